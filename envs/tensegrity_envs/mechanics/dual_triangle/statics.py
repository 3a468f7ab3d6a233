"""Statics of the arm of dual-triangles: potential energy, stiffness, the control law and the compliance."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Self

from tensegrity_envs.compiler.namespace import Component, Components, namespace_of
from tensegrity_envs.mechanics import equilibrium as _equilibrium
from tensegrity_envs.mechanics.checks import check_count
from tensegrity_envs.mechanics.dual_triangle.kinematics import DualTriangleKinematics, pairs
from tensegrity_envs.mechanics.eigenvalues import smallest_eigenvalue

_NO_LOAD = (0.0, 0.0)


class DualTriangleStatics(DualTriangleKinematics):
    """Forces and stiffness of an arm of one design, or of a batch of designs."""

    def potential_energy(
        self, q: Sequence[Component], free_lengths: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> Component:
        """Energy of the springs, less the load times the tip's position (and a torque times its turn) [J]."""
        xp = self._xp(*q, *free_lengths, *load)
        shape = self._shape(xp, q)
        x, y = self._arms(shape.links)[0]
        energy = -load[0] * (self.base_height + x) - load[1] * y
        for torque in load[2:]:
            for qi in q:
                energy = energy - torque * qi
        for springs, pair, segment in zip(shape.springs, pairs(free_lengths), self.chain, strict=True):
            energy = energy + segment.energy_of(xp, springs, pair)
        return energy

    def statics(
        self, q: Sequence[Component], free_lengths: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, tuple[Components, ...]]:
        """Gradient [N m] and Hessian [N m/rad] of the potential energy in one evaluation.

        g_i = -M_i(q_i) - (J^T F)_i, H_ij = K_i (i = j) + F . (tip - pivot max(i, j)): the second term is the load's
        geometric stiffness, which [Zhao2021] leaves out. A torque at the tip is subtracted from every g_i, and has no
        geometric stiffness.
        """
        xp = self._xp(*q, *free_lengths, *load)
        shape = self._shape(xp, q)
        fx, fy, *torques = load
        gradient, stiffness, along = [], [], []
        arms = self._arms(shape.links)
        for springs, pair, (x, y), segment in zip(shape.springs, pairs(free_lengths), arms, self.chain, strict=True):
            slope, k = segment.slope_and_stiffness(xp, springs, pair)
            gradient.append(slope + fx * y - fy * x)
            for torque in torques:
                gradient[-1] = gradient[-1] - torque
            stiffness.append(k)
            along.append(fx * x + fy * y)
        n = self.segments
        hessian = tuple(
            tuple(along[max(i, j)] + stiffness[i] if i == j else along[max(i, j)] for j in range(n)) for i in range(n)
        )
        return tuple(gradient), hessian

    def energy_gradient(
        self, q: Sequence[Component], free_lengths: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> Components:
        """Gradient of the potential energy in q [N m], n components; zero in equilibrium."""
        return self.statics(q, free_lengths, load)[0]

    def stiffness_matrix(
        self, q: Sequence[Component], free_lengths: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, ...]:
        """Hessian of the potential energy [N m/rad], n rows; an equilibrium is stable where it is positive definite."""
        return self.statics(q, free_lengths, load)[1]

    def stability_margin(
        self,
        q: Sequence[Component],
        free_lengths: Sequence[Component] | None = None,
        load: Sequence[Component] = _NO_LOAD,
    ) -> Component:
        """Smallest eigenvalue of the Hessian divided by `stiffness_scale` = (k1 + k2) b1 b2 / 2 of segment 1, k b^2 if
        that is symmetric.

        Without free lengths: at those of the control law for this configuration and load.
        """
        lengths = self.free_lengths(self.control(q, load)) if free_lengths is None else free_lengths
        return smallest_eigenvalue(self.stiffness_matrix(q, lengths, load)) / self.stiffness_scale

    # ------------------------------------------------------------------------------------------------- control

    def load_torques(self, q: Sequence[Component], load: Sequence[Component]) -> Components:
        """(J^T F)_i [N m], plus the torque at the tip where there is one: the external moment on every segment.

        Raises:
            ValueError: there are not n angles and two or three components of the load.
        """
        check_count("q", q, self.segments)
        check_count("load", load, 2, 3)
        arms = self._arms(self._links(self._xp(*q, *load), q))
        moments = tuple(load[1] * x - load[0] * y for x, y in arms)
        return tuple(moment + load[2] for moment in moments) if len(load) == 3 else moments

    def free_lengths(self, delta: Sequence[Component], common: Sequence[Component] | float = 0.0) -> Components:
        """The 2 n free lengths [m] under n control inputs: L0 + common -+ delta for the springs 1 and 2 of a segment.

        Args:
            delta: n control inputs [m]; delta_i > 0 turns segment i towards q_i > 0.
            common: added to both free lengths of a segment [m], one number or n of them: co-contraction where negative.

        Raises:
            ValueError: there are not n control inputs, or neither one number nor n of them in common.
        """
        check_count("delta", delta, self.segments)
        added = self._each(common)
        shares = zip(delta, added, self.chain, strict=True)
        return tuple(length for d, c, segment in shares for length in segment.free_lengths(d, c))

    def _each(self, common: Sequence[Component] | float) -> Sequence[Component]:
        """What is added to the free lengths of every segment."""
        if isinstance(common, int | float):
            return [common] * self.segments
        check_count("common", common, self.segments)
        return common

    def control(
        self,
        q: Sequence[Component],
        load: Sequence[Component] | None = None,
        common: Sequence[Component] | float = 0.0,
    ) -> Components:
        """The n control inputs [m] that make q an equilibrium, under a load or without, [Zhao2021, Eqs. 4, 5].

        Eq. 5 prints the external moment with the wrong sign, see `DualTriangleSegment.control`. That q is an
        equilibrium does not make it stable: check `stability_margin`, and `free_length_margin` for free lengths that
        would be negative.

        Raises:
            ValueError: there are not n angles, two or three components of the load, and one number or n of them in
                common.
        """
        check_count("q", q, self.segments)
        added = self._each(common)
        moments: Sequence[Component] = [0.0] * self.segments if load is None else self.load_torques(q, load)
        return tuple(
            segment.control(qi, moment, extra)
            for qi, moment, extra, segment in zip(q, moments, added, self.chain, strict=True)
        )

    def free_length_margin(self, free_lengths: Sequence[Component]) -> Component:
        """The smallest of the free lengths [m]: negative where the inputs cannot be realized."""
        xp = self._xp(*free_lengths)
        smallest = free_lengths[0]
        for length in free_lengths[1:]:
            smallest = xp.minimum(smallest, length)
        return smallest

    def wrench_margin(
        self,
        q: Sequence[Component],
        free_lengths: Sequence[Component] | None = None,
        load: Sequence[Component] = _NO_LOAD,
    ) -> Component:
        """`free_length_margin` divided by (b1 + b2) / 2 of segment 1 [-]: negative where inputs cannot be realized.

        Without free lengths: at those of the control law for this configuration and load.
        """
        lengths = self.free_lengths(self.control(q, load)) if free_lengths is None else free_lengths
        return 2 * self.free_length_margin(lengths) / (self._first.design.b1 + self._first.design.b2)

    def posture(
        self, q: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, Component, Component]:
        """Free lengths of the control law, stability margin and wrench margin of q."""
        lengths = self.free_lengths(self.control(q, load))
        return lengths, self.stability_margin(q, lengths, load), self.wrench_margin(q, lengths)

    def as_bilateral(self) -> Self:
        """The same arm with springs that push, too."""
        return type(self)(replace(self.design, springs="bilateral"), self.segments)

    def tip_compliance(
        self,
        q: Sequence[Component],
        free_lengths: Sequence[Component] | None = None,
        load: Sequence[Component] = _NO_LOAD,
    ) -> tuple[Components, Components]:
        """J H^-1 J^T [m/N], 2 x 2: how far the tip of the loaded arm yields to a small additional force.

        NaN where the stiffness matrix H is not positive definite. Without free lengths: at those of the control law.
        """
        lengths = self.free_lengths(self.control(q, load)) if free_lengths is None else free_lengths
        hessian = self.stiffness_matrix(q, lengths, load)
        row_x, row_y = self.jacobian(q)
        by_x, pivot, _ = _equilibrium.solve_symmetric(hessian, row_x)
        by_y, _, _ = _equilibrium.solve_symmetric(hessian, row_y)
        xp = namespace_of(pivot)

        def entry(row: Components, answer: Components) -> Component:
            total = row[0] * answer[0]
            for a, b in zip(row[1:], answer[1:], strict=True):
                total = total + a * b
            return xp.where(pivot > 0, total, math.nan)

        cxy = entry(row_x, by_y)
        return (entry(row_x, by_x), cxy), (cxy, entry(row_y, by_y))

    def cartesian_stiffness(
        self,
        q: Sequence[Component],
        free_lengths: Sequence[Component] | None = None,
        load: Sequence[Component] = _NO_LOAD,
    ) -> tuple[Components, Components]:
        """The inverse of `tip_compliance` [N/m], 2 x 2; infinite where the arm is singular, NaN where unstable."""
        (cxx, cxy), (_, cyy) = self.tip_compliance(q, free_lengths, load)
        xp = namespace_of(cxx)
        det = cxx * cyy - cxy * cxy
        regular = abs(det) > 1e-14 * (cxx + cyy) * (cxx + cyy)
        none = math.inf + 0.0 * det  # NaN where det is
        det = xp.where(regular, det, 1.0)
        kxx, kxy, kyy = (xp.where(regular, c / det, none) for c in (cyy, -cxy, cxx))
        return (kxx, kxy), (kxy, kyy)
