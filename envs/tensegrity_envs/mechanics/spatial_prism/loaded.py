"""Equilibria of loaded prisms, forward and inverse, and the loads at which struts or cables go slack: for batches.

The platform's orientation is the unknown. It is followed from rest while the wrench grows, by Newton's method on the
balance of moments; the sheet of the unloaded prism is kept.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Components
from tensegrity_envs.mechanics.spatial_prism import statics
from tensegrity_envs.mechanics.spatial_prism.statics import Pose
from tensegrity_envs.mechanics.spatial_prism.vectors import Matrix, add, rotate, scale, spin

_FIRST_STEP = 0.25  # of the wrench
_SHORTEST_STEP = 2.0**-16
_ITERATIONS = 12
_LONGEST_TURN = 0.1  # [rad] of a step along the path, and of a Newton step; more is too far
_FORCE_STEP, _FORCE_RESOLUTION = 1 / 40, 2.0**-42  # of the largest force that is tried
_CONVERGED = 1e-13  # [rad]
_BALANCED = 1e-6  # of a moment left over, relative to those that balance


class LoadedEquilibrium(NamedTuple):
    """An equilibrium under a wrench, or where the search for one ended.

    Attributes:
        configuration: position [m] and rotation vector [rad] of the platform, (x, y, z, w1, w2, w3).
        lengths: of the struts [m].
        forces: thrusts of the struts [N].
        tensions: of the platform's cables [N], a third of the force acting at every node; NaN where there is a torque,
            which may act at the nodes in many ways.
        residual: norm of the moment that is left [N m].
        is_stable: whether this is an equilibrium that is stable while the struts keep their lengths.
        fraction: of the wrench up to which the equilibrium could be followed: 1, or less where it was lost.
    """

    configuration: tuple[np.ndarray, ...]
    lengths: tuple[np.ndarray, ...]
    forces: tuple[np.ndarray, ...]
    tensions: tuple[np.ndarray, ...]
    residual: np.ndarray
    is_stable: np.ndarray
    fraction: np.ndarray


class UnloadingLimit(NamedTuple):
    """The first event while a force grows at locked struts.

    Attributes:
        force: at which it happens [N], or the largest one that was tried.
        event: 0 none up to there, 1 a strut's thrust ends, 2 a cable goes slack, 3 the equilibrium ends.
    """

    force: np.ndarray
    event: np.ndarray


class Problem:
    """n prisms whose struts' lengths, or whose positions, are given, and the wrenches on them.

    Args:
        design: numbers d, D, k, each a float or of shape (n,).
        platform: nodes of the platform in its own axes, three vectors [m].
        base: nodes of the base [m].
        known: lengths or positions, shape (3, n) [m].
        locked: whether they are lengths.
        sheet: sign of z, shape (n,), of locked struts.
    """

    def __init__(
        self,
        design: tuple[np.ndarray, np.ndarray, np.ndarray],
        platform: Sequence[Components],
        base: tuple[Components, ...],
        known: np.ndarray,
        locked: bool,
        sheet: np.ndarray,
    ) -> None:
        self.d, self.width, self.k = design
        self.platform, self.base, self.known = platform, base, known
        self.locked, self.sheet = locked, sheet

    def pose(self, w: np.ndarray) -> Pose:
        """Where everything is at rotation vectors of shape (3, n); NaN where the lengths do not fit."""
        arms = tuple(rotate(tuple(w), self.platform))
        position = tuple(self.known)
        if self.locked:
            foot, normal, square = statics.trilaterate(position, arms, self.base)
            height = self.sheet * np.sqrt(np.where(square >= 0, square, np.nan))
            position = add(foot, scale(height, normal))
        return statics.pose_of(position, arms, self.base)

    def balance(self, w: np.ndarray, wrench: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Moment left (n, 3), and its derivative along the rotation vector (n, 3, 3)."""
        with np.errstate(invalid="ignore", divide="ignore"):
            pose = self.pose(w)
            rho, inverse = statics.densities(pose, self.k, tuple(wrench[:3]))
            left = statics.moment(pose, self.k, rho, tuple(wrench[3:]))
            slope = statics.moment_slope(pose, self.k, rho, inverse, self.locked)
        turn = np.moveaxis(_stack(spin(tuple(w))), -1, 0)
        return np.stack(left, axis=-1), np.moveaxis(_stack(slope), -1, 0) @ turn

    def solve(self, w: np.ndarray, wrench: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Newton's method from w: the solutions (3, n), and where it converged and stayed near."""
        start, w, fine, done = w, w.copy(), np.ones(w.shape[1], bool), np.zeros(w.shape[1], bool)
        for _ in range(_ITERATIONS):
            left, slope = self.balance(w, wrench)
            fine &= np.isfinite(left).all(axis=1) & np.isfinite(slope).all(axis=(1, 2))
            with np.errstate(all="ignore"):
                good = fine & (np.abs(np.linalg.det(np.where(fine[:, None, None], slope, np.eye(3)))) > 0)
            fine &= good
            step = np.linalg.solve(np.where(fine[:, None, None], slope, np.eye(3)), left[..., None])[..., 0]
            step = np.where(fine[:, None], step, 0.0)
            size = np.abs(step).max(axis=1)
            fine &= size <= _LONGEST_TURN
            w -= np.where(fine, step.T, 0.0)
            done = size <= 1e-9
            if (size <= _CONVERGED).all():
                break
        return w, fine & done & (np.abs(w - start).max(axis=0) <= _LONGEST_TURN)

    def stable(self, w: np.ndarray, wrench: np.ndarray) -> np.ndarray:
        """Whether the equilibria are stable with the struts locked."""
        with np.errstate(invalid="ignore", divide="ignore"):
            stiffness = -_stack(self.locked_slope(w, wrench))
        stiffness = np.moveaxis(stiffness, -1, 0)
        finite = np.isfinite(stiffness).all(axis=(1, 2))
        symmetric = np.where(finite[:, None, None], (stiffness + np.swapaxes(stiffness, 1, 2)) / 2, -np.eye(3))
        return np.asarray(np.linalg.eigvalsh(symmetric)[:, 0] > 0)

    def locked_slope(self, w: np.ndarray, wrench: np.ndarray) -> Matrix:
        """`statics.moment_slope` with the struts locked."""
        pose = self.pose(w)
        rho, inverse = statics.densities(pose, self.k, tuple(wrench[:3]))
        return statics.moment_slope(pose, self.k, rho, inverse, True)

    def take(self, index: np.ndarray) -> "Problem":
        """Those at some indices."""
        part = object.__new__(Problem)

        def pick(value: Any) -> Any:
            if isinstance(value, tuple | list):
                return type(value)(pick(v) for v in value)
            return value[index] if isinstance(value, np.ndarray) and value.ndim else value

        part.d, part.width, part.k = pick(self.d), pick(self.width), pick(self.k)
        part.platform, part.base = pick(self.platform), pick(self.base)
        part.known, part.locked, part.sheet = self.known[:, index], self.locked, self.sheet[index]
        return part

    def follow(self, wrench: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The equilibria that the unloaded ones become while the wrench grows from zero.

        Returns:
            Rotation vectors (3, n) [rad], and the fraction of the wrench (n,) up to which they are stable equilibria.
        """
        n = wrench.shape[1]
        w, fraction, step = np.zeros((3, n)), np.zeros(n), np.full(n, 1.0)
        index = np.arange(n)
        while len(index):
            part, load = self.take(index), wrench[:, index]
            ahead = np.minimum(fraction[index] + step[index], 1.0)
            new, good = part.solve(w[:, index], ahead * load)
            good &= part.stable(new, ahead * load)
            w[:, index[good]], fraction[index[good]] = new[:, good], ahead[good]
            step[index] = np.where(good, 2 * step[index], np.minimum(step[index] / 2, _FIRST_STEP))
            index = index[(fraction[index] < 1) & (step[index] >= _SHORTEST_STEP)]
        return w, fraction

    def told(self, w: np.ndarray, wrench: np.ndarray, fraction: np.ndarray) -> LoadedEquilibrium:
        """All there is to tell of an equilibrium."""
        with np.errstate(invalid="ignore", divide="ignore"):
            pose = self.pose(w)
            force = tuple(wrench[:3])
            rho, _ = statics.densities(pose, self.k, force)
            lengths = tuple(np.sqrt(sum(c * c for c in strut)) for strut in pose.struts)
            left = statics.moment(pose, self.k, rho, tuple(wrench[3:]))
            tensions = statics.cable_tensions(pose, self.k, rho, force, self.d)
        free = (wrench[3:] == 0).all(axis=0)
        residual = np.sqrt(sum(m * m for m in left))
        # Of a platform next to the base's plane a rotation of a rounding error is a moment of any size.
        balanced = residual <= _BALANCED * self._moment(wrench)
        return LoadedEquilibrium(
            (*pose.position, *w),
            lengths,
            tuple(r * l for r, l in zip(rho, lengths, strict=True)),
            tuple(np.where(free, tension, np.nan) for tension in tensions),
            residual,
            (fraction >= 1) & balanced & self.stable(w, wrench),
            fraction,
        )

    def _moment(self, wrench: np.ndarray) -> np.ndarray:
        """Of what size the moments are that balance one another [N m]."""
        force, torque = (np.sqrt((part * part).sum(axis=0)) for part in (wrench[:3], wrench[3:]))
        return np.asarray(self.k * self.d * self.width + force * self.d + torque)

    def unloading(self, direction: np.ndarray, largest: float) -> UnloadingLimit:
        """The first event while the force grows along `direction` (3, n) to `largest` [N].

        Steps are halved at an event, and where the platform turns too far in one, until they are of no size.
        """
        n = direction.shape[1]
        w, force, event = np.zeros((3, n)), np.zeros(n), np.zeros(n, int)
        step, passed_before = np.full(n, _FORCE_STEP * largest), np.ones(n, bool)
        index = np.arange(n)
        while len(index):
            trial = np.minimum(force[index] + step[index], largest)
            new, kind = self._at(index, w[:, index], direction[:, index], trial)
            passed = kind == 0
            w[:, index[passed]], force[index[passed]] = new[:, passed], trial[passed]
            event[index] = np.where(passed, 0, kind)
            grown = np.where(passed_before[index], 2.0, 1.0)
            step[index] = np.minimum(step[index] * np.where(passed, grown, 0.5), _FORCE_STEP * largest)
            passed_before[index] = passed
            index = index[(force[index] < largest) & (step[index] > _FORCE_RESOLUTION * largest)]
        return UnloadingLimit(force, np.where(force < largest, event, 0))

    def _at(
        self, index: np.ndarray, w: np.ndarray, direction: np.ndarray, force: np.ndarray | float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Equilibria next to w under a force, and the event that has happened there."""
        part = self.take(index)
        wrench = np.concatenate([force * direction, np.zeros_like(direction)])
        new, good = part.solve(w, wrench)
        good &= part.stable(new, wrench)
        found = part.told(new, wrench, np.ones(len(index)))
        event = np.where(np.min(found.tensions, axis=0) <= 0, 2, 0)
        event = np.where(np.min(found.forces, axis=0) <= 0, 1, event)
        return new, np.where(good, event, 3)


def _stack(rows: Matrix) -> np.ndarray:
    """Rows of components as an array (3, 3, n)."""
    entries = np.broadcast_arrays(*(entry for row in rows for entry in row))
    return np.stack(entries).reshape(3, 3, -1).astype(float)
