"""Every row of tests/data/two_x.json that concerns the mechanics; the workspace analysis has its own file."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq
from two_x_reference import assert_same_solutions, joint_by_circles

from tensegrity_envs.mechanics import FURET2018, MURALIDHARAN2022, TwoX
from tensegrity_envs.mechanics.two_x import furet_quartic

ROWS = {row["id"]: row for row in json.loads((Path(__file__).parents[1] / "data" / "two_x.json").read_text())["rows"]}
# Areas, boundaries, cusps and polynomial degrees: test_two_x_workspace_rows.py.
WORKSPACE_ROWS = {
    "F_limits_areas",
    "F_cusp_b1/2",
    "F_node_b1/2",
    "F_area4_b1/2",
    "F_discriminant",
    "M_swfj_area",
    "M_swfw_area",
    "M_swfw_on_x0",
    "M_k100_area",
    "M_degrees",
}
# prefix -> check; the longest prefix that fits is taken
CHECKS = {}
CLIP = 0.99 * math.pi


def checks(*prefixes):
    def register(function):
        CHECKS.update(dict.fromkeys(prefixes, function))
        return function

    return register


def check_of(row_id):
    prefix = max((p for p in CHECKS if row_id.startswith(p)), key=len, default=None)
    return CHECKS.get(prefix)


@pytest.mark.parametrize("row_id", [row_id for row_id in ROWS if row_id not in WORKSPACE_ROWS])
def test_row(row_id):
    check = check_of(row_id)
    assert check is not None, f"no check for {row_id}; write one, or list it as a row of the workspace analysis"
    row = ROWS[row_id]
    check(row["inputs"], row["expected"], row["tolerance"])


def test_rows_are_all_accounted_for():
    assert ROWS.keys() >= WORKSPACE_ROWS, "a row left out here no longer exists"
    assert len(ROWS) - len(WORKSPACE_ROWS) == 56
    assert {check_of(row_id) for row_id in ROWS if row_id not in WORKSPACE_ROWS} == set(CHECKS.values())


def furet(inputs):
    assert inputs["L"] == 1.0
    return TwoX(FURET2018(inputs["b"], joint_limit=2 * inputs.get("theta_max", math.pi)))


def paper(inputs, payload=None):
    changes = {
        None: {},
        "paper": {},
        "paper with mp=0.5": {"payload": 0.5},
        "paper with mp=0.2": {"payload": 0.2},
        "paper with Fmax=50": {"max_tension": 50.0},
        "paper with k1=50,k2=25,Fmax=20": {"k1": 50.0, "k2": 25.0, "max_tension": 20.0},
        "paper, all four forces equal F": {},
    }[inputs.get("design")]
    if payload is not None:
        changes = {"payload": payload}
    return TwoX(replace(MURALIDHARAN2022, **changes))


def inverse(m, inputs):
    return m.inverse_kinematics(inputs["x"], inputs["y"])


def thetas(solutions):
    return np.array([s.configuration for s in solutions]).reshape(-1, 2) / 2


# ----------------------------------------------------------------------------------------------------- Furet, Wenger


@checks("F_fk_")
def forward(inputs, expected, tolerance):
    q = (2 * inputs["theta1"], 2 * inputs["theta2"])
    assert furet(inputs).tip(q) == pytest.approx(expected["xy"], abs=tolerance)


@checks("F_detJ_")
def determinant(inputs, expected, tolerance):
    value = furet(inputs).jacobian_determinant((2 * inputs["theta1"], 2 * inputs["theta2"]))
    assert value == pytest.approx(expected["det_wrt_alpha"], abs=tolerance)
    assert 4 * value == pytest.approx(expected["det_wrt_theta"], abs=4 * tolerance)


@checks("F_crank_")
def crank(inputs, expected, tolerance):
    m = furet(inputs)
    alpha = 2 * expected["theta"]
    points = joint_by_circles(inputs["b"], 1.0, inputs["phi_AC"])
    nodes = m.nodes((alpha, 0.0))
    for name, point in points.items():
        assert nodes[f"{name}1"] == pytest.approx((point.real, point.imag), abs=10 * tolerance)
    left, right, _, _ = m.cable_lengths((alpha, 0.0))
    assert (left, right) == pytest.approx((expected["side_left_AD"], expected["side_right_BC"]), abs=tolerance)
    middle = (points["C"] + points["D"]) / 2
    assert abs(middle) == pytest.approx(expected["midlen"], abs=tolerance)
    assert (abs(alpha) < math.pi) == expected["up"]


@checks("F_ik_", "F_spurious_locus", "F_flat_solution", "F_limits_")
def inverse_without_offsets(inputs, expected, tolerance):
    solutions = inverse(furet(inputs), inputs)
    assert len(solutions) == expected["count"]
    assert_same_solutions(thetas(solutions), np.array(expected["theta"]).reshape(-1, 2), tolerance)
    if "type" in expected:
        assert [s.state for s in solutions] == expected["type"]
    coefficients = furet_quartic(inputs["x"], inputs["y"], inputs["b"])
    for root in expected.get("t_roots", []):
        scale = abs(coefficients) @ abs(root) ** np.arange(4, -1, -1)
        assert abs(np.polyval(coefficients, root)) < 1e-9 * scale
    if "a4_of_quartic" in expected:
        assert coefficients[0] == pytest.approx(expected["a4_of_quartic"], abs=1e-12)


@checks("F_origin")
def origin(inputs, expected, tolerance):
    m = furet(inputs)
    assert not furet_quartic(0.0, 0.0, inputs["b"]).any()
    theta1 = np.linspace(-3, 3, 61)
    assert np.hypot(*m.tip((2 * theta1, 2 * (math.pi - theta1)))).max() < 1e-15
    with pytest.raises(ValueError, match="base"):
        m.inverse_kinematics(0.0, 0.0)


@checks("F_class_")
def classes(inputs, expected, tolerance):
    states = [s.state for s in inverse(furet(inputs), inputs)]
    assert {state: states.count(state) for state in set(states)} == expected["counts"]


@checks("F_no_cusps")
def at_most_two_solutions(inputs, expected, tolerance):
    grid = np.linspace(-1.99, 1.99, 40)
    x, y = (v.ravel() for v in np.meshgrid(grid, grid))
    a1, _ = furet(inputs).inverse_kinematics_batch(x, y)
    assert (~np.isnan(a1)).sum(axis=1).max() == expected["max_solutions"]


@checks("F_swallowtail")
def swallowtail(inputs, expected, tolerance):
    """Four solutions meet in the upright pose at this b: the quartic has one root of multiplicity four there."""
    m = TwoX(FURET2018(expected["b"]))
    q = tuple(2 * theta for theta in expected["theta"])
    assert m.tip(q) == pytest.approx((expected["x"], expected["y"]), abs=tolerance)
    assert m.jacobian_determinant(q) == pytest.approx(0.0, abs=1e-15)
    coefficients = furet_quartic(expected["x"], expected["y"], expected["b"])
    phi = math.atan2(m.nodes(q)["C1"][1], m.nodes(q)["C1"][0] + expected["b"] / 2)
    t = math.tan(phi / 2)
    np.testing.assert_allclose(coefficients / coefficients[0], np.poly([t] * 4), rtol=0, atol=1e-10)


# ------------------------------------------------------------------------------------------------------ Muralidharan


@checks("M_masses")
def masses(inputs, expected, tolerance):
    """Masses, and the coefficients C of the paper's Eq. 7, fitted to energies of random poses."""
    m = paper(inputs)
    bars = [member for member in m.members if member.kind == "bar"]
    assert [bar.mass for bar in bars] == pytest.approx(list(expected["masses"].values()), abs=tolerance)
    d = m.design
    a1, a2 = np.random.default_rng(0).uniform(-3, 3, (2, 60))
    r1, r2 = (np.sqrt(d.l**2 - d.b**2 * np.cos(alpha / 2) ** 2) for alpha in (a1, a2))
    turns = np.stack(
        [r1 * np.cos(a1 / 2), np.cos(a1), r2 * np.cos(a1 + a2 / 2), np.cos(a1 + a2), np.cos(a2), np.ones(60)], axis=1
    )
    fit, _, rank, _ = np.linalg.lstsq(turns, m.potential_energy((a1, a2), (0.0,) * 4), rcond=None)
    assert rank == 6
    # The paper's energies carry a factor of 2, its C1x the springs of joint 1 less the weights on offset 1.
    found = {"C1x": -2 * fit[1], "C1x_prime": fit[0], "C2x": -2 * fit[4], "C3x": fit[2], "C3x_prime": 2 * fit[3]}
    for name, value in found.items():
        assert value == pytest.approx(expected[name], abs=1e-11)


