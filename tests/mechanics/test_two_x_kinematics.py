"""Kinematics of the 2-X: forward against circle geometry, inverse against a root finder that proves its counts."""

import math
from dataclasses import replace

import numpy as np
import pytest
from mechanism_cases import TWO_X_MECHANISMS, random_two_x_design
from scipy.optimize import brentq
from two_x_reference import CertifiedRoots, angle_gap, assert_same_solutions, joint_by_circles, meeting_point

from tensegrity_envs.mechanics import FURET2018, MURALIDHARAN2022, TwoX, TwoXDesign
from tensegrity_envs.mechanics.two_x import furet_quartic


def kinematic(b, a, limit, l=1.0):
    return TwoXDesign(b=b, l=l, a=a, k1=1.0, k2=1.0, min_tension=0.0, max_tension=1.0, joint_limit=limit)


def random_lengths(seed):
    rng = np.random.default_rng(1000 + seed)
    l = 10 ** rng.uniform(-1.5, 1.0)
    a = l * 10 ** rng.uniform(-7.0, 1.0)
    limit = (2.6, math.pi, 2 * math.pi)[seed % 3]
    return kinematic(l * rng.uniform(0.05, 0.97), a, limit, l)


# (design, number of targets): 500 targets altogether.
INVERSE_DESIGNS = [
    pytest.param(MURALIDHARAN2022, 80, id="published"),
    pytest.param(replace(MURALIDHARAN2022, joint_limit=2.6), 30, id="published, limits of the environments"),
    pytest.param(replace(MURALIDHARAN2022, joint_limit=2 * math.pi), 40, id="published, full torus"),
    pytest.param(FURET2018(2 / 5), 40, id="furet 2/5"),
    pytest.param(FURET2018(2 / 3), 40, id="furet 2/3"),
    pytest.param(FURET2018(2 / 3, joint_limit=2 * math.pi / 3), 20, id="furet 2/3 limited"),
    pytest.param(FURET2018(9 / 10), 40, id="furet 9/10"),
    *(pytest.param(random_lengths(seed), 20, id=f"random lengths {seed}") for seed in range(6)),
    pytest.param(kinematic(0.6, 1e-9, 2 * math.pi), 30, id="hardly any offset"),
    pytest.param(kinematic(0.98, 0.3, math.pi), 30, id="bars of nearly equal length"),
    pytest.param(kinematic(0.3, 3.0, 2 * math.pi), 30, id="long offsets, up to eight solutions"),
]


def draw_targets(mechanism, count, seed):
    """Half of them tips of random configurations, half anywhere in the square that the reach allows."""
    rng = np.random.default_rng(seed)
    limit = mechanism.design.joint_limit
    x, y = (np.array(v) for v in mechanism.tip(tuple(rng.uniform(-limit, limit, (2, count)))))
    x[::2], y[::2] = rng.uniform(-mechanism.reach, mechanism.reach, (2, len(x[::2])))
    return x, y


def certified(design):
    d = design
    return CertifiedRoots(d.b, d.l, d.a, d.joint_limit, cells=48 if d.joint_limit < 4 else 80)


def configurations(solutions):
    return np.array([s.configuration for s in solutions]).reshape(-1, 2)


@pytest.mark.parametrize(("design", "count"), INVERSE_DESIGNS)
def test_inverse_solutions_are_all_that_exist(design, count):
    """No target is left out: the reference decides every one of these (it could not only at a singularity)."""
    m, reference = TwoX(design), certified(design)
    x, y = draw_targets(m, count, seed=count)
    for i in range(count):
        expected, undecided = reference.solve(x[i], y[i])
        assert not undecided
        solutions = m.inverse_kinematics(x[i], y[i])
        found = configurations(solutions)
        assert_same_solutions(found, expected, 1e-7)
        assert list(found[:, 0]) == sorted(found[:, 0])
        for solution in solutions:
            px, py = m.tip(solution.configuration)
            assert math.hypot(px - x[i], py - y[i]) <= 1e-9 * m.reach
            assert solution.residual == pytest.approx(math.hypot(px - x[i], py - y[i]), abs=1e-15 * m.reach)
            assert solution.singularity == pytest.approx(m.jacobian_determinant(solution.configuration))
            assert solution.state == "".join("U" if abs(angle) < math.pi else "D" for angle in solution.configuration)
            assert solution.stability_margin == m.stability_margin(solution.configuration)
            assert solution.wrench_margin == m.wrench_margin(solution.configuration)


def test_there_are_500_inverse_targets():
    assert sum(parameters.values[1] for parameters in INVERSE_DESIGNS) >= 500


