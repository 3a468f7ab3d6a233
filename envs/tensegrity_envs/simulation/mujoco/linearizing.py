"""The motion of a mechanism near an equilibrium, as a linear system in its own coordinates.

Importing this module does not need MuJoCo: tables of controllers do, where it may not be installed.
"""

from dataclasses import replace
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from tensegrity_envs.simulation.mujoco.model import MujocoModel

_STEP = 1e-6  # of MuJoCo's differences


class LinearMotion(NamedTuple):
    """x' = A x + B u over one step of an environment, x and u being deviations from an equilibrium.

    Attributes:
        a: shape (2 n + m, 2 n + m); of x = (configuration, its velocity, what the m actuators with a state of their
            own, which lag or are ramped, have reached).
        b: shape (2 n + m, inputs); of MuJoCo's controls: the commanded inputs, of ramped actuators their speeds [m/s].
    """

    a: np.ndarray
    b: np.ndarray


def linearize(
    model: "MujocoModel",
    q: ArrayLike,
    inputs: ArrayLike,
    load: ArrayLike | None = None,
    loops: Literal["closed", "soft"] = "closed",
) -> LinearMotion:
    """The linearised motion about rest in q under constant inputs, without dry friction, which has no derivative there.

    MuJoCo's finite-differenced transition matrices (mjd_transitionFD) of one time step, in all its degrees of freedom,
    are reduced to the mechanism's: with S = d hinges / d q, which keeps the loops closed, and R S = 1, hinges = S q and
    q = R hinges (of a platform, S and R are those of positions and of velocities, see `Platform`). The step of an
    environment is that many time steps.

    Args:
        model: of the mechanism.
        q: configuration [rad], shape (n,).
        inputs: tensions [N], free or actuator lengths [m] that hold it, shape (inputs,).
        load: at the tip [N], shape (2,), in space (3,).
        loops: "soft" reduces the whole step: what differences of simulated steps show, and what a mechanism with rigid
            loops does, to 0.3%. "closed" reduces every time step, and so forgets by how much it opened the loops of a
            linkage, which the next one would mend: MuJoCo damps every hinge for itself, implicitly, when the forces
            that close the loops are known. Its error goes with time step times damping; it is up to 7% in the 2-X
            with its usual damping, 2% in the lightly damped one. The same without loops.

    Raises:
        ValueError: configuration, inputs or load have another size, or are not finite.
    """
    import mujoco

    from tensegrity_envs.simulation.mujoco.processes import without_log

    linkage = model.linkage
    q, inputs = model._check("configuration", q, linkage.size), model._check("inputs", inputs, model.input_size)
    smooth = model.variant(dynamics=replace(model.dynamics, joint_friction=0.0))
    data = mujoco.MjData(smooth)
    data.qpos[:] = linkage.joint_angles(q)
    if smooth.na:
        data.act[:] = inputs
    model.command(data, inputs, load)
    nv, na, n = int(smooth.nv), int(smooth.na), linkage.size
    size = 2 * nv + na
    full, by_input = np.zeros((size, size)), np.zeros((size, int(smooth.nu)))
    angles = data.qpos.copy()
    with without_log():
        mujoco.mjd_transitionFD(smooth, data, _STEP, True, full, by_input, None, None)
    out, back = np.zeros((size, 2 * n + na)), np.zeros((2 * n + na, size))
    out[:nv, :n] = linkage.rates_by_configuration(angles)
    out[nv : 2 * nv, n : 2 * n] = np.stack([linkage.rates_of(angles, e) for e in np.eye(n)], axis=1)
    back[:n, :nv] = linkage.configuration_by_rates(angles)
    back[n : 2 * n, nv : 2 * nv] = np.stack([linkage.velocity(angles, e) for e in np.eye(nv)], axis=1)
    out[2 * nv :, 2 * n :] = back[2 * n :, 2 * nv :] = np.eye(na)
    if loops == "closed":
        once, push = back @ full @ out, back @ by_input
        return LinearMotion(*_chained(once, push, model.dynamics.frame_skip))
    a, b = _chained(full, by_input, model.dynamics.frame_skip)
    return LinearMotion(back @ a @ out, back @ b)


def _chained(once: np.ndarray, push: np.ndarray, times: int) -> tuple[np.ndarray, np.ndarray]:
    """The same motion that many times over, under inputs that stay."""
    a, b = np.eye(len(once)), np.zeros_like(push)
    for _ in range(times):
        a, b = once @ a, once @ b + push
    return a, b
