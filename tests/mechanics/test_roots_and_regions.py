"""Regions with known boundaries: areas, holes, corners, components, slices, and images with known preimages."""

import json
import math

import numpy as np
import pytest
import shapely
from scipy.optimize import brentq

from tensegrity_envs.geometry.overlay import cut, feature_collection, image, winding_numbers
from tensegrity_envs.geometry.regions import LIMIT, Region, signed_area
from tensegrity_envs.mechanics.roots import bracketed_roots, hidden_sign_changes

UNIT = ((-1.0, -1.0), (1.0, 1.0))


def disc(radius, x=0.0, y=0.0, box=((-2.0, -2.0), (2.0, 2.0))):
    return Region(lambda q1, q2: (radius**2 - (q1 - x) ** 2 - (q2 - y) ** 2,), ("disc",), *box)


def test_bracketed_roots_agree_with_brentq():
    rng = np.random.default_rng(0)
    a, b, c = rng.uniform(-3, 3, (3, 500))

    def f(x, a, b, c):
        return np.sin(a * x) + np.exp(b * x) - np.abs(c * x - 0.3) - 1.2

    low, high = np.full(500, -2.0), np.full(500, 1.5)
    good = f(low, a, b, c) * f(high, a, b, c) < 0
    assert good.sum() > 100
    a, b, c, low, high = (v[good] for v in (a, b, c, low, high))
    roots = bracketed_roots(lambda x: f(x, a, b, c), low, high)
    assert np.abs(f(roots, a, b, c)).max() < 1e-13
    for k in range(0, len(a), 10):
        assert f(brentq(lambda x, k=k: f(x, a[k], b[k], c[k]), -2.0, 1.5, xtol=1e-15), a[k], b[k], c[k]) < 1e-12


def test_bracketed_roots_at_ends_kinks_and_steep_places():
    assert bracketed_roots(lambda x: x, np.zeros(0), np.zeros(0)).shape == (0,)
    np.testing.assert_array_equal(bracketed_roots(lambda x: x, np.array([0.0, -1.0]), np.array([1.0, 0.0])), [0, 0])
    kinked = bracketed_roots(lambda x: np.minimum(x - 0.2, 1e-3 * (x - 0.2)), np.array([-5.0]), np.array([1.0]))
    assert kinked[0] == pytest.approx(0.2, abs=1e-11)
    steep = bracketed_roots(lambda x: np.tan(x) - 1e6, np.array([0.0]), np.array([math.pi / 2 - 1e-9]))
    assert steep[0] == pytest.approx(math.atan(1e6), abs=1e-15)


@pytest.mark.parametrize("width", [1e-2, 1e-3, 1e-4])
def test_humps_much_narrower_than_a_step_are_found(width):
    x = np.linspace(-1, 1, 101)[None, :] + np.zeros((40, 1))
    centres = np.random.default_rng(1).uniform(-0.9, 0.9, 40)

    def kinked(line, s):
        return width - np.abs(s - centres[line]) * (1 + (s > centres[line]))

    line, place = hidden_sign_changes(kinked, x, kinked(np.arange(40)[:, None], x))
    inside = kinked(np.arange(40)[:, None], x) > 0
    assert set(np.flatnonzero(~inside.any(axis=1))) <= set(line)
    assert (kinked(line, place) > 0).all()


@pytest.mark.parametrize("resolution", [16, 64, 200])
def test_disc(resolution):
    traced = disc(1.0).trace(resolution)
    assert traced.area == pytest.approx(math.pi, abs=1e-9)
    assert abs(sum(signed_area(r.points) for r in traced.rings) - math.pi) < 1.001 * traced.area_error < 1e-4
    assert len(traced.components) == 1
    radius = np.hypot(*traced.rings[0].points.T)
    assert np.abs(radius - 1).max() < 1e-12
    assert traced.lengths()["disc"] == pytest.approx(2 * math.pi, abs=1e-4)