@pytest.mark.parametrize(
    "design",
    [MURALIDHARAN2022, FURET2018(2 / 3), replace(MURALIDHARAN2022, joint_limit=2 * math.pi), random_lengths(1)],
    ids=["published", "furet", "full torus", "random"],
)
def test_the_batch_finds_what_single_targets_find(design):
    m = TwoX(design)
    x, y = draw_targets(m, 60, seed=2)
    a1, a2 = m.inverse_kinematics_batch(x, y)
    assert a1.shape == a2.shape
    for i in range(len(x)):
        found = configurations(m.inverse_kinematics(float(x[i]), float(y[i])))
        np.testing.assert_array_equal(np.isnan(a1[i]), np.arange(a1.shape[1]) >= len(found))
        np.testing.assert_allclose(np.stack([a1[i], a2[i]], axis=1)[: len(found)], found, rtol=0, atol=1e-10)


@pytest.mark.parametrize("design", [MURALIDHARAN2022, FURET2018(0.9), random_lengths(4)], ids=["a", "b", "c"])
def test_every_configuration_is_among_the_solutions_of_its_tip(design):
    """3,000 round trips. Left out: |det J| below 1e-6 reach^2, where a configuration and its neighbour may be one."""
    m = TwoX(design)
    rng = np.random.default_rng(3)
    q = rng.uniform(-design.joint_limit, design.joint_limit, (2, 3000))
    regular = abs(m.jacobian_determinant(tuple(q))) > 1e-6 * m.reach**2
    assert regular.mean() > 0.99
    a1, a2 = m.inverse_kinematics_batch(*m.tip(tuple(q)))
    gap = np.fmax(angle_gap(a1, q[0][:, None]), angle_gap(a2, q[1][:, None]))
    assert np.nanmin(gap[regular], axis=1).max() < 1e-7
    px, py = m.tip((a1, a2))
    x, y = m.tip(tuple(q))
    assert np.nanmax(np.hypot(px - x[:, None], py - y[:, None])) <= 1e-9 * m.reach


@pytest.mark.parametrize("b", [0.1, 0.9, 0.99, 0.999])
@pytest.mark.parametrize("a", [0.0, 1e-6, 0.1])
def test_round_trips_next_to_the_poses_with_two_flat_joints(a, b):
    """The hardest corner: up to four solutions lie close together there. Left out: |det J| below 1e-8 reach^2."""
    m = TwoX(kinematic(b, a, 2 * math.pi))
    rng = np.random.default_rng(4)
    count = 1000 if b < 0.999 else 60  # nearly equal bars take long
    spread = 10 ** rng.uniform(-6, 0, (2, count))
    q = rng.choice([-math.pi, math.pi], (2, count)) + rng.normal(size=(2, count)) * spread
    q = q[:, abs(m.jacobian_determinant(tuple(q))) > 1e-8 * m.reach**2]
    assert q.shape[1] > 0.4 * count
    a1, a2 = m.inverse_kinematics_batch(*m.tip(tuple(q)))
    gap = np.fmax(angle_gap(a1, q[0][:, None]), angle_gap(a2, q[1][:, None]))
    assert np.nanmin(gap, axis=1).max() < 1e-6


@pytest.mark.parametrize("closeness", [1e-3, 1e-5, 1e-7, 1e-9, 1e-11])
@pytest.mark.parametrize("a", [0.0, 0.05, 0.2, 2.0, 20.0])
def test_two_solutions_next_to_a_fold_and_none_beyond(a, closeness):
    """Where det J = 0 two solutions meet, like square roots of the distance of the target from the fold's image."""
    m = TwoX(kinematic(0.5, a, math.pi))
    alpha1 = -0.8
    angles = np.linspace(0.0, 3.0, 300)
    signs = np.sign(m.jacobian_determinant((alpha1, angles)))
    change = np.flatnonzero(signs[1:] != signs[:-1])[-1]
    q = np.array(
        [
            alpha1,
            brentq(lambda angle: m.jacobian_determinant((alpha1, angle)), *angles[change : change + 2], xtol=1e-15),
        ]
    )
    left, _, right = np.linalg.svd(np.array(m.jacobian(tuple(q))))
    # Along the kernel the tip turns back: second derivative across the fold's image
    step = 1e-4 * right[1]
    bend = (np.array(m.tip(tuple(q + step))) + np.array(m.tip(tuple(q - step))) - 2 * np.array(m.tip(tuple(q)))) / 1e-8
    normal = left[:, 1] * np.sign(left[:, 1] @ bend)

    def nearby(target):
        found = configurations(m.inverse_kinematics(*target))
        return found[angle_gap(found, q).max(axis=1) < 0.5]

    size = closeness * m.reach
    assert len(nearby(m.tip(tuple(q)) - size * normal)) == 0
    first, second = nearby(m.tip(tuple(q)) + size * normal)
    assert m.jacobian_determinant(tuple(first)) * m.jacobian_determinant(tuple(second)) < 0
    half = np.linalg.norm(first - second) / 2
    assert half == pytest.approx(math.sqrt(2 * size / (normal @ bend)), rel=0.3 if closeness > 1e-4 else 0.02)


