"""Routings whose cables do not act on all joints independently: joints that no cable spans, cables that are too few."""

import numpy as np
import pytest
from scipy.optimize import linprog

from tensegrity_envs.mechanics import MURALIDHARAN2022, NX, NXDesign

PAIR = ((1, 0, 0), (-1, 0, 0))
TWO_PAIRS = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))
OPPOSED = ((1, -1, 0), (-1, 1, 0), (0, 0, 1), (0, 0, -1))
UPRIGHT, BENT = (0.0, 0.0, 0.0), (0.3, -0.2, 0.4)


def arm_of(routing, weightless=False):
    given = {"k_left": 0.0, "bar_density": 0.0} if weightless else {"k_left": (600.0, 300.0, 300.0)}
    return NX(NXDesign(3, 0.05, 0.10, 0.20, min_tension=5.0, max_tension=155.0, routing=routing, **given))


def largest_smallest_tension(arm, q):
    """By a linear programme in the torques of the nodes' energy; None where no tensions hold q."""
    table, moments = np.array(arm.torque_matrix(q)), np.array(arm.passive_gradient(q))
    scale = np.maximum(np.abs(table).sum(axis=1) * 155.0, np.abs(moments))
    scale[scale == 0] = 1.0
    m = table.shape[1]
    answer = linprog(
        np.append(np.zeros(m), -1.0),
        A_ub=np.hstack([-np.eye(m), np.ones((m, 1))]),
        b_ub=np.zeros(m),
        A_eq=np.hstack([table / scale[:, None], np.zeros((len(table), 1))]),
        b_eq=moments / scale,
        bounds=[(None, 155.0)] * m + [(-1e4, 155.0)],
    )
    return None if answer.x is None else answer.x[-1]


@pytest.mark.parametrize("routing", [PAIR, TWO_PAIRS, OPPOSED])
@pytest.mark.parametrize("q", [UPRIGHT, BENT])
@pytest.mark.parametrize("weightless", [False, True])
def test_wrench_margin_against_a_linear_programme(routing, q, weightless):
    arm = arm_of(routing, weightless)
    wanted, margin = largest_smallest_tension(arm, q), arm.wrench_margin(q)
    if wanted is None:
        assert margin < -100 and not arm.is_stable_wrench_feasible(q)
        assert arm.stiffness_range(q) == (0.0, 0.0)
    else:
        assert margin == pytest.approx((wanted - 5) / 155, abs=1e-6)
        for tensions in (arm.stiffest_tensions(q), arm.softest_tensions(q)):
            off = np.array(arm.torque_matrix(q)) @ tensions - np.array(arm.passive_gradient(q))
            assert np.abs(off).max() < 1e-6
    inside = arm.torque_zonotope(q).margin(np.array(arm.passive_gradient(q)))
    assert (inside > -1e-9) == (wanted is not None and wanted >= 5)


def test_a_batch_is_its_postures():
    arm = arm_of(TWO_PAIRS)
    q = tuple(np.array([first, second]) for first, second in zip(UPRIGHT, BENT, strict=True))
    expected = [arm.wrench_margin(UPRIGHT), arm.wrench_margin(BENT)]
    np.testing.assert_allclose(arm.wrench_margin(q), expected, rtol=1e-12)


def test_a_flat_set_of_torques_has_no_polygon_of_tip_forces():
    with pytest.raises(ValueError, match=r"2 cables act on 1 of 3 joints independently.*must span every joint"):
        arm_of(PAIR).tip_forces(BENT)


def test_as_many_cables_as_joints_have_one_stiffness():
    arm = arm_of(((-1, 0, 0), (0, 1, 0), (0, 0, -1)), weightless=True)
    assert arm.stiffness_range(BENT) == (0.0, 0.0)  # they pull one way only


def test_arguments_that_are_refused_by_name():
    arm = NX(NXDesign(1, 0.05, 0.10, 0.20, 300.0, min_tension=5.0, max_tension=155.0))
    for largest in (-1.0, 0.0, float("nan")):
        with pytest.raises(ValueError, match=r"largest = .*: must be"):
            arm.buckling_load((100.0, 100.0), (0.0, -1.0), largest=largest)
    with pytest.raises(ValueError, match=r"tensions = .*must be single numbers, not arrays"):
        arm.equilibria((np.array([50.0, 60.0]), 50.0))
    for joints in (2.5, "3", True):
        with pytest.raises(TypeError, match=r"joints = .*must be an integer"):
            NXDesign.from_two_x(MURALIDHARAN2022, joints)


def test_stiffness_range_of_what_is_not_known_is_not_known():
    arm = NX(NXDesign(2, 0.05, 0.10, 0.20, 600.0, min_tension=5.0, max_tension=155.0))
    assert np.isnan(arm.stiffness_range((0.1, 0.1), load=(float("nan"), 0.0))).all()
    q = (np.array([0.1, np.nan]), np.array([0.1, 0.1]))
    least, greatest = arm.stiffness_range(q)
    assert np.isnan([least[1], greatest[1]]).all()
    assert (least[0], greatest[0]) == pytest.approx(arm.stiffness_range((0.1, 0.1)))
