"""The planar n-X manipulator: any number of anti-parallelogram (X) joints in series, springs, cables, offsets.

Derived here, as a generalization of the 2-X of [Muralidharan2022] ("Stable wrench-feasible workspace of a 2-X
tensegrity manipulator", hal-03670867) to n joints, each with its own bars and springs, and to any routing of the
cables; docs/n_x.md has the equations. Conventions are those of `mechanics.two_x`: alpha_i [rad] is the orientation of
the top bar of joint i relative to its base bar, counter-clockwise.
"""

import math
from collections.abc import Sequence

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, Namespace, as_components
from tensegrity_envs.mechanics import equilibrium as _equilibrium
from tensegrity_envs.mechanics.checks import check_finite, check_numbers, check_single, common_shape, sized
from tensegrity_envs.mechanics.eigenvalues import smallest_eigenvalue
from tensegrity_envs.mechanics.n_x import buckling, inverse, local_optima, programmes, statics, tensions, wrenches
from tensegrity_envs.mechanics.n_x.chain import NO_LOAD, CableArm, symmetric
from tensegrity_envs.mechanics.n_x.design import NXDesign
from tensegrity_envs.mechanics.n_x.redundancy import Redundancy
from tensegrity_envs.mechanics.n_x.routing import FROM_BASE, PER_JOINT
from tensegrity_envs.mechanics.n_x.vertices import extreme_stiffness
from tensegrity_envs.mechanics.optima.objectives import Objective, Optimum
from tensegrity_envs.mechanics.x_joints.joint import Joint

_CELLS = (32, 32, 16)  # along each joint, with which the search for all equilibria begins


