"""Analytic controllers of the 2-X manipulator."""

from functools import partial

from tensegrity_agents.controllers.base import Makers
from tensegrity_agents.controllers.dynamic import Feedback, Ramp
from tensegrity_agents.controllers.dynamic_servo import OwnRamp
from tensegrity_agents.controllers.integral_ramp import IntegralRamp
from tensegrity_agents.controllers.lqg import LQG
from tensegrity_agents.controllers.mpc import MPC
from tensegrity_agents.controllers.regulated import FullSpeedPlan, Regulated, Shaped
from tensegrity_agents.controllers.two_x import posture
from tensegrity_agents.controllers.two_x.beliefs import TwoXBeliefs
from tensegrity_agents.controllers.two_x.informed import Informed
from tensegrity_agents.controllers.two_x.reach import CarefulOracle, ClosedFormIK, Observer, Oracle, PseudoInverse
from tensegrity_agents.controllers.two_x.resting import CarefulClosedForm, RestingObserver
from tensegrity_agents.controllers.two_x.servo import IdentifyingObserver, Servo

__all__ = [
    "BASELINES",
    "DYNAMIC",
    "TEACHERS",
    "CarefulOracle",
    "ClosedFormIK",
    "IdentifyingObserver",
    "Informed",
    "Observer",
    "Oracle",
    "PseudoInverse",
    "Servo",
]

# By the name of the environment's arm, then by their own, the strongest last: how to make each for a core.
BASELINES: Makers = {
    "TwoXReach": {
        "closed_form_ik": ClosedFormIK,
        "pseudo_inverse": PseudoInverse,
        "observer": Observer,
        "servo": Servo,
        "identifying_observer": IdentifyingObserver,
        "oracle": Oracle,
    },
    "TwoXPostureChange": {
        "pseudo_inverse": posture.PseudoInverse,
        "straight_path": posture.StraightPath,
        "planner": posture.Planner,
    },
}

# The same of the dynamic environments: quasi-static controllers, led along ramps, shaped or damped.
DYNAMIC: Makers = {
    "TwoXReach": {
        "closed_form_ramp": partial(Ramp, base=ClosedFormIK),
        "pseudo_inverse": partial(Feedback, base=PseudoInverse, slowed=0.1),
        "closed_form_plan": partial(FullSpeedPlan, base=ClosedFormIK),
        "lqr": partial(Regulated, base=Observer, shaper=None, softness=10.0),
        "lqg": partial(LQG, base=ClosedFormIK),
        "oracle": partial(Ramp, base=Oracle),
    },
}

# Fast tasks: the same, at full speed, too; ramps that wait for rest would be too late there.
DYNAMIC["TwoXFastReach"] = {
    "closed_form_ramp": partial(Ramp, base=ClosedFormIK),
    "pseudo_inverse": partial(Feedback, base=PseudoInverse, slowed=0.1),
    "closed_form_plan": partial(FullSpeedPlan, base=ClosedFormIK),
    "closed_form_shaped": partial(Shaped, base=ClosedFormIK),
    "lqr": partial(Regulated, base=Observer, shaper=None, softness=10.0),
    "lqg": partial(LQG, base=ClosedFormIK, softness=0.3, smoothing=8),  # tuned (`tensegrity tune`)
    "oracle": partial(Regulated, base=Oracle, shaper=None, softness=10.0),
}

# Those that only teach agents (sb3.teacher_student), beside the baselines.
TEACHERS: Makers = {
    "TwoXReach": {"careful_oracle": CarefulOracle},
}

# Of uncertain ids, by their names, besides those of the arm.
UNCERTAIN: Makers = {
    name: {"mpc": partial(MPC, beliefs=TwoXBeliefs)}
    for name in ("TwoXTensionReachUncertain", "TwoXPayloadReachUncertain")
}
UNCERTAIN["TwoXPayloadReachUncertain"] |= {
    "identifying_observer": partial(IdentifyingObserver, looks=8, clearance=0.2),  # tuned (`tensegrity tune`)
}
UNCERTAIN["TwoXTensionReachUncertainMuJoCo"] = {
    "servo": partial(IntegralRamp, base=CarefulClosedForm),
    "identifying_observer": partial(IntegralRamp, base=partial(RestingObserver, looks=10), look=9),
    "lqg": partial(LQG, base=ClosedFormIK),
}

# The same: told everything that was drawn.
INFORMED: Makers = {
    "TwoXTensionReachUncertain": {"informed": Informed},
    "TwoXPayloadReachUncertain": {"informed": Informed},
    "TwoXTensionReachUncertainMuJoCo": {"informed": partial(OwnRamp, base=Informed)},
    "TwoXFastReachMuJoCo": {"informed": partial(OwnRamp, base=Informed)},
}
