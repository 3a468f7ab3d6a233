"""No inverse solution and no equilibrium is lost at seams, singularities, joint limits, or as bars become equal."""

import math

import numpy as np
import pytest
from brute_force import missed_by_planar_four_bar, missed_by_two_x
from scipy.optimize import brentq

from tensegrity_envs.geometry.workspace import stable_wrench_feasible_joint_space, stable_wrench_feasible_workspace
from tensegrity_envs.mechanics import FURET2018, JI2014, MURALIDHARAN2022, PlanarFourBar, SpatialPrism, TwoX, TwoXDesign
from tensegrity_envs.mechanics.intervals import Interval
from tensegrity_envs.mechanics.roots import circle_roots

FOUR_BAR = PlanarFourBar(JI2014)


@pytest.mark.parametrize("k", range(40))
@pytest.mark.parametrize("missed_by", [missed_by_two_x, missed_by_planar_four_bar], ids=["two-x", "planar-four-bar"])
def test_no_equilibrium_is_missed_that_brute_force_finds(missed_by, k):
    *_, missed, _, what = missed_by(np.random.default_rng([1, k]), 400)
    assert not missed, what


@pytest.mark.parametrize(("lengths", "load", "count", "stable"), [((10, 10), (5, 0), 4, 1), ((16, 16), (-30, 0), 4, 1)])
def test_states_at_the_seam_of_the_circle(lengths, load, count, stable):
    """A horizontal force on equal lengths: states at gamma = 0 and +-pi."""
    found = FOUR_BAR.equilibria(lengths, load)
    assert len(found) == count
    assert sum(state.is_stable for state in found) == stable
    assert max(state.residual for state in found) < 1e-9 * JI2014.stiffness * JI2014.length**2
    assert {round(abs(state.configuration[1]), 6) for state in found} == {0.0, round(math.pi, 6)}


@pytest.mark.parametrize("turn", np.linspace(-3, 3, 13))
def test_scans_of_a_circle_have_no_seam(turn):
    """The same roots wherever the circle is cut; roots at +-pi, double ones among them."""

    def f(line, angle):
        return np.where(line == 0, np.sin(3 * (angle - turn)), np.cos(angle - turn) - 1 + 1e-9)

    line, angle = circle_roots(f, 2, 180)
    roots = np.sort((angle[line == 0] - turn + 1e-9) % (2 * np.pi))
    np.testing.assert_allclose(roots, np.arange(6) * np.pi / 3 + 1e-9, atol=1e-9)
    near = np.sort((angle[line == 1] - turn + np.pi) % (2 * np.pi) - np.pi)
    np.testing.assert_allclose(near, [-math.sqrt(2e-9), math.sqrt(2e-9)], rtol=1e-4)


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("load", [(5.0, 10.0), (-20.0, 3.0)])
def test_loaded_inverse_solutions_with_an_actuator_at_its_end(which, load):
    """States with rho = 2 L exactly: the tip of each is solved by the lengths that it has."""
    lengths = [7.0, 7.0]
    lengths[which] = 2 * JI2014.length
    states = FOUR_BAR.equilibria(lengths, load)
    assert states
    for state in states:
        found = FOUR_BAR.inverse_kinematics(*state.tip, load)
        assert min(max(abs(a - b) for a, b in zip(s.lengths, lengths, strict=True)) for s in found) < 1e-5


def lost(arm, configurations, tolerance=1e-5):
    """Those that are not among the inverse solutions of their own tip."""
    missing = []
    for q in configurations:
        found = arm.inverse_kinematics(*(float(part) for part in arm.tip(tuple(q))))
        gaps = [max(abs(math.remainder(a - b, 4 * math.pi)) for a, b in zip(s.configuration, q)) for s in found]
        if not gaps or min(gaps) > tolerance:
            missing.append(tuple(q))
    return missing


def singular(arm, limit, count, rng):
    """Configurations with det J = 0."""
    found = []
    grid = np.linspace(-limit, limit, 400)
    while len(found) < count:
        a1 = rng.uniform(-limit, limit)
        values = arm.jacobian_determinant((np.full(400, a1), grid))
        change = np.flatnonzero(values[1:] * values[:-1] < 0)
        if len(change):
            i = rng.choice(change)
            a2 = brentq(lambda a2, a1=a1: arm.jacobian_determinant((a1, a2)), grid[i], grid[i + 1], xtol=1e-15)
            if math.hypot(*arm.tip((a1, a2))) > 1e-6:  # the base of a plain arm is singular in another way
                found.append((a1, a2))
    return found


