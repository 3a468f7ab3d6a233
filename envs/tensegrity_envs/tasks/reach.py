"""Reach: bring the tip to a target and hold it there, staying stable and wrench-feasible.

The reward is a sum of terms, each between 0 and its weight, so that nothing still to come is ever negative: an episode
that ends early because stability or wrench feasibility was lost gives up everything that it could still have collected,
and failing early never pays.
"""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from tensegrity_envs.mechanics.namespace import Component, Components
from tensegrity_envs.simulation.protocol import RUNNING, State


@dataclass(frozen=True)
class RewardWeights:
    """Weights of the dense reward's terms, each zero or positive; a term scores between 0 and 1 before it is weighted.

    Attributes:
        distance: 1 / (1 + sqrt(tip error / tolerance)): 1 at the target, 1/2 at one tolerance from it, 1/11 at a
            hundred.
        potential: 1 in the nearest feasible configuration that puts the tip on the target, falling linearly with the
            joint distance to it. The reachable set has a hole and two sheets, so that walking straight towards the
            target runs into its boundary; this term knows the way round. It uses inverse solutions that the agent does
            not see.
        success: 1 while the tip is within tolerance.
        effort: 1 with all inputs at zero, 0 with every input at its scale (tensions: at their maximum).
        stability: rises with the stability margin, up to 1 at 0.2.
        wrench: rises with the wrench margin, up to 1 at 0.2.
    """

    distance: float = 0.3
    potential: float = 0.5
    success: float = 0.5
    effort: float = 0.05
    stability: float = 0.05
    wrench: float = 0.05

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            ValueError: a weight is negative or not finite.
        """
        for field in fields(self):
            value = getattr(self, field.name)
            scalar = np.isscalar(value)
            if not (scalar and np.isfinite(value) and value >= 0):
                raise ValueError(f"reward weight {field.name} = {value!r}: must be a finite number, zero or positive")


_FULL_MARGIN = 0.2


@dataclass(frozen=True)
class Reach:
    """Goal, success and reward of a reaching task.

    Attributes:
        input_scale: scale of the effort [N or m].
        joint_span: scale of the joint distance [rad].
        tolerance: the tip is on target within this distance [m].
        reward_type: "dense", or "sparse" (1 while on target, else 0).
        weights: of the dense reward.
    """

    input_scale: float
    joint_span: float
    tolerance: float = 0.005
    reward_type: str = "dense"
    weights: RewardWeights = RewardWeights()

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            ValueError: an unknown reward type, or a tolerance that is not positive.
        """
        if self.reward_type not in ("dense", "sparse"):
            raise ValueError(f"reward_type = {self.reward_type!r}: must be 'dense' or 'sparse'")
        if not (np.isfinite(self.tolerance) and self.tolerance > 0):
            raise ValueError(f"tolerance = {self.tolerance!r}: must be a positive length [m]")

    def is_success(self, error: Component, failure: Component) -> Component:
        """Whether the tip is within tolerance, in a stable and wrench-feasible state."""
        return (error <= self.tolerance) & (failure == RUNNING)

    def effort(self, state: State) -> Component:
        """Mean over the inputs of (input / scale)^2."""
        total: Component = 0.0
        for f in state.inputs:
            total = total + f * f
        return total / (len(state.inputs) * self.input_scale**2)

    def reward_terms(
        self, xp: Any, error: Component, state: State, solutions: tuple[Components, ...]
    ) -> dict[str, Component]:
        """The weighted terms of the reward by name; all zero in the step in which the episode fails.

        Args:
            xp: namespace of the components.
            error: distance of the tip from the target [m].
            state: after the step.
            solutions: configurations that solve the episode; none leaves the potential out.
        """
        running = xp.where(state.failure == RUNNING, 1.0, 0.0)
        success = xp.where(error <= self.tolerance, running, 0.0)
        if self.reward_type == "sparse":
            return {"success": success}
        w = self.weights
        terms = {"distance": w.distance * running / (1.0 + xp.sqrt(error / self.tolerance))}
        if solutions:
            gap = _nearest(xp, state.configuration, solutions)
            terms["potential"] = w.potential * running * xp.maximum(1.0 - gap / self.joint_span, 0.0)
        stability = xp.minimum(xp.maximum(state.stability_margin / _FULL_MARGIN, 0.0), 1.0)
        wrench = xp.minimum(xp.maximum(state.wrench_margin / _FULL_MARGIN, 0.0), 1.0)
        return terms | {
            "success": w.success * success,
            "effort": w.effort * running * (1.0 - self.effort(state)),
            "stability": w.stability * running * stability,
            "wrench": w.wrench * running * wrench,
        }


def _nearest(xp: Any, q: Components, solutions: tuple[Components, ...]) -> Component:
    """Largest joint difference to the solution where that is smallest [rad]."""
    gap: Component = None
    for solution in solutions:
        to_this: Component = 0.0
        for angle, goal in zip(q, solution, strict=True):
            to_this = xp.maximum(to_this, abs(angle - goal))
        gap = to_this if gap is None else xp.minimum(gap, to_this)
    return gap


def weights_from(given: dict[str, float] | RewardWeights | None) -> RewardWeights:
    """Reward weights by name; those left out keep their default.

    Raises:
        ValueError: a name is unknown, or a weight negative or not finite.
    """
    if isinstance(given, RewardWeights):
        return given
    known = list(RewardWeights.__dataclass_fields__)
    for name in given or {}:
        if name not in known:
            raise ValueError(f"reward_weights: no term {name!r}; there are {', '.join(known)}")
    return RewardWeights(**(given or {}))
