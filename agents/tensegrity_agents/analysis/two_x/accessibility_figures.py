"""Figures of the 2-X's regions by inverse solutions, after those of [Furet2018], for any design.

Every function takes results of `tensegrity_envs.mechanics` and returns a `matplotlib.figure.Figure`; see
`reporting.style` for the style and for `save`.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline

from tensegrity_agents.analysis.two_x.axes import (
    COUNTS,
    PATH,
    POSITIVE,
    TYPES,
    fill,
    joint_axes,
    panels_of,
    workspace_axes,
)
from tensegrity_agents.reporting.style import FAINT, INK, new_figure, note, styled
from tensegrity_envs.geometry.accessibility import PI, Accessibility, tip_curve, wrapped
from tensegrity_envs.geometry.aspects import Aspects, PosturePath
from tensegrity_envs.mechanics.two_x import InverseSolution, TwoX


def _bounds(found: Accessibility) -> tuple[float, float, float, float]:
    shapes = list(found.by_count.values())
    x0, y0, x1, y1 = shapely.total_bounds(np.array(shapes, object)) if shapes else (-1.0, -1.0, 1.0, 1.0)
    return float(x0), float(y0), float(x1), float(y1)


def _critical(axes: Axes, found: Accessibility, size: float = 4.0) -> list[Any]:
    """Cusps and nodes; the handles of a legend."""
    handles: list[Any] = []
    for name, marker, points in (("cusp", "o", found.cusps), ("node", "D", found.nodes)):
        style: Any = {
            "marker": marker,
            "markersize": size,
            "color": "white",
            "markeredgecolor": INK,
            "linestyle": "none",
        }
        for point in points:
            axes.plot(*point.tip, **style, zorder=7)
        if points:
            handles.append(Line2D([], [], label=name, **style))
    return handles


def _curves(axes: Axes, found: Accessibility, width: float = 1.1) -> list[Any]:
    handles: list[Any] = []
    for chain in found.limits:
        axes.plot(*tip_curve(found.mechanism, chain).T, color=FAINT, linewidth=0.8 * width)
    for chain in found.singular:
        axes.plot(*tip_curve(found.mechanism, chain).T, color=INK, linewidth=width)
    if found.singular:
        handles.append(Line2D([], [], color=INK, linewidth=width, label="det J = 0"))
    if found.limits:
        handles.append(Line2D([], [], color=FAINT, linewidth=width, label="joint limit"))
    return handles


def _solutions(n: int) -> str:
    return f"{n} solution{'s' if n > 1 else ''}"


@styled
def workspace_boundaries(workspaces: Mapping[str, Accessibility]) -> Figure:
    """Workspace boundaries and regions by number of inverse solutions, [Furet2018, Fig. 3]; a panel for each design."""
    n = max(len(workspaces), 1)
    figure = new_figure(max(2.7 * n + 0.6, 5.0), 3.6 if n > 2 else 4.2)
    panels = panels_of(figure, n)
    counts = sorted({count for found in workspaces.values() for count in found.by_count})
    handles: dict[str, Any] = {}
    for axes, (name, found) in zip(panels, workspaces.items(), strict=False):
        for count, shape in found.by_count.items():
            fill(axes, shape, COUNTS.get(count, "#33608f"))
        workspace_axes(axes, _bounds(found))
        for handle in (*_curves(axes, found), *_critical(axes, found)):
            handles.setdefault(handle.get_label(), handle)
        axes.set_title(name)
    fills = [Patch(color=COUNTS.get(count, "#33608f"), label=_solutions(count)) for count in counts]
    figure.legend(handles=[*fills, *handles.values()], loc="outside lower center", ncols=6 if n > 2 else 3)
    return figure


def draw_arm(axes: Axes, mechanism: TwoX, q: tuple[float, float], colour: str, cables: bool = False) -> None:
    """The bars of an arm (and its lateral sides), joint 2 lighter."""
    nodes = mechanism.nodes(q)
    for member in mechanism.members:
        (x1, y1), (x2, y2) = (nodes[name] for name in member.nodes)
        if math.hypot(x2 - x1, y2 - y1) < 1e-12:
            continue
        if member.kind == "bar":
            axes.plot([x1, x2], [y1, y2], color=colour, linewidth=1.6, solid_capstyle="round", zorder=4)
        elif cables and member.kind == "cable":
            axes.plot([x1, x2], [y1, y2], color=FAINT, linewidth=0.7, linestyle=(0, (3, 2)), zorder=3)
    xy = np.array([value for name, value in nodes.items() if name != "P"])
    axes.plot(*xy.T, "o", markersize=2.4, color="white", markeredgecolor=colour, markeredgewidth=0.8, zorder=5)
    axes.plot(*nodes["P"], "*", markersize=7, color=PATH, zorder=6)


@styled
def inverse_solutions(mechanism: TwoX, solutions: Sequence[InverseSolution], target: tuple[float, float]) -> Figure:
    """The arm in every inverse solution of one target, [Furet2018, Fig. 4]."""
    n = max(len(solutions), 1)
    figure = new_figure(min(2.4 * n, 10) + 0.4, 3.9)
    panels = panels_of(figure, n, sharex=True, sharey=True)
    if not solutions:
        note(panels[0], "no inverse solution")
    for axes, solution in zip(panels, solutions, strict=False):
        draw_arm(axes, mechanism, solution.configuration, POSITIVE if solution.singularity > 0 else "#b26b00")
        t1, t2 = (alpha / 2 for alpha in solution.configuration)
        sign = ">" if solution.singularity > 0 else "<"
        axes.set_title(f"{solution.state},  det J {sign} 0\n" rf"$\theta$ = ({t1:.4f}, {t2:.4f})", fontsize=8.5)
        axes.set(aspect="equal", xlabel="x [m]")
        axes.grid(visible=False)
    panels[0].set_ylabel("y [m]")
    return figure


def _types_panel(axes: Axes, found: Accessibility, colours: Mapping[str, str], width: float) -> None:
    for types, shape in found.by_type.items():
        fill(axes, shape, colours[types])
    for chain in found.flat.values():
        axes.plot(*tip_curve(found.mechanism, chain).T, color="#b2182b", linewidth=0.7 * width)
    _curves(axes, found, width)


@styled
def regions_by_type(found: Accessibility) -> Figure:
    """Regions by the up and down states of their solutions, [Furet2018, Fig. 6], and a magnified part.

    Args:
        found: the workspace.
    """
    figure = new_figure(9.4, 4.6)
    zoom = [part for part in found.parts(max(found.by_count, default=0)) if part.centroid.y > 0]
    panels = panels_of(figure, 2 if zoom and len(found.by_count) > 1 else 1)
    ordered = sorted(found.by_type, key=lambda types: -found.by_type[types].area)
    colours = {types: TYPES[k % len(TYPES)] for k, types in enumerate(ordered)}
    _types_panel(panels[0], found, colours, 1.0)
    bounds = _bounds(found)
    workspace_axes(panels[0], bounds)
    if len(panels) > 1:
        _types_panel(panels[1], found, colours, 1.3)
        x0, y0, x1, y1 = zoom[0].bounds
        workspace_axes(panels[1], (x0, y0, x1, y1), base=False)
        panels[1].set_aspect("auto")
        panels[1].set_title("magnified (axes not to one scale)")
        panels[0].add_patch(
            PathPatch(
                Outline([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]), fill=False, edgecolor=PATH, linewidth=0.8
            )
        )
    critical = _critical(panels[-1], found)
    lines = [Line2D([], [], color=INK, linewidth=1.1, label="det J = 0")]
    if found.flat:
        lines.append(Line2D([], [], color="#b2182b", linewidth=0.8, label="a flat joint"))
    fills = [Patch(color=colours[types], label=types.replace("+", "+ ").replace("  ", " ")) for types in ordered]
    figure.legend(handles=[*fills, *lines, *critical], loc="outside right upper", fontsize=7.5)
    return figure


@styled
def joint_limited(found: Accessibility) -> Figure:
    """Regions by number of solutions within joint limits, [Furet2018, Fig. 7], a three-solution sliver magnified."""
    zoom = found.parts(3)
    figure = new_figure(8.6 if zoom else 5.4, 4.0)
    panels = panels_of(figure, 2 if zoom else 1, width_ratios=[1.3, 1] if zoom else [1])
    for axes in panels:
        for count, shape in found.by_count.items():
            fill(axes, shape, COUNTS.get(count, "#33608f"))
        lines = _curves(axes, found)
        workspace_axes(axes, _bounds(found), base=axes is panels[0])
        marks = _critical(axes, found)
    if zoom:
        x0, y0, x1, y1 = max(zoom, key=lambda part: part.centroid.x).bounds
        panels[1].set(xlim=(x0 - 0.02, x1 + 0.02), ylim=(y0 - 0.02, y1 + 0.02), aspect="auto")
        panels[1].set_title("magnified: three solutions")
    fills = [Patch(color=COUNTS.get(count, "#33608f"), label=_solutions(count)) for count in found.by_count]
    figure.legend(handles=[*fills, *lines, *marks], loc="outside lower center", ncols=7)
    return figure


@styled
def posture_change(
    found: Accessibility, path: PosturePath, aspects: Aspects, goal: tuple[float, float] | None = None
) -> Figure:
    """A change of posture without a singularity: in joint space over the aspects, and around its cusp in the workspace.

    Args:
        found: the workspace.
        path: from one inverse solution to another.
        aspects: of the arm.
        goal: as it was asked for, marked in addition to the path's end.
    """
    figure = new_figure(9.0, 4.3)
    left, right = figure.subplots(1, 2)
    limit = float(found.mechanism.design.joint_limit)
    shades = {1: "#dbe9f6", -1: "#fdebd0"}
    for label, sign in enumerate(aspects.signs):
        rows = np.where(aspects.labels == label, 1.0, np.nan)
        left.contourf(*aspects.axes, np.nan_to_num(rows).T, levels=[0.5, 1.5], colors=[shades[sign]])
    for chain in found.singular:
        for piece in wrapped(chain):
            left.plot(*piece.T, color=INK, linewidth=1.1)
    if not found.mechanism.design.a:
        for total in (-2 * PI, 2 * PI):
            left.plot([-limit, limit], [total + limit, total - limit], color=INK, linewidth=0.9, linestyle=(0, (4, 2)))
    for piece in wrapped(path.configurations) if not found.limits else [path.configurations]:
        left.plot(*piece.T, color=PATH, linewidth=1.8)
    ends = path.configurations[[0, -1]] if goal is None else np.array([path.configurations[0], goal])
    for marker, end in zip("os", ends, strict=True):
        left.plot(*end, marker, markersize=5, color="white", markeredgecolor=PATH, markeredgewidth=1.4, zorder=6)
    joint_axes(left, limit)
    for count, shape in found.by_count.items():
        fill(right, shape, COUNTS.get(count, "#33608f"))
    _curves(right, found)
    workspace_axes(right, _bounds(found))
    right.plot(*path.tips.T, color=PATH, linewidth=1.8)
    right.plot(*path.tips[0], "o", markersize=5, color="white", markeredgecolor=PATH, markeredgewidth=1.4, zorder=8)
    marks = _critical(right, found)
    for axes, chosen in ((left, False), (right, True)):
        for cusp in found.cusps:
            if not chosen:
                axes.plot(*cusp.configuration, "o", markersize=4, color="white", markeredgecolor=INK, zorder=7)
    fills = [Patch(color=COUNTS.get(count, "#33608f"), label=_solutions(count)) for count in found.by_count]
    signs = [Patch(color=shades[s], label=f"det J {'>' if s > 0 else '<'} 0") for s in (1, -1) if s in aspects.signs]
    lines = [
        Line2D([], [], color=INK, linewidth=1.1, label="det J = 0"),
        Line2D([], [], color=INK, linewidth=0.9, linestyle=(0, (4, 2)), label="det J = 0, tip at base"),
        Line2D([], [], color=PATH, linewidth=1.8, label=f"path, |det J| ≥ {path.clearance:.2g}"),
        Line2D([], [], marker="o", color="white", markeredgecolor=PATH, linestyle="none", label="start"),
        Line2D([], [], marker="s", color="white", markeredgecolor=PATH, linestyle="none", label="goal"),
    ]
    figure.legend(handles=[*signs, *fills, *lines, *marks], loc="outside lower center", ncols=6, fontsize=8)
    return figure
