"""The analytic controllers that reach with the dual-triangle arm, and the information set of each.

[Zhao2021] is the closed form: redundancy resolution by one of three objectives and the control law. Under a load the
law needs the load (with the sign of the print corrected), and stability must be checked: observer and oracle do both.
"""

from abc import abstractmethod
from typing import NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import AnalyticController, jacobian_at
from tensegrity_agents.controllers.dual_triangle.identification import advance, explain
from tensegrity_agents.controllers.dual_triangle.planning import RoadMap, choose_posture, schedules
from tensegrity_envs.mechanics.dual_triangle import DualTriangle, DualTriangleDesign
from tensegrity_envs.mechanics.dual_triangle.redundancy import Objective
from tensegrity_envs.observation import DecodedObservation

_TABLE = 400  # postures that the pseudo-inverse may start from anew
STEPS = 100  # planned ahead; afterwards the last inputs are held


class Memory(NamedTuple):
    """What a controller carries from step to step, for n environments.

    Attributes:
        plan: control inputs after each step, shape (n, steps, segments) [m].
        step: of the episode, shape (n,).
        commanded: configuration that the inputs stand for, shape (n, segments) [rad].
        least: distance of the tip from the target since the last new start, shape (n,) [m].
        waited: steps in which it did not fall, shape (n,).
        restart_at: posture that is tried next, shape (n, segments) [rad].
        crossing: whether the arm is moving there, shape (n,).
    """

    plan: np.ndarray
    step: np.ndarray
    commanded: np.ndarray
    least: np.ndarray
    waited: np.ndarray
    restart_at: np.ndarray
    crossing: np.ndarray


