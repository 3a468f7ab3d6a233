"""Geometry and energy of the chain of X-joints, on components: what `NX` is built upon."""

from collections.abc import Sequence
from typing import Self

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, Namespace, is_symbol, namespace_of
from tensegrity_envs.compiler.pytree import tree_leaves
from tensegrity_envs.mechanics.design import Index, Member, check_design, take
from tensegrity_envs.mechanics.n_x import statics, structure, tensions
from tensegrity_envs.mechanics.n_x.design import NXDesign
from tensegrity_envs.mechanics.n_x.routing import PER_JOINT, cable_names, routing_table
from tensegrity_envs.mechanics.stiffness import TipStiffness
from tensegrity_envs.mechanics.x_joints.curve import Geometry
from tensegrity_envs.mechanics.x_joints.joint import Bars, Joint, joint_at

NO_LOAD = (0.0, 0.0)
_FLATTEST = 1 - 1e-9  # |sin(alpha/2)| at which a joint counts as flat


class Chain:
    """Kinematics, members and energy of an n-X manipulator; see `NX`."""

    def __init__(self, design: NXDesign) -> None:
        check_design(design, NXDesign, "THREE_X")
        self.design = design
        self.degrees_of_freedom = design.joints
        self.routing = routing_table(design.routing, design.joints)
        self.input_names = cable_names(design.routing, self.routing)
        self._b, self.offsets = design.each("b"), design.each("a")
        lengths = design.each("l")
        self._excess = tuple((l - b) * (l + b) for l, b in zip(lengths, self._b, strict=True))
        self._bars = structure.bars(design)
        self._weights = structure.weights(design, self._bars)
        sides = tuple(zip(design.each("k_left"), design.each("k_right"), strict=True))
        # half the sum of both springs' stiffnesses times b^2, half their difference times b
        self._springs = tuple((k + m) / 2 * b * b for (k, m), b in zip(sides, self._b, strict=True))
        self._unequal = tuple((m - k) * b for (k, m), b in zip(sides, self._b, strict=True))
        first = self._springs[0]
        self.stiffness_scale = first + (first == 0) * design.max_tension * self._b[0]
        # The one component that tells floats from arrays when a batch of designs meets a single configuration.
        self._probe: Component = sum(
            tree_leaves(design, lambda value: isinstance(value, np.ndarray) or is_symbol(value))
        )

    def take(self, index: Index) -> Self:
        """The mechanisms at `index` of a batch of designs; itself where there is one design only."""
        return type(self)(take(self.design, index)) if isinstance(self._probe, np.ndarray) else self

    # ------------------------------------------------------------------------------------------------ geometry

    @property
    def bars(self) -> tuple[Bars, ...]:
        """Those of the joints, from the base on."""
        return tuple(map(Bars, self._b, self.design.each("l"), self.offsets))

    @property
    def geometry(self) -> Geometry:
        """See `x_joints.curve.Pair`."""
        columns = (self._b, self.design.each("l"), self.offsets)
        b, l, a = (tuple(np.array([value], float) for value in column) for column in columns)
        design: NXDesign = object.__new__(NXDesign)
        kept = {"joints": self.degrees_of_freedom, "routing": PER_JOINT, "k_right": None}
        vars(design).update(dict.fromkeys(vars(self.design), 1.0) | {"b": b, "l": l, "a": a} | kept)
        return Chain, design

    @property
    def reach(self) -> Component:
        """An upper bound of the tip's distance from the base [m]."""
        return sum(self.design.each("l")) + sum(self.offsets)

    def namespace(self, *components: Component) -> Namespace:
        """Where the arithmetic of these components comes from."""
        return namespace_of(self._probe, *components)

    def joints(self, xp: Namespace, q: Sequence[Component]) -> list[Joint]:
        """The joints in a configuration."""
        parts = zip(self._b, self._excess, q, strict=True)
        return [joint_at(xp, b, excess, xp.sin(alpha / 2), xp.cos(alpha / 2)) for b, excess, alpha in parts]

    def tip(self, q: Sequence[Component], inputs: Sequence[Component] | None = None) -> tuple[Component, Component]:
        """Tip position (x, y) [m]."""
        joints = self.joints(self.namespace(*q), q)
        return statics.tip(joints, statics.turns(joints), self.offsets)

    def jacobian(
        self, q: Sequence[Component], inputs: Sequence[Component] | None = None, load: Sequence[Component] | None = None
    ) -> tuple[Components, Components]:
        """d tip / d alpha [m/rad]: ((dx/da1, ..., dx/dan), (dy/da1, ..., dy/dan))."""
        joints = self.joints(self.namespace(*q), q)
        return statics.jacobian(joints, statics.turns(joints), self.offsets)

    def jacobian_determinant(
        self, q: Sequence[Component], inputs: Sequence[Component] | None = None, load: Sequence[Component] | None = None
    ) -> Component:
        """det J of two joints [m2/rad2]; of more, sqrt(det J J^T), the product of the singular values, of one |J|."""
        x_row, y_row = self.jacobian(q)
        xp = self.namespace(*x_row)
        n = len(q)
        if n == 1:
            return xp.hypot(x_row[0], y_row[0])
        minors = [x_row[i] * y_row[j] - x_row[j] * y_row[i] for i in range(n) for j in range(i + 1, n)]
        return minors[0] if n == 2 else xp.sqrt(sum(minor * minor for minor in minors))

    def nodes(
        self, q: Sequence[Component], inputs: Sequence[Component] | None = None
    ) -> dict[str, tuple[Component, Component]]:
        """Positions (x, y) [m] of the nodes: Ai, Bi base left, right; Di, Ci top left, right of joint i; P tip."""
        return structure.nodes(
            self.namespace(*q), self.design, q, [joint.r for joint in self.joints(self.namespace(*q), q)]
        )

    @property
    def members(self) -> tuple[Member, ...]:
        """Bars with their masses, springs and cables (drawn along the lateral sides that they span)."""
        return structure.members(self.design, self._bars, self.routing, self.input_names)

    def cable_lengths(self, q: Sequence[Component]) -> Components:
        """What varies of the length of every cable: the sum of the sides that it spans [m]."""
        xp = self.namespace(*q)
        sides = [joint.sides(xp) for joint in self.joints(xp, q)]
        spanned = [[sides[j][max(side, 0)] for j, side in enumerate(row) if side] for row in self.routing]
        return tuple(sum(parts[1:], parts[0]) for parts in spanned)

    def torque_matrix(self, q: Sequence[Component]) -> tuple[Components, ...]:
        """Joint torque by tension, -d cable length / d alpha [m/rad]: n rows, a column for each cable.

        torque_matrix(q) @ tensions is the cables' torque [N m]; in equilibrium it equals the gradient of all other
        energy (`passive_gradient`).
        """
        joints = self.joints(self.namespace(*q), q)
        rows = []
        for j, joint in enumerate(joints):
            left, right = joint.arms
            zero = 0.0 * left
            rows.append(tuple({-1: -left, 1: -right, 0: zero}[row[j]] for row in self.routing))
        return tuple(rows)

    # ------------------------------------------------------------------------------------------------- statics

    def potential_energy(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> Component:
        """Potential energy [J] of gravity (zero at the base), springs, cables and load."""
        xp = self.namespace(*q, *tensions, *load)
        joints = self.joints(xp, q)
        total = statics.energy(joints, statics.turns(joints), self.offsets, self._weights, load)
        for j, joint in enumerate(joints):
            # k/2 (left^2 + right^2) with equal springs is k (l^2 - b^2 cos alpha)
            total = total + self._springs[j] * (self._excess[j] / (joint.b * joint.b) + 2 * joint.s * joint.s)
            total = total + self._unequal[j] * joint.r * joint.s
        for tension, length in zip(tensions, self.cable_lengths(q), strict=True):
            total = total + tension * length
        return total

    def passive(
        self, joints: Sequence[Joint], load: Sequence[Component]
    ) -> tuple[list[Component], list[list[Component]]]:
        """Gradient [N m] and Hessian [N m/rad] (its upper triangle) of the energy without cables."""
        given = None if load is NO_LOAD else load
        gradient, hessian = statics.derivatives(joints, statics.turns(joints), self.offsets, self._weights, given)
        for j, joint in enumerate(joints):
            s, c, k, unequal = joint.s, joint.c, self._springs[j], self._unequal[j]
            gradient[j] = gradient[j] + k * (2 * s * c) + unequal * (joint.dr * s + joint.r * c / 2)
            bend = joint.ddr * s + joint.dr * c - joint.r * s / 4
            hessian[j][j] = hessian[j][j] + k * (c * c - s * s) + unequal * bend
        return gradient, hessian

    def _active(
        self, joints: Sequence[Joint], pull: Sequence[Component], load: Sequence[Component]
    ) -> tuple[Components, tuple[Components, ...]]:
        """Gradient and Hessian of the whole energy."""
        gradient, hessian = self.passive(joints, load)
        for j, (joint, (left, right)) in enumerate(zip(joints, tensions.effective(self.routing, pull), strict=True)):
            total, difference = left + right, (right - left) * joint.b / 2
            gradient[j] = gradient[j] + total * joint.dr + difference * joint.c
            hessian[j][j] = hessian[j][j] + total * joint.ddr - difference * joint.s / 2
        return tuple(gradient), symmetric(hessian)

    def statics(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> tuple[Components, tuple[Components, ...]]:
        """Gradient and Hessian of the potential energy in one evaluation."""
        return self._active(self.joints(self.namespace(*q, *tensions, *load), q), tensions, load)

    def energy_gradient(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> Components:
        """dU/dalpha [N m], zero in equilibrium."""
        return self.statics(q, tensions, load)[0]

    def stiffness_matrix(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> tuple[Components, ...]:
        """Hessian of the potential energy [N m/rad], n rows; positive definite where stable."""
        return self.statics(q, tensions, load)[1]

    def passive_gradient(self, q: Sequence[Component], load: Sequence[Component] = NO_LOAD) -> Components:
        """Gradient of the energy without cables [N m]: the torque that the cables must give to hold q."""
        return tuple(self.passive(self.joints(self.namespace(*q, *load), q), load)[0])

    def to_sines(self, q: Sequence[Component]) -> Components:
        """u_i = sin(alpha_i / 2), the coordinates of `sine_statics`; for joints up."""
        xp = self.namespace(*q)
        return tuple(xp.sin(alpha / 2) for alpha in q)

    def from_sines(self, u: Sequence[Component]) -> Components:
        """alpha_i = 2 asin(u_i) [rad]."""
        xp = self.namespace(*u)
        inside = [xp.maximum(xp.minimum(ui, _FLATTEST), -_FLATTEST) for ui in u]
        return tuple(2 * xp.atan2(ui, xp.sqrt(1 - ui * ui)) for ui in inside)

    def sine_statics(
        self, u: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> tuple[Components, tuple[Components, ...]]:
        """Gradient and Hessian of the potential energy in u_i = sin(alpha_i / 2) [J], for joints up.

        In these coordinates the flat poses are ordinary boundary points, and the energy of springs and cables is convex
        where both springs of a joint are equal.
        """
        xp = self.namespace(*u, *tensions, *load)
        joints = []
        for unlimited, b, excess in zip(u, self._b, self._excess, strict=True):
            ui = xp.maximum(xp.minimum(unlimited, _FLATTEST), -_FLATTEST)
            joints.append(joint_at(xp, b, excess, ui, xp.sqrt(1 - ui * ui)))
        gradient, hessian = self._active(joints, tensions, load)
        turn = [2 / joint.c for joint in joints]  # d alpha / d u
        n = len(turn)
        rows: list[list[Component]] = [[0.0] * n for _ in range(n)]
        for i in range(n):
            bend = gradient[i] * (joints[i].s / (2 * joints[i].c))
            rows[i][i] = (hessian[i][i] + bend) * turn[i] * turn[i]
            for j in range(i + 1, n):
                rows[i][j] = hessian[i][j] * turn[i] * turn[j]
        return tuple(g * t for g, t in zip(gradient, turn, strict=True)), symmetric(rows)


class CableArm(Chain, TipStiffness):
    """A chain and what holds it in a posture: what searches over the postures of an `NX` asks of it."""


def symmetric(upper: Sequence[Sequence[Component]]) -> tuple[Components, ...]:
    """A symmetric matrix from its upper triangle."""
    n = len(upper)
    return tuple(tuple(upper[min(i, j)][max(i, j)] for j in range(n)) for i in range(n))
