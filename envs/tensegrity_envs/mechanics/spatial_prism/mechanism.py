"""The spatial prism: kinematics, statics, stability and the limits of its loads.

Source: [Jahromy] R. Jahromy, "Forward and inverse kinematic analysis of a spatial tensegrity mechanism with
translational degrees of freedom". Equations (8)-(15), (17), (18), (22), (23) and (26) are misprinted or wrong, those of
the loaded case altogether; docs/spatial_prism.md lists every correction. The statics here are those of `statics`.

Conventions: base node b_i at D (cos g_i, sin g_i, 0), g = 0, 120, 240 degrees; platform node p_i at r + A U_i,
U_i = d (cos(g_i + 30 deg), sin(g_i + 30 deg), 0). Spring i joins b_i and p_i, strut (actuator) i joins b_i and p_{i+1}:
mind the index. A configuration is q = (x, y, z, w1, w2, w3): the centroid r [m] and the rotation vector of A, axis
times angle in world axes [rad]; at rest A = 1. `wrench` is (fx, fy, fz) [N] at the centroid, or with a moment
(fx, fy, fz, mx, my, mz) [N, N m], dead and in world axes. Forces of struts are thrusts: positive in compression. There
is no gravity but that of a load. The prism has two sheets, z > 0 and z < 0; on the plane between them it is singular.
"""

import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, is_symbol, namespace_of
from tensegrity_envs.mechanics.eigenvalues import smallest_eigenvalue
from tensegrity_envs.mechanics.spatial_prism import statics
from tensegrity_envs.mechanics.spatial_prism.kinematics import PrismKinematics, plain
from tensegrity_envs.mechanics.spatial_prism.loaded import LoadedEquilibrium, Problem, UnloadingLimit
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

_ANGLES = (0.0, 2 * math.pi / 3, 4 * math.pi / 3)


_NO_WRENCH = (0.0, 0.0, 0.0)


