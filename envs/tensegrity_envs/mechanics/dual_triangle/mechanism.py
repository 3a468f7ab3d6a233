"""The serial arm of dual-triangles: n equal segments in series, six free lengths (of three segments) as inputs.

Source: [Zhao2021] Zhao, Pashkevich, Klimchik, Chablat, "Kinematic control of compliant serial manipulators composed of
dual-triangles", ICCCR 2021. Where a printed equation is wrong the docstring says so; docs/dual_triangle.md lists every
correction. Two matter most: the loaded control law has the wrong sign, and stability is not ensured under load.

Conventions: q_i [rad] is the angle of segment i's moving triangle relative to its base triangle, counter-clockwise;
q > 0 moves the tip towards +y, and the straight arm lies along +x. Pivot 1 is at (b1, 0), the next ones at distances
b1 + b2, the tip P at b2 beyond the last. Spring 1 of a segment is the one on the +y side, which shortens for q > 0.
`load` is a dead force at the tip (fx, fy) [N] in world axes, in statics with a torque [N m] on the last triangle as a
third component, if there is one; compression of the straight arm is fx < 0. There is no gravity.
"""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, as_components, is_batch
from tensegrity_envs.mechanics import equilibrium as _equilibrium
from tensegrity_envs.mechanics.checks import check_finite, check_single, sized
from tensegrity_envs.mechanics.dual_triangle.branches import Branch, follow_load, heading_in_load
from tensegrity_envs.mechanics.dual_triangle.design import DualTriangleDesign
from tensegrity_envs.mechanics.dual_triangle.inverse import InverseSolution, inverse_kinematics
from tensegrity_envs.mechanics.dual_triangle.loads import (
    LoadedState,
    critical_load,
    estimate_load,
    identify,
    identify_from,
    straight_critical_loads,
)
from tensegrity_envs.mechanics.dual_triangle.local_optima import nearest, optima
from tensegrity_envs.mechanics.dual_triangle.redundancy import Objective, Redundancy, resolve
from tensegrity_envs.mechanics.dual_triangle.shooting import candidates, grid_of_starts, polish
from tensegrity_envs.mechanics.dual_triangle.statics import DualTriangleStatics
from tensegrity_envs.mechanics.n_x.redundancy import Optimum, measure_of

_NO_LOAD = (0.0, 0.0)


