"""Figures of the 2-X's stable wrench-feasible set, after those of [Muralidharan2022], for any design."""

from collections.abc import Sequence

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tensegrity_agents.analysis.two_x.axes import (
    ANGLES,
    CONDITIONS,
    COUNTS,
    NEGATIVE,
    POSITIVE,
    SINGULAR,
    fill,
    joint_axes,
    workspace_axes,
)
from tensegrity_agents.reporting.style import INK, new_figure, note, styled, without_jumps
from tensegrity_envs.geometry.accessibility import PI
from tensegrity_envs.geometry.overlay import Image
from tensegrity_envs.geometry.regions import LIMIT, Interval, Traced
from tensegrity_envs.geometry.workspace import CLIP, SINGULARITY, STABILITY, Cloud
from tensegrity_envs.mechanics.two_x import TwoX


@styled
def boundary_scan(mechanism: TwoX, intervals: Sequence[Interval], fixed: float, cloud: Cloud) -> Figure:
    """One slice, and the boundary points of both scans, [Muralidharan2022, Fig. 3].

    Args:
        mechanism: of which they are.
        intervals: of alpha_1 on the slice alpha_2 = fixed.
        fixed: its alpha_2 [rad].
        cloud: boundary points.
    """
    figure = new_figure(9.6, 3.9)
    left, middle, right = figure.subplots(1, 3, width_ratios=[1.05, 1, 1])
    s = np.linspace(-CLIP, CLIP, 1500)
    tensions, stability, _ = mechanism.posture((s, np.full(len(s), fixed)))
    low, high = float(mechanism.design.min_tension), float(mechanism.design.max_tension)
    margins = {STABILITY: np.asarray(stability)}
    margins |= {name: (np.asarray(f) - low) / high for name, f in zip(mechanism.input_names, tensions, strict=True)}
    for interval in intervals:
        left.axvspan(interval.low, interval.high, color="#e6edf5", linewidth=0)
        for end, name in zip(interval[:2], interval[2:], strict=True):
            left.plot(end, 0, "o", markersize=4.5, color=CONDITIONS.get(name, INK), zorder=5)
            left.annotate(
                f"{end:.5f}", (end, 0), xytext=(0, -13), textcoords="offset points", ha="center", fontsize=7.5
            )
    for name, values in margins.items():
        left.plot(s, without_jumps(values), color=CONDITIONS.get(name, INK), linewidth=1.3, label=name)
    left.axhline(0, color=INK, linewidth=0.8)
    left.set(xlim=(-PI, PI), ylim=(-1, 2), xlabel=ANGLES[0], ylabel="margins [-]")
    left.set_title(rf"slice $\alpha_2$ = {fixed:g}")
    inside = np.array([name != SINGULARITY for name in cloud.conditions], bool)
    colours = np.array([CONDITIONS.get(name, INK) for name in cloud.conditions])
    for axes, wanted, title in (
        (middle, inside & (cloud.fixed == 1), r"scan of $\alpha_2$"),
        (right, inside, "both scans"),
    ):
        axes.scatter(*cloud.points[wanted].T, s=9, c=list(colours[wanted]), linewidths=0)
        joint_axes(axes, PI)
        axes.set_title(title)
        if not wanted.any():
            note(axes, "empty")
    handles = [
        Line2D([], [], marker="o", color=colour, linewidth=1.3, markersize=3.5, label=name)
        for name, colour in CONDITIONS.items()
        if name in margins or name in set(np.array(cloud.conditions)[inside])
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def _say_empty(joints: Axes, positions: Axes) -> None:
    positions.set(xlabel="x [m]", ylabel="y [m]")
    for axes in (joints, positions):
        note(axes, "no stable, wrench-feasible configuration")


@styled
def stable_sets(mechanism: TwoX, cloud: Cloud, joint_space: Traced, workspace: Image) -> Figure:
    """SWFJ and SWFW with the two sheets of det J, [Muralidharan2022, Fig. 4]: points, and curves through them."""
    figure = new_figure(9.0, 4.5)
    left, right = figure.subplots(1, 2)
    joint_axes(left, PI)
    if joint_space.is_empty:
        _say_empty(left, right)
        return figure
    for sheet in workspace.sheets:
        colour = POSITIVE if ">" in sheet.name else NEGATIVE
        for component in sheet.source.components:
            shape = shapely.Polygon(component.outer.points, [hole.points for hole in component.holes])
            fill(left, shape, colour, alpha=0.16)
            for ring in component.rings:
                left.plot(*np.vstack([ring.points, ring.points[:1]]).T, color=colour, linewidth=1.0)
        for ring_image in sheet.rings:
            closed = np.vstack([ring_image, ring_image[:1]])
            right.plot(*closed.T, color=colour, linewidth=1.0)
        position = ">" in sheet.name
        inside = [face.polygon for face in workspace.faces if face.counts[workspace.sheets.index(sheet)]]
        for polygon in inside:
            fill(right, polygon, colour, alpha=0.16)
        chosen = (cloud.determinant > 0) if position else (cloud.determinant < 0)
        left.scatter(*cloud.points[chosen].T, s=7, color=colour, linewidths=0, zorder=4)
        right.scatter(*cloud.tips[chosen].T, s=7, color=colour, linewidths=0, zorder=4)
    fold = np.array([name == SINGULARITY for name in cloud.conditions], bool)
    left.scatter(*cloud.points[fold].T, s=7, color=SINGULAR, linewidths=0, zorder=5)
    right.scatter(*cloud.tips[fold].T, s=7, color=SINGULAR, linewidths=0, zorder=5)
    workspace_axes(right, workspace.reachable.bounds)
    count = len(joint_space.components)
    components = f"{count} connected component{'s' if count > 1 else ''}"
    left.set_title(f"SWFJ: {100 * joint_space.fraction:.3f}% of the square, in {components}")
    right.set_title(f"SWFW: {workspace.area():.5g} m², overlap {workspace.overlap:.5g} m²")
    handles = [
        Line2D([], [], marker="o", markersize=3, color=POSITIVE, linewidth=1, label="det J > 0"),
        Line2D([], [], marker="o", markersize=3, color=NEGATIVE, linewidth=1, label="det J < 0"),
        Line2D([], [], marker="o", markersize=3, color=SINGULAR, linewidth=0, label="det J = 0"),
        Line2D([], [], marker="^", color=INK, linewidth=0, label="base"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


@styled
def active_conditions(mechanism: TwoX, joint_space: Traced, workspace: Image) -> Figure:
    """What ends the SWFJ along its boundary, and the workspace by number of configurations."""
    figure = new_figure(9.0, 4.5)
    left, right = figure.subplots(1, 2)
    joint_axes(left, PI)
    if joint_space.is_empty:
        _say_empty(left, right)
        return figure
    names = (*joint_space.region.names, LIMIT)
    lengths = joint_space.lengths()
    for component in joint_space.components:
        fill(left, shapely.Polygon(component.outer.points, [hole.points for hole in component.holes]), "#eef2f7")
        for ring in component.rings:
            following = np.roll(ring.points, -1, axis=0)
            for k, name in enumerate(names):
                mine = ring.conditions == k
                pieces = np.stack([ring.points[mine], following[mine], np.full((int(mine.sum()), 2), np.nan)], axis=1)
                left.plot(*pieces.reshape(-1, 2).T, color=CONDITIONS.get(name, INK), linewidth=1.8)
    for sheet in workspace.sheets[:1]:
        for ring in sheet.source.rings:
            k = sheet.source.region.names.index(SINGULARITY)
            mine = ring.conditions == k
            following = np.roll(ring.points, -1, axis=0)
            pieces = np.stack([ring.points[mine], following[mine], np.full((int(mine.sum()), 2), np.nan)], axis=1)
            left.plot(*pieces.reshape(-1, 2).T, color=SINGULAR, linewidth=1.0)
    for n, shape in workspace.regions.items():
        fill(right, shape, COUNTS.get(n, "#33608f"), edgecolor=INK, linewidth=0.6)
    workspace_axes(right, workspace.reachable.bounds)
    lines = [
        Line2D([], [], color=CONDITIONS.get(name, INK), linewidth=1.8, label=f"{name}: {lengths[name]:.2f} rad")
        for name in names
        if lengths[name] > 0
    ]
    lines.append(Line2D([], [], color=SINGULAR, linewidth=1, label="det J = 0"))
    fills = [
        Patch(color=COUNTS.get(n, "#33608f"), label=f"{n} configuration{'s' if n > 1 else ''}: {shape.area:.5g} m²")
        for n, shape in workspace.regions.items()
    ]
    figure.legend(handles=[*lines, *fills], loc="outside lower center", ncols=4)
    return figure
