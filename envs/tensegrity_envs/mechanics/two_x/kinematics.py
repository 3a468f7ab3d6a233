"""Kinematics of the 2-X manipulator: nodes, members, tip, Jacobian, cable lengths and joint limits."""

import math
from collections.abc import Sequence
from typing import Self

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, Namespace, is_symbol, namespace_of
from tensegrity_envs.mechanics.design import Index, Member, check_design, take
from tensegrity_envs.mechanics.two_x.design import MURALIDHARAN2022, TwoXDesign
from tensegrity_envs.mechanics.x_joints.curve import Geometry
from tensegrity_envs.mechanics.x_joints.joint import Bars, Joint, joint_at

_BARS = "A1 C1, B1 D1, D1 C1, D1 A2, D1 B2, C1 B2, A2 B2, A2 C2, B2 D2, D2 C2, D2 P, C2 P"


class TwoXKinematics:
    """Geometry of a design, or of a batch of designs."""

    degrees_of_freedom = 2
    input_names = ("left 1", "right 1", "left 2", "right 2")

    def __init__(self, design: TwoXDesign = MURALIDHARAN2022) -> None:
        check_design(design, TwoXDesign, "MURALIDHARAN2022")
        self.design = design
        b, l, a, g = design.b, design.l, design.a, design.gravity
        half = (a * a + b * b / 4) ** 0.5
        brace = (a * a + b * b) ** 0.5
        line = design.bar_density * math.pi * design.bar_radius**2  # mass per length [kg/m]
        self._lengths = (l, l, b, a, brace, a, b, l, l, b, half, half)  # [Muralidharan2022, figure 2]
        m = [line * length for length in self._lengths]
        # Gravity's energy is a sum of weights times the heights of four vectors: base to top of joint 1, its offset,
        # base to top of joint 2, its offset (see `_statics`).
        beyond_2 = m[9] + m[10] + m[11] + design.payload  # carried by the top of joint 2
        beyond_1 = m[6] + m[7] + m[8] + beyond_2  # carried by the end of offset 1
        self._w1 = g * ((m[0] + m[1]) / 2 + m[2] + m[3] + m[4] + m[5] + beyond_1)
        self._h1 = g * ((m[3] + m[4] + m[5]) / 2 + beyond_1)
        self._w2 = g * ((m[7] + m[8]) / 2 + beyond_2)
        self._h2 = g * ((m[10] + m[11]) / 2 + design.payload)
        self._masses = m
        self._bb = b * b
        self._excess = (l - b) * (l + b)
        self._spring1 = design.k1 * b * b
        self._spring2 = design.k2 * b * b
        self.stiffness_scale = self._spring1 + (design.k1 == 0) * design.max_tension * b  # [N m/rad]
        # The one component that tells floats from arrays when a batch of designs meets a single configuration.
        self._probe: Component = sum(
            value for value in vars(design).values() if isinstance(value, np.ndarray) or is_symbol(value)
        )  # 0 for a single design

    def take(self, index: Index) -> Self:
        """The mechanisms at `index` of a batch of designs; itself where there is one design only."""
        return take(self, index)

    @property
    def bars(self) -> tuple[Bars, Bars]:
        """Those of both joints, which are alike."""
        bars = Bars(self.design.b, self.design.l, self.design.a)
        return bars, bars

    @property
    def geometry(self) -> Geometry:
        """See `x_joints.curve.Pair`."""
        design: TwoXDesign = object.__new__(TwoXDesign)
        lengths = {name: np.array([getattr(self.design, name)], float) for name in ("b", "l", "a")}
        vars(design).update(dict.fromkeys(vars(self.design), 1.0) | lengths)
        return TwoXKinematics, design

    @property
    def reach(self) -> Component:
        """An upper bound of the tip's distance from the base [m]."""
        return 2 * (self.design.l + self.design.a)

    def _joint(self, xp: Namespace, alpha: Component) -> Joint:
        return self._joint_at(xp, xp.sin(alpha / 2), xp.cos(alpha / 2))

    def _joint_at(self, xp: Namespace, s: Component, c: Component) -> Joint:
        return joint_at(xp, self.design.b, self._excess, s, c)

    def _xp(self, *components: Component) -> Namespace:
        return namespace_of(self._probe, *components)

    def tip(self, q: Sequence[Component], inputs: Sequence[Component] | None = None) -> tuple[Component, Component]:
        """Tip position (x, y) [m], [Muralidharan2022, Eq. 1]."""
        xp = self._xp(*q)
        return self._tip(self._joint(xp, q[0]), self._joint(xp, q[1]))

    def _tip(self, j1: Joint, j2: Joint) -> tuple[Component, Component]:
        a = self.design.a
        sin_a1, cos_a1, s12, c12, end_s, end_c = directions(j1, j2)
        return (
            -(j1.r * j1.s + a * (sin_a1 + end_s) + j2.r * s12),
            j1.r * j1.c + a * (cos_a1 + end_c) + j2.r * c12,
        )

    def jacobian(
        self, q: Sequence[Component], inputs: Sequence[Component] | None = None, load: Sequence[Component] | None = None
    ) -> tuple[tuple[Component, Component], tuple[Component, Component]]:
        """d tip / d alpha [m/rad]: ((dx/da1, dx/da2), (dy/da1, dy/da2))."""
        xp = self._xp(*q)
        a1, a2 = q
        j1, j2 = self._joint(xp, a1), self._joint(xp, a2)
        a = self.design.a
        s12, c12 = xp.sin(a1 + a2 / 2), xp.cos(a1 + a2 / 2)
        end_s, end_c = a * xp.sin(a1 + a2), a * xp.cos(a1 + a2)
        return (
            (
                -(j1.dr * j1.s + j1.r * j1.c / 2 + a * xp.cos(a1) + j2.r * c12 + end_c),
                -(j2.dr * s12 + j2.r * c12 / 2 + end_c),
            ),
            (
                j1.dr * j1.c - j1.r * j1.s / 2 - a * xp.sin(a1) - j2.r * s12 - end_s,
                j2.dr * c12 - j2.r * s12 / 2 - end_s,
            ),
        )

    def jacobian_determinant(
        self, q: Sequence[Component], inputs: Sequence[Component] | None = None, load: Sequence[Component] | None = None
    ) -> Component:
        """det J with respect to alpha [m2/rad2]; zero where the inverse solutions meet.

        Equal to [Muralidharan2022, Eq. 3] divided by 4 l_1 l_2, once the radical of its first term is read in alpha_1.
        """
        (xa, xb), (ya, yb) = self.jacobian(q)
        return xa * yb - xb * ya

    def nodes(
        self, q: Sequence[Component], inputs: Sequence[Component] | None = None
    ) -> dict[str, tuple[Component, Component]]:
        """Positions (x, y) [m] of the nodes: Ai, Bi base left, right; Di, Ci top left, right of joint i; P tip."""
        xp = self._xp(*q)
        a1, a2 = q
        a, half = self.design.a, self.design.b / 2
        zero = 0.0 * (a1 + a2)
        nodes: dict[str, tuple[Component, Component]] = {}
        x, y, turn = zero, zero, zero
        for i, alpha in ((1, a1), (2, a2)):
            joint = self._joint(xp, alpha)
            cos, sin = half * xp.cos(turn), half * xp.sin(turn)
            nodes[f"A{i}"], nodes[f"B{i}"] = (x - cos, y - sin), (x + cos, y + sin)
            x, y = x - joint.r * xp.sin(turn + alpha / 2), y + joint.r * xp.cos(turn + alpha / 2)
            turn = turn + alpha
            cos, sin = half * xp.cos(turn), half * xp.sin(turn)
            nodes[f"D{i}"], nodes[f"C{i}"] = (x - cos, y - sin), (x + cos, y + sin)
            x, y = x - a * xp.sin(turn), y + a * xp.cos(turn)
        nodes["P"] = (x, y)
        return nodes

    @property
    def members(self) -> tuple[Member, ...]:
        """Bars with their masses, springs and cables (drawn along the lateral sides that they span)."""
        sides = (("left 1", "A1 D1"), ("right 1", "B1 C1"), ("left 2", "A2 D2"), ("right 2", "B2 C2"))

        def pair(text: str) -> tuple[str, str]:
            first, second = text.split()
            return first, second

        bars = [
            Member(f"bar {i + 1}", "bar", pair(text), mass=self._masses[i], radius=self.design.bar_radius)
            for i, text in enumerate(_BARS.split(", "))
        ]
        springs = [
            Member(f"spring {name}", "spring", pair(text), stiffness=self.design.k1 if i < 2 else self.design.k2)
            for i, (name, text) in enumerate(sides)
        ]
        return (*bars, *springs, *(Member(f"cable {name}", "cable", pair(text)) for name, text in sides))

    def cable_lengths(self, q: Sequence[Component]) -> Components:
        """Lengths of the lateral sides (left 1, right 1, left 2, right 2) [m]: what cables and springs span.

        left * right = l^2 - b^2, so the shorter one is taken from the longer one: accurate close to the flat poses.
        """
        xp = self._xp(*q)
        sides: list[Component] = []
        for alpha in q:
            sides += self._joint(xp, alpha).sides(xp)
        return tuple(sides)

    def is_within_limits(self, q: Sequence[Component]) -> Component:
        """Whether both joints are within the joint limits."""
        limit = self.design.joint_limit
        return (abs(q[0]) <= limit) & (abs(q[1]) <= limit)


def directions(j1: Joint, j2: Joint) -> tuple[Component, ...]:
    """Sine and cosine of the orientations of offset 1, of joint 2's middle line and of offset 2."""
    sin_a1, cos_a1 = 2 * j1.s * j1.c, j1.c * j1.c - j1.s * j1.s
    s12, c12 = sin_a1 * j2.c + cos_a1 * j2.s, cos_a1 * j2.c - sin_a1 * j2.s
    return sin_a1, cos_a1, s12, c12, s12 * j2.c + c12 * j2.s, c12 * j2.c - s12 * j2.s
