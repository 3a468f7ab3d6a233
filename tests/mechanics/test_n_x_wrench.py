"""Wrench feasibility and extreme tensions of every routing, against linear programmes."""

import numpy as np
import pytest
from n_x_checks import draw, is_held, largest_least_tension, random_arm
from scipy.optimize import linprog, minimize

from tensegrity_envs.mechanics.n_x.tensions import effective


@pytest.mark.parametrize("joints", range(1, 6))
def test_wrench_margin_by_linear_programme(joints):
    feasible = 0
    for seed in range(30):
        arm, rng = random_arm(seed, joints, strong=True)
        q, _, load = draw(arm, rng, min(arm.design.joint_limit, 3.0) * rng.choice([0.2, 1.0]))
        low, high = arm.design.min_tension, arm.design.max_tension
        margin, best = arm.wrench_margin(q, load=load), largest_least_tension(arm, q, load)
        if best is None:
            assert margin < -1e6
            continue
        assert margin == pytest.approx((best - low) / high, abs=1e-7 * (1 + abs(best) / high))
        if abs(margin) > 1e-6:
            assert is_held(arm, q, load, low) == (margin > 0)
        feasible += margin > 0
        # what holds q: also the tensions that are returned do, within the bounds as far as that is possible
        tensions = np.array(arm.stiffest_tensions(q, load))
        torque = np.array(arm.torque_matrix(q)) @ tensions
        assert torque == pytest.approx(arm.passive_gradient(q, load), abs=1e-6 * high)
        assert tensions.max() <= high * (1 + 1e-7)
        if arm.design.routing != "per_joint":
            assert tensions.min() >= low + min(0.0, margin) * high - 1e-6 * high
    assert feasible >= 5


@pytest.mark.parametrize("joints", (1, 2, 3, 5))
@pytest.mark.parametrize("kind", (0, 1))
def test_stiffest_and_softest_are_extreme_on_every_side_of_every_joint(joints, kind):
    """No feasible tensions pull more, or less, on any side of any joint."""
    checked = 0
    for seed in range(kind, 60, 3):
        arm, rng = random_arm(seed, joints, strong=True)
        q, _, load = draw(arm, rng, 0.6)
        if arm.wrench_margin(q, load=load) < 1e-3:
            continue
        checked += 1
        table, moments = np.array(arm.torque_matrix(q)), np.array(arm.passive_gradient(q, load))
        bounds = [(arm.design.min_tension, arm.design.max_tension)] * len(arm.input_names)
        for sign, found in ((-1, arm.stiffest_tensions(q, load)), (1, arm.softest_tensions(q, load))):
            for j, pair in enumerate(effective(arm.routing, found)):
                for side, value in zip((-1, 1), pair, strict=True):
                    cost = np.array([float(row[j] == side) for row in arm.routing])
                    best = linprog(sign * cost, A_eq=table, b_eq=moments, bounds=bounds, method="highs")
                    assert value == pytest.approx(sign * best.fun, rel=1e-6, abs=1e-6)
    assert checked >= 4


def test_stiffest_tensions_of_a_matrix_have_the_greatest_smallest_eigenvalue():
    """SLSQP over the feasible tensions finds no greater one; cutting planes prove theirs by an upper bound."""
    checked = 0
    for seed in range(2, 90, 3):
        arm, rng = random_arm(seed, 3, strong=True)
        q, _, load = draw(arm, rng, 0.5)
        if arm.wrench_margin(q, load=load) < 0.01:
            continue
        checked += 1
        table, moments = np.array(arm.torque_matrix(q)), np.array(arm.passive_gradient(q, load))
        bounds = [(arm.design.min_tension, arm.design.max_tension)] * len(arm.input_names)
        ours = arm.stability_margin(q, load=load)
        for _ in range(3):
            search = minimize(
                lambda f, arm=arm, q=q, load=load: -arm.stability_margin(q, tuple(f), load),
                rng.uniform(*bounds[0], len(bounds)),
                method="SLSQP",
                bounds=bounds,
                constraints={"type": "eq", "fun": lambda f, a=table, b=moments: a @ f - b},
            )
            if np.abs(table @ search.x - moments).max() < 1e-9:
                assert -search.fun <= ours + 1e-6 * (1 + abs(ours))
    assert checked >= 4
