"""The planar 4-bar class-2 tensegrity mechanism: four bars, three springs of zero free length, two linear actuators.

Source: [Ji2014] Ji, Li, Lin, "Kinematics, Singularity, and Workspaces of a Planar 4-Bar Tensegrity Mechanism", Journal
of Robotics 2014, 967251. Many of its equations are misprinted; docs/planar_four_bar.md lists every correction.

Conventions: A = (0, 0) and B = (L, 0) are fixed. The actuators set rho1 = |AC|, hence the angle beta of bar BC, and
rho2 = |BD|, hence the angle alpha of bar AD; C and D are never below the base. That leaves two angles free, the
configuration q = (theta, gamma): E = D + L (-cos theta, sin theta), F = C + L (cos gamma, sin gamma). F is the tip.
The mechanism lies in a horizontal plane: no gravity. `load` is a dead force on F (fx, fy) [N].

Without a load the stable state is a rectangle C-D-F-E with the bars CF and DE as its diagonals, on one of two `side`s
of the line CD, as long as R = |CD| / L < 1, which is rho1^2 + rho2^2 < 4 L^2; beyond, the mechanism is flat.
"""

import math
from collections.abc import Sequence

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, as_components, is_symbol
from tensegrity_envs.mechanics import equilibrium as _equilibrium
from tensegrity_envs.mechanics.checks import sized
from tensegrity_envs.mechanics.planar_four_bar import equilibria as _equilibria
from tensegrity_envs.mechanics.planar_four_bar import inverse as _inverse
from tensegrity_envs.mechanics.planar_four_bar import snapping as _snapping
from tensegrity_envs.mechanics.planar_four_bar.design import PlanarFourBarDesign
from tensegrity_envs.mechanics.planar_four_bar.kinematics import Point
from tensegrity_envs.mechanics.planar_four_bar.statics import NO_LOAD, FourBarStatics


