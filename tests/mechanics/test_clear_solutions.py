"""Inverse solutions clear of obstacles, against Shapely on dense samples of all solutions."""

import numpy as np
import pytest
import shapely
from n_x_checks import best_by_slides
from test_clearance import by_shapely, random_polygon
from test_dual_triangle_local_optima import UNEQUAL, completed, tapered

from tensegrity_envs.geometry.clear_solutions import clear_solutions
from tensegrity_envs.geometry.clearance import Disc, Wall, bars_of
from tensegrity_envs.mechanics import (
    MURALIDHARAN2022,
    NX,
    THREE_X,
    ZHAO2021_CAPTION,
    DualTriangle,
    NXDesign,
    PlanarFourBar,
    TwoX,
)

OBJECTIVES = ("clearance", "sum", "max", "squares", "margin")
LARGER = ("clearance", "margin")


def obstacles_near(rng, reach):
    discs = [Disc(tuple(rng.uniform(-0.6, 0.9, 2) * reach), rng.uniform(0.03, 0.1) * reach) for _ in range(3)]
    return [*discs, Wall((0.0, -0.5 * reach), (0.2, 1.0))]


def gaps_by_shapely(arm, q, obstacles):
    """Clearances of configurations (n, k) from discs and walls."""
    bars = np.array([np.broadcast_arrays(*(v for end in bar for v in end)) for bar in bars_of(arm, tuple(q)).values()])
    lines = shapely.linestrings(bars.transpose(0, 2, 1).reshape(*bars.shape[::2], 2, 2))
    gaps = []
    for one in obstacles:
        if isinstance(one, Disc):
            gaps.append(shapely.distance(lines, shapely.Point(one.centre)) - one.radius)
        else:
            normal = np.array(one.normal) / np.hypot(*one.normal)
            gaps.append(((shapely.get_coordinates(lines) - one.point) @ normal).reshape(*lines.shape, 2).min(axis=-1))
    return np.min(gaps, axis=(0, 1))


def value_of(arm, objective, q, gaps, start):
    if objective == "clearance":
        return -gaps
    if objective == "margin":
        return -np.minimum(*arm.posture(tuple(q))[1:])
    move = np.abs(q - np.array(start)[:, None])
    return {"sum": move.sum(0), "max": move.max(0), "squares": (move**2).sum(0)}[objective]


@pytest.mark.parametrize(
    "arm",
    [TwoX(MURALIDHARAN2022), NX(NXDesign.from_two_x(MURALIDHARAN2022)), DualTriangle(UNEQUAL, 2)],
    ids=["two_x", "n_x", "dual_triangle"],
)
def test_of_two_joints_they_are_the_inverse_solutions_that_touch_nothing(arm):
    rng, kept, left_out = np.random.default_rng(0), 0, 0
    limit = 0.9 * min(float(arm.design.joint_limit), 2.6)
    for _ in range(30):
        x, y = arm.tip(tuple(rng.uniform(-limit, limit, 2).tolist()))
        obstacles = [Disc(tuple(rng.uniform(-0.5, 0.9, 2) * arm.reach), 0.1 * arm.reach), random_polygon(rng)]
        least = rng.choice([0.0, 0.02]) * arm.reach
        expected = []
        for one in arm.inverse_kinematics(x, y):
            bars = bars_of(arm, one.configuration).values()
            gap = min(by_shapely(obstacle, bar) for obstacle in obstacles for bar in bars)
            left_out += gap <= least
            if gap > least and getattr(one, "is_within_limits", True):
                expected.append((gap, one.configuration))
        found = clear_solutions(arm, x, y, obstacles, least=least)
        kept += len(found)
        assert [one.clearance for one in found] == sorted((one.clearance for one in found), reverse=True)
        expected.sort(reverse=True)
        np.testing.assert_allclose([one.clearance for one in found], [gap for gap, _ in expected], atol=1e-9)
        assert all(one.objective == one.clearance for one in found)
        configurations = sorted(one.configuration for one in found)  # several are as clear where the base is nearest
        np.testing.assert_allclose(configurations, sorted(q for _, q in expected), atol=1e-7)
    assert kept > 10
    assert left_out > 5


def check(arm, objective, found, q, obstacles, start, least, close):
    """What is found is clear and at the target, and no sample (n, k) is better; one comes close."""
    gaps = gaps_by_shapely(arm, q, obstacles)
    values = np.where(gaps > least, value_of(arm, objective, q, gaps, start), np.inf)
    if not found:
        assert not np.isfinite(values).any()
        return None
    sign = -1.0 if objective in LARGER else 1.0
    column = np.array(found[0].configuration)[:, None]
    gap = gaps_by_shapely(arm, column, obstacles)
    assert gap[0] > least
    assert found[0].clearance == pytest.approx(gap[0], abs=1e-9)
    assert sign * found[0].objective == pytest.approx(value_of(arm, objective, column, gap, start)[0], abs=1e-9)
    assert [sign * one.objective for one in found] == sorted(sign * one.objective for one in found)
    assert sign * found[0].objective <= values.min() + 1e-7
    return values.min() - sign * found[0].objective < close


