"""Sampling model-predictive control: the environment itself, with what is believed of an episode, is the model.

In every step the cross-entropy method [Rubinstein1999], with correlated noise and the elites of the step before as
[Pinneri2020], looks for the actions a_1 ... a_H that minimize

    J = sum_k c(x_k) + tail c(x_H),    c(x) = -r(x) + edge max(0, clearance - stability margin(x)) / clearance,

r being the environment's own reward for a step, from which a state that failed gets `failed` in every step. `samples`
sequences are drawn around a mean with a deviation, the best `elites` of them, which are kept, give the next mean and
deviation, `rounds` times; the first action of the best one is taken, and the others are where the next step begins.
Among the first samples are straight ways to inputs that hold solutions of the target (`Beliefs.goals`). Noise has an
autocorrelation of `colour` from step to step, and begins with a deviation in proportion to the way that is left,
between `fine` and `coarse`.

The model is the native environment on batches (`tensegrity_envs.batch`), nominal but for what an observer believes of
the episode (`Beliefs`); it holds no number that was drawn for the true one. Its state is that of a simulation that has
gone through the measured inputs since the episode began; where it fails and the arm does not, it begins again where the
arm is believed to be. The actions that are still on the way (`delay_line`) are taken first. Offset-free tracking
[Maeder2009]: what the measured tip differs from the model's is filtered,

    b <- b + `follow` (tip - model tip - b),

and the model's target is the target less b.

[Rubinstein1999] Rubinstein, "The cross-entropy method for combinatorial and continuous optimization", Methodology and
Computing in Applied Probability 1, 1999. [Pinneri2020] Pinneri et al., "Sample-efficient cross-entropy method for
real-time planning", CoRL 2020. [Maeder2009] Maeder, Borrelli, Morari, "Linear offset-free model predictive control",
Automatica 45, 2009.
"""

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np

from tensegrity_agents.controllers.base import AnalyticController, rows_where
from tensegrity_agents.controllers.believed_plant import FACTORS
from tensegrity_agents.controllers.delay_line import Line, delays_of, first_line, seen, sent
from tensegrity_envs.core import Core, Sampled
from tensegrity_envs.observation import DecodedObservation
from tensegrity_envs.simulation.protocol import RUNNING, Episode

_FAR = 0.1  # of the reach: a way from which samples are as wide as they may be


