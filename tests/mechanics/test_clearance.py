"""Clearance of arms from obstacles, against Shapely."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from tensegrity_envs.compiler.kernel import Kernel
from tensegrity_envs.compiler.pytree import Schema
from tensegrity_envs.geometry.clearance import Disc, Polygon, Wall, bars_of, clearance, segment_distance
from tensegrity_envs.geometry.own_bars import own_pairs
from tensegrity_envs.mechanics import (
    MURALIDHARAN2022,
    NX,
    THREE_X,
    ZHAO2021_CAPTION,
    DualTriangle,
    PlanarFourBar,
    SpatialPrism,
    TwoX,
)

ARMS = {"two_x": TwoX(MURALIDHARAN2022), "three_x": NX(THREE_X), "five_triangles": DualTriangle(ZHAO2021_CAPTION, 5)}
COUNT = 200


def random_polygon(rng):
    angles = np.sort(rng.uniform(0, 2 * np.pi, 12))
    hull = shapely.MultiPoint(rng.uniform(-0.5, 0.9, 2) + 0.2 * np.stack([np.cos(angles), np.sin(angles)], 1))
    ring = shapely.geometry.polygon.orient(hull.convex_hull.simplify(1e-3)).exterior.coords[:-1]
    return Polygon(tuple(ring))


def by_shapely(obstacle, bar):
    line = shapely.LineString(bar)
    if isinstance(obstacle, Disc):
        return line.distance(shapely.Point(obstacle.centre)) - obstacle.radius
    if isinstance(obstacle, Wall):
        normal = np.array(obstacle.normal) / np.linalg.norm(obstacle.normal)
        return min((np.array(end) - obstacle.point) @ normal for end in bar)
    # apart, the distance; else how deep the origin is in the Minkowski difference
    apart = line.distance(shapely.Polygon(obstacle.corners))
    if apart > 0:
        return apart
    difference = shapely.MultiPoint([np.subtract(p, end) for p in obstacle.corners for end in bar]).convex_hull
    return -difference.exterior.distance(shapely.Point(0, 0))


@pytest.mark.parametrize("name", ARMS)
def test_the_clearance_is_shapelys(name):
    arm, rng = ARMS[name], np.random.default_rng(len(name))
    joints = 5 if name == "five_triangles" else arm.degrees_of_freedom
    limit = 0.9 * arm.design.joint_limit if name == "five_triangles" else 2.6
    q = tuple(rng.uniform(-limit, limit, (joints, COUNT)))
    obstacles = [Disc(tuple(rng.uniform(-0.6, 0.9, 2)), rng.uniform(0.02, 0.3)) for _ in range(3)]
    obstacles += [random_polygon(rng) for _ in range(3)]
    obstacles += [Wall(tuple(rng.uniform(-0.6, 0.6, 2)), tuple(rng.normal(size=2)))]
    overlaps = 0
    for obstacle in obstacles:
        found = clearance(arm, q, [obstacle])
        for i in range(COUNT):
            bars = bars_of(arm, tuple(float(angle[i]) for angle in q)).values()
            assert found[i] == pytest.approx(min(by_shapely(obstacle, bar) for bar in bars), abs=1e-9)
        overlaps += (found < 0).sum()
    assert overlaps > COUNT / 10
    whole = clearance(arm, q, obstacles)
    np.testing.assert_array_equal(whole, np.min([clearance(arm, q, [one]) for one in obstacles], axis=0))


def test_the_distance_of_segments_is_shapelys():
    rng = np.random.default_rng(0)
    ends = np.round(rng.uniform(-1, 1, (2000, 4, 2)), 1)  # many touch, are parallel or of no length
    found = segment_distance(*(tuple(tuple(ends[:, i].T) for i in pair) for pair in ((0, 1), (2, 3))))
    expected = shapely.distance(shapely.linestrings(ends[:, :2]), shapely.linestrings(ends[:, 2:]))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    assert (expected == 0).sum() > 100


def test_bad_obstacles_are_explained():
    for make, message in (
        (lambda: Disc((0.0, 0.0), 0.0), "positive radius"),
        (lambda: Disc((0.0, float("nan")), 1.0), "finite"),
        (lambda: Polygon(((0, 0), (1, 0))), "three corners"),
        (lambda: Polygon(((0, 0), (0, 1), (1, 0))), "counter-clockwise"),
        (lambda: Polygon(((0, 0), (1, 0), (0.2, 0.2), (0, 1))), "convex"),
        (lambda: Wall((0.0, 0.0), (0.0, 0.0)), "normal not zero"),
        (lambda: clearance(ARMS["two_x"], (0.0, 0.0), []), "one or more"),
        (lambda: clearance(ARMS["two_x"], (0.0, 0.0), [], own=[("bar 1", "bar x")]), "own: bar x: bars are bar 1, "),
        (lambda: Disc(1.0, 1.0), r"Disc\(centre=1.0, radius=1.0\): must have a centre \(x, y\)"),
        (lambda: Disc(("a", "b"), 1.0), "must have a centre"),
        (lambda: Disc((0.0, 0.0), None), "positive radius"),
        (lambda: Polygon("abc"), "corners='abc'.*: must have three corners"),
        (lambda: Polygon(((0, 0), (1,), (0, 1))), "three corners"),
        (lambda: Polygon(((0, 0), (1, 0), (0, 1), (0, 0))), "each of them once"),
        (lambda: Polygon(((0, 0), (1, 0), (2, 0), (0, 1))), "none on the line between two others"),
        (lambda: Wall(0.0, (0.0, 1.0)), r"point and normal must be \(x, y\)"),
        (lambda: Wall((0.0, 0.0, 0.0), (1.0,)), r"point and normal must be \(x, y\)"),
        (lambda: own_pairs(TwoX(replace(MURALIDHARAN2022, b=np.array([0.05, 0.04])))), "own_pairs takes one design"),
    ):
        with pytest.raises(ValueError, match=message):
            make()
    disc = Disc((0.0, 0.5), 0.1)
    for given in (disc, [{"centre": (0.0, 0.5), "radius": 0.1}], "disc", 3):
        with pytest.raises(TypeError, match=r"obstacles = .*: must be a list or tuple of Disc, Polygon and Wall"):
            clearance(ARMS["two_x"], (0.0, 0.0), given)
    for spatial in (lambda: own_pairs(SpatialPrism()), lambda: clearance(SpatialPrism(), (0.0,) * 6, [disc])):
        with pytest.raises(TypeError, match=r"SpatialPrism: .* planar mechanisms"):
            spatial()
    for own in (True, "bar 1", [("bar 1", "bar 8", "bar 9")]):
        with pytest.raises(TypeError, match=r"own = .*: must be pairs of names of bars; own_bars.own_pairs"):
            clearance(ARMS["two_x"], (0.0, 0.0), [disc], own=own)
    with pytest.raises(TypeError, match=r"mechanism = NXDesign.*: must have nodes and members"):
        clearance(THREE_X, (0.0,) * 3, [disc])
    with pytest.raises(TypeError, match="PlanarFourBar: its nodes depend on its lengths: give them as inputs"):
        clearance(PlanarFourBar(), (0.1, 0.2), [disc])


@pytest.mark.parametrize("size", [1e-320, 1e-170, 3.0, 1e170, 1e308])
def test_the_length_of_a_normal_does_not_count(size):
    bar = ((1.0, 1.0), (2.0, 3.0))
    assert Wall((0.0, 0.5), (size, size)).clearance(bar) == pytest.approx(1.5 / np.sqrt(2))


def test_floats_tensors_and_compiled_code_give_what_arrays_give():
    torch = pytest.importorskip("torch")
    arm, rng = ARMS["three_x"], np.random.default_rng(2)
    q = tuple(rng.uniform(-2.6, 2.6, (3, 50)))
    obstacles = (Disc((0.3, 0.4), 0.1), random_polygon(rng), Wall((0.0, -0.3), (0.1, 1.0)))
    expected = clearance(arm, q, obstacles)
    compiled = Kernel(lambda q: clearance(arm, q, obstacles), Schema(q))(np.stack(q))[0]
    np.testing.assert_allclose(compiled, expected, atol=1e-12)
    tensors = clearance(arm, tuple(torch.as_tensor(angle) for angle in q), obstacles)
    np.testing.assert_allclose(tensors, expected, atol=1e-12)
    floats = [clearance(arm, tuple(float(angle[i]) for angle in q), obstacles) for i in range(50)]
    np.testing.assert_allclose(floats, expected, atol=1e-12)
