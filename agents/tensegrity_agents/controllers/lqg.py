"""LQG: a linear-quadratic regulator on the state that a Kalman filter believes in, behind a delay.

A quasi-static controller plans the inputs at full speed when an episode begins. Where the nominal arm would rest under
them is the path Q of the joints; a moving average over `smoothing` steps takes the corners off, and where the arm does
not begin where the nominal one would, the difference fades away in 25 steps, within the joint limits. In every step k

1. the filter (`kalman`) turns measurements with noise into angles, rates and the parameters in which this arm differs
   from the nominal one; `delay_line` finds the delay d from what has become of earlier actions;
2. the believed simulation runs ahead through the d actions that are still on the way, to where the action of this
   moment will be taken. For a known delay that is the optimal regulator of the state augmented by these actions;
3. the torques of the path, inverse dynamics of the believed arm with what the actuators' lag costs,

       t_k = M Q''_k + g_0(Q_k),    c_k = t_(k+1) + l / (1 - l) (t_(k+1) - t_k),

   g_0 being the energy gradient without inputs (less J^T times a hidden load), and the regulator of
   `torque_regulator`, whose gain follows the way at every third step, give the commanded torque c_k + dc - G z, which
   is allocated to the inputs;
4. integral action: from `wait` steps after the end of the plan on, while the arm hardly moves, the path is moved by
   J^T (J J^T + 0.1^2)^-1 times `integral` times the error of the believed tip.

Without noise and uncertainty the measured state is the belief.
"""

from typing import ClassVar, NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import jacobian_at, rows_where
from tensegrity_agents.controllers.believed_plant import BelievedPlant
from tensegrity_agents.controllers.delay_line import Line, delays_of, first_line, seen, sent
from tensegrity_agents.controllers.dynamic import Base
from tensegrity_agents.controllers.kalman import ArmFilter, Belief
from tensegrity_agents.controllers.regulated import FullSpeed
from tensegrity_agents.controllers.resting import ends_of_plans
from tensegrity_agents.controllers.torque_regulator import allocated, effect_of, gain_of, torque_motion
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation
from tensegrity_envs.simulation.mujoco.linearizing import linearize

KNOWS = (
    "the nominal design and the documented ranges; LQG along the path: {} identified by a Kalman filter, delay by "
    "what became of actions"
)
_EVERY = 3  # steps of the path that have one gain
_FADES = 25  # steps
_STILL = 1e-6  # [rad]
_DAMPING = 0.1  # [m/rad] of the integral action
_NEAR = 0.05  # [m]: errors that are to be integrated
_SLOW = 0.2  # [rad/s]: an error of an arm that swings is not


class LQGMemory(NamedTuple):
    """What is carried from step to step, for n environments.

    Attributes:
        plan: inputs of the path, the start first, shape (n, steps, inputs).
        path: Q, likewise, shape (n, steps, joints) [rad].
        end: step from which on it rests, (n,).
        inertia: M at every third step of it, shape (n, steps / 3, joints, joints) [kg m2].
        gain: G there, shape (n, steps / 3, joints, size of z).
        shift: of the path by the integral action, shape (n, joints) [rad].
        belief: about the arms.
        line: what is on the way to them.
        step: of the episode, shape (n,).
        more: what a subclass remembers, arrays (n, ...).
    """

    plan: np.ndarray
    path: np.ndarray
    end: np.ndarray
    inertia: np.ndarray
    gain: np.ndarray
    shift: np.ndarray
    belief: Belief
    line: Line
    step: np.ndarray
    more: tuple[np.ndarray, ...] = ()


