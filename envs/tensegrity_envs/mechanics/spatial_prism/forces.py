"""Forces, energy, stiffness and margins of the spatial prism at a configuration; see `mechanism`."""

from collections.abc import Sequence

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, is_symbol, namespace_of
from tensegrity_envs.mechanics.eigenvalues import smallest_eigenvalue
from tensegrity_envs.mechanics.spatial_prism import statics
from tensegrity_envs.mechanics.spatial_prism.kinematics import PrismKinematics, plain
from tensegrity_envs.mechanics.spatial_prism.statics import Pose
from tensegrity_envs.mechanics.spatial_prism.vectors import (
    Matrix,
    add,
    cross,
    dot,
    inverse_of_columns,
    norm,
    rotate,
    scale,
    spin,
    subtract,
    times,
)

_NO_WRENCH = (0.0, 0.0, 0.0)


class PrismStatics(PrismKinematics):
    """Statics of a spatial prism, or of a batch of them."""

    def potential_energy(
        self,
        q: Sequence[Component],
        lengths: Sequence[Component] | None = None,
        wrench: Sequence[Component] = _NO_WRENCH,
    ) -> Component:
        """Energy of the springs minus the work of the force [J].

        Args:
            q: position [m] and rotation vector [rad].
            lengths: of the struts [m], those of q; nothing depends on them, numbers are checked.
            wrench: a dead force at the centroid [N].

        Raises:
            ValueError: the lengths are not those of q, or there is a moment, which has no potential.
        """
        if len(wrench) > 3 and any(np.any(plain(m) != 0) for m in wrench[3:]):
            raise ValueError("potential_energy: a dead moment has no potential; give a force (fx, fy, fz)")
        self._check_lengths_of(q, lengths)
        pose = self.pose(q)
        energy: Component = 0.0
        for i in range(3):
            spring = subtract(add(pose.position, pose.arms[i]), pose.base[i])
            energy = energy + self.design.k / 2 * dot(spring, spring)
        return energy - dot(wrench[:3], pose.position)

    def actuator_forces(self, q: Sequence[Component], wrench: Sequence[Component] = _NO_WRENCH) -> Components:
        """Thrusts of the struts [N] that balance springs and force; at rest k l_i, [Jahromy, Eq. 24].

        Raises:
            ValueError: the struts lie in one plane (unloaded: z = 0).
        """
        pose = self.pose(q)
        _check_not_flat(pose)
        rho, _ = statics.densities(pose, self.design.k, tuple(wrench[:3]))
        return tuple(r * norm(strut) for r, strut in zip(rho, pose.struts, strict=True))

    def cable_tensions(self, q: Sequence[Component], wrench: Sequence[Component] = _NO_WRENCH) -> Components:
        """Tensions [N] of the platform's edges, a third of the force acting at every node; at rest k D.

        Raises:
            ValueError: there is a moment, which may act at the nodes in many ways; or the struts lie in one plane.
        """
        if len(wrench) > 3 and any(np.any(plain(m) != 0) for m in wrench[3:]):
            raise ValueError("cable_tensions: how a moment acts at the nodes is not defined; give a force (fx, fy, fz)")
        pose, k = self.pose(q), self.design.k
        _check_not_flat(pose)
        rho, _ = statics.densities(pose, k, tuple(wrench[:3]))
        return statics.cable_tensions(pose, k, rho, tuple(wrench[:3]), self.design.d)

    def moment_residual(self, q: Sequence[Component], wrench: Sequence[Component] = _NO_WRENCH) -> Components:
        """Moment about the centroid that is not balanced [N m], once struts balance the forces: 0 in equilibrium."""
        pose, k = self.pose(q), self.design.k
        rho, _ = statics.densities(pose, k, tuple(wrench[:3]))
        return statics.moment(pose, k, rho, tuple(wrench[3:]) or _NO_WRENCH)

    def stiffness_matrix(
        self,
        q: Sequence[Component],
        lengths: Sequence[Component] | None = None,
        wrench: Sequence[Component] = _NO_WRENCH,
    ) -> Matrix:
        """Reduced Hessian [N m/rad]: of the energy over rotations about the world axes, struts locked, at equilibrium.

        At rest kappa diag(1, 1, 2) everywhere. Off an equilibrium, and under a moment, the symmetric part.
        """
        self._check_lengths_of(q, lengths)
        pose, k = self.pose(q), self.design.k
        rho, inverse = statics.densities(pose, k, tuple(wrench[:3]))
        slope = statics.moment_slope(pose, k, rho, inverse, True)
        rows = tuple(tuple(-(slope[i][j] + slope[j][i]) / 2 for j in range(3)) for i in range(3))
        return rows[0], rows[1], rows[2]

    def energy_gradient(
        self,
        q: Sequence[Component],
        lengths: Sequence[Component] | None = None,
        wrench: Sequence[Component] = _NO_WRENCH,
    ) -> Components:
        """Derivative of the energy over rotations about the world axes, struts locked [N m]: -`moment_residual`.

        Raises:
            ValueError: the lengths are not those of q.
        """
        self._check_lengths_of(q, lengths)
        return tuple(-moment for moment in self.moment_residual(q, wrench))

    def statics(
        self, w: Components, lengths: Sequence[Component], force: Sequence[Component], sheet: Component = 1.0
    ) -> tuple[Components, Matrix]:
        """Gradient [N m] and Hessian [N m/rad] of the energy over the rotation vector, struts locked. Traceable.

        The Hessian leaves out a part that is zero in equilibrium: for Newton's method. Not finite where the lengths
        do not fit.
        """
        pose, k = self.locked_pose(w, lengths, sheet), self.design.k
        rho, inverse = statics.densities(pose, k, tuple(force))
        left = statics.moment(pose, k, rho, (0.0, 0.0, 0.0))
        slope = statics.moment_slope(pose, k, rho, inverse, True)
        turn = tuple(zip(*spin(w), strict=True))  # columns
        gradient = tuple(-dot(column, left) for column in turn)
        held = tuple(tuple(-(slope[i][j] + slope[j][i]) / 2 for j in range(3)) for i in range(3))
        bent = [times((held[0], held[1], held[2]), column) for column in turn]
        rows = tuple(tuple(dot(column, other) for other in bent) for column in turn)
        return gradient, (rows[0], rows[1], rows[2])

    def locked_pose(self, w: Components, lengths: Sequence[Component], sheet: Component = 1.0) -> Pose:
        """Where struts of given lengths put a platform of given orientation. Traceable; NaN where they do not fit."""
        arms = tuple(rotate(w, self.platform))
        foot, normal, square = statics.trilaterate(tuple(lengths), arms, self.base)
        height = sheet * namespace_of(square).sqrt(square)
        return statics.pose_of(add(foot, scale(height, normal)), arms, self.base)

    def stability_margin(
        self,
        q: Sequence[Component],
        lengths: Sequence[Component] | None = None,
        wrench: Sequence[Component] = _NO_WRENCH,
    ) -> Component:
        """Smallest eigenvalue of the reduced Hessian divided by kappa [-]; 1 at rest, positive where stable."""
        return smallest_eigenvalue(self.stiffness_matrix(q, lengths, wrench)) / self.rotational_stiffness

    def wrench_margin(
        self,
        q: Sequence[Component],
        lengths: Sequence[Component] | None = None,
        wrench: Sequence[Component] = _NO_WRENCH,
    ) -> Component:
        """Smallest thrust or cable tension divided by k D [-]; positive while struts push and cables pull."""
        self._check_lengths_of(q, lengths)
        forces = self.actuator_forces(q, wrench) + self.cable_tensions(q, wrench)
        xp = namespace_of(*forces)
        smallest = forces[0]
        for force in forces[1:]:
            smallest = xp.minimum(smallest, force)
        return smallest / (self.design.k * self.design.D)

    def tip_compliance(self, q: Sequence[Component], wrench: Sequence[Component] = _NO_WRENCH) -> np.ndarray:
        """Matrix d r / d F [m/N] of the centroid with the struts locked, shape (3, 3) or (n, 3, 3): G K^-1 G^T."""
        pose, k = self.pose(q), self.design.k
        _check_not_flat(pose)
        _, inverse = statics.densities(pose, k, tuple(wrench[:3]))
        entries = [entry for row in statics.motion(pose, inverse) for entry in row]
        stiffness = [entry for row in self.stiffness_matrix(q, None, wrench) for entry in row]
        values = np.stack(np.broadcast_arrays(*entries, *stiffness), axis=-1).astype(float)
        g = values[..., :9].reshape(*values.shape[:-1], 3, 3)
        held = values[..., 9:].reshape(g.shape)
        return g @ np.linalg.solve(held, np.swapaxes(g, -1, -2))

    def cartesian_stiffness(self, q: Sequence[Component], wrench: Sequence[Component] = _NO_WRENCH) -> np.ndarray:
        """Matrix d F / d r [N/m] with the struts locked, the inverse of `tip_compliance`, of the same shape."""
        return np.linalg.inv(self.tip_compliance(q, wrench))

    def jacobian(
        self,
        q: Sequence[Component],
        lengths: Sequence[Component] | None = None,
        wrench: Sequence[Component] = _NO_WRENCH,
    ) -> Matrix:
        """d r / d lengths [-], three rows, of an equilibrium under a constant wrench, by implicit differentiation.

        The inverse of how lengths change with the position where the orientation keeps the moments in balance; at rest
        the inverse of `strut_jacobian`. Not finite where the struts lie in one plane.

        Raises:
            ValueError: the lengths are not those of q.
        """
        self._check_lengths_of(q, lengths)
        pose, k = self.pose(q), self.design.k
        rho, inverse = statics.densities(pose, k, tuple(wrench[:3]))
        turn = statics.moment_slope(pose, k, rho, inverse, False)
        by_turn, _ = inverse_of_columns(*((turn[0][j], turn[1][j], turn[2][j]) for j in range(3)))
        columns = []
        for move in statics.moment_by_position(pose, k, rho, inverse):
            columns.append(scale(-1.0, times(by_turn, move)))
        rates = []
        for j, axis in enumerate(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))):
            ends = [add(axis, cross(columns[j], pose.arms[(i + 1) % 3])) for i in range(3)]
            rates.append(tuple(dot(h, end) / norm(h) for h, end in zip(pose.struts, ends, strict=True)))
        found, _ = inverse_of_columns(rates[0], rates[1], rates[2])
        return found

    def jacobian_determinant(
        self,
        q: Sequence[Component],
        lengths: Sequence[Component] | None = None,
        wrench: Sequence[Component] = _NO_WRENCH,
    ) -> Component:
        """det of `jacobian` [-]; at rest 1 / `strut_determinant`."""
        first, second, third = self.jacobian(q, lengths, wrench)
        return dot(first, cross(second, third))

    def _check_lengths_of(self, q: Sequence[Component], lengths: Sequence[Component] | None) -> None:
        """Raise ValueError unless the lengths, where there are any, are those of q. Symbols are not looked at."""
        if lengths is None or is_symbol(*q, *lengths):
            return
        size = np.max(plain(self.design.D))
        for given, own in zip(lengths, self.strut_lengths(q), strict=True):
            if not np.all(np.abs(plain(given) - plain(own)) <= 1e-6 * size):
                raise ValueError(f"lengths = {tuple(lengths)!r}: the struts of q = {tuple(q)!r} are not that long")


def _check_not_flat(pose: Pose) -> None:
    if is_symbol(*pose.struts[0]):
        return
    first, second, third = pose.struts
    volume = dot(first, cross(second, third))
    if not np.all(np.abs(plain(volume)) > 0):
        raise ValueError("the struts lie in one plane (at rest: z = 0): their forces are not determined there")
