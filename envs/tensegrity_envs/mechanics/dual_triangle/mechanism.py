"""The serial arm of dual-triangles: n segments in series, equal or not, six free lengths (of three segments) as inputs.

Source: [Zhao2021] Zhao, Pashkevich, Klimchik, Chablat, "Kinematic control of compliant serial manipulators composed of
dual-triangles", ICCCR 2021. Where a printed equation is wrong the docstring says so; docs/dual_triangle.md lists every
correction. Two matter most: the loaded control law has the wrong sign, and stability is not ensured under load.

Conventions: q_i [rad] is the angle of segment i's moving triangle relative to its base triangle, counter-clockwise;
q > 0 moves the tip towards +y, and the straight arm lies along +x. Pivot 1 is at (b1, 0), the next ones at distances
b2 + b1 (of the segments before and after), the tip P at b2 beyond the last. Spring 1 of a segment is the one on the +y
side, which shortens for q > 0.
`load` is a dead force at the tip (fx, fy) [N] in world axes, in statics with a torque [N m] on the last triangle as a
third component, if there is one; compression of the straight arm is fx < 0. There is no gravity.
"""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, as_components, is_batch
from tensegrity_envs.mechanics import equilibrium as _equilibrium
from tensegrity_envs.mechanics.checks import check_finite, check_numbers, check_single, common_shape, sized
from tensegrity_envs.mechanics.dual_triangle.design import DualTriangleDesign
from tensegrity_envs.mechanics.dual_triangle.inverse import InverseSolution, inverse_kinematics
from tensegrity_envs.mechanics.dual_triangle.loading import DualTriangleLoading
from tensegrity_envs.mechanics.dual_triangle.local_optima import nearest, optima
from tensegrity_envs.mechanics.dual_triangle.redundancy import Objective, Redundancy, resolve
from tensegrity_envs.mechanics.dual_triangle.shooting import candidates, grid_of_starts, polish
from tensegrity_envs.mechanics.optima.objectives import Optimum, measure_of

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
class DualTriangle(DualTriangleLoading):
    """An arm of n segments, equal or not, of one design, or of a batch of designs.

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
        check_numbers("free_lengths", free_lengths, 2 * self.segments)
        check_numbers("load", load, max(len(load), 2))
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
        """The configuration with the tip at (x, y) that is nearest to a start, or the one of the largest margin.

        "sum" of the joints' displacements [Zhao2021, objective a], the largest of them, "max" (b), or the sum of their
        "squares" (c), minimized over the whole self-motion curve within the joint limits (which the paper's objectives
        ignore), see `redundancy.py`. The optimum jumps along a path of targets, most often for "sum". Of other numbers
        of segments, of links of other lengths, and for the "margin", the best one of `local_optima`.

        Args:
            x: target [m], a float or an array of shape (m,).
            y: target [m].
            start: n angles [rad], floats or arrays of shape (m,).
            objective: "sum", "max" or "squares"; or "margin", see `local_optima`.
            joint_limit: |q_i| is at most this [rad]; None for the design's, infinity for none (displacements are then
                measured the shorter way round; of three segments only).

        Returns:
            Configuration, value of the objective, and for a target that cannot be reached the nearest point that can.
            Displacements take no notice of the springs: the result's margins, and `is_stable_wrench_feasible`, tell
            whether the unloaded control law holds the configuration.

        Raises:
            ValueError: a number is not finite, the objective is unknown, the arm has one segment, or its triangles'
                heights are those of a batch of designs.
        """
        if self.segments < 2:
            raise ValueError(f"redundancy: for two segments or more, not for {self.segments}")
        check_finite("target", (x, y), 2)
        check_finite("start", start, self.segments)
        if not self.has_plain_links or objective == "margin":
            return self._best_optima(x, y, start, objective, joint_limit)
        single = not is_batch(x, y, *start, self._probe)
        limit = np.asarray(self.design.joint_limit if joint_limit is None else joint_limit, float)
        if not np.all(limit > 0):
            raise ValueError(f"joint_limit = {joint_limit!r}: must be positive")
        shape = common_shape("x, y, joint_limit and start", x, y, limit, *start)
        px, py, bound = (np.broadcast_to(np.asarray(value, float), shape) for value in (x, y, limit))
        origin = np.stack([np.broadcast_to(np.asarray(value, float), shape) for value in start])
        found = resolve(self._plain_links(), px, py, origin, objective, bound)
        return self._with_margins(found, single)

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
            load: (fx, fy) [N], or with a torque (fx, fy, tau) [N m], for "margin".

        Returns:
            The optima within the joint limits, none where the target is out of reach; of two segments all solutions. Of
            four and more each is a local optimum by the test of `optima.optimality`; the first one is what is best of
            all that was looked at, and need not pass it.

        Raises:
            ValueError: a number is not finite, the objective is unknown, the arm has one segment, or it is a batch of
                designs.
        """
        if self.segments < 2:
            raise ValueError(f"local_optima: for two segments or more, not for {self.segments}")
        check_single(self._probe, "local_optima")
        begin = (0.0,) * self.segments if start is None else start
        check_numbers("target", (x, y), 2)
        check_numbers("start", begin, self.segments)
        check_finite("load", load, 2, 3)
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
        shape = common_shape("x, y and start", x, y, *start)
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
        return self._with_margins(Redundancy(tuple(q), best, reached, (near[0], near[1]), distance), single)

    def _with_margins(self, found: Redundancy, single: bool) -> Redundancy:
        """The same with the margins of its configurations; of a single target as floats."""
        with np.errstate(all="ignore"):  # without joint limits, where triangles cannot be
            _, stability, wrench = self.posture(found.configuration)
        if not single:
            return found._replace(stability_margin=stability, wrench_margin=wrench)
        return Redundancy(
            tuple(float(qi[0]) for qi in found.configuration),
            float(found.objective[0]),
            bool(found.is_reachable[0]),
            (float(found.nearest[0][0]), float(found.nearest[1][0])),
            float(found.distance[0]),
            float(stability[0]),
            float(wrench[0]),
        )


def _statics(
    q: Components, parameters: tuple[DualTriangleDesign, int, Components, Components]
) -> tuple[Components, tuple[Components, ...]]:
    design, segments, free_lengths, load = parameters
    return DualTriangle(design, segments).statics(q, free_lengths, load)
