"""Analytic controllers of the spatial prism."""

from functools import partial

from tensegrity_agents.controllers.base import Makers
from tensegrity_agents.controllers.spatial_prism.dynamic import CurvePlan, CurveTracking, TrackingFeedback
from tensegrity_agents.controllers.spatial_prism.informed import Informed
from tensegrity_agents.controllers.spatial_prism.servo import IdentifyingObserver, Servo
from tensegrity_agents.controllers.spatial_prism.track import ClosedFormIK, Observer, Oracle, PseudoInverse

__all__ = [
    "BASELINES",
    "DYNAMIC",
    "INFORMED",
    "UNCERTAIN",
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
    "SpatialPrismTrack": {
        "closed_form_ik": ClosedFormIK,
        "pseudo_inverse": PseudoInverse,
        "observer": Observer,
        "oracle": Oracle,
    },
}

# The same of the dynamic environments: quasi-static controllers, led along ramps, shaped or damped.
DYNAMIC: Makers = {
    "SpatialPrismTrack": {
        "closed_form_ik": partial(CurvePlan, base=ClosedFormIK),
        "closed_form_shaped": partial(CurveTracking, base=ClosedFormIK, pace="shaped", damped=False),
        "closed_form_damped": partial(CurveTracking, base=ClosedFormIK),
        "pseudo_inverse": partial(TrackingFeedback, base=PseudoInverse),
        "oracle": partial(CurveTracking, base=Oracle),
    },
}

# Of some ids, by their names, besides those of the arm.
UNCERTAIN: Makers = {
    "SpatialPrismPayloadTrackUncertain": {"servo": Servo, "identifying_observer": IdentifyingObserver},
}

# The same: told everything that was drawn.
INFORMED: Makers = {
    "SpatialPrismPayloadTrackUncertain": {"informed": Informed},
}
