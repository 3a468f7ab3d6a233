"""The analytic controllers of the spatial prism in dynamics: at full speed or shaped, damped or not.

All plan lengths; `Damping` then adds small deviations that calm the platform.
"""

from typing import Any

import numpy as np

from tensegrity_agents.controllers.base import beginning, renewed
from tensegrity_agents.controllers.dynamic import ADDS, Pace
from tensegrity_agents.controllers.fixed_length_damping import Damping
from tensegrity_agents.controllers.spatial_prism.modes import PrismModes
from tensegrity_agents.controllers.spatial_prism.reading import read
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation


class PrismWay:
    """A quasi-static controller of the spatial prism that follows the curve, shaped or not, damped or not.

    Args:
        core: of the environment.
        base: makes the quasi-static controller.
        pace: "full", or "shaped": a quarter each of the goals now and in two steps, half of the one in a step. The
            curve is known ahead, so that shaping does not delay.
        damped: whether deviations calm the platform.
    """

    def __init__(self, core: Core, base: Any, pace: Pace = "full", damped: bool = True) -> None:
        self.core, self.base, self.pace, self.is_damped = core, base(core), pace, damped
        self.knows = f"{self.base.knows}; {ADDS[pace]}{', active damping' if damped else ''}"
        self.wants_privileged = getattr(self.base, "wants_privileged", False)
        simulation: Any = core.simulation
        self.rate = float(simulation.rate)
        self.low, self.high = simulation.bounds(core.nominal)
        self.damper = Damping(core, PrismModes(core))

    def begin_episodes(self, mask: np.ndarray, design: Any, privileged: Any = None) -> None:
        """Hand over what the quasi-static controller asks for."""
        self.base.begin_episodes(mask, design, privileged)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Actions (n, 3) for a batch of n observations."""
        observed = read(observation, self.core)
        n = len(observed.tip)
        fresh = beginning(n, state, episode_start)
        damping, step = (None, np.zeros(n, int)) if state is None else state
        damping, step = renewed(fresh, self.damper.begin(observed.lengths), damping), np.where(fresh, 0, step)
        commanded = planned = self.planned(observed, step, damping.lengths)
        if self.is_damped:
            commanded, damping = self.damper.act(observed, observed.lengths, planned, damping)
        else:
            damping = damping._replace(lengths=planned)
        action = np.clip((np.clip(commanded, self.low, self.high) - observed.lengths) / self.rate, -1.0, 1.0)
        return action, (damping, step + 1)

    def planned(self, observed: DecodedObservation, step: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Lengths after this step, shape (n, 3) [m]; `before` those planned a step ago."""
        if self.pace == "full":
            return np.asarray(self.base._lengths(observed, step))
        later = observed.tip + observed.goal_in_2
        goals = ((0.25, observed.target), (0.5, observed.next_goal), (0.25, later))
        return np.asarray(sum(w * self.base._lengths(observed.replace(next_goal=goal), step) for w, goal in goals))


class PrismFeedback(PrismWay):
    """Resolved rate: the goal's own step, and a share of the way from the measured position to the goal."""

    slowed = 0.15

    def __init__(self, core: Core, base: Any, damped: bool = True) -> None:
        super().__init__(core, base, "full", damped)
        self.knows = f"{self.base.knows}; slowed down{', active damping' if damped else ''}"

    def planned(self, observed: DecodedObservation, step: np.ndarray, before: np.ndarray) -> np.ndarray:
        """See `PrismWay.planned`."""
        way = observed.next_goal - observed.target + self.slowed * (observed.target - observed.tip)
        return np.asarray(self.base._lengths(observed.replace(lengths=before, next_goal=observed.tip + way), step))
