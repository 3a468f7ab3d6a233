"""The dual-triangle arm, told everything: what a controller could do that lacks nothing but time.

It is told the drawn stiffness and the load, and with them the true state without noise: an arm at rest is where its own
inputs and its load put it, and the inputs are seen exactly. The delay is known, and there is nothing to be done about
it but to send the same inputs: it follows its own command, which a delay only moves to later steps.
"""

from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import AnalyticController, rows_of
from tensegrity_agents.controllers.dual_triangle.identification import explain
from tensegrity_agents.controllers.dual_triangle.reach import Memory, Oracle
from tensegrity_envs.core import Core
from tensegrity_envs.mechanics.dual_triangle import DualTriangleDesign
from tensegrity_envs.observation import DecodedObservation


class InformedMemory(NamedTuple):
    """What is carried from step to step: the oracle's memory, and the command, shape (n, 3) [m]."""

    plan: Memory
    inputs: np.ndarray


class Informed(AnalyticController[InformedMemory]):
    """Plans in the true model and follows its own command. See the module.

    Args:
        core: of the environment.
    """

    wants_privileged = True
    knows = "everything that was drawn, the delay included, and the true state; plans in the true model"

    def __init__(self, core: Core) -> None:
        super().__init__(core)
        self.planner = Oracle(core)

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> InformedMemory:
        """See `AnalyticController.initial`."""
        plans = [self._plan(observed.take(np.array([k])), np.array([i])) for k, i in enumerate(index)]
        plan = Memory(*(np.concatenate(parts) for parts in zip(*plans, strict=True)))
        return InformedMemory(plan, observed.inputs)

    def _plan(self, observed: DecodedObservation, index: np.ndarray) -> Memory:
        """The oracle's memory in one environment: it plans with one design at a time."""
        own = rows_of(self.truth, index)
        design = _of_one(own.design)
        arm, load = self.core.mechanism(design), tuple(np.reshape(force, 1) for force in own.load)
        self.planner.begin_episodes(np.ones(1, bool), design, own)
        lengths = arm.free_lengths(tuple(observed.inputs.T))
        seen = explain(arm, observed.tip, np.stack(lengths, axis=1)).configuration
        q = np.stack(arm.equilibrium(lengths, tuple(seen.T), load).configuration, axis=1)
        return self.planner.initial(observed.replace(tip=np.stack(arm.tip(tuple(q.T)), axis=1)), np.zeros(1, int))

    def _act(self, observed: DecodedObservation, memory: InformedMemory) -> tuple[np.ndarray, InformedMemory]:
        action, plan = self.planner.act(observed.replace(inputs=memory.inputs), memory.plan)
        low, high = self.input_bounds()
        return action, InformedMemory(plan, np.clip(memory.inputs + self.rate * action, low, high))


def _of_one(design: DualTriangleDesign) -> DualTriangleDesign:
    """The design of a batch of one, with numbers for arrays."""
    values = {field.name: getattr(design, field.name) for field in fields(design)}
    numbers: dict[str, Any] = {name: float(v[0]) for name, v in values.items() if isinstance(v, np.ndarray)}
    return replace(design, **numbers)
