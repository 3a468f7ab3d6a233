"""Stiffness of the tip: by differences of equilibria, ranges against grids of tensions, tensions for a stiffness."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from mechanism_cases import random_two_x_design
from n_x_checks import draw, random_arm

from tensegrity_envs.mechanics import MURALIDHARAN2022, NX, NXDesign, TwoX
from tensegrity_envs.mechanics.n_x.vertices import vertices

PULL = (50.0, 50.0, 50.0, 50.0)
DIRECTIONS = (None, (1.0, 0.0), (0.3, -2.0))


def arms(count):
    """Arms of every kind with postures that feasible tensions hold in stable equilibrium."""
    found = 0
    for seed in range(1000):
        if seed % 4 == 3:
            arm, rng = (
                TwoX(replace(random_two_x_design(seed), bar_radius=0.002, payload=0.0)),
                np.random.default_rng(seed),
            )
            q, load = tuple(rng.uniform(-0.8, 0.8, 2).tolist()), tuple(rng.normal(0, 1, 2).tolist())
        else:
            arm, rng = random_arm(seed, 1 + seed % 5 if seed % 3 < 2 else 2 + seed % 2, strong=True)
            q, _, load = draw(arm, rng, 0.6)
        _, stability, wrench = arm.posture(q, load)
        if wrench > 1e-3 and stability > 1e-3:
            found += 1
            yield arm, q, load, rng
        if found == count:
            return


def test_compliance_by_differences_of_equilibria():
    for arm, q, load, _ in arms(12):
        tensions = arm.stiffest_tensions(q, load)
        compliance = np.array(arm.tip_compliance(q, tensions, load))
        step = 1e-5 * arm.reach * arm.stiffness(q, tensions, load)
        moved = []
        for sign_x, sign_y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            other = (load[0] + sign_x * step, load[1] + sign_y * step)
            found = arm.equilibrium(tensions, q, other)
            assert found.is_stable
            moved.append(np.array(arm.tip(found.configuration)))
        columns = np.stack([(moved[0] - moved[1]) / (2 * step), (moved[2] - moved[3]) / (2 * step)], axis=1)
        assert compliance == pytest.approx(columns, abs=1e-4 * np.abs(compliance).max())
        if len(q) > 1 and np.linalg.cond(compliance) < 1e8:
            assert np.array(arm.cartesian_stiffness(q, tensions, load)) @ compliance == pytest.approx(
                np.eye(2), abs=1e-6
            )
        worst = 1 / np.linalg.eigvalsh(compliance)[1]
        assert arm.stiffness(q, tensions, load) == pytest.approx(worst)
        assert arm.stiffness(q, tensions, load, (0.0, -3.0)) == pytest.approx(1 / compliance[1, 1])


def feasible_tensions(arm, q, load, rng, count):
    """Tensions that hold q: mixtures of the vertices of all of them, and the vertices."""
    if isinstance(arm, TwoX):
        arm = NX(NXDesign.from_two_x(arm.design))
    table, moments = np.array(arm.torque_matrix(q)), np.array(arm.passive_gradient(q, load))
    corners = vertices(table, moments, arm.design.min_tension, arm.design.max_tension)
    mixed = rng.dirichlet(np.full(len(corners), rng.choice([0.05, 0.3])), count) @ corners
    return np.concatenate([mixed, corners])


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_range_against_all_feasible_tensions(direction):
    above_zero = 0
    for arm, q, load, rng in arms(16):
        least, greatest = arm.stiffness_range(q, load, direction)
        every = feasible_tensions(arm, q, load, rng, 2000)
        values = arm.stiffness(q, tuple(every.T), load, direction)
        assert values.min() >= least * (1 - 1e-7)
        assert values.max() <= greatest * (1 + 1e-6)
        # ... and both ends are reached
        assert values.max() == pytest.approx(greatest, rel=1e-3 if len(every[0]) > 4 else 0.05)
        if least > 0:
            above_zero += 1
            assert values.min() == pytest.approx(least, rel=1e-6)
    assert above_zero >= 4


def tension_grid(arm, q, load, count):
    """Tensions that hold q, (k, cables): left ones on a grid of count^n, right ones by the balance of torques."""
    if isinstance(arm, TwoX):
        arm = NX(NXDesign.from_two_x(arm.design))
    table, moments = np.array(arm.torque_matrix(q)), np.array(arm.passive_gradient(q, load))
    low, high, n = arm.design.min_tension, arm.design.max_tension, len(q)
    left = np.stack(np.meshgrid(*[np.linspace(low, high, count)] * n), axis=-1).reshape(-1, n)
    right = np.linalg.solve(table[:, 1::2], moments[:, None] - table[:, ::2] @ left.T).T
    inside = ((right >= low) & (right <= high)).all(axis=1)
    return np.stack([left, right], axis=-1).reshape(-1, 2 * n)[inside]


@pytest.mark.full
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_range_against_a_dense_grid_of_tensions(direction):
    """Of up to 20,000 tensions for each posture: none beyond the range, and some next to both of its ends."""
    gaps, points = [], 0
    for arm, q, load, _ in arms(120):
        cables = 2 * len(q)
        if len(q) > 3 or getattr(arm.design, "routing", "per_joint") not in ("per_joint", "from_base"):
            continue
        every = tension_grid(arm, q, load, {1: 20_001, 2: 141, 3: 28}[len(q)])
        if len(every) < 50:
            continue
        assert every.shape[1] == cables
        least, greatest = arm.stiffness_range(q, load, direction)
        values = np.asarray(arm.stiffness(q, tuple(every.T), load, direction))
        assert values.min() >= least * (1 - 1e-9)
        assert values.max() <= greatest * (1 + 1e-9)
        points += len(every)
        gaps.append([greatest / values.max() - 1, values.min() / least - 1 if least > 0 else 0.0])
    upper, lower = np.array(gaps).T
    print(f"{len(gaps)} postures, {points} tensions; ends beyond the grid by {np.median(gaps, axis=0)} in the median")
    assert len(gaps) >= 20
    assert np.median(upper) < 0.05
    assert np.median(lower) < 0.05


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_tensions_for_a_stiffness(direction):
    for arm, q, load, rng in arms(16):
        least, greatest = arm.stiffness_range(q, load, direction)
        for share in (0.0, rng.uniform(), 1.0):
            wanted = max(least + share * (greatest - least), 1e-3 * greatest)
            tensions = arm.tensions_for(q, wanted, load, direction)
            assert arm.stiffness(q, tensions, load, direction) == pytest.approx(wanted, rel=1e-6)
            assert np.linalg.norm(arm.energy_gradient(q, tensions, load)) < 1e-7 * arm.design.max_tension * arm.reach
            assert arm.wrench_margin(q, tensions) > -1e-9
            assert arm.stability_margin(q, tensions, load) > 0
        for outside in (0.99 * least, 1.01 * greatest, -1.0, 0.0):
            with pytest.raises(ValueError, match=r"must be between .* and .* N/m"):
                arm.tensions_for(q, outside, load, direction)


def test_two_equal_joints_have_the_stiffness_of_the_two_x():
    rng = np.random.default_rng(0)
    q = tuple(rng.uniform(-1, 1, (2, 100)))
    two, arm = TwoX(MURALIDHARAN2022), NX(NXDesign.from_two_x(MURALIDHARAN2022))
    for direction in DIRECTIONS:
        expected, found = two.stiffness_range(q, direction=direction), arm.stiffness_range(q, direction=direction)
        np.testing.assert_allclose(found, expected, rtol=1e-10)
    np.testing.assert_allclose(arm.softest_tensions(q), two.softest_tensions(q), rtol=1e-12)


def test_a_batch_is_what_single_postures_give():
    arm = TwoX(MURALIDHARAN2022)
    rng = np.random.default_rng(1)
    q = tuple(rng.uniform(-0.7, 0.7, (2, 20)))
    least, greatest = arm.stiffness_range(q)
    wanted = least + 0.4 * (greatest - least)
    tensions = arm.tensions_for(q, wanted)
    for i in range(20):
        one = tuple(float(angle[i]) for angle in q)
        assert [float(f[i]) for f in tensions] == pytest.approx(arm.tensions_for(one, float(wanted[i])), rel=1e-9)


@pytest.mark.parametrize("size", [5e-324, 1e-200, 3.0, 1e200, 1.7e308])
def test_a_direction_counts_by_its_angle_alone(size):
    """Of the largest and smallest floats, too; by powers of two to the last digit."""
    arm, q = TwoX(MURALIDHARAN2022), (0.1, 0.2)
    usual, given = arm.stiffness_range(q, direction=(1.0, 1.0)), arm.stiffness_range(q, direction=(size, size))
    assert given == pytest.approx(usual, rel=1e-14)
    wanted = 0.5 * sum(usual)
    tensions = arm.tensions_for(q, wanted, direction=(size, size))
    assert arm.stiffness(q, tensions, direction=(-size, -size)) == pytest.approx(wanted, rel=1e-9)
    twice = arm.stiffness(q, tensions, direction=(0.75, -2.5)), arm.stiffness(q, tensions, direction=(6.0, -20.0))
    assert twice[0] == twice[1]


def test_postures_that_are_not_held_and_wrong_directions_are_named():
    arm = TwoX(MURALIDHARAN2022)
    assert arm.stiffness_range((2.9, 2.9)) == (0.0, 0.0)
    with pytest.raises(ValueError, match="no feasible tensions hold it in stable equilibrium"):
        arm.tensions_for((2.9, 2.9), 10.0)
    for direction in ((0.0, 0.0), (np.nan, 1.0), (np.inf, 0.0), (np.array([1.0, 0.0]), np.array([1.0, 0.0]))):
        for call in (
            arm.stiffness_range,
            partial(arm.tensions_for, stiffness=10.0),
            partial(arm.stiffness, tensions=PULL),
        ):
            with pytest.raises(ValueError, match=r"direction = .*: must be two finite numbers .* not both zero"):
                call((0.1, 0.2), direction=direction)
    with pytest.raises(ValueError, match="moves along a curve"):
        NX(NXDesign.from_two_x(MURALIDHARAN2022, 1)).cartesian_stiffness((0.1,), (10.0, 10.0))