@sized(
    q=(2, "theta, gamma"),
    start=(2, "theta, gamma"),
    lengths=(2, "rho1, rho2"),
    load=(2, "fx, fy"),
    direction=(2, "x, y"),
)
class PlanarFourBar(FourBarStatics):
    """A mechanism of one design, or of a batch of designs.

    A configuration is q = (theta, gamma) [rad], the inputs are the actuator lengths (rho1, rho2) [m]. Components are
    floats, NumPy arrays or Torch tensors of any (broadcastable) shape.
    """

    def inverse_kinematics(self, x: float, y: float, load: Sequence[float] = NO_LOAD) -> list[_inverse.InverseSolution]:
        """Every equilibrium with F at a target, stable or not; see `inverse.inverse_kinematics`."""
        return _inverse.inverse_kinematics(self, x, y, load)

    def equilibria(
        self, lengths: Sequence[float], load: Sequence[float] = NO_LOAD
    ) -> list[_equilibria.FourBarEquilibrium]:
        """All equilibria under given lengths and load, stable and unstable; see `equilibria.equilibria`."""
        return _equilibria.equilibria(self, lengths, load)

    def equilibrium(
        self, lengths: Sequence[Component], start: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> _equilibrium.Equilibrium:
        """The equilibrium that the mechanism reaches from rest at `start`, see `equilibrium.relax`.

        Args:
            lengths: (rho1, rho2) [m], each a float or an array of shape (m,).
            start: (theta, gamma) [rad].
            load: (fx, fy) [N].

        Raises:
            ValueError: lengths are out of [0, 2 L].
        """
        self.check_lengths(lengths)
        parameters = (self.design, as_components(lengths), as_components(load))
        return _equilibrium.relax(_statics, start, parameters, 4 * math.pi)

    def rectangle_jacobian(
        self, lengths: Sequence[Component], side: Component
    ) -> tuple[tuple[Component, Component], tuple[Component, Component]]:
        """d(x, y) / d(rho1, rho2) of the unloaded rectangle [-]: two rows, [Ji2014, Eqs. 27-38].

        By differentiating F = D + side h rot90(C - D), h = sqrt(L^2 / CD^2 - 1); not finite where C and D coincide
        and where the mechanism becomes flat, h = 0. Of flat or loaded states: `jacobian`.

        Raises:
            ValueError: there is no rectangle under some of these lengths.
        """
        (cx, cy), (dx, dy) = self.supports(lengths)
        (c1, c2), (d1, d2) = self._support_rates(lengths)
        square, rest = self.flatness(lengths)
        xp = self._xp(square)
        if not is_symbol(rest) and not np.all(np.asarray((rest > 0) & (square > 0))):
            raise ValueError(
                f"lengths = {lengths!r}: no rectangle (or C and D coincide); "
                "jacobian(q, lengths) is that of other states"
            )
        vx, vy = cx - dx, cy - dy
        height = side * xp.sqrt(rest / square)
        fall = -side / (square * xp.sqrt(rest * square) * self.length**2)  # d height / d (CD^2 / 2)

        def rate(ux: Component, uy: Component) -> Point:
            change = fall * (vx * ux + vy * uy)
            return -change * vy - height * uy, change * vx + height * ux

        (x1, y1), (x2, y2) = rate(c1, c2), rate(-d1, -d2)
        return (x1, x2 + d1), (y1, y2 + d2)

    def rectangle_determinant(self, lengths: Sequence[Component], side: Component) -> Component:
        """det J of the unloaded rectangle [-], [Ji2014, Eq. 40] with Phi3 corrected."""
        (j11, j12), (j21, j22) = self.rectangle_jacobian(lengths, side)
        return j11 * j22 - j12 * j21

    def phi(self, q: Sequence[Component], lengths: Sequence[Component]) -> tuple[Component, Component, Component]:
        """Phi1, Phi2, Phi3 of [Ji2014, Eq. 37] with the misprint cos(alpha - theta) of Eqs. 32 and 37 corrected:
        dgamma/drho1 = Phi1 / Phi2 dbeta/drho1, dgamma/drho2 = Phi3 / Phi2 dalpha/drho2, in unloaded equilibria.
        """
        xp = self._xp(*q, *lengths)
        (alpha, beta), (theta, gamma) = self.base_angles(lengths), q
        both = xp.cos(theta + gamma)
        of_theta = 2 * xp.cos(theta) + both - 2 * xp.cos(beta - theta) - 2 * xp.cos(alpha + theta)
        of_gamma = 2 * xp.cos(beta + gamma) + 2 * xp.cos(alpha - gamma) - both - 2 * xp.cos(gamma)
        return (
            -2 * (xp.cos(beta - theta) * both + xp.cos(beta + gamma) * of_theta),
            both * both + of_theta * of_gamma,
            2 * (xp.cos(alpha + theta) * both + xp.cos(alpha - gamma) * of_theta),
        )

    def jacobian(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> tuple[tuple[Component, Component], tuple[Component, Component]]:
        """d(x, y) / d(rho1, rho2) of any equilibrium under a constant load [-], by implicit differentiation."""
        xp = self._xp(*q, *lengths, *load)
        theta, gamma = q
        (h11, h12), (_, h22) = self.stiffness_matrix(q, lengths, load)
        scale = 2 * self.stiffness * self.length
        ct, st, cg, sg = xp.cos(theta), xp.sin(theta), xp.cos(gamma), xp.sin(gamma)
        columns = []
        (c1, c2), (d1, d2) = self._support_rates(lengths)
        # The springs' moments on the bars change with the vector from D to C alone.
        for (vx, vy), (fx, fy) in (((c1, c2), (c1, c2)), ((-d1, -d2), (0.0, 0.0))):
            g1, g2 = -scale * (vy * ct + vx * st), scale * (vy * cg - vx * sg)
            turn = -(h11 * g2 - h12 * g1) / (h11 * h22 - h12 * h12)
            columns.append((fx - self.length * sg * turn, fy + self.length * cg * turn))
        (x1, y1), (x2, y2) = columns
        return (x1, x2), (y1, y2)

    def jacobian_determinant(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> Component:
        """det of `jacobian` [-]; of an unloaded rectangle `rectangle_determinant`."""
        (j11, j12), (j21, j22) = self.jacobian(q, lengths, load)
        return j11 * j22 - j12 * j21

    def critical_load(self, lengths: Sequence[float], side: int, direction: Sequence[float]) -> float:
        """The dead force on F in a direction at which the rectangle snaps [N]; see `snapping.critical_load`."""
        return _snapping.critical_load(self, lengths, side, direction)


def _statics(
    q: Components, parameters: tuple[PlanarFourBarDesign, Components, Components]
) -> tuple[Components, tuple[Components, ...]]:
    design, lengths, load = parameters
    return PlanarFourBar(design).statics(q, lengths, load)