ARMS = {
    "offsets": TwoX(MURALIDHARAN2022),
    "plain 0.4": TwoX(FURET2018(0.4)),
    "plain 0.9": TwoX(FURET2018(0.9)),
    "limited": TwoX(FURET2018(0.4, 2 * math.pi / 3)),
}


@pytest.mark.parametrize("name", ARMS)
def test_inverse_solutions_at_and_next_to_singularities(name):
    arm = ARMS[name]
    rng = np.random.default_rng(0)
    places = singular(arm, 0.999 * min(arm.design.joint_limit, 2 * math.pi), 60, rng)
    assert not lost(arm, places)
    assert not lost(arm, [(a1, a2 + 1e-8 * rng.uniform(-1, 1)) for a1, a2 in places])


@pytest.mark.parametrize("limit", [2.6, 2 * math.pi / 3, 1.0])
@pytest.mark.parametrize("design", [MURALIDHARAN2022, FURET2018(0.4), FURET2018(0.9)])
def test_inverse_solutions_at_joint_limits(design, limit):
    arm = TwoX(TwoXDesign(**{**vars(design), "joint_limit": limit}))
    rng = np.random.default_rng(1)
    q = rng.uniform(-limit, limit, (150, 2))
    q[np.arange(150), rng.integers(0, 2, 150)] = limit * rng.choice([-1, 1], 150)
    q[:4] = [(a, b) for a in (-limit, limit) for b in (-limit, limit)]
    assert not lost(arm, q)
    for place in q:
        for solution in arm.inverse_kinematics(*(float(part) for part in arm.tip(tuple(place)))):
            assert max(map(abs, solution.configuration)) <= limit


