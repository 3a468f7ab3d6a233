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

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, as_components, detached, is_symbol, namespace_of
from tensegrity_envs.mechanics import equilibrium as _equilibrium
from tensegrity_envs.mechanics.design import Member
from tensegrity_envs.mechanics.planar_four_bar import equilibria as _equilibria
from tensegrity_envs.mechanics.planar_four_bar import inverse as _inverse
from tensegrity_envs.mechanics.planar_four_bar import snapping as _snapping
from tensegrity_envs.mechanics.planar_four_bar.design import JI2014, PlanarFourBarDesign

Point = tuple[Component, Component]
NO_LOAD = (0.0, 0.0)
_TINY = 1e-100


class HalfAngles(NamedTuple):
    """Sines and cosines of alpha / 2 and beta / 2."""

    sin_a: Component
    cos_a: Component
    sin_b: Component
    cos_b: Component


class ForwardSolution(NamedTuple):
    """A stable state without a load.

    Attributes:
        configuration: (theta, gamma) [rad].
        tip: position (x, y) of F [m].
        side: 1 or -1, on which side of the line CD the rectangle lies; 0 where the mechanism is flat.
    """

    configuration: Components
    tip: Point
    side: Component


class PlanarFourBar:
    """A mechanism of one design, or of a batch of designs.

    A configuration is q = (theta, gamma) [rad], the inputs are the actuator lengths (rho1, rho2) [m]. Components are
    floats, NumPy arrays or Torch tensors of any (broadcastable) shape.
    """

    input_names = ("rho1", "rho2")

    def __init__(self, design: PlanarFourBarDesign = JI2014) -> None:
        if not isinstance(design, PlanarFourBarDesign):
            raise TypeError(
                f"design = {design!r}: must be a PlanarFourBarDesign, such as tensegrity_envs.mechanics.JI2014"
            )
        self.design = design
        self.length, self.stiffness = design.length, design.stiffness

    # ------------------------------------------------------------------------------------------------ geometry

    @property
    def reach(self) -> Any:
        """An upper bound of the distance of F from A [m]: three bars, since F hangs on C and C on B."""
        return 3 * self.length

    @property
    def largest_force(self) -> Any:
        """K L [N]: the compression of the bars DE and CF in every unloaded rectangle."""
        return self.stiffness * self.length

    def _xp(self, *components: Component) -> Any:
        return namespace_of(self.length, self.stiffness, *components)

    def half_angles(self, lengths: Sequence[Component]) -> HalfAngles:
        """Of the bars AD and BC, by the cosine laws [Ji2014, Eqs. 7-10]."""
        xp = self._xp(*lengths)
        sin_b, sin_a = (rho / (2 * self.length) for rho in lengths)
        # In factors: near rho = 2 L the difference of squares would lose half of the digits.
        cos_a, cos_b = (xp.sqrt(xp.maximum((1 - s) * (1 + s), 0.0)) for s in (sin_a, sin_b))
        return HalfAngles(sin_a, cos_a, sin_b, cos_b)

    def base_angles(self, lengths: Sequence[Component]) -> tuple[Component, Component]:
        """(alpha, beta) [rad] of the bars AD and BC, both in [0, pi]."""
        xp = self._xp(*lengths)
        sin_a, cos_a, sin_b, cos_b = self.half_angles(lengths)
        return 2 * xp.atan2(sin_a, cos_a), 2 * xp.atan2(sin_b, cos_b)

    def lengths_of(self, alpha: Component, beta: Component) -> tuple[Component, Component]:
        """The actuator lengths (rho1, rho2) [m] at which the bars AD and BC have these angles [rad]."""
        xp = self._xp(alpha, beta)
        return 2 * self.length * xp.sin(beta / 2), 2 * self.length * xp.sin(alpha / 2)

    def supports(self, lengths: Sequence[Component]) -> tuple[Point, Point]:
        """Positions of C and D [m], [Ji2014, Eq. 3]."""
        sin_a, cos_a, sin_b, cos_b = self.half_angles(lengths)
        side = 2 * self.length
        return (side * sin_b * sin_b, side * sin_b * cos_b), (self.length - side * sin_a * sin_a, side * sin_a * cos_a)

    def flatness(self, lengths: Sequence[Component]) -> tuple[Component, Component]:
        """R^2 and 1 - R^2, R = |CD| / L.

        1 - R^2 = 8 sin(alpha/2) sin(beta/2) cos((alpha + beta)/2): positive exactly where rho1, rho2 > 0 and
        rho1^2 + rho2^2 < 4 L^2, and without cancellation where it is small. C and D coincide where R = 0.
        """
        sin_a, cos_a, sin_b, cos_b = self.half_angles(lengths)
        across = 2 * (sin_a * sin_a + sin_b * sin_b) - 1  # C - D in units of L; N0 of [Ji2014, Appendix A]
        along = 2 * (sin_b * cos_b - sin_a * cos_a)  # -N1
        return across * across + along * along, 8 * sin_a * sin_b * (cos_a * cos_b - sin_a * sin_b)

    def _ends(self, xp: Any, q: Sequence[Component], lengths: Sequence[Component]) -> tuple[Point, Point, Point, Point]:
        (cx, cy), (dx, dy) = self.supports(lengths)
        theta, gamma = q
        e = dx - self.length * xp.cos(theta), dy + self.length * xp.sin(theta)
        f = cx + self.length * xp.cos(gamma), cy + self.length * xp.sin(gamma)
        return (cx, cy), (dx, dy), e, f

    def tip(self, q: Sequence[Component], lengths: Sequence[Component]) -> Point:
        """Position (x, y) of F [m], [Ji2014, Eq. 5]."""
        return self._ends(self._xp(*q, *lengths), q, lengths)[3]

    def nodes(self, q: Sequence[Component], lengths: Sequence[Component]) -> dict[str, Point]:
        """Positions (x, y) of the nodes A to F [m], [Ji2014, Eqs. 3, 4]."""
        c, d, e, f = self._ends(self._xp(*q, *lengths), q, lengths)
        zero = 0.0 * f[0]
        return {"A": (zero, zero), "B": (zero + self.length, zero), "C": c, "D": d, "E": e, "F": f}

    @property
    def members(self) -> tuple[Member, ...]:
        """Four bars, three springs, and the actuators, whose lengths are the inputs (rho1, rho2)."""
        bars = [Member(f"bar {ends}", "bar", (ends[0], ends[1])) for ends in ("AD", "BC", "DE", "CF")]
        springs = [
            Member(f"spring {ends}", "spring", (ends[0], ends[1]), stiffness=self.stiffness)
            for ends in ("CE", "EF", "DF")
        ]
        actuators = [Member(f"actuator {ends}", "actuator", (ends[0], ends[1]), is_input=True) for ends in ("AC", "BD")]
        return (*bars, *springs, *actuators)

    # ------------------------------------------------------------------------------------------------- statics

    def potential_energy(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> Component:
        """Energy of the springs, less the load times the position of F [J], [Ji2014, Eq. 6].

        U / (K L^2 / 2) = 13 + 6 (cos(alpha + beta) - cos alpha - cos beta) + 4 a (cos gamma + cos theta)
        + 2 cos(theta + gamma) + 4 s (sin theta - sin gamma), a = 1 - cos alpha - cos beta, s = sin alpha - sin beta.
        The print lacks the factor 4 of the last term.
        """
        xp = self._xp(*q, *lengths, *load)
        sin_a, cos_a, sin_b, cos_b = self.half_angles(lengths)
        a, s = 2 * (sin_a * sin_a + sin_b * sin_b) - 1, 2 * (sin_a * cos_a - sin_b * cos_b)
        square = a * a + s * s
        theta, gamma = q
        # 4 + 3 R^2 is what the part without theta and gamma comes to.
        terms = 4 * a * (xp.cos(gamma) + xp.cos(theta)) + 4 * s * (xp.sin(theta) - xp.sin(gamma))
        springs = self.stiffness * self.length**2 / 2 * (4 + 3 * square + terms + 2 * xp.cos(theta + gamma))
        x, y = self.tip(q, lengths)
        return springs - load[0] * x - load[1] * y

    def statics(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> tuple[Components, tuple[Components, ...]]:
        """Gradient [N m] and Hessian [N m/rad] of the potential energy in (theta, gamma), actuators locked.

        [Ji2014, Eqs. 12, 13], whose brackets are misplaced; the load adds its moment and its geometric stiffness.
        """
        xp = self._xp(*q, *lengths, *load)
        sin_a, cos_a, sin_b, cos_b = self.half_angles(lengths)
        a, s = 2 * (sin_a * sin_a + sin_b * sin_b) - 1, 2 * (sin_a * cos_a - sin_b * cos_b)
        theta, gamma = q
        sin_t, cos_t, sin_g, cos_g = xp.sin(theta), xp.cos(theta), xp.sin(gamma), xp.cos(gamma)
        sin_sum, cos_sum = sin_t * cos_g + cos_t * sin_g, cos_t * cos_g - sin_t * sin_g
        scale = self.stiffness * self.length**2
        fx, fy = (self.length * force for force in load)
        gradient = (
            scale * (2 * (s * cos_t - a * sin_t) - sin_sum),
            scale * (-2 * (s * cos_g + a * sin_g) - sin_sum) + fx * sin_g - fy * cos_g,
        )
        coupling = -scale * cos_sum
        hessian = (
            (scale * (-2 * (s * sin_t + a * cos_t) - cos_sum), coupling),
            (coupling, scale * (2 * (s * sin_g - a * cos_g) - cos_sum) + fx * cos_g + fy * sin_g),
        )
        return gradient, hessian

    def energy_gradient(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> Components:
        """Gradient of the potential energy in (theta, gamma) [N m]; zero in equilibrium."""
        return self.statics(q, lengths, load)[0]

    def stiffness_matrix(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> tuple[Components, ...]:
        """Hessian of the potential energy in (theta, gamma) [N m/rad]: stable where it is positive definite.

        In an unloaded rectangle its eigenvalues are 2 K (L^2 - CD^2) along (1, 1) and 2 K CD^2 along (1, -1).
        """
        return self.statics(q, lengths, load)[1]

    def stability_margin(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> Component:
        """Smallest eigenvalue of the Hessian divided by K L^2; of an unloaded rectangle 2 min(R^2, 1 - R^2)."""
        (h11, h12), (_, h22) = self.stiffness_matrix(q, lengths, load)
        xp = self._xp(h11)
        smallest = (h11 + h22) / 2 - xp.hypot((h11 - h22) / 2, h12)
        return smallest / (self.stiffness * self.length**2)

    def thrusts(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> tuple[Component, Component]:
        """Forces of the actuators AC and BD [N], positive in compression: p_i = dU/drho_i - f . dF/drho_i at fixed
        theta and gamma; in an unloaded rectangle p1 = K rho2 cos(beta + alpha/2) / cos(beta/2) and
        p2 = K rho1 cos(alpha + beta/2) / cos(alpha/2), at most 2 K L. At rho_i = 2 L, where the triangle of the
        actuator is flat, it is infinite (1e100 here).
        """
        xp = self._xp(*q, *lengths, *load)
        (cx, cy), (dx, dy), (ex, ey), (fx, fy) = self._ends(xp, q, lengths)
        k = self.stiffness
        (c_x, c_y), (d_x, d_y) = self._support_rates(lengths)
        pull_c = k * (cx + 2 * (fx - ex) - dx) - load[0], k * (cy + 2 * (fy - ey) - dy) - load[1]
        pull_d = k * (2 * (ex - fx) + dx - cx), k * (2 * (ey - fy) + dy - cy)
        return pull_c[0] * c_x + pull_c[1] * c_y, pull_d[0] * d_x + pull_d[1] * d_y

    def _support_rates(self, lengths: Sequence[Component]) -> tuple[Point, Point]:
        """dC/drho1 and dD/drho2 [-]: L dbeta/drho1 = 1 / cos(beta/2) [Ji2014, Eq. 38] along the circles about B and
        A.
        """
        sin_a, cos_a, sin_b, cos_b = self.half_angles(lengths)
        xp = self._xp(sin_a, sin_b)
        cos_a, cos_b = xp.maximum(cos_a, _TINY), xp.maximum(cos_b, _TINY)  # 0 at rho_i = 2 L
        c = 2 * sin_b, (1 - 2 * sin_b * sin_b) / cos_b
        d = -2 * sin_a, (1 - 2 * sin_a * sin_a) / cos_a
        return c, d

    def member_forces(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> dict[str, Component]:
        """Axial force of every member by name [N], positive in tension, in an equilibrium."""
        n = self.nodes(q, lengths)
        k, l = self.stiffness, self.length
        p1, p2 = self.thrusts(q, lengths, load)
        xp = self._xp(p1)

        def from_to(first: str, second: str) -> Point:
            return n[second][0] - n[first][0], n[second][1] - n[first][1]

        def dot(u: Point, v: Point) -> Component:
            return u[0] * v[0] + u[1] * v[1]

        forces: dict[str, Component] = {}
        # The forces on a bar's end, along the bar, balance it; towards the inside of the bar is negative.
        ec, ef, ed = from_to("E", "C"), from_to("E", "F"), from_to("E", "D")
        forces["bar DE"] = -k * (dot(ec, ed) + dot(ef, ed)) / l
        fe, fd, fc = from_to("F", "E"), from_to("F", "D"), from_to("F", "C")
        forces["bar CF"] = -(k * (dot(fe, fc) + dot(fd, fc)) + dot((load[0], load[1]), fc)) / l
        da, db, df, de = from_to("D", "A"), from_to("D", "B"), from_to("D", "F"), from_to("D", "E")
        ca, cb, ce, cf = from_to("C", "A"), from_to("C", "B"), from_to("C", "E"), from_to("C", "F")
        forces["bar AD"] = -(k * dot(df, da) + forces["bar DE"] * dot(de, da) / l - p2 * dot(db, da) / lengths[1]) / l
        forces["bar BC"] = -(k * dot(ce, cb) + forces["bar CF"] * dot(cf, cb) / l - p1 * dot(ca, cb) / lengths[0]) / l
        for member in self.members:
            if member.kind == "spring":
                forces[member.name] = k * xp.hypot(*from_to(*member.nodes))
        return forces | {"actuator AC": -p1, "actuator BD": -p2}

    # ------------------------------------------------------------------------------------------------ kinematics

    def rectangle(self, lengths: Sequence[Component], side: Component) -> tuple[Components, Point]:
        """Configuration and tip of the unloaded rectangle on a side of the line CD. Traceable.

        F = D + side sqrt(L^2 - CD^2) rot90(u), E = C + the same, u = (C - D) / |CD|: instead of the quartic of
        [Ji2014, Eqs. 14-16]. Meaningless where the mechanism is flat (R >= 1), undefined where C and D coincide.

        Args:
            lengths: (rho1, rho2) [m].
            side: 1 or -1.
        """
        xp = self._xp(*lengths)
        (cx, cy), (dx, dy) = self.supports(lengths)
        square, rest = self.flatness(lengths)
        ux, uy = cx - dx, cy - dy
        height = side * xp.sqrt(xp.maximum(rest, 0.0) / square)  # of the rectangle, by |CD|
        ox, oy = -height * uy, height * ux
        theta = xp.atan2(uy + oy, -(ux + ox))
        gamma = xp.atan2(oy - uy, ox - ux)
        return (theta, gamma), (dx + ox, dy + oy)

    def check_lengths(self, lengths: Sequence[Component]) -> None:
        """Raise ValueError unless these are two finite actuator lengths within [0, 2 L]."""
        if len(lengths) != 2:
            raise ValueError(f"lengths = {lengths!r}: two numbers are expected, (rho1, rho2) [m]")
        for name, value in zip(self.input_names, lengths, strict=True):
            array = np.asarray(detached(value), float)
            if not np.all(np.isfinite(array) & (array >= 0) & (array <= 2 * np.asarray(self.length))):
                raise ValueError(f"{name} = {value!r}: must be within [0, 2 L] = [0, {2 * self.length!r}] m")

    def forward_kinematics(
        self, lengths: Sequence[Component], side: Component, mode: str = "rectangle"
    ) -> ForwardSolution:
        """The stable unloaded state under given actuator lengths.

        Args:
            lengths: (rho1, rho2) [m], floats or arrays.
            side: 1 or -1, on which side of the line CD the rectangle lies: both mirror images have the same energy, so
                it has to be carried along. Not used in flat mode.
            mode: "rectangle" (rho1^2 + rho2^2 < 4 L^2) or "flat" (beyond).

        Raises:
            ValueError: lengths out of [0, 2 L], a side that is neither 1 nor -1, an unknown mode, or lengths at which
                the mechanism has no stable state of this mode; the message says which.
        """
        self.check_lengths(lengths)
        square, rest = (np.asarray(v) for v in self.flatness(lengths))
        if mode == "flat":
            if not np.all(rest < 0):
                raise ValueError(
                    f"lengths = {lengths!r}: flat states are stable only for rho1^2 + rho2^2 > 4 L^2; "
                    "below, use mode='rectangle'"
                )
            q, tip = self.flat(lengths)
            return ForwardSolution(q, tip, 0 * side)
        if mode != "rectangle":
            raise ValueError(f"mode = {mode!r}: must be 'rectangle' or 'flat'")
        if not np.all(np.abs(np.asarray(side)) == 1):
            raise ValueError(f"side = {side!r}: must be 1 or -1")
        if not np.all(rest > 0):
            raise ValueError(
                f"lengths = {lengths!r}: no rectangle, all moving nodes are collinear; it needs rho1, rho2 > 0 "
                "and rho1^2 + rho2^2 < 4 L^2 (beyond, use mode='flat')"
            )
        if not np.all(square > 1e-24):
            raise ValueError(
                f"lengths = {lengths!r}: C and D coincide (singular configuration vi), where the bars CF and DE turn "
                "freely; move rho1 or rho2 away from L"
            )
        q, tip = self.rectangle(lengths, side)
        return ForwardSolution(q, tip, side)

    def flat(self, lengths: Sequence[Component]) -> tuple[Components, Point]:
        """Configuration and tip of the flat state with both bars folded inwards: F = C - L u, E = D + L u."""
        xp = self._xp(*lengths)
        (cx, cy), (dx, dy) = self.supports(lengths)
        ux, uy = cx - dx, cy - dy
        size = xp.hypot(ux, uy)
        theta, gamma = xp.atan2(uy, -ux), xp.atan2(-uy, -ux)
        return (theta, gamma), (cx - self.length * ux / size, cy - self.length * uy / size)

    def side_of(self, q: Sequence[Component], lengths: Sequence[Component]) -> Component:
        """On which side of the line CD the tip is: 1, -1, or 0 on the line (sign of (C - D) x (F - D))."""
        xp = self._xp(*q, *lengths)
        (cx, cy), (dx, dy), _, (fx, fy) = self._ends(xp, q, lengths)
        cross = (cx - dx) * (fy - dy) - (cy - dy) * (fx - dx)
        return xp.where(cross > 0, 1, xp.where(cross < 0, -1, 0))

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
        """The equilibrium that the mechanism reaches from rest at `start`, see `equilibrium.settle`.

        Args:
            lengths: (rho1, rho2) [m], each a float or an array of shape (m,).
            start: (theta, gamma) [rad].
            load: (fx, fy) [N].

        Raises:
            ValueError: lengths are out of [0, 2 L].
        """
        self.check_lengths(lengths)
        parameters = (self.design, as_components(lengths), as_components(load))
        return _equilibrium.settle(_statics, start, parameters, 4 * math.pi)

    # ---------------------------------------------------------------------------------------------- velocities

    def jacobian(
        self, lengths: Sequence[Component], side: Component
    ) -> tuple[tuple[Component, Component], tuple[Component, Component]]:
        """d(x, y) / d(rho1, rho2) of the unloaded rectangle [-]: two rows, [Ji2014, Eqs. 27-38].

        By differentiating F = D + side h rot90(C - D), h = sqrt(L^2 / CD^2 - 1); not finite where C and D coincide
        and where the mechanism becomes flat, h = 0. Of flat or loaded states: `tip_jacobian`.

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
                "tip_jacobian(q, lengths) is that of other states"
            )
        vx, vy = cx - dx, cy - dy
        height = side * xp.sqrt(rest / square)
        fall = -side / (square * xp.sqrt(rest * square) * self.length**2)  # d height / d (CD^2 / 2)

        def rate(ux: Component, uy: Component) -> Point:
            change = fall * (vx * ux + vy * uy)
            return -change * vy - height * uy, change * vx + height * ux

        (x1, y1), (x2, y2) = rate(c1, c2), rate(-d1, -d2)
        return (x1, x2 + d1), (y1, y2 + d2)

    def singularity(self, lengths: Sequence[Component], side: Component) -> Component:
        """det J of the unloaded rectangle [-], [Ji2014, Eq. 40] with Phi3 corrected."""
        (j11, j12), (j21, j22) = self.jacobian(lengths, side)
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

    def tip_jacobian(
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

    # --------------------------------------------------------------------------------------------------- loads

    def compliance(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> tuple[Components, Components]:
        """dF / d load with the actuators locked [m/N], of rank one: F can only turn about C.

        Along that circle it is `tangential_compliance`; in an unloaded rectangle 1 / (4 K R^2 (1 - R^2)).
        """
        size = self.tangential_compliance(q, lengths, load)
        xp = self._xp(*q)
        tx, ty = -xp.sin(q[1]), xp.cos(q[1])
        return (size * tx * tx, size * tx * ty), (size * tx * ty, size * ty * ty)

    def tangential_compliance(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> Component:
        """Displacement of F per force along its circle about C, actuators locked [m/N]."""
        (h11, h12), (_, h22) = self.stiffness_matrix(q, lengths, load)
        return self.length**2 * h11 / (h11 * h22 - h12 * h12)

    def energy_barrier(self, lengths: Sequence[Component]) -> Component:
        """Energy from an unloaded rectangle to the lowest saddle on the way to its mirror image [J]:
        2 K L^2 min(R^2, (1 - R)^2), at most K L^2 / 2; zero where the mechanism is flat.
        """
        square, rest = self.flatness(lengths)
        xp = self._xp(square)
        size = xp.sqrt(square)
        fold = xp.maximum(rest, 0.0) / (1 + size)  # 1 - R
        return 2 * self.stiffness * self.length**2 * xp.minimum(square, fold * fold)

    def critical_load(self, lengths: Sequence[float], side: int, direction: Sequence[float]) -> float:
        """The dead force on F in a direction at which the rectangle snaps [N]; see `snapping.critical_load`."""
        return _snapping.critical_load(self, lengths, side, direction)


def _statics(q: Components, parameters: Any) -> tuple[Components, tuple[Components, ...]]:
    design, lengths, load = parameters
    return PlanarFourBar(design).statics(q, lengths, load)
