"""Redundancy: optima against an independent search over q1, folds, limits, unreachable targets; inverse kinematics."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from tensegrity_envs.mechanics import ZHAO2021_CAPTION, DualTriangle, DualTriangleDesign

UNIT = DualTriangle(DualTriangleDesign.symmetric(1.0, 1.0, 1.0, 1.0))
OBJECTIVES = ("sum", "max", "squares")


def on_the_circle(x, y, q1, elbow):
    """The configurations with the given q1, by intersecting circles around pivot 2 and the target; NaN without."""
    px, py = 1 + 2 * np.cos(q1), 2 * np.sin(q1)
    dx, dy = x - px, y - py
    rho = np.hypot(dx, dy)
    along = (rho**2 + 4 - 1) / (2 * rho)
    height = np.sqrt(np.where(along**2 <= 4, 4 - along**2, np.nan))
    cx, cy = px + (dx * along + elbow * dy * height) / rho, py + (dy * along - elbow * dx * height) / rho
    second, third = np.arctan2(cy - py, cx - px), np.arctan2(y - cy, x - cx)
    return np.stack([q1, wrapped(second - q1), wrapped(third - second)])


def wrapped(angle):
    return (angle + math.pi) % (2 * math.pi) - math.pi


def value_of(objective, q, start, limit):
    move = q - np.asarray(start)[:, None]
    move = np.abs(wrapped(move) if math.isinf(limit) else move)
    value = {"sum": move.sum(0), "max": move.max(0), "squares": (move**2).sum(0)}[objective]
    return np.where(np.abs(q).max(axis=0) <= limit + 1e-12, value, np.inf)


def lowest(objective, x, y, start, limit):
    """Search over q1 itself, both elbows, in ever finer grids around the best points."""
    best = np.inf
    centres, half = np.array([0.0]), math.pi
    for level in range(8):
        grid = (centres[:, None] + half * np.linspace(-1, 1, 8_001 if level == 0 else 81)).ravel()
        scored = []
        for elbow in (1.0, -1.0):
            with np.errstate(invalid="ignore"):
                value = value_of(objective, on_the_circle(x, y, grid, elbow), start, limit)
            scored.append(np.where(np.isnan(value), np.inf, value))
        value = np.minimum(*scored)
        best = min(best, value.min())
        inner = np.flatnonzero((value[1:-1] <= value[:-2]) & (value[1:-1] <= value[2:]) & np.isfinite(value[1:-1])) + 1
        order = inner[np.argsort(value[inner])][:8]
        if not len(order):
            break
        centres, half = grid[order], half / (4_000 if level == 0 else 40) * 2
    return best


def targets():
    """300 targets and starts: random ones, and ones next to the borders of the regions of different curves."""
    rng = np.random.default_rng(0)
    for number in range(300):
        limit = (math.inf, math.pi / 2, 1.2771870562503)[number % 3]
        radius, angle = 5 * math.sqrt(rng.uniform()), rng.uniform(-math.pi, math.pi)
        if number % 6 == 0:  # stretched and folded: the fold of q1 lies at the ends of the curve
            radius = (1.0, 1 + 1e-6, 1 - 1e-3, 3.0, 3 + 1e-6, 3 - 1e-3, 5 - 1e-4, 5 - 1e-9, 1e-9, 4.9)[number // 6 % 10]
        if math.isfinite(limit):
            angle /= 3
        yield number, 1 + radius * math.cos(angle), radius * math.sin(angle), rng.uniform(-1, 1, 3).tolist(), limit


def test_optima_by_an_independent_search():
    reached = 0
    for number, x, y, start, limit in targets():
        for objective in OBJECTIVES:
            found = UNIT.redundancy(x, y, start, objective, limit)
            expected = lowest(objective, x, y, start, limit)
            if not found.is_reachable:
                assert math.isinf(expected), (number, x, y, limit)
                continue
            reached += 1
            assert found.objective <= expected + 1e-9, (number, objective, x, y, limit)
            # what is returned is feasible, so it is the minimum and not less
            assert UNIT.tip(found.configuration) == pytest.approx((x, y), abs=1e-12)
            assert max(map(abs, found.configuration)) <= min(limit, math.pi) + 1e-9
            q = np.array(found.configuration)[:, None]
            assert value_of(objective, q, start, limit + 1e-9)[0] == pytest.approx(found.objective, abs=1e-12)
    assert reached > 500


def test_optima_by_a_general_optimizer():
    """SLSQP with the tip as a constraint, from many starts, never finds less."""
    rng = np.random.default_rng(1)
    equal = 0
    for _ in range(5):
        x, y = rng.uniform(3.0, 5.0), rng.uniform(-2.0, 2.0)
        found = UNIT.redundancy(x, y, (-0.1, 0.1, 0.1), "squares")
        if not found.is_reachable:
            continue
        ends = []
        for start in rng.uniform(-1.5, 1.5, (6, 3)):
            search = minimize(
                lambda q: ((q - np.array([-0.1, 0.1, 0.1])) ** 2).sum(),
                start,
                method="SLSQP",
                bounds=[(-math.pi / 2, math.pi / 2)] * 3,
                constraints={"type": "eq", "fun": lambda q, x=x, y=y: np.subtract(UNIT.tip(tuple(q)), (x, y))},
                options={"ftol": 1e-14, "maxiter": 200},
            )
            if np.abs(np.subtract(UNIT.tip(tuple(search.x)), (x, y))).max() < 1e-8:
                ends.append(search.fun)
        assert min(ends) > found.objective - 1e-7
        equal += min(ends) < found.objective + 1e-6
    assert equal >= 2


def test_batch_is_what_single_calls_give():
    rng = np.random.default_rng(2)
    arm = DualTriangle(ZHAO2021_CAPTION)
    x, y = rng.uniform(0, 0.32, 600), rng.uniform(-0.25, 0.25, 600)
    start = tuple(rng.uniform(-0.5, 0.5, (3, 600)))
    for objective in OBJECTIVES:
        batch = arm.redundancy(x, y, start, objective)
        assert 0.2 < batch.is_reachable.mean() < 0.9
        for i in range(0, 600, 20):
            one = arm.redundancy(float(x[i]), float(y[i]), tuple(float(s[i]) for s in start), objective)
            assert one.is_reachable == batch.is_reachable[i]
            assert one.objective == pytest.approx(batch.objective[i], abs=1e-12)
            assert one.configuration == pytest.approx(tuple(q[i] for q in batch.configuration), abs=1e-7)
            assert one.nearest == pytest.approx((batch.nearest[0][i], batch.nearest[1][i]), abs=1e-12)


def nearest_by_sampling(x, y, limit, rng):
    """Smallest distance over the box of angles: a grid, then a bounded minimization from its best points."""
    axis = np.linspace(-limit, limit, 25)
    q = np.array(np.meshgrid(axis, axis, axis)).reshape(3, -1)
    tip = UNIT.tip(tuple(q))
    gap = np.hypot(tip[0] - x, tip[1] - y)
    best = gap.min()
    for i in np.argsort(gap)[:4]:
        search = minimize(
            lambda p: np.hypot(*np.subtract(UNIT.tip(tuple(p)), (x, y))),
            q[:, i],
            method="L-BFGS-B",
            bounds=[(-limit, limit)] * 3,
        )
        best = min(best, search.fun)
    return best


def test_unreachable_targets_and_their_nearest_points():
    rng = np.random.default_rng(3)
    for _ in range(20):
        limit = float(rng.choice([math.pi / 2, 1.2771870562503, 0.4]))
        x, y = rng.uniform(-7, 8), rng.uniform(-7, 7)
        found = UNIT.redundancy(x, y, (0, 0, 0), "squares", limit)
        expected = nearest_by_sampling(x, y, limit, rng)
        assert found.is_reachable == (expected < 1e-5)
        assert found.distance <= expected + 1e-9
        assert found.distance == pytest.approx(math.dist(found.nearest, (x, y)), abs=1e-12)
        assert UNIT.tip(found.configuration) == pytest.approx(found.nearest, abs=1e-12)
        assert max(map(abs, found.configuration)) <= limit + 1e-9
        if not found.is_reachable:  # the nearest point itself is reachable, give or take rounding
            inside = np.array(found.nearest) * (1 - 1e-9) + 1e-9 * np.array([4.0, 0.0])
            again = UNIT.redundancy(*inside, (0, 0, 0), "squares", limit)
            assert again.distance < 1e-7
    assert UNIT.redundancy(7.0, 0.0, (0, 0, 0), "sum", math.inf).nearest == pytest.approx((6.0, 0.0), abs=1e-12)
    far = UNIT.redundancy(1.0, 9.0, (0, 0, 0), "sum", math.inf)
    assert (far.is_reachable, far.distance) == (False, pytest.approx(4.0))


def test_the_argmin_of_sum_jumps_along_a_line():
    """Along x = 5.2 b: why "sum" must not be used target by target along a path."""
    y = np.arange(-2.0, 2.0, 0.02)
    for objective, jumps in (("sum", 3), ("max", 1), ("squares", 1)):
        q = np.stack(UNIT.redundancy(np.full_like(y, 5.2), y, (-0.1, 0.1, 0.1), objective, math.inf).configuration)
        moves = np.abs(np.diff(q, axis=1)).max(axis=0)
        assert (moves > 1.0).sum() == jumps


def test_inverse_kinematics_given_q1():
    rng = np.random.default_rng(4)
    for segments in (2, 3, 5):
        arm = DualTriangle(DualTriangleDesign(0.05, 0.04, 0.06, 0.05, 500.0, 500.0, 0.05, 0.05), segments)
        for _ in range(60):
            q = tuple(rng.uniform(-1.2, 1.2, segments).tolist())
            found = arm.inverse_kinematics(*arm.tip(q), *q[:-2])
            assert [s.elbow for s in found] == [1, -1]
            (same,) = [s for s in found if s.configuration == pytest.approx(q, abs=1e-9)]
            assert same.is_within_limits
            for s in found:
                assert s.residual < 1e-15
    assert [s.elbow for s in UNIT.inverse_kinematics(6.0, 0.0, 0.0)] == [0]
    assert UNIT.inverse_kinematics(5.0, 2.0, -0.8) == []


def test_moore_penrose_step():
    rng = np.random.default_rng(5)
    q = tuple(rng.uniform(-1, 1, (3, 30)))
    batch = np.array(UNIT.moore_penrose_step(q, 4.0, np.linspace(-1, 1, 30)))
    for i in range(30):
        here = tuple(float(v[i]) for v in q)
        expected = np.linalg.pinv(np.array(UNIT.jacobian(here))) @ np.subtract(
            (4.0, np.linspace(-1, 1, 30)[i]), UNIT.tip(here)
        )
        assert UNIT.moore_penrose_step(here, 4.0, float(np.linspace(-1, 1, 30)[i])) == pytest.approx(
            expected, abs=1e-11
        )
        np.testing.assert_allclose(batch[:, i], expected, atol=1e-11)
    straight = UNIT.moore_penrose_step((0.0, 0.0, 0.0), 5.5, 0.35)  # rank one: what is left of J is followed
    assert straight == pytest.approx(0.35 * np.array([5, 3, 1]) / 35, abs=1e-14)
    damped = UNIT.moore_penrose_step((0.3, 0.2, 0.1), 5.0, 1.0, damping=1.0)
    jacobian = np.array(UNIT.jacobian((0.3, 0.2, 0.1)))
    error = np.subtract((5.0, 1.0), UNIT.tip((0.3, 0.2, 0.1)))
    expected = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + np.eye(2), error)
    assert damped == pytest.approx(expected, abs=1e-13)


@settings(max_examples=40, deadline=None)
@given(st.sampled_from([math.nan, math.inf, -math.inf]), st.integers(0, 4))
def test_numbers_that_are_not_finite(value, place):
    numbers = [0.2, 0.1, 0.0, 0.0, 0.0]
    numbers[place] = value
    with pytest.raises(ValueError, match="finite"):
        DualTriangle().redundancy(numbers[0], numbers[1], numbers[2:])


@settings(max_examples=100, deadline=None)
@given(st.floats(-8, 8), st.floats(-8, 8), st.sampled_from(OBJECTIVES), st.sampled_from([0.3, math.pi / 2, math.inf]))
def test_any_target_is_answered(x, y, objective, limit):
    found = UNIT.redundancy(x, y, (0.0, 0.0, 0.0), objective, limit)
    assert UNIT.tip(found.configuration) == pytest.approx(found.nearest, abs=1e-11)
    assert found.distance >= 0
    assert found.is_reachable == (found.distance == 0)
    assert math.isfinite(found.objective)


def test_calls_that_make_no_sense():
    arm = DualTriangle()
    with pytest.raises(ValueError, match="objective = 'most'"):
        arm.redundancy(0.2, 0.0, (0, 0, 0), "most")
    with pytest.raises(ValueError, match="joint_limit"):
        arm.redundancy(0.2, 0.0, (0, 0, 0), joint_limit=-1.0)
    with pytest.raises(ValueError, match="must be 3"):
        arm.redundancy(0.2, 0.0, (0, 0))
    with pytest.raises(ValueError, match="must be 1"):
        arm.inverse_kinematics(0.2, 0.0)
    with pytest.raises(ValueError, match="one segment"):
        DualTriangle(segments=1).inverse_kinematics(0.1, 0.0)
    batch = DualTriangle(replace(ZHAO2021_CAPTION, b1=np.full(3, 0.05)))
    with pytest.raises(ValueError, match="batch"):
        batch.redundancy(0.2, 0.0, (0, 0, 0))
