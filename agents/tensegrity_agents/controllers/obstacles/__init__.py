"""Analytic controllers of planar arms among obstacles."""

from functools import partial

from tensegrity_agents.controllers.base import Makers
from tensegrity_agents.controllers.dynamic import Ramp
from tensegrity_agents.controllers.n_x.dynamic import HeldRamp
from tensegrity_agents.controllers.obstacles import dual_triangle, n_x, planar_four_bar, two_x

__all__ = ["BASELINES", "DYNAMIC"]

# By the name of the environment's arm, then by their own, the strongest last: how to make each for a core.
BASELINES: Makers = {
    "NXObstacleReach": {
        "closed_form_ik": n_x.ClosedFormIK,
        "pseudo_inverse": n_x.PseudoInverse,
        "planner": n_x.Planner,
    },
    "TwoXObstacleReach": {
        "closed_form_ik": two_x.ClosedFormIK,
        "pseudo_inverse": two_x.PseudoInverse,
        "planner": two_x.Planner,
    },
    "DualTriangleObstacleReach": {
        "straight_path": dual_triangle.StraightPath,
        "pseudo_inverse": dual_triangle.PseudoInverse,
        "planner": dual_triangle.Planner,
    },
    "PlanarFourBarObstacleReach": {
        "closed_form_ik": planar_four_bar.ClosedFormIK,
        "pseudo_inverse": planar_four_bar.PseudoInverse,
        "planner": planar_four_bar.Planner,
    },
}

# The same of the dynamic environments, led along ramps.
DYNAMIC: Makers = {
    "NXObstacleReach": {
        "closed_form_ramp": partial(HeldRamp, base=n_x.ClosedFormIK),
        "planner": partial(HeldRamp, base=n_x.Planner),
    },
    "TwoXObstacleReach": {
        "closed_form_ramp": partial(Ramp, base=two_x.ClosedFormIK),
        "planner": partial(Ramp, base=two_x.Planner),
    },
    "DualTriangleObstacleReach": {
        "straight_path_ramp": partial(Ramp, base=dual_triangle.StraightPath),
        "planner": partial(Ramp, base=dual_triangle.Planner),
    },
}
