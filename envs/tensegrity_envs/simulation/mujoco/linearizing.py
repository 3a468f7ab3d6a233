"""The motion of a mechanism near an equilibrium, as a linear system in its free coordinates."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import mujoco
import numpy as np

from tensegrity_envs.simulation.mujoco.linkage import Linkage
from tensegrity_envs.simulation.mujoco.model import MujocoModel

_STEP = 1e-6  # of MuJoCo's differences


class LinearMotion(NamedTuple):
    """x' = A x + B u over one step of an environment, x and u being deviations from an equilibrium.

    Attributes:
        a: shape (2 n + m, 2 n + m); of x = (configuration, its rate, what the m lagging actuators have reached).
        b: shape (2 n + m, inputs); of the commanded inputs.
    """

    a: np.ndarray
    b: np.ndarray


def linearize(model: MujocoModel, q: Any, inputs: Any, load: Sequence[float] | None = None) -> LinearMotion:
    """The linearised motion about rest in q under constant inputs, without dry friction, which has no derivative there.

    MuJoCo's finite-differenced transition matrices (mjd_transitionFD) of one time step, in all hinges, are reduced to
    the free coordinates: with S = d hinges / d q, which keeps the loops closed, and R S = 1, hinges = S q and q =
    R hinges. The step of an environment is that many time steps.

    Args:
        model: of a mechanism of hinges.
        q: configuration [rad], shape (n,).
        inputs: tensions [N] or free lengths [m] that hold it.
        load: at the tip [N].

    Raises:
        ValueError: the mechanism is no linkage of hinges.
    """
    linkage = model.linkage
    if not isinstance(linkage, Linkage):
        raise ValueError(f"linearize: {type(model.mechanism).__name__} has coordinates other than its hinges'")
    smooth = model.variant(dynamics=replace(model.dynamics, joint_friction=0.0))
    data = mujoco.MjData(smooth)
    data.qpos[:] = linkage.joint_angles(np.asarray(q, float))
    if smooth.na:
        data.act[:] = inputs
    model.command(data, np.asarray(inputs, float), load)
    nv, na, n = int(smooth.nv), int(smooth.na), linkage.size
    size = 2 * nv + na
    full, by_input = np.zeros((size, size)), np.zeros((size, int(smooth.nu)))
    mujoco.mjd_transitionFD(smooth, data, _STEP, True, full, by_input, None, None)
    spread = linkage.rates_by_configuration(data.qpos.copy())
    out, back = np.zeros((size, 2 * n + na)), np.zeros((2 * n + na, size))
    for k in range(2):
        out[k * nv : (k + 1) * nv, k * n : (k + 1) * n] = spread
        back[k * n : (k + 1) * n, k * nv : (k + 1) * nv] = linkage.reading
    out[2 * nv :, 2 * n :] = back[2 * n :, 2 * nv :] = np.eye(na)
    once, push = back @ full @ out, back @ by_input
    a, b = np.eye(2 * n + na), np.zeros_like(push)
    for _ in range(model.dynamics.frame_skip):
        a, b = once @ a, once @ b + push
    return LinearMotion(a, b)
