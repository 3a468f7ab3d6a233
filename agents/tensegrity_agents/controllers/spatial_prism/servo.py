"""Controllers that follow a curve with a prism that is not quite the nominal one, behind a delay, seen through noise.

The inputs that act are measured without noise, so the delay d is found from what has become of earlier actions
(`delay_line`). An action that is given in step t then moves the platform in step t + d, and what counts is where the
goal is afterwards:

    u* = lengths(goal(t + d + 1)),    a = clip((u* - u) / rate),    u <- clip(u + rate a),

u being the controller's own command, not the measured lengths, which are those of d steps ago. The goal is observed
1, 2, 5 and 10 steps ahead; what was seen earlier fills the steps between (`with_seen_goals`).

The servo takes lengths(g) = the closed form without a load at g - b, b being a running mean of how far the measured tip
is from where the measured lengths would put a prism without a load:

    b <- b + gain * (tip - tip_0(l) - b).

The identifying observer knows that this comes from one number, the weight W that acts from an unknown step o on, and
that the tip yields to it linearly, tip - tip_0(l) = h(l) W + noise. A weight that is divided by the stiffness factor
does the same, so that a wrong stiffness is told as another weight. With the noise's standard deviation s, the sums from
step o on

    a_o = sum h . (tip - tip_0) / s^2,    b_o = sum h . h / s^2,

and a Gaussian of the range's mean m and variance v in the place of the documented range of W, the posterior of W given
o and the evidence of o, relative to that of no weight so far, are

    E[W | o] = (a_o + m / v) / (b_o + 1 / v),
    log L_o = (a_o + m / v)^2 / (2 (b_o + 1 / v)) - m^2 / (2 v) - log(1 + v b_o) / 2.

Steps o are equally likely in their documented range; those that are still to come have L_o = 1 and no weight. The mean
of W over all o goes into the loaded inverse kinematics: lengths(g) = `SpatialPrism.held` under it.

An agent may correct either (`Correctable`): u goes on from what was done to the lengths that are due, so that nothing
of what is added stays.
"""

from abc import abstractmethod
from typing import ClassVar, NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import Observation
from tensegrity_agents.controllers.correctable import Correctable
from tensegrity_agents.controllers.delay_line import Line, delays_of, first_line, seen, sent, sent_instead
from tensegrity_agents.controllers.spatial_prism.identification import resting
from tensegrity_agents.controllers.spatial_prism.measurements import decoded
from tensegrity_agents.controllers.spatial_prism.track import held
from tensegrity_envs.core import Core
from tensegrity_envs.environments.spatial_prism.sampling import GRAVITY, ONSETS
from tensegrity_envs.environments.spatial_prism.track import AHEAD, SpatialPrismTrack
from tensegrity_envs.mechanics.spatial_prism import SpatialPrism
from tensegrity_envs.observation import DecodedObservation

_LEAST_NOISE = 1e-4  # [m]: the tip yields to a weight not quite linearly
_FARTHEST = AHEAD[-1]
_FAR, _LATE = 3.0, 3.0  # steps of the rate, and of a delay, that are shown as 1


class ServoMemory(NamedTuple):
    """What is carried from step to step, for n environments.

    Attributes:
        step: of the episode, (n,).
        goals: of this step and the ten that follow, (n, 11, 3) [m].
        inputs: the command u, (n, 3) [m].
        line: what is on the way.
        offset: b, (n, 3) [m].
        sums: a and b of all steps so far, (n, 2).
        before: the same of all steps before each step o in which the weight may come, (n, steps, 2).
    """

    step: np.ndarray
    goals: np.ndarray
    inputs: np.ndarray
    line: Line
    offset: np.ndarray
    sums: np.ndarray
    before: np.ndarray


def first_goals(observed: DecodedObservation) -> np.ndarray:
    """Goals of the first step and the ten that follow, (n, 11, 3) [m]; on straight lines between the seen ones."""
    places = (0, *AHEAD)
    share = np.stack([np.interp(np.arange(_FARTHEST + 1), places, row) for row in np.eye(len(places))], axis=1)
    return np.asarray(np.einsum("tk,nki->nti", share, _seen_goals(observed)))