class SpatialPrism(PrismKinematics):
    """A spatial prism, or a batch of them. Components are floats, NumPy arrays or Torch tensors."""

    def potential_energy(self, q: Sequence[Component], wrench: Sequence[Component] = _NO_WRENCH) -> Component:
        """Energy of the springs minus the work of the force [J].

        Raises:
            ValueError: there is a moment, which has no potential.
        """
        if len(wrench) > 3 and any(np.any(plain(m) != 0) for m in wrench[3:]):
            raise ValueError("potential_energy: a dead moment has no potential; give a force (fx, fy, fz)")
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

    def stiffness_matrix(self, q: Sequence[Component], wrench: Sequence[Component] = _NO_WRENCH) -> Matrix:
        """Reduced Hessian [N m/rad]: of the energy over rotations about the world axes, struts locked, at equilibrium.

        At rest kappa diag(1, 1, 2) everywhere. Off an equilibrium, and under a moment, the symmetric part.
        """
        pose, k = self.pose(q), self.design.k
        rho, inverse = statics.densities(pose, k, tuple(wrench[:3]))
        slope = statics.moment_slope(pose, k, rho, inverse, True)
        rows = tuple(tuple(-(slope[i][j] + slope[j][i]) / 2 for j in range(3)) for i in range(3))
        return rows[0], rows[1], rows[2]

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

    def stability_margin(self, q: Sequence[Component], wrench: Sequence[Component] = _NO_WRENCH) -> Component:
        """Smallest eigenvalue of the reduced Hessian divided by kappa [-]; 1 at rest, positive where stable."""
        return smallest_eigenvalue(self.stiffness_matrix(q, wrench)) / self.rotational_stiffness

    def wrench_margin(self, q: Sequence[Component], wrench: Sequence[Component] = _NO_WRENCH) -> Component:
        """Smallest thrust or cable tension divided by k D [-]; positive while struts push and cables pull."""
        forces = self.actuator_forces(q, wrench) + self.cable_tensions(q, wrench)
        xp = namespace_of(*forces)
        smallest = forces[0]
        for force in forces[1:]:
            smallest = xp.minimum(smallest, force)
        return smallest / (self.design.k * self.design.D)

    def compliance(self, q: Sequence[Any], wrench: Sequence[Any] = _NO_WRENCH) -> np.ndarray:
        """Matrix d r / d F [m/N] of the centroid with the struts locked, shape (3, 3) or (n, 3, 3): G K^-1 G^T."""
        pose, k = self.pose(q), self.design.k
        _check_not_flat(pose)
        _, inverse = statics.densities(pose, k, tuple(wrench[:3]))
        entries = [entry for row in statics.motion(pose, inverse) for entry in row]
        stiffness = [entry for row in self.stiffness_matrix(q, wrench) for entry in row]
        values = np.stack(np.broadcast_arrays(*entries, *stiffness), axis=-1).astype(float)
        g = values[..., :9].reshape(*values.shape[:-1], 3, 3)
        held = values[..., 9:].reshape(g.shape)
        return g @ np.linalg.solve(held, np.swapaxes(g, -1, -2))

    # ------------------------------------------------------------------------------------------------------ loads

    def loaded_equilibrium(self, lengths: Sequence[Any], wrench: Sequence[Any], sheet: Any = 1) -> LoadedEquilibrium:
        """What a wrench makes of a prism whose struts keep their lengths: the equilibrium followed from rest.

        Args:
            lengths: of the struts [m], floats or of shape (n,).
            wrench: three or six components, floats or of shape (n,).
            sheet: 1 or -1, of the unloaded prism.

        Raises:
            ValueError: lengths that no unloaded position fits, or a number that is not finite.
        """
        self.forward_kinematics(tuple(np.asarray(length, float) for length in lengths), sheet)
        return self._followed(lengths, wrench, True, sheet)

    def loaded_inverse_kinematics(self, position: Sequence[Any], wrench: Sequence[Any]) -> LoadedEquilibrium:
        """Lengths of the struts that hold the centroid at a position under a wrench; followed from no wrench.

        Args:
            position: of the centroid [m], floats or of shape (n,).
            wrench: three or six components, floats or of shape (n,).

        Raises:
            ValueError: z = 0, or a number is not finite.
        """
        self.inverse_kinematics(tuple(np.asarray(component, float) for component in position))
        return self._followed(position, wrench, False, 1)

    def held(
        self, position: Sequence[Component], force: Sequence[Component], iterations: int = 4
    ) -> tuple[Components, Components, Component]:
        """`loaded_inverse_kinematics` for small forces, by so many Newton steps from rest. Traceable.

        Returns:
            Configuration, lengths of the struts [m], and the moment that is left [N m]: look at it.
        """
        place = tuple(position)
        w: Components = (0.0, 0.0, 0.0)
        for _ in range(iterations):
            step, _ = self.holding_step(place, w, force)
            w = subtract(w, step)
        pose, _, _, left = self._held_moment(place, w, force)
        return (*place, *w), tuple(norm(strut) for strut in pose.struts), norm(left)

    def holding_step(
        self, position: Sequence[Component], w: Components, force: Sequence[Component]
    ) -> tuple[Components, Components]:
        """Newton's step of the rotation vector [rad], to be subtracted, of a platform that is held at a position under
        a force, and the moment that is left before it [N m]. Traceable.
        """
        pose, rho, inverse, left = self._held_moment(tuple(position), w, force)
        slope = statics.moment_slope(pose, self.design.k, rho, inverse, False)
        columns = [times(slope, column) for column in zip(*spin(w), strict=True)]
        step, _ = inverse_of_columns(columns[0], columns[1], columns[2])
        return times(step, left), left

    def _held_moment(
        self, place: Components, w: Components, force: Sequence[Component]
    ) -> tuple[Pose, Components, Matrix, Components]:
        pose = statics.pose_of(place, tuple(rotate(w, self.platform)), self.base)
        rho, inverse = statics.densities(pose, self.design.k, tuple(force))
        return pose, rho, inverse, statics.moment(pose, self.design.k, rho, (0.0, 0.0, 0.0))

    def unloading_limit(
        self, lengths: Sequence[Any], direction: Sequence[Any], largest: float = 400.0, sheet: Any = 1
    ) -> UnloadingLimit:
        """The force at the centroid at which a strut first stops pushing or a cable pulling, struts locked.

        Args:
            lengths: of the struts [m], floats or of shape (n,).
            direction: of the force, of any length; floats or of shape (n,).
            largest: force that is tried [N].
            sheet: 1 or -1.

        Raises:
            ValueError: a direction is zero, or see `loaded_equilibrium`.
        """
        self.forward_kinematics(tuple(np.asarray(length, float) for length in lengths), sheet)
        problem, way = self._problem(lengths, direction, True, sheet)
        size = np.sqrt((way[:3] ** 2).sum(axis=0))
        if not (np.isfinite(size) & (size > 0)).all():
            raise ValueError(f"direction = {tuple(direction)!r}: must not be zero")
        found = problem.unloading(way[:3] / size, largest)
        if any(np.ndim(value) for value in (*lengths, *direction)):
            return found
        return UnloadingLimit(*(value[0].item() for value in found))

    def _problem(
        self, known: Sequence[Any], wrench: Sequence[Any], locked: bool, sheet: Any
    ) -> tuple[Problem, np.ndarray]:
        if len(wrench) not in (3, 6):
            raise ValueError(f"wrench of {len(wrench)} components: must be (fx, fy, fz), or with a moment, six")
        parts = [np.asarray(value, float) for value in (*known, *wrench, sheet)]
        values = np.stack(np.broadcast_arrays(np.zeros(1), *parts))[1:]
        if not np.isfinite(values).all():
            raise ValueError("lengths, position and wrench must be finite numbers")
        n = values.shape[1]
        load = np.zeros((6, n))
        load[: len(wrench)] = values[3:-1]
        d, D, k = (np.asarray(getattr(self.design, field.name), float) for field in fields(self.design))
        return Problem((d, D, k), self.platform, self.base, values[:3].copy(), locked, values[-1]), load

    def _followed(self, known: Sequence[Any], wrench: Sequence[Any], locked: bool, sheet: Any) -> LoadedEquilibrium:
        problem, load = self._problem(known, wrench, locked, sheet)
        found = problem.told(*_with(problem.follow(load), load))
        if any(np.ndim(value) for value in (*known, *wrench, sheet)):
            return found
        return LoadedEquilibrium(  # of a single prism
            *(tuple(v[0].item() for v in part) if isinstance(part, tuple) else part[0].item() for part in found)  # type: ignore[arg-type]
        )


def _with(followed: tuple[np.ndarray, np.ndarray], load: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    w, fraction = followed
    return w, fraction * load, fraction


def _check_not_flat(pose: Pose) -> None:
    if is_symbol(*pose.struts[0]):
        return
    first, second, third = pose.struts
    volume = dot(first, cross(second, third))
    if not np.all(np.abs(plain(volume)) > 0):
        raise ValueError("the struts lie in one plane (at rest: z = 0): their forces are not determined there")
