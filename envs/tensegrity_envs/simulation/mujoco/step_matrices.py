"""The derivatives of one step of a dynamic simulation at rest, in the coordinates of the mechanism."""

from typing import NamedTuple

import mujoco
import numpy as np

from tensegrity_envs.simulation.mujoco.model import MujocoModel
from tensegrity_envs.simulation.mujoco.processes import without_log

_EPSILON = 1e-6


class StepMatrices(NamedTuple):
    """How the state (coordinates, velocities, lagging actuators) after a step depends on that before, and on commands.

    Attributes:
        free: by the state before, shape (m, m).
        driven: by the commands, shape (m, inputs).
        reached: by what actuators that follow evenly had reached before, shape (m, inputs); zero where there are none.
        follows_inputs: whether actuators follow evenly, so that they have reached their commands at the end of a step.
        drift: largest change of a coordinate in the step, zero at an equilibrium [rad].
        time: of the step [s].
    """

    free: np.ndarray
    driven: np.ndarray
    reached: np.ndarray
    follows_inputs: bool
    drift: float
    time: float


def step_matrices(model: MujocoModel, q: np.ndarray, inputs: np.ndarray, load: np.ndarray) -> StepMatrices:
    """Of a step from rest under these inputs, by MuJoCo's `mjd_transitionFD` over all its time steps.

    Args:
        model: of the mechanism.
        q: coordinates [rad], shape (n,).
        inputs: tensions [N], free or actuator lengths [m], that actuators have reached.
        load: at the tip [N].

    Raises:
        ValueError: a shape is wrong, a number is not finite, or coordinates or inputs are beyond their bounds.
    """
    linkage, steps = model.linkage, model.dynamics.frame_skip
    joints, nv, na, nu = linkage.size, int(model.model.nv), int(model.model.na), int(model.model.nu)
    data = model.put(model.state(q, None, inputs), inputs, load)
    size = 2 * nv + na
    free, driven = np.eye(size), np.zeros((size, nu))
    a, b = np.zeros((size, size)), np.zeros((size, nu))
    before = data.qpos.copy()
    for _ in range(steps):
        with without_log():
            mujoco.mjd_transitionFD(model.model, data, _EPSILON, 1, a, b, None, None)
            mujoco.mj_step(model.model, data)
        free, driven = a @ free, a @ driven + b
    after = data.qpos.copy()
    inlet = linkage.rates_by_configuration(before)
    # Of a platform the velocity is the angular one, and not the rate of the rotation vector.
    rates = np.stack([linkage.rates_of(before, e) for e in np.eye(joints)], axis=1)
    outlet = np.stack([linkage.velocity(after, e) for e in np.eye(nv)], axis=1)
    ends = linkage.rates_by_configuration(after)
    turned = np.linalg.inv(ends) if ends.shape[0] == ends.shape[1] else outlet
    lag = 0 if model.is_ramped else na
    into, out = np.zeros((size, 2 * joints + lag)), np.zeros((2 * joints + lag, size))
    into[:nv, :joints], into[nv : 2 * nv, joints : 2 * joints] = inlet, rates
    out[:joints, :nv], out[joints : 2 * joints, nv : 2 * nv] = turned, outlet
    if lag:
        into[2 * nv :, 2 * joints :] = out[2 * joints :, 2 * nv :] = np.eye(na)
    time = steps * model.dynamics.timestep
    moved = abs(linkage.configuration(after) - linkage.configuration(before)).max()
    reached = np.zeros((2 * joints + lag, nu))
    if model.is_ramped:  # their controls are speeds, (command - reached) / time
        driven = driven / time
        reached = out @ (free[:, 2 * nv :] - driven)
    return StepMatrices(out @ free @ into, out @ driven, reached, model.is_ramped, float(moved), time)
