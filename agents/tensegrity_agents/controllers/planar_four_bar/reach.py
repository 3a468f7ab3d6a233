"""The analytic controllers that reach with the planar 4-bar mechanism, and the information set of each.

[Ji2014] has no controller. The closed form is the inverse kinematics; under a force the mechanism yields across bar CF,
and can snap to its other side: observer and oracle plan with that.
"""

from typing import NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import AnalyticController
from tensegrity_agents.controllers.planar_four_bar.corners import ByCorners
from tensegrity_agents.controllers.planar_four_bar.measurements import (
    NOTICEABLE,
    configuration,
    force_across,
    identified,
    resolved_rate,
    side,
    with_posture,
)
from tensegrity_agents.controllers.planar_four_bar.planning import LEGS, plan, trips, waypoints
from tensegrity_envs.mechanics.planar_four_bar import PlanarFourBar, PlanarFourBarDesign
from tensegrity_envs.observation import DecodedObservation

_SAME = 1e-6  # actions that differ by less are one


class Memory(NamedTuple):
    """What a controller carries from step to step, for n environments.

    Attributes:
        path: actuator lengths to visit one after another, shape (n, LEGS, 2) [m].
        leg: which of them is next, shape (n,).
        action: the controller's own latest one, shape (n, 2).
        arrives: whether that leads there, shape (n,).
        step: of the episode, shape (n,).
        information: see `measurements.with_posture`, (n, 2, 2).
        evidence: see `measurements.with_posture`, (n, 2) [N].
        load: with which the path was planned, (n, 2) [N].
        least: distance of the tip from the target since the last new start, (n,) [m].
        waited: steps in which it did not fall, (n,).
    """

    path: np.ndarray
    leg: np.ndarray
    action: np.ndarray
    arrives: np.ndarray
    step: np.ndarray
    information: np.ndarray
    evidence: np.ndarray
    load: np.ndarray
    least: np.ndarray
    waited: np.ndarray


def onward(memory: Memory, action: np.ndarray) -> Memory:
    """A corner that the controller's own action leads to counts as reached, where another action is taken."""
    differs = np.abs(action - memory.action).max(axis=1) > _SAME
    return memory._replace(leg=np.minimum(memory.leg + (memory.arrives & differs), LEGS - 1))


