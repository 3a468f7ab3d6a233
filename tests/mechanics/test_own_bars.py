"""Which bars of a mechanism can meet each other, and how far they are from each other, against Shapely."""

from itertools import combinations

import numpy as np
import pytest
import shapely

from tensegrity_envs.compiler.kernel import Kernel
from tensegrity_envs.compiler.pytree import Schema
from tensegrity_envs.geometry.clearance import bars_of, clearance, signed_distance
from tensegrity_envs.geometry.own_bars import own_pairs
from tensegrity_envs.mechanics import MURALIDHARAN2022, NX, THREE_X, ZHAO2021_CAPTION, DualTriangle, PlanarFourBar, TwoX

COUNT = 100
# Rigid bodies by their bars, then pairs of bodies that a pin joins or that lie in different planes by construction.
BODIES = {
    "two_x": (
        "A1C1 / B1D1 / D1C1 D1A2 D1B2 C1B2 A2B2 / A2C2 / B2D2 / D2C2 D2P C2P",
        [(0, 1), (0, 2), (1, 2), (2, 3), (2, 4), (3, 4), (3, 5), (4, 5)],
    ),
    "three_x": (
        "A1C1 / B1D1 / D1C1 D1A2 D1B2 C1B2 A2B2 / A2C2 / B2D2 / D2C2 D2A3 D2B3 C2B3 A3B3 / A3C3 / B3D3 / D3C3 D3P C3P",
        [(0, 1), (0, 2), (1, 2), (2, 3), (2, 4), (3, 4), (3, 5), (4, 5), (5, 6), (5, 7), (6, 7), (6, 8), (7, 8)],
    ),
    "three_triangles": (
        "A1B1 A1O1 B1O1 / D1C1 D1O1 C1O1 A2O2 B2O2 / D2C2 D2O2 C2O2 A3O3 B3O3 / D3C3 D3O3 C3O3",
        [(0, 1), (1, 2), (2, 3)],
    ),
    "four_bar": ("AD / BC / DE / CF", [(0, 2), (1, 3), (2, 3)]),
}
ARMS = {
    "two_x": TwoX(MURALIDHARAN2022),
    "three_x": NX(THREE_X),
    "three_triangles": DualTriangle(ZHAO2021_CAPTION, 3),
    "four_bar": PlanarFourBar(),
}
every_arm = pytest.mark.parametrize("name", ARMS)


def ends_of(arm):
    return {member.name: "".join(member.nodes) for member in arm.members if member.kind == "bar"}


def postures(arm, count, widest=2.6):
    """Configurations, and inputs where nodes depend on them, within the limits."""
    rng = np.random.default_rng(7)
    if isinstance(arm, PlanarFourBar):
        lengths = 2 * float(arm.length) * rng.uniform(0.01, 0.99, (2, 20 * count))
        lengths = lengths[:, 2 * np.min(arm.flatness(tuple(lengths)), axis=0) > 0.02][:, :count]
        return arm.rectangle(tuple(lengths), rng.choice([-1.0, 1.0], count))[0], tuple(lengths)
    limit = min(float(arm.design.joint_limit), widest)
    joints = arm.segments if isinstance(arm, DualTriangle) else arm.degrees_of_freedom
    return tuple(rng.uniform(-limit, limit, (joints, count))), None


def by_shapely(first, second):
    """The distance of segments (2, 2, k); where they cross, how deep the origin is in their Minkowski difference."""
    found = shapely.distance(*(shapely.linestrings(ends.transpose(2, 0, 1)) for ends in (first, second)))
    for i in np.flatnonzero(found == 0):
        corners = [p - q for p in first[..., i] for q in second[..., i]]
        found[i] = -shapely.MultiPoint(corners).convex_hull.exterior.distance(shapely.Point(0, 0))
    return found


@every_arm
def test_pairs_are_those_of_bodies_that_are_not_joined(name):
    arm = ARMS[name]
    bodies, joined = BODIES[name]
    bodies = [body.split() for body in bodies.split(" / ")]
    expected = {
        frozenset((one, other))
        for i, j in combinations(range(len(bodies)), 2)
        if (i, j) not in joined
        for one in bodies[i]
        for other in bodies[j]
    }
    names = ends_of(arm)
    assert {frozenset((names[one], names[other])) for one, other in own_pairs(arm)} == expected


@every_arm
def test_the_clearance_of_own_bars_is_shapelys(name):
    arm, (q, inputs) = ARMS[name], postures(ARMS[name], COUNT)
    pairs, bars = own_pairs(arm), bars_of(arm, q, inputs)
    ends = {key: np.array([[np.broadcast_to(x, COUNT) for x in end] for end in bar]) for key, bar in bars.items()}
    expected = np.min([by_shapely(ends[one], ends[other]) for one, other in pairs], axis=0)
    np.testing.assert_allclose(clearance(arm, q, (), inputs, pairs), expected, rtol=0, atol=1e-9 * float(arm.reach))
    assert (expected < 0).any() or name in ("two_x", "three_triangles")  # too short to reach themselves
    assert (expected > 0).sum() > 10


@every_arm
def test_bars_that_are_left_out_do_not_meet_or_always_cross(name):
    arm, (q, inputs) = ARMS[name], postures(ARMS[name], 5000)
    if name == "four_bar":
        return  # AD and DE, BC and CF have an end in common; DE and CF are the diagonals of a rectangle
    bars, pairs = bars_of(arm, q, inputs), own_pairs(arm)
    for one, other in combinations(bars, 2):
        if (one, other) not in pairs:
            (ax, ay), (bx, by) = bars[one]
            (cx, cy), (dx, dy) = bars[other]
            first, second = (ax, ay, bx, by), (cx, cy, dx, dy)
            points = [((cx, cy), first), ((dx, dy), first), ((ax, ay), second), ((bx, by), second)]
            sides = [(x2 - x1) * (y - y1) - (y2 - y1) * (x - x1) for (x, y), (x1, y1, x2, y2) in points]
            sides = [np.where(abs(side) < 1e-12 * float(arm.reach) ** 2, 0.0, side) for side in sides]
            crossed = (sides[0] * sides[1] < 0) & (sides[2] * sides[3] < 0)
            assert crossed.all() or not crossed.any(), (one, other)


def test_the_depth_of_crossing_segments_is_the_shortest_displacement():
    rng = np.random.default_rng(0)
    ends = rng.uniform(-1, 1, (4, 2, 2000))
    found = signed_distance((tuple(ends[0]), tuple(ends[1])), (tuple(ends[2]), tuple(ends[3])))
    np.testing.assert_allclose(found, by_shapely(ends[:2], ends[2:]), rtol=0, atol=1e-12)
    assert (found < 0).sum() > 200


def test_floats_tensors_and_compiled_code_give_what_arrays_give():
    torch = pytest.importorskip("torch")
    arm, (q, _) = ARMS["three_x"], postures(ARMS["three_x"], 20)
    pairs = own_pairs(arm)
    expected = clearance(arm, q, (), None, pairs)
    compiled = Kernel(lambda q: clearance(arm, q, (), None, pairs), Schema(q))(np.stack(q))[0]
    np.testing.assert_allclose(compiled, expected, atol=1e-12)
    tensors = clearance(arm, tuple(torch.as_tensor(angle) for angle in q), (), None, pairs)
    np.testing.assert_allclose(tensors, expected, atol=1e-12)
    floats = [clearance(arm, tuple(float(angle[i]) for angle in q), (), None, pairs) for i in range(20)]
    np.testing.assert_allclose(floats, expected, atol=1e-12)
