"""Every row of tests/data/dual_triangle.json: numbers of [Zhao2021] recomputed elsewhere from nodes and energy."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tensegrity_envs.mechanics import DualTriangle, DualTriangleDesign, DualTriangleSegment
from tensegrity_envs.mechanics.dual_triangle.self_motion import self_motions

PATH = Path(__file__).parents[1] / "data" / "dual_triangle.json"
ROWS = {row["id"]: row for row in json.loads(PATH.read_text())["rows"]}
OBJECTIVES = {"a": "sum", "b": "max", "c": "squares"}
CHECKS = {}


def computes(*prefixes):
    """Register a function of a row's inputs (and expected values) that returns what the row's keys should be."""

    def register(function):
        CHECKS.update(dict.fromkeys(prefixes, function))
        return function

    return register


def check_of(row_id):
    prefix = max((p for p in CHECKS if row_id.startswith(p)), key=len, default=None)
    return CHECKS.get(prefix)


@pytest.mark.parametrize("row_id", ROWS)
def test_row(row_id):
    row = ROWS[row_id]
    actual = check_of(row_id)(row["inputs"], row["expected"])
    assert actual.keys() == row["expected"].keys()
    for key, expected in row["expected"].items():
        tolerance = row["tolerance"][key] if isinstance(row["tolerance"], dict) else row["tolerance"]
        if expected is None or isinstance(expected, (bool, int)):
            assert actual[key] == expected, key
        else:
            assert np.shape(actual[key]) == np.shape(expected), key
            np.testing.assert_allclose(actual[key], expected, rtol=0, atol=tolerance, err_msg=key)


def test_rows_are_all_accounted_for():
    assert len(ROWS) == 59
    assert {check_of(row_id) for row_id in ROWS} == set(CHECKS.values())


def design_of(inputs, **given):
    values = {"a": 1.0, "b": 1.0, "k": 1.0, "L0": 1.0} | inputs | given
    if "a1" in inputs:
        k1, k2 = inputs.get("k1", 1.0), inputs.get("k2", 1.0)
        lengths = inputs.get("L10", 1.0), inputs.get("L20", 1.0)
        return DualTriangleDesign(*(inputs[name] for name in ("a1", "b1", "a2", "b2")), k1, k2, *lengths)
    return DualTriangleDesign.symmetric(
        values["a"], values["b"], values["k"], values["L0"], springs=given.get("springs", "bilateral")
    )


def segment_of(inputs, **given):
    return DualTriangleSegment(design_of(inputs, **given))


def arm_of(inputs, segments=3):
    return DualTriangle(design_of(inputs), segments)


def eigenvalues(arm, q, lengths, load):
    return np.linalg.eigvalsh(np.array(arm.stiffness_matrix(q, lengths, load)))


# ------------------------------------------------------------------------------------------------------- segment


@computes("seg-torque")
def _(inputs, expected):
    s, q, lengths = segment_of(inputs), inputs["q"], (inputs["L10"], inputs["L20"])
    (l1, l2), (m1, m2) = s.spring_lengths(q), s.spring_torques(q, lengths)
    return {
        "L1": l1,
        "L2": l2,
        "U": s.potential_energy(q, lengths),
        "M1": m1,
        "M2": m2,
        "M": s.torque(q, lengths),
        "dM": -s.stiffness(q, lengths),
    }


@computes("seg-cable")
def _(inputs, expected):
    bilateral, cable = segment_of(inputs), segment_of(inputs, springs="cable")
    lengths = bilateral.free_lengths(inputs["delta"])
    f1, f2 = bilateral.spring_forces(inputs["q"], lengths)
    return {
        "M_bilateral": bilateral.torque(inputs["q"], lengths),
        "M_cable": cable.torque(inputs["q"], lengths),
        "F1": f1,
        "F2": f2,
    }


@computes("limits-")
def _(inputs, expected):
    s = segment_of(inputs)
    values = {"q_limit": s.design.joint_limit, "beta12": s.design.beta12, "q_control_limit": s.control_limit}
    return {key: values[key] for key in expected}


@computes("cond2-")
def _(inputs, expected):
    s = segment_of(inputs)
    return {
        "threshold": s.monotone_threshold,
        "K0": s.stiffness(0.0, s.free_lengths(0.0)),
        "holds": s.is_monotone(),
    }


@computes("control-")
def _(inputs, expected):
    s, q, moment = segment_of(inputs), inputs["q"], inputs["Mext"]
    delta = s.control(q, moment)
    lengths = s.free_lengths(delta)
    stiffness = s.stiffness(q, lengths)
    values = {
        "delta": delta,
        "K_at_target": stiffness,
        "stable": stiffness > 0,
        "free_lengths_nonneg": min(lengths) >= 0,
        "ddelta_dq": s.sensitivity(q, moment),
        "delta_as_printed_eq5": s.control(q, -moment),
    }
    return {key: values[key] for key in expected}


@computes("equilibria-")
def _(inputs, expected):
    s = segment_of(inputs)
    lengths = s.free_lengths(inputs["delta"]) if "delta" in inputs else (inputs["L10"], inputs["L20"])
    found = s.equilibria(lengths, inputs["Mext"])
    values = {
        "q": [e.configuration[0] for e in found],
        "K": [s.stiffness(e.configuration[0], lengths) for e in found],
        "stable": [e.is_stable for e in found],
        "q_limit": s.design.joint_limit,
    }
    return {key: values[key] for key in expected}


@computes("bistable-fold")
def _(inputs, expected):
    s = segment_of(inputs)
    return {
        "q_fold": s.fold.angle,
        "delta_fold": s.fold.delta,
        "q_star_delta0": s.wells[1],
        "n_eq_at_0.999_delta_fold": len(s.equilibria(s.free_lengths(0.999 * s.fold.delta))),
        "n_eq_at_1.001_delta_fold": len(s.equilibria(s.free_lengths(1.001 * s.fold.delta))),
    }


@computes("bistable-range")
def _(inputs, expected):
    s = segment_of(inputs)
    for free_length, found in ((s.well_threshold - 1e-6, None), (s.well_threshold + 1e-6, tuple)):
        wells = segment_of(inputs, L0=free_length).wells
        assert wells is None if found is None else isinstance(wells, tuple)
    return {"L0_max": s.monotone_threshold, "L0_min_inside_limits": s.well_threshold}


@computes("tension-")
def _(inputs, expected):
    s, q = segment_of(inputs), inputs["q"]
    lengths = s.free_lengths(s.control(q))
    f1, f2 = s.spring_forces(q, lengths)
    return {"F1": f1, "F2": f2, "both_tensile": s.is_tensile(q, lengths)}


# ---------------------------------------------------------------------------------------------------- kinematics


@computes("fk-J")
def _(inputs, expected):
    arm = arm_of(inputs, len(inputs["q"]))
    q = tuple(map(float, inputs["q"]))
    jacobian = arm.jacobian(q)
    return {"xy": arm.tip(q), "J": jacobian, "sv": np.linalg.svd(jacobian, compute_uv=False)}


@computes("ik-")
def _(inputs, expected):
    found = arm_of(inputs).inverse_kinematics(inputs["x"], inputs["y"], inputs["q1"])
    values = {"n": len(found)}
    if found:
        values |= {"q_S3pos": found[0].configuration, "q_S3neg": found[1].configuration}
        assert [solution.elbow for solution in found] == [1, -1]
    return values


@computes("pinv-")
def _(inputs, expected):
    arm = arm_of(inputs)
    step = arm.moore_penrose_step(inputs["q0"], *inputs["xy"])
    end = arm.tip(tuple(a + b for a, b in zip(inputs["q0"], step, strict=True)))
    return {"dq": step, "fk_error_after_one_step": math.dist(end, inputs["xy"])}


def gap_to_next_minimum(arm, inputs):
    """Between the two lowest local minima without limits, from dense samples of the curve."""
    ((_, curve),) = self_motions(np.array([inputs["x"]]), np.array([inputs["y"]]), *arm._plain_links())
    loop, s, before, after = curve.grid(400_000)
    q = np.stack(curve.at(np.zeros(len(s), int), loop, s))
    move = np.abs(q - np.array(inputs["q0"])[:, None])
    move = np.minimum(move, 2 * math.pi - move)
    value = {"a": move.sum(0), "b": move.max(0), "c": (move**2).sum(0)}[inputs["objective"]]
    minima = np.sort(value[(value <= value[before]) & (value < value[after])])
    return minima[1] - minima[0]


@computes("opt-")
def _(inputs, expected):
    arm = arm_of(inputs)
    target = (inputs["x"], inputs["y"], inputs["q0"], OBJECTIVES[inputs["objective"]])
    unlimited = arm.redundancy(*target, joint_limit=math.inf)
    found = arm.redundancy(*target, joint_limit=inputs["joint_limit"]) if inputs["joint_limit"] else unlimited
    assert found.is_reachable
    values = {"f": found.objective, "q": found.configuration, "delta": arm.control(found.configuration)}
    values |= {"unlimited_f": unlimited.objective}
    if "gap_to_next_local_min" in expected:
        values["gap_to_next_local_min"] = gap_to_next_minimum(arm, inputs)
    return {key: values[key] for key in expected}


@computes("reach-")
def _(inputs, expected):
    found = arm_of(inputs).redundancy(inputs["x"], inputs["y"], (0, 0, 0), "max", inputs["joint_limit"] or math.inf)
    return {"reachable": found.is_reachable}


@computes("reach-axis")
def _(inputs, expected):
    arm, limit = arm_of(inputs), inputs["joint_limit"]
    low, high = 2.5, 6.0
    for _ in range(60):
        middle = (low + high) / 2
        reachable = arm.redundancy(middle, 0.0, (0, 0, 0), "max", limit).is_reachable
        low, high = (low, middle) if reachable else (middle, high)
    # a little inside: on the boundary rounding decides which of the two mirror images is left
    found = arm.redundancy(high + 1e-9, 0.0, (-1, 1, 1), "squares", limit)
    return {"x_min": high, "q": found.configuration}


@computes("fig6-")
def _(inputs, expected):
    arm = arm_of(inputs)
    found = arm.redundancy(inputs["x"], inputs["y"], inputs["q0"], OBJECTIVES[inputs["objective"]], math.inf)
    delta = arm.control(found.configuration)
    pairs = zip(found.configuration, delta, strict=True)
    return {"delta": delta, "K": [arm.segment.stiffness(q, arm.segment.free_lengths(d)) for q, d in pairs]}


# --------------------------------------------------------------------------------------------------------- loads


@computes("loaded-")
def _(inputs, expected):
    arm, q, load = arm_of(inputs), tuple(inputs["q_target"]), tuple(inputs["F"])
    delta = arm.control(q, load)
    lengths = arm.free_lengths(delta)
    found = arm.equilibria(lengths, load)
    found.sort(key=lambda e: arm.potential_energy(e.configuration, lengths, load))
    printed = arm.control(q, (-load[0], -load[1]))
    wrong = arm.free_lengths(printed)
    stable = [e.configuration for e in arm.equilibria(wrong, load) if e.is_stable]
    return {
        "Mext": arm.load_torques(q, load),
        "delta": delta,
        "hess": arm.stiffness_matrix(q, lengths, load),
        "eig": eigenvalues(arm, q, lengths, load),
        "target_stable": arm.stability_margin(q, load=load) > 0,
        "segment_K": [arm.segment.stiffness(qi, arm.segment.free_lengths(d)) for qi, d in zip(q, delta, strict=True)],
        "n_equilibria": len(found),
        "equilibria": [e.configuration for e in found],
        "index": [int((eigenvalues(arm, e.configuration, lengths, load) < 0).sum()) for e in found],
        "delta_printed_sign": printed,
        "lowest_stable_eq_with_printed_sign": min(stable, key=lambda p: arm.potential_energy(p, wrong, load)),
    }


@computes("passive-")
def _(inputs, expected):
    arm, load = arm_of(inputs), tuple(inputs["F"])
    lengths = arm.free_lengths(inputs["delta"])
    (found,) = arm.equilibria(lengths, load)
    q = arm.equilibrium(lengths, (0.0, 0.0, 0.0), load).configuration
    assert q == pytest.approx(found.configuration, abs=1e-9)
    return {
        "q": q,
        "xy": arm.tip(q),
        "eig": eigenvalues(arm, q, lengths, load),
        "compliance_xy": arm.tip_compliance(q, lengths, load),
        "energy": arm.potential_energy(q, lengths, load),
    }


@computes("buckling-")
def _(inputs, expected):
    arm = arm_of(inputs, inputs["n"])
    k0 = arm.segment.stiffness(0.0, arm.segment.free_lengths(0.0))
    return {"K0": round(k0, 9) if isinstance(expected["K0"], int) else k0, "P_crit": arm.straight_critical_loads()}


@computes("postbuckling-")
def _(inputs, expected):
    arm = arm_of(inputs, inputs["n"])
    assert arm.design.joint_limit == pytest.approx(inputs["joint_range"])
    lengths = arm.free_lengths((0.0,) * inputs["n"])
    found = arm.equilibria(lengths, inputs["F"])
    stable = [e.configuration for e in found if e.is_stable]
    positive = [q for q in stable if q[0] > 1e-6]
    return {
        "n_equilibria": len(found),
        "n_stable": len(stable),
        "index_sorted": sorted(int((eigenvalues(arm, e.configuration, lengths, inputs["F"]) < 0).sum()) for e in found),
        "stable_q_positive_q1": positive[0] if positive else None,
    }


@computes("postbuckling-hits-limit")
def _(inputs, expected):
    arm = arm_of(inputs, inputs["n"])
    branch = arm.buckled_branch()
    assert branch.reason == "q1 reached its limit"
    first = arm.straight_critical_loads()[0]
    return {"P": branch.load[-1], "P_over_P1": branch.load[-1] / first, "q": branch.configuration[-1]}


@computes("algo-critical")
def _(inputs, expected):
    direction = math.cos(inputs["theta"]), math.sin(inputs["theta"])
    arm, q = arm_of(inputs), tuple(map(float, inputs["q_target"]))
    found = arm.critical_load(q, direction)

    def margin(force):
        return arm.stability_margin(q, load=(force * direction[0], force * direction[1]))

    assert brentq(margin, 0.0, 2 * found, xtol=1e-14) == pytest.approx(found, abs=1e-9)
    return {"F_crit": found}


def relaxed(arm, lengths, load, start):
    """End of the gradient flow from `start`."""
    flow = solve_ivp(
        lambda t, q: -np.array(arm.energy_gradient(tuple(q), lengths, load)),
        (0.0, 2000.0),
        start,
        method="LSODA",
        rtol=1e-10,
        atol=1e-12,
    )
    return flow.y[:, -1]


@computes("relax-1")
def _(inputs, expected):
    arm, load = arm_of(inputs), inputs["F"]
    lengths = arm.free_lengths(arm.control(inputs["q_target"], load))
    q = relaxed(arm, lengths, load, inputs["q_start"])
    return {"q_final": q, "reaches_target": bool(np.abs(q - inputs["q_target"]).max() < 1e-3)}


@computes("relax-ramp")
def _(inputs, expected):
    arm, q = arm_of(inputs), tuple(map(float, inputs["q_start"]))
    for s in np.linspace(0.0, 1.0, 62)[1:].tolist():
        load = tuple(s * f for f in inputs["F"])
        target = tuple(s * angle for angle in inputs["q_target"])
        found = arm.equilibrium(arm.free_lengths(arm.control(target, load)), q, load)
        assert found.is_stable
        q = found.configuration
    return {"q_final": q, "reaches_target": bool(np.abs(np.array(q) - inputs["q_target"]).max() < 1e-3)}