def test_ring_with_a_hole_beside_a_small_disc():
    def conditions(q1, q2):
        r = np.hypot(q1, q2)
        ring = np.minimum(1.5 - r, r - 0.8)
        return (np.maximum(ring, 0.05 - np.hypot(q1 - 1.8, q2 - 1.8)),)

    traced = Region(conditions, ("either",), (-2.0, -2.0), (2.0, 2.0)).trace(48)
    assert [len(c.holes) for c in traced.components] == [1, 0]
    assert traced.components[0].area == pytest.approx(math.pi * (1.5**2 - 0.8**2), abs=1e-7)
    assert traced.components[1].area == pytest.approx(math.pi * 0.05**2, abs=1e-8)
    assert traced.components[0].outer.points[:, 0].max() == pytest.approx(1.5, abs=1e-6)


def test_a_disc_smaller_than_a_cell_makes_the_grid_finer():
    small = Region(lambda q1, q2: (0.01 - np.hypot(q1 - 0.111, q2 - 0.0777),), ("disc",), *UNIT)
    assert small.trace(16, finest=16).is_empty
    found = small.trace(16)
    assert found.resolution > 16
    assert found.area == pytest.approx(math.pi * 1e-4, abs=1e-9)


def test_corners_are_exact():
    """A lens of two discs: its corners are where both conditions are zero."""
    lens = disc(1.0, x=-0.5).with_condition("second", lambda q1, q2: 1 - (q1 - 0.5) ** 2 - q2**2)
    traced = lens.trace(40)
    assert traced.area == pytest.approx(2 * math.pi / 3 - math.sqrt(3) / 2, abs=1e-9)
    points = traced.rings[0].points
    for corner in ((0, math.sqrt(0.75)), (0, -math.sqrt(0.75))):
        assert np.hypot(*(points - corner).T).min() < 1e-12
    lengths = traced.lengths()
    assert lengths["disc"] == pytest.approx(2 * math.pi / 3, abs=1e-5) == lengths["second"]
    assert lengths["unresolved"] == 0


def test_what_is_cut_by_the_box():
    traced = disc(1.0, x=2.0).trace(40)
    assert traced.area == pytest.approx(math.pi / 2, abs=1e-9)
    assert traced.lengths()[LIMIT] == pytest.approx(2.0, abs=1e-12)
    everything = Region(lambda q1, q2: (1 + 0 * q1,), ("one",), *UNIT).trace(8)
    assert everything.area == pytest.approx(4.0, abs=1e-12)
    assert everything.lengths() == {"one": 0.0, LIMIT: pytest.approx(8.0), "unresolved": 0.0}
    assert everything.fraction == pytest.approx(1.0, abs=1e-12)


def test_empty_and_bad_input():
    empty = Region(lambda q1, q2: (-1 + 0 * q1,), ("never",), *UNIT).trace()
    assert empty.is_empty
    assert (empty.area, empty.area_error, empty.fraction, empty.bounds()) == (0, 0, 0, None)
    assert empty.to_features() == []
    with pytest.raises(ValueError, match="box"):
        disc(1.0, box=((0.0, 0.0), (0.0, 1.0)))
    with pytest.raises(ValueError, match="finite"):
        disc(1.0, box=((0.0, 0.0), (math.inf, 1.0)))
    with pytest.raises(ValueError, match="differ"):
        Region(lambda q1, q2: (q1, q2), ("a", "a"), *UNIT)
    for bad in (-3.0, math.nan):
        with pytest.raises(ValueError, match="values"):
            disc(1.0).slices(0, [bad])
    with pytest.raises(ValueError, match="fixed"):
        disc(1.0).slices(2, [0.0])
    with pytest.raises(ValueError, match="resolution"):
        disc(1.0).trace(1)
    nowhere = Region(lambda q1, q2: (np.sqrt(q1 - 0.5),), ("root",), *UNIT)  # not a number where it is not defined
    assert nowhere.trace(32).area == pytest.approx(1.0, abs=1e-6)


