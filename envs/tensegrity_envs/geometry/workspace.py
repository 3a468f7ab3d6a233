"""The stable wrench-feasible joint space (SWFJ) and workspace (SWFW) of a planar cable-driven mechanism.

[Muralidharan2022] solves one polynomial for each limiting condition (Eq. 15) on every grid line, up to degree 36. Here
every condition is a continuous margin, `Region` finds all boundary points from the margins themselves, and follows the
boundary curves between the grid lines. Images of the two sheets of det J are then exact up to chords.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.geometry.overlay import Image, image
from tensegrity_envs.geometry.regions import BoundaryPoints, Region, Traced

STABILITY, WRENCH, SINGULARITY = "stability", "wrench", "singularity"
CLIP = 0.99 * math.pi  # [Muralidharan2022, section 5] keeps away from the flat poses by this much
SHEETS = {"det J > 0": 1, "det J < 0": -1}


class CableDriven(Protocol):
    """What a mechanism needs here: `TwoX`, and any other with two joint angles, a tip and stiffest tensions."""

    design: Any

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the cables."""

    @property
    def reach(self) -> Component:
        """An upper bound of the tip's distance from the base [m]."""

    def tip(self, q: Sequence[Component]) -> tuple[Component, Component]:
        """Tip position [m]."""

    def jacobian_determinant(self, q: Sequence[Component]) -> Component:
        """det J."""

    def posture(
        self, q: Sequence[Component], load: Sequence[Component] = ...
    ) -> tuple[Components, Component, Component]:
        """Stiffest tensions [N], stability margin and wrench margin."""


def stable_wrench_feasible_joint_space(
    mechanism: CableDriven, limit: float | None = None, sheet: int = 0, load: tuple[float, float] = (0.0, 0.0)
) -> Region:
    """The SWFJ as a region of the joint angles [rad].

    Its conditions are "stability" (the stability margin at the stiffest feasible tensions) and, by name of the cable,
    that its stiffest tension is above the lower bound, as a fraction of the upper one. Where a boundary point's active
    condition is a cable, that cable is slack to its bound and its antagonist at the upper one.

    Args:
        mechanism: of one design.
        limit: |alpha_i| <= limit [rad], below pi; by default the joint limit, at most 0.99 pi.
        sheet: 1 or -1 restricts the region to det J of that sign, and adds "singularity" to its conditions (det J
            divided by reach^2).
        load: dead force at the tip (fx, fy) [N].

    Raises:
        ValueError: limit is not in (0, pi), sheet is not -1, 0 or 1, or the mechanism is a batch of designs.
    """
    if any(isinstance(value, np.ndarray) for value in vars(mechanism.design).values()):
        raise ValueError("a region belongs to one design, not to a batch of them")
    limit = _checked_limit(mechanism, limit)
    if sheet not in (-1, 0, 1):
        raise ValueError(f"sheet = {sheet!r}: must be 1 or -1, the sign of det J, or 0 for both")
    low, high = float(mechanism.design.min_tension), float(mechanism.design.max_tension)
    scale = sheet / float(mechanism.reach) ** 2

    outside = () if tuple(load) == (0.0, 0.0) else (load,)

    def conditions(q1: Component, q2: Component) -> tuple[Component, ...]:
        tensions, stability, _ = mechanism.posture((q1, q2), *outside)
        margins = (stability, *((tension - low) / high for tension in tensions))
        return (*margins, scale * mechanism.jacobian_determinant((q1, q2))) if sheet else margins

    def least(q1: Component, q2: Component) -> Component:
        _, stability, wrench = mechanism.posture((q1, q2), *outside)
        margin = np.minimum(stability, wrench)
        return np.minimum(margin, scale * mechanism.jacobian_determinant((q1, q2))) if sheet else margin

    names = (STABILITY, *mechanism.input_names, *((SINGULARITY,) if sheet else ()))
    what = "SWFJ" + (f", det J {'>' if sheet > 0 else '<'} 0" if sheet else "")
    return Region(conditions, names, (-limit, -limit), (limit, limit), what, least)


