"""Every row of tests/data/spatial_prism.json: numbers of [Jahromy] recomputed elsewhere from nodes and energy."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tensegrity_envs.mechanics import SpatialPrism, SpatialPrismDesign
from tensegrity_envs.mechanics.spatial_prism import trajectory31, trajectory32

PATH = Path(__file__).parents[1] / "data" / "spatial_prism.json"
ROWS = {row["id"]: row for row in json.loads(PATH.read_text())["rows"]}
CHECKS = {}
ROOT3 = math.sqrt(3)


def computes(*prefixes):
    """Register a function of a prism and a row's inputs; the longest prefix of a row's id decides."""

    def register(function):
        CHECKS.update(dict.fromkeys(prefixes, function))
        return function

    return register


def configuration(inputs):
    """Of a position and Euler angles psi, theta, phi (A = Rz Ry Rx)."""
    turn = Rotation.from_euler("ZYX", inputs["psi_theta_phi"])
    return (*map(float, inputs["r"]), *turn.as_rotvec().tolist())


def printed_matrix(inputs):
    return Rotation.from_euler("ZYX", inputs["psi_theta_phi"]).as_matrix()


@pytest.mark.parametrize("row", ROWS.values(), ids=ROWS.keys())
def test_row(row):
    inputs = row["inputs"]
    prism = SpatialPrism(SpatialPrismDesign(inputs["d"], inputs["D"], inputs["k"]))
    name = max((prefix for prefix in CHECKS if row["id"].startswith(prefix)), key=len)
    found = np.asarray(CHECKS[name](prism, inputs), float)
    np.testing.assert_allclose(found, row["expected"], rtol=0, atol=max(row["tolerance"], 1e-300))


@computes("sp-V")
def _(prism, inputs):
    return prism.potential_energy(configuration(inputs))


@computes("sp-len")
def _(prism, inputs):
    q = configuration(inputs)
    return [*prism.strut_lengths(q), *prism.spring_lengths(q)]


@computes("sp-mom")
def _(prism, inputs):
    return prism.moment_residual(configuration(inputs))


@computes("sp-ik")
def _(prism, inputs):
    return prism.unloaded_lengths(inputs["r"])


@computes("sp-fk")
def _(prism, inputs):
    return prism.forward_solutions(inputs["l"])


@computes("sp-fk-infeasible")
def _(prism, inputs):
    with pytest.raises(ValueError, match="fit no position"):
        prism.forward_kinematics(inputs["l"])
    return len(prism.forward_solutions(inputs["l"]))


@computes("sp-f-")
def _(prism, inputs):
    q = (*map(float, inputs["r"]), 0.0, 0.0, 0.0)
    return [*prism.actuator_forces(q), *prism.cable_tensions(q)]


@computes("sp-det")
def _(prism, inputs):
    return prism.strut_determinant(inputs["r"])


@computes("sp-hess", "sp-twist-pi")
def _(prism, inputs):
    yaw = math.pi if "yaw=pi" in inputs["quantity"] else 0.0
    return np.linalg.eigvalsh(np.array(prism.stiffness_matrix((*map(float, inputs["r"]), 0.0, 0.0, yaw)), float))


@computes("sp-c0")
def _(prism, inputs):
    return prism.least_square


@computes("sp-kappa")
def _(prism, inputs):
    return prism.rotational_stiffness


@computes("sp-off")
def _(prism, inputs):
    """A platform drawn in axes turned by another offset: A = 1 in those is a yaw of off - pi / 6 in ours."""
    return prism.moment_residual((*inputs["r"], 0.0, 0.0, inputs["off"] - math.pi / 6))


@computes("sp-twist")
def _(prism, inputs):
    """Rest, as a yaw of the axes with that offset: theirs is ours minus (off - pi / 6)."""
    rest = prism.loaded_equilibrium(prism.unloaded_lengths((0.1, 0.0, 0.5)), (0.0, 0.0, 0.0))
    assert rest.is_stable
    return rest.configuration[5] - (inputs["off"] - math.pi / 6)


@computes("sp-sim31", "sp-sim32")
def _(prism, inputs):
    trajectory = trajectory31 if "(31)" in inputs["quantity"] else trajectory32
    position = trajectory(np.asarray(inputs["t"], float))
    forces = prism.actuator_forces((*position, *np.zeros_like(position)))
    return np.stack(forces, axis=-1)


@computes("sp-compl")
def _(prism, inputs):
    return prism.tip_compliance((*map(float, inputs["r"]), 0.0, 0.0, 0.0)).ravel()


def loaded(prism, inputs):
    found = prism.loaded_equilibrium(inputs["l"], inputs["F"])
    assert found.is_stable
    return found


@computes("sp-load-r")
def _(prism, inputs):
    return loaded(prism, inputs).configuration[:3]


@computes("sp-load-w")
def _(prism, inputs):
    return loaded(prism, inputs).configuration[3:]


@computes("sp-load-f")
def _(prism, inputs):
    return loaded(prism, inputs).forces


@computes("sp-load-T")
def _(prism, inputs):
    return loaded(prism, inputs).tensions


@computes("sp-load-ik")
def _(prism, inputs):
    found = prism.loaded_inverse_kinematics(inputs["r"], inputs["F"])
    assert found.is_stable
    return [*found.lengths, *found.forces]


@computes("sp-load-1d")
def _(prism, inputs):
    lengths = prism.unloaded_lengths(inputs["r0"])
    return prism.loaded_equilibrium(lengths, inputs["F"]).configuration[5]


@computes("sp-unload-up")
def _(prism, inputs):
    lengths = prism.unloaded_lengths(inputs["r0"])
    limit = prism.unloading_limit(lengths, (0.0, 0.0, 1.0))
    assert limit.event == 1
    there = prism.loaded_equilibrium(lengths, (0.0, 0.0, limit.force * (1 - 1e-12)))
    return [limit.force, there.configuration[2], there.configuration[5]]


# ------------------------------------------------------------------------ what the paper prints, for the errata's sake


@computes("sp-p10")
def _(prism, inputs):
    """Left sides of (10)-(12) as printed, minus the springs' squared lengths."""
    (x, y, z), (d, D) = inputs["r"], (inputs["d"], inputs["D"])
    psi, theta, phi = inputs["psi_theta_phi"]
    sp, cp, st, ct, sf, cf = (f(a) for a in (psi, theta, phi) for f in (math.sin, math.cos))
    n = x * x + y * y + z * z + d * d + D * D
    first = n - x * D + d * (x - D) * (cp * st * sf - sp * ct) - ROOT3 * d * ct * cp * (x - D)
    first += y * d * (sp * st * sf + cp * cf - ROOT3 * sp * st) + z * d * (ct * sf + ROOT3 * st)
    first += ROOT3 / 2 * d * d * sp * cp * ct * cf
    second = n + d * (2 * x + D) * (sp * cf - cp * st * sf) + x * D - ROOT3 * y * d
    second += -2 * y * d * (sp * st * sf + cp * cf) - 2 * z * d * ct * sf
    third = n - x * D + d * (x - D / 2) * (cp * st * sf + ROOT3 * cp * ct) - d * sp * sf * (x - D / 2)
    third += y * d * (sp * st * sf + cp * cf + ROOT3 * sp * ct) - ROOT3 / 2 * y * D
    third += z * d / 2 * (ct * sf - ROOT3 * st) + ROOT3 / 4 * d * d * st * ct * sf
    third += -D * d / 2 * (3 * sp * ct + cp * cf + ROOT3 * sp * st * sf)
    return np.array([first, second, third]) - np.square(prism.spring_lengths(configuration(inputs)))


