"""Equilibria of the n-X: complete against Newton's method from many starts; the one that is reached from a start."""

import pytest
from n_x_checks import distance_after_release, missed_equilibria


@pytest.mark.parametrize("joints", (1, 2, 3))
def test_no_equilibrium_is_missed(joints):
    found = 0
    for seed in range(8):
        by_starts, ours, missed = missed_equilibria(seed, joints, 500)
        assert not missed, (seed, missed)
        assert ours >= by_starts
        found += ours
    assert found >= 8


@pytest.mark.parametrize("joints", (4, *(pytest.param(n, marks=pytest.mark.full) for n in (5, 6))))
def test_the_stable_equilibrium_is_reached_from_the_start(joints):
    """Under stiff tensions that hold a posture, released from beside it, the arm comes back to it."""
    distances = [distance_after_release(seed, joints) for seed in range(12)]
    found = [distance for distance in distances if distance is not None]
    assert len(found) >= 4
    assert max(found) < 1e-7