class ReachController(AnalyticController[Memory]):
    """Follows a path of actuator lengths. Subclasses say how it is planned.

    Args:
        core: of the environment.
    """

    nominal: PlanarFourBar
    first_step = 0.5  # of who does not know the force yet, as a share of the largest

    def _take(self, design: PlanarFourBarDesign) -> None:
        super()._take(design)
        self.bounds = self.input_bounds()
        points = waypoints(self.nominal, 40)
        pairs = np.stack([np.repeat(points[:24], 24, axis=0), np.tile(points[:24], (24, 1))], axis=1)
        self.table = np.concatenate([np.repeat(points[:, None], 2, axis=1), pairs[::3]])

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> Memory:
        """See `AnalyticController.initial`."""
        n = len(index)
        return Memory(
            np.repeat(observed.actuator_lengths[:, None], LEGS, axis=1),
            np.zeros(n, int),
            np.zeros((n, 2)),
            np.zeros(n, bool),
            np.zeros(n, int),
            np.zeros((n, 2, 2)),
            np.zeros((n, 2)),
            np.full((n, 2), np.nan),
            np.full(n, np.inf),
            np.zeros(n, int),
        )

    def _act(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        action, memory = self._move(observed, memory)
        return action, memory._replace(step=memory.step + 1)

    def _move(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        """Actions (n, 2), and what to remember."""
        return self.along(observed, self.planned(observed, memory, np.flatnonzero(memory.step == 0)))

    def load(self, observed: DecodedObservation, memory: Memory) -> np.ndarray:
        """The force on F that is planned with, shape (n, 2) [N]."""
        return np.zeros_like(observed.tip)

    def planned(self, observed: DecodedObservation, memory: Memory, index: np.ndarray) -> Memory:
        """The memory with new paths for the environments at `index`."""
        if not len(index):
            return memory
        part, load = observed.take(index), self.load(observed, memory)[index]
        q = configuration(self.nominal, part)
        tolerance = self.core.task.tolerance / 2
        path, leads = plan(
            self.nominal, q, part.actuator_lengths, part.target, load, self.table, self.rate, self.bounds, tolerance
        )
        better = leads | ~np.isfinite(memory.load[index, 0])  # an old path is better than none
        paths, legs, loads = memory.path.copy(), memory.leg.copy(), memory.load.copy()
        paths[index] = np.where(better[:, None, None], path, paths[index])
        legs[index] = np.where(better, 0, legs[index])
        loads[index] = load
        return memory._replace(path=paths, leg=legs, load=loads)

    def _stranded(self, observed: DecodedObservation, memory: Memory) -> np.ndarray:
        """Whether the path has ended off the target, shape (n,)."""
        off = np.hypot(*(observed.target - observed.tip).T) > self.core.task.tolerance
        arrived = np.abs(memory.path[:, -1] - observed.actuator_lengths).max(axis=1) < 1e-4 * self.rate
        return np.asarray(off & arrived & (memory.step < 90))

    def along(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        """Actions (n, 2) along the path from the present lengths on, and what to remember."""
        rows = np.arange(len(memory.leg))
        leg = memory.leg
        for _ in range(LEGS):
            change = memory.path[rows, leg] - observed.actuator_lengths
            leg = np.where((np.abs(change).max(axis=1) < 1e-4 * self.rate) & (leg < LEGS - 1), leg + 1, leg)
        change = memory.path[rows, leg] - observed.actuator_lengths
        steps = np.abs(change).max(axis=1, keepdims=True) / self.rate
        action = change / np.maximum(steps, 1.0) / self.rate
        return action, memory._replace(leg=leg, action=action, arrives=steps[:, 0] <= 1.0)

    def safest(self, observed: DecodedObservation, load: np.ndarray) -> np.ndarray:
        """Of small actions in eight directions the one after which the mechanism has the largest margin, (n, 2)."""
        n, q = len(load), configuration(self.nominal, observed)
        turn = np.arange(8) * np.pi / 4
        actions = self.first_step * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        end = np.clip(observed.actuator_lengths[:, None] + self.rate * actions, *self.bounds).reshape(-1, 1, 2)
        points = np.concatenate([np.repeat(observed.actuator_lengths, 8, axis=0)[:, None], *[end] * LEGS], axis=1)
        _, margin = trips(self.nominal, np.repeat(q, 8, axis=0), points, np.repeat(load, 8, axis=0))
        return np.asarray(actions[margin.reshape(n, 8).argmax(axis=1)])


class ClosedFormIK(ReachController):
    """Inverse kinematics of the unloaded rectangle, on its side; the lengths go there straight, or round the
    singularity at rho1 = rho2 = L.
    """

    knows = "the nominal design; closed-form inverse kinematics without a load, no feedback"


class PseudoInverse(ReachController):
    """Resolved rate: steps of the lengths by the damped pseudo-inverse of the unloaded Jacobian, with feedback.

    Steps that would come close to a singularity of the unloaded rectangle are turned aside. Where the error stops
    falling, at a fold of the Jacobian, the lengths first go to those of a fixed table whose tip is nearest to the
    target but which are not near.
    """

    knows = "the nominal design; feedback of the tip error"
    gain = 0.6
    damping = 0.1
    keep_off = 0.07  # of the stability margin
    patience = 6  # steps without progress
    apart = 0.2  # so different the next lengths are, in L
    turns = np.deg2rad([0.0, 40.0, -40.0, 80.0, -80.0, 120.0, -120.0, 160.0, -160.0, 180.0])

    def _move(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        lengths, here = observed.actuator_lengths, side(self.nominal, observed)
        error = observed.target - observed.tip
        memory = self._watch(observed, np.hypot(*error.T), here, memory)
        crossing = memory.leg > 0
        step = np.where(
            crossing[:, None],
            memory.path[:, 0] - lengths,
            resolved_rate(self.nominal, lengths, here, self.gain * error, self.damping),
        )
        step = step / np.maximum(np.abs(step).max(axis=1, keepdims=True) / self.rate, 1.0)
        return self.turned_aside(lengths, step) / self.rate, memory

    def turned_aside(self, lengths: np.ndarray, step: np.ndarray) -> np.ndarray:
        """The step, turned until the lengths keep off the singularities; or less far in, where they are too close."""
        c, s = np.cos(self.turns), np.sin(self.turns)
        turned = np.stack(
            [np.outer(c, step[:, 0]) - np.outer(s, step[:, 1]), np.outer(s, step[:, 0]) + np.outer(c, step[:, 1])]
        )
        new = np.clip(lengths.T[:, None] + turned, *self.bounds)
        square, rest = self.nominal.flatness((new[0], new[1]))
        margin = 2 * np.minimum(square, rest)
        good = margin >= self.keep_off
        choice = np.where(good.any(axis=0), good.argmax(axis=0), margin.argmax(axis=0))
        return np.asarray((new[:, choice, np.arange(len(step))]).T - lengths)

    def _watch(self, observed: DecodedObservation, distance: np.ndarray, here: np.ndarray, memory: Memory) -> Memory:
        """Begin to go to other lengths where there was no progress (leg > 0), and end it there."""
        progress = (distance < 0.98 * memory.least) | (distance <= self.core.task.tolerance)
        waited = np.where(progress, 0, memory.waited + 1)
        crossing = memory.leg > 0
        there = np.abs(memory.path[:, 0] - observed.actuator_lengths).max(axis=1) < 0.2 * self.rate
        tired = crossing & (waited > 40)
        stuck = ~crossing & (waited > self.patience)
        if stuck.any():
            l = float(self.nominal.length)
            table = self.table[:40, 0]
            tips = [np.stack(self.nominal.rectangle(tuple(table.T), sign)[1], axis=1) for sign in (1.0, -1.0)]
            on_side = np.where(here[:, None, None] > 0, tips[0], tips[1])
            distance_to = np.linalg.norm(observed.target[:, None] - on_side, axis=2)
            near = np.abs(table - observed.actuator_lengths[:, None]).max(axis=2) < self.apart * l
            visited = np.abs(table - memory.path[:, None, 0]).max(axis=2) < self.apart * l
            choice = np.where(near | visited, np.inf, distance_to).argmin(axis=1)
            path = memory.path.copy()
            path[stuck] = table[choice[stuck]][:, None]
            memory = memory._replace(path=path)
        crossing = (crossing | stuck) & ~there & ~tired
        changed = crossing != (memory.leg > 0)
        return memory._replace(
            leg=crossing.astype(int),
            waited=np.where(changed, 0, waited),
            least=np.where(changed, np.inf, np.minimum(memory.least, distance)),
        )


class Observer(ReachController, ByCorners[Memory]):
    """Identifies the force on F from tip and lengths, and plans with it.

    One posture reveals the force across bar CF only. So the first step is a small one, the safest under what is known;
    two postures reveal all of the force, by least squares.
    """

    knows = "the nominal design; identifies the force from tip and lengths, checks that the path is stable"
    looks = 1

    def course(self, observed: DecodedObservation, memory: Memory) -> tuple[Memory, np.ndarray, np.ndarray]:
        """See `ByCorners.course`."""
        return memory, observed.actuator_lengths, self.load(observed, memory)

    def steps(self, memory: Memory) -> np.ndarray:
        """See `ByCorners.steps`."""
        return memory.step

    def given(self, before: Memory, after: Memory, action: np.ndarray) -> Memory:
        """See `Correctable.given`."""
        return onward(after, action)

    def load(self, observed: DecodedObservation, memory: Memory) -> np.ndarray:
        """See `ReachController.load`."""
        return identified(self.nominal, memory.information, memory.evidence)

    def _move(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        known = with_posture(memory.information, memory.evidence, *force_across(self.nominal, observed))
        memory = memory._replace(information=known[0], evidence=known[1])
        changed = np.hypot(*(self.load(observed, memory) - memory.load).T)
        noticeable = NOTICEABLE * float(self.nominal.largest_force)
        again = ~(changed < noticeable) | self._stranded(observed, memory)  # NaN: never planned
        first = memory.step == 0
        action, memory = self.along(observed, self.planned(observed, memory, np.flatnonzero(again & ~first)))
        beginning = np.flatnonzero(first)
        if len(beginning):
            action[beginning] = self.safest(observed.take(beginning), self.load(observed, memory)[beginning])
        return action, memory


class Oracle(ReachController):
    """Is given the true force."""

    wants_privileged = True
    knows = "the true force; plans paths along which the mechanism does not snap"

    def _move(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        again = (memory.step == 0) | self._stranded(observed, memory)
        return self.along(observed, self.planned(observed, memory, np.flatnonzero(again)))

    def load(self, observed: DecodedObservation, memory: Memory) -> np.ndarray:
        """See `ReachController.load`."""
        return self.true_load(np.arange(len(observed.tip)))