def test_slices_of_a_disc():
    region = disc(1.0, x=0.3)
    heights = np.linspace(-1.5, 1.5, 31)
    for y, found in zip(heights, region.slices(1, heights, 33), strict=True):
        if abs(y) >= 1:
            assert found == []
        else:
            half = math.sqrt(1 - y * y)
            assert found[0][:2] == pytest.approx((0.3 - half, 0.3 + half), abs=1e-13)
            assert found[0][2:] == ("disc", "disc")
    ((low, high, a, b),) = disc(1.0, x=2.0).slices(1, 0.0)[0]
    assert (low, high, a, b) == (pytest.approx(1.0, abs=1e-14), 2.0, "disc", LIMIT)


def test_scan_covers_both_directions():
    cloud = disc(1.0).scan(41)
    assert np.abs(np.hypot(*cloud.points.T) - 1).max() < 1e-13
    assert sorted(set(cloud.fixed.tolist())) == [0, 1]
    assert set(cloud.conditions) == {"disc"}


def test_geojson_is_valid_and_closed():
    document = json.loads(json.dumps(feature_collection(disc(1.0).trace(32).to_features(), coordinates="m")))
    shape = shapely.geometry.shape(document["features"][0]["geometry"])
    assert shape.is_valid
    assert shape.area == pytest.approx(math.pi, abs=1e-3)


def test_winding_numbers():
    t = np.linspace(0, 4 * math.pi, 400, endpoint=False)
    twice = np.stack([np.cos(t), np.sin(t)], axis=1) * (1 + 0.2 * np.sin(t / 2))[:, None]
    points = np.array([[0.0, 0.0], [3.0, 0.0], [0.0, -5.0]])
    assert winding_numbers([twice], points).tolist() == [2, 0, 0]
    assert winding_numbers([twice[::-1]], points).tolist() == [-2, 0, 0]
    assert winding_numbers([], points).tolist() == [0, 0, 0]


def test_cutting_squares():
    square = np.array([[0, 0], [2, 0], [2, 2], [0, 2], [0, 0]], float)
    faces = cut([square, square + 1, np.array([[5.0, 5.0], [6.0, 6.0]])])
    assert sorted(face.area for face in faces) == pytest.approx([1, 3, 3])
    assert cut([]) == []
    assert len(cut([square, square + 1e-12])) == 1  # rounding between curves that should be one is no face


def test_image_of_a_map_that_covers_twice():
    """z -> z^2 on the ring 0.5 < |z| < 1 without a sector: angles of 300 degrees become 600, so the image overlaps."""
    sector = math.radians(300)

    def conditions(r, angle):
        return (np.minimum(r - 0.5, 1 - r), np.minimum(angle, sector - angle))

    def squared(q):
        r, angle = q
        return r**2 * np.cos(2 * angle), r**2 * np.sin(2 * angle)

    ring = Region(conditions, ("radius", "angle"), (0.3, -0.2), (1.2, 6.0)).trace(64, image=squared, finest=64)
    found = image({"sheet": ring}, squared)
    once = math.pi * (1 - 0.5**4) * (360 * 2 - 600) / 360
    twice = math.pi * (1 - 0.5**4) * (600 - 360) / 360
    assert found.sheets[0].area == pytest.approx(once + 2 * twice, abs=1e-3)
    assert found.overlap == pytest.approx(twice, abs=1e-3)
    assert found.area() == pytest.approx(once + twice, abs=1e-3)
    assert found.most == (2, 2)
    assert found.holes[0].area == pytest.approx(math.pi * 0.5**4, abs=1e-3)
    assert found.count([0.7, 0.0, 3.0], [0.01, 0.0, 0.0]).tolist() == [2, 0, 0]
    spans = found.along((-2.0, 0.01), (2.0, 0.01))
    # Chords of the two layers differ a little along their common edges.
    assert [n for p, q, n in spans if q[0] - p[0] > 1e-3] == [found.count(-0.6, 0.01), found.count(0.6, 0.01)] == [2, 2]