def test_targets_out_of_reach_have_no_solution():
    for design in (MURALIDHARAN2022, FURET2018(2 / 3)):
        m = TwoX(design)
        for target in ((1.01 * m.reach, 0.0), (0.0, -5.0), (1e300, -1e300), (0.9 * m.reach, 0.9 * m.reach)):
            assert m.inverse_kinematics(*target) == []
    table, _ = TwoX().inverse_kinematics_batch(np.array([5.0, 0.2]), np.array([5.0, 0.3]))
    assert np.isnan(table[0]).all()
    assert not np.isnan(table[1, 0])
    assert TwoX().inverse_kinematics_batch(np.zeros(0), np.zeros(0))[0].shape == (0, 1)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_targets_that_are_not_numbers(bad):
    with pytest.raises(ValueError, match="target"):
        TwoX().inverse_kinematics(bad, 0.1)
    with pytest.raises(ValueError, match="target"):
        TwoX().inverse_kinematics_batch(np.array([0.1, 0.1]), np.array([0.2, bad]))


def test_the_base_as_a_target():
    """Without offsets a whole curve of configurations reaches it; with offsets it is a target like any other."""
    m = TwoX(FURET2018(2 / 3))
    with pytest.raises(ValueError, match="base"):
        m.inverse_kinematics(0.0, 0.0)
    with pytest.raises(ValueError, match="base"):
        m.inverse_kinematics_batch(np.array([0.5, 0.0]), np.array([0.5, 0.0]))
    angles = np.linspace(0.1, 6.0, 50)
    assert np.hypot(*m.tip((angles, 2 * math.pi - angles))).max() < 1e-15
    assert len(m.inverse_kinematics(1e-6, 1e-6)) == 2
    assert TwoX(replace(MURALIDHARAN2022, joint_limit=3.14)).inverse_kinematics(0.0, 0.0) == []
    design = replace(MURALIDHARAN2022, joint_limit=2 * math.pi)
    expected, undecided = certified(design).solve(0.0, 0.0)
    assert not undecided
    assert_same_solutions(configurations(TwoX(design).inverse_kinematics(0.0, 0.0)), expected, 1e-8)


def test_inverse_kinematics_of_batches_of_designs():
    lengths = TwoX(replace(MURALIDHARAN2022, l=np.array([0.1, 0.11])))
    payloads = TwoX(replace(MURALIDHARAN2022, payload=np.array([0.0, 0.3, 0.4])))
    with pytest.raises(ValueError, match="batch"):
        lengths.inverse_kinematics_batch(np.array([0.3]), np.array([0.2]))
    with pytest.raises(ValueError, match="batch"):
        payloads.inverse_kinematics(0.3, 0.2)
    targets = np.array([0.3, 0.2]), np.array([0.2, 0.35])
    np.testing.assert_array_equal(
        payloads.inverse_kinematics_batch(*targets), TwoX().inverse_kinematics_batch(*targets)
    )


@pytest.mark.parametrize("b", [0.4, 0.5, 2 / 3, 0.9])
def test_on_the_curve_where_the_quartic_has_a_double_root_that_is_no_configuration(b):
    """The tip of joint 1 runs along it: there the quartic has a root for which joint 2 would need length 0."""
    m, reference = TwoX(FURET2018(b)), certified(FURET2018(b))
    for theta in np.linspace(-3.0, 3.0, 13):
        r = math.sqrt(1 - (b * math.cos(theta)) ** 2)
        x, y = -r * math.sin(theta), r * math.cos(theta)
        assert (x * x + y * y) ** 2 == pytest.approx(x * x + (1 - b * b) * y * y)
        phi = theta + math.atan2(r, b * math.cos(theta))
        values = np.polyder(furet_quartic(x, y, b)), furet_quartic(x, y, b)
        t = math.tan(phi / 2)
        if abs(t) < 20:
            for polynomial in values:  # a double root indeed
                assert abs(np.polyval(polynomial, t)) < 1e-9 * (1 + t**4)
        for scale in (1.0, 1 + 1e-6, 1 - 1e-9):
            expected, undecided = reference.solve(scale * x, scale * y)
            found = configurations(m.inverse_kinematics(scale * x, scale * y))
            assert not undecided
            assert_same_solutions(found, expected, 1e-7)
            assert abs(found[:, 0] - 2 * theta).min() > 1e-3