class ReachController(AnalyticController[Memory]):
    """Plans the inputs of an episode when it begins, and follows the plan. Subclasses say how they plan.

    Args:
        core: of the environment.

    Attributes:
        any_segments: whether it is for arms of any number of segments, or for three alone.

    Raises:
        ValueError: it is for three segments, and the arm has another number.
    """

    nominal: DualTriangle
    any_segments = False

    def _take(self, design: DualTriangleDesign) -> None:
        super()._take(design)
        if not (self.any_segments or self.nominal.has_plain_links):
            kind = "links of different lengths" if self.nominal.segments == 3 else f"{self.nominal.segments}"
            raise ValueError(
                f"{type(self).__name__}: plans along the self-motion curves of three segments, not of {kind}; the "
                "closed forms, pseudo_inverse and random take any"
            )
        self.bound = self.input_bounds()[1]
        # Up to here the unloaded arm can be held, too; beyond its joint limit an episode ends.
        self.joint_limit = 0.98 * min(float(design.joint_limit), float(self.nominal.control_limit))

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> Memory:
        """See `AnalyticController.initial`."""
        start = self._start(observed)
        return self._remembering(self._plan(observed, start, index), start)

    def held(self, observed: DecodedObservation) -> Memory:
        """The memory of a plan that holds the inputs."""
        inputs = observed.inputs
        return self._remembering(np.repeat(inputs[:, None], STEPS, axis=1), np.zeros_like(inputs))

    def _remembering(self, plan: np.ndarray, start: np.ndarray) -> Memory:
        """The memory of these plans, from these configurations (n, segments) [rad]."""
        n = len(plan)
        return Memory(
            plan,
            np.zeros(n, int),
            start,
            np.full(n, np.inf),
            np.zeros(n, int),
            np.zeros_like(start),
            np.zeros(n, bool),
        )

    def _start(self, observed: DecodedObservation) -> np.ndarray:
        """Configurations (n, segments) [rad]: observed, or else where the nominal arm would rest under the inputs."""
        if "joint_angles" in observed:
            return observed.joint_angles
        # The law q -> inputs of the unloaded arm has one inverse; from the middle it is reached stably.
        lengths = self.nominal.free_lengths(tuple(observed.inputs.T))
        rest = self.nominal.equilibrium(lengths, tuple(np.zeros_like(observed.inputs.T)))
        return np.stack(rest.configuration, axis=1)

    @abstractmethod
    def _plan(self, observed: DecodedObservation, start: np.ndarray, index: np.ndarray) -> np.ndarray:
        """Inputs of the environments at `index` after each step, (n, steps, segments) [m]."""

    def _act(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        rows = np.arange(len(memory.step))
        wanted = memory.plan[rows, np.minimum(memory.step, STEPS - 1)]
        return (wanted - observed.inputs) / self.rate, memory._replace(step=memory.step + 1)


class ClosedForm(ReachController):
    """One of [Zhao2021]'s objectives chooses the configuration, its control law the inputs; then straight there.

    The optimum is exact and within the limits of joints and free lengths, which the paper's are not.
    """

    any_segments = True
    objective: Objective = "squares"

    def _plan(self, observed: DecodedObservation, start: np.ndarray, index: np.ndarray) -> np.ndarray:
        x, y = observed.target.T
        found = self.nominal.redundancy(x, y, tuple(start.T), self.objective, self.joint_limit)
        goal = np.clip(np.stack(self.nominal.control(found.configuration), axis=1), -self.bound, self.bound)
        change = goal - observed.inputs
        steps = np.maximum(np.abs(change).max(axis=1) / self.rate, 1.0)
        share = np.minimum(np.arange(1, STEPS + 1) / steps[:, None], 1.0)
        return np.asarray(observed.inputs[:, None] + share[..., None] * change[:, None])


class ClosedFormSum(ClosedForm):
    """Objective (a): the smallest sum of the joints' displacements."""

    knows = "the nominal design; smallest sum of joint displacements, no feedback"
    objective = "sum"


class ClosedFormMax(ClosedForm):
    """Objective (b): the smallest largest displacement."""

    knows = "the nominal design; smallest largest joint displacement, no feedback"
    objective = "max"


class ClosedFormSquares(ClosedForm):
    """Objective (c): the smallest sum of squares of the displacements."""

    knows = "the nominal design; smallest sum of squared joint displacements, no feedback"
    objective = "squares"


class PseudoInverse(ReachController):
    """Resolved rate: joint steps by the damped pseudo-inverse of the Jacobian [Zhao2021, Eq. 16], with feedback of the
    tip error.

    The commanded configuration is moved by these steps: that is integral action, which makes up for an unknown load as
    long as the nominal Jacobian points the right way; the inputs are those of the unloaded control law there. Joints
    that run into their limits are taken out of the Jacobian gradually (weighted least norm), and the rest of the
    freedom moves all towards the middle. Where the error stops falling, at joint limits, the arm goes over to another
    posture, that of a fixed table whose tip is nearest to the target, and tries from there.
    """

    any_segments = True
    knows = "the nominal design; feedback of the tip error"
    gain = 0.5
    damping = 0.02  # [m/rad]
    zone = 0.5  # [rad]: so near to its limit a joint moves less
    centring = 0.2
    fade = 0.03  # [m]
    largest_step = 0.1  # of a joint by the pseudo-inverse [rad]
    largest_turn = 0.2  # of a joint while crossing over [rad]
    patience = 5  # steps without progress
    spread = 0.85  # of the postures of the table, as a share of the joint limit
    apart = 0.6  # so different the next posture is, in one joint at least [rad]

    def _plan(self, observed: DecodedObservation, start: np.ndarray, index: np.ndarray) -> np.ndarray:
        return np.zeros((len(start), STEPS, start.shape[1]))

    def _act(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        q, limit = memory.commanded, self.joint_limit
        error = observed.target - observed.tip
        memory = self._watch(observed, np.hypot(*error.T), memory)
        step = self.joint_step(observed, q, self.gain * error)
        goal = np.clip(np.where(memory.crossing[:, None], memory.restart_at, q + step), -limit, limit)
        turn = goal - q
        turn = turn * np.minimum(1.0, self.largest_turn / np.maximum(np.abs(turn).max(axis=1, keepdims=True), 1e-12))
        turn = self.allowed(observed, q, turn)
        change = np.stack(self.nominal.control(tuple((q + turn).T)), axis=1) - observed.inputs
        share = 1.0 / np.maximum(np.abs(change).max(axis=1, keepdims=True) / self.rate, 1.0)
        commanded = q + share * turn
        return share * change / self.rate, memory._replace(commanded=commanded, step=memory.step + 1)

    def allowed(self, observed: DecodedObservation, q: np.ndarray, turn: np.ndarray) -> np.ndarray:
        """As much of joint steps (n, segments) [rad] as may be taken: here all."""
        return turn

    def joint_step(self, observed: DecodedObservation, q: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Joint steps from configurations (n, segments) [rad] for wanted tip steps (n, 2) [m]."""
        return self._resolved_rate(q, wanted)

    def _resolved_rate(self, q: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Joint steps (n, segments) [rad] for wanted tip steps (n, 2) [m]."""
        jacobian = jacobian_at(self.nominal, tuple(q.T))
        near = np.clip((self.joint_limit - np.abs(q)) / self.zone, 0.0, 1.0)
        weight = np.ones_like(q)
        for _ in range(2):  # a joint that is about to run into its limit moves less; on the limit, not at all
            inner = np.einsum("nij,nj,nkj->nik", jacobian, weight, jacobian) + self.damping**2 * np.eye(2)
            inverse = np.einsum("nj,nij,nik->njk", weight, jacobian, np.linalg.inv(inner))
            step = np.einsum("njk,nk->nj", inverse, wanted)
            weight = np.where(step * q > 0, near, 1.0)
        # Damping lets some of the centring through to the tip: it fades away near the target.
        centre = -self.centring * np.minimum(1.0, np.hypot(*wanted.T)[:, None] / self.fade) * q
        step += centre - np.einsum("njk,nkl,nl->nj", inverse, jacobian, centre)
        return np.asarray(
            step * np.minimum(1.0, self.largest_step / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-12))
        )

    def _watch(self, observed: DecodedObservation, distance: np.ndarray, memory: Memory) -> Memory:
        """Begin to cross over to another posture where there was no progress, and end it there."""
        q, limit = memory.commanded, self.joint_limit
        progress = (distance < 0.98 * memory.least) | (distance <= self.core.task.tolerance)
        waited = np.where(progress, 0, memory.waited + 1)
        stuck = (waited > self.patience) & (np.abs(q).max(axis=1) > limit - 0.1) & ~memory.crossing
        table = self.spread * limit * np.random.default_rng(0).uniform(-1.0, 1.0, (_TABLE, q.shape[1]))
        tips = np.stack(self.nominal.tip(tuple(table.T)), axis=1)
        distances = np.linalg.norm(observed.target[:, None] - tips, axis=2)
        distances += np.where(np.abs(table - q[:, None]).max(axis=2) < self.apart, np.inf, 0.0)
        restart_at = np.where(stuck[:, None], table[distances.argmin(axis=1)], memory.restart_at)
        there = np.abs(restart_at - q).max(axis=1) < 1e-3
        crossing = (memory.crossing | stuck) & ~there
        restart = crossing | (memory.crossing & ~crossing)
        return memory._replace(
            waited=np.where(restart, 0, waited),
            least=np.where(restart, np.inf, np.minimum(memory.least, distance)),
            restart_at=restart_at,
            crossing=crossing,
        )


class Observer(ReachController):
    """Solves configuration and load from tip and inputs; then the loaded control law along a path that stays stable.

    It goes to the posture of the target's self-motion curve to which the straight joint path is stable under the
    identified load and within the limits of joints and free lengths: among those with enough clearance, the shortest.
    """

    knows = "the nominal design; identifies configuration and load from tip and inputs, checks stability"

    def _identified(self, observed: DecodedObservation, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Configuration (n, 3) [rad] and load (n, 2) [N]."""
        lengths = np.stack(self.nominal.free_lengths(tuple(observed.inputs.T)), axis=1)
        estimate = explain(self.nominal, observed.tip, lengths)
        return estimate.configuration, estimate.load

    def _plan(self, observed: DecodedObservation, start: np.ndarray, index: np.ndarray) -> np.ndarray:
        q, load = self._identified(observed, index)
        goal, _ = choose_posture(self.nominal, self.bound, q, observed.target, load)
        paths = [np.stack(ends) for ends in zip(q, goal, strict=True)]
        return self._scheduled(paths, load)

    def _scheduled(self, paths: list[np.ndarray], load: np.ndarray) -> np.ndarray:
        return np.asarray(np.clip(schedules(self.nominal, paths, load, self.rate, STEPS), -self.bound, self.bound))


class Oracle(Observer):
    """Is given the true load; runs its plan in the nominal model first, and where the straight path fails, goes round
    by intermediate postures of a road map.
    """

    wants_privileged = True
    knows = "the true load; plans paths inside the set of stable postures"
    attempts = 4

    def _identified(self, observed: DecodedObservation, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        q, _ = super()._identified(observed, index)
        return q, self.true_load(index)

    def _plan(self, observed: DecodedObservation, start: np.ndarray, index: np.ndarray) -> np.ndarray:
        plans = super()._plan(observed, start, index)
        q, load = self._identified(observed, index)
        failed = np.flatnonzero(self._final_error(q, observed, plans, load) > self.core.task.tolerance / 2)
        for i in failed:
            for seed in range(self.attempts):
                roads = RoadMap(self.nominal, self.bound, load[i], np.random.default_rng(seed))
                path = roads.path(q[i], observed.target[i], self.rate)
                if not path:
                    continue
                plan = self._scheduled([np.array([q[i], *path])], load[[i]])
                one = np.array([i])
                if self._final_error(q[one], observed.take(one), plan, load[one])[0] <= self.core.task.tolerance / 2:
                    plans[i] = plan[0]
                    break
        return plans

    def _final_error(
        self, q: np.ndarray, observed: DecodedObservation, plans: np.ndarray, load: np.ndarray
    ) -> np.ndarray:
        """Distance of the tip from the target at the end of plans [m], (n,); infinite where the arm buckles."""
        inputs, fine = observed.inputs, np.ones(len(q), bool)
        tip = observed.tip
        for step in range(plans.shape[1]):
            wanted = inputs + np.clip(plans[:, step] - inputs, -self.rate, self.rate)
            q, stable, tip = advance(self.nominal, q, inputs, wanted, load)
            inputs, fine = wanted, fine & stable
        return np.where(fine, np.hypot(*(tip - observed.target).T), np.inf)