class LQG(FullSpeed[LQGMemory]):
    """See the module.

    Args:
        core: of the environment, joint angles and rates observed.
        base: makes the quasi-static controller that plans.
        softness: see `torque_regulator`.
        smoothing: steps of the moving average.
        integral: share of the tip error that is integrated in a step.
    """

    tunable: ClassVar[dict[str, tuple[float, ...]]] = {
        "softness": (0.2, 0.3, 1.0, 3.0, 10.0),
        "smoothing": (3, 5, 8, 10, 12, 16, 20),
    }
    is_told_ranges = True
    wait = 8  # steps
    look = 0  # first steps, in which the inputs are held

    def __init__(
        self, core: Core, base: Base, softness: float = 3.0, smoothing: int = 5, integral: float = 0.05
    ) -> None:
        super().__init__(core, base, "LQG")
        self.knows = KNOWS.format("angles and parameters")
        self.softness, self.smoothing, self.integral = softness, smoothing, integral
        self.plant = BelievedPlant(core)
        self.filter = ArmFilter(self.plant)
        self.time = self.model.dynamics.step_time
        self.follows = float(self.plant.follows(np.zeros((1, len(self.plant.names))))[0])
        self.delays = delays_of(core)

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> LQGMemory:
        """See `AnalyticController.initial`."""
        angles, inputs, n = observed.joint_angles, observed.inputs, len(index)
        plan = self._plan(observed, index)
        rest, here = self._rests(angles, plan), self._rests(angles, inputs[:, None])
        fades = np.maximum(1 - np.arange(1, plan.shape[1] + 1) / _FADES, 0.0)[:, None]
        limit = self.model.linkage.limit  # the difference may lead beyond it, where no arm goes
        path = self._averaged(angles, rest + fades * (angles[:, None] - here)).clip(-limit, limit)
        plan = self._averaged(inputs, plan)
        end = ends_of_plans(path, _STILL)
        inertia, gain = self._along(plan, path, end)
        belief, line = self.filter.first(observed), first_line(inputs, self.delays)
        return LQGMemory(plan, path, end, inertia, gain, 0 * angles, belief, line, np.zeros(n, int))

    def _averaged(self, start: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Moving average of what comes after each step (n, steps, m), the start (n, m) in front."""
        width = int(self.smoothing)
        before, after = np.repeat(start[:, None], width, axis=1), np.repeat(values[:, -1:], width, axis=1)
        total = np.cumsum(np.concatenate([0 * before[:, :1], before, values, after], axis=1), axis=1)
        return np.asarray((total[:, width:] - total[:, :-width]) / width)

    def _along(
        self, plan: np.ndarray, path: np.ndarray, end: np.ndarray, loads: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Inertia and gain along the path, under loads (n, 2) [N] if there are any; see `LQGMemory`."""
        inertia, gain = [], []
        for i, (inputs, angles, last) in enumerate(zip(plan, path, end, strict=True)):
            load = None if loads is None else loads[i]
            places = [min(k, path.shape[1] - 1) for k in range(0, int(last) + _EVERY, _EVERY)]
            masses = [self.model.mass_matrix(angles[k]) for k in places]
            gains = [self._gain_at(angles[k], inputs[k], mass, load) for k, mass in zip(places, masses, strict=True)]
            held = path.shape[1] // _EVERY + 2 - len(places)
            inertia.append(masses + held * masses[-1:])
            gain.append(gains + held * gains[-1:])
        return np.array(inertia), np.array(gain)

    def _gain_at(
        self, q: np.ndarray, inputs: np.ndarray, mass: np.ndarray, load: np.ndarray | None = None
    ) -> np.ndarray:
        """G about rest in q under these inputs and a load at the tip (2,) [N]."""
        actuation = self.plant.actuation(inputs[None])
        effect = effect_of(self.simulation, self.core.nominal, q[None], inputs[None], self.rate)[1][0]
        into = (self.plant.actuation(inputs - np.linalg.pinv(effect).T) - actuation).T
        motion = torque_motion(linearize(self.model, q, actuation[0], load), into, self.follows)
        forces = () if load is None else (tuple(load),)
        rows = self.core.nominal.stiffness_matrix(tuple(q[:, None]), tuple(actuation.T), *forces)
        stiffness = np.array([[np.ravel(value)[0] for value in row] for row in rows])
        return gain_of(motion, stiffness, mass, effect, self.rate, self.softness)

    def _act(self, observed: DecodedObservation, memory: LQGMemory) -> tuple[np.ndarray, LQGMemory]:
        line = seen(memory.line, observed.inputs, self.rate, float(self.low), float(self.high))
        belief = self._believing(observed, memory)
        memory = self._led(observed, memory._replace(belief=belief))
        there, inputs = self._ahead(belief, line, observed.inputs)
        shift = self._integrated(observed, belief, memory)
        wanted = self._regulated(there, inputs, memory._replace(shift=shift))
        action = np.clip((wanted - inputs) / self.rate, -1.0, 1.0)
        action[memory.step < self.look] = 0.0
        line = sent(line, observed.inputs, action)
        return action, memory._replace(line=line, shift=shift, step=memory.step + 1)

    def _led(self, observed: DecodedObservation, memory: LQGMemory) -> LQGMemory:
        """The memory, with another path where a subclass wants it."""
        return memory

    def _believing(self, observed: DecodedObservation, memory: LQGMemory) -> Belief:
        """What is believed after a step and its measurement; while the inputs are held, what the memory says."""
        first = memory.step <= self.look
        if first.all():
            return memory.belief
        belief = self.filter.measured(self.filter.moved(memory.belief, observed.inputs), observed)
        return rows_where(first, memory.belief, belief)

    def _ahead(self, belief: Belief, line: Line, inputs: np.ndarray) -> tuple[Belief, np.ndarray]:
        """What is believed of the moment when an action that is given now is taken, and the inputs of then."""
        size, delay = 2 * self.joints, line.delay
        mean, reached, inputs = belief.mean.copy(), belief.reached.copy(), inputs.copy()
        for j in range(int(delay.max(initial=0))):
            rows = np.flatnonzero(delay > j)
            here = Belief(mean[rows], belief.covariance, reached[rows], belief.lag)
            estimates = self.filter.estimates(here)
            given = inputs[rows] + self.rate * line.actions[rows, delay[rows] - 1 - j]
            inputs[rows] = np.clip(given, self.low, self.high)
            q, rates = mean[rows, : self.joints], mean[rows, self.joints : size]
            states = self.plant.states(q, rates, self.plant.actuation(reached[rows]))
            commands = self.plant.actuation(inputs[rows])
            models, load = self.plant.models(estimates), self.filter.load(here)
            mean[rows, :size] = self.plant.read(self.plant.moved(states, commands, models, load))
            reached[rows] += self.plant.follows(estimates)[:, None] * (inputs[rows] - reached[rows])
        return belief._replace(mean=mean, reached=reached), inputs

    def _integrated(self, observed: DecodedObservation, belief: Belief, memory: LQGMemory) -> np.ndarray:
        """The shift of the path by the integral action."""
        arm, q = self.core.nominal, tuple(belief.mean[:, : self.joints].T)
        error = observed.target - np.stack(arm.tip(q), axis=1)
        jacobian = jacobian_at(arm, q)
        square = jacobian @ jacobian.transpose(0, 2, 1) + _DAMPING**2 * np.eye(2)
        step = np.einsum("nij,nik,nk->nj", jacobian, np.linalg.inv(square), self.integral * error)
        slow = np.abs(belief.mean[:, self.joints : 2 * self.joints]).max(axis=1) < _SLOW
        rests = (memory.step > memory.end + self.wait) & slow & (np.hypot(*error.T) < _NEAR)
        return np.asarray(memory.shift + np.where(rests[:, None], step, 0.0))

    def _regulated(self, there: Belief, inputs: np.ndarray, memory: LQGMemory) -> np.ndarray:
        """The inputs that are commanded, within bounds and rate of those before."""
        joints, last = self.joints, memory.path.shape[1] - 1
        rows, k = np.arange(len(inputs)), np.minimum(memory.step, memory.path.shape[1] - 1)
        estimates = self.filter.estimates(there)
        arm, load = self.plant.mechanism(estimates), self.filter.load(there)

        def at(values: np.ndarray, place: np.ndarray) -> np.ndarray:
            return np.asarray(values[rows, np.clip(place, 0, last)])

        def torque(place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            """t of the path, and E."""
            q = at(memory.path, place)
            bend = (at(memory.path, place + 1) - 2 * q + at(memory.path, place - 1)) / self.time**2
            still, effect = effect_of(self.simulation, arm, q + memory.shift, at(memory.plan, place), self.rate)
            if load is not None:
                still = still - np.einsum("nij,ni->nj", jacobian_at(arm, tuple((q + memory.shift).T)), load)
            mass = memory.inertia[rows, np.clip(place, 0, last) // _EVERY]
            return still + np.einsum("nij,nj->ni", mass, bend), effect

        (before, _), (now, effect), (after, effect_after) = torque(k - 1), torque(k), torque(k + 1)
        share = self.plant.follows(estimates)[:, None]
        lead = (1 - share) / share
        speed = (at(memory.path, k + 1) - at(memory.path, k - 1)) / (2 * self.time)
        off = [there.mean[:, :joints] - at(memory.path, k) - memory.shift, there.mean[:, joints : 2 * joints] - speed]
        if self.model.dynamics.time_constant:
            off.append(-np.einsum("nij,nj->ni", effect, there.reached) - now)
        commanded = -np.einsum("nij,nj->ni", effect, inputs) - (now + lead * (now - before))
        gain = memory.gain[rows, k // _EVERY]
        change = -np.einsum("nij,nj->ni", gain, np.concatenate([*off, commanded], axis=1))
        wanted = after + lead * (after - now) + commanded + change
        low, high = np.maximum(self.low, inputs - self.rate), np.minimum(self.high, inputs + self.rate)
        return allocated(effect_after, -wanted, at(memory.plan, k + 1), low, high)
