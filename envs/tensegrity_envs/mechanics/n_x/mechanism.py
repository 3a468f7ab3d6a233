"""The planar n-X manipulator: any number of anti-parallelogram (X) joints in series, springs, cables, offsets.

Derived here, as a generalization of the 2-X of [Muralidharan2022] ("Stable wrench-feasible workspace of a 2-X
tensegrity manipulator", hal-03670867) to n joints, each with its own bars and springs, and to any routing of the
cables; docs/n_x.md has the equations. Conventions are those of `mechanics.two_x`: alpha_i [rad] is the orientation of
the top bar of joint i relative to its base bar, counter-clockwise.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, as_components, is_symbol, namespace_of
from tensegrity_envs.compiler.pytree import tree_leaves
from tensegrity_envs.mechanics import equilibrium as _equilibrium
from tensegrity_envs.mechanics.checks import check_finite, check_single
from tensegrity_envs.mechanics.design import Member, take
from tensegrity_envs.mechanics.dual_triangle.eigenvalues import smallest_eigenvalue
from tensegrity_envs.mechanics.n_x import programmes, statics, structure, tensions
from tensegrity_envs.mechanics.n_x.design import NXDesign
from tensegrity_envs.mechanics.n_x.joint import Joint, joint_at
from tensegrity_envs.mechanics.n_x.routing import FROM_BASE, PER_JOINT, cable_names, routing_table

_NO_LOAD = (0.0, 0.0)
_FLATTEST = 1 - 1e-9  # |sin(alpha/2)| at which a joint counts as flat
_CELLS = (32, 32, 16, 6)  # along each joint, with which the search for all equilibria begins


class NX:
    """The n-X manipulator of one design, or of a batch of designs.

    A configuration is q = (alpha_1, ..., alpha_n) [rad], tensions are one for each cable [N], in the order of
    `input_names`, `load` is a dead force at the tip (fx, fy) [N] in world axes, besides gravity. Components are floats,
    NumPy arrays or Torch tensors of any (broadcastable) shape.

    Attributes:
        degrees_of_freedom: the number of joints n.
        routing: a row for each cable, a column for each joint: -1 left side, 1 right side, 0 not spanned.
        input_names: of the cables.
        stiffness_scale: what the stability margin is relative to: k b^2 of joint 1, k the mean of its springs
            (max_tension b without springs) [N m/rad].
    """

    def __init__(self, design: NXDesign) -> None:
        self.design = design
        self.degrees_of_freedom = design.joints
        self.routing = routing_table(design.routing, design.joints)
        self.input_names = cable_names(design.routing, self.routing)
        self._b, self._offsets = design.each("b"), design.each("a")
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

    def take(self, index: Any) -> "NX":
        """The mechanisms at `index` of a batch of designs; itself where there is one design only."""
        return NX(take(self.design, index)) if isinstance(self._probe, np.ndarray) else self

    # ------------------------------------------------------------------------------------------------ geometry

    @property
    def reach(self) -> Any:
        """An upper bound of the tip's distance from the base [m]."""
        return sum(self.design.each("l")) + sum(self._offsets)

    def _xp(self, *components: Component) -> Any:
        return namespace_of(self._probe, *components)

    def _joints(self, xp: Any, q: Sequence[Component]) -> list[Joint]:
        parts = zip(self._b, self._excess, q, strict=True)
        return [joint_at(xp, b, excess, xp.sin(alpha / 2), xp.cos(alpha / 2)) for b, excess, alpha in parts]

    def tip(self, q: Sequence[Component]) -> tuple[Component, Component]:
        """Tip position (x, y) [m]."""
        joints = self._joints(self._xp(*q), q)
        return statics.tip(joints, statics.turns(joints), self._offsets)

    def jacobian(self, q: Sequence[Component]) -> tuple[Components, Components]:
        """d tip / d alpha [m/rad]: ((dx/da1, ..., dx/dan), (dy/da1, ..., dy/dan))."""
        joints = self._joints(self._xp(*q), q)
        return statics.jacobian(joints, statics.turns(joints), self._offsets)

    def singularity(self, q: Sequence[Component]) -> Component:
        """det J of two joints [m2/rad2]; of more, sqrt(det J J^T), the product of the singular values, of one |J|."""
        x_row, y_row = self.jacobian(q)
        xp = self._xp(*x_row)
        n = len(q)
        if n == 1:
            return xp.hypot(x_row[0], y_row[0])
        minors = [x_row[i] * y_row[j] - x_row[j] * y_row[i] for i in range(n) for j in range(i + 1, n)]
        return minors[0] if n == 2 else xp.sqrt(sum(minor * minor for minor in minors))

    def nodes(self, q: Sequence[Component]) -> dict[str, tuple[Component, Component]]:
        """Positions (x, y) [m] of the nodes: Ai, Bi base left, right; Di, Ci top left, right of joint i; P tip."""
        return structure.nodes(self._xp(*q), self.design, q, [joint.r for joint in self._joints(self._xp(*q), q)])

    @property
    def members(self) -> tuple[Member, ...]:
        """Bars with their masses, springs and cables (drawn along the lateral sides that they span)."""
        return structure.members(self.design, self._bars, self.routing, self.input_names)

    def cable_lengths(self, q: Sequence[Component]) -> Components:
        """What varies of the length of every cable: the sum of the sides that it spans [m]."""
        xp = self._xp(*q)
        sides = [joint.sides(xp) for joint in self._joints(xp, q)]
        spanned = [[sides[j][max(side, 0)] for j, side in enumerate(row) if side] for row in self.routing]
        return tuple(sum(parts[1:], parts[0]) for parts in spanned)

    def torque_matrix(self, q: Sequence[Component]) -> tuple[Components, ...]:
        """Joint torque by tension, -d cable length / d alpha [m/rad]: n rows, a column for each cable.

        torque_matrix(q) @ tensions is the cables' torque [N m]; in equilibrium it equals the gradient of all other
        energy (`passive_gradient`).
        """
        joints = self._joints(self._xp(*q), q)
        rows = []
        for j, joint in enumerate(joints):
            left, right = joint.arms
            zero = 0.0 * left
            rows.append(tuple({-1: -left, 1: -right, 0: zero}[row[j]] for row in self.routing))
        return tuple(rows)

    # ------------------------------------------------------------------------------------------------- statics

    def potential_energy(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> Component:
        """Potential energy [J] of gravity (zero at the base), springs, cables and load."""
        xp = self._xp(*q, *tensions, *load)
        joints = self._joints(xp, q)
        total = statics.energy(joints, statics.turns(joints), self._offsets, self._weights, load)
        for j, joint in enumerate(joints):
            # k/2 (left^2 + right^2) with equal springs is k (l^2 - b^2 cos alpha)
            total = total + self._springs[j] * (self._excess[j] / (joint.b * joint.b) + 2 * joint.s * joint.s)
            total = total + self._unequal[j] * joint.r * joint.s
        for tension, length in zip(tensions, self.cable_lengths(q), strict=True):
            total = total + tension * length
        return total

    def _passive(
        self, joints: Sequence[Joint], load: Sequence[Component]
    ) -> tuple[list[Component], list[list[Component]]]:
        """Gradient [N m] and Hessian [N m/rad] (its upper triangle) of the energy without cables."""
        given = None if load is _NO_LOAD else load
        gradient, hessian = statics.derivatives(joints, statics.turns(joints), self._offsets, self._weights, given)
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
        gradient, hessian = self._passive(joints, load)
        for j, (joint, (left, right)) in enumerate(zip(joints, tensions.effective(self.routing, pull), strict=True)):
            total, difference = left + right, (right - left) * joint.b / 2
            gradient[j] = gradient[j] + total * joint.dr + difference * joint.c
            hessian[j][j] = hessian[j][j] + total * joint.ddr - difference * joint.s / 2
        return tuple(gradient), _symmetric(hessian)

    def statics(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, tuple[Components, ...]]:
        """Gradient and Hessian of the potential energy in one evaluation."""
        return self._active(self._joints(self._xp(*q, *tensions, *load), q), tensions, load)

    def energy_gradient(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> Components:
        """dU/dalpha [N m], zero in equilibrium."""
        return self.statics(q, tensions, load)[0]

    def stiffness_matrix(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, ...]:
        """Hessian of the potential energy [N m/rad], n rows; positive definite where stable."""
        return self.statics(q, tensions, load)[1]

    def passive_gradient(self, q: Sequence[Component], load: Sequence[Component] = _NO_LOAD) -> Components:
        """Gradient of the energy without cables [N m]: the torque that the cables must give to hold q."""
        return tuple(self._passive(self._joints(self._xp(*q, *load), q), load)[0])

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

        In these coordinates the flat poses are ordinary boundary points, and the energy of springs and cables is convex
        where both springs of a joint are equal.
        """
        xp = self._xp(*u, *tensions, *load)
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
        return tuple(g * t for g, t in zip(gradient, turn, strict=True)), _symmetric(rows)

    # --------------------------------------------------------------------------------------- wrench feasibility

    def _extreme(
        self, xp: Any, joints: Sequence[Joint], load: Sequence[Component], stiffest: bool
    ) -> tuple[Components, Component, Component]:
        """Stiffest or softest tensions, stability margin, and the distance of the others from their bound [N]."""
        gradient, hessian = self._passive(joints, load)
        holding = [tensions.held(xp, joint, g) for joint, g in zip(joints, gradient, strict=True)]
        low, high = self.design.min_tension, self.design.max_tension
        if self.design.routing == PER_JOINT:
            found, room = tensions.per_joint(xp, holding, low, high, stiffest)
        elif self.design.routing == FROM_BASE:
            found, room = tensions.from_base(xp, self.routing, holding, low, high, stiffest)
        else:
            found, room = programmes.extreme(self, joints, holding, hessian, stiffest)
        added = tensions.stiffness_of_cables(joints, tensions.effective(self.routing, found))
        for j, more in enumerate(added):
            hessian[j][j] = hessian[j][j] + more
        return tuple(found), smallest_eigenvalue(_symmetric(hessian)) / self.stiffness_scale, room

    def stiffest_tensions(self, q: Sequence[Component], load: Sequence[Component] = _NO_LOAD) -> Components:
        """The tensions [N] of greatest stiffness that hold q in equilibrium.

        "per_joint": the larger tension of each joint is max_tension; the other one follows and is not clipped.
        "from_base": the tensions of which every joint's stiffness is the greatest possible one. A matrix: those of the
        greatest smallest eigenvalue of the stiffness matrix. Where no tensions within the bounds hold q, the lower
        bound is lowered until some do, which then are below min_tension.
        """
        return self.posture(q, load)[0]

    def softest_tensions(self, q: Sequence[Component], load: Sequence[Component] = _NO_LOAD) -> Components:
        """The tensions [N] within the bounds of least stiffness that hold q, see `stiffest_tensions`.

        Of a wrench-infeasible q they mean nothing.
        """
        xp = self._xp(*q, *load)
        return self._extreme(xp, self._joints(xp, q), load, stiffest=False)[0]

    def posture(
        self, q: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, Component, Component]:
        """Stiffest tensions, stability margin and wrench margin of q in one evaluation."""
        xp = self._xp(*q, *load)
        found, stability, room = self._extreme(xp, self._joints(xp, q), load, stiffest=True)
        return found, stability, room / self.design.max_tension

    def posture_and_tip(self, q: Sequence[Component]) -> tuple[Components, Component, Component, Components]:
        """`posture` and `tip` of q in one evaluation."""
        xp = self._xp(*q)
        joints = self._joints(xp, q)
        found, stability, room = self._extreme(xp, joints, _NO_LOAD, stiffest=True)
        end = statics.tip(joints, statics.turns(joints), self._offsets)
        return found, stability, room / self.design.max_tension, end

    def wrench_margin(
        self, q: Sequence[Component], tensions: Sequence[Component] | None = None, load: Sequence[Component] = _NO_LOAD
    ) -> Component:
        """Distance of the tensions to their bounds, divided by max_tension [-]; positive inside.

        Without `tensions`: of the largest smallest tension with which tensions up to max_tension hold q, to
        min_tension, so that it is >= 0 exactly where q is wrench-feasible. With `tensions`: of those, to the nearer of
        both bounds.
        """
        if tensions is None:
            return self.posture(q, load)[2]
        xp = self._xp(*q, *tensions)
        low, high = self.design.min_tension, self.design.max_tension
        slack = [xp.minimum(f - low, high - f) for f in tensions]
        least = slack[0]
        for other in slack[1:]:
            least = xp.minimum(least, other)
        return least / high

    def stability_margin(
        self, q: Sequence[Component], tensions: Sequence[Component] | None = None, load: Sequence[Component] = _NO_LOAD
    ) -> Component:
        """Smallest eigenvalue of the stiffness matrix divided by `stiffness_scale` [-].

        Without `tensions`: at the stiffest ones, which is the best that can be had in this configuration.
        """
        if tensions is None:
            return self.posture(q, load)[1]
        return smallest_eigenvalue(self.stiffness_matrix(q, tensions, load)) / self.stiffness_scale

    def is_stable_wrench_feasible(self, q: Sequence[Component], load: Sequence[Component] = _NO_LOAD) -> Component:
        """Whether q is in the stable wrench-feasible joint space (SWFJ), joint limits included."""
        _, stability, wrench = self.posture(q, load)
        return (stability > 0) & (wrench >= 0) & self.is_within_limits(q)

    def is_within_limits(self, q: Sequence[Component]) -> Component:
        """Whether all joints are within the joint limits."""
        limit = self.design.joint_limit
        inside = abs(q[0]) <= limit
        for alpha in q[1:]:
            inside = inside & (abs(alpha) <= limit)
        return inside

    # --------------------------------------------------------------------------------------------- equilibrium

    def equilibrium(
        self, tensions: Sequence[Component], start: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> _equilibrium.Equilibrium:
        """The equilibrium that the arm reaches from `start` under these tensions, see `equilibrium.settle`.

        Args:
            tensions: one for each cable [N], each a float or an array of shape (m,).
            start: n angles [rad].
            load: (fx, fy) [N].

        Returns:
            Configuration [rad], residual [N m], is_stable, and the reason in words.

        Raises:
            ValueError: a number is NaN or infinite, or there are too few or too many.
        """
        check_finite("tensions", tensions, len(self.routing))
        check_finite("start", start, self.degrees_of_freedom)
        check_finite("load", load, 2)
        inputs, forces = as_components(tensions), as_components(load)
        return _equilibrium.settle(_statics, start, (self.design, inputs, forces), self.design.joint_limit)

    def equilibria(self, tensions: Sequence[float], load: Sequence[float] = _NO_LOAD) -> list[_equilibrium.Equilibrium]:
        """All equilibria within the joint limits (flat poses excluded), stable and unstable, sorted by configuration.

        By exclusion of cells, which is complete for up to four joints within seconds.

        Raises:
            ValueError: a number is NaN or infinite, there are too few or too many, the arm has more than four joints or
                is a batch of designs, or the equilibria form a continuum.
        """
        check_single(self._probe, "equilibria")
        check_finite("tensions", tensions, len(self.routing))
        check_finite("load", load, 2)
        n = self.degrees_of_freedom
        if n > len(_CELLS):
            raise ValueError(f"equilibria: for up to four joints, not for {n}; equilibrium(tensions, start) finds one")
        limit = self.design.joint_limit

        def here(q: Components) -> tuple[Components, tuple[Components, ...]]:
            return self.statics(q, tensions, load)

        return _equilibrium.find_all(here, (-limit,) * n, (limit,) * n, _CELLS[n - 1])


def _symmetric(upper: Sequence[Sequence[Component]]) -> tuple[Components, ...]:
    """A symmetric matrix from its upper triangle."""
    n = len(upper)
    return tuple(tuple(upper[min(i, j)][max(i, j)] for j in range(n)) for i in range(n))


def _statics(q: Components, parameters: Any) -> tuple[Components, tuple[Components, ...]]:
    design, pull, load = parameters
    return NX(design).statics(q, pull, load)