@pytest.mark.parametrize("closeness", [1e-2, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("a", [0.0, 0.3])
@pytest.mark.parametrize("count", [25, pytest.param(150, marks=pytest.mark.full)])
def test_inverse_solutions_as_bars_become_equal(a, closeness, count):
    design = TwoXDesign(b=1 - closeness, l=1.0, a=a, k1=1.0, k2=1.0, min_tension=0.0, max_tension=1.0)
    assert not lost(TwoX(design), np.random.default_rng(0).uniform(-3.1, 3.1, (count, 2)))


@pytest.mark.parametrize("b", [0.4, 0.9])
def test_the_straight_plain_arm_is_its_own_only_solution(b):
    arm = TwoX(FURET2018(b, math.pi))
    (solution,) = [s for s in arm.inverse_kinematics(*arm.tip((0.0, 0.0))) if max(map(abs, s.configuration)) < 0.1]
    np.testing.assert_allclose(solution.configuration, 0.0, atol=1e-5)


def test_flat_poses_are_no_solutions_where_the_limits_leave_them_out():
    assert TwoX(MURALIDHARAN2022).inverse_kinematics(0, 0) == []


@pytest.mark.parametrize("closeness", [1e-1, 2e-4, 1e-5, 1e-8])
def test_equilibria_as_bars_become_equal(closeness):
    design = TwoXDesign(b=0.1 * (1 - closeness), l=0.1, a=0.2, k1=600.0, k2=300.0, min_tension=5.0, max_tension=155.0)
    found = TwoX(design).equilibria((60.0, 20.0, 15.0, 40.0))
    assert len(found) == 5
    assert sum(state.is_stable for state in found) == 1


def test_equilibria_that_form_a_continuum_are_named():
    with pytest.raises(ValueError, match="continuum"):
        TwoX(FURET2018(0.5)).equilibria((0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("seed", range(20))
def test_bounds_of_intervals_hold(seed):
    """Gradient and Hessian on random boxes contain what they are at random points of these."""
    rng = np.random.default_rng(seed)
    arm, tensions, load = TwoX(MURALIDHARAN2022), tuple(rng.uniform(5, 155, 4)), tuple(rng.normal(size=2))
    centre, half = rng.uniform(-2.5, 2.5, (2, 50)), 10 ** rng.uniform(-6, 0, (2, 50))
    gradient, hessian = arm.statics(tuple(Interval(c - h, c + h) for c, h in zip(centre, half)), tensions, load)
    for _ in range(50):
        point = centre + half * rng.uniform(-1, 1, (2, 50))
        values, rows = arm.statics(tuple(point), tensions, load)
        for bound, value in [
            *zip(gradient, values),
            *zip([e for r in hessian for e in r], [e for r in rows for e in r]),
        ]:
            slop = 1e-9 * (1 + np.abs(value))
            assert ((bound.low <= value + slop) & (value <= bound.high + slop)).all()


def test_errors_of_areas_know_of_slivers():
    """A stable set of 0.06 x 0.02 rad in a box of 6: the areas' errors were 50 times the estimate."""
    arm = TwoX(TwoXDesign(**{**vars(MURALIDHARAN2022), "b": 0.09, "l": 0.1, "a": 3.0}))
    workspace = stable_wrench_feasible_workspace(arm)
    joint_space = stable_wrench_feasible_joint_space(arm)
    limit, lines = joint_space.upper[0], 3000
    values = (2 * np.arange(lines) + 1 - lines) / lines * limit
    area = mapped = 0.0
    for value, intervals in zip(values, joint_space.slices(0, values, 1025)):
        for interval in intervals:
            width = interval.high - interval.low
            q2 = interval.low + width * (np.arange(32) + 0.5) / 32
            area += width * 2 * limit / lines
            mapped += np.abs(arm.jacobian_determinant((np.full(32, value), q2))).mean() * width * 2 * limit / lines
    traced = joint_space.trace()
    assert abs(traced.area - area) < 2 * traced.area_error + 0.01 * area
    assert abs(sum(sheet.area for sheet in workspace.sheets) - mapped) < 2 * workspace.area_error + 0.01 * mapped
    assert workspace.area_error < 0.3 * mapped


@pytest.mark.parametrize("count", [100, pytest.param(400, marks=pytest.mark.full)])
def test_no_prism_is_stable_that_is_not_in_balance(count):
    """Down to platforms a rounding error above the base."""
    prism, rng = SpatialPrism(), np.random.default_rng(0)
    stable = 0
    for _ in range(count):
        height = 10 ** rng.uniform(-10, 0)
        position = (rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), height)
        wrench = rng.normal(size=6) * 10 ** rng.uniform(-3, 1) * (rng.random(6) < 0.7)
        found = prism.loaded_inverse_kinematics(position, wrench)
        stable += bool(found.is_stable)
        size = 10.0 + np.abs(wrench).sum()  # k d D = 10 N m
        assert not found.is_stable or found.residual <= 1e-6 * size
    assert stable > count / 4


@pytest.mark.parametrize("angle", [0.3, 1.0, 2.0, 2.9])
def test_inverse_solutions_where_circles_touch(angle):
    """B, C and F aligned: the two places of C are one, and rounding must not lose it."""
    length = float(JI2014.length)
    x, y = length + 2 * length * math.cos(angle), 2 * length * math.sin(angle)
    for scale in (1.0, 1 - 1e-16, 1 + 1e-16):
        found = FOUR_BAR.inverse_kinematics(length + scale * (x - length), scale * y)
        assert [s for s in found if s.residual < 1e-6 * length], angle


@pytest.mark.parametrize(
    ("closeness", "limit", "q"),
    [
        (1e-9, math.pi / 2, (0.015707524711997323, 0.0)),
        (1e-9, 2.6, (2.5999999, 0.001)),
        (1e-6, math.pi / 2, (-math.pi / 2, -math.pi / 2)),
        (1e-9, math.pi / 2, (-math.pi / 2, -math.pi / 2)),
    ],
)
def test_singular_poses_and_limits_of_nearly_equal_bars(closeness, limit, q):
    """Plain arms: a point of the cluster of solutions around q is found."""
    design = TwoXDesign(
        b=1 - closeness, l=1.0, a=0.0, k1=1.0, k2=1.0, min_tension=0.0, max_tension=1.0, joint_limit=limit
    )
    assert not lost(TwoX(design), [q], tolerance=1e-3)


@pytest.mark.parametrize(
    ("closeness", "limit", "q"),
    [
        (1e-6, math.pi, (math.pi - 1e-7, math.pi - 1e-7)),
        (1e-9, math.pi, (math.pi - 1e-7, math.pi - 1e-7)),
        (1e-12, math.pi, (5.67e-5 - math.pi, 5.67e-5 - math.pi)),
        (1e-9, 2.6, (2.599885923695298, 0.001425708701239534)),
        (1e-9, 1.5, (1.4999990668092769, 0.0015365955530053594)),
        (1e-12, 1.5, (1.2765652208351859, 0.18)),
    ],
)
def test_valleys_of_solutions_of_nearly_equal_bars_are_one_solution_each(closeness, limit, q):
    """Along a valley the tip moves less than rounding: one point of it is given, on target to rounding."""
    design = TwoXDesign(
        b=1 - closeness, l=1.0, a=0.0, k1=1.0, k2=1.0, min_tension=0.0, max_tension=1.0, joint_limit=limit
    )
    arm = TwoX(design)
    found = arm.inverse_kinematics(*arm.tip(q))
    assert len(found) <= 2  # a solution and, mirrored, one far from it
    assert all(solution.residual < 1e-14 for solution in found)
    # Equal bars move the tip by the sum of the angles alone.
    assert min(abs(sum(solution.configuration) - sum(q)) for solution in found) < 2e-5