def with_seen_goals(goals: np.ndarray, observed: DecodedObservation) -> np.ndarray:
    """The goals a step later: those known before, and those that are seen now, exactly."""
    moved = np.concatenate([goals[:, 1:], goals[:, -1:]], axis=1)
    moved[:, [0, *AHEAD]] = _seen_goals(observed)
    return moved


def _seen_goals(observed: DecodedObservation) -> np.ndarray:
    """Goals now and 1, 2, 5 and 10 steps ahead, (n, 5, 3) [m]; the observed ways begin at the measured tip."""
    ways = [observed.tip + getattr(observed, f"goal_in_{steps}") for steps in AHEAD]
    return np.stack([observed.target, *ways], axis=1)


class Ahead(Correctable[ServoMemory]):
    """Sends the lengths for the goal of the step in which they will act; subclasses say which those are.

    Args:
        core: of the environment.
    """

    nominal: SpatialPrism
    onsets = np.zeros(0, int)  # steps in which the weight may come, of who asks for that

    def __init__(self, core: Core) -> None:
        super().__init__(core)
        self.delays = delays_of(core) if self.is_told_ranges else (0, 0)
        self.low, self.high = self.input_bounds()

    def decode(self, observation: Observation) -> DecodedObservation:
        """See `AnalyticController.decode`."""
        return decoded(observation, self.core)

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> ServoMemory:
        """See `AnalyticController.initial`."""
        n = len(index)
        return ServoMemory(
            np.zeros(n, int),
            first_goals(observed),
            observed.lengths,
            first_line(observed.lengths, self.delays),
            np.zeros((n, 3)),
            np.zeros((n, 2)),
            np.zeros((n, len(self.onsets), 2)),
        )

    def _act(self, observed: DecodedObservation, memory: ServoMemory) -> tuple[np.ndarray, ServoMemory]:
        line, goals = memory.line, memory.goals
        later = np.flatnonzero(memory.step > 0)
        if len(later):
            goals = goals.copy()
            goals[later] = with_seen_goals(memory.goals[later], observed.take(later))
        line = seen(line, observed.lengths, self.rate, self.low, self.high)
        memory = self._measured(observed, memory._replace(line=line, goals=goals))
        ahead = np.minimum(self._delay(memory) + 1, _FARTHEST)
        wanted = self._lengths(goals[np.arange(len(ahead)), ahead], memory.step + ahead, memory)
        action = np.clip((wanted - memory.inputs) / self.rate, -1.0, 1.0)
        line, inputs = sent(line, observed.lengths, action), self._driven(memory.inputs, action)
        return action, memory._replace(step=memory.step + 1, inputs=inputs, line=line)

    def _driven(self, inputs: np.ndarray, action: np.ndarray) -> np.ndarray:
        """The command after an action."""
        return np.asarray(np.clip(inputs + self.rate * action, self.low, self.high))

    def given(self, before: ServoMemory, after: ServoMemory, action: np.ndarray) -> ServoMemory:
        """See `Correctable.given`."""
        return after._replace(inputs=self._driven(before.inputs, action), line=sent_instead(after.line, action))

    @property
    def outlook_size(self) -> int:
        """See `Correctable.outlook_size`."""
        return 5

    def outlook(self, observed: DecodedObservation, memory: ServoMemory) -> np.ndarray:
        """See `Correctable.outlook`: how far the command is from the measured lengths, the delay that is believed in,
        and what is believed of the load.
        """
        way = (memory.inputs - observed.lengths) / (_FAR * self.rate)
        return np.concatenate([way, self._delay(memory)[:, None] / _LATE, self._load(memory)[:, None]], axis=1)

    def _delay(self, memory: ServoMemory) -> np.ndarray:
        """Believed delay [steps], (n,)."""
        return memory.line.delay

    def _measured(self, observed: DecodedObservation, memory: ServoMemory) -> ServoMemory:
        """What is believed after a measurement; here always the same."""
        return memory

    def _load(self, memory: ServoMemory) -> np.ndarray:
        """What is believed of the load, as a number of about 1, (n,); here nothing."""
        return np.zeros(len(memory.step))

    @abstractmethod
    def _lengths(self, goal: np.ndarray, time: np.ndarray, memory: ServoMemory) -> np.ndarray:
        """Lengths of the struts (n, 3) [m] for goals (n, 3) [m] of so many steps after the beginning."""