def stable_wrench_feasible_workspace(
    mechanism: CableDriven,
    limit: float | None = None,
    load: tuple[float, float] = (0.0, 0.0),
    resolution: int = 256,
    tolerance: float = 1e-6,
) -> Image:
    """The SWFW [m]: the images of the SWFJ's two sheets, det J > 0 and det J < 0, and how they overlap.

    Args:
        mechanism: of one design.
        limit, load: see `stable_wrench_feasible_joint_space`.
        resolution, tolerance: see `Region.trace`.

    Returns:
        `Image` with sheets "det J > 0" and "det J < 0"; without faces where no configuration is stable and
        wrench-feasible.
    """
    sheets = {
        name: stable_wrench_feasible_joint_space(mechanism, limit, sign, load).trace(
            resolution, tolerance, mechanism.tip
        )
        for name, sign in SHEETS.items()
    }
    return image(sheets, mechanism.tip)


class Size(NamedTuple):
    """How large a stable wrench-feasible set is.

    Attributes:
        fraction: of the square |alpha_i| <= limit that the SWFJ covers.
        area: of the SWFW [m2].
        overlap: area that is reached in two configurations or more [m2].
    """

    fraction: float
    area: float
    overlap: float


def stable_wrench_feasible_size(
    mechanism: CableDriven, limit: float | None = None, resolution: int = 128, tolerance: float = 1e-4
) -> Size:
    """Fraction and areas to about 1e-3 and fast, for searching among many designs.

    Args:
        mechanism: of one design.
        limit: see `stable_wrench_feasible_joint_space`.
        resolution, tolerance: see `Region.trace`; the grid is made finer once at most.
    """
    sheets = {
        name: stable_wrench_feasible_joint_space(mechanism, limit, sign).trace(
            resolution, tolerance, mechanism.tip, finest=2 * resolution, lines=0
        )
        for name, sign in SHEETS.items()
    }
    found = image(sheets, mechanism.tip, precision=1e-7)
    return Size(sum(sheet.fraction for sheet in sheets.values()), found.area(), found.overlap)


class Cloud(NamedTuple):
    """The paper's boundary clouds, [Muralidharan2022, Figs. 3 and 4].

    Attributes:
        points: boundary points of the SWFJ and points with det J = 0 inside it, shape (n, 2) [rad].
        tips: their tip positions, shape (n, 2) [m].
        conditions: what is active there.
        fixed: which angle, 0 or 1, was constant on the grid line.
        determinant: det J, shape (n,) [m2]; 0 at the points with condition "singularity".
    """

    points: np.ndarray
    tips: np.ndarray
    conditions: list[str]
    fixed: np.ndarray
    determinant: np.ndarray


def boundary_cloud(
    mechanism: CableDriven, lines: int = 50, limit: float | None = None, load: tuple[float, float] = (0.0, 0.0)
) -> Cloud:
    """Boundary points of the SWFJ, and singular points in it, on `lines` grid lines in each direction."""
    edge = stable_wrench_feasible_joint_space(mechanism, limit, 0, load).scan(lines)
    folds = stable_wrench_feasible_joint_space(mechanism, limit, 1, load).scan(lines)
    of_fold = np.array([name == SINGULARITY for name in folds.conditions], bool)
    cloud = BoundaryPoints(
        np.concatenate([edge.points, folds.points[of_fold]]),
        [*edge.conditions, *(SINGULARITY for _ in range(int(of_fold.sum())))],
        np.concatenate([edge.fixed, folds.fixed[of_fold]]),
    )
    q = (cloud.points[:, 0], cloud.points[:, 1])
    determinant = np.array(mechanism.jacobian_determinant(q), float)
    determinant[len(edge.points) :] = 0.0
    return Cloud(cloud.points, np.stack(mechanism.tip(q), axis=1), cloud.conditions, cloud.fixed, determinant)


def summary(joint_space: Traced, workspace: Image) -> dict[str, float | int | bool]:
    """The numbers of a stable wrench-feasible set: areas, fractions, components, overlap, holes."""
    lengths = joint_space.lengths()
    return {
        "SWFJ empty": joint_space.is_empty,
        "SWFJ fraction of the square": joint_space.fraction,
        "SWFJ area [rad2]": joint_space.area,
        "SWFJ area error [rad2]": joint_space.area_error,
        "SWFJ components": len(joint_space.components),
        **{f"SWFJ boundary, {name} [rad]": length for name, length in lengths.items() if length > 0},
        "SWFW area [m2]": workspace.area(),
        **{f"SWFW area of {sheet.name} [m2]": sheet.area for sheet in workspace.sheets},
        "SWFW overlap [m2]": workspace.overlap,
        "SWFW area error [m2]": workspace.area_error,
        "SWFW most configurations": workspace.most[-1],
        "SWFW holes": len(workspace.holes),
        "SWFW area of the largest hole [m2]": workspace.holes[0].area if workspace.holes else 0.0,
    }