@checks("M_fk_")
def forward_with_offsets(inputs, expected, tolerance):
    m, q = TwoX(), (inputs["alpha1"], inputs["alpha2"])
    nodes = m.nodes(q)
    assert m.tip(q) == pytest.approx(expected["P"], abs=tolerance)
    for name in ("P", "A2", "D2"):
        assert nodes[name] == pytest.approx(expected[name], abs=tolerance)
    assert m.jacobian_determinant(q) == pytest.approx(expected["detJ_alpha"], abs=tolerance)
    assert m.cable_lengths(q) == pytest.approx(expected["sides1"] + expected["sides2"], abs=tolerance)


@checks("M_static_")
def statics(inputs, expected, tolerance):
    m, q, tensions = TwoX(), (inputs["alpha1"], inputs["alpha2"]), tuple(inputs["F_for_hessian"])
    slack = (0.0,) * 4
    passive = np.array(m.energy_gradient(q, slack))
    assert 2 * passive == pytest.approx([expected["G1_paper"], expected["G2_paper"]], abs=tolerance)
    corners = [(low, high) for low in (5.0, 155.0) for high in (5.0, 155.0)]
    for joint in (0, 1):
        values = []
        for pair in corners:
            forces = [0.0] * 4
            forces[2 * joint : 2 * joint + 2] = pair
            values.append(-2 * (m.energy_gradient(q, tuple(forces))[joint] - passive[joint]))
        assert [min(values), max(values)] == pytest.approx(expected[f"Gamma{joint + 1}_bounds"], abs=tolerance)
    rise = m.potential_energy(q, tensions) - m.potential_energy((0.0, 0.0), tensions)
    assert rise == pytest.approx(expected["U_relative_to_upright"], abs=tolerance)
    assert m.energy_gradient(q, tensions) == pytest.approx(expected["dU"], abs=tolerance)
    (h11, h12), (_, h22) = m.stiffness_matrix(q, tensions)
    assert [h11, h12, h22] == pytest.approx(expected["hessian_U"], abs=tolerance)


