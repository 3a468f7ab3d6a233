"""The analytic controllers that hold the tip of the dual-triangle arm against a growing force.

The literature offers none. What can be done is to make the arm stiff (co-contraction), to choose the posture on the
self-motion curve that withstands most, and to correct the inputs for the load that the joint angles reveal.
"""

from abc import abstractmethod
from typing import NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import AnalyticController, Observation, columns_of
from tensegrity_agents.controllers.dual_triangle.identification import explain
from tensegrity_agents.controllers.dual_triangle.stiffening import Loop, hold, withstood
from tensegrity_envs.environments import DualTrianglePush
from tensegrity_envs.mechanics.dual_triangle import DualTriangle, DualTriangleDesign
from tensegrity_envs.observation import DecodedObservation

_PLACES = 180  # on the self-motion curve
_FINE = np.linspace(-1.0, 1.0, 11)
_SHARES = np.array([1.0, 0.7, 0.5, 0.35, 0.2, 0.1, 0.05, 0.0])


class Memory(NamedTuple):
    """What a controller carries from step to step, for n environments.

    Attributes:
        step: of the episode, shape (n,).
        commanded: configuration that the inputs stand for, shape (n, 3) [rad].
        load: estimated a step ago, shape (n, 2) [N].
        goal: place on the self-motion curve to go to, shape (n,).
        sense: in which to go there, +-1, shape (n,).
        offset: of the tip from the target to go to, shape (n, 2) [m].
    """

    step: np.ndarray
    commanded: np.ndarray
    load: np.ndarray
    goal: np.ndarray
    sense: np.ndarray
    offset: np.ndarray


