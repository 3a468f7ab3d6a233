"""Analytic controllers of arms of X-joints that reach with a commanded stiffness."""

from tensegrity_agents.controllers.base import Makers
from tensegrity_agents.controllers.stiffness.reach import (
    ClosedForm,
    NXClosedForm,
    NXOracle,
    NXPseudoInverse,
    Oracle,
    PseudoInverse,
)

__all__ = ["BASELINES", "ClosedForm", "NXClosedForm", "NXOracle", "NXPseudoInverse", "Oracle", "PseudoInverse"]

# By the name of the environment's arm, then by their own, the strongest last: how to make each for a core.
BASELINES: Makers = {
    "TwoXStiffnessReach": {"closed_form": ClosedForm, "pseudo_inverse": PseudoInverse, "oracle": Oracle},
    "NXStiffnessReach": {"closed_form": NXClosedForm, "pseudo_inverse": NXPseudoInverse, "oracle": NXOracle},
}
