"""Weights of the rewards' terms, each zero or positive; a term scores between 0 and 1 before it is weighted."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np

W = TypeVar("W", bound="Weights")


@dataclass(frozen=True)
class Weights:
    """What all weights share: they are finite, zero or positive."""

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            ValueError: a weight is negative or not finite.
        """
        for field in fields(self):
            value = getattr(self, field.name)
            is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
            if not (is_number and np.isfinite(value) and value >= 0):
                raise ValueError(f"reward weight {field.name} = {value!r}: must be a finite number, zero or positive")

    def updated(self: W, weights: "Mapping[str, float] | Weights | None") -> W:
        """These weights with others by name, or others altogether.

        Raises:
            ValueError: a name is unknown, or a weight negative or not finite.
        """
        if isinstance(weights, type(self)):
            return weights
        if not isinstance(weights, Mapping | None):
            raise ValueError(f"reward_weights = {weights!r}: must be a dict such as {{'success': 1.0}}")
        known = [field.name for field in fields(self)]
        for name in weights or {}:
            if name not in known:
                raise ValueError(f"reward_weights: no term {name!r}; there are {', '.join(known)}")
        return replace(self, **(weights or {}))


@dataclass(frozen=True)
class ReachWeights(Weights):
    """Weights of the dense reward's terms, each zero or positive; a term scores between 0 and 1 before it is weighted.

    Attributes:
        distance: 1 / (1 + sqrt(tip error / tolerance)): 1 at the target, 1/2 at one tolerance from it, 1/11 at a
            hundred.
        potential: 1 in the nearest feasible configuration that puts the tip on the target, falling linearly with the
            joint distance to it. The reachable set has a hole and two sheets, so that walking straight towards the
            target runs into its boundary; this term knows the path round it. It uses inverse solutions that the agent
            does not see.
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


@dataclass(frozen=True)
class ObstacleReachWeights(ReachWeights):
    """Weights of the dense reward of reaching among obstacles: those of `ReachWeights`, and one more.

    Attributes:
        clearance: rises with the clearance from the obstacles, up to 1 at the safe clearance.
    """

    clearance: float = 0.1


@dataclass(frozen=True)
class HoldWeights(Weights):
    """Weights of the dense reward of holding.

    Attributes:
        hold: 1 in every step.
        distance: 1 on the target, 0 where the tolerance ends.
        stability: rises with the stability margin, up to 1 at 0.1.
        success: 1 while a force of at least the reference is held.
    """

    hold: float = 0.5
    distance: float = 0.25
    stability: float = 0.1
    success: float = 0.5


@dataclass(frozen=True)
class TrackWeights(Weights):
    """Weights of the dense reward of tracking.

    Attributes:
        distance: 1 / (1 + sqrt(distance from the moving goal / tolerance)).
        success: 1 while the tip is within tolerance of it.
        stability: rises with the stability margin, up to 1 at 0.2.
        wrench: rises with the wrench margin, up to 1 at 0.2.
    """

    distance: float = 0.5
    success: float = 0.5
    stability: float = 0.05
    wrench: float = 0.05


@dataclass(frozen=True)
class PostureWeights(Weights):
    """Weights of the dense reward of changing posture.

    Attributes:
        distance: 1 at the goal, falling linearly with the joint distance.
        closeness: 1 / (1 + sqrt(joint distance / tolerance)).
        potential: falls with the length of the singularity-avoiding path to the goal, from 1 to 0. The straight path
            mostly meets a singularity; this term knows the path round it.
        clearance: rises with the distance from the singularity.
        success: 1 while at the goal.
    """

    distance: float = 0.3
    closeness: float = 0.3
    potential: float = 1.0
    clearance: float = 0.1
    success: float = 0.5