def test_where_the_tip_curve_of_joint_2_crosses_itself():
    """There (r + 2 a cos(alpha_2/2) = 0) alpha_2 and -alpha_2 put the tip at one point: two solutions, one alpha_1."""
    design = kinematic(0.5, 0.8, 2 * math.pi)
    m, reference = TwoX(design), certified(design)
    c = -math.sqrt(1 / (4 * 0.8**2 + 0.25))
    alpha2 = 2 * math.acos(c)
    for alpha1 in np.linspace(-6.0, 6.0, 25):
        for nudge in (0.0, 1e-9, 1e-5):
            x, y = m.tip((alpha1, alpha2))
            expected, undecided = reference.solve(x, y + nudge)
            found = configurations(m.inverse_kinematics(x, y + nudge))
            assert not undecided
            assert_same_solutions(found, expected, 1e-7)


@pytest.mark.parametrize("b", [0.2, 0.5, 0.9])
def test_the_quartic_has_the_inverse_solutions_as_its_roots(b):
    m = TwoX(FURET2018(b))
    rng = np.random.default_rng(5)
    for _ in range(30):
        x, y = rng.uniform(-1.5, 1.5, 2)
        coefficients = furet_quartic(x, y, b)
        for solution in m.inverse_kinematics(x, y):
            nodes = m.nodes(solution.configuration)
            (ax, ay), (cx, cy) = nodes["A1"], nodes["C1"]
            half = math.atan2(cy - ay, cx - ax) / 2
            powers = math.sin(half) ** np.arange(4, -1, -1) * math.cos(half) ** np.arange(5)
            assert abs(coefficients @ powers) < 1e-11 * abs(coefficients).max()


@pytest.mark.parametrize("case", TWO_X_MECHANISMS, ids=lambda case: case.name)
def test_joints_are_crossed_four_bars(case):
    """Nodes of joint 1 from circle intersections, its bars crossing, for long-bar directions all around."""
    m, design = case.mechanism, case.mechanism.design
    for phi in np.linspace(-3.0, 3.1, 40):
        points = joint_by_circles(design.b, design.l, phi)
        up = points["C"] - points["D"]
        middle = (points["C"] + points["D"]) / 2
        # The line of the midpoints is turned by half of alpha, which also says on which sheet of the torus it is.
        alpha = 2 * math.atan2(-middle.real, middle.imag)
        assert abs(np.exp(1j * alpha) - up / design.b) < 1e-9
        nodes = m.nodes((alpha, 0.3))
        for name, point in points.items():
            assert nodes[f"{name}1"] == pytest.approx((point.real, point.imag), abs=1e-9 * design.l)


@pytest.mark.parametrize("seed", range(6))
def test_singular_where_tip_and_instant_centres_are_in_line(seed):
    m = TwoX(random_two_x_design(seed))
    rng = np.random.default_rng(seed)
    limit = m.design.joint_limit
    for _ in range(50):
        q = rng.uniform(-limit, limit, 2)
        if min(abs(np.cos(q / 2))) < 0.05:  # the bars of a nearly flat joint are nearly parallel
            continue
        nodes = {name: complex(*position) for name, position in m.nodes(tuple(q)).items()}
        first = meeting_point(*(nodes[name] for name in ("A1", "C1", "B1", "D1")))
        second = meeting_point(*(nodes[name] for name in ("A2", "C2", "B2", "D2")))
        arms = nodes["P"] - first, nodes["P"] - second
        cross = (arms[0].conjugate() * arms[1]).imag
        assert m.jacobian_determinant(tuple(q)) == pytest.approx(cross, abs=1e-10 * m.reach**2)


def test_cable_lengths_are_the_sides_of_the_nodes():
    for case in TWO_X_MECHANISMS:
        q, _, _ = case.draw(9, 200)
        m = case.mechanism
        nodes = m.nodes(q)
        cables = [member for member in m.members if member.kind == "cable"]
        assert [cable.name for cable in cables] == [f"cable {name}" for name in m.input_names]
        for cable, length in zip(cables, m.cable_lengths(q), strict=True):
            (x1, y1), (x2, y2) = (nodes[name] for name in cable.nodes)
            np.testing.assert_allclose(length, np.hypot(x2 - x1, y2 - y1), rtol=0, atol=1e-13 * m.design.l)
        l1, r1, l2, r2 = m.cable_lengths(q)
        np.testing.assert_allclose(np.array([l1 * r1, l2 * r2]), m.design.l**2 - m.design.b**2, rtol=1e-12)