def stable_wrench_feasible_slice(
    mechanism: CableDriven,
    free: tuple[int, int],
    fixed: Sequence[float],
    limit: float | None = None,
    load: tuple[float, float] = (0.0, 0.0),
) -> Region:
    """A slice of the SWFJ of a mechanism of more than two joints: a region of two of its joint angles [rad].

    Its conditions are "stability" and "wrench", the margins at the stiffest feasible tensions.

    Args:
        mechanism: of one design.
        free: which joints vary, by number from 0.
        fixed: all joint angles [rad]; those of the free joints do not matter.
        limit, load: see `stable_wrench_feasible_joint_space`.

    Raises:
        ValueError: limit is not in (0, pi), or the joints are not two of the mechanism's.
    """
    limit = _checked_limit(mechanism, limit)
    first, second = free
    angles = [float(angle) for angle in fixed]
    if first == second or not all(0 <= joint < len(angles) for joint in free):
        raise ValueError(f"free = {free!r}: must be two different joints of 0 ... {len(angles) - 1}")

    def conditions(q1: Component, q2: Component) -> tuple[Component, ...]:
        q: list[Component] = [angle + 0.0 * q1 for angle in angles]
        q[first], q[second] = q1, q2
        _, stability, wrench = mechanism.posture(tuple(q), load)
        return stability, wrench

    what = f"SWFJ, joints {first + 1} and {second + 1}"
    return Region(conditions, (STABILITY, WRENCH), (-limit, -limit), (limit, limit), what)


class Volume(NamedTuple):
    """How large the SWFJ of a mechanism of any number of joints is.

    Attributes:
        volume: in joint space [rad^n].
        fraction: of the cube |alpha_i| <= limit.
        error: standard error of the fraction.
    """

    volume: float
    fraction: float
    error: float


def stable_wrench_feasible_volume(
    mechanism: CableDriven,
    joints: int,
    limit: float | None = None,
    load: tuple[float, float] = (0.0, 0.0),
    lines: int = 1024,
    samples: int = 65,
) -> Volume:
    """The volume of the SWFJ in joint space, from its exact intervals along lines.

    The lines run along the last joint's angle; where, tell the points of eight scrambled Sobol sequences, the same ones
    at every call, whose means give the standard error.

    Args:
        mechanism: of one design.
        joints: how many it has, two or more.
        limit, load: see `stable_wrench_feasible_joint_space`.
        lines: of each sequence, a power of two.
        samples: along each line, see `Region.slices`.

    Raises:
        ValueError: limit is not in (0, pi), or there are fewer than two joints.
    """
    from scipy.stats import qmc

    limit = _checked_limit(mechanism, limit)
    if joints < 2:
        raise ValueError(f"joints = {joints!r}: must be two or more")
    shares = []
    for seed in range(8):
        places = (2 * qmc.Sobol(joints - 1, rng=seed).random(lines) - 1) * limit

        def conditions(line: Component, last: Component, places: np.ndarray = places) -> tuple[Component, ...]:
            number, last = np.broadcast_arrays(np.rint(line).astype(int), last)
            _, stability, wrench = mechanism.posture((*places[number].transpose(-1, *range(number.ndim)), last), load)
            return stability, wrench

        region = Region(conditions, (STABILITY, WRENCH), (0.0, -limit), (float(lines), limit))
        found = region.slices(0, np.arange(lines), samples)
        shares.append(sum(part.high - part.low for line in found for part in line) / (2 * limit * lines))
    fraction = float(np.mean(shares))
    error = float(np.std(shares, ddof=1) / math.sqrt(len(shares)))
    return Volume(fraction * (2 * limit) ** joints, fraction, error)


def _checked_limit(mechanism: CableDriven, limit: float | None) -> float:
    if limit is None:
        limit = min(float(mechanism.design.joint_limit), CLIP)
    if not 0 < limit < math.pi:
        raise ValueError(f"limit = {limit!r}: must be in (0, pi); at pi no cable has a moment arm")
    return limit
