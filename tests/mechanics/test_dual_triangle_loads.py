"""The arm under load: all equilibria by multistart, critical loads, branches, compliance, identification."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mechanism_cases import node_energy, random_dual_triangle_design
from scipy.optimize import brentq, minimize, root

from tensegrity_envs.mechanics import ZHAO2021_CAPTION, ZHAO2021_TEXT, DualTriangle, DualTriangleDesign
from tensegrity_envs.mechanics.eigenvalues import smallest_eigenvalue

symmetric = DualTriangleDesign.symmetric
UNIT = DualTriangle(symmetric(1.0, 1.0, 1.0, 1.0))  # b = k = 1
UNIT_TEXT = DualTriangle(symmetric(1.1, 1.0, 1.0, 0.7))
STRAIGHT = (0.0, 0.0, 0.0)


def hessian_of(arm, q, lengths, load):
    return np.array(arm.stiffness_matrix(q, lengths, load))


# ---------------------------------------------------------------------------------------------------- equilibria


def found_from_many_starts(arm, lengths, load, starts, rng):
    """Zeros of the gradient that a general root finder reaches from random starts, and ends of energy minimization."""
    limit = arm.design.joint_limit
    zeros = []
    for start in rng.uniform(-limit, limit, (starts, arm.segments)):
        search = root(
            lambda q: arm.energy_gradient(tuple(q), lengths, load),
            start,
            jac=lambda q: np.array(arm.stiffness_matrix(tuple(q), lengths, load)),
            tol=1e-13,
        )
        if np.abs(search.fun).max() < 1e-10 * arm.stiffness_scale and np.abs(search.x).max() < limit - 1e-6:
            zeros.append(search.x)
    minima = []
    for start in rng.uniform(-0.9 * limit, 0.9 * limit, (starts // 12, arm.segments)):
        search = minimize(
            lambda q: node_energy(arm, tuple(q), lengths, load) / arm.stiffness_scale,
            start,
            method="L-BFGS-B",
            bounds=[(-limit, limit)] * arm.segments,
            options={"ftol": 1e-15, "gtol": 1e-9},
        )
        if np.abs(search.x).max() < limit - 1e-4:
            minima.append(search.x)
    return zeros, minima


CASES = [
    (symmetric(1.0, 1.0, 1.0, 1.0), 3, 0.3),
    (symmetric(1.1, 1.0, 1.0, 0.7), 3, 0.5),
    (symmetric(0.5, 1.0, 1.0, 1.0), 3, 0.1),
    (symmetric(0.6, 1.0, 1.0, 0.9), 3, 0.0),
    (symmetric(0.5, 1.0, 1.0, 1.0), 2, 0.2),
    (symmetric(1.0, 1.0, 1.0, 1.0), 2, 1.0),
    (symmetric(1.0, 1.0, 1.0, 1.0), 4, 0.2),
    (symmetric(1.0, 1.0, 1.0, 1.0), 1, 2.0),
    (DualTriangleDesign(1.0, 1.0, 0.7, 0.9, 1.0, 1.3, 1.0, 1.0), 3, 0.3),
    (DualTriangleDesign(0.6, 1.2, 0.5, 0.8, 1.0, 1.0, 1.2, 1.2), 3, 0.1),
    (symmetric(1.1, 1.0, 1.0, 0.7, springs="cable"), 3, 0.3),
]


@pytest.mark.parametrize("number", range(len(CASES)))
def test_all_equilibria_by_multistart(number):
    design, segments, strength = CASES[number]
    arm = DualTriangle(design, segments)
    rng = np.random.default_rng(number)
    for _ in range(2):
        nominal = np.array(arm.free_lengths((0.0,) * segments))
        lengths = tuple((nominal + rng.uniform(-0.25, 0.25, 2 * segments)).tolist())
        load = tuple(rng.normal(0.0, strength, 2).tolist())
        listed = arm.equilibria(lengths, load)
        points = np.array([e.configuration for e in listed]).reshape(-1, segments)
        assert sorted(map(tuple, points)) == list(map(tuple, points))
        zeros, minima = found_from_many_starts(arm, lengths, load, 60, rng)
        for q in zeros:
            assert len(points) and np.abs(points - q).max(axis=1).min() < 1e-6, (q, points)
        stable = points[[e.is_stable for e in listed]].reshape(-1, segments)
        for q in minima:
            assert len(stable) and np.abs(stable - q).max(axis=1).min() < 1e-3, (q, points)
        for e in listed:
            assert e.residual < 1e-11
            eigenvalues = np.linalg.eigvalsh(hessian_of(arm, e.configuration, lengths, load))
            assert e.is_stable == (eigenvalues[0] > 0)


def test_without_load_the_segments_are_independent():
    arm = DualTriangle(symmetric(0.5, 1.0, 1.0, 1.0))
    delta = (0.1, 0.2, -0.4)
    lengths = arm.free_lengths(delta)
    alone = [arm.segment.equilibria(lengths[2 * i : 2 * i + 2]) for i in range(3)]
    assert [len(found) for found in alone] == [3, 3, 1]
    expected = sorted((a, b, c) for (a,), *_ in alone[0] for (b,), *_ in alone[1] for (c,), *_ in alone[2])
    found = [e.configuration for e in arm.equilibria(lengths)]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)
    assert sum(e.is_stable for e in arm.equilibria(lengths)) == 4


def test_equilibrium_is_one_of_the_equilibria_and_batches_agree():
    arm = DualTriangle(ZHAO2021_CAPTION)
    rng = np.random.default_rng(0)
    q = rng.uniform(-0.8, 0.8, (3, 25))
    load = rng.normal(0.0, 2.0, (2, 25))
    lengths = arm.free_lengths(arm.control(tuple(q)))
    batch = arm.equilibrium(lengths, tuple(q), tuple(load))
    for i in range(25):
        pick = tuple(float(v[i]) for v in lengths), tuple(q[:, i].tolist()), tuple(load[:, i].tolist())
        one = arm.equilibrium(*pick)
        assert one.is_stable == batch.is_stable[i]
        assert one.reason == batch.reason[i]
        assert one.configuration == pytest.approx(tuple(c[i] for c in batch.configuration), abs=1e-9)
        if one.is_stable and i < 6:
            listed = [e.configuration for e in arm.equilibria(pick[0], pick[2])]
            assert min(max(abs(np.subtract(p, one.configuration))) for p in listed) < 1e-8


# --------------------------------------------------------------------------------- the loaded law, and what it holds


@pytest.mark.parametrize("design", [ZHAO2021_CAPTION, ZHAO2021_TEXT])
def test_corrected_law_makes_every_loaded_target_an_equilibrium_stable_or_not(design):
    arm = DualTriangle(design)
    b, k = design.b1, design.k1
    rng = np.random.default_rng(1)
    q = tuple(rng.uniform(-1, 1, (3, 3000)))
    angle, force = rng.uniform(-math.pi, math.pi, 3000), 0.3 * k * b
    load = (force * np.cos(angle), force * np.sin(angle))
    lengths = arm.free_lengths(arm.control(q, load))
    gradient = np.array(arm.energy_gradient(q, lengths, load)) / (k * b * b)
    assert np.abs(gradient).max() < 1e-12
    stable = arm.stability_margin(q, lengths, load) > 0
    assert 0.6 < stable.mean() < 0.72  # 0.66: stability is *not* ensured
    for i in np.concatenate([np.flatnonzero(stable)[:5], np.flatnonzero(~stable)[:10]]):
        target, here = tuple(float(v[i]) for v in q), tuple(float(v[i]) for v in load)
        inputs = tuple(float(v[i]) for v in lengths)
        found = arm.equilibrium(inputs, target, here)
        assert found.is_stable == stable[i]
        assert found.configuration == pytest.approx(target, abs=1e-9)
        assert ("unstable" in found.reason) != stable[i]


def test_printed_sign_misses_by_three_b():
    load = (0.0, -0.05)
    wrong = UNIT.free_lengths(UNIT.control(STRAIGHT, (0.0, 0.05)))
    q = UNIT.equilibrium(wrong, STRAIGHT, load).configuration
    assert q == pytest.approx((-0.4486, -0.2604, -0.0850), abs=1e-4)
    assert math.dist(UNIT.tip(q), (6.0, 0.0)) == pytest.approx(3.04, abs=5e-3)


def test_six_independent_free_lengths_stiffen_the_arm():
    """Longer free lengths push: K0 and the first critical load grow linearly with them."""
    loads = [UNIT.straight_critical_loads(common)[0] for common in (0.0, 0.25, 0.5)]
    assert loads == pytest.approx([0.1339746, 1.25 * 0.1339746, 1.5 * 0.1339746], abs=1e-7)
    assert UNIT.critical_load(STRAIGHT, (-1, 0), (0.5, 0.5, 0.5)) == pytest.approx(loads[2], abs=1e-12)
    q = (0.3, -0.2, 0.5)
    lengths = UNIT.free_lengths(UNIT.control(q, (0.1, 0.05), (0.1, 0.2, -0.3)), (0.1, 0.2, -0.3))
    assert np.abs(UNIT.energy_gradient(q, lengths, (0.1, 0.05))).max() < 1e-15


# ---------------------------------------------------------------------------------------------------- critical loads


@pytest.mark.parametrize(
    ("design", "expected"),
    [(ZHAO2021_CAPTION, (0.133975, 1.0, 1.866025)), (ZHAO2021_TEXT, (0.150052, 1.12, 2.089948))],
)
def test_critical_loads_of_the_straight_arm(design, expected):
    arm = DualTriangle(design)
    kb = design.k1 * design.b1
    assert np.array(arm.straight_critical_loads()) / kb == pytest.approx(expected, abs=5e-7)
    assert arm.critical_load(STRAIGHT, (-2.0, 0.0)) / kb == pytest.approx(expected[0], abs=5e-7)
    assert arm.critical_load(STRAIGHT, (1.0, 0.0)) == math.inf
    lengths = arm.free_lengths(STRAIGHT)
    for force in arm.straight_critical_loads():
        eigenvalues = np.linalg.eigvalsh(hessian_of(arm, STRAIGHT, lengths, (-force, 0.0)))
        assert np.abs(eigenvalues).min() < 1e-12


def test_critical_loads_of_unequal_heights_and_of_many_segments():
    arm = DualTriangle(DualTriangleDesign(1.0, 0.8, 1.1, 1.3, 1.0, 1.0, 1.5, 1.5), 4)
    lengths = arm.free_lengths(arm.control((0.0,) * 4))
    loads = arm.straight_critical_loads()
    assert list(loads) == sorted(loads)
    for force in loads:
        eigenvalues = np.linalg.eigvalsh(hessian_of(arm, (0.0,) * 4, lengths, (-force, 0.0)))
        assert np.abs(eigenvalues).min() < 1e-12
    n = 7
    closed = DualTriangle(symmetric(1.0, 1.0, 1.0, 1.0), n).straight_critical_loads()
    table = np.array([[2 * (n - 1 - max(i, j)) + 1.0 for j in range(n)] for i in range(n)])
    np.testing.assert_allclose(closed, np.sort(1 / np.linalg.eigvalsh(table)), rtol=1e-12)


def test_critical_load_of_any_posture_by_bisection():
    rng = np.random.default_rng(2)
    for trial in range(60):
        arm = DualTriangle(random_dual_triangle_design(trial), 2 + trial % 3)
        q = tuple(rng.uniform(-0.6, 0.6, arm.segments).tolist())
        angle = rng.uniform(-math.pi, math.pi)
        unit = math.cos(angle), math.sin(angle)
        found = arm.critical_load(q, unit)
        scale = arm.stiffness_scale / arm.design.b1

        def margin(force, arm=arm, q=q, unit=unit):
            return arm.stability_margin(q, load=(force * unit[0], force * unit[1]))

        if margin(0.0) <= 0:
            assert found == 0.0
            continue
        forces = np.linspace(0.0, min(found, 30 * scale), 400)[1:-1]
        assert min(map(margin, forces)) > 0
        if found < 30 * scale:
            assert margin(found * (1 + 1e-7)) < 1e-9
            if arm.design.springs == "bilateral":
                assert abs(margin(found)) < 1e-12


def test_critical_loads_in_batches():
    arm = DualTriangle(ZHAO2021_TEXT)
    q = tuple(np.random.default_rng(3).uniform(-1, 1, (3, 20)))
    batch = arm.critical_load(q, (-1.0, 0.2))
    cables = DualTriangle(replace(ZHAO2021_TEXT, springs="cable"))
    for m, values in ((arm, batch), (cables, cables.critical_load(q, (-1.0, 0.2)))):
        assert values.shape == (20,)
        for i in range(20):
            assert m.critical_load(tuple(float(v[i]) for v in q), (-1.0, 0.2)) == pytest.approx(values[i], rel=1e-9)


# ------------------------------------------------------------------------------------------------------- branches


def test_post_buckling():
    first, second, _ = UNIT.straight_critical_loads()
    branch = UNIT.buckled_branch()
    assert branch.load[0] == pytest.approx(first)
    assert (np.diff(branch.load[1:]) > 0).all()  # supercritical
    assert branch.is_stable[1:].all()
    at = [np.interp(1.5 * first, branch.load, branch.configuration[:, j]) for j in range(3)]
    assert at == pytest.approx([0.96687, 0.60815, 0.19722], abs=1e-4)
    assert branch.load[-1] == pytest.approx(0.347358223246, abs=1e-10)
    assert branch.reason == "q1 reached its limit"
    mirrored = UNIT.buckled_branch(side=-1)
    np.testing.assert_allclose(mirrored.configuration[-1], -branch.configuration[-1], atol=1e-10)
    higher = UNIT.buckled_branch(2)
    assert higher.load[0] == pytest.approx(second)
    assert not higher.is_stable.any()
    lengths = UNIT.free_lengths(STRAIGHT)
    for ratio, count, stable in ((0.9, 1, 1), (1.05, 3, 2), (1.5, 3, 2), (2.7, 1, 0)):
        found = UNIT.equilibria(lengths, (-ratio * first, 0.0))
        assert (len(found), sum(e.is_stable for e in found)) == (count, stable)
    for points in (branch, higher):
        for force, q in zip(points.load, points.configuration, strict=True):
            assert np.abs(UNIT.energy_gradient(tuple(q), lengths, (-force, 0.0))).max() < 1e-10


def test_quasi_buckling_of_a_bent_start():
    q0 = (0.05, 0.05, 0.05)
    lengths = UNIT.free_lengths(UNIT.control(q0))
    branch = UNIT.load_branch(lengths, (-1.0, 0.0), q0, step=0.005)
    start = UNIT.tip(q0)
    for force, moved in ((0.10, 1.2), (0.12, 2.3)):
        q = tuple(float(np.interp(force, branch.load, branch.configuration[:, j])) for j in range(3))
        assert math.dist(UNIT.tip(q), start) == pytest.approx(moved, abs=0.06)
    near = np.abs(branch.load - 0.9 * 0.133975) < 0.02
    assert branch.stability_margin[near].min() == pytest.approx(0.28, abs=0.01)
    assert branch.is_stable.all()
    assert [len(UNIT.equilibria(lengths, (-force, 0.0))) for force in (0.16, 0.18)] == [1, 3]


def test_branch_turns_back_at_its_fold():
    """The other pair of equilibria of the bent start: one branch, which comes down in load, turns and goes up again."""
    q0 = (0.05, 0.05, 0.05)
    lengths = UNIT.free_lengths(UNIT.control(q0))
    other = [e for e in UNIT.equilibria(lengths, (-0.25, 0.0)) if e.configuration[0] < 0 and e.is_stable]
    (start,) = other
    branch = UNIT.load_branch(lengths, (1.0, 0.0), start.configuration, load=-0.25, min_load=-0.3, max_load=1.0)
    fold = int(branch.load.argmax())
    assert 0.16 < -branch.load[fold] < 0.18
    assert 0 < fold < len(branch.load) - 1
    assert branch.is_stable[: fold - 1].all()
    assert not branch.is_stable[fold + 2 :].any()
    assert branch.reason == "the smallest load was reached"


# ----------------------------------------------------------------------------------- compliance and measurements


def test_compliance_is_the_derivative_of_the_tip():
    rng = np.random.default_rng(4)
    for _ in range(10):
        q = tuple(rng.uniform(-0.8, 0.8, 3).tolist())
        load = tuple(rng.normal(0, 0.03, 2).tolist())
        lengths = UNIT.free_lengths(UNIT.control(q, load))
        columns = []
        for push in ((1e-4, 0.0), (0.0, 1e-4)):
            ends = [
                UNIT.tip(UNIT.equilibrium(lengths, q, (load[0] + s * push[0], load[1] + s * push[1])).configuration)
                for s in (1, -1)
            ]
            columns.append((np.array(ends[0]) - ends[1]) / 2e-4)
        compliance = np.array(UNIT.tip_compliance(q, lengths, load))
        np.testing.assert_allclose(compliance, np.array(columns).T, rtol=2e-4, atol=2e-3)
        stiffness = np.array(UNIT.cartesian_stiffness(q, lengths, load))
        np.testing.assert_allclose(stiffness @ compliance, np.eye(2), atol=1e-8)
    assert np.array(UNIT.tip_compliance(STRAIGHT))[1, 1] == pytest.approx(35.0)
    assert np.array(UNIT.tip_compliance(STRAIGHT, load=(-0.1, 0.0)))[1, 1] == pytest.approx(137, abs=1)
    assert np.isnan(UNIT.tip_compliance(STRAIGHT, load=(-0.2, 0.0))).all()
    assert np.isinf(UNIT.cartesian_stiffness(STRAIGHT)).all()
    batch = np.array(UNIT.tip_compliance(tuple(np.full((3, 4), 0.3)), load=(0.01, 0.02)))
    np.testing.assert_allclose(batch[..., 2], UNIT.tip_compliance((0.3, 0.3, 0.3), load=(0.01, 0.02)), rtol=1e-12)


def test_load_from_measured_angles():
    rng = np.random.default_rng(5)
    for design in (ZHAO2021_CAPTION, replace(ZHAO2021_TEXT, springs="cable")):
        arm = DualTriangle(design)
        q, load = tuple(rng.uniform(-1, 1, (3, 50))), tuple(rng.normal(0, 4, (2, 50)))
        lengths = arm.free_lengths(arm.control(q, load))
        np.testing.assert_allclose(arm.estimate_load(q, lengths), load, rtol=0, atol=1e-9)
        one = arm.estimate_load(tuple(float(v[7]) for v in q), tuple(float(v[7]) for v in lengths))
        assert one == pytest.approx((load[0][7], load[1][7]), abs=1e-9)
    # straight: the force along the links is invisible, its smallest value is given
    lengths = UNIT.free_lengths(UNIT.control(STRAIGHT, (-0.05, 0.02)))
    assert UNIT.estimate_load(STRAIGHT, lengths) == pytest.approx((0.0, 0.02), abs=1e-14)


def test_a_torque_at_the_tip_from_measured_angles():
    """Exact of three segments or more; not asked for, it is taken for a force that leaves a torque over."""
    rng = np.random.default_rng(7)
    for segments in (3, 4, 6):
        arm = DualTriangle(ZHAO2021_TEXT, segments)
        q, load = tuple(rng.uniform(-0.8, 0.8, (segments, 40))), tuple(rng.normal(0, (2, 2, 0.1), (40, 3)).T)
        lengths = arm.free_lengths(arm.control(q, load))
        np.testing.assert_allclose(arm.estimate_load(q, lengths, torque=True), load, rtol=0, atol=1e-8)
        one = arm.estimate_load(tuple(float(v[7]) for v in q), tuple(float(v[7]) for v in lengths), torque=True)
        assert one == pytest.approx([float(part[7]) for part in load], abs=1e-8)
        left = arm.energy_gradient(q, lengths, arm.estimate_load(q, lengths))
        assert np.abs(left).max(axis=0).min() > 1e-6
    straight = arm.estimate_load((0.0,) * 6, arm.free_lengths(arm.control((0.0,) * 6, (0.0, 0.5, 0.2))), torque=True)
    assert arm.load_torques((0.0,) * 6, straight) == pytest.approx(arm.load_torques((0.0,) * 6, (0.0, 0.5, 0.2)))
    with pytest.raises(ValueError, match="shows in three segments or more, not in 2"):
        DualTriangle(ZHAO2021_TEXT, 2).estimate_load((0.1, 0.2), (0.1,) * 4, torque=True)


def test_load_and_configuration_from_tip_and_inputs():
    rng = np.random.default_rng(6)
    arm = DualTriangle(ZHAO2021_CAPTION)
    states = []
    for _ in range(40):
        q = tuple(rng.uniform(-1.2, 1.2, 3).tolist())
        load = tuple(rng.normal(0, 2.0, 2).tolist())
        common = tuple(rng.uniform(-0.01, 0.01, 3).tolist())
        lengths = arm.free_lengths(arm.control(q, load, common), common)
        tip = arm.tip(q)
        found = arm.identify(*tip, lengths)
        gaps = [max(abs(np.subtract(s.configuration, q))) for s in found]
        best = found[int(np.argmin(gaps))]
        assert min(gaps) < 1e-9
        assert best.load == pytest.approx(load, abs=1e-7)
        assert best.is_stable == (arm.stability_margin(q, lengths, load) > 0)
        for s in found:  # each explains the measurement
            assert arm.tip(s.configuration) == pytest.approx(tip, abs=1e-12)
            assert s.residual < 1e-11
        # nothing is missed: a search from many starts finds no other
        for start in rng.uniform(-1.5, 1.5, (12, 3)):
            end = arm.identify_from(*tip, lengths, tuple(start.tolist()), iterations=60)
            if not math.isnan(end.configuration[0]) and arm.is_within_limits(end.configuration):
                assert min(max(abs(np.subtract(s.configuration, end.configuration))) for s in found) < 1e-6
        states.append((q, load, lengths, tip))
    near = tuple(np.array([s[0] for s in states]).T + 0.01)
    force = tuple(np.array([s[1] for s in states]).T * 0.95)
    tips, inputs = np.array([s[3] for s in states]).T, tuple(np.array([s[2] for s in states]).T)
    followed = arm.identify_from(*tips, inputs, near, force)
    np.testing.assert_allclose(np.array(followed.load).T, [s[1] for s in states], atol=1e-8)
    np.testing.assert_allclose(np.array(followed.configuration).T, [s[0] for s in states], atol=1e-9)


# ------------------------------------------------------------------------------------------- eigenvalues, bad input


@pytest.mark.parametrize("values", [(1, 1, 2), (1, 2, 2), (1, 1 + 1e-9, 2), (-1, 0, 1), (1, 1, 1), (0, 1e-9, 1), (3,)])
def test_smallest_eigenvalue(values):
    rng = np.random.default_rng(7)
    for n in (len(values), 2, 5):
        spectrum = np.resize(np.array(values, float), n)
        turn = np.linalg.qr(rng.normal(size=(500, n, n)))[0]
        matrices = (turn * spectrum[:, None].T) @ turn.swapaxes(1, 2)
        matrices = (matrices + matrices.swapaxes(1, 2)) / 2
        rows = tuple(tuple(matrices[:, i, j] for j in range(n)) for i in range(n))
        np.testing.assert_allclose(smallest_eigenvalue(rows), np.linalg.eigvalsh(matrices)[:, 0], rtol=0, atol=5e-15)
        single = smallest_eigenvalue(tuple(tuple(float(v) for v in row) for row in matrices[0]))
        assert type(single) is float
    assert smallest_eigenvalue(((0.0, 0.0, 0.0),) * 3) == 0.0


def test_margin_is_the_smallest_eigenvalue_over_kb2():
    arm = DualTriangle(ZHAO2021_TEXT)
    q, load = (0.3, -0.4, 0.8), (1.0, -2.0)
    expected = np.linalg.eigvalsh(hessian_of(arm, q, arm.free_lengths(arm.control(q, load)), load))[0]
    assert arm.stability_margin(q, load=load) == pytest.approx(expected / (500 * 0.05**2), rel=1e-12)
    assert brentq(lambda f: arm.stability_margin(STRAIGHT, load=(-f, 0.0)), 1, 10) == pytest.approx(
        0.150052 * 25, abs=1e-4
    )


@settings(max_examples=40, deadline=None)
@given(st.sampled_from([math.nan, math.inf, -math.inf]), st.sampled_from(["free_lengths", "start", "load"]))
def test_numbers_that_are_not_finite(value, where):
    arm = DualTriangle()
    arguments = {"free_lengths": [0.05] * 6, "start": [0.1] * 3, "load": [0.0] * 2}
    arguments[where][-1] = value
    with pytest.raises(ValueError, match=where):
        arm.equilibrium(**arguments)


def test_calls_that_make_no_sense():
    arm = DualTriangle()
    lengths = arm.free_lengths(STRAIGHT)
    with pytest.raises(ValueError, match="segments = 0"):
        DualTriangle(segments=0)
    with pytest.raises(TypeError, match=r"segments = 2\.5"):
        DualTriangle(segments=2.5)
    with pytest.raises(ValueError, match="must be 6"):
        arm.equilibria(lengths[:5])
    with pytest.raises(ValueError, match="direction"):
        arm.critical_load(STRAIGHT, (0.0, 0.0))
    with pytest.raises(ValueError, match="direction"):
        arm.load_branch(lengths, (0.0, 0.0), STRAIGHT)
    with pytest.raises(ValueError, match="not an equilibrium"):
        arm.load_branch(lengths, (1.0, 0.0), (0.5, 0.0, 0.0))
    with pytest.raises(ValueError, match="mode = 4"):
        arm.buckled_branch(4)
    with pytest.raises(ValueError, match="side = 0"):
        arm.buckled_branch(side=0)
    batch = DualTriangle(replace(ZHAO2021_CAPTION, k1=np.full(3, 500.0)))
    for call in (lambda: batch.equilibria(lengths), lambda: batch.identify(0.2, 0.0, lengths)):
        with pytest.raises(ValueError, match="batch"):
            call()


def test_batches_of_designs():
    rng = np.random.default_rng(8)
    factor = rng.uniform(0.8, 1.2, (4, 6))
    design = symmetric(0.05 * factor[0], 0.05 * factor[1], 500 * factor[2], 0.05 * factor[3])
    batch = DualTriangle(design)
    q, load = tuple(rng.uniform(-0.5, 0.5, (3, 6))), tuple(rng.normal(0, 1, (2, 6)))
    lengths = batch.free_lengths(batch.control(q, load))
    settled = batch.equilibrium(lengths, STRAIGHT, load)
    for i in range(6):
        one = DualTriangle(symmetric(*(float(v[i]) for v in (design.a1, design.b1, design.k1, design.free_length1))))
        qi, fi = tuple(float(v[i]) for v in q), tuple(float(v[i]) for v in load)
        for m in (one, batch.take(i)):
            assert m.tip(qi) == pytest.approx(tuple(v[i] for v in batch.tip(q)), rel=1e-12)
            assert m.critical_load(qi, (-1, 0)) == pytest.approx(batch.critical_load(q, (-1, 0))[i], rel=1e-9)
            assert m.straight_critical_loads()[0] == pytest.approx(batch.straight_critical_loads()[0][i], rel=1e-12)
            assert m.stability_margin(qi, load=fi) == pytest.approx(batch.stability_margin(q, load=load)[i], rel=1e-10)
            inputs = tuple(float(v[i]) for v in lengths)
            assert m.equilibrium(inputs, STRAIGHT, fi).configuration == pytest.approx(
                tuple(v[i] for v in settled.configuration), abs=1e-8
            )
    assert len(batch.take(np.array([1, 4])).tip(STRAIGHT)[0]) == 2