@sized(
    q=(lambda arm: arm.segments, "q_1, ..., q_n"),
    start=(lambda arm: arm.segments, "q_1, ..., q_n"),
    first=(lambda arm: arm.segments - 2, "all angles but the last two"),
    delta=(lambda arm: arm.segments, "delta_1, ..., delta_n"),
    free_lengths=(lambda arm: 2 * arm.segments, "spring 1 and spring 2 of every segment"),
    inputs=(lambda arm: 2 * arm.segments, "spring 1 and spring 2 of every segment"),
    load=((2, 3), "fx, fy, and a torque where there is one"),
    direction=(2, "x, y"),
    target=(2, "x, y"),
)
class DualTriangle(DualTriangleStatics):
    """An arm of n segments of one design, or of a batch of designs.

    A configuration is q = (q_1, ..., q_n) [rad]; free lengths are (spring 1 and spring 2 of segment 1, of segment 2,
    ...), 2 n of them [m]; control inputs are (delta_1, ..., delta_n) [m]. Components are floats, NumPy arrays or Torch
    tensors of any (broadcastable) shape.
    """

    def equilibrium(
        self, free_lengths: Sequence[Component], start: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> _equilibrium.Equilibrium:
        """The equilibrium that the arm reaches from rest at `start`, see `equilibrium.relax`.

        Args:
            free_lengths: 2 n of them [m], each a float or an array of shape (m,).
            start: n angles [rad].
            load: (fx, fy) [N], or (fx, fy, torque on the last triangle, counter-clockwise [N m]).

        Returns:
            Configuration [rad], residual [N m], is_stable, and the reason in words.

        Raises:
            ValueError: a number is NaN or infinite, or there are not 2 n free lengths and n angles.
        """
        check_finite("free_lengths", free_lengths, 2 * self.segments)
        check_finite("start", start, self.segments)
        check_finite("load", load, max(len(load), 2))

        parameters = (self.design, self.segments, as_components(free_lengths), as_components(load))
        return _equilibrium.relax(_statics, start, parameters, self.design.joint_limit)

    def equilibria(
        self, free_lengths: Sequence[float], load: Sequence[float] = _NO_LOAD
    ) -> list[_equilibrium.Equilibrium]:
        """All equilibria strictly inside the joint limits, stable and unstable, sorted by configuration.

        By intervals from the tip to the base, which exclude all that holds none (`shooting.py`), and Newton's method;
        without a load, by the segments' own. Of equilibria without any stiffness, which form a continuum, one is given,
        as unstable. Where very many boxes can neither be excluded nor told apart (springs that all but hold nothing),
        Newton's method starts from some of them, which need not lead to all.

        Args:
            free_lengths: 2 n of them [m].
            load: (fx, fy) [N], or (fx, fy, torque on the last triangle, counter-clockwise [N m]).

        Raises:
            ValueError: a number is not finite, there are not 2 n free lengths, or the arm is a batch of designs.
        """
        check_single(self._probe, "equilibria")
        check_finite("free_lengths", free_lengths, 2 * self.segments)
        check_finite("load", load, max(len(load), 2))
        points = candidates(self, free_lengths, load)
        if self.design.springs == "cable" and any(load):
            points = np.concatenate([points, grid_of_starts(self)], axis=1)
        found: list[_equilibrium.Equilibrium] = []
        neutral = False
        for point in polish(self, free_lengths, load, points).T:
            q = tuple(float(value) for value in point)
            gradient, hessian = self.statics(q, free_lengths, load)
            values = np.linalg.eigvalsh(np.array(hessian)) / self.stiffness_scale
            flat = bool(np.abs(values).min() < 1e-9)
            if flat and neutral and self.design.springs == "cable":
                continue
            neutral |= flat
            stable = bool(values[0] >= 1e-9)
            reason = "stable" if stable else "unstable: the stiffness matrix is not positive definite"
            found.append(_equilibrium.Equilibrium(q, float(np.linalg.norm(gradient)), stable, reason))
        return found

    def inverse_kinematics(self, x: float, y: float, *first: float) -> list[InverseSolution]:
        """All configurations with the given first n - 2 angles whose tip is at (x, y) [m], [Zhao2021, Eq. 7].

        The two-link inverse in closed form, for three segments given q1: with (u, v) the target seen from pivot n - 1,
        cos q_n = (u^2 + v^2 - l^2 - b2^2) / (2 l b2), l = b1 + b2. The print has atan for atan2 and lost its
        parentheses; its "5 b^2" is right. Solutions beyond the joint limits are given too, and marked.

        Returns:
            Two solutions, elbow +1 first, one where both are the same, none where the target is out of reach.

        Raises:
            ValueError: a number is not finite, there are not n - 2 angles, the arm has one segment only, or it is a
                batch of designs.
        """
        return inverse_kinematics(self, x, y, *first)

    def redundancy(
        self,
        x: Component,
        y: Component,
        start: Sequence[Component],
        objective: Objective | Literal["margin"] = "squares",
        joint_limit: Component | None = None,
    ) -> Redundancy:
        """The configuration with the tip at (x, y) that is nearest to a start, by one of three measures.

        "sum" of the joints' displacements [Zhao2021, objective a], the largest of them, "max" (b), or the sum of their
        "squares" (c), minimized over the whole self-motion curve within the joint limits (which the paper's objectives
        ignore), see `redundancy.py`. The optimum jumps along a path of targets, most often for "sum". Of other numbers
        of segments, and for the "margin", the best one of `local_optima`.

        Args:
            x: target [m], a float or an array of shape (m,).
            y: target [m].
            start: n angles [rad], floats or arrays of shape (m,).
            objective: "sum", "max" or "squares"; or "margin", see `local_optima`.
            joint_limit: |q_i| is at most this [rad]; None for the design's, infinity for none (displacements are then
                measured the shorter way round; of three segments only).

        Returns:
            Configuration, value of the objective, and for a target that cannot be reached the nearest point that can.

        Raises:
            ValueError: a number is not finite, the objective is unknown, the arm has one segment, or its triangles'
                heights are those of a batch of designs.
        """
        if self.segments < 2:
            raise ValueError(f"redundancy: for two segments or more, not for {self.segments}")
        check_finite("target", (x, y), 2)
        check_finite("start", start, self.segments)
        if self.segments != 3 or objective == "margin":
            return self._best_optima(x, y, start, objective, joint_limit)
        single = not is_batch(x, y, *start, self._probe)
        limit = np.asarray(self.design.joint_limit if joint_limit is None else joint_limit, float)
        if not np.all(limit > 0):
            raise ValueError(f"joint_limit = {joint_limit!r}: must be positive")
        shape = np.broadcast_shapes((1,), np.shape(x), np.shape(y), limit.shape, *(np.shape(s) for s in start))
        px, py, bound = (np.broadcast_to(np.asarray(value, float), shape) for value in (x, y, limit))
        origin = np.stack([np.broadcast_to(np.asarray(value, float), shape) for value in start])
        found = resolve(self._plain_links(), px, py, origin, objective, bound)
        if not single:
            return found
        q, value, reachable, nearest, distance = found
        return Redundancy(
            tuple(float(qi[0]) for qi in q),
            float(value[0]),
            bool(reachable[0]),
            (float(nearest[0][0]), float(nearest[1][0])),
            float(distance[0]),
        )

    def local_optima(
        self,
        x: float,
        y: float,
        objective: Objective | Literal["margin"] = "squares",
        start: Sequence[float] | None = None,
        load: Sequence[float] = _NO_LOAD,
    ) -> list[Optimum]:
        """The local optima among the configurations with the tip at (x, y) [m], best first; see `local_optima.py`.

        Args:
            x: target [m].
            y: target [m].
            objective: "sum", "max" or "squares" of the displacements from `start`, to be small
                [Zhao2021, section III]; or "margin", the smaller one of stability and wrench margin at the control
                law's inputs, to be large.
            start: n angles [rad]; zero by default.
            load: (fx, fy) [N], for "margin".

        Returns:
            The optima within the joint limits, none where the target is out of reach; of two segments all solutions.

        Raises:
            ValueError: a number is not finite, the objective is unknown, the arm has one segment, or it is a batch of
                designs.
        """
        if self.segments < 2:
            raise ValueError(f"local_optima: for two segments or more, not for {self.segments}")
        check_single(self._probe, "local_optima")
        begin = (0.0,) * self.segments if start is None else start
        check_finite("target", (x, y), 2)
        check_finite("start", begin, self.segments)
        check_finite("load", load, 2)
        place, limit = np.array(begin, float)[:, None], float(self.design.joint_limit)
        _, q, value = optima(self, np.array([float(x)]), np.array([float(y)]), place, objective, tuple(load), limit)
        return [Optimum(tuple(row), best) for row, best in zip(q.T.tolist(), value.tolist(), strict=True)]

    def _best_optima(
        self, x: Component, y: Component, start: Sequence[Component], objective: str, joint_limit: Component | None
    ) -> Redundancy:
        """`redundancy` by `local_optima`."""
        check_single(self._probe, "redundancy")
        limit = float(self.design.joint_limit if joint_limit is None else joint_limit)
        if not 0 < limit < math.inf:
            raise ValueError(f"joint_limit = {joint_limit!r}: must be positive and finite")
        single = not is_batch(x, y, *start)
        shape = np.broadcast_shapes((1,), np.shape(x), np.shape(y), *(np.shape(s) for s in start))
        px, py = (np.broadcast_to(np.asarray(value, float), shape) for value in (x, y))
        begin = np.stack([np.broadcast_to(np.asarray(value, float), shape) for value in start])
        owner, found, value = optima(self, px, py, begin, objective, _NO_LOAD, limit)
        targets, first = np.unique(owner, return_index=True)
        q, best, reached = np.zeros((self.segments, *shape)), np.zeros(shape), np.zeros(shape, bool)
        q[:, targets], best[targets], reached[targets] = found[:, first], value[first], True
        near = np.stack([px, py])
        for i in np.flatnonzero(~reached):
            q[:, i], near[:, i] = nearest(self, float(px[i]), float(py[i]), limit, begin[:, i])
            sign = -1.0 if objective == "margin" else 1.0
            best[i] = sign * measure_of(self, objective, begin, _NO_LOAD)(q[:, [i]], np.array([i]))[0]
        distance = np.hypot(near[0] - px, near[1] - py)
        if not single:
            return Redundancy(tuple(q), best, reached, (near[0], near[1]), distance)
        place = float(near[0, 0]), float(near[1, 0])
        return Redundancy(tuple(q[:, 0].tolist()), float(best[0]), bool(reached[0]), place, float(distance[0]))

    def straight_critical_loads(self, common: Component = 0.0) -> tuple[Component, ...]:
        """The n axial compressions [N] at which the straight arm loses stability, in one mode after the other.

        P_m = (2 K0 / b) sin^2((2 m - 1) pi / (4 n)) with K0 = k [L0 b - 2 (b^2 - a^2)] of a symmetric segment: in
        closed form for triangles of equal height. P_1 > 0 is condition (2) of [Zhao2021]: under load that guarantees no
        more than a buckling load that is not zero.

        Args:
            common: added to all free lengths [m]; longer ones are stiffer.
        """
        return straight_critical_loads(self, common)

    def critical_load(
        self,
        q: Sequence[Component],
        direction: Sequence[Component],
        common: Sequence[Component] | float = 0.0,
    ) -> Component:
        """The tip force [N] in a direction at which a configuration, held by the control law, loses its stability.

        The control law keeps q an equilibrium under every load, and the Hessian is affine in the force: a generalized
        eigenvalue problem. Stable at a force means stable at every smaller one. (For cables the Hessian is affine
        between the forces at which one becomes slack.) 0 where q is unstable without load, infinity where no force in
        this direction makes it so.

        Args:
            q: n angles [rad], floats or arrays of shape (m,).
            direction: (x, y), of any length.
            common: added to the free lengths [m], one number or n of them.

        Raises:
            ValueError: a number is not finite, or the direction is zero.
        """
        check_finite("q", q, self.segments)
        check_finite("direction", direction, 2)
        xp = self._xp(*q, *direction)
        length = xp.hypot(direction[0], direction[1])
        if not np.all(length > 0):
            raise ValueError(f"direction = {direction!r}: must not be zero")
        unit = direction[0] / length, direction[1] / length
        single = not is_batch(self._probe, *q, *unit)
        if self.design.springs == "bilateral" or single:
            found = critical_load(self, q, unit, common)
            return float(found) if single else found
        shape = np.broadcast_shapes(*(np.shape(value) for value in (*q, *unit)), np.shape(self._probe))
        wide = [np.broadcast_to(np.asarray(value, float), shape).ravel() for value in (*q, *unit)]
        n = self.segments
        answers = [
            critical_load(self.take(i), tuple(float(v) for v in row[:n]), (float(row[n]), float(row[n + 1])), common)
            for i, row in enumerate(zip(*wide, strict=True))
        ]
        return np.array(answers).reshape(shape)

    def load_branch(
        self,
        free_lengths: Sequence[float],
        direction: Sequence[float],
        start: Sequence[float],
        load: float = 0.0,
        max_load: float = math.inf,
        min_load: float = 0.0,
        step: float = 0.02,
        max_points: int = 2000,
    ) -> Branch:
        """Follow an equilibrium under a growing tip force, past folds, where the branch turns back in the load.

        Args:
            free_lengths: 2 n of them [m], kept.
            direction: (x, y) of the force, of any length.
            start: an equilibrium under `load` [rad].
            load: size of the force at the start [N].
            max_load: the branch ends there [N].
            min_load: and there [N].
            step: largest step in (angles [rad], load / (k b)).
            max_points: at most so many points.

        Raises:
            ValueError: a number is not finite, the direction is zero, the start is no equilibrium, or the arm is a
                batch of designs.
        """
        unit = self._unit("load_branch", free_lengths, direction)
        check_finite("start", start, self.segments)
        found = polish(self, free_lengths, (load * unit[0], load * unit[1]), np.array(start, float)[:, None])
        if not found.shape[1] or np.abs(found[:, 0] - np.array(start)).max() > 1e-3:
            raise ValueError(f"start = {start!r}: not an equilibrium under the load {load!r} N")
        z0 = np.append(found[:, 0], load)
        heading = heading_in_load(self, free_lengths, unit, z0)
        return follow_load(self, free_lengths, unit, z0, heading, max_load, min_load, step, max_points)

    def buckled_branch(
        self,
        mode: int = 1,
        side: int = 1,
        common: float = 0.0,
        max_load: float = math.inf,
        step: float = 0.02,
        max_points: int = 2000,
    ) -> Branch:
        """The buckled shapes that branch off the straight arm at its critical load number `mode`.

        Args:
            mode: 1 to n; the branches of the higher ones are unstable.
            side: 1 or -1, sign of q1.
            common: added to all free lengths [m].
            max_load: the branch ends there [N], or where an angle reaches its limit.
            step: largest step in (angles [rad], load / (k b)).
            max_points: at most so many points.

        Returns:
            The branch, its first point the straight arm at the critical load.

        Raises:
            ValueError: there is no such mode or side, or the arm is a batch of designs.
        """
        if mode not in range(1, self.segments + 1):
            raise ValueError(f"mode = {mode!r}: must be in 1 ... {self.segments}")
        if side not in (1, -1):
            raise ValueError(f"side = {side!r}: must be 1 or -1")
        straight = (0.0,) * self.segments
        lengths = self.free_lengths(self.control(straight, None, common), common)
        unit = self._unit("buckled_branch", lengths, (-1.0, 0.0))
        critical = float(self.straight_critical_loads(common)[mode - 1])
        values, vectors = np.linalg.eigh(np.array(self.stiffness_matrix(straight, lengths, (-critical, 0.0)), float))
        shape = vectors[:, np.abs(values).argmin()]
        heading = np.append(shape * (side * np.sign(shape[0])), 0.0)
        z0 = np.append(np.zeros(self.segments), critical)
        return follow_load(self, lengths, unit, z0, heading, max_load, -math.inf, step, max_points)

    def _unit(self, what: str, free_lengths: Sequence[float], direction: Sequence[float]) -> tuple[float, float]:
        check_single(self._probe, what)
        check_finite("free_lengths", free_lengths, 2 * self.segments)
        check_finite("direction", direction, 2)
        length = math.hypot(*direction)
        if length == 0:
            raise ValueError(f"direction = {direction!r}: must not be zero")
        return direction[0] / length, direction[1] / length

    # ------------------------------------------------------------------------------- what measurements reveal

    def estimate_load(self, q: Sequence[Component], free_lengths: Sequence[Component]) -> tuple[Component, Component]:
        """The tip force (fx, fy) [N] under which measured angles are in equilibrium: least squares of J^T F = -M.

        n equations, two unknowns: exact where the angles are. At a singular configuration, the straight arm, the force
        along the links cannot be seen in the torques; the force of smallest norm is given.
        """
        found = estimate_load(self, q, free_lengths)
        if is_batch(self._probe, *q, *free_lengths):
            return found[..., 0], found[..., 1]
        return float(found[0]), float(found[1])

    def identify(self, x: float, y: float, free_lengths: Sequence[float]) -> list[LoadedState]:
        """Every configuration within the limits, with its load, that explains a measured tip under known inputs.

        n + 2 equations (tip, equilibrium) for as many unknowns (n angles, two force components): the solutions are the
        stationary points of the springs' energy where the tip is. Sorted by configuration. Only the stable ones can be
        the state of an arm at rest; there may be several, and none for a tip out of reach. Two segments: both postures
        of the tip, each with its load. Three: all along the self-motion curve. More: those that Newton's method leads
        to from 300 starts.

        Args:
            x: measured tip [m].
            y: measured tip [m].
            free_lengths: 2 n of them [m].

        Raises:
            ValueError: a number is not finite, the arm has one segment, or it is a batch of designs.
        """
        check_single(self._probe, "identify")
        if self.segments < 2:
            raise ValueError(f"identify: for two segments or more, not for {self.segments}: its tip reveals no force")
        check_finite("tip", (x, y), 2)
        check_finite("free_lengths", free_lengths, 2 * self.segments)
        return identify(self, float(x), float(y), free_lengths)

    def identify_from(
        self,
        x: Component,
        y: Component,
        free_lengths: Sequence[Component],
        start: Sequence[Component],
        load: Sequence[Component] = _NO_LOAD,
        iterations: int = 20,
    ) -> LoadedState:
        """The solution of `identify` next to a state that was known a step before, by Newton's method, in batches.

        Args:
            x: measured tip [m], a float or an array of shape (m,).
            y: measured tip [m].
            free_lengths: 2 n of them [m].
            start: n angles [rad].
            load: (fx, fy) [N] known before.
            iterations: at most so many steps.

        Returns:
            Configuration, load, stability and residual; NaN where Newton's method did not converge.

        Raises:
            ValueError: a number is not finite, or there are not 2 n free lengths and n angles.
        """
        check_finite("tip", (x, y), 2)
        check_finite("free_lengths", free_lengths, 2 * self.segments)
        check_finite("start", start, self.segments)
        check_finite("load", load, 2)
        return identify_from(self, x, y, free_lengths, start, load, iterations)


def _statics(
    q: Components, parameters: tuple[DualTriangleDesign, int, Components, Components]
) -> tuple[Components, tuple[Components, ...]]:
    design, segments, free_lengths, load = parameters
    return DualTriangle(design, segments).statics(q, free_lengths, load)
