"""Every row of tests/data/planar_four_bar.json: numbers of [Ji2014] recomputed elsewhere from nodes and energy."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from tensegrity_envs.geometry.four_bar_workspace import _rectangle_sheets, actuator_workspace, output_workspace
from tensegrity_envs.mechanics import JI2014, PlanarFourBar

PATH = Path(__file__).parents[1] / "data" / "planar_four_bar.json"
ROWS = {row["id"]: row for row in json.loads(PATH.read_text())["rows"]}
CHECKS = {}
ARM = PlanarFourBar()
MODES = {"X": "rectangle", "paper": "paper", "flat": "flat"}


def computes(*prefixes):
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
    assert (row["inputs"]["L"], row["inputs"]["K"]) == (JI2014.length, JI2014.stiffness)
    actual = np.asarray(check_of(row_id)(row["inputs"]), float)
    assert actual.shape == np.shape(row["expected"])
    np.testing.assert_allclose(actual, row["expected"], rtol=0, atol=row["tolerance"])


def test_rows_are_all_accounted_for():
    assert len(ROWS) == 47
    assert {check_of(row_id) for row_id in ROWS} == set(CHECKS.values())


def posture(inputs):
    """Configuration and lengths from four given angles."""
    return (inputs["theta"], inputs["gamma"]), ARM.lengths_of(inputs["alpha"], inputs["beta"])


def lengths_of(inputs):
    return inputs["rho1"], inputs["rho2"]


def rest(inputs, side=1):
    """The stable unloaded state, flat or not."""
    lengths = lengths_of(inputs)
    flat = lengths[0] ** 2 + lengths[1] ** 2 > 4 * ARM.length**2
    return ARM.forward_kinematics(lengths, inputs.get("side", side), "flat" if flat else "rectangle"), lengths


def in_range(angles):
    return all(0 < angle < math.pi for angle in angles)


@computes("fb-U-")
def _(inputs):
    return ARM.potential_energy(*posture(inputs))


@computes("fb-gradU")
def _(inputs):
    return ARM.energy_gradient(*posture(inputs))


@computes("fb-hess")
def _(inputs):
    return np.ravel(ARM.stiffness_matrix(*posture(inputs)))


@computes("fb-eq6-defect")
def _(inputs):
    q, lengths = posture(inputs)
    a, b, t, g = (inputs[name] for name in ("alpha", "beta", "theta", "gamma"))
    missing = 3 * (math.sin(a) - math.sin(b)) * (math.sin(t) - math.sin(g))  # printed with 1 instead of 4
    n = ARM.nodes(q, lengths)
    springs = sum(math.dist(n[m.nodes[0]], n[m.nodes[1]]) ** 2 for m in ARM.members if m.kind == "spring")
    k = ARM.stiffness / 2
    return k * springs - (ARM.potential_energy(q, lengths) - k * ARM.length**2 * missing)


@computes("fb-count")
def _(inputs):
    found = ARM.equilibria(lengths_of(inputs))
    stable = [state for state in found if state.is_stable]
    return [
        len(found),
        len(stable),
        sum(in_range(state.configuration) for state in stable),
        sum(in_range(state.configuration) for state in found),
    ]


@computes("fb-fk-flat")
def _(inputs):
    state, lengths = rest(inputs)
    return [*state.tip, math.sqrt(ARM.flatness(lengths)[0])]


@computes("fb-fk")
def _(inputs):
    state, _ = rest(inputs)
    return [*state.tip, *state.configuration]


@computes("fb-heig")
def _(inputs):
    state, lengths = rest(inputs)
    return np.linalg.eigvalsh(np.array(ARM.stiffness_matrix(state.configuration, lengths)))


@computes("fb-Ueq")
def _(inputs):
    state, lengths = rest(inputs)
    return ARM.potential_energy(state.configuration, lengths)


@computes("fb-barrier")
def _(inputs):
    return ARM.energy_barrier(lengths_of(inputs))


@computes("fb-ik-")
def _(inputs):
    found = ARM.inverse_kinematics(inputs["x"], inputs["y"])
    return sorted(s.lengths for s in found if s.is_stable)


@computes("fb-ikn")
def _(inputs):
    found = ARM.inverse_kinematics(inputs["x"], inputs["y"])
    stable = [s for s in found if s.is_stable]
    return [len(found), len(stable), sum(s.is_within_paper_range for s in stable)]


@computes("fb-J-")
def _(inputs):
    state, lengths = rest(inputs)
    return np.ravel(ARM.jacobian(state.configuration, lengths))


@computes("fb-detJ")
def _(inputs):
    return ARM.rectangle_determinant(lengths_of(inputs), inputs["side"])


@computes("fb-phi")
def _(inputs):
    state, lengths = rest(inputs)
    return ARM.phi(state.configuration, lengths)


@computes("fb-double-sing")
def _(inputs):
    state, lengths = rest(inputs)
    return [*state.tip, ARM.rectangle_determinant(lengths, inputs["side"])]


@computes("fb-v-nodes")
def _(inputs):
    state, lengths = rest(inputs)
    nodes = ARM.nodes(state.configuration, lengths)
    return [*nodes["E"], *nodes["F"]]


@computes("fb-vi-neutral")
def _(inputs):
    lengths = lengths_of(inputs)
    q = (math.pi - 0.7, 0.7)
    return [ARM.potential_energy(q, lengths), *np.linalg.eigvalsh(np.array(ARM.stiffness_matrix(q, lengths)))]


@computes("fb-arc")
def _(inputs):
    """Where 1 - R^2 changes sign along a ray."""
    low, high = 0.1, 24.0
    direction = np.array([0.6, 0.8])
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (middle, high) if ARM.flatness(tuple(middle * direction))[1] > 0 else (low, middle)
    return low**2


@computes("fb-area-act-X")
def _(inputs):
    return actuator_workspace(ARM).trace().area


@computes("fb-area-act-paper")
def _(inputs):
    return [actuator_workspace(ARM, "paper", lobe).trace().area for lobe in (0, 1, -1)]


@computes("fb-area-out")
def _(inputs):
    return output_workspace(ARM, MODES[inputs["mode"]]).area()


@computes("fb-curve-viii-arc")
def _(inputs):
    """The largest beta at which a sheet of rectangles reaches the fold B, C, F aligned, gamma = pi - beta."""
    sheets, _ = _rectangle_sheets(ARM, False)
    low, high = 0.1, math.pi / 2
    for _ in range(100):
        beta = (low + high) / 2
        inside = any(sheet.margins(beta, math.pi - beta)[:-1].min() > 0 for sheet in sheets.values())
        low, high = (beta, high) if inside else (low, beta)
    return low


@computes("fb-xmax-ymax-ymin")
def _(inputs):
    _, low_y, high_x, high_y = output_workspace(ARM).reachable.bounds
    return [high_x, high_y, low_y]


@computes("fb-p-near-v", "fb-p-")
def _(inputs):
    state, lengths = rest(inputs)
    return ARM.thrusts(state.configuration, lengths)


@computes("fb-bars")
def _(inputs):
    state, lengths = rest(inputs)
    forces = ARM.member_forces(state.configuration, lengths)
    return [-forces[f"bar {name}"] for name in ("AD", "BC", "DE", "CF")]


@computes("fb-compl")
def _(inputs):
    state, lengths = rest(inputs)
    return ARM.tangential_compliance(state.configuration, lengths)


@computes("fb-load-n")
def _(inputs):
    found = ARM.equilibria(lengths_of(inputs), inputs["f"])
    return [len(found), sum(state.is_stable for state in found)]


@computes("fb-load-")
def _(inputs):
    lengths, load = lengths_of(inputs), inputs["f"]
    found = sorted((s for s in ARM.equilibria(lengths, load) if s.is_stable), key=lambda s: s.tip)
    state = found[0]
    values = [*state.tip, *state.configuration, *ARM.thrusts(state.configuration, lengths, load)]
    # -pi and pi are one angle
    return [-v if 2 <= i < 4 and v == pytest.approx(math.pi, abs=1e-9) else v for i, v in enumerate(values)]


@computes("fb-ikload")
def _(inputs):
    found = ARM.inverse_kinematics(inputs["x"], inputs["y"], inputs["f"])
    return sorted([*s.lengths, *s.thrusts] for s in found if s.is_stable)


@computes("fb-pcrit")
def _(inputs):
    found = ARM.critical_load(lengths_of(inputs), inputs["side"], inputs["direction"])
    return min(found, 4 * ARM.largest_force)


@computes("fb-quartic15")
def _(inputs):
    found = ARM.equilibria(lengths_of(inputs))
    return sorted(state.configuration[1] for state in found if state.type != "PAR")
