"""Analytic controllers of the planar 4-bar mechanism, and features that its nominal model gives agents."""

from functools import partial

from tensegrity_agents.controllers.base import Makers
from tensegrity_agents.controllers.planar_four_bar.dynamic import DampedFeedback, PlannedPath, SmoothPlan
from tensegrity_agents.controllers.planar_four_bar.dynamic_servo import OwnPath, Told
from tensegrity_agents.controllers.planar_four_bar.features import Features
from tensegrity_agents.controllers.planar_four_bar.informed import Informed
from tensegrity_agents.controllers.planar_four_bar.loaded_features import LoadedFeatures
from tensegrity_agents.controllers.planar_four_bar.reach import ClosedFormIK, Observer, Oracle, PseudoInverse
from tensegrity_agents.controllers.planar_four_bar.servo import IdentifyingObserver, Servo
from tensegrity_agents.controllers.regulated import FullSpeedPlan
from tensegrity_envs.environments import PlanarFourBarReach

__all__ = [
    "BASELINES",
    "DYNAMIC",
    "FEATURES",
    "INFORMED",
    "UNCERTAIN",
    "ClosedFormIK",
    "Features",
    "IdentifyingObserver",
    "Informed",
    "LoadedFeatures",
    "Observer",
    "Oracle",
    "PseudoInverse",
    "Servo",
]

# By the name of the environment's arm, then by their own, the strongest last: how to make each for a core.
BASELINES: Makers = {
    "PlanarFourBarReach": {
        "closed_form_ik": ClosedFormIK,
        "pseudo_inverse": PseudoInverse,
        "observer": Observer,
        "oracle": Oracle,
    },
}

# The same of the dynamic environments: quasi-static controllers, led along ramps, shaped or damped.
DYNAMIC: Makers = {
    "PlanarFourBarReach": {
        "closed_form_ik": partial(FullSpeedPlan, base=ClosedFormIK),
        "closed_form_plan": partial(SmoothPlan, base=ClosedFormIK),
        "closed_form_shaped": partial(PlannedPath, base=ClosedFormIK, pace="shaped", damped=False),
        "closed_form_damped": partial(PlannedPath, base=ClosedFormIK, pace="full"),
        "closed_form_ramp": partial(PlannedPath, base=ClosedFormIK),
        "pseudo_inverse": partial(DampedFeedback, base=PseudoInverse),
    },
}


def _features(core: PlanarFourBarReach) -> Features:
    return LoadedFeatures(core) if any(core.sampler.load_range) else Features(core)


# By the name of the environment's arm: makes, for a core, what has `size` and computes so many features.
FEATURES = {"PlanarFourBarReach": _features}

# Of some ids, by their names, besides those of the arm.
UNCERTAIN: Makers = {
    "PlanarFourBarLoadedReachUncertain": {"servo": Servo, "identifying_observer": IdentifyingObserver},
    "PlanarFourBarReachUncertainMuJoCo": {"servo": partial(OwnPath, base=ClosedFormIK)},
}

# The same: told everything that was drawn.
INFORMED: Makers = {
    "PlanarFourBarLoadedReachUncertain": {"informed": Informed},
    "PlanarFourBarReachUncertainMuJoCo": {"informed": partial(OwnPath, base=Told)},
}