@checks("M_maxstiff_")
def stiffest(inputs, expected, tolerance):
    m, q = TwoX(), (inputs["alpha1"], inputs["alpha2"])
    tensions = m.stiffest_tensions(q)
    assert tensions == pytest.approx(expected["forces_Fl1_Fr1_Fl2_Fr2"], abs=tolerance)
    (h11, h12), (_, h22) = m.stiffness_matrix(q, tensions)
    assert [h11, h12, h22] == pytest.approx(expected["hessian"], abs=tolerance)
    assert m.stability_margin(q) * m.stiffness_scale == pytest.approx(expected["mineig"], abs=tolerance)
    assert (m.wrench_margin(q) >= 0) == expected["wrench_feasible"]
    assert m.is_stable_wrench_feasible(q) == expected["in_SWFJ"]


def margin(m, q):
    _, stability, wrench = m.posture(q)
    return np.minimum(stability, wrench)


def intervals(m, line, samples=8000):
    """Where the margin is positive on the line s -> q(s), |s| <= 0.99 pi: sampled, extrema refined, ends by brentq."""
    s = np.linspace(-CLIP, CLIP, samples)
    values = margin(m, line(s))
    # A hump below zero, or a dip above, between samples of one sign: its extremum decides.
    size = abs(values)
    near = np.flatnonzero((size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:])) + 1
    fine = [s]
    for i in near:
        fine.append(np.linspace(s[i - 1], s[i + 1], 400))
    s = np.unique(np.concatenate(fine))
    inside = margin(m, line(s)) > 0
    edges = []
    for i in np.flatnonzero(inside[1:] != inside[:-1]):
        edges.append(brentq(lambda p: float(margin(m, line(p))), s[i], s[i + 1], xtol=1e-13))
    edges = ([-CLIP] if inside[0] else []) + edges + ([CLIP] if inside[-1] else [])
    return [edges[i : i + 2] for i in range(0, len(edges), 2)]


@checks("M_slice_", "M_mp05_slice_", "M_F50_slice_")
def slices(inputs, expected, tolerance):
    m = paper(inputs)
    if "alpha1" in inputs:
        found, known = intervals(m, lambda s: (inputs["alpha1"] + 0 * s, s)), expected["alpha2_intervals"]
    else:
        found, known = intervals(m, lambda s: (s, inputs["alpha2"] + 0 * s)), expected["alpha1_intervals"]
    assert len(found) == len(known)
    np.testing.assert_allclose(np.reshape(found, (-1, 2)), np.reshape(known, (-1, 2)), rtol=0, atol=tolerance)


