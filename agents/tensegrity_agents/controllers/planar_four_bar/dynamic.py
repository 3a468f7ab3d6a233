"""The analytic controllers of the planar 4-bar mechanism in dynamics: at full speed, shaped, along ramps, damped.

All plan lengths; `Damping` then adds small deviations that calm the mechanism. Input shapers are those of Singer and
Seering ("Preshaping Command Inputs to Reduce System Vibration", 1990).
"""

from typing import Any, NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import beginning, renewed
from tensegrity_agents.controllers.dynamic import ADDS, Pace, Ramp
from tensegrity_agents.controllers.fixed_length_damping import Damping, DampingMemory
from tensegrity_agents.controllers.planar_four_bar.modes import FourBarModes
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation


class Laid(NamedTuple):
    """What a laid out way carries from step to step.

    Attributes:
        plan: lengths after each step, shape (n, steps, inputs) [m].
        step: of the episode, shape (n,).
        damping: see `DampingMemory`.
    """

    plan: np.ndarray
    step: np.ndarray
    damping: DampingMemory


class FourBarWay(Ramp):
    """The lengths that a quasi-static controller of the planar 4-bar would give, laid out when the episode begins.

    Args:
        core: of the environment.
        base: makes the quasi-static controller, which feeds nothing back.
        pace: at which they are followed: at full speed; the same through two zero-vibration-and-derivative shapers, for
            the modes where the way ends; or along a minimum-jerk time course of 60 steps at least.
        damped: whether deviations calm the mechanism.
    """

    def __init__(self, core: Core, base: Any, pace: Pace = "smooth", damped: bool = True) -> None:
        super().__init__(core, base)
        self.pace, self.is_damped = pace, damped
        self.knows = f"{self.base.knows}; {ADDS[pace]}{', active damping' if damped else ''}"
        self.modes = FourBarModes(core)
        self.damper = Damping(core, self.modes)

    def believed(self, observed: DecodedObservation, inputs: np.ndarray) -> np.ndarray:
        """Nothing that is needed."""
        return np.zeros_like(inputs)

    def predict(  # type: ignore[override]
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Laid]:
        """Actions (n, 2) for a batch of n observations."""
        observed = self.core.schema.decode(observation)
        n = len(observed)
        fresh = beginning(n, state, episode_start)
        plan: Any
        plan, step, damping = (None, np.zeros(n, int), None) if state is None else state
        damping = renewed(fresh, self.damper.begin(observed.inputs), damping)
        if fresh.any():
            index = np.flatnonzero(fresh)
            new = self._planned(observation, index)
            plan = np.zeros((n, *new.shape[1:])) if plan is None else plan.copy()
            plan[index], step = new, np.where(fresh, 0, step)
        wanted = plan[np.arange(n), np.minimum(step, plan.shape[1] - 1)]
        if self.is_damped:
            wanted, damping = self.damper.act(observed, observed.inputs, wanted, damping)
        action = np.clip((np.clip(wanted, self.low, self.high) - observed.inputs) / self.rate, -1.0, 1.0)
        return action, Laid(plan, step + 1, damping)

    def _planned(self, observation: Any, index: np.ndarray) -> np.ndarray:
        """Lengths after each step of the environments at `index`, shape (m, steps, 2) [m]."""
        plan = self._laid_out(observation, index)
        if self.pace != "shaped":
            return plan
        return self._shaped({key: np.asarray(value)[index] for key, value in observation.items()}, plan)

    def _smooth(self, path: np.ndarray) -> np.ndarray:
        return super()._smooth(path) if self.pace == "smooth" else path[:, 1:]

    def _shaped(self, observation: Any, plan: np.ndarray) -> np.ndarray:
        """The plan, a quarter of it now, half of it half a period later, a quarter a period later; for each mode."""
        n, length, _ = plan.shape
        observed = self.core.schema.decode(observation)
        _, _, branch = self.modes.read(observed, plan[:, -1])
        halves = self.damper.half_periods(plan[:, -1], branch)
        plan = np.concatenate([plan, np.repeat(plan[:, -1:], 50, axis=1)], axis=1)
        start = observed.inputs[:, None]
        for half in halves.T:
            moved = 0.25 * plan
            for share, delay in ((0.5, half), (0.25, 2 * half)):
                at = np.maximum(np.arange(length + 50) + 1 - delay[:, None], 0.0)  # 0: the start, k: the plan's k-th
                whole = np.concatenate([start, plan], axis=1)
                before = np.minimum(at.astype(int), length + 49)
                part = (at - before)[..., None]
                rows = np.arange(n)[:, None]
                moved = moved + share * ((1 - part) * whole[rows, before] + part * whole[rows, before + 1])
            plan = moved
        return plan


class FourBarFeedback(FourBarWay):
    """The pseudo-inverse controller of the planar 4-bar, slowed down not to drive the vibration, and damped."""

    slowed = 0.15

    def __init__(self, core: Core, base: Any, damped: bool = True) -> None:
        super().__init__(core, base, "full", damped)
        self.base.gain *= self.slowed
        self.base.patience = int(self.base.patience / self.slowed)
        self.knows = f"{self.base.knows}; slowed down{', active damping' if damped else ''}"

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Actions (n, 2) for a batch of n observations."""
        observed = self.core.schema.decode(observation)
        n = len(observed)
        fresh = beginning(n, state, episode_start)
        damping, base = (None, None) if state is None else state
        damping = renewed(fresh, self.damper.begin(observed.inputs), damping)
        inputs = damping.lengths
        imagined = self.core.schema.with_values(observation, "inputs", inputs)
        action, base = self.base.predict(imagined, base, fresh, deterministic=True)
        wanted = np.clip(inputs + self.rate * action, self.low, self.high)
        if self.is_damped:
            commanded, damping = self.damper.act(observed, observed.inputs, wanted, damping)
        else:
            commanded, damping = wanted, damping._replace(lengths=wanted)
        step = np.clip(commanded, self.low, self.high) - observed.inputs
        return np.clip(step / self.rate, -1.0, 1.0), (damping, base)