class PushController(AnalyticController[Memory]):
    """What the controllers of this task share.

    Args:
        core: of the environment.
    """

    core: DualTrianglePush
    nominal: DualTriangle

    def _take(self, design: DualTriangleDesign) -> None:
        super()._take(design)
        self.bounds = self.input_bounds()

    def decode(self, observation: Observation) -> DecodedObservation:
        """The observation, with the joint angles that explain the tip where they are not observed."""
        observed = super().decode(observation)
        if "joint_angles" in observed:
            return observed
        q = explain(self.nominal, observed.tip, observed.inputs).configuration
        return observed.replace(joint_angles=q)

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> Memory:
        """See `AnalyticController.initial`."""
        n = len(index)
        none = np.zeros((n, 2))
        return Memory(np.zeros(n, int), observed.joint_angles, none, np.zeros(n), np.ones(n), none)

    def _act(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        action, memory = self._move(observed, observed.joint_angles, memory)
        return action, memory._replace(step=memory.step + 1)

    @abstractmethod
    def _move(self, observed: DecodedObservation, q: np.ndarray, memory: Memory) -> tuple[np.ndarray, Memory]:
        """Actions (n, 6) for configurations (n, 3) [rad], and what to remember."""


class HoldInputs(PushController):
    """The closed form's inputs for the unloaded arm, with which an episode begins, are kept."""

    knows = "the nominal design; no feedback"

    def _move(self, observed: DecodedObservation, q: np.ndarray, memory: Memory) -> tuple[np.ndarray, Memory]:
        return np.zeros_like(observed.inputs), memory


class PushPseudoInverse(PushController):
    """Resolved rate: the commanded configuration moves by the damped pseudo-inverse of the tip error; its inputs are
    those of the unloaded control law.
    """

    knows = "the nominal design; feedback of the tip error"
    gain = 0.5
    damping = 0.005  # [m/rad]

    def _move(self, observed: DecodedObservation, q: np.ndarray, memory: Memory) -> tuple[np.ndarray, Memory]:
        x, y = (observed.tip + self.gain * (observed.target - observed.tip)).T
        step = np.stack(self.nominal.moore_penrose_step(tuple(q.T), x, y, self.damping), axis=1)
        limit = float(self.nominal.design.joint_limit)
        commanded = np.clip(memory.commanded + step, -limit, limit)
        lengths = np.stack(self.nominal.free_lengths(self.nominal.control(tuple(commanded.T))), axis=1)
        return (lengths - observed.inputs) / self.rate, memory._replace(commanded=commanded)


class PushObserver(PushController):
    """Estimates the load from the joint angles, corrects the inputs for the load to come, co-contracts as far as the
    bounds allow, and moves along the self-motion curve to the posture that withstands the largest load.

    From the first change of the load it takes direction and growth, which it assumes to stay. The target's tolerance is
    used, too: the tip goes to the point within it that withstands most. In every step, of all combinations of a share
    of the stride along the curve and a share of the remaining stiffening, it takes one that the rates allow and that is
    stable under the load to come.
    """

    knows = "the nominal design; estimates the load from the joint angles, checks stability"
    largest_turn = 0.15  # along the curve in one step
    share_of_tolerance = 0.98
    safe = 0.02  # stability margin beyond which no more is asked for
    first_move = 1  # step; before, the direction of the load is not known

    def _move(self, observed: DecodedObservation, q: np.ndarray, memory: Memory) -> tuple[np.ndarray, Memory]:
        load = np.stack(self.nominal.estimate_load(tuple(q.T), tuple(observed.inputs.T)), axis=1)
        growth = self._growth(load, memory)
        begins = np.flatnonzero(self._plans_now(memory))
        if len(begins):
            plan = self._plan(observed.target[begins], q[begins], growth[begins])
            goal, sense, offset = memory.goal.copy(), memory.sense.copy(), memory.offset.copy()
            goal[begins], sense[begins], offset[begins] = plan
            memory = memory._replace(goal=goal, sense=sense, offset=offset)
        moves = memory.step >= self.first_move
        return self._step(observed, q, load + growth, moves, memory), memory._replace(load=load)

    def _growth(self, load: np.ndarray, memory: Memory) -> np.ndarray:
        """What the load will grow by in the next step [N], (n, 2)."""
        return np.where(memory.step[:, None] > 0, load - memory.load, 0.0)

    def _plans_now(self, memory: Memory) -> np.ndarray:
        return np.asarray(memory.step == self.first_move)

    def _plan(self, target: np.ndarray, q: np.ndarray, growth: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where on the self-motion curve to go, in which sense, and with which offset of the tip."""
        n, arm = len(target), self.nominal
        speed = np.maximum(np.hypot(*growth.T), 1e-12)
        unit = growth / speed[:, None]
        largest = 4 * self.core.critical_load
        places = np.arange(_PLACES) * (2 * np.pi / _PLACES)
        table = Loop(arm, tuple(np.repeat(target, _PLACES, axis=0).T)).at(np.tile(places, n)).reshape(3, n, _PLACES)
        direction = unit[:, :1], unit[:, 1:]
        strength = withstood(arm, self.bounds, table, direction, largest)
        half = self.core.critical_load / 2
        lengths = np.stack(hold(arm, self.bounds, table, (half * direction[0], half * direction[1])).free_lengths)
        steps = np.abs(np.roll(lengths, -1, axis=2) - lengths).max(axis=0) / self.rate + 0.02
        first = np.rint(Loop(arm, tuple(target.T)).place(q.T) / (2 * np.pi) * _PLACES).astype(int) % _PLACES
        rows = np.arange(n)[:, None]
        best, goal, turning = np.full(n, -np.inf), np.zeros(n, int), np.ones(n)
        for sense in (1, -1):
            order = (first[:, None] + sense * np.arange(_PLACES)) % _PLACES
            cost = steps[rows, order if sense > 0 else (order - 1) % _PLACES]
            arrival = np.concatenate([np.zeros((n, 1)), np.cumsum(cost, axis=1)[:, :-1]], axis=1)
            along = strength[rows, order]
            passable = along > speed[:, None] * (arrival + 12.0)  # the first steps go into stiffening
            passable[:, 0] = True
            open_path = np.logical_and.accumulate(passable, axis=1)
            value = np.where(open_path, along - 0.02 * speed[:, None] * arrival, -np.inf)
            place = value.argmax(axis=1)
            better = value[rows[:, 0], place] > best
            best = np.where(better, value[rows[:, 0], place], best)
            goal = np.where(better, order[rows[:, 0], place], goal)
            turning = np.where(better, sense, turning)
        s, offset = self._refined(target, places[goal], (unit[:, 0], unit[:, 1]), largest)
        return s, turning, offset

    def _refined(
        self, target: np.ndarray, s: np.ndarray, unit: tuple[np.ndarray, np.ndarray], largest: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """The place near s, and the tip on the edge of the tolerance, that withstand most: on a grid, then a finer."""
        radius = self.share_of_tolerance * self.core.task.tolerance
        rows, side = np.arange(len(s))[:, None], np.zeros(len(s))
        for turns, places in ((np.arange(24) * np.pi / 12, np.linspace(-0.6, 0.6, 31)), (_FINE * 0.25, _FINE * 0.04)):
            all_turns, all_places = (v.ravel() for v in np.meshgrid(turns, places))
            angle, where = side[:, None] + all_turns, s[:, None] + all_places
            x, y = target[:, :1] + radius * np.cos(angle), target[:, 1:] + radius * np.sin(angle)
            q = Loop(self.nominal, (x.ravel(), y.ravel())).at(where.ravel()).reshape(3, *where.shape)
            strength = withstood(self.nominal, self.bounds, q, (unit[0][:, None], unit[1][:, None]), largest)
            best = strength.argmax(axis=1)[:, None]
            side, s = angle[rows, best][:, 0], where[rows, best][:, 0]
        return s % (2 * np.pi), radius * np.stack([np.cos(side), np.sin(side)], axis=1)

    def _step(
        self, observed: DecodedObservation, q: np.ndarray, load: np.ndarray, moves: np.ndarray, memory: Memory
    ) -> np.ndarray:
        """Actions (n, 6): of all combinations of moving and stiffening the best that is possible under the load."""
        along, stiffer = (v.ravel()[:, None] for v in np.meshgrid(_SHARES, _SHARES))
        ahead = self._ahead(observed, q, along, moves, memory)
        nominal = self.nominal.free_lengths((0.0, 0.0, 0.0))
        beyond = observed.inputs - np.array(nominal)
        common = tuple(((beyond[:, 0::2] + beyond[:, 1::2]) / 2).T)
        held = hold(self.nominal, self.bounds, ahead, tuple(load.T), common, stiffer)
        change = (np.stack(held.free_lengths) - observed.inputs.T[:, None]) / self.rate
        largest = np.abs(change).max(axis=0)
        rank = 10 * np.minimum(held.stability_margin / self.safe, 1.0) + stiffer + 0.5 * along
        best = np.where(largest <= 1.0, rank, -1e3 * largest).argmax(axis=0)
        return np.asarray(change[:, best, np.arange(len(q))].T)

    def _ahead(
        self, observed: DecodedObservation, q: np.ndarray, along: np.ndarray, moves: np.ndarray, memory: Memory
    ) -> np.ndarray:
        """Postures (3, m, n) [rad] at the shares `along` (m, 1) of a stride; share 0 leaves the posture as it is."""
        arm, n = self.nominal, len(q)
        tip = np.stack(arm.tip(tuple(q.T)))
        here = Loop(arm, (tip[0], tip[1])).place(q.T)
        near = np.pi - (np.pi - (memory.goal - here)) % (2 * np.pi)
        left = np.where(np.abs(near) < 0.5, near, memory.sense * ((memory.sense * (memory.goal - here)) % (2 * np.pi)))
        stride = np.where(moves, np.clip(left, -self.largest_turn, self.largest_turn), 0.0)
        # The tip goes to its offset in step with the place on the curve.
        pace = np.where(moves, np.where(np.abs(left) > 1e-9, stride / np.where(left == 0, 1.0, left), 1.0), 0.0)
        x, y = (tip[i] + along * pace * ((observed.target + memory.offset)[:, i] - tip[i]) for i in range(2))
        ahead = Loop(arm, (x.ravel(), y.ravel())).at((here + along * stride).ravel()).reshape(3, -1, n)
        return np.where(along == 0, q.T[:, None], ahead)


class PushOracle(PushObserver):
    """Is given the growth of the load: it plans the posture before the first step."""

    wants_privileged = True
    knows = "how the load grows; plans the posture in advance"
    first_move = 0

    def _growth(self, load: np.ndarray, memory: Memory) -> np.ndarray:
        return columns_of(self.truth.load_rate, len(load))
