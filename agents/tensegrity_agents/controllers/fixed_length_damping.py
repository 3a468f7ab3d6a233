"""Active damping of mechanisms with prismatic actuators: elastic motion at imposed lengths, and how to calm it.

Lengths l are imposed by the actuators; what is elastic, w, swings about its equilibrium w0(l). With y = w - w0(l),
small, M the inertia of w at locked lengths and N that between w and l,

    M y'' + C y' + K y = -(N + M dw0/dl) l''.

Lengths move evenly within a step, so that l'' is an impulse where a step begins: linear, exact from step to step, but
for the little that hinges damp of the imposed motion. The linear-quadratic regulator of that adds to the planned
lengths small deviations that take the energy out. The platform's orientation and the bars' angles have no actuators of
their own; this is how lengths act on them.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from scipy.linalg import expm

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation

_STEP = 1e-5  # of differences, as a share of the scale of lengths
_AT_FIRST, _LATER = 60, 2  # iterations of Riccati's equation


class Modes(Protocol):
    """What is elastic in a mechanism, for batches of n."""

    count: int  # elastic coordinates
    scale: float  # of lengths [m]

    def read(self, observed: DecodedObservation, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """w - w0(l) [rad], the rate of w [rad/s], and what distinguishes branches, (n, ...)."""
        ...

    def rest(self, lengths: np.ndarray, branch: np.ndarray) -> np.ndarray:
        """w0, shape (n, count) [rad]."""
        ...

    def place(self, w: np.ndarray, lengths: np.ndarray) -> np.ndarray:
        """Coordinates of the simulation, shape (n, coordinates)."""
        ...

    def stiffness(self, w: np.ndarray, lengths: np.ndarray) -> np.ndarray:
        """K, shape (n, count, count) [N m/rad]."""
        ...


def matrices(rows: Sequence[Sequence[Component]], n: int) -> np.ndarray:
    """Matrices (n, rows, columns) from rows of components."""
    return np.stack([np.stack([np.broadcast_to(v, n) for v in row], axis=1) for row in rows], axis=1)


class DampingMemory(NamedTuple):
    """What damping carries from step to step.

    Attributes:
        lengths: planned, after the last step, (n, inputs) [m].
        rate: at which they were to change, (n, inputs) [m/s].
        deviation: what was added to that, (n, inputs) [m/s].
        cost: of Riccati's equation, (n, size, size).
    """

    lengths: np.ndarray
    rate: np.ndarray
    deviation: np.ndarray
    cost: np.ndarray


class Damping:
    """Turns planned lengths into lengths that calm the mechanism meanwhile.

    The regulator weighs the elastic energy and the kinetic one against deviations of the lengths, as if these stretched
    springs of `softness` times the elastic stiffness. They stay below `most` times the scale of lengths, so that they
    do not lead into singularities.

    Args:
        core: of the environment, dynamic, everything observed.
        modes: of its mechanism.
        enabled: whether it does anything; if not, the lengths are the planned ones.
    """

    softness = 10.0
    most = 0.02

    def __init__(self, core: Core, modes: Modes, enabled: bool = True) -> None:
        engine = core.engine
        assert engine is not None
        self.enabled = enabled
        self.modes, self.model = modes, engine.model
        self.time = self.model.dynamics.step_time
        self.damping = np.array(self.model.model.dof_damping).reshape(engine.joints, -1)[:, 0]

    def begin(self, lengths: np.ndarray) -> DampingMemory:
        """For mechanisms at rest."""
        still = np.zeros_like(lengths)
        size = 2 * self.modes.count + 2 * lengths.shape[1]
        return DampingMemory(lengths, still, still, np.full((len(lengths), size, size), np.nan))

    def act(
        self, observed: DecodedObservation, lengths: np.ndarray, planned: np.ndarray, memory: DampingMemory
    ) -> tuple[np.ndarray, DampingMemory]:
        """The lengths to command.

        Args:
            observed: of n environments.
            lengths: commanded last, shape (n, inputs) [m].
            planned: after this step, shape (n, inputs) [m].
            memory: from the step before.
        """
        if not self.enabled:
            return planned, memory._replace(lengths=planned)
        m = lengths.shape[1]
        elastic, rate, branch = self.modes.read(observed, lengths)
        jump, flow, weight, slope = self._system(lengths, branch)
        v = (planned - memory.lengths) / self.time
        speed = rate - np.einsum("nij,nj->ni", slope, memory.rate + memory.deviation)
        speed = speed - np.einsum("nij,nj->ni", jump, v - memory.rate)
        k = self.modes.count
        state = np.concatenate([elastic, speed, lengths - memory.lengths, memory.deviation], axis=1)
        n, size = state.shape
        # One step: the deviation d of the lengths' rates kicks the speed, then the mechanism swings freely.
        inside, inlet = np.zeros((n, size, size)), np.zeros((n, size, m))
        inside[:, : 2 * k, : 2 * k] = flow
        inside[:, : 2 * k, 2 * k + m :] = flow[:, :, k:] @ jump
        inside[:, 2 * k : 2 * k + m, 2 * k : 2 * k + m] = np.eye(m)
        inlet[:, : 2 * k] = -flow[:, :, k:] @ jump
        inlet[:, 2 * k : 2 * k + m] = self.time * np.eye(m)
        inlet[:, 2 * k + m :] = np.eye(m)
        price = self.softness * np.trace(weight[:, :k, :k], axis1=1, axis2=2) / k / self.modes.scale**2
        cost = np.zeros((n, size, size))
        cost[:, : 2 * k, : 2 * k] = weight
        cost[:, 2 * k : 2 * k + m, 2 * k : 2 * k + m] = price[:, None, None] * np.eye(m)
        effort = price[:, None, None] * self.time**2 * np.eye(m)
        fresh = ~np.isfinite(memory.cost[:, 0, 0])
        ahead = np.where(fresh[:, None, None], cost, memory.cost)
        for _ in range(_AT_FIRST if fresh.any() else _LATER):
            gain, ahead = _riccati(inside, inlet, cost, effort, ahead)
        d = -np.einsum("nij,nj->ni", gain, state)
        most = self.most * self.modes.scale
        deviation = np.clip(lengths - memory.lengths + self.time * d, -most, most)
        d = (deviation - (lengths - memory.lengths)) / self.time
        return planned + deviation, DampingMemory(planned, v, d, ahead)

    def half_periods(self, lengths: np.ndarray, branch: np.ndarray) -> np.ndarray:
        """Of the modes where the lengths are kept, in steps, shape (n, count), the longest first."""
        k = self.modes.count
        _, _, weight, _ = self._system(lengths, branch)
        squares = np.linalg.eigvals(np.linalg.solve(weight[:, k:, k:], weight[:, :k, :k])).real
        return np.asarray(np.pi / np.sqrt(np.sort(squares, axis=1)) / self.time)

    def _system(self, lengths: np.ndarray, branch: np.ndarray) -> tuple[np.ndarray, ...]:
        """Kick of the speed per rate of lengths; free motion over a step; energy; d w0 / d l."""
        n, m = lengths.shape
        k, h = self.modes.count, _STEP
        rest = self.modes.rest(lengths, branch)
        u = self.modes.place(rest, lengths)

        def slopes(function: Callable[[np.ndarray], np.ndarray], size: int, step: float) -> np.ndarray:
            return np.stack([(function(step * e) - function(-step * e)) / (2 * step) for e in np.eye(size)], axis=2)

        by_w = slopes(lambda e: self.modes.place(rest + e, lengths), k, h)
        by_l = slopes(lambda e: self.modes.place(rest, lengths + e), m, h * self.modes.scale)

        def turned(e: np.ndarray) -> np.ndarray:
            change = self.modes.rest(lengths + e, branch) - rest
            return np.asarray(np.arctan2(np.sin(change), np.cos(change)))

        slope = slopes(turned, m, h * self.modes.scale)
        mass = np.stack([self.model.mass_matrix(row) for row in u])
        inertia = np.swapaxes(by_w, 1, 2) @ mass @ by_w
        coupling = np.swapaxes(by_w, 1, 2) @ mass @ by_l
        lag = np.swapaxes(by_w, 1, 2) @ (self.damping[:, None] * by_w)
        stiffness = self.modes.stiffness(rest, lengths)
        jump = np.linalg.solve(inertia, coupling) + slope
        motion, weight = np.zeros((2, n, 2 * k, 2 * k))
        motion[:, :k, k:] = np.eye(k)
        motion[:, k:, :k] = -np.linalg.solve(inertia, stiffness)
        motion[:, k:, k:] = -np.linalg.solve(inertia, lag)
        weight[:, :k, :k], weight[:, k:, k:] = stiffness, inertia
        return jump, expm(self.time * motion), weight, slope


def _riccati(
    inside: np.ndarray, inlet: np.ndarray, cost: np.ndarray, effort: np.ndarray, ahead: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Gain and cost of one more step before those that cost `ahead`."""
    right = np.swapaxes(inlet, 1, 2) @ ahead
    gain = np.linalg.solve(effort + right @ inlet, right @ inside)
    closed = inside - inlet @ gain
    before = cost + np.swapaxes(gain, 1, 2) @ effort @ gain + np.swapaxes(closed, 1, 2) @ ahead @ closed
    return gain, (before + np.swapaxes(before, 1, 2)) / 2
