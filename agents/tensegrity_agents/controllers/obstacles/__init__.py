"""Analytic controllers of planar arms among obstacles."""

from tensegrity_agents.controllers.base import Makers
from tensegrity_agents.controllers.obstacles import dual_triangle, n_x, two_x

__all__ = ["BASELINES"]

# By the name of the environment's arm, then by their own, the strongest last: how to make each for a core.
BASELINES: Makers = {
    "NXObstacleReach": {
        "closed_form_ik": n_x.ClosedFormIK,
        "pseudo_inverse": n_x.PseudoInverse,
        "planner": n_x.Planner,
    },
    "TwoXObstacleReach": {
        "closed_form_ik": two_x.ClosedFormIK,
        "planner": two_x.Planner,
    },
    "DualTriangleObstacleReach": {
        "straight_path": dual_triangle.StraightPath,
        "pseudo_inverse": dual_triangle.PseudoInverse,
        "planner": dual_triangle.Planner,
    },
}
