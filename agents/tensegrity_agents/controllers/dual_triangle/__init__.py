"""Analytic controllers of the dual-triangle arm."""

from functools import partial

from tensegrity_agents.controllers.base import Makers
from tensegrity_agents.controllers.dual_triangle.beliefs import DualTriangleBeliefs
from tensegrity_agents.controllers.dual_triangle.informed import Informed
from tensegrity_agents.controllers.dual_triangle.loaded_lqg import LoadedLQG
from tensegrity_agents.controllers.dual_triangle.push import HoldInputs, PushObserver, PushOracle, PushPseudoInverse
from tensegrity_agents.controllers.dual_triangle.reach import (
    ClosedFormMax,
    ClosedFormSquares,
    ClosedFormSum,
    Observer,
    Oracle,
    PseudoInverse,
)
from tensegrity_agents.controllers.dual_triangle.servo import IdentifyingObserver, Servo
from tensegrity_agents.controllers.dynamic import Feedback, Ramp
from tensegrity_agents.controllers.dynamic_servo import OwnRamp, RestingRamp
from tensegrity_agents.controllers.lqg import LQG
from tensegrity_agents.controllers.mpc import MPC
from tensegrity_agents.controllers.regulated import FullSpeedPlan, Regulated, Shaped

__all__ = [
    "BASELINES",
    "DYNAMIC",
    "ClosedFormMax",
    "ClosedFormSquares",
    "ClosedFormSum",
    "HoldInputs",
    "IdentifyingObserver",
    "Informed",
    "Observer",
    "Oracle",
    "PseudoInverse",
    "PushObserver",
    "PushOracle",
    "PushPseudoInverse",
    "Servo",
]

# By the name of the environment's arm, then by their own, the strongest last: how to make each for a core.
BASELINES: Makers = {
    "DualTriangleReach": {
        "closed_form_sum": ClosedFormSum,
        "closed_form_max": ClosedFormMax,
        "closed_form_squares": ClosedFormSquares,
        "pseudo_inverse": PseudoInverse,
        "observer": Observer,
        "servo": Servo,
        "identifying_observer": IdentifyingObserver,
        "oracle": Oracle,
    },
    "DualTrianglePush": {
        "closed_form": HoldInputs,
        "pseudo_inverse": PushPseudoInverse,
        "observer": PushObserver,
        "oracle": PushOracle,
    },
}

# The same of the dynamic environments: quasi-static controllers, led along ramps, shaped or damped.
DYNAMIC: Makers = {
    "DualTriangleReach": {
        "closed_form_ramp": partial(Ramp, base=ClosedFormSquares),
        "pseudo_inverse": partial(Feedback, base=PseudoInverse),
        "observer": partial(Ramp, base=Observer),
        "identifying_observer": partial(RestingRamp, base=Observer),
        "oracle": partial(Ramp, base=Oracle),
    },
}
# Fast tasks: the same, at full speed, too.
DYNAMIC["DualTriangleFastReach"] = {
    "closed_form_ramp": partial(Ramp, base=ClosedFormSquares),
    "pseudo_inverse": partial(Feedback, base=PseudoInverse),
    "observer": partial(Ramp, base=Observer),
    "identifying_observer": partial(RestingRamp, base=Observer),
    "closed_form_plan": partial(FullSpeedPlan, base=ClosedFormSquares),
    "closed_form_shaped": partial(Shaped, base=ClosedFormSquares),
    "lqr": partial(Regulated, base=Observer),
    "lqg": partial(LQG, base=ClosedFormSquares, softness=0.3, smoothing=10),  # tuned at level 0 (`tensegrity tune`)
    "oracle": partial(Regulated, base=Oracle),
}

# Of some ids, by their names, besides those of the arm.
UNCERTAIN: Makers = {
    "DualTriangleLoadedReachUncertain": {
        # Tuned at level 2 (`tensegrity tune`).
        "identifying_observer": partial(IdentifyingObserver, wait=2, mean=8, enough=0.8, looks=12),
        "mpc": partial(MPC, beliefs=DualTriangleBeliefs),
    },
    "DualTriangleReachMuJoCo": {
        "closed_form_plan": partial(FullSpeedPlan, base=ClosedFormSquares),
        "lqr": partial(Regulated, base=Observer),
        "lqg": partial(LQG, base=ClosedFormSquares, softness=0.3, smoothing=10),
    },
    "DualTriangleLoadedReachMuJoCo": {
        "observer_plan": partial(FullSpeedPlan, base=Observer),
        "lqg": partial(LoadedLQG, softness=1.0, smoothing=5, speed=1.0, look=1),  # tuned (`tensegrity tune`)
    },
    "DualTriangleLoadedReachUncertainMuJoCo": {"lqg": LoadedLQG},
}

# The same: told everything that was drawn.
INFORMED: Makers = {
    "DualTriangleLoadedReachUncertain": {"informed": Informed},
    "DualTriangleLoadedReachUncertainMuJoCo": {"informed": partial(OwnRamp, base=Informed)},
    "DualTriangleFastReachMuJoCo": {"informed": partial(OwnRamp, base=Informed)},
}