@computes("sp-p17")
def _(prism, inputs):
    """Left sides of (17)-(19) as printed (in (19) with the lost plus sign), minus the struts' squared lengths."""
    (x, y, z), (d, D) = inputs["r"], (inputs["d"], inputs["D"])
    psi, theta, phi = inputs["psi_theta_phi"]
    sp, cp, st, ct, sf, cf = (f(a) for a in (psi, theta, phi) for f in (math.sin, math.cos))
    n = x * x + y * y + z * z + d * d + D * D
    first = n - 2 * x * D - x * d * (sp * cf + ROOT3 * cp * ct)
    first += y * d * (sp * st * sf + cp * cf - ROOT3 * sp * ct) + z * d * (ct * sf + ROOT3 * st)
    first += D * d * (sp * cf + ROOT3 * cp * ct - cp * st * sf)
    second = n - x * D + d / 2 * st * sf * (x * cp + y * sp) + z * ROOT3 / 2 * d * st + z * d / 2 * ct * sf
    second += -ROOT3 / 2 * d * ct * (x * sp + y * cp) + d / 2 * cf * (y * cp - x * sp)
    third = n + x * d * (cp * st * sf - sp * cf + ROOT3 * cp * ct) + x * D + ROOT3 * D * y
    third += y * d * (sp * st * sf + cp * cf + ROOT3 * sp * ct) + z * d * (ct * sf - ROOT3 * st)
    third += D * d * (ROOT3 / 2 * sp * st * sf + cp * st * sf / 2 + ROOT3 / 2 * ct * cp)
    third += D * d * (ROOT3 / 2 * cp * cf + 3 / 2 * sp * ct - sp * cf / 2)
    return np.array([first, second, third]) - np.square(prism.strut_lengths(configuration(inputs)))


@computes("sp-eq26")
def _(prism, inputs):
    """Ranks of (26), its fifth row corrected to [0, -c, c], and of that with (27)."""
    c, s = math.cos(math.pi / 6), 1 + math.sin(math.pi / 6)
    d, D, k = inputs["d"], inputs["D"], inputs["k"]
    a = d * np.array([[-2 * c, 0, -c], [0, 0, -s], [2 * c, c, 0], [0, -s, 0], [0, -c, c], [0, s, s]])
    b = 2 * k * D * d * math.sin(math.pi / 3) * np.array([-1.5, -ROOT3 / 2, 1.5, -ROOT3 / 2, 0, ROOT3])
    np.testing.assert_allclose(np.linalg.lstsq(a, b)[0], prism.cable_tensions((0.1, 0.1, 0.4, 0.0, 0.0, 0.0)))
    return [np.linalg.matrix_rank(a), np.linalg.matrix_rank(np.column_stack([a, b]))]