class Servo(Ahead):
    """The closed form ahead by the delay, and a running mean of what it is off. See the module."""

    knows = (
        "the nominal design and the range of the delay, which it identifies; its own commands; running mean of how far "
        "the tip is off"
    )
    is_told_ranges = True
    gain = 0.03
    tunable: ClassVar[dict[str, tuple[float, ...]]] = {"gain": (0.02, 0.03, 0.05, 0.1)}

    def _measured(self, observed: DecodedObservation, memory: ServoMemory) -> ServoMemory:
        off = observed.tip - np.stack(self.nominal.forward_kinematics(tuple(observed.lengths.T)), axis=1)
        return memory._replace(offset=memory.offset + self.gain * (off - memory.offset))

    def _load(self, memory: ServoMemory) -> np.ndarray:
        return np.asarray(memory.offset[:, 2] / self.core.task.tolerance)

    def _lengths(self, goal: np.ndarray, time: np.ndarray, memory: ServoMemory) -> np.ndarray:
        return np.stack(self.nominal.unloaded_lengths(tuple((goal - memory.offset).T)), axis=1)


class IdentifyingObserver(Ahead):
    """The loaded inverse kinematics ahead by the delay, under the weight that is believed in. See the module."""

    knows = (
        "the nominal design and the ranges of payload, stiffness, noise and onset; identifies the delay, and the "
        "payload and its onset by Bayes's rule"
    )
    is_told_ranges = True

    def __init__(self, core: Core) -> None:
        super().__init__(core)
        assert isinstance(core, SpatialPrismTrack)
        drawn = core.randomization
        low, high = drawn.stiffness or (1.0, 1.0)
        lightest, heaviest = core.sampler.payload_range
        self.range = GRAVITY * lightest / high, GRAVITY * heaviest / low
        self.noise = max(drawn.tip_noise, _LEAST_NOISE)
        self.onsets = np.arange(int(core.cycle * ONSETS[0]), int(np.ceil(core.cycle * ONSETS[1])))

    def _measured(self, observed: DecodedObservation, memory: ServoMemory) -> ServoMemory:
        lengths, heaviest = observed.lengths, np.full(len(observed), self.range[1])
        free = resting(self.nominal, lengths, 0.0 * heaviest)
        yields = (resting(self.nominal, lengths, heaviest) - free) / self.range[1]
        products = [(yields * (observed.tip - free)).sum(axis=1), (yields * yields).sum(axis=1)]
        before, place = memory.before.copy(), memory.step - self.onsets[0]
        now = np.flatnonzero((place >= 0) & (place < len(self.onsets)))
        before[now, place[now]] = memory.sums[now]
        return memory._replace(sums=memory.sums + np.stack(products, axis=1) / self.noise**2, before=before)

    def weight(self, memory: ServoMemory) -> np.ndarray:
        """The weight that is believed in, (n,) [N]: 0 before it may have come."""
        mean, variance = np.mean(self.range), (self.range[1] - self.range[0]) ** 2 / 12
        a, b = np.moveaxis(memory.sums[:, None] - memory.before, 2, 0)
        come = self.onsets <= memory.step[:, None] - 1
        known = np.where(come, b, 0.0) + 1 / variance
        pull = np.where(come, a, 0.0) + mean / variance
        evidence = pull**2 / (2 * known) - mean**2 / (2 * variance) - np.log(variance * known) / 2
        likely = np.exp(evidence - evidence.max(axis=1, keepdims=True))
        weights = np.where(come, np.clip(pull / known, *self.range), 0.0)
        return np.asarray((likely * weights).sum(axis=1) / likely.sum(axis=1))

    def _load(self, memory: ServoMemory) -> np.ndarray:
        return self.weight(memory) / self.range[1]

    def _lengths(self, goal: np.ndarray, time: np.ndarray, memory: ServoMemory) -> np.ndarray:
        return held(self.nominal, goal, self.weight(memory))
