"""The shortest way past a disc, against a shortest path by brute force."""

import numpy as np
import pytest

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.geometry.obstacle_path import Disc, shortest_path

DISC = Disc(10.0, 10.0, 1.5)


def by_brute_force(start, end, count=4000):
    """Over the edge of the disc: straight if free, else to a point of the edge that is seen, along it, and on."""
    t = np.linspace(0, 1, 400)[:, None]
    line = start + t * (end - start)
    if np.hypot(*(line - 10.0).T).min() >= DISC.radius:
        return np.hypot(*(end - start))
    angles = np.linspace(-np.pi, np.pi, count, endpoint=False)
    edge = 10.0 + DISC.radius * np.stack([np.cos(angles), np.sin(angles)], 1)

    def seen(point):
        inside = (point + np.linspace(0, 1, 200)[:, None, None] * (edge - point) - 10.0)[:-1]
        return np.hypot(inside[..., 0], inside[..., 1]).min(axis=0) >= DISC.radius - 1e-3

    first, last = np.flatnonzero(seen(start))[:, None], np.flatnonzero(seen(end))[None]
    turn = np.abs(angles[first] - angles[last])
    arc = DISC.radius * np.minimum(turn, 2 * np.pi - turn)
    to, on = np.hypot(*(edge - start).T), np.hypot(*(edge - end).T)
    return (to[first] + arc + on[last]).min()


def test_lengths_are_those_of_brute_force():
    rng = np.random.default_rng(0)
    points = rng.uniform(5.0, 15.0, (400, 2, 2))
    points = points[(np.hypot(*(points - 10.0).transpose(2, 0, 1)) > 1.6).all(axis=1)][:120]
    blocked = 0
    for start, end in points:
        expected = by_brute_force(start, end)
        length, _ = shortest_path(tuple(start), tuple(end), DISC)
        assert length == pytest.approx(expected, abs=5e-3)
        blocked += expected > np.hypot(*(end - start)) + 1e-6
    assert blocked > 10


def test_heading_for_the_corners_leads_to_the_end_round_the_disc():
    rng = np.random.default_rng(1)
    start, end = (
        10.0 + r * np.stack([np.cos(a), np.sin(a)])
        for r, a in ((rng.uniform(1.5, 9, 2000), rng.uniform(-np.pi, np.pi, 2000)) for _ in range(2))
    )
    here, walked = start.copy(), np.zeros(2000)
    for _ in range(600):
        _, corner = evaluate(shortest_path, tuple(here), tuple(end), DISC)
        gap = np.stack(corner) - here
        size = np.hypot(*gap)
        step = np.minimum(size, 0.05)
        here = here + gap * step / np.maximum(size, 1e-12)
        walked += step
        assert np.hypot(*(here - 10.0)).min() > 1.5 - 0.01
    np.testing.assert_allclose(here, end, atol=1e-9)
    shortest, _ = shortest_path(tuple(start), tuple(end), DISC)
    assert (walked >= shortest - 1e-6).all()
    assert (walked / shortest).max() < 1.2


def test_floats_and_arrays_agree_and_a_start_at_the_centre_has_a_way():
    ways = shortest_path((np.array([4.0, 10.0]), np.array([10.2, 10.0])), (np.array([16.0, 13.0]), 10.0), DISC)
    for k, start in enumerate(((4.0, 10.2), (10.0, 10.0))):
        one = shortest_path(start, ((16.0, 13.0)[k], 10.0), DISC)
        np.testing.assert_allclose([one[0], *one[1]], [ways[0][k], ways[1][0][k], ways[1][1][k]])
        assert np.isfinite(one[0])
