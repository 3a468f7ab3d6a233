"""One dual-triangle: its equilibria, where it is bistable, and the limits of its control law."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics import equilibrium as _equilibrium
from tensegrity_envs.mechanics.checks import check_finite, check_single, sized
from tensegrity_envs.mechanics.dual_triangle import one_segment
from tensegrity_envs.mechanics.dual_triangle.segment_statics import SegmentStatics


class Fold(NamedTuple):
    """Where two equilibria of a bistable segment meet and vanish: the control input [m] and the angle [rad]."""

    delta: float
    angle: float


@sized(free_lengths=(2, "spring 1, spring 2"))
class DualTriangleSegment(SegmentStatics):
    """The statics of one segment of a design, or of a batch of designs.

    q [rad] is the angle of the moving triangle, counter-clockwise; free lengths are (spring 1, spring 2) [m]; a moment
    [N m] is what acts on the moving triangle from outside, counter-clockwise. Components are floats, NumPy arrays or
    Torch tensors.
    """

    def equilibria(self, free_lengths: Sequence[float], moment: float = 0.0) -> list[_equilibrium.Equilibrium]:
        """All equilibria strictly inside the joint limits, stable and unstable, ascending.

        Exact up to rounding: stiffness is bounded on every interval that is not subdivided further, so that the torque
        is proved monotone or without a zero there (`one_segment.roots`). A double root, at a fold, is given once, as
        unstable. Where both cables are slack and there is no moment, every angle of an interval is in equilibrium: the
        middle of the interval is given, as unstable.

        Args:
            free_lengths: (spring 1, spring 2) [m].
            moment: from outside on the moving triangle [N m].

        Returns:
            Configurations (q,) [rad], residuals [N m], whether stable, and the reason in words.

        Raises:
            ValueError: a number is not finite, or the segment is a batch of designs.
        """
        check_single(self._probe, "equilibria")
        check_finite("free_lengths", free_lengths, 2)
        check_finite("moment", (moment,), 1)
        found = []
        for q in one_segment.roots(self, (float(free_lengths[0]), float(free_lengths[1])), float(moment)):
            stiffness = self.stiffness(q, free_lengths)
            stable = stiffness > 1e-9 * self.stiffness_scale
            reason = "stable" if stable else "unstable: the stiffness is not positive"
            residual = abs(self.torque(q, free_lengths) + moment)
            found.append(_equilibrium.Equilibrium((q,), residual, stable, reason))
        return found

    @property
    def monotone_threshold(self) -> Component:
        """2 b (1 - (a/b)^2) [m]: with delta = 0 the torque is monotone just if L0 is larger, [Zhao2021, Eq. 2].

        Proved for the whole range of angles, but for delta = 0 and symmetric segments only; see `is_monotone`.

        Raises:
            ValueError: the segment is not symmetric.
        """
        self._require_symmetric("monotone_threshold")
        a, b = self.design.a1, self.design.b1
        return 2 * (b - a) * (b + a) / b

    def is_monotone(self, free_lengths: Sequence[float] | None = None) -> bool:
        """Whether the torque falls strictly on the whole range of angles, so that there is one equilibrium at most.

        Without free lengths: at the nominal ones. Decided by bounds of the stiffness on subdivided intervals.

        Raises:
            ValueError: a number is not finite, or the segment is a batch of designs.
        """
        check_single(self._probe, "is_monotone")
        lengths = self.free_lengths(0.0) if free_lengths is None else free_lengths
        check_finite("free_lengths", lengths, 2)
        return one_segment.is_monotone(self, (float(lengths[0]), float(lengths[1])))

    @property
    def wells(self) -> tuple[float, float] | None:
        """The two stable angles [rad] of an unloaded symmetric segment at delta = 0, None where q = 0 is stable.

        cos(q/2) = L0 b / (2 (b^2 - a^2)). They lie inside the joint limits only if L0 > `well_threshold`: otherwise
        None too, although q = 0 is unstable; the segment rests on a stop.

        Raises:
            ValueError: the segment is not symmetric, or is a batch of designs.
        """
        check_single(self._probe, "wells")
        if not self.design.free_length1 < self.monotone_threshold:
            return None
        angle = 2 * float(np.arccos(self.design.free_length1 / self.monotone_threshold))
        return (-angle, angle) if angle < self.design.joint_limit else None

    @property
    def well_threshold(self) -> float:
        """2 a (b^2 - a^2) / (b c) [m]: the wells of a symmetric segment lie inside its stops if L0 is larger."""
        self._require_symmetric("well_threshold")
        a, b = self.design.a1, self.design.b1
        return float(self.monotone_threshold * a / np.hypot(a, b))

    @property
    def fold(self) -> Fold | None:
        """Where bistability of an unloaded symmetric segment ends: three equilibria for |delta| < fold.delta.

        cos^3(q/2) = L0 b / (2 (b^2 - a^2)), delta = 2 (b^2 - a^2) / a sin^3(q/2); mirrored for the other sign: the
        fold at q = fold.angle > 0 has the input -fold.delta. None where the segment is not bistable.

        Raises:
            ValueError: the segment is not symmetric, or is a batch of designs.
        """
        check_single(self._probe, "fold")
        if not self.design.free_length1 < self.monotone_threshold:
            return None
        ratio = self.design.free_length1 / self.monotone_threshold
        angle = 2 * float(np.arccos(ratio ** (1 / 3)))
        a, b = self.design.a1, self.design.b1
        return Fold(float(2 * (b - a) * (b + a) / a * np.sin(angle / 2) ** 3), angle)

    @property
    def control_limit(self) -> float:
        """The angle [rad] up to which (from 0) both free lengths of the unloaded control law stay zero or more.

        At most the joint limit. Of a segment that is not symmetric: the smaller of the limits to both sides.

        Raises:
            ValueError: the segment is a batch of designs.
        """
        check_single(self._probe, "control_limit")
        return one_segment.control_limit(self)

    def _require_symmetric(self, what: str) -> None:
        if not self.design.is_symmetric:
            raise ValueError(f"{what} is defined for symmetric segments; this one is {self.design!r}")
