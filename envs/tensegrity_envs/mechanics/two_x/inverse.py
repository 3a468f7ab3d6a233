"""Inverse kinematics of the 2-X manipulator: what is told about a solution, and the published quartic."""

from typing import NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics.two_x.kinematics import TwoXKinematics
from tensegrity_envs.mechanics.x_joints.curve import angle_on_curve, beyond, from_anomaly, off_curve


class InverseSolution(NamedTuple):
    """One solution of the inverse kinematics.

    Attributes:
        configuration: (alpha_1, alpha_2) [rad].
        state: "U" (up, |alpha| < pi) or "D" (down) for each joint, such as "UD".
        singularity: det J [m2]; its sign tells the aspect.
        stability_margin: see `TwoX.stability_margin`.
        wrench_margin: see `TwoX.wrench_margin`.
        residual: distance of its forward kinematics from the target [m].
    """

    configuration: tuple[float, float]
    state: str
    singularity: float
    stability_margin: float
    wrench_margin: float
    residual: float

    @property
    def is_stable_wrench_feasible(self) -> bool:
        """Whether feasible tensions hold this configuration in stable equilibrium."""
        return self.stability_margin > 0 and self.wrench_margin >= 0


def through_anomaly(
    arm: TwoXKinematics, x: Component, y: Component, psi: Component
) -> tuple[tuple[Component, Component], Component, Component]:
    """What the inverse kinematics looks for roots of, along the circle of joint 1's eccentric anomaly. Traceable.

    Returns:
        (alpha_1, alpha_2) [rad] with the tip at (x, y) [m] where the second result is 0; that result; and u, next
        to whose zeros [m2] alpha_2 has another solution.
    """
    first, second = arm.bars
    alpha1 = from_anomaly(first, psi)
    dx, dy, dd = beyond(first, x, y, alpha1)
    alpha2, u, _, _ = angle_on_curve(second, dx, dy, dd)
    return (alpha1, alpha2), off_curve(second, dy, dd), u


def furet_quartic(x: float, y: float, b: float) -> np.ndarray:
    """Coefficients a4 ... a0 of [Furet2018, Eqs. 4-8] in t = tan(phi_1/2), for L = 1.

    phi_1, which the paper does not define, is the orientation of the long bar from the left base pivot to the top
    right one.
    """
    xx, yy, bb = x * x, y * y, b * b
    rr = (xx + yy) ** 2
    return np.array(
        [
            (b + 1) ** 2 * (bb * yy + rr + 4 * x * (xx + yy) + 5 * xx + yy + 2 * x),
            4 * y * (b + 1) * (2 * bb * x + bb - 2 * xx - 2 * yy - 4 * x - 1),
            2 * (bb * bb * yy + bb * rr + bb * xx - 10 * bb * yy + rr - 3 * xx + 9 * yy),
            4 * y * (b - 1) * (2 * bb * x - bb + 2 * xx + 2 * yy - 4 * x + 1),
            (b - 1) ** 2 * (bb * yy + rr - 4 * x * (xx + yy) + 5 * xx + yy - 2 * x),
        ]
    )
