"""The 2-X, told everything: what a controller could do that lacks nothing but time.

It is told the drawn parameters and, with them, the true state without noise: an arm at rest is where its own tensions
put it, and these are seen exactly. The delay is known, and there is nothing to be done about it but to send the same
inputs: as the servo, it follows its own command, which a delay only moves to later steps.
"""

from typing import NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import AnalyticController, rows_of
from tensegrity_agents.controllers.two_x.reach import CarefulOracle, Memory
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation


class InformedMemory(NamedTuple):
    """What is carried from step to step: the oracle's memory, and the command, shape (n, 4) [N]."""

    plan: Memory
    inputs: np.ndarray


class Informed(AnalyticController[InformedMemory]):
    """Plans in the true model and follows its own command. See the module.

    Args:
        core: of the environment, in cable control.
    """

    wants_privileged = True
    knows = "everything that was drawn, the delay included, and the true state; plans in the true model"

    def __init__(self, core: Core) -> None:
        super().__init__(core)
        self.planner = CarefulOracle(core)

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> InformedMemory:
        """See `AnalyticController.initial`."""
        design = rows_of(self.truth.design, index)
        arm, tensions = self.core.mechanism(design), observed.tensions
        everyone = np.ones(len(index), bool)
        self.planner.begin_episodes(everyone, design, rows_of(self.truth, index))
        seen = self.planner.configuration_of(observed, None)
        q = np.stack(arm.equilibrium(tuple(tensions.T), tuple(seen.T)).configuration, axis=1)
        true = {"tip": np.stack(arm.tip(tuple(q.T)), axis=1)}
        if "joint_angles" in observed:
            true["joint_angles"] = q
        plan = self.planner.initial(observed.replace(**true), np.arange(len(index)))
        return InformedMemory(plan, tensions)

    def _act(self, observed: DecodedObservation, memory: InformedMemory) -> tuple[np.ndarray, InformedMemory]:
        self.planner.begin_episodes(np.ones(len(observed), bool), self.truth.design, self.truth)
        action, plan = self.planner.follow(observed.replace(tensions=memory.inputs), memory.plan)
        action = np.clip(action, -1.0, 1.0)
        low, high = self.nominal.design.min_tension, self.nominal.design.max_tension
        return action, InformedMemory(plan, np.clip(memory.inputs + self.rate * action, low, high))
