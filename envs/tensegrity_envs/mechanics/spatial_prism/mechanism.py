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

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.checks import check_finite, sized
from tensegrity_envs.mechanics.equilibrium import Equilibrium
from tensegrity_envs.mechanics.spatial_prism import statics
from tensegrity_envs.mechanics.spatial_prism.forces import PrismStatics
from tensegrity_envs.mechanics.spatial_prism.loaded import LoadedEquilibrium, Problem, UnloadingLimit
from tensegrity_envs.mechanics.spatial_prism.statics import Pose
from tensegrity_envs.mechanics.spatial_prism.vectors import (
    Matrix,
    inverse_of_columns,
    norm,
    rotate,
    spin,
    subtract,
    times,
)

_ANGLES = (0.0, 2 * math.pi / 3, 4 * math.pi / 3)


_NO_WRENCH = (0.0, 0.0, 0.0)


@sized(
    q=(6, "x, y, z, w1, w2, w3"),
    start=(6, "x, y, z, w1, w2, w3"),
    w=(3, "w1, w2, w3"),
    position=(3, "x, y, z"),
    lengths=(3, "of the struts 1, 2, 3"),
    wrench=((3, 6), "fx, fy, fz, or with a moment fx, fy, fz, mx, my, mz"),
    force=(3, "fx, fy, fz"),
    direction=(3, "x, y, z"),
)
class SpatialPrism(PrismStatics):
    """A spatial prism, or a batch of them. Components are floats, NumPy arrays or Torch tensors."""

    # ------------------------------------------------------------------------------------------------------ loads

    def loaded_equilibrium(
        self, lengths: Sequence[Component], wrench: Sequence[Component], sheet: Component = 1
    ) -> LoadedEquilibrium:
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

    def equilibrium(
        self, lengths: Sequence[Component], start: Sequence[Component], wrench: Sequence[Component] = _NO_WRENCH
    ) -> Equilibrium:
        """The equilibrium that a wrench makes of the unloaded prism on the sheet of `start`: `loaded_equilibrium`.

        Args:
            lengths: of the struts [m], floats or of shape (n,).
            start: configuration, of which the sign of z alone counts: the equilibrium is followed from rest.
            wrench: three or six components, floats or of shape (n,).

        Returns:
            Configuration [m, rad], residual [N m], is_stable, and the reason in words (for a batch: a list).

        Raises:
            ValueError: start is on the plane z = 0, or see `loaded_equilibrium`.
        """
        sheet = np.sign(np.asarray(start[2], float))
        if not np.all(np.abs(sheet) == 1):
            raise ValueError(f"start = {start!r}: z must be above or below 0, where the prism is singular")
        found = self.loaded_equilibrium(lengths, wrench, sheet if sheet.ndim else int(sheet))
        return _told(found)

    def equilibria(self, lengths: Sequence[float], wrench: Sequence[float] = _NO_WRENCH) -> list[Equilibrium]:
        """The stable equilibria that a wrench makes of the two unloaded ones, one on each sheet; those it does not end.

        Without a wrench these are all that are stable: A = 1 is the energy's only minimum over all orientations of
        a platform that is held, and two positions fit the lengths. Under a wrench the list is not proved complete, and
        unstable equilibria are never listed. Sorted by configuration.

        Raises:
            ValueError: no unloaded position fits the lengths, or a number is not finite.
        """
        check_finite("lengths", lengths, 3)
        both = [_told(self.loaded_equilibrium(lengths, wrench, sheet)) for sheet in (1, -1)]
        return sorted((found for found in both if found.is_stable), key=lambda found: found.configuration)

    def inverse_kinematics(
        self, x: float, y: float, z: float, wrench: Sequence[float] = _NO_WRENCH
    ) -> list[LoadedEquilibrium]:
        """The stable equilibrium with the centroid at (x, y, z) [m]: one, or none where the wrench ends it.

        Without a wrench it is the only one, and `unloaded_lengths` gives its lengths in closed form; under a wrench the
        one that it becomes, see `loaded_inverse_kinematics`, not proved to be the only one.

        Raises:
            ValueError: z = 0, or a number is not finite.
        """
        check_finite("position", (x, y, z), 3)
        found = self.loaded_inverse_kinematics((float(x), float(y), float(z)), tuple(map(float, wrench)))
        return [found] if found.is_stable else []

    def loaded_inverse_kinematics(
        self, position: Sequence[Component], wrench: Sequence[Component]
    ) -> LoadedEquilibrium:
        """Lengths of the struts that hold the centroid at a position under a wrench; followed from no wrench.

        Args:
            position: of the centroid [m], floats or of shape (n,).
            wrench: three or six components, floats or of shape (n,).

        Raises:
            ValueError: z = 0, or a number is not finite.
        """
        self.unloaded_lengths(tuple(np.asarray(component, float) for component in position))
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
        self, lengths: Sequence[Component], direction: Sequence[Component], largest: float = 400.0, sheet: Component = 1
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
        self, known: Sequence[Component], wrench: Sequence[Component], locked: bool, sheet: Component
    ) -> tuple[Problem, np.ndarray]:
        parts = [np.asarray(value, float) for value in (*known, *wrench, sheet)]
        values = np.stack(np.broadcast_arrays(np.zeros(1), *parts))[1:]
        if not np.isfinite(values).all():
            raise ValueError("lengths, position and wrench must be finite numbers")
        n = values.shape[1]
        load = np.zeros((6, n))
        load[: len(wrench)] = values[3:-1]
        d, D, k = (np.asarray(getattr(self.design, field.name), float) for field in fields(self.design))
        return Problem((d, D, k), self.platform, self.base, values[:3].copy(), locked, values[-1]), load

    def _followed(
        self, known: Sequence[Component], wrench: Sequence[Component], locked: bool, sheet: Component
    ) -> LoadedEquilibrium:
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


def _told(found: LoadedEquilibrium) -> Equilibrium:
    """What every mechanism tells of an equilibrium."""

    def words(is_stable: bool, fraction: float) -> str:
        return "stable" if is_stable else f"lost at {float(fraction):.6g} of the wrench, followed from rest"

    single = np.ndim(found.fraction) == 0
    flags, fractions = np.atleast_1d(found.is_stable), np.atleast_1d(found.fraction)
    reasons = [words(*both) for both in zip(flags, fractions, strict=True)]
    return Equilibrium(found.configuration, found.residual, found.is_stable, reasons[0] if single else reasons)