@checks("M_half_angle")
def half_angle(inputs, expected, tolerance):
    """Stability ends the slice alpha_2 = 0; the paper prints half of the angle."""
    m = paper(inputs)
    bound = brentq(lambda angle: m.stability_margin((angle, 0.0)), 2.0, 2.8, xtol=1e-14)
    assert bound == pytest.approx(expected["alpha1_bound"], abs=tolerance)
    assert bound == pytest.approx(2.41225176202, abs=1e-11)
    assert bound / 2 == pytest.approx(expected["half_of_it"], abs=tolerance)
    assert bound / 2 == pytest.approx(expected["paper_prints"], abs=5e-6)
    assert m.stiffest_tensions((bound, 0.0)) == pytest.approx((155.0, 19.926074, 151.440301, 155.0), abs=1e-5)
    assert m.wrench_margin((bound, 0.0)) > 0
    ((left, right),) = intervals(m, lambda s: (s, 0.0 * s))
    assert (left, right) == pytest.approx((-bound, bound), abs=1e-10)
    for angle in (bound - 1e-9, -bound + 1e-9):
        assert m.is_stable_wrench_feasible((angle, 0.0))
        assert not m.is_stable_wrench_feasible((angle * (1 + 1e-8), 0.0))


@checks("M_grid50")
def fifty_lines(inputs, expected, tolerance):
    m = paper(inputs)
    grid = np.linspace(-CLIP, CLIP, 50)
    # An angle's scan runs over its 50 values; each line carries intervals of the other angle.
    scan_2 = [len(intervals(m, lambda s, fixed=fixed: (s, fixed + 0 * s), 4000)) for fixed in grid]
    scan_1 = [len(intervals(m, lambda s, fixed=fixed: (fixed + 0 * s, s), 4000)) for fixed in grid]
    assert scan_2 == expected["per_line_alpha2_scan"]
    assert scan_1 == expected["per_line_alpha1_scan"]
    assert sum(scan_2) == expected["intervals_total_alpha2_scan"]
    assert sum(scan_1) == expected["intervals_total_alpha1_scan"]


@checks("M_empty")
def empty(inputs, expected, tolerance):
    m = paper(inputs)
    grid = np.linspace(-CLIP, CLIP, 601)
    _, stability, wrench = m.posture(tuple(np.meshgrid(grid, grid)))
    feasible = wrench >= 0
    assert not (feasible & (stability > 0)).any()
    best = stability[feasible].max() * m.stiffness_scale
    assert best == pytest.approx(
        expected["max_mineig_over_wrench_feasible_set"], abs=tolerance["max_mineig_over_wrench_feasible_set"]
    )
    assert feasible.mean() == pytest.approx(expected["WFJ_fraction"], abs=tolerance["WFJ_fraction"])


@checks("M_ik_")
def inverse_with_offsets(inputs, expected, tolerance):
    m = paper(inputs)
    solutions = inverse(m, inputs)
    assert_same_solutions(2 * thetas(solutions), np.array(expected["ik_all"]), tolerance)
    assert [round(math.copysign(1, s.singularity)) for s in solutions] == expected["det_sign"]
    assert [s.is_stable_wrench_feasible for s in solutions] == expected["in_swfj"]
    assert sum(s.is_stable_wrench_feasible for s in solutions) == expected["swfw_count"]


@checks("M_eq_")
def equilibria(inputs, expected, tolerance):
    m = paper(inputs)
    found = m.equilibria(tuple(inputs["F_l1_r1_l2_r2"]))
    assert len(found) == expected["n_critical"]
    assert_same_solutions(
        np.array([e.configuration for e in found]).reshape(-1, 2),
        np.array(expected["all"]).reshape(-1, 2),
        tolerance,
    )
    stable = np.array([e.configuration for e in found if e.is_stable]).reshape(-1, 2)
    assert len(stable) == expected["n_stable"]
    assert_same_solutions(stable, np.array(expected["stable"]).reshape(-1, 2), tolerance)


@checks("M_upright_critical_payload")
def critical_payload(inputs, expected, tolerance):
    for force in (5.0, 155.0):
        payload = brentq(
            lambda mp, f=force: paper(inputs, mp).stability_margin((0.0, 0.0), (f,) * 4), 0.0, 0.6, xtol=1e-13
        )
        assert payload == pytest.approx(expected[f"mp_crit_F{force:.0f}"], abs=tolerance)


@checks("M_paper_monostable")
def monostable(inputs, expected, tolerance):
    """A sample; the row's 100,000 are numerical evidence, and so is this."""
    m = paper(inputs)
    rng = np.random.default_rng(0)
    for _ in range(60):
        stable = [e for e in m.equilibria(tuple(rng.uniform(5, 155, 4))) if e.is_stable]
        assert len(stable) <= expected["max_number_of_stable_equilibria"]
