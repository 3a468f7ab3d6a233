"""Input shaping: commands that leave no vibration behind.

An input shaper replaces a command by a sum of delayed ones [Singer & Seering, "Preshaping Command Inputs to Reduce
System Vibration", ASME J. Dyn. Sys. Meas. Control 112 (1990)]. For a mode of frequency w and damping ratio zeta,

    K = exp(-zeta pi / sqrt(1 - zeta^2)),    T = pi / (w sqrt(1 - zeta^2)),
    ZV:  1 / (1 + K) now, K / (1 + K) after T,
    ZVD: 1 / (1 + K)^2 now, 2 K / (1 + K)^2 after T, K^2 / (1 + K)^2 after 2 T,

and what the shares excite cancels from the last of them on; ZVD does so to first order where w is wrong, too. Several
modes take one shaper each, one after another. Delays between steps are interpolated.
"""

from typing import Literal, NamedTuple

import numpy as np

Shaper = Literal["ZV", "ZVD"]


class Vibration(NamedTuple):
    """Modes of n mechanisms.

    Attributes:
        half_period: T in steps, shape (n, modes).
        decay: K, by which an amplitude falls in that time, shape (n, modes).
    """

    half_period: np.ndarray
    decay: np.ndarray


def vibration_of(motions: np.ndarray, count: int, shortest: float = 2.0) -> Vibration:
    """The modes of linear motions, from the eigenvalues of their transition matrices over a step.

    Args:
        motions: transition matrices, shape (n, size, size).
        count: how many modes to tell; where there are fewer, their half period is 0 and they shape nothing.
        shortest: half period [steps]; faster modes are left out.
    """
    half, decay = np.zeros((len(motions), count)), np.ones((len(motions), count))
    for i, a in enumerate(motions):
        values = np.linalg.eigvals(a)
        values = values[(values.imag > 1e-9) & (np.abs(values) > 1e-6)]
        turns = np.pi / np.angle(values)
        chosen = np.flatnonzero(turns >= shortest)
        chosen = chosen[np.argsort(-turns[chosen])][:count]
        half[i, : len(chosen)] = turns[chosen]
        decay[i, : len(chosen)] = np.abs(values[chosen]) ** turns[chosen]
    return Vibration(half, np.minimum(decay, 1.0))


def shaped(
    start: np.ndarray, plan: np.ndarray, vibration: Vibration, shaper: Shaper = "ZVD", more: int = 50
) -> np.ndarray:
    """The plan through a shaper for each mode.

    Args:
        start: inputs before the first step, shape (n, inputs).
        plan: after each step, shape (n, steps, inputs).
        vibration: what is not to be excited.
        shaper: see the module.
        more: steps by which the plan gets longer.
    """
    n, length, _ = plan.shape
    plan = np.concatenate([plan, np.repeat(plan[:, -1:], more, axis=1)], axis=1)
    rows, last = np.arange(n)[:, None], length + more - 1
    for half, k in zip(vibration.half_period.T, vibration.decay.T, strict=True):
        order = 2 if shaper == "ZVD" else 1
        shares = np.array([np.ones(n), 2 * k, k**2] if order == 2 else [np.ones(n), k]) / (1 + k) ** order
        whole = np.concatenate([start[:, None], plan], axis=1)
        moved = shares[0][:, None, None] * plan
        for times in range(1, order + 1):  # `at` 0 is the start, k the plan's k-th
            at = np.maximum(np.arange(length + more) + 1 - times * half[:, None], 0.0)
            before = np.minimum(at.astype(int), last)
            part = (at - before)[..., None]
            late = (1 - part) * whole[rows, before] + part * whole[rows, before + 1]
            moved = moved + shares[times][:, None, None] * late
        plan = moved
    return np.asarray(plan)
