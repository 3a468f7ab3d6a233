"""Analytic controllers of arms of any number of X-joints."""

from functools import partial

from tensegrity_agents.controllers.base import Makers
from tensegrity_agents.controllers.dynamic import Feedback
from tensegrity_agents.controllers.lqg import LQG
from tensegrity_agents.controllers.n_x.dynamic import HeldRamp
from tensegrity_agents.controllers.n_x.reach import ClosedFormIK, Observer, Oracle, PseudoInverse
from tensegrity_agents.controllers.regulated import FullSpeedPlan, Regulated

__all__ = ["BASELINES", "DYNAMIC", "TEACHERS", "ClosedFormIK", "Observer", "Oracle", "PseudoInverse"]

# By the name of the environment's arm, then by their own, the strongest last: how to make each for a core.
BASELINES: Makers = {
    "NXReach": {
        "closed_form_ik": ClosedFormIK,
        "pseudo_inverse": PseudoInverse,
        "observer": Observer,
        "oracle": Oracle,
    },
}

# The same of the dynamic environments: quasi-static controllers, led along ramps, at full speed, or damped.
DYNAMIC: Makers = {
    "NXReach": {
        "closed_form_ramp": partial(HeldRamp, base=ClosedFormIK),
        "pseudo_inverse": partial(Feedback, base=PseudoInverse, slowed=0.1),
        "closed_form_plan": partial(FullSpeedPlan, base=ClosedFormIK),
        "lqr": partial(Regulated, base=ClosedFormIK, shaper=None, softness=10.0),
        "lqg": partial(LQG, base=ClosedFormIK, softness=0.3, smoothing=20),
        "oracle": partial(HeldRamp, base=Oracle),
    },
}

# Those that only teach agents (sb3.teacher_student), beside the baselines.
TEACHERS: Makers = {
    "NXReach": {"careful_oracle": Oracle},  # as careful as the 2-X's
}
