"""An arm of dual-triangles under load: where it buckles, its buckled shapes, and which load a measurement reveals."""

import math
from collections.abc import Sequence

import numpy as np

from tensegrity_envs.compiler.namespace import Component, is_batch
from tensegrity_envs.mechanics.checks import check_finite, check_single
from tensegrity_envs.mechanics.dual_triangle.branches import Branch, follow_load, heading_in_load
from tensegrity_envs.mechanics.dual_triangle.loads import (
    LoadedState,
    critical_load,
    estimate_load,
    identify,
    identify_from,
    straight_critical_loads,
)
from tensegrity_envs.mechanics.dual_triangle.shooting import polish
from tensegrity_envs.mechanics.dual_triangle.statics import DualTriangleStatics

_NO_LOAD = (0.0, 0.0)


class DualTriangleLoading(DualTriangleStatics):
    """Buckling, equilibrium branches and the identification of loads, of an arm of one design or of a batch of them."""

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

    def estimate_load(
        self, q: Sequence[Component], free_lengths: Sequence[Component], torque: bool = False
    ) -> tuple[Component, ...]:
        """The tip force (fx, fy) [N] under which measured angles are in equilibrium: least squares of J^T F = -M.

        n equations, two unknowns: exact where the angles are. At a singular configuration, the straight arm, the force
        along the links cannot be seen in the torques; the force of smallest norm is given. A torque at the tip that is
        not asked for is taken for a force.

        Args:
            q: n measured angles [rad].
            free_lengths: 2 n of them [m].
            torque: estimate (fx, fy, tau), with the torque tau [N m] at the tip: three unknowns, for three segments or
                more. Where all pivots are on one line, the smallest one is given, a torque counting as a force at the
                distance of the reach.

        Raises:
            ValueError: a torque is asked for, and the arm has fewer than three segments.
        """
        if torque and self.segments < 3:
            raise ValueError(f"estimate_load: a torque, too, shows in three segments or more, not in {self.segments}")
        found = estimate_load(self, q, free_lengths, torque)
        if is_batch(self._probe, *q, *free_lengths):
            return tuple(np.moveaxis(found, -1, 0))
        return tuple(found.tolist())

    def identify(self, x: float, y: float, free_lengths: Sequence[float]) -> list[LoadedState]:
        """Every configuration within the limits, with its force, that explains a measured tip under known inputs.

        A torque at the tip would be one unknown too many; where there is one, it is taken for a force.

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
