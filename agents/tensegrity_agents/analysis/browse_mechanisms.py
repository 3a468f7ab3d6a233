"""The pages for browsing of the dual-triangle arm, the planar 4-bar and the spatial prism."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from tensegrity_agents.analysis.browse_page import Sample, Shape, members_of, write_browse_page
from tensegrity_envs.geometry.dual_triangle_fields import maximum, region_of, room
from tensegrity_envs.geometry.overlay import Image
from tensegrity_envs.mechanics.dual_triangle import DualTriangle
from tensegrity_envs.mechanics.planar_four_bar import PlanarFourBar
from tensegrity_envs.mechanics.spatial_prism import SpatialPrism

_COUNTS = ("#dbe9f6", "#a6cbe3", "#6aaed6", "#3787c0", "#105ba4")
_GRID = 33  # points along each axis
_SLIVER = 1e-6  # of the workspace's size: faces that are smaller lie between two chords of one curve


def _grid(bounds: tuple[float, float, float, float]) -> tuple[np.ndarray, float]:
    """Points over a rectangle, shape (n, 2), and their distance."""
    x0, y0, x1, y1 = bounds
    step = max(x1 - x0, y1 - y0) / (_GRID - 1)
    x, y = np.meshgrid(np.arange(x0, x1 + step / 2, step), np.arange(y0, y1 + step / 2, step))
    return np.column_stack([x.ravel(), y.ravel()]), step


def dual_triangle_page(arm: DualTriangle, path: Path, title: str) -> Path:
    """Where the tip can be without a load, and at each point the posture that is farthest from its limits."""
    b = float(arm.design.b1)
    field = maximum(arm, room(arm), 201)
    region = region_of(field, b)
    rings = [np.asarray(r.coords) for part in shapely.get_parts(region) for r in (part.exterior, *part.interiors)]
    samples = []
    stride = 200 // (_GRID - 1)
    for i in range(len(field.y) // 2 % stride, len(field.y), stride):
        for j in range(0, len(field.x), stride):
            if field.value[i, j] <= 0:
                continue
            q = tuple(float(angle) for angle in field.best[:, i, j])
            push = float(np.asarray(arm.critical_load(q, (-1.0, 0.0))))
            row: list[float | str] = [*q, *(float(v) for v in arm.control(q)), push]
            place = (float(field.x[j] * b), float(field.y[i] * b))
            samples.append(Sample(place, [row], [members_of(arm.nodes(q), arm.members)]))
    columns = [f"q{i} [rad]" for i in (1, 2, 3)] + [f"Δ{i} [m]" for i in (1, 2, 3)] + ["critical push [N]"]
    return write_browse_page(
        path,
        title,
        regions=[Shape(f"reached without a load: {region.area:.5g} m²", _COUNTS[0], rings)],
        samples=samples,
        columns=columns,
        cell=0.75 * stride * float(field.x[1] - field.x[0]) * b,
        what=("posture, the one farthest from its limits", "postures"),
    )


def four_bar_page(arm: PlanarFourBar, workspaces: Mapping[str, Image], path: Path, title: str) -> Path:
    """Regions by number of stable rectangles, and at each point all stable states."""
    found = workspaces["rectangle"]
    size = float(arm.length) ** 2
    regions = []
    for count, region in found.regions.items():
        parts = [
            part for part in shapely.get_parts(region) if part.geom_type == "Polygon" and part.area > _SLIVER * size
        ]
        rings = [np.asarray(ring.coords) for part in parts for ring in (part.exterior, *part.interiors)]
        label = f"{count} stable rectangle{'s' if count > 1 else ''}: {region.area:.5g} m²"
        regions.append(Shape(label, _COUNTS[min(count, 5) - 1], rings))
    samples = []
    points, step = _grid(found.reachable.bounds)
    for x, y in points:
        states = [s for s in arm.inverse_kinematics(float(x), float(y)) if s.is_stable]
        sample = Sample((float(x), float(y)))
        for state in states:
            q, lengths = state.configuration, state.lengths
            thrusts = arm.thrusts(q, lengths, (0.0, 0.0))
            sample.rows.append([*(float(v) for v in (*lengths, *q, *thrusts))])
            sample.arms.append(members_of(arm.nodes(q, lengths), arm.members))
        if states:
            samples.append(sample)
    columns = ["rho1 [m]", "rho2 [m]", "theta [rad]", "gamma [rad]", "thrust 1 [N]", "thrust 2 [N]"]
    return write_browse_page(
        path, title, regions=regions, samples=samples, columns=columns, cell=0.75 * step,
        what=("stable state", "stable states"),
    )  # fmt: skip


def spatial_prism_page(prism: SpatialPrism, path: Path, title: str) -> Path:
    """A horizontal section through the middle of the published motions: lengths and thrusts of the struts."""
    D = float(prism.design.D)
    height = 0.8 * D
    angle = np.linspace(0, 2 * np.pi, 181)
    disc = 1.2 * D * np.column_stack([np.cos(angle), np.sin(angle)])
    points, step = _grid((-1.2 * D, -1.2 * D, 1.2 * D, 1.2 * D))
    samples = []
    for x, y in points[np.hypot(*points.T) <= 1.2 * D]:
        r = (float(x), float(y), height)
        q = (*r, 0.0, 0.0, 0.0)
        lengths, thrusts = prism.unloaded_lengths(r), prism.actuator_forces(q)
        clearance = float(np.asarray(prism.strut_clearance(q)))
        nodes: dict[str, Any] = {name: place[:2] for name, place in prism.nodes(q).items()}  # from above
        row: list[float | str] = [*(float(v) for v in (*lengths, *thrusts)), 1000 * clearance]
        samples.append(Sample((float(x), float(y)), [row], [members_of(nodes, prism.members)]))
    columns = [f"l{i} [m]" for i in (1, 2, 3)] + [f"thrust {i} [N]" for i in (1, 2, 3)] + ["struts apart [mm]"]
    base = np.array([node[:2] for node in (*prism.base, prism.base[0])], float)
    return write_browse_page(
        path,
        f"{title}, section z = {height:.3g} m, from above",
        regions=[Shape("within 1.2 base radii of the axis", _COUNTS[0], [disc])],
        samples=samples,
        columns=columns,
        cell=0.75 * step,
        what=("platform without a load", "platforms"),
        curves=[base],
    )
