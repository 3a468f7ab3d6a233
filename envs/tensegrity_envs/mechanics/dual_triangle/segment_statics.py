"""One dual-triangle: two triangles with a common pivot, two springs that turn one against the other.

[Zhao2021] Zhao, Pashkevich, Klimchik, Chablat, "Kinematic control of compliant serial manipulators composed of
dual-triangles", ICCCR 2021. Misprints are named where they matter; docs/dual_triangle.md lists every one.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Namespace, is_symbol, namespace_of
from tensegrity_envs.mechanics.design import Index, take
from tensegrity_envs.mechanics.dual_triangle.design import ZHAO2021_CAPTION, DualTriangleDesign

# Added to cos(theta/2), which no rounded angle makes smaller than 1e-17 unless it is exactly 0: changes nothing else.
_NOT_ZERO = 1e-30


class Spring(NamedTuple):
    """A spring's length [m], its moment arm h about the pivot [m], and dh/dtheta [m/rad], theta its angle in Eq. 1."""

    length: Component
    arm: Component
    arm_slope: Component


Springs = tuple[Spring, Spring]


class SegmentStatics:
    """The statics of one segment of a design, or of a batch of designs.

    q [rad] is the angle of the moving triangle, counter-clockwise; free lengths are (spring 1, spring 2) [m]; a moment
    [N m] is what acts on the moving triangle from outside, counter-clockwise. Components are floats, NumPy arrays or
    Torch tensors.
    """

    def __init__(self, design: DualTriangleDesign = ZHAO2021_CAPTION) -> None:
        self.design = design
        a1, b1, a2, b2 = design.a1, design.b1, design.a2, design.b2
        # The one component that tells floats from arrays when a batch of designs meets a single angle.
        self._probe: Component = sum(v for v in vars(design).values() if isinstance(v, np.ndarray) or is_symbol(v))
        xp = namespace_of(self._probe, a1, b1, a2, b2)
        c1, c2 = xp.hypot(a1, b1), xp.hypot(a2, b2)
        self._gg = c1 * c2
        self._d = ((a1 - a2) * (a1 + a2) + (b1 - b2) * (b1 + b2)) / (c1 + c2)  # c1 - c2 without its cancellation
        self._equal = not is_symbol(self._d) and bool(np.all(self._d == 0))
        self._cos = xp.cos(design.beta12 / 2)
        self._sin = xp.sin(design.beta12 / 2)
        self._root = 2 * xp.sqrt(self._gg)
        self.stiffness_scale = (design.k1 + design.k2) * b1 * b2 / 2  # [N m/rad]; k b^2 of a symmetric segment

    def take(self, index: Index) -> Self:
        """The segments at `index` of a batch of designs; itself where there is one design only."""
        return take(self, index)

    def _xp(self, *components: Component) -> Namespace:
        return namespace_of(self._probe, *components)

    # ------------------------------------------------------------------------------------------------- geometry

    def springs(self, xp: Namespace, q: Component) -> Springs:
        """Both springs at the angle q, the namespace given."""
        return self.springs_at(xp, xp.sin(q / 2), xp.cos(q / 2))

    def springs_at(self, xp: Namespace, s: Component, c: Component) -> Springs:
        """Lengths and moment arms of both springs from sin(q/2), cos(q/2); accurate down to coinciding ends.

        With theta_1 = beta12 + q, theta_2 = beta12 - q and u = cos(theta/2), a spring between corners at distances c1,
        c2 from the pivot has L^2 = (c1 - c2)^2 + 4 c1 c2 u^2 and the moment arm h = c1 c2 sin(theta) / L = -dL/dtheta.
        [Zhao2021, Eq. 1] divides by a root that loses all digits at theta = pi where c1 = c2; half angles do not.
        """
        return (
            self._spring(xp, self._cos * c - self._sin * s, self._sin * c + self._cos * s),
            self._spring(xp, self._cos * c + self._sin * s, self._sin * c - self._cos * s),
        )

    def _spring(self, xp: Namespace, u: Component, s: Component) -> Spring:
        if self._equal:  # no root, and smooth beyond the stop, where the length is negative
            return Spring(self._root * u, self._root / 2 * s, self._root / 4 * u)
        u = u + _NOT_ZERO
        gg, d, gu = self._gg, self._d, self._root * u
        square = d * d + gu * gu
        length = xp.sqrt(square)
        arm = 2 * gg * s * u / length
        # dh/dtheta = c1 c2 cos(theta) / L + h^2 / L, brought to one fraction: the two terms cancel as L goes to 0
        return Spring(length, arm, gg * ((u * u - s * s) * d * d + gu * gu * u * u) / (length * square))

    def spring_lengths(self, q: Component) -> tuple[Component, Component]:
        """Lengths of spring 1 (on the +y side) and spring 2 [m]."""
        first, second = self.springs(self._xp(q), q)
        return first.length, second.length

    def moment_arms(self, q: Component) -> tuple[Component, Component]:
        """h1, h2 [m]: spring i's tension F_i turns the moving triangle by M1 = F1 h1, M2 = -F2 h2.

        [Zhao2021, section II] prints "M1 = F1 h1, M1 = F2 h2".
        """
        first, second = self.springs(self._xp(q), q)
        return first.arm, second.arm

    # -------------------------------------------------------------------------------------------------- statics

    def _tensions(
        self, xp: Namespace, springs: Springs, free_lengths: Sequence[Component]
    ) -> tuple[Component, Component]:
        f1 = self.design.k1 * (springs[0].length - free_lengths[0])
        f2 = self.design.k2 * (springs[1].length - free_lengths[1])
        if self.design.springs == "cable":
            return xp.maximum(f1, 0.0), xp.maximum(f2, 0.0)
        return f1, f2

    @staticmethod
    def _taut(xp: Namespace, tension: Component, k: Component) -> Component:
        """The stiffness of a cable, 0 where it is slack; in the precision of the tension (Torch's own is single)."""
        return xp.where(tension > 0, k + 0.0 * tension, 0.0)

    def spring_forces(self, q: Component, free_lengths: Sequence[Component]) -> tuple[Component, Component]:
        """Tensions of both springs [N]; negative where a bilateral spring pushes."""
        xp = self._xp(q, *free_lengths)
        return self._tensions(xp, self.springs(xp, q), free_lengths)

    def spring_torques(self, q: Component, free_lengths: Sequence[Component]) -> tuple[Component, Component]:
        """M1, M2 [N m]: torque of each spring on the moving triangle, counter-clockwise, [Zhao2021, Eq. 1]."""
        xp = self._xp(q, *free_lengths)
        springs = self.springs(xp, q)
        f1, f2 = self._tensions(xp, springs, free_lengths)
        return f1 * springs[0].arm, -(f2 * springs[1].arm)

    def energy_of(self, xp: Namespace, springs: Springs, free_lengths: Sequence[Component]) -> Component:
        """`potential_energy` with the namespace and the springs given."""
        f1, f2 = self._tensions(xp, springs, free_lengths)
        return f1 * f1 / (2 * self.design.k1) + f2 * f2 / (2 * self.design.k2)

    def potential_energy(self, q: Component, free_lengths: Sequence[Component]) -> Component:
        """Energy of both springs [J]."""
        xp = self._xp(q, *free_lengths)
        return self.energy_of(xp, self.springs(xp, q), free_lengths)

    def slope_and_stiffness(
        self, xp: Namespace, springs: Springs, free_lengths: Sequence[Component]
    ) -> tuple[Component, Component]:
        """dU/dq [N m] and d2U/dq2 [N m/rad] in one evaluation, the namespace and the springs given."""
        first, second = springs
        f1, f2 = self._tensions(xp, springs, free_lengths)
        k1, k2 = self.design.k1, self.design.k2
        if self.design.springs == "cable":
            k1, k2 = self._taut(xp, f1, k1), self._taut(xp, f2, k2)
        return (
            f2 * second.arm - f1 * first.arm,
            k1 * first.arm * first.arm - f1 * first.arm_slope + k2 * second.arm * second.arm - f2 * second.arm_slope,
        )

    def torque(self, q: Component, free_lengths: Sequence[Component]) -> Component:
        """M(q) = -dU/dq [N m], which the springs exert on the moving triangle, [Zhao2021, Eqs. 1, 3]."""
        xp = self._xp(q, *free_lengths)
        return -self.slope_and_stiffness(xp, self.springs(xp, q), free_lengths)[0]

    def stiffness(self, q: Component, free_lengths: Sequence[Component]) -> Component:
        """K(q) = -dM/dq [N m/rad], positive where an equilibrium is stable.

        For a symmetric segment it is -2 k [(b^2 - a^2) cos q - (L10 L1 + L20 L2) / 8].
        """
        xp = self._xp(q, *free_lengths)
        return self.slope_and_stiffness(xp, self.springs(xp, q), free_lengths)[1]

    # -------------------------------------------------------------------------------------------------- control

    def free_lengths(self, delta: Component, common: Component = 0.0) -> tuple[Component, Component]:
        """Free lengths [m] under the control input: L10 = L0 + common - delta, L20 = L0 + common + delta.

        Args:
            delta: control input [m]; delta > 0 turns towards q > 0.
            common: added to both nominal free lengths [m]: co-contraction where negative. On bilateral springs, which
                push, *longer* free lengths are the stiffer ones.
        """
        return self.design.free_length1 + common - delta, self.design.free_length2 + common + delta

    def control(self, q: Component, moment: Component = 0.0, common: Component = 0.0) -> Component:
        """The control input delta [m] that holds the angle q against a moment [N m].

        The torque is linear in delta, so for any segment delta = -(M(q; delta = 0) + moment) / (k1 h1 + k2 h2). For a
        symmetric one that is [L0 b sin(q/2) - (b^2 - a^2) sin q - moment / (2 k)] / (a cos(q/2)), [Zhao2021, Eq. 4];
        Eq. 5 prints the moment with the opposite sign, which doubles the load instead of carrying it.

        Of cables, one alone carries what both in tension cannot; without a moment both may be slack, equally so. Beyond
        |q| = beta12, inside the stops only if a < b, both cables turn the same way: the one with the longer moment arm
        carries what both in tension cannot, or is just taut where the torque left over is then the smallest.
        """
        xp = self._xp(q, moment, common)
        return self.control_of(xp, self.springs(xp, q), moment, common)

    def control_of(self, xp: Namespace, springs: Springs, moment: Component, common: Component) -> Component:
        """`control` with the namespace and the springs given."""
        first, second = springs
        l10, l20 = self.free_lengths(0.0, common)
        t1, t2 = self.design.k1 * first.arm, self.design.k2 * second.arm
        s1, s2 = first.length - l10, second.length - l20
        delta = (t2 * s2 - t1 * s1 - moment) / (t1 + t2)
        if self.design.springs != "cable":
            return delta
        moment = moment + 0.0 * delta  # an array or tensor where delta is one
        against = xp.where(moment > 0, s2 - moment / t2, xp.where(moment < 0, -moment / t1 - s1, (s2 - s1) / 2))
        both = xp.maximum(s1 + s2, 0.0)  # times the shorter arm: the least torque that two cables can exert
        by_first = xp.where(-moment >= -t2 * both, xp.maximum(-moment / t1, 0.0), 0.0) - s1
        by_second = s2 - xp.where(moment >= -t1 * both, xp.maximum(moment / t2, 0.0), 0.0)
        alone = xp.where(t1 * t2 > 0, against, xp.where(t1 > t2, by_first, by_second))
        return xp.where(xp.minimum(s1 + delta, s2 - delta) >= 0, delta, alone)

    def sensitivity(self, q: Component, moment: Component = 0.0, common: Component = 0.0) -> Component:
        """Sensitivity d delta / dq [m/rad] of `control` at a constant moment.

        The stiffness at the commanded angle divided by k1 h1 + k2 h2: it has the stiffness's sign. [Zhao2021, figure 3]
        plots a "sensitivity" that its text does not define. NaN where both cables are slack.
        """
        xp = self._xp(q, moment, common)
        first, second = springs = self.springs(xp, q)
        inputs = self.free_lengths(self.control_of(xp, springs, moment, common), common)
        k1, k2 = self.design.k1, self.design.k2
        if self.design.springs == "cable":
            f1, f2 = self._tensions(xp, springs, inputs)
            k1, k2 = self._taut(xp, f1, k1), self._taut(xp, f2, k2)
        leverage = k1 * first.arm + k2 * second.arm
        stiffness = self.slope_and_stiffness(xp, springs, inputs)[1]
        return xp.where(leverage != 0, stiffness / xp.where(leverage != 0, leverage, 1.0), math.nan)

    @property
    def delta_range(self) -> tuple[Component, Component]:
        """Smallest and largest control input [m] at which no free length is negative."""
        return -self.design.free_length2, self.design.free_length1

    def is_tensile(self, q: Component, free_lengths: Sequence[Component]) -> Component:
        """Whether both springs are in tension. Unloaded and symmetric: just if L0 < 2 b cos(q/2), for |q| < beta12."""
        xp = self._xp(q, *free_lengths)
        first, second = self.springs(xp, q)
        return (first.length > free_lengths[0]) & (second.length > free_lengths[1])
