"""Kinematics of the planar 4-bar mechanism: nodes, members, and the unloaded rectangle and flat states."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, Namespace, detached, namespace_of
from tensegrity_envs.mechanics.design import Member, check_design
from tensegrity_envs.mechanics.planar_four_bar.design import JI2014, PlanarFourBarDesign

Point = tuple[Component, Component]
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


class FourBarKinematics:
    """Geometry of a mechanism of one design, or of a batch of designs."""

    input_names = ("rho1", "rho2")

    def __init__(self, design: PlanarFourBarDesign = JI2014) -> None:
        check_design(design, PlanarFourBarDesign, "JI2014")
        self.design = design
        self.length, self.stiffness = design.length, design.stiffness

    @property
    def reach(self) -> Component:
        """An upper bound of the distance of F from A [m]: three bars, since F hangs on C and C on B."""
        return 3 * self.length

    @property
    def largest_force(self) -> Component:
        """K L [N]: the compression of the bars DE and CF in every unloaded rectangle."""
        return self.stiffness * self.length

    def _xp(self, *components: Component) -> Namespace:
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

    def _ends(
        self, xp: Namespace, q: Sequence[Component], lengths: Sequence[Component]
    ) -> tuple[Point, Point, Point, Point]:
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
