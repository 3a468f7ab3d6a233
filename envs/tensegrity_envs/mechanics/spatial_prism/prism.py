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
from tensegrity_envs.mechanics.design import Member
from tensegrity_envs.mechanics.dual_triangle.eigenvalues import smallest_eigenvalue
from tensegrity_envs.mechanics.spatial_prism import statics
from tensegrity_envs.mechanics.spatial_prism.design import JAHROMY, SpatialPrismDesign
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


class SpatialPrism:
    """A spatial prism, or a batch of them. Components are floats, NumPy arrays or Torch tensors."""

    degrees_of_freedom = 3
    input_names = ("strut 1", "strut 2", "strut 3")

    def __init__(self, design: SpatialPrismDesign = JAHROMY) -> None:
        self.design = design
        d, D = design.d, design.D
        self.base = tuple((D * math.cos(a), D * math.sin(a), 0.0 * D) for a in _ANGLES)
        self.platform = [(d * math.cos(a + math.pi / 6), d * math.sin(a + math.pi / 6), 0.0 * d) for a in _ANGLES]
        # From b_i to p_{i+1} where the centroid is at the origin and A = 1, w_i of [Jahromy, Eq. 30]
        self.offsets = tuple(subtract(self.platform[(i + 1) % 3], self.base[i]) for i in range(3))
        self.least_square = d * d + D * D + math.sqrt(3) * d * D  # c0 [m2]: |w_i|^2
        self.rotational_stiffness = 1.5 * math.sqrt(3) * design.k * d * D  # kappa [N m/rad]

    # ------------------------------------------------------------------------------------------------- structure

    @property
    def members(self) -> tuple[Member, ...]:
        """Springs, struts (actuators) and the platform's cables; the base is fixed."""
        springs = [Member(f"spring {i}", "spring", (f"B{i}", f"P{i}"), stiffness=self.design.k) for i in (1, 2, 3)]
        struts = [Member(f"strut {i}", "actuator", (f"B{i}", f"P{i % 3 + 1}")) for i in (1, 2, 3)]
        cables = [Member(f"cable {i}", "cable", (f"P{i}", f"P{i % 3 + 1}")) for i in (1, 2, 3)]
        return (*springs, *struts, *cables)

    def nodes(self, q: Sequence[Component]) -> dict[str, Components]:
        """Positions (x, y, z) [m]: base B1, B2, B3, platform P1, P2, P3 and its centroid P."""
        arms = rotate(tuple(q[3:]), self.platform)
        places = {f"B{i + 1}": self.base[i] for i in range(3)}
        places |= {f"P{i + 1}": add(q[:3], arms[i]) for i in range(3)}
        return places | {"P": tuple(q[:3])}

    def tip(self, q: Sequence[Component]) -> Components:
        """The centroid of the platform [m]."""
        return tuple(q[:3])

    def pose(self, q: Sequence[Component]) -> Pose:
        """Where everything is at a configuration."""
        return statics.pose_of(tuple(q[:3]), tuple(rotate(tuple(q[3:]), self.platform)), self.base)

    def strut_lengths(self, q: Sequence[Component]) -> Components:
        """Lengths of the struts [m], [Jahromy, Eq. 16]."""
        return tuple(norm(strut) for strut in self.pose(q).struts)

    def spring_lengths(self, q: Sequence[Component]) -> Components:
        """Lengths of the springs [m]."""
        pose = self.pose(q)
        return tuple(norm(subtract(add(pose.position, pose.arms[i]), pose.base[i])) for i in range(3))

    def strut_clearance(self, q: Sequence[Component]) -> np.ndarray:
        """Smallest distance between the axes of two struts [m], for floats and arrays."""
        pose = self.pose(q)
        starts = [np.stack(np.broadcast_arrays(*b, *h)[:3], axis=-1) for b, h in zip(pose.base, pose.struts)]
        ways = [np.stack(np.broadcast_arrays(*h), axis=-1) for h in pose.struts]
        gaps = [_segment_distance(starts[i], ways[i], starts[i - 1], ways[i - 1]) for i in range(3)]
        return np.asarray(np.minimum.reduce(gaps))

    # ---------------------------------------------------------------------------------------- unloaded kinematics

    def inverse_kinematics(self, position: Sequence[Component]) -> Components:
        """Lengths of the struts [m] that hold the centroid there without a load, [Jahromy, Eq. 30].

        Exact: A = 1 is the energy's only minimum over all orientations, whatever the position.

        Raises:
            ValueError: z = 0, where the prism is singular (floats and arrays; symbols are not looked at).
        """
        if not is_symbol(*position) and not np.all(_plain(position[2]) != 0):
            raise ValueError(
                "z = 0: there the struts lie in one plane with the base and hold no height; z must be above or below"
            )
        return tuple(norm(add(position, offset)) for offset in self.offsets)

    def forward_kinematics(self, lengths: Sequence[Component], sheet: Component = 1) -> Components:
        """Position [m] of the centroid of the unloaded prism on one of its two sheets, in closed form.

        (x, y) = sum w_i l_i^2 / (3 c0), z = sheet sqrt(mean l^2 - c0 - x^2 - y^2).

        Args:
            lengths: of the struts [m].
            sheet: 1 for z > 0, -1 for z < 0; it never changes while the prism moves.

        Raises:
            ValueError: no position fits the lengths, or a length is not positive and finite, or sheet is not 1 or -1.
        """
        _check_lengths(lengths)
        if not np.all(np.isin(_plain(sheet), (-1, 1))):
            raise ValueError(f"sheet = {sheet!r}: must be 1 (z > 0) or -1 (z < 0)")
        foot, square = self.foot_and_square(lengths)
        _check_feasible(square, lengths, self.least_square)
        xp = namespace_of(square)
        return *foot, sheet * xp.sqrt(xp.maximum(square, 0.0 * square))

    def forward_solutions(self, lengths: Sequence[float]) -> list[tuple[float, float, float]]:
        """Every position of the unloaded prism with these lengths: two, one on the singular plane, or none."""
        _check_lengths(lengths)
        (x, y), square = self.foot_and_square(lengths)
        if square < 0:
            return []
        z = math.sqrt(square)
        return [(float(x), float(y), z), (float(x), float(y), -z)] if z > 0 else [(float(x), float(y), 0.0)]

    def foot_and_square(self, lengths: Sequence[Component]) -> tuple[Components, Component]:
        """(x, y) [m] of the unloaded prism, and z^2 [m2], negative where no position fits the lengths. Traceable."""
        first, second, third = (length * length for length in lengths)
        x, y = (
            (self.offsets[0][a] * first + self.offsets[1][a] * second + self.offsets[2][a] * third)
            / (3 * self.least_square)
            for a in (0, 1)
        )
        return (x, y), (first + second + third) / 3 - self.least_square - x * x - y * y

    def jacobian(self, position: Sequence[Component]) -> Matrix:
        """Rows d l_i / d r of the unloaded prism [-]: the struts' directions."""
        struts = [add(position, offset) for offset in self.offsets]
        rows = [scale(1 / norm(strut), strut) for strut in struts]
        return rows[0], rows[1], rows[2]

    def singularity(self, position: Sequence[Component]) -> Component:
        """Det of the Jacobian: z (3 sqrt3 / 2) c0 / (l1 l2 l3); zero on the plane z = 0 alone."""
        product: Component = 1.0
        for offset in self.offsets:
            product = product * norm(add(position, offset))
        return 1.5 * math.sqrt(3) * self.least_square * position[2] / product

    # ---------------------------------------------------------------------------------------------------- statics

    def potential_energy(self, q: Sequence[Component], wrench: Sequence[Component] = _NO_WRENCH) -> Component:
        """Energy of the springs minus the work of the force [J].

        Raises:
            ValueError: there is a moment, which has no potential.
        """
        if len(wrench) > 3 and any(np.any(_plain(m) != 0) for m in wrench[3:]):
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
        if len(wrench) > 3 and any(np.any(_plain(m) != 0) for m in wrench[3:]):
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