@sized(
    q=(lambda arm: arm.degrees_of_freedom, "alpha_1, ..., alpha_n"),
    start=(lambda arm: arm.degrees_of_freedom, "alpha_1, ..., alpha_n"),
    u=(lambda arm: arm.degrees_of_freedom, "u_1, ..., u_n"),
    tensions=(lambda arm: len(arm.routing), "one for each cable"),
    inputs=(lambda arm: len(arm.routing), "one for each cable"),
    load=(2, "fx, fy"),
    direction=(2, "x, y"),
)
class NX(CableArm):
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

    # --------------------------------------------------------------------------------------- wrench feasibility

    def _extreme(
        self, xp: Namespace, joints: Sequence[Joint], load: Sequence[Component], stiffest: bool
    ) -> tuple[Components, Component, Component]:
        """Stiffest or softest tensions, stability margin, and the distance of the others from their bound [N]."""
        gradient, hessian = self.passive(joints, load)
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
        return tuple(found), smallest_eigenvalue(symmetric(hessian)) / self.stiffness_scale, room

    def stiffest_tensions(self, q: Sequence[Component], load: Sequence[Component] = NO_LOAD) -> Components:
        """The tensions [N] of greatest stiffness that hold q in equilibrium.

        "per_joint": the larger tension of each joint is max_tension; the other one follows and is not clipped.
        "from_base": the tensions of which every joint's stiffness is the greatest possible one. A matrix: those of the
        greatest smallest eigenvalue of the stiffness matrix. Where no tensions within the bounds hold q, the lower
        bound is lowered until some do, which then are below min_tension.
        """
        return self.posture(q, load)[0]

    def softest_tensions(self, q: Sequence[Component], load: Sequence[Component] = NO_LOAD) -> Components:
        """The tensions [N] within the bounds of least stiffness that hold q, see `stiffest_tensions`.

        Of a wrench-infeasible q they mean nothing.
        """
        xp = self.namespace(*q, *load)
        return self._extreme(xp, self.joints(xp, q), load, stiffest=False)[0]

    def posture(
        self, q: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> tuple[Components, Component, Component]:
        """Stiffest tensions, stability margin and wrench margin of q in one evaluation."""
        xp = self.namespace(*q, *load)
        found, stability, room = self._extreme(xp, self.joints(xp, q), load, stiffest=True)
        return found, stability, room / self.design.max_tension

    def posture_and_tip(self, q: Sequence[Component]) -> tuple[Components, Component, Component, Components]:
        """`posture` and `tip` of q in one evaluation."""
        xp = self.namespace(*q)
        joints = self.joints(xp, q)
        found, stability, room = self._extreme(xp, joints, NO_LOAD, stiffest=True)
        end = statics.tip(joints, statics.turns(joints), self.offsets)
        return found, stability, room / self.design.max_tension, end

    def wrench_margin(
        self, q: Sequence[Component], tensions: Sequence[Component] | None = None, load: Sequence[Component] = NO_LOAD
    ) -> Component:
        """Distance of the tensions to their bounds, divided by max_tension [-]; positive inside.

        Without `tensions`: of the largest smallest tension with which tensions up to max_tension hold q, to
        min_tension, so that it is >= 0 exactly where q is wrench-feasible. With `tensions`: of those, to the nearer of
        both bounds.
        """
        if tensions is None:
            return self.posture(q, load)[2]
        xp = self.namespace(*q, *tensions)
        low, high = self.design.min_tension, self.design.max_tension
        slack = [xp.minimum(f - low, high - f) for f in tensions]
        least = slack[0]
        for other in slack[1:]:
            least = xp.minimum(least, other)
        return least / high

    def stability_margin(
        self, q: Sequence[Component], tensions: Sequence[Component] | None = None, load: Sequence[Component] = NO_LOAD
    ) -> Component:
        """Smallest eigenvalue of the stiffness matrix divided by `stiffness_scale` [-].

        Without `tensions`: at the stiffest ones, which is the best that can be had in this configuration.
        """
        if tensions is None:
            return self.posture(q, load)[1]
        return smallest_eigenvalue(self.stiffness_matrix(q, tensions, load)) / self.stiffness_scale

    def is_stable_wrench_feasible(self, q: Sequence[Component], load: Sequence[Component] = NO_LOAD) -> Component:
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

    def torque_zonotope(self, q: Sequence[float]) -> wrenches.Zonotope:
        """The joint torques [N m] that tensions within bounds give at q, exactly. Raises ValueError for a batch."""
        check_single(self._probe, "torque_zonotope")
        check_finite("q", q, self.degrees_of_freedom)
        low, high = float(self.design.min_tension), float(self.design.max_tension)
        return wrenches.torque_zonotope(np.array(self.torque_matrix(tuple(map(float, q)))), low, high)

    def tip_forces(self, q: Sequence[float]) -> np.ndarray:
        """The dead forces at the tip under which tensions within their bounds hold q, exactly.

        Returns:
            Vertices of the polygon (fx, fy) [N], counter-clockwise, shape (k, 2); none where no force is feasible.

        Raises:
            ValueError: the set is not bounded (one joint, or a singular posture) or has no area (a joint that no cable
                spans, or too few cables), or the mechanism is a batch.
        """
        zonotope, here = self.torque_zonotope(q), tuple(map(float, q))
        return wrenches.tip_force_polygon(
            zonotope, np.array(self.passive_gradient(here)), np.array(self.jacobian(here))
        )

    def critical_load(self, q: Sequence[float], direction: Sequence[float]) -> buckling.CriticalLoad:
        """The largest tip force in a direction under which q is in the stable wrench-feasible joint space.

        The stiffest tensions follow the load, so that q stays in equilibrium.

        Raises:
            ValueError: a number is not finite, the direction is zero, or the mechanism is a batch of designs.
        """
        check_single(self._probe, "critical_load")
        check_finite("q", q, self.degrees_of_freedom)
        return buckling.critical_load(self, tuple(map(float, q)), _unit(direction))

    def buckling_load(
        self,
        tensions: Sequence[float],
        direction: Sequence[float],
        start: Sequence[float] | None = None,
        largest: float | None = None,
    ) -> buckling.CriticalLoad:
        """The tip force in a direction at which the arm loses its stability at constant tensions, growing from zero.

        The equilibrium that the arm reaches from `start` is followed while the force grows. An upright symmetric arm
        under a vertical force stays upright, up to its buckling load.

        Args:
            tensions: one for each cable [N].
            direction: (x, y), of any length but zero.
            start: n angles [rad]; zero by default.
            largest: force up to which to look [N]; 100 times max_tension by default.

        Raises:
            ValueError: a number is not finite, the direction is zero, there is no stable equilibrium without the force,
                `largest` is not positive, or the mechanism is a batch of designs.
        """
        check_single(self._probe, "buckling_load")
        if largest is not None:
            check_numbers("largest", (largest,), 1)
            if largest <= 0:
                raise ValueError(f"largest = {largest!r}: must be positive [N], or None for 100 times max_tension")
        begin = (0.0,) * self.degrees_of_freedom if start is None else tuple(map(float, start))
        rest = self.equilibrium(tensions, begin)
        if not rest.is_stable:
            raise ValueError(f"tensions = {tensions!r}: no stable equilibrium without the force: {rest.reason}")
        end = 100 * float(self.design.max_tension) if largest is None else float(largest)
        pull = tuple(map(float, tensions))
        return buckling.buckling_load(_loaded, (self.design, pull), _unit(direction), rest.configuration, end)

    def _softest_and_stiffest(
        self, q: Sequence[Component], load: Sequence[Component], direction: Sequence[Component] | None
    ) -> tuple[Components, Components]:
        """See `TipStiffness`; with cables by a matrix no tensions need be softest in every direction."""
        if isinstance(self.design.routing, str):
            return super()._softest_and_stiffest(q, load, direction)
        if any(np.ndim(value) for value in (*q, *load, *(direction or ()))):
            raise ValueError("stiffness: of a routing that is given as a matrix for one posture at a time, of floats")
        return extreme_stiffness(self, tuple(map(float, q)), load, direction)

    # --------------------------------------------------------------------------------------------- equilibrium

    def equilibrium(
        self, tensions: Sequence[Component], start: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> _equilibrium.Equilibrium:
        """The equilibrium that the arm reaches from `start` under these tensions, see `equilibrium.relax`.

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
        return _equilibrium.relax(_statics, start, (self.design, inputs, forces), self.design.joint_limit)

    def equilibria(self, tensions: Sequence[float], load: Sequence[float] = NO_LOAD) -> list[_equilibrium.Equilibrium]:
        """All equilibria within the joint limits (flat poses excluded), stable and unstable, sorted by configuration.

        By exclusion of cells, which is complete for up to three joints; four can take too many cells.

        Raises:
            ValueError: a number is NaN or infinite, there are too few or too many, the arm has more than three joints
                or is a batch of designs, or the equilibria form a continuum.
        """
        check_single(self._probe, "equilibria")
        check_numbers("tensions", tensions, len(self.routing))
        check_numbers("load", load, 2)
        n = self.degrees_of_freedom
        if n > len(_CELLS):
            raise ValueError(f"equilibria: for up to three joints, not for {n}; equilibrium(tensions, start) finds one")
        limit = self.design.joint_limit

        def here(q: Components) -> tuple[Components, tuple[Components, ...]]:
            return self.statics(q, tensions, load)

        return _equilibrium.find_all(here, (-limit,) * n, (limit,) * n, _CELLS[n - 1])

    # ---------------------------------------------------------------------------------------- inverse kinematics

    def inverse_kinematics(self, x: float, y: float) -> list[inverse.InverseSolution]:
        """All configurations within the joint limits with the tip at (x, y) [m], of an arm of one or two joints.

        The real roots of one polynomial of degree eight, polished and verified by forward kinematics; of one joint in
        closed form, where the target is on its curve. More joints have a continuum of solutions, see `redundancy`.

        Raises:
            ValueError: x or y is not a finite number, the arm has three joints or more, the mechanism is a batch of
                designs, or the target is the base and its solutions are a continuum.
        """
        if self.degrees_of_freedom > 2:
            raise ValueError(
                f"inverse_kinematics: {self.degrees_of_freedom} joints reach a point in a continuum of configurations; "
                "redundancy(x, y, start, objective) picks one, local_optima(...) lists what there is to pick from"
            )
        check_single(self._probe, "inverse_kinematics")
        check_finite("target", (x, y), 2)
        _, found, residual = inverse.all_solutions(self, np.array([float(x)]), np.array([float(y)]))
        solutions = []
        for column, distance in zip(found.T.tolist(), residual.tolist(), strict=True):
            q = tuple(column)
            _, stability, wrench = self.posture(q)
            state = "".join("U" if abs(alpha) < math.pi else "D" for alpha in q)
            solutions.append(
                inverse.InverseSolution(q, state, self.jacobian_determinant(q), stability, wrench, distance)
            )
        return solutions

    def local_optima(
        self,
        x: float,
        y: float,
        objective: Objective = "squares",
        start: Sequence[float] | None = None,
        load: Sequence[float] = NO_LOAD,
    ) -> list[Optimum]:
        """The local optima among the configurations of three or more joints with the tip at (x, y) [m], best first.

        Args:
            x, y: target [m].
            objective: "sum", "max" or "squares" of the displacements from `start`, to be small
                ([Zhao2021, section III], of joint angles); or "margin", the smaller one of stability and wrench margin,
                to be large.
            start: n angles [rad]; zero by default.
            load: (fx, fy) [N], for "margin".

        Returns:
            The optima within the joint limits, none where the target is out of reach. Of more than three joints each
            is a local optimum by the test of `optima.optimality`; the first one is what is best of all that was looked
            at, and need not pass it.

        Raises:
            ValueError: a number is not finite, the arm has fewer than three joints, or the mechanism is a batch.
        """
        check_numbers("target", (x, y), 2)
        check_numbers("start", (0.0,) * self.degrees_of_freedom if start is None else start, self.degrees_of_freedom)
        found = self._optima(x, y, objective, start, load)
        return [Optimum(tuple(q), v) for q, v in zip(found[1].T.tolist(), found[2].tolist(), strict=True)]

    def redundancy(
        self,
        x: Component,
        y: Component,
        start: Sequence[Component] | None = None,
        objective: Objective = "squares",
        load: Sequence[float] = NO_LOAD,
    ) -> Redundancy:
        """The best configuration with the tip at (x, y) [m], floats or arrays of shape (m,); see `local_optima`.

        Args:
            x, y: targets.
            start: n angles [rad], floats or arrays of shape (m,); zero by default.
            objective: see `local_optima`.
            load: (fx, fy) [N], under which "margin" and the margins of the result are.

        Returns:
            Configuration, value of the objective, and whether the target is reached. Displacements take no notice of
            tensions: the result's margins, and `is_stable_wrench_feasible`, tell whether some hold the configuration.

        Raises:
            ValueError: see `local_optima`.
        """
        owner, q, value = self._optima(x, y, objective, start, load)
        first = np.unique(owner, return_index=True)
        (m,) = common_shape("x, y and start", x, y, *(() if start is None else start))
        best, values, there = np.full((len(q), m), np.nan), np.full(m, np.nan), np.zeros(m, bool)
        best[:, first[0]], values[first[0]], there[first[0]] = q[:, first[1]], value[first[1]], True
        stability, wrench = np.full((2, m), np.nan)
        if there.any():
            _, stability[there], wrench[there] = self.posture(tuple(best[:, there]), tuple(load))
        if any(map(np.ndim, (x, y, *(() if start is None else start)))):
            return Redundancy(tuple(best), values, there, stability, wrench)
        margins = float(stability[0]), float(wrench[0])
        return Redundancy(tuple(best[:, 0].tolist()), float(values[0]), bool(there[0]), *margins)

    def _optima(
        self, x: Component, y: Component, objective: str, start: Sequence[Component] | None, load: Sequence[float]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        n = self.degrees_of_freedom
        if n < 3:
            raise ValueError(f"redundancy: for three joints or more, not for {n}; see inverse_kinematics")
        check_single(self._probe, "redundancy")
        begin = (0.0,) * n if start is None else start
        check_finite("target", (x, y), 2)
        check_finite("start", begin, n)
        check_finite("load", load, 2)
        shape = common_shape("x, y and start", x, y, *begin)
        px, py, *angles = (np.broadcast_to(np.asarray(value, float), shape) for value in (x, y, *begin))
        places = np.stack(angles)
        return local_optima.optima(self, px, py, places, objective, tuple(load))


def _unit(direction: Sequence[float]) -> tuple[float, float]:
    """The direction with length 1.

    Raises:
        ValueError: it is zero, or not two finite numbers.
    """
    check_finite("direction", direction, 2)
    length = math.hypot(*direction)
    if length == 0:
        raise ValueError(f"direction = {direction!r}: must not be zero")
    return direction[0] / length, direction[1] / length


def _statics(
    q: Components, parameters: tuple[NXDesign, Components, Components]
) -> tuple[Components, tuple[Components, ...]]:
    design, pull, load = parameters
    return NX(design).statics(q, pull, load)


def _loaded(
    start: Components, parameters: tuple[NXDesign, Components], begin: Components, end: Components
) -> tuple[Components, Component]:
    """The equilibrium while the load grows evenly, and how much of the way it could be followed."""
    design, tensions = parameters

    def path(q: Components, t: Component) -> tuple[Components, tuple[Components, ...]]:
        load = tuple(a + t * (b - a) for a, b in zip(begin, end, strict=True))
        return NX(design).statics(q, tensions, load)

    return _equilibrium.continuation(path, start, buckling.RESOLUTION)
