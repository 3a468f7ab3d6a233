"""The planar 2-X manipulator: two anti-parallelogram (X) joints in series, springs, four cables, optional offsets.

Sources: [Furet2018] Furet and Wenger, "Workspace and cuspidality analysis of a 2-X planar manipulator", 2018;
[Muralidharan2022] Muralidharan, "Stable wrench-feasible workspace of a 2-X tensegrity manipulator", 2022, hal-03670867.
Where a printed equation is wrong the docstring says so; docs/two_x.md lists every correction.

Conventions: alpha_i [rad] is the orientation of joint i's top bar relative to its base bar, counter-clockwise, so that
alpha > 0 moves the tip towards -x. The crossed assembly is symmetric: the line between the midpoints of base and top
bar is turned by theta_i = alpha_i / 2. On the full torus alpha runs over (-2 pi, 2 pi]; |alpha| < pi is the joint
"up", beyond it "down". Tensions are ordered left 1, right 1, left 2, right 2. The cables of joint 2 are strut-routed,
so they do no work on alpha_1.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, as_components, is_batch, is_symbol, namespace_of
from tensegrity_envs.mechanics import equilibrium as _equilibrium
from tensegrity_envs.mechanics.checks import check_finite
from tensegrity_envs.mechanics.design import Member, require, require_finite_numbers, take
from tensegrity_envs.mechanics.polynomials import product, real_roots
from tensegrity_envs.mechanics.roots import circle_roots
from tensegrity_envs.mechanics.stiffness import TipStiffness

_NO_LOAD = (0.0, 0.0)
_FLATTEST = 1 - 1e-9  # |sin(alpha/2)| at which a joint counts as flat
_FULL_TURN = 4 * math.pi  # of alpha, since theta = alpha / 2 runs once around
_BARS = "A1 C1, B1 D1, D1 C1, D1 A2, D1 B2, C1 B2, A2 B2, A2 C2, B2 D2, D2 C2, D2 P, C2 P"
_NEARLY_SINGULAR = 2e-3  # 1 - (b/l)^2, where the polynomial is not enough
_VALLEY = 4e-15  # of the reach: tips of nearly equal bars that are no further apart are the same but for rounding
_GRID = 25  # starts along each joint, for nearly equal bars
_ROUNDING = 1e-6  # [rad] by which rounding may carry a double root beyond a joint limit
_SAMPLES = 16  # of the trigonometric polynomial of the inverse kinematics; 9 would determine it


def _samples_to_polynomial() -> np.ndarray:
    """The matrix from samples of a trigonometric polynomial of order 4 at pi + 2 pi j / 16 to p_0 ... p_8.

    With t = tan(omega/2) the trigonometric polynomial is (p_0 + ... + p_8 t^8) / (1 + t^2)^4.
    """
    half = (math.pi + np.arange(_SAMPLES) * (2 * math.pi / _SAMPLES)) / 2
    power = np.arange(9)
    return np.linalg.pinv(np.sin(half)[:, None] ** power * np.cos(half)[:, None] ** (8 - power)).T


_SAMPLES_TO_POLYNOMIAL = _samples_to_polynomial()


@dataclass(frozen=True)
class TwoXDesign:
    """Parameters of a 2-X manipulator. A field may be an array of shape (n,): a batch of designs.

    Attributes:
        b: length of base and top bars [m].
        l: length of the crossed bars [m], l > b.
        a: length of the offset after each joint [m], 0 for none.
        k1: stiffness of *each* of joint 1's two springs (zero free length) [N/m].
        k2: the same for joint 2 [N/m].
        min_tension: lower bound of every cable tension [N].
        max_tension: upper bound of every cable tension [N].
        payload: point mass at the tip [kg].
        bar_density: density of the bars [kg/m3].
        bar_radius: radius of the bars, solid cylinders [m].
        gravity: gravitational acceleration, towards -y [m/s2].
        joint_limit: |alpha_i| is at most this [rad]; pi excludes the flat poses, 2 pi is the full torus.
    """

    b: Any
    l: Any
    a: Any
    k1: Any
    k2: Any
    min_tension: Any
    max_tension: Any
    payload: Any = 0.0
    bar_density: Any = 2700.0
    bar_radius: Any = 0.005
    gravity: Any = 9.8
    joint_limit: float = math.pi

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            TypeError: a field is not a number.
            ValueError: a field is outside its range; the message names field and value.
        """
        require_finite_numbers(self)
        name = type(self).__name__
        require(self.b > 0, name, "b", self.b, "positive")
        require(
            self.l > self.b, name, "l", self.l, f"greater than b = {self.b!r} (else the X-joints cannot be assembled)"
        )
        for field in ("a", "k1", "k2", "min_tension", "payload", "bar_density", "gravity"):
            require(getattr(self, field) >= 0, name, field, getattr(self, field), "zero or positive")
        require(self.bar_radius > 0, name, "bar_radius", self.bar_radius, "positive")
        require(
            self.max_tension > self.min_tension,
            name,
            "max_tension",
            self.max_tension,
            f"greater than min_tension = {self.min_tension!r}",
        )
        if np.ndim(self.joint_limit):
            raise TypeError(f"{name}.joint_limit = {self.joint_limit!r}: must be one number for the whole batch")
        require(0 < self.joint_limit <= 2 * math.pi, name, "joint_limit", self.joint_limit, "in (0, 2 pi]")


# [Muralidharan2022, section 5]. The paper prints neither density nor gravity; aluminium at 2700 kg/m3 and 9.8 m/s2
# reproduce the one number that it prints, to all its digits.
MURALIDHARAN2022 = TwoXDesign(b=0.05, l=0.10, a=0.20, k1=600.0, k2=300.0, min_tension=5.0, max_tension=155.0)


