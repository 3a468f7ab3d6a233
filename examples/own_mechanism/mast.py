"""A mast of two triangles, held by a spring at its right and a cable at its left: the mechanics.

Each triangle stands with its lower corner in the middle of the base below it (the ground, or the top side of the other
triangle). Its top side has the length 2 w and is l above the corner. A spring of zero free length joins the right ends
of base and top side, a cable the left ends. A leaning angle theta > 0 leans to the right; the tip P is the middle of
the upper top side. The lengths of cable (+) and spring (-) obey

    length^2 = l^2 + 2 w^2 +- 2 w l sin(theta) - 2 w^2 cos(theta).

All functions take components (floats, arrays or tensors) and never branch on their values.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from tensegrity_envs.compiler.namespace import Component, Components, as_components, namespace_of
from tensegrity_envs.mechanics.checks import check_finite
from tensegrity_envs.mechanics.design import Member, require, require_finite_numbers
from tensegrity_envs.mechanics.eigenvalues import smallest_eigenvalue
from tensegrity_envs.mechanics.equilibrium import Equilibrium, find_all, relax

NO_LOAD = (0.0, 0.0)
Matrix = tuple[Components, Components]


@dataclass(frozen=True)
class MastDesign:
    """A design of the mast, in SI units; a field may be an array, for a batch of designs.

    Attributes:
        l: height of a triangle [m].
        w: half of its top side, and of the base [m].
        k: stiffness of the springs [N/m].
        payload: mass at the tip [kg].
        gravity: [m/s^2].
        min_tension: of a cable [N].
        max_tension: of a cable [N].
        joint_limit: largest leaning angle [rad].

    Raises:
        TypeError: a field is not a number.
        ValueError: a field is out of range; the message names it.
    """

    l: Component = 0.15
    w: Component = 0.05
    k: Component = 500.0
    payload: Component = 0.1
    gravity: float = 9.81
    min_tension: float = 10.0
    max_tension: float = 300.0
    joint_limit: float = 0.9

    def __post_init__(self) -> None:
        """Validate."""
        require_finite_numbers(self)
        for name in ("l", "w", "k", "max_tension", "joint_limit"):
            require(getattr(self, name) > 0, "MastDesign", name, getattr(self, name), "positive")
        for name in ("payload", "gravity", "min_tension"):
            require(getattr(self, name) >= 0, "MastDesign", name, getattr(self, name), "zero or positive")
        require(self.min_tension < self.max_tension, "MastDesign", "min_tension", self.min_tension, "below max_tension")


class Solution(NamedTuple):
    """An inverse solution: leaning angles [rad], tensions that hold them [N], and two margins, positive where it can
    be held: see `Mast.stability_margin` and `Mast.wrench_margin`.
    """

    configuration: Components
    tensions: Components
    stability_margin: Component
    wrench_margin: Component


class Mast:
    """The mechanism of a design. Configurations are the two leaning angles, each relative to what is below [rad];
    inputs are the tensions of the two cables [N], a load is a dead force (fx, fy) at the tip [N].
    """

    input_names = ("lower", "upper")

    def __init__(self, design: MastDesign | None = None) -> None:
        self.design = MastDesign() if design is None else design

    @property
    def reach(self) -> Component:
        """The largest distance of the tip from the middle of the ground [m]."""
        return 2 * self.design.l

    @property
    def members(self) -> list[Member]:
        """Six bars, two springs, two cables, between `nodes`."""
        bars = [(a, b) for i, foot in ((1, "O"), (2, "E")) for a, b in _sides(foot, f"L{i}", f"R{i}")]
        found = [Member(f"bar {a} {b}", "bar", (a, b)) for a, b in bars]
        for i, name in enumerate(self.input_names):
            right, left = (f"R{i}", f"R{i + 1}"), (f"L{i}", f"L{i + 1}")
            found.append(Member(f"spring {name}", "spring", right, stiffness=self.design.k))
            found.append(Member(f"cable {name}", "cable", left))
        return found

    # -------------------------------------------------------------------------------------------------- kinematics

    def nodes(self, q: Components, tensions: Components | None = None) -> dict[str, tuple[Component, Component]]:
        """The positions of all nodes [m]: ends of the ground L0 and R0, foot O, corners, E and P between them."""
        l, w = self.design.l, self.design.w
        x: Component = 0.0 * q[0]
        y, angle = x, x
        found = {"L0": (x - w, y), "R0": (x + w, y), "O": (x, y)}
        for i, middle in ((1, "E"), (2, "P")):
            angle = angle + q[i - 1]
            xp = namespace_of(angle)
            s, c = xp.sin(angle), xp.cos(angle)
            x, y = x + l * s, y + l * c
            found |= {f"L{i}": (x - w * c, y + w * s), f"R{i}": (x + w * c, y - w * s), middle: (x, y)}
        return found

    def tip(self, q: Components, tensions: Components | None = None) -> Components:
        """The position of the tip [m]."""
        xp, l = namespace_of(*q), self.design.l
        return l * (xp.sin(q[0]) + xp.sin(q[0] + q[1])), l * (xp.cos(q[0]) + xp.cos(q[0] + q[1]))

    def jacobian(self, q: Components, tensions: Components | None = None, load: Components = NO_LOAD) -> Matrix:
        """The rows d x / d q and d y / d q of the tip [m/rad]."""
        xp, l = namespace_of(*q), self.design.l
        s1, c1, s12, c12 = xp.sin(q[0]), xp.cos(q[0]), xp.sin(q[0] + q[1]), xp.cos(q[0] + q[1])
        return (l * (c1 + c12), l * c12), (-l * (s1 + s12), -l * s12)

    def jacobian_determinant(
        self, q: Components, tensions: Components | None = None, load: Components = NO_LOAD
    ) -> Component:
        """The determinant of the Jacobian [m^2/rad^2]: zero where the mast is straight."""
        return -(self.design.l**2) * namespace_of(*q).sin(q[1])

    def inverse_configurations(self, x: Component, y: Component) -> tuple[Components, Components]:
        """The two configurations that put the tip on (x, y), NaN where it is out of reach; x and y may be arrays."""
        xp, l = namespace_of(x, y), self.design.l
        cosine = (x * x + y * y) ** 0.5 / (2 * l)
        sine = xp.maximum(1.0 - cosine * cosine, 0.0) ** 0.5
        bend = xp.where(cosine <= 1.0, xp.atan2(sine, cosine), math.nan)
        direction = xp.atan2(x, y)
        return (direction - bend, 2 * bend), (direction + bend, -2 * bend)

    def inverse_kinematics(self, x: float, y: float, load: Components = NO_LOAD) -> list[Solution]:
        """Every configuration that puts the tip on (x, y) [m], with the tensions that hold it under a load [N]."""
        check_finite("target", (x, y), 2)
        if math.hypot(x, y) > self.reach:
            return []
        found = []
        for q in self.inverse_configurations(float(x), float(y)):
            tensions = self.holding_tensions(q, load)
            margins = self.stability_margin(q, tensions, load), self.wrench_margin(q, tensions)
            found.append(Solution(q, tensions, *margins))
        return found

    # ----------------------------------------------------------------------------------------------------- statics

    def potential_energy(self, q: Components, tensions: Components, load: Components = NO_LOAD) -> Component:
        """Energy of springs, cables (tension times length), payload and load [J]."""
        d, (x, y) = self.design, self.tip(q)
        energy = d.payload * d.gravity * y - load[0] * x - load[1] * y
        for angle, tension in zip(q, tensions, strict=True):
            energy = energy + d.k / 2 * self._square(angle, -1) + tension * self._square(angle, 1) ** 0.5
        return energy

    def statics(self, q: Components, tensions: Components, load: Components = NO_LOAD) -> tuple[Components, Matrix]:
        """The gradient [N m] and the Hessian [N m/rad] of the energy, in closed form."""
        d = self.design
        fx, fy = load[0], load[1] - d.payload * d.gravity
        (jx1, jx2), (jy1, jy2) = self.jacobian(q)
        # Second derivatives of the tip: (x, y)'' is -(x, y) along q1, and -l (sin, cos)(q1 + q2) along the others.
        own, shared = fx * jy1 - fy * jx1, fx * jy2 - fy * jx2
        first, second = (self._joint(angle, tension) for angle, tension in zip(q, tensions, strict=True))
        gradient = first[0] - fx * jx1 - fy * jy1, second[0] - fx * jx2 - fy * jy2
        coupling = -shared
        return gradient, ((first[1] - own, coupling), (coupling, second[1] - shared))

    def energy_gradient(self, q: Components, tensions: Components, load: Components = NO_LOAD) -> Components:
        """The gradient of the energy [N m]."""
        return self.statics(q, tensions, load)[0]

    def stiffness_matrix(self, q: Components, tensions: Components, load: Components = NO_LOAD) -> Matrix:
        """The Hessian of the energy [N m/rad]."""
        return self.statics(q, tensions, load)[1]

    def holding_tensions(self, q: Components, load: Components = NO_LOAD) -> Components:
        """The tensions under which q is an equilibrium [N], within their bounds or not."""
        without, _ = self.statics(q, (0.0 * q[0], 0.0 * q[1]), load)
        return tuple(-torque / self.lever(angle) for torque, angle in zip(without, q, strict=True))

    def stability_margin(
        self, q: Components, tensions: Components | None = None, load: Components = NO_LOAD
    ) -> Component:
        """The smallest eigenvalue of the stiffness matrix, divided by k w^2; of the holding tensions, if none are
        given.
        """
        tensions = self.holding_tensions(q, load) if tensions is None else tensions
        return smallest_eigenvalue(self.statics(q, tensions, load)[1]) / (self.design.k * self.design.w**2)

    def wrench_margin(self, q: Components, tensions: Components | None = None, load: Components = NO_LOAD) -> Component:
        """How far the tensions are from their bounds, divided by half of their range; of the holding tensions, if
        none are given.
        """
        d = self.design
        tensions = self.holding_tensions(q, load) if tensions is None else tensions
        xp = namespace_of(*tensions)
        lowest, highest = xp.minimum(*tensions), xp.maximum(*tensions)
        return xp.minimum(lowest - d.min_tension, d.max_tension - highest) * 2 / (d.max_tension - d.min_tension)

    def equilibrium(
        self, tensions: Sequence[Component], start: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> Equilibrium:
        """The equilibrium that the mast reaches from `start` under these tensions; see `relax`."""
        for name, values in (("tensions", tensions), ("start", start), ("load", load)):
            check_finite(name, values, 2)
        parameters = (self.design, as_components(tensions), as_components(load))
        return relax(_statics, start, parameters, self.design.joint_limit)

    def equilibria(self, tensions: Sequence[float], load: Sequence[float] = NO_LOAD) -> list[Equilibrium]:
        """All equilibria within the joint limits, stable or not."""
        limit, inputs, forces = self.design.joint_limit, as_components(tensions), as_components(load)
        return find_all(lambda q: self.statics(q, inputs, forces), (-limit, -limit), (limit, limit))

    def _square(self, angle: Component, side: int) -> Component:
        """The squared length of the cable (side 1) or the spring (side -1) of a joint [m^2]."""
        l, w, xp = self.design.l, self.design.w, namespace_of(angle)
        return l * l + 2 * w * w + side * 2 * w * l * xp.sin(angle) - 2 * w * w * xp.cos(angle)

    def lever(self, angle: Component) -> Component:
        """The derivative of a cable's length [m/rad]."""
        l, w, xp = self.design.l, self.design.w, namespace_of(angle)
        return (w * l * xp.cos(angle) + w * w * xp.sin(angle)) / self._square(angle, 1) ** 0.5

    def _joint(self, angle: Component, tension: Component) -> tuple[Component, Component]:
        """The first [N m] and the second derivative [N m/rad] of a joint's own energy."""
        l, w, k, xp = self.design.l, self.design.w, self.design.k, namespace_of(angle)
        s, c, lever = xp.sin(angle), xp.cos(angle), self.lever(angle)
        bend = (w * w * c - w * l * s - lever * lever) / self._square(angle, 1) ** 0.5
        return k * (w * w * s - w * l * c) + tension * lever, k * (w * w * c + w * l * s) + tension * bend


def _sides(foot: str, left: str, right: str) -> tuple[tuple[str, str], ...]:
    """The sides of a triangle."""
    return (foot, left), (foot, right), (left, right)


def _statics(q: Components, parameters: tuple[MastDesign, Components, Components]) -> tuple[Components, Matrix]:
    """`Mast.statics` as a function of a module, whose compiled form is kept."""
    design, tensions, load = parameters
    return Mast(design).statics(q, tensions, load)
