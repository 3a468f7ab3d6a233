"""A linear-quadratic regulator of joint torques, for arms whose actuators lag and are limited in range and rate.

The inputs u act on the joints by the torques t = -E(q) u, E being the derivative of the energy gradient in the inputs,
which is linear in them. So the regulator works with torques, and `allocated` finds the inputs, nearest to those of a
plan, that make them within bounds and rates: where one cable is at its bound its antagonist takes over. About an
equilibrium, a step of the environment is

    z' = A z + B d,    z = (dq, d dq/dt, dr, dc),

dq the joint angles, dr the torques of what the actuators have reached (r' = l r + (1 - l) c, l = exp(-step / lag); only
where they lag), dc the commanded torques, c' = c + d. The regulator d = -G z minimizes the sum of

    dq . K dq + dv . M dv + price d . (E E^T)^-1 d,

K being the stiffness matrix, M the mass matrix: the energy that is to be taken out, and the squares of the inputs'
increments. The price is `softness` times what the stiffness costs in a turn of 0.02 rad of every joint, for increments
as large as the rate: what is costly is to change the inputs, for it is their rate that is limited.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import LinAlgError, solve_discrete_are

from tensegrity_envs.simulation.mujoco.linearizing import LinearMotion

_TURN = 0.02  # [rad]
_LEAST = 0.1  # of the largest stiffness: what a direction counts at least, which may be unstable on the way
_SPREADS = 4  # passes of an allocation: each leaves out the inputs that have come to a bound
_RIGID = 1e-6  # share by which torques that no free input can make are given up


class TorqueMotion(NamedTuple):
    """z' = A z + B d of the module."""

    a: np.ndarray
    b: np.ndarray


def torque_motion(motion: LinearMotion, into: np.ndarray, follows: float) -> TorqueMotion:
    """The motion in torques, from that in what actuators do.

    Args:
        motion: about an equilibrium.
        into: actuation that makes torques, shape (actuators, joints).
        follows: share of the way to a command that an actuator goes in a step, 1 - l.
    """
    joints = into.shape[1]
    free, push = 2 * joints, motion.b[: 2 * joints] @ into
    one, none = np.eye(joints), np.zeros((joints, free))
    if len(motion.a) == free:
        return TorqueMotion(np.block([[motion.a, push], [none, one]]), np.concatenate([push, one]))
    reached = motion.a[:free, free:] @ into
    a = np.block(
        [
            [motion.a[:free, :free], reached, push],
            [none, (1 - follows) * one, follows * one],
            [none, 0 * one, one],
        ]
    )
    return TorqueMotion(a, np.concatenate([push, follows * one, one]))


def gain_of(
    motion: TorqueMotion, stiffness: np.ndarray, mass: np.ndarray, effect: np.ndarray, rate: float, softness: float
) -> np.ndarray:
    """G of the module, shape (joints, size of z); zero where there is none.

    Args:
        motion: about an equilibrium.
        stiffness: K, shape (joints, joints).
        mass: M, likewise.
        effect: E, shape (joints, inputs).
        rate: largest increment of an input in a step.
        softness: see the module.
    """
    joints, size = len(mass), len(motion.a)
    values, vectors = np.linalg.eigh((stiffness + stiffness.T) / 2)
    stiffness = vectors @ np.diag(np.maximum(values, _LEAST * np.abs(values).max())) @ vectors.T
    cost = np.zeros((size, size))
    cost[:joints, :joints], cost[joints : 2 * joints, joints : 2 * joints] = stiffness, mass
    cost += 1e-9 * np.trace(cost) * np.eye(size)
    price = softness * np.trace(stiffness) * _TURN**2 / rate**2 * np.linalg.pinv(effect @ effect.T)
    a, b = motion
    try:
        ahead = solve_discrete_are(a, b, cost, price)
    except (LinAlgError, ValueError):
        return np.zeros((joints, size))
    return np.asarray(np.linalg.solve(price + b.T @ ahead @ b, b.T @ ahead @ a))


def effect_of(
    simulation: Any, arm: Any, q: np.ndarray, inputs: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """The energy gradient without inputs (n, joints) [N m], and its derivative E in them (n, joints, inputs).

    Args:
        simulation: says what inputs do.
        arm: one, or n.
        q: shape (n, joints) [rad].
        inputs: anything within bounds, shape (n, inputs).
        step: of the differences, which are exact.
    """

    def gradient(values: np.ndarray) -> np.ndarray:
        rows = arm.energy_gradient(tuple(q.T), simulation.actuation(arm, tuple(values.T)))
        return np.stack([np.broadcast_to(row, len(q)) for row in rows], axis=1)

    here = gradient(inputs)
    effect = np.stack([(gradient(inputs + step * e) - here) / step for e in np.eye(inputs.shape[1])], axis=2)
    return here - np.einsum("nij,nj->ni", effect, inputs), effect


def allocated(effect: np.ndarray, wanted: np.ndarray, near: np.ndarray, low: ArrayLike, high: ArrayLike) -> np.ndarray:
    """Inputs u with E u = `wanted` within bounds, near given ones: those that come to a bound stay there, and the
    others make up for it as far as they can (redistributed pseudo-inverse).

    Args:
        effect: E, shape (n, joints, inputs).
        wanted: shape (n, joints).
        near: shape (n, inputs).
        low: lowest inputs, a number or an array (n, inputs).
        high: highest.
    """
    inputs = np.clip(near, low, high)
    free = np.ones_like(inputs)
    scale = np.einsum("nij,nij->n", effect, effect)[:, None, None] * np.eye(effect.shape[1])
    for _ in range(_SPREADS):
        off = wanted - np.einsum("nij,nj->ni", effect, inputs)
        own = effect * free[:, None]
        inverse = np.linalg.inv(own @ effect.transpose(0, 2, 1) + _RIGID * scale)
        moved = inputs + np.einsum("nji,njk,nk->ni", own, inverse, off)
        free = free * ((moved > low) & (moved < high))
        inputs = np.clip(moved, low, high)
    return np.asarray(inputs)