def FURET2018(b: float, joint_limit: float = 2 * math.pi) -> TwoXDesign:
    """The plain 2-X of [Furet2018]: L = 1 m, no offsets, purely kinematic (no springs, no masses), on the full torus.

    Args:
        b: length of base and top bars [m], below 1; the paper's examples are 2/5, 1/2, 2/3 and 9/10.
        joint_limit: |alpha| <= joint_limit [rad]; figure 7 of the paper has 2 pi / 3.
    """
    return TwoXDesign(
        b=b, l=1.0, a=0.0, k1=0.0, k2=0.0, min_tension=0.0, max_tension=1.0, bar_density=0.0, joint_limit=joint_limit
    )


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


class _Joint(NamedTuple):
    """Half-angle sine and cosine of a joint, the distance r of its bars' midpoints, and r's derivatives in alpha."""

    s: Component
    c: Component
    r: Component
    dr: Component
    ddr: Component


class TwoX(TipStiffness):
    """The 2-X manipulator of one design, or of a batch of designs.

    A configuration is q = (alpha_1, alpha_2) [rad], tensions are (left 1, right 1, left 2, right 2) [N], `load` is a
    dead force at the tip (fx, fy) [N] in world axes, besides gravity. Components are floats, NumPy arrays or Torch
    tensors of any (broadcastable) shape.
    """

    degrees_of_freedom = 2
    input_names = ("left 1", "right 1", "left 2", "right 2")

    def __init__(self, design: TwoXDesign = MURALIDHARAN2022) -> None:
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

    def take(self, index: Any) -> "TwoX":
        """The mechanisms at `index` of a batch of designs; itself where there is one design only."""
        if not isinstance(self._probe, np.ndarray):
            return self
        part = object.__new__(TwoX)
        part.__dict__.update(
            {name: value[index] if isinstance(value, np.ndarray) else value for name, value in vars(self).items()}
        )
        part.design = take(self.design, index)
        part._masses = [m[index] if isinstance(m, np.ndarray) else m for m in self._masses]
        part._lengths = tuple(m[index] if isinstance(m, np.ndarray) else m for m in self._lengths)
        return part

    # ------------------------------------------------------------------------------------------------ geometry

    @property
    def reach(self) -> Any:
        """An upper bound of the tip's distance from the base [m]."""
        return 2 * (self.design.l + self.design.a)

    def _joint(self, xp: Any, alpha: Component) -> _Joint:
        return self._joint_at(xp, xp.sin(alpha / 2), xp.cos(alpha / 2))

    def _joint_at(self, xp: Any, s: Component, c: Component) -> _Joint:
        bb = self._bb
        r = xp.sqrt(self._excess + bb * s * s)  # = sqrt(l^2 - b^2 c^2) without its cancellation for l close to b
        dr = bb * s * c / (2 * r)
        return _Joint(s, c, r, dr, (bb * (c * c - s * s) / 4 - dr * dr) / r)

    def _xp(self, *components: Component) -> Any:
        return namespace_of(self._probe, *components)

    def tip(self, q: Sequence[Component]) -> tuple[Component, Component]:
        """Tip position (x, y) [m], [Muralidharan2022, Eq. 1]."""
        xp = self._xp(*q)
        return self._tip(self._joint(xp, q[0]), self._joint(xp, q[1]))

    def _tip(self, j1: _Joint, j2: _Joint) -> tuple[Component, Component]:
        a = self.design.a
        sin_a1, cos_a1, s12, c12, end_s, end_c = _directions(j1, j2)
        return (
            -(j1.r * j1.s + a * (sin_a1 + end_s) + j2.r * s12),
            j1.r * j1.c + a * (cos_a1 + end_c) + j2.r * c12,
        )

    def jacobian(self, q: Sequence[Component]) -> tuple[tuple[Component, Component], tuple[Component, Component]]:
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

    def singularity(self, q: Sequence[Component]) -> Component:
        """det J with respect to alpha [m2/rad2]; zero where the inverse solutions meet.

        Equal to [Muralidharan2022, Eq. 3] divided by 4 l_1 l_2, once the radical of its first term is read in alpha_1.
        """
        (xa, xb), (ya, yb) = self.jacobian(q)
        return xa * yb - xb * ya

    def nodes(self, q: Sequence[Component]) -> dict[str, tuple[Component, Component]]:
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
            joint = self._joint(xp, alpha)
            longer = joint.r + self.design.b * abs(joint.s)
            shorter = self._excess / longer
            sides += [xp.where(joint.s > 0, shorter, longer), xp.where(joint.s > 0, longer, shorter)]
        return tuple(sides)

    # ------------------------------------------------------------------------------------------------- statics

    def potential_energy(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> Component:
        """Potential energy [J] of gravity (zero at the base), springs, cables and load, [Muralidharan2022, Eq. 4]."""
        xp = self._xp(*q, *tensions, *load)
        a1, a2 = q
        j1, j2 = self._joint(xp, a1), self._joint(xp, a2)
        fx, fy = load
        a, ll = self.design.a, self.design.l * self.design.l
        k1, k2, bb = self.design.k1, self.design.k2, self._bb
        l1, r1, l2, r2 = self.cable_lengths(q)
        gravity_and_load = (
            j1.r * (fx * j1.s + (self._w1 - fy) * j1.c)
            + a * (fx * xp.sin(a1) + (self._h1 - fy) * xp.cos(a1))
            + j2.r * (fx * xp.sin(a1 + a2 / 2) + (self._w2 - fy) * xp.cos(a1 + a2 / 2))
            + a * (fx * xp.sin(a1 + a2) + (self._h2 - fy) * xp.cos(a1 + a2))
        )
        springs = k1 * (ll - bb * xp.cos(a1)) + k2 * (ll - bb * xp.cos(a2))
        return gravity_and_load + springs + tensions[0] * l1 + tensions[1] * r1 + tensions[2] * l2 + tensions[3] * r2

    def _passive(self, xp: Any, j1: _Joint, j2: _Joint, load: Sequence[Component]) -> tuple[Component, ...]:
        """Gradient [N m] and Hessian [N m/rad] of the energy without cables: (g1, g2, h11, h12, h22)."""
        s1, c1, r1, dr1, ddr1 = j1
        s2, c2, r2, dr2, ddr2 = j2
        a = self.design.a
        sin_a1, cos_a1, s12, c12, end_s, end_c = _directions(j1, j2)
        sin_a2, cos_a2 = 2 * s2 * c2, c2 * c2 - s2 * s2
        # Each of the four vectors of the chain contributes p = fx sin(phi) + w cos(phi) times its length; d = dp/dphi.
        if load is _NO_LOAD:
            h1, h2 = a * self._h1, a * self._h2
            p1, d1 = self._w1 * c1, -self._w1 * s1
            p2, d2 = h1 * cos_a1, -h1 * sin_a1
            p3, d3 = self._w2 * c12, -self._w2 * s12
            p4, d4 = h2 * end_c, -h2 * end_s
        else:
            fx, fy = load
            w1, h1, w2, h2 = self._w1 - fy, a * (self._h1 - fy), self._w2 - fy, a * (self._h2 - fy)
            fa = a * fx
            p1, d1 = fx * s1 + w1 * c1, fx * c1 - w1 * s1
            p2, d2 = fa * sin_a1 + h1 * cos_a1, fa * cos_a1 - h1 * sin_a1
            p3, d3 = fx * s12 + w2 * c12, fx * c12 - w2 * s12
            p4, d4 = fa * end_s + h2 * end_c, fa * end_c - h2 * end_s
        r2p3, r2d3 = r2 * p3, r2 * d3
        return (
            dr1 * p1 + r1 * d1 / 2 + d2 + r2d3 + d4 + self._spring1 * sin_a1,
            dr2 * p3 + r2d3 / 2 + d4 + self._spring2 * sin_a2,
            (ddr1 - r1 / 4) * p1 + dr1 * d1 - p2 - r2p3 - p4 + self._spring1 * cos_a1,
            dr2 * d3 - r2p3 / 2 - p4,
            ddr2 * p3 + dr2 * d3 - r2p3 / 4 - p4 + self._spring2 * cos_a2,
        )

    def _active(
        self, xp: Any, j1: _Joint, j2: _Joint, tensions: Sequence[Component], load: Sequence[Component]
    ) -> tuple[Component, ...]:
        """Gradient and Hessian of the whole energy: (g1, g2, h11, h12, h22)."""
        g1, g2, h11, h12, h22 = self._passive(xp, j1, j2, load)
        half = self.design.b / 2
        left1, right1, left2, right2 = tensions
        sum1, pull1, sum2, pull2 = left1 + right1, (right1 - left1) * half, left2 + right2, (right2 - left2) * half
        return (
            g1 + sum1 * j1.dr + pull1 * j1.c,
            g2 + sum2 * j2.dr + pull2 * j2.c,
            h11 + sum1 * j1.ddr - pull1 * j1.s / 2,
            h12,
            h22 + sum2 * j2.ddr - pull2 * j2.s / 2,
        )

    def statics(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, tuple[Components, ...]]:
        """Gradient and Hessian of the potential energy in one evaluation: (g1, g2), ((h11, h12), (h12, h22))."""
        xp = self._xp(*q, *tensions, *load)
        a1, a2 = q
        g1, g2, h11, h12, h22 = self._active(xp, self._joint(xp, a1), self._joint(xp, a2), tensions, load)
        return (g1, g2), ((h11, h12), (h12, h22))

    def to_sines(self, q: Sequence[Component]) -> Components:
        """u_i = sin(alpha_i / 2), the coordinates of `sine_statics`; for joints up."""
        xp = self._xp(*q)
        return tuple(xp.sin(alpha / 2) for alpha in q)

    def from_sines(self, u: Sequence[Component]) -> Components:
        """alpha_i = 2 asin(u_i) [rad]."""
        xp = self._xp(*u)
        inside = [xp.maximum(xp.minimum(ui, _FLATTEST), -_FLATTEST) for ui in u]
        return tuple(2 * xp.atan2(ui, xp.sqrt(1 - ui * ui)) for ui in inside)

    def sine_statics(
        self, u: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, tuple[Components, ...]]:
        """Gradient and Hessian of the potential energy in u_i = sin(alpha_i / 2) [J], for joints up.

        In these coordinates the energy of springs and cables is convex, and the flat poses, where the cables lose
        their moment arms in alpha, are ordinary boundary points (|u| = 1). Newton's method converges from much
        further away than in alpha, and no trigonometry is left.
        """
        xp = self._xp(*u, *tensions, *load)
        joints, turns, tangents = [], [], []
        for unlimited in u:
            ui = xp.maximum(xp.minimum(unlimited, _FLATTEST), -_FLATTEST)
            c = xp.sqrt(1 - ui * ui)
            joints.append(self._joint_at(xp, ui, c))
            turns.append(2 / c)  # d alpha / d u
            tangents.append(ui / (2 * c))
        g1, g2, h11, h12, h22 = self._active(xp, joints[0], joints[1], tensions, load)
        t1, t2 = turns
        mixed = h12 * t1 * t2
        return (
            (g1 * t1, g2 * t2),
            (((h11 + g1 * tangents[0]) * t1 * t1, mixed), (mixed, (h22 + g2 * tangents[1]) * t2 * t2)),
        )

    def energy_gradient(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> Components:
        """dU/dalpha [N m], both zero in equilibrium.

        [Muralidharan2022, Eqs. 5-6] hold twice these (G - Gamma), with sin(alpha_1 + alpha_2/2) in G_1, where Eq. 6
        misprints it.
        """
        return self.statics(q, tensions, load)[0]

    def stiffness_matrix(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, ...]:
        """Hessian of the potential energy [N m/rad], ((h11, h12), (h12, h22)); positive definite where stable.

        [Muralidharan2022, Eqs. 8-11] print four times this matrix.
        """
        return self.statics(q, tensions, load)[1]

    def _stiffest(
        self, xp: Any, j1: _Joint, j2: _Joint, load: Sequence[Component]
    ) -> tuple[Components, Component, Component]:
        """Stiffest tensions, stability margin and wrench margin."""
        g1, g2, h11, h12, h22 = self._passive(xp, j1, j2, load)
        b, top = self.design.b, self.design.max_tension
        tensions: list[Component] = []
        others: list[Component] = []
        diagonal: list[Component] = []
        for joint, g, h in ((j1, g1, h11), (j2, g2, h22)):
            # Equilibrium of a joint: F_left * left - F_right * right = moment, where moment = 2 r g / (b cos(alpha/2)).
            moment = 2 * joint.r * g / (b * joint.c)
            longer = joint.r + b * abs(joint.s)
            shorter = self._excess / longer
            left = xp.where(joint.s > 0, shorter, longer)
            right = xp.where(joint.s > 0, longer, shorter)
            # Whichever cable is not at the maximum follows from equilibrium.
            other_right = (top * left - moment) / right
            other_left = (top * right + moment) / left
            is_left_max = other_right <= top
            f_left = xp.where(is_left_max, top, other_left)
            f_right = xp.where(is_left_max, other_right, top)
            tensions += [f_left, f_right]
            others.append(xp.where(is_left_max, other_right, other_left))
            diagonal.append(h + (f_left + f_right) * joint.ddr - (f_right - f_left) * b * joint.s / 4)
        return (
            tuple(tensions),
            smallest_eigenvalue(diagonal[0], h12, diagonal[1], xp) / self.stiffness_scale,
            (xp.minimum(others[0], others[1]) - self.design.min_tension) / top,
        )

    def stiffest_tensions(self, q: Sequence[Component], load: Sequence[Component] = _NO_LOAD) -> Components:
        """The tensions (left 1, right 1, left 2, right 2) [N] of greatest stiffness that hold q in equilibrium.

        For each joint the larger tension is max_tension [Muralidharan2022, section 2]; the other one follows from
        equilibrium and is not clipped: below min_tension it says that q is not wrench-feasible. Close to the flat
        poses, where a cable has no moment arm, it grows without bound.
        """
        return self.posture(q, load)[0]

    def softest_tensions(self, q: Sequence[Component], load: Sequence[Component] = _NO_LOAD) -> Components:
        """The tensions (left 1, right 1, left 2, right 2) [N] of least stiffness that hold q in equilibrium.

        For each joint the smaller tension is min_tension; the other one follows from equilibrium. Of a q that is not
        wrench-feasible they mean nothing.
        """
        left1, right1, left2, right2 = self.stiffest_tensions(q, load)
        sides = self.cable_lengths(q)
        xp = self._xp(left1, *sides)
        low = self.design.min_tension
        tensions: list[Component] = []
        for f_left, f_right, left, right in ((left1, right1, *sides[:2]), (left2, right2, *sides[2:])):
            # F_left left - F_right right is the moment of the joint: it stays.
            less = xp.minimum((f_left - low) / right, (f_right - low) / left)
            tensions += [f_left - less * right, f_right - less * left]
        return tuple(tensions)

    def posture(
        self, q: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, Component, Component]:
        """Stiffest tensions, stability margin and wrench margin of q in one evaluation."""
        xp = self._xp(*q, *load)
        return self._stiffest(xp, self._joint(xp, q[0]), self._joint(xp, q[1]), load)

    def posture_and_tip(self, q: Sequence[Component]) -> tuple[Components, Component, Component, Components]:
        """`posture` and `tip` of q in one evaluation."""
        xp = self._xp(*q)
        j1, j2 = self._joint(xp, q[0]), self._joint(xp, q[1])
        return (*self._stiffest(xp, j1, j2, _NO_LOAD), self._tip(j1, j2))

    def wrench_margin(
        self, q: Sequence[Component], tensions: Sequence[Component] | None = None, load: Sequence[Component] = _NO_LOAD
    ) -> Component:
        """Distance of the tensions to their bounds, divided by max_tension [-]; positive inside.

        Without `tensions`: of the stiffest ones, to the lower bound (they are at the upper one), so that it is >= 0
        exactly where q is wrench-feasible. With `tensions`: of those, to the nearer of both bounds.
        """
        if tensions is None:
            return self.posture(q, load)[2]
        xp = self._xp(*q, *tensions)
        low, high = self.design.min_tension, self.design.max_tension
        slack = [xp.minimum(f - low, high - f) for f in tensions]
        return xp.minimum(xp.minimum(slack[0], slack[1]), xp.minimum(slack[2], slack[3])) / high

    def stability_margin(
        self, q: Sequence[Component], tensions: Sequence[Component] | None = None, load: Sequence[Component] = _NO_LOAD
    ) -> Component:
        """Smallest eigenvalue of the stiffness matrix divided by k1 b^2 (by max_tension b without springs) [-].

        Without `tensions`: at the stiffest ones, which is the best that can be had in this configuration.
        """
        if tensions is None:
            return self.posture(q, load)[1]
        (h11, h12), (_, h22) = self.stiffness_matrix(q, tensions, load)
        return smallest_eigenvalue(h11, h12, h22, self._xp(h11)) / self.stiffness_scale

    def is_stable_wrench_feasible(self, q: Sequence[Component], load: Sequence[Component] = _NO_LOAD) -> Component:
        """Whether q is in the stable wrench-feasible joint space (SWFJ), joint limits included."""
        _, stability, wrench = self.posture(q, load)
        return (stability > 0) & (wrench >= 0) & self.is_within_limits(q)

    def is_within_limits(self, q: Sequence[Component]) -> Component:
        """Whether both joints are within the joint limits."""
        limit = self.design.joint_limit
        return (abs(q[0]) <= limit) & (abs(q[1]) <= limit)

    def equilibrium(
        self, tensions: Sequence[Component], start: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> _equilibrium.Equilibrium:
        """The equilibrium that the arm reaches from `start` under these tensions, see `equilibrium.settle`.

        Args:
            tensions: (left 1, right 1, left 2, right 2) [N], each a float or an array of shape (n,).
            start: (alpha_1, alpha_2) [rad].
            load: (fx, fy) [N].

        Returns:
            Configuration [rad], residual [N m], is_stable, and the reason in words.

        Raises:
            ValueError: a number is NaN or infinite, or there are not four tensions and two angles.
        """
        check_finite("tensions", tensions, 4)
        check_finite("start", start, 2)
        check_finite("load", load, 2)

        inputs, forces = as_components(tensions), as_components(load)
        return _equilibrium.settle(_statics, start, (self.design, inputs, forces), self.design.joint_limit)

    def equilibria(self, tensions: Sequence[float], load: Sequence[float] = _NO_LOAD) -> list[_equilibrium.Equilibrium]:
        """All equilibria within the joint limits (flat poses excluded), stable and unstable, sorted by configuration.

        Raises:
            ValueError: a number is NaN or infinite, there are not four tensions, or the equilibria form a continuum (an
                arm without springs, weight and tensions).
        """
        check_finite("tensions", tensions, 4)
        check_finite("load", load, 2)
        limit = self.design.joint_limit
        return _equilibrium.find_all(lambda q: self.statics(q, tensions, load), (-limit, -limit), (limit, limit))

    # ---------------------------------------------------------------------------------------- inverse kinematics

    def inverse_kinematics(self, x: float, y: float) -> list[InverseSolution]:
        """All configurations within the joint limits whose tip is at (x, y) [m], sorted by alpha_1.

        The real roots of one polynomial, of degree eight with offsets and, without, the quartic of [Furet2018, Eqs.
        3-8]. They are candidates only (on one curve a double root is no configuration at all): each is polished and
        verified by forward kinematics. Two solutions closer than 1e-6 rad to one another, next to a singularity, are
        given as one, and so are those (1e-5 rad at most) between which the tip is no further from the target. Of nearly
        equal bars (1 - (b/l)^2 < 2e-3) the solutions lie in valleys, along which the tip moves less than rounding:
        where it stays within 4e-15 of the reach from the target all the way between two solutions, one is given.

        Returns:
            The solutions, an empty list where the target is out of reach.

        Raises:
            ValueError: x or y is not a finite number, the mechanism is a batch of designs, or (without offsets) the
                target is the base itself, which every configuration with alpha_1 + alpha_2 = +-2 pi reaches.
        """
        if is_batch(self._probe):
            raise ValueError("inverse_kinematics takes one design, not a batch of them; see inverse_kinematics_batch")
        _, found, residual = self._inverse(np.array([float(x)]), np.array([float(y)]))
        solutions = []
        for a1, a2, distance in zip(found[0].tolist(), found[1].tolist(), residual.tolist(), strict=True):
            q = (a1, a2)
            _, stability, wrench = self.posture(q)
            state = "".join("U" if abs(alpha) < math.pi else "D" for alpha in q)
            solutions.append(InverseSolution(q, state, self.singularity(q), stability, wrench, distance))
        return solutions

    def inverse_kinematics_batch(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """All inverse solutions of many targets, as `inverse_kinematics` finds them.

        Args:
            x: shape (n,) [m].
            y: shape (n,) [m].

        Returns:
            alpha_1 and alpha_2, each of shape (n, m) [rad], m the largest number of solutions (at least 1), padded
            with NaN.

        Raises:
            ValueError: as `inverse_kinematics`, and where the designs of a batch differ in b, l or a.
        """
        owner, found, _ = self._inverse(np.asarray(x, float), np.asarray(y, float))
        counts = np.bincount(owner, minlength=len(x))
        column = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        tables = np.full((2, len(x), max(int(counts.max(initial=0)), 1)), np.nan)
        for table, alpha in zip(tables, found, strict=True):
            table[owner, column] = alpha
        return tables[0], tables[1]

    def _inverse(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], np.ndarray]:
        """Candidates, polished and verified: index of the target, configuration and residual of every solution."""
        if any(isinstance(value, np.ndarray) for value in (self.design.a, self.design.b, self.design.l)):
            raise ValueError("inverse kinematics takes one set of bar lengths, not a batch of them")
        check_finite("target", (x, y), 2)
        equal_bars = self._excess < _NEARLY_SINGULAR * self.design.l**2  # many candidates, the best of which are kept
        owner, a1, a2 = self._candidates(x, y)
        near = np.maximum(np.abs(a1), np.abs(a2)) < self.design.joint_limit + 0.1
        owner, a1, a2 = owner[near], a1[near], a2[near]
        a1, a2 = self._polish(x[owner], y[owner], a1, a2)
        if equal_bars:
            a1, a2 = self._along_valleys(x[owner], y[owner], a1, a2)
        a1, a2 = (2 * math.pi - (2 * math.pi - alpha) % _FULL_TURN for alpha in (a1, a2))  # into (-2 pi, 2 pi]
        a1, a2 = self._onto_limits(x[owner], y[owner], a1, a2)
        px, py = self.tip((a1, a2))
        residual = np.hypot(px - x[owner], py - y[owner])
        rounding = (_VALLEY if equal_bars else 1e-12) * self.reach
        keep = (residual < rounding) & self.is_within_limits((a1, a2))
        if self.design.joint_limit <= math.pi:  # which leaves the flat poses out
            keep &= np.maximum(np.abs(a1), np.abs(a2)) < math.pi - 1e-9
        order = np.lexsort((residual[keep], owner[keep]) if equal_bars else (a2[keep], a1[keep], owner[keep]))
        owner, a1, a2, residual = (values[keep][order] for values in (owner, a1, a2, residual))
        if equal_bars:
            new = self._leaders(x, y, owner, a1, a2, residual)
        else:
            new = self._new_solutions(x, y, owner, a1, a2, residual)
        kept = np.flatnonzero(new)
        kept = kept[np.lexsort((a2[kept], a1[kept], owner[kept]))]
        return owner[kept], (a1[kept], a2[kept]), residual[kept]

    def _new_solutions(
        self, x: np.ndarray, y: np.ndarray, owner: np.ndarray, a1: np.ndarray, a2: np.ndarray, residual: np.ndarray
    ) -> np.ndarray:
        """Which candidates are solutions of their own; others differ by rounding, sqrt(eps) at a double root."""
        new = np.ones(len(owner), bool)
        for lag in range(1, len(owner)):
            same = owner[lag:] == owner[:-lag]
            if not same.any():
                break
            gap = _angle_gap(a1[lag:], a1[:-lag]) + _angle_gap(a2[lag:], a2[:-lag])
            one = gap <= 1e-6
            near = np.flatnonzero(same & ~one & (gap < 1e-5))  # of a double root: what lies between is as good
            px, py = self.tip(tuple((a[lag:][near] + a[:-lag][near]) / 2 for a in (a1, a2)))
            between = np.hypot(px - x[owner[lag:][near]], py - y[owner[lag:][near]])
            one[near] = between <= np.maximum(residual[lag:][near], residual[:-lag][near])
            new[lag:] &= ~same | ~one
        return new

    def _leaders(
        self, x: np.ndarray, y: np.ndarray, owner: np.ndarray, a1: np.ndarray, a2: np.ndarray, residual: np.ndarray
    ) -> np.ndarray:
        """The same for nearly equal bars, whose solutions are long valleys; the best candidates come first.

        A candidate belongs to a better one where the tip, all the way between them along the valley's floor, is no
        further from the target than at the worse of the two, or than rounding.
        """
        new = np.zeros(len(owner), bool)
        left = np.arange(len(owner))
        rounding = _VALLEY * self.reach
        between = np.linspace(0.0, 1.0, 18)[1:-1, None]
        while len(left):
            _, first, group = np.unique(owner[left], return_index=True, return_inverse=True)
            new[left[first]] = True
            best = left[first][group]
            ways = [(alpha[left] - alpha[best] + 2 * math.pi) % _FULL_TURN - 2 * math.pi for alpha in (a1, a2)]
            q = (a1[best] + between * ways[0], a2[best] + between * ways[1])
            length = np.abs(ways[0]) + np.abs(ways[1])
            for _ in range(4):  # down the gradient, to the floor of a bent valley
                px, py = self.tip(q)
                ex, ey = px - x[owner[left]], py - y[owner[left]]
                rows = self.jacobian(q)
                square = sum(part * part for row in rows for part in row) + 1e-300
                steps = [(rows[0][i] * ex + rows[1][i] * ey) / square for i in range(2)]
                shrink = 0.1 * length / np.maximum(0.1 * length + 1e-300, np.hypot(*steps))
                q = (q[0] - shrink * steps[0], q[1] - shrink * steps[1])
            px, py = self.tip(q)
            off = np.hypot(px - x[owner[left]], py - y[owner[left]]).max(axis=0)
            one = (length <= 1e-6) | (off <= np.maximum(residual[left], rounding))
            left = left[~one]
        return new

    def _onto_limits(
        self, x: np.ndarray, y: np.ndarray, a1: np.ndarray, a2: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Angles that rounding has carried beyond a joint limit, put onto it; the other joint makes up for it."""
        limit, beyond, stride = self.design.joint_limit, _ROUNDING, 1e-3
        if self._excess < _NEARLY_SINGULAR * self.design.l**2:  # valleys along which the tip moves less than rounding
            beyond = stride = 0.3
            if limit == math.pi:
                limit -= 2e-9  # since a flat pose counts as none
        over = [np.abs(alpha) > limit for alpha in (a1, a2)]
        index = np.flatnonzero((over[0] | over[1]) & (np.maximum(np.abs(a1), np.abs(a2)) < limit + beyond))
        if not len(index):
            return a1, a2
        q = [np.clip(alpha[index], -limit, limit) for alpha in (a1, a2)]
        free = [~part[index] for part in over]
        for _ in range(20):
            px, py = self.tip((q[0], q[1]))
            ex, ey = px - x[index], py - y[index]
            rows = self.jacobian((q[0], q[1]))
            for i in range(2):
                dx, dy = rows[0][i], rows[1][i]
                step = (dx * ex + dy * ey) / (dx * dx + dy * dy + 1e-300)
                q[i] = np.where(free[i], np.clip(q[i] - np.clip(step, -stride, stride), -limit, limit), q[i])
        a1, a2 = a1.copy(), a2.copy()
        a1[index], a2[index] = q
        return a1, a2

    def _polish(self, x: np.ndarray, y: np.ndarray, a1: np.ndarray, a2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Damped Newton steps from every candidate to its target: the best point of each way.

        Steps that lead further away are taken back, and damped more: next to a singularity, where two solutions meet,
        full steps would run along the direction that moves the tip least.
        """
        a1, a2 = a1.copy(), a2.copy()
        px, py = self.tip((a1, a2))
        ex, ey = px - x, py - y
        square, damped = ex * ex + ey * ey, np.full(len(a1), 1e-3)
        active = np.arange(len(a1))
        size = self.reach
        for _ in range(60):
            q = (a1[active], a2[active])
            (xa, xb), (ya, yb) = self.jacobian(q)
            # Levenberg's damping, quadratically small in the error: Newton's speed, yet finite steps where det J is 0.
            ux, uy = ex[active], ey[active]
            damping = damped[active] * square[active] / size**2
            m11, m12, m22 = xa * xa + ya * ya + damping, xa * xb + ya * yb, xb * xb + yb * yb + damping
            v1, v2 = xa * ux + ya * uy, xb * ux + yb * uy
            det = xa * yb - xb * ya
            det = det * det + damping * (m11 + m22 - damping) + 1e-300
            step1, step2 = (m22 * v1 - m12 * v2) / det, (m11 * v2 - m12 * v1) / det
            length = np.hypot(step1, step2)
            shrink = 0.3 / np.maximum(0.3, length)
            new1, new2 = q[0] - shrink * step1, q[1] - shrink * step2
            px, py = self.tip((new1, new2))
            there = (px - x[active]) ** 2 + (py - y[active]) ** 2
            better = there <= square[active]
            done = active[better]
            a1[done], a2[done], square[done] = new1[better], new2[better], there[better]
            ex[done], ey[done] = (px - x[active])[better], (py - y[active])[better]
            damped[active] *= np.where(better, 0.1, 100.0)
            damped[active] = np.maximum(damped[active], 1e-3)
            active = active[(length > 1e-11) & (square[active] > 0) & (damped[active] < 1e40)]
            if not len(active):
                break
        return a1, a2

    def _along_valleys(
        self, x: np.ndarray, y: np.ndarray, a1: np.ndarray, a2: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Newton steps that may lead further away: a step along a bent valley leaves it, the next one returns to it."""
        best1, best2 = a1.copy(), a2.copy()
        least = np.full(len(a1), np.inf)
        for _ in range(12):
            px, py = self.tip((a1, a2))
            ex, ey = px - x, py - y
            error = np.hypot(ex, ey)
            better = error < least
            least = np.where(better, error, least)
            best1, best2 = np.where(better, a1, best1), np.where(better, a2, best2)
            (xa, xb), (ya, yb) = self.jacobian((a1, a2))
            det = xa * yb - xb * ya
            det = np.where(det == 0, np.inf, det)
            step1, step2 = (yb * ex - xb * ey) / det, (xa * ey - ya * ex) / det
            shrink = 0.3 / np.maximum(0.3, np.hypot(step1, step2))
            a1, a2 = a1 - shrink * step1, a2 - shrink * step2
        return best1, best2

    def _candidates(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A starting point close to every solution: index of the target, alpha_1, alpha_2.

        Seen from the base of joint 2, in its axes, the tip runs along a curve that has no square root in it: with d
        the tip's position, k = d.d - a^2 - l^2,

            (k + l^2) k + b^2 d_y^2 - 2 a (l^2 - b^2) d_y - a^2 (2 l^2 - b^2) = 0.

        An X-joint moves like two rolling ellipses; in their eccentric anomaly psi, tan(alpha/2) = sqrt(1 - b^2/l^2)
        tan(psi), r = sqrt(l^2 - b^2) / h, h^2 = cos^2(psi) + (1 - b^2/l^2) sin^2(psi). Times h^4 the curve's equation
        is therefore a trigonometric polynomial of order 4 in psi_1, known from a few samples: at most eight
        solutions, the real roots of a polynomial of degree eight. (Without offsets h^2 divides it; what is left is the
        quartic of [Furet2018, Eqs. 3-8] in another variable.)
        """
        a, l = self.design.a, self.design.l
        distance = np.maximum(np.abs(x), np.abs(y))
        if a == 0 and (distance < 1e-12 * l).any():
            raise ValueError(
                "target (0, 0): the base, which every configuration with alpha_1 + alpha_2 = +-2 pi reaches"
            )
        within = np.flatnonzero(distance <= self.reach)
        x, y = x[within], y[within]
        psi = np.arange(_SAMPLES) * (2 * math.pi / _SAMPLES)
        flatness = self._excess / (l * l)
        hh = np.cos(psi) ** 2 + flatness * np.sin(psi) ** 2
        _, dy, dd = self._beyond_joint_1(x[:, None], y[:, None], self._from_anomaly(psi))
        samples = self._off_curve(dy, dd) * (hh * hh)
        # The variable is t = tan(omega/2), with t = infinity where the sample is largest: no root is near infinity.
        top = np.abs(samples).argmax(axis=1)
        turned = samples[np.arange(len(x))[:, None], (top[:, None] + np.arange(_SAMPLES)) % _SAMPLES]
        polynomial = product(turned, _SAMPLES_TO_POLYNOMIAL)
        owner, t = real_roots(polynomial)
        a1 = self._from_anomaly(psi[top[owner]] + math.pi + 2 * np.arctan(t))
        # Ill-conditioned where the bars are nearly equal: all but the smallest angles have anomalies next to pi / 2.
        if flatness < _NEARLY_SINGULAR:
            more = self._scanned(x, y)
            owner, a1 = np.concatenate([owner, more[0]]), np.concatenate([a1, more[1]])
        a2, u, rc, rr = self._second_angle(*self._beyond_joint_1(x[owner], y[owner], a1))
        # Where the curve crosses itself (u = 0) a point of it belongs to both signs of alpha_2.
        node = np.flatnonzero(np.abs(u) < 1e-3 * l * l)
        fold = 2 * np.arccos(np.clip(rc[node] / np.sqrt(rr[node] + 1e-300), -1.0, 1.0))
        owner = within[owner]
        owner, a1, a2 = (
            np.concatenate([owner, owner[node], owner[node]]),
            np.concatenate([a1, a1[node], a1[node]]),
            np.concatenate([a2, fold, -fold]),
        )
        if flatness < _NEARLY_SINGULAR:  # and alpha_2 from alpha_1 is ill-conditioned at singularities and limits
            limit = self.design.joint_limit
            axis = np.linspace(-limit, limit, _GRID)
            # A joint whose midpoints meet turns within angles of this size.
            near = np.geomspace(math.sqrt(flatness), 0.1, 6)
            axis = np.concatenate([axis, near, -near, 2 * math.pi - near, near - 2 * math.pi])
            axis = axis[np.abs(axis) <= limit]
            grid = [part.ravel() for part in np.meshgrid(axis, axis)]
            owner = np.concatenate([owner, np.repeat(within, len(grid[0]))])
            a1, a2 = (np.concatenate([a, np.tile(part, len(within))]) for a, part in zip((a1, a2), grid, strict=True))
        return owner, a1, a2

    def _off_curve(self, dy: Component, dd: Component) -> Component:
        """0 where joint 2 can reach the target; see `_candidates`."""
        a, l, bb = self.design.a, self.design.l, self._bb
        u = dd - a * a
        return u * (u - l * l) + bb * dy * dy - a * (2 * self._excess * dy + a * (l * l + self._excess))

    def _second_angle(
        self, dx: Component, dy: Component, dd: Component
    ) -> tuple[Component, Component, Component, Component]:
        """alpha_2 [rad] of a target on the curve, u = d.d - a^2, r cos(alpha_2/2) and r^2; see `_candidates`."""
        xp = self._xp(dx, dy, dd)
        a, l, bb = self.design.a, self.design.l, self._bb
        u = dd - a * a
        rc = (a * (2 * (u - l * l) + bb) + bb * dy) / (bb + 4 * a * a)
        rr = xp.maximum(u - 2 * a * rc, 0.0)
        sign = xp.where(u > 0, 1.0, xp.where(u < 0, -1.0, 0.0))
        return 2 * xp.atan2(-rr * dx * sign, rc * abs(u)), u, rc, rr

    def through_anomaly(
        self, x: Component, y: Component, psi: Component
    ) -> tuple[tuple[Component, Component], Component, Component]:
        """What the inverse kinematics looks for roots of, along the circle of joint 1's eccentric anomaly. Traceable.

        Returns:
            (alpha_1, alpha_2) [rad] with the tip at (x, y) [m] where the second result is 0; that result; and u, next
            to whose zeros [m2] alpha_2 has another solution.
        """
        alpha1 = self._from_anomaly(psi)
        dx, dy, dd = self._beyond_joint_1(x, y, alpha1)
        alpha2, u, _, _ = self._second_angle(dx, dy, dd)
        return (alpha1, alpha2), self._off_curve(dy, dd), u

    def _scanned(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Index of the target and alpha_1 of solutions, by even scans of the circle of alpha_1 and of its anomaly."""
        n = len(x)

        def off(line: np.ndarray, angle: np.ndarray) -> np.ndarray:
            a1 = np.where(line < n, 2 * angle, self._from_anomaly(angle))
            _, dy, dd = self._beyond_joint_1(x[line % n], y[line % n], a1)
            return np.asarray(self._off_curve(dy, dd))

        if not n:
            return np.zeros(0, int), np.zeros(0)
        line, angle = circle_roots(off, 2 * n, 720, 1e-12)
        return line % n, np.where(line < n, 2 * angle, self._from_anomaly(angle))

    def _from_anomaly(self, psi: Component) -> Component:
        """The angle alpha [rad] at which the eccentric anomaly of a joint's rolling ellipses is psi."""
        xp = self._xp(psi)
        return 2 * xp.atan2(xp.sqrt(self._excess) / self.design.l * xp.sin(psi), xp.cos(psi))

    def _beyond_joint_1(self, x: Component, y: Component, a1: Component) -> tuple[Component, Component, Component]:
        """The target seen from the base of joint 2, in that base's axes, and its distance squared."""
        joint = self._joint(self._xp(x, y, a1), a1)
        sin, cos = 2 * joint.s * joint.c, joint.c**2 - joint.s**2
        dx = x + joint.r * joint.s + self.design.a * sin
        dy = y - joint.r * joint.c - self.design.a * cos
        return cos * dx + sin * dy, cos * dy - sin * dx, dx * dx + dy * dy


def _statics(q: Components, parameters: Any) -> tuple[Components, tuple[Components, ...]]:
    design, tensions, load = parameters
    return TwoX(design).statics(q, tensions, load)


def _directions(j1: _Joint, j2: _Joint) -> tuple[Component, ...]:
    """Sine and cosine of the orientations of offset 1, of joint 2's middle line and of offset 2."""
    sin_a1, cos_a1 = 2 * j1.s * j1.c, j1.c * j1.c - j1.s * j1.s
    s12, c12 = sin_a1 * j2.c + cos_a1 * j2.s, cos_a1 * j2.c - sin_a1 * j2.s
    return sin_a1, cos_a1, s12, c12, s12 * j2.c + c12 * j2.s, c12 * j2.c - s12 * j2.s


def smallest_eigenvalue(h11: Component, h12: Component, h22: Component, xp: Any) -> Component:
    """Smallest eigenvalue of a symmetric 2 x 2 matrix."""
    half = (h11 - h22) / 2
    return (h11 + h22) / 2 - xp.sqrt(half * half + h12 * h12)


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


def _angle_gap(first: Any, second: Any) -> Any:
    gap = np.abs(first - second) % _FULL_TURN
    return np.minimum(gap, _FULL_TURN - gap)
