"""What configurations with the tip at a target are compared by.

Objectives are those of [Zhao2021, section III] ("sum", "max" and "squares" of the joints' displacements from a start)
and "margin", the smaller one of stability and wrench margin. All but "squares" have kinks where minima tend to lie.
"""

from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Component

Objective = Literal["sum", "max", "squares", "margin"]
OBJECTIVES = ("sum", "max", "squares", "margin")

# configurations (n, k) and the indices (k,) of their targets -> values (k,)
Measure = Callable[[np.ndarray, np.ndarray], np.ndarray]
# configurations (n, k) -> stability and wrench margins (k,)
Margins = Callable[[np.ndarray], Sequence[np.ndarray]]


class Optimum(NamedTuple):
    """A configuration with the tip at the target that no other one nearby is better than.

    Attributes:
        configuration: n angles [rad].
        objective: its value [rad; rad^2 for "squares"; - for "margin", where larger is better].
    """

    configuration: tuple[float, ...]
    objective: float


def measure_of(
    arm: Any, objective: str, start: np.ndarray, load: Sequence[Component], margins: Margins | None = None
) -> Measure:
    """What is minimized: the objective, or minus the smaller one of both margins, by default the arm's of `posture`.

    Raises:
        ValueError: there is no such objective.
    """
    if objective not in OBJECTIVES:
        raise ValueError(f"objective = {objective!r}: must be one of {', '.join(OBJECTIVES)}")

    def measure(q: np.ndarray, owner: np.ndarray) -> np.ndarray:
        if objective == "margin":
            with np.errstate(all="ignore"):
                stability, wrench = arm.posture(tuple(q), load)[1:] if margins is None else margins(q)
            margin = np.minimum(stability, wrench)
            return np.where(np.isnan(margin), np.inf, -margin)  # what is not defined is worse than all that is
        move = np.abs(q - start[:, owner])
        if objective == "squares":
            return np.asarray((move * move).sum(axis=0))
        return np.asarray(move.sum(axis=0) if objective == "sum" else move.max(axis=0))

    return measure


def of_target(measure: Measure) -> Callable[[np.ndarray], np.ndarray]:
    """The same of configurations (n, k) with the tip at the first target."""
    return lambda q: measure(q, np.zeros(q.shape[1], int))