class Beliefs(Protocol):
    """What a mechanism's observer believes of n episodes, as a memory that it gets back."""

    def first(self, observed: DecodedObservation) -> Any:
        """When they begin."""
        ...

    def updated(self, belief: Any, observed: DecodedObservation) -> Any:
        """After a step."""
        ...

    def told(self, belief: Any) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Configurations (n, joints) [rad], and what `Core.episode_with_goal` asks for, but for what is nominal."""
        ...

    def goals(self, belief: Any, episode: Episode) -> np.ndarray:
        """Inputs that might hold the arms on target, (goals, n, inputs); numbers that are not finite where none do."""
        ...


class MPCMemory(NamedTuple):
    """What is carried from step to step, for n environments.

    Attributes:
        belief: of the observer.
        model: states of the model, shape (n, state size).
        bias: b of the module, shape (n, axes) [m].
        actions: the best ones of the step before, shifted, shape (n, horizon, action size).
        line: what is on the way.
        step: of the episode, shape (n,).
    """

    belief: Any
    model: np.ndarray
    bias: np.ndarray
    actions: np.ndarray
    line: Line
    step: np.ndarray


class MPC(AnalyticController[MPCMemory]):
    """See the module.

    Args:
        core: of the environment, quasi-static, with inputs that are observed.
        beliefs: makes the mechanism's observer for a core.
    """

    knows = "the nominal design and ranges; believes what an observer identifies; plans by sampling in that model"
    is_told_ranges = True
    samples, elites, rounds, horizon = 128, 8, 2, 10
    colour, coarse, fine = 0.7, 0.6, 0.03
    tail, failed = 10.0, 3.0
    edge, clearance = 1.0, 0.1
    follow = 0.2
    tunable: ClassVar[dict[str, tuple[float, ...]]] = {
        "horizon": (6, 10),
        "follow": (0.1, 0.2),
        "clearance": (0.1, 0.2),
    }

    def __init__(self, core: Core, beliefs: Callable[[Core], Beliefs]) -> None:
        super().__init__(core)
        self.beliefs = beliefs(core)
        self.delays = delays_of(core)
        self.low, self.high = self.input_bounds()
        self.seed = 0  # of the samples, the same in every step

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> MPCMemory:
        """See `AnalyticController.initial`."""
        n, size = len(index), self.core.simulation.action_size
        belief = self.beliefs.first(observed)
        model = self._begun(belief, observed.inputs, observed.target)
        line = first_line(observed.inputs, self.delays)
        actions, bias = np.zeros((n, self.horizon, size)), np.zeros_like(observed.target)
        return MPCMemory(belief, model, bias, actions, line, np.zeros(n, int))

    # ------------------------------------------------------------------------------------------------------ the model

    def _episodes(self, belief: Any, target: np.ndarray) -> np.ndarray:
        """The matrix of episodes that are believed in, with these targets (n, axes)."""
        core, n = self.core, len(target)
        random = {name: np.zeros(n) for name in core.episodes.rows.random}
        random |= {name: np.ones(n) for name in FACTORS if name in random}
        told = self.beliefs.told(belief)[1]
        info = {f"random_{name}": value for name, value in random.items()} | told
        random |= {name: told[f"random_{name}"] for name in random if f"random_{name}" in told}
        goal = tuple(np.clip(target, -core.reach, core.reach).T)
        return core.episodes.pack(core.episode_with_goal(info, goal)._replace(random=random), n)

    def _begun(self, belief: Any, inputs: np.ndarray, target: np.ndarray) -> np.ndarray:
        """States (n, size) of models at rest under these inputs, near where they are believed to be."""
        core: Any = self.core
        believed = self._episodes(belief, target)
        episodes = core.episodes.unpack(believed)
        arm, rows = core.mechanism(episodes.design), core.states.rows
        q = tuple(np.ascontiguousarray(self.beliefs.told(belief)[0].T))
        columns = tuple(np.ascontiguousarray(inputs.T))
        rest = arm.equilibrium(core.simulation.actuation(arm, columns), q, episodes.load)
        found = [np.where(np.asarray(rest.is_stable), a, b) for a, b in zip(rest.configuration, q, strict=True)]
        takes = core.sample(np.zeros(1, np.int64), np.zeros(1, np.int64)).inputs is not None
        _, outcomes = core.begin_sampled(Sampled(episodes, tuple(found), columns if takes else None))
        outcomes = np.array(outcomes)
        outcomes[list(rows.inputs)], outcomes[list(rows.configuration)] = inputs.T, found
        states = core.moved(believed, outcomes, np.zeros((core.simulation.action_size, len(inputs))))
        return np.asarray(states[: core.states.size].T)

    def _followed(self, observed: DecodedObservation, memory: MPCMemory, episodes: np.ndarray) -> np.ndarray:
        """States of the models after a step in which the inputs became what is measured."""
        core = self.core
        rows = core.states.rows
        states = np.ascontiguousarray(memory.model.T)
        actions = (observed.inputs.T - states[list(rows.inputs)]) / self.rate
        outcomes = core.moved(episodes, states, np.clip(actions, -1.0, 1.0))
        lost = outcomes[rows.failure] != RUNNING
        if lost.any():  # the true arm has not buckled: start again where it is believed to be
            fresh = self._begun(memory.belief, observed.inputs, observed.target).T
            outcomes[: core.states.size, lost] = fresh[:, lost]
        return np.asarray(outcomes[: core.states.size].T)

    def _tips(self, model: np.ndarray) -> np.ndarray:
        return model[:, list(self.core.states.rows.tip)]

    # ------------------------------------------------------------------------------------------------------- actions

    def _act(self, observed: DecodedObservation, memory: MPCMemory) -> tuple[np.ndarray, MPCMemory]:
        core = self.core
        first = memory.step == 0
        line = seen(memory.line, observed.inputs, self.rate, self.low, self.high)
        belief, model = memory.belief, memory.model
        if not first.all():
            belief = rows_where(first, belief, self.beliefs.updated(belief, observed))
            memory = memory._replace(belief=belief)
            model = rows_where(first, model, self._followed(observed, memory, self._episodes(belief, observed.target)))
        off = observed.tip - self._tips(model)
        bias = np.where(first[:, None], 0.0, memory.bias + self.follow * (off - memory.bias))
        target = observed.target - bias
        episodes = self._episodes(belief, target)
        there = self._after_delay(episodes, model, line)
        away = np.linalg.norm(target - self._tips(there), axis=1)
        goals = self.beliefs.goals(belief, core.episodes.unpack(episodes))
        best = self._planned(episodes, there, np.concatenate([memory.actions[None], self._ramps(there, goals)]), away)
        action = np.clip(best[:, 0], -1.0, 1.0)
        shifted = np.concatenate([best[:, 1:], 0 * best[:, :1]], axis=1)
        line = sent(line, observed.inputs, action)
        return action, MPCMemory(belief, model, bias, shifted, line, memory.step + 1)

    def _after_delay(self, episodes: np.ndarray, model: np.ndarray, line: Line) -> np.ndarray:
        """States of the models when an action that is given now is taken."""
        core, delay, model = self.core, line.delay, model.copy()
        for j in range(int(delay.max(initial=0))):
            rows = np.flatnonzero(delay > j)
            actions = line.actions[rows, delay[rows] - 1 - j]
            outcomes = core.moved(
                episodes[:, rows], np.ascontiguousarray(model[rows].T), np.ascontiguousarray(actions.T)
            )
            model[rows] = outcomes[: core.states.size].T
        return model

    def _ramps(self, model: np.ndarray, goals: np.ndarray) -> np.ndarray:
        """Actions that go straight to these inputs, (goals, n, horizon, action size)."""
        inputs, rows = model[:, list(self.core.states.rows.inputs)], np.isfinite(goals).all(axis=2)
        way = np.where(rows[..., None], goals - inputs, 0.0) / self.rate
        steps = np.maximum(np.abs(way).max(axis=2), 1e-9)[:, :, None, None]
        done = np.minimum(np.arange(self.horizon + 1)[:, None] / np.maximum(steps, 1.0), 1.0)
        return np.asarray(np.diff(done, axis=2) * way[:, :, None])

    def _planned(self, episodes: np.ndarray, model: np.ndarray, known: np.ndarray, away: np.ndarray) -> np.ndarray:
        """The best sequences, (n, horizon, action size); `known` ones (k, n, ...) are among the samples."""
        _, n, horizon, size = known.shape
        rng = np.random.default_rng(self.seed)
        spread = np.clip(away / (_FAR * self.core.reach), self.fine, self.coarse)
        deviation = spread[:, None, None] * np.ones_like(known[0])
        many = np.ascontiguousarray(np.repeat(episodes, self.samples, axis=1))
        starts = np.ascontiguousarray(np.repeat(model.T, self.samples, axis=1))
        # Samples about the best of what is known, which is nothing new where a plan goes on.
        kept = np.concatenate([known, np.zeros_like(known[:1])]).transpose(1, 0, 2, 3)
        cost = self._costs(np.repeat(episodes, kept.shape[1], axis=1), np.repeat(model.T, kept.shape[1], axis=1), kept)
        mean = best = kept[np.arange(n), cost.argmin(axis=1)]
        for _ in range(self.rounds):
            noise = rng.normal(size=(self.samples, horizon, size))
            for k in range(1, horizon):
                noise[:, k] = self.colour * noise[:, k - 1] + np.sqrt(1 - self.colour**2) * noise[:, k]
            drawn = np.clip(mean[:, None] + deviation[:, None] * noise, -1.0, 1.0)
            drawn[:, : kept.shape[1]] = kept
            cost = self._costs(many, starts, drawn)
            elite = np.argsort(cost, axis=1, kind="stable")[:, : self.elites]
            kept = np.take_along_axis(drawn, elite[:, :, None, None], axis=1)
            mean, deviation, best = kept.mean(axis=1), kept.std(axis=1), kept[:, 0]
        return np.asarray(best)

    def _costs(self, episodes: np.ndarray, states: np.ndarray, drawn: np.ndarray) -> np.ndarray:
        """J of the sequences (n, samples, horizon, action size), (n, samples)."""
        core = self.core
        n, samples, horizon, _ = drawn.shape
        total, lost = np.zeros(n * samples), np.zeros(n * samples, bool)
        rows = core.outcomes.rows
        for k in range(horizon):
            actions = np.ascontiguousarray(drawn[:, :, k].reshape(n * samples, -1).T)
            outcomes = core.moved(episodes, states, actions)
            states = outcomes
            lost |= outcomes[rows.state.failure] != RUNNING
            short = np.maximum(0.0, self.clearance - outcomes[rows.state.stability_margin]) / self.clearance
            cost = np.where(lost, self.failed, self.edge * short - outcomes[rows.reward])
            total += cost * (1.0 + self.tail * (k == horizon - 1))
        return total.reshape(n, samples)