@pytest.mark.parametrize("objective", OBJECTIVES)
@pytest.mark.parametrize("design", [ZHAO2021_CAPTION, tapered(3)], ids=["equal", "tapered"])
def test_three_segments_against_all_first_angles(design, objective):
    arm, rng, close = DualTriangle(design), np.random.default_rng(1), []
    limit = float(arm.design.joint_limit)
    for _ in range(4):
        x, y = (float(v) for v in arm.tip(tuple(rng.uniform(-0.8 * limit, 0.8 * limit, 3))))
        obstacles, start = obstacles_near(rng, float(arm.reach)), tuple(rng.uniform(-0.5, 0.5, 3).tolist())
        first = np.linspace(-limit, limit, 8001)[None]
        q = np.concatenate([completed(arm, first, x, y, elbow) for elbow in (1.0, -1.0)], axis=1)
        q = q[:, (np.abs(q) <= limit).all(axis=0)]
        least = 0.01 * float(arm.reach)
        found = clear_solutions(arm, x, y, obstacles, objective, start, least)
        close.append(check(arm, objective, found, q, obstacles, start, least, 0.05))
    assert close.count(True) >= 2
    assert False not in close


@pytest.mark.parametrize("objective", ["clearance", "squares"])
def test_three_x_joints_against_slides(objective):
    arm, rng, found = NX(THREE_X), np.random.default_rng(2), 0
    for _ in range(2):
        x, y = (float(v) for v in arm.tip(tuple(rng.uniform(-1.5, 1.5, 3))))
        obstacles, start = obstacles_near(rng, float(arm.reach)), tuple(rng.uniform(-0.5, 0.5, 3).tolist())

        def clear_value(q, obstacles=obstacles, start=start):
            gaps = gaps_by_shapely(arm, q, obstacles)
            return np.where(gaps > 0, value_of(arm, objective, q, gaps, start), np.inf)

        place = np.array([x]), np.array([y])
        slid = best_by_slides(arm, *place, np.array(start)[:, None], clear_value, rng, 60, rounds=60)[0]
        solutions = clear_solutions(arm, x, y, obstacles, objective, start)
        if not solutions:
            assert not np.isfinite(slid)
            continue
        found += 1
        best = (-1.0 if objective in LARGER else 1.0) * solutions[0].objective
        assert best <= slid + 1e-6
        assert arm.tip(solutions[0].configuration) == pytest.approx((x, y), abs=1e-9)
        assert gaps_by_shapely(arm, np.array(solutions[0].configuration)[:, None], obstacles)[0] > 0
    assert found


@pytest.mark.parametrize("objective", ["clearance", "max"])
def test_five_segments_against_random_postures(objective):
    arm, rng, close = DualTriangle(ZHAO2021_CAPTION, 5), np.random.default_rng(3), []
    limit, start = float(arm.design.joint_limit), (0.1, -0.1, 0.0, 0.2, 0.0)
    for _ in range(3):
        x, y = (float(v) for v in arm.tip(tuple(rng.uniform(-0.5, 0.5, 5))))
        obstacles = obstacles_near(rng, float(arm.reach))
        first = rng.uniform(-limit, limit, (3, 10_000))
        q = np.concatenate([completed(arm, first, x, y, elbow) for elbow in (1.0, -1.0)], axis=1)
        q = q[:, (np.abs(q) <= limit).all(axis=0)]
        found = clear_solutions(arm, x, y, obstacles, objective, start)
        close.append(check(arm, objective, found, q, obstacles, start, 0.0, 1.0))
    assert True in close
    assert False not in close


def test_an_obstacle_on_the_base_leaves_nothing_and_wrong_calls_are_explained():
    arm, disc = DualTriangle(), Disc((0.0, 0.0), 0.01)
    assert clear_solutions(arm, 0.2, 0.05, [disc]) == []
    assert clear_solutions(arm, 9.0, 0.0, [Disc((0.0, 2.0), 0.01)]) == []
    with pytest.raises(ValueError, match="one or more"):
        clear_solutions(arm, 9.0, 0.0, [])
    with pytest.raises(ValueError, match="objective = 'most'"):
        clear_solutions(arm, 0.2, 0.05, [disc], "most")
    with pytest.raises(ValueError, match="target"):
        clear_solutions(arm, np.nan, 0.05, [disc])
    with pytest.raises(ValueError, match="two joints or more"):
        clear_solutions(DualTriangle(segments=1), 0.2, 0.05, [disc])
    with pytest.raises(TypeError, match="PlanarFourBar: must be one of TwoX, NX, DualTriangle"):
        clear_solutions(PlanarFourBar(), 0.2, 0.05, [disc])