def _plain(value: Component) -> np.ndarray:
    """Numbers to look at, of a tensor too."""
    return np.asarray(value.detach() if hasattr(value, "detach") else value, float)


def _check_lengths(lengths: Sequence[Component]) -> None:
    for i, length in enumerate(lengths, 1):
        if not np.all(np.isfinite(_plain(length)) & (_plain(length) > 0)):
            raise ValueError(f"length {i} of the struts = {length!r}: must be positive and finite [m]")


def _check_feasible(square: Component, lengths: Sequence[Component], least: Component) -> None:
    values = _plain(square)
    if (values >= 0).all():
        return
    worst = np.broadcast_arrays(values, *(_plain(length) for length in lengths))
    given = tuple(float(v.ravel()[np.argmin(values)]) for v in worst[1:])
    raise ValueError(
        f"lengths {given} of the struts fit no position: z^2 would be {float(values.min()):.3g} m^2. "
        f"The mean of their squares must be at least c0 + x^2 + y^2, c0 = {float(np.max(_plain(least))):.6g} m^2: "
        "lengthen the struts, or make them more equal"
    )


def _check_not_flat(pose: Pose) -> None:
    if is_symbol(*pose.struts[0]):
        return
    first, second, third = pose.struts
    volume = dot(first, cross(second, third))
    if not np.all(np.abs(_plain(volume)) > 0):
        raise ValueError("the struts lie in one plane (at rest: z = 0): their forces are not determined there")


def _segment_distance(p: np.ndarray, u: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Distance between segments p + s u and q + t v, s and t in [0, 1], arrays (..., 3): inside, or at some end."""
    gap = p - q

    def inner(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.asarray((a * b).sum(axis=-1))

    uu, vv, uv, ug, vg = inner(u, u), inner(v, v), inner(u, v), inner(u, gap), inner(v, gap)
    area = uu * vv - uv * uv
    safe = np.where(area > 1e-14 * uu * vv, area, 1.0)
    s = np.where(area > 1e-14 * uu * vv, (uv * vg - vv * ug) / safe, 0.0)
    pairs = [(s, np.clip((vg + s * uv) / vv, 0, 1))]
    pairs += [(end + 0 * s, np.clip((vg + end * uv) / vv, 0, 1)) for end in (0.0, 1.0)]
    pairs += [(np.clip((end * uv - ug) / uu, 0, 1), end + 0 * s) for end in (0.0, 1.0)]
    pairs = [(np.clip(a, 0, 1), b) for a, b in pairs]
    distances = [np.sqrt(inner(d, d)) for a, b in pairs for d in [gap + a[..., None] * u - b[..., None] * v]]
    return np.asarray(np.minimum.reduce(distances))
