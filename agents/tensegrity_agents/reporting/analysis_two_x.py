"""Figures of the 2-X's workspaces, after those of [Furet2018] and [Muralidharan2022], for any design.

Every function takes results of `tensegrity_envs.mechanics` and returns a `matplotlib.figure.Figure`; see
`reporting.figures` for the style and for `save`.
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

from tensegrity_agents.reporting.figures import _FAINT, _INK, _figure, _note, _styled, outline, without_jumps
from tensegrity_envs.mechanics.accessibility import PI, Accessibility, tip_curve, wrapped
from tensegrity_envs.mechanics.overlay import Image
from tensegrity_envs.mechanics.regions import LIMIT, Interval, Traced
from tensegrity_envs.mechanics.singularity import Aspects, PosturePath
from tensegrity_envs.mechanics.two_x import InverseSolution, TwoX
from tensegrity_envs.mechanics.workspace import CLIP, SINGULARITY, STABILITY, Cloud

_FINE = 5e-5  # simplification of filled shapes, relative to their size: invisible in print
_SINGULAR = "#7b3294"
_PATH = "#d55e00"
_COUNTS = {1: "#dbe7f3", 2: "#9ec3e0", 3: "#e69f00", 4: "#5b8fc0"}
# Okabe and Ito's colours; a cable and its antagonist share a hue
_CONDITIONS = {
    STABILITY: "#d55e00",
    "left 1": "#0072b2",
    "right 1": "#56b4e9",
    "left 2": "#009e73",
    "right 2": "#66c9a8",
    SINGULARITY: _SINGULAR,
    LIMIT: "#8b929b",
}
_POSITIVE, _NEGATIVE = "#0072b2", "#e69f00"  # det J > 0 and < 0
_TYPES = (
    *("#e4ecf5", "#b3cfe8", "#fdd0a2", "#b8dfb0", "#cdbfe3", "#f7c1c1", "#f4e79a", "#a6dbd8", "#d8b08c", "#c9c9c9"),
    *("#8fa9d6", "#6f9fcb", "#f29e5c", "#7fc47c", "#a58bd0", "#e98b8b", "#d9c24a", "#63b9b4", "#b07f55", "#979797"),
    *("#5d7fb8", "#c46a3a", "#4d9a55", "#7a5fb0", "#bf5b5b", "#a8922e"),
)
_ANGLES = r"$\alpha_1$ [rad]", r"$\alpha_2$ [rad]"
_TICKS = {k: v for k, v in zip((-2, -1, 0, 1, 2), (r"$-2\pi$", r"$-\pi$", "0", r"$\pi$", r"$2\pi$"), strict=True)}


def _fill(axes: Axes, geometry: Any, colour: str, **kwargs: Any) -> None:
    x0, y0, x1, y1 = geometry.bounds
    path = outline(geometry.simplify(_FINE * max(x1 - x0, y1 - y0)))
    if path is not None:  # not add_patch, which looks for the data's limits point by point; they are set anyway
        axes.add_artist(PathPatch(path, facecolor=colour, **({"edgecolor": "none", "linewidth": 0} | kwargs)))


def _panels(figure: Figure, count: int, **kwargs: Any) -> list[Axes]:
    """Axes side by side."""
    return list(figure.subplots(1, count, squeeze=False, **kwargs)[0])


def _workspace_axes(axes: Axes, bounds: Sequence[float], base: bool = True) -> None:
    x0, y0, x1, y1 = bounds
    rim = 0.05 * max(x1 - x0, y1 - y0)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", xlim=(x0 - rim, x1 + rim), ylim=(y0 - rim, y1 + rim))
    axes.grid(visible=False)
    if base:
        axes.plot(0, 0, "^", markersize=5, color=_INK, zorder=6)


def _joint_axes(axes: Axes, limit: float) -> None:
    axes.set(xlabel=_ANGLES[0], ylabel=_ANGLES[1], aspect="equal", xlim=(-limit, limit), ylim=(-limit, limit))
    axes.grid(visible=False)
    if limit > 3:
        shown = [k for k in _TICKS if abs(k) * PI <= limit * 1.02]
        axes.set_xticks([k * PI for k in shown], [_TICKS[k] for k in shown])
        axes.set_yticks([k * PI for k in shown], [_TICKS[k] for k in shown])


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
            "markeredgecolor": _INK,
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
        axes.plot(*tip_curve(found.mechanism, chain).T, color=_FAINT, linewidth=0.8 * width)
    for chain in found.singular:
        axes.plot(*tip_curve(found.mechanism, chain).T, color=_INK, linewidth=width)
    if found.singular:
        handles.append(Line2D([], [], color=_INK, linewidth=width, label="det J = 0"))
    if found.limits:
        handles.append(Line2D([], [], color=_FAINT, linewidth=width, label="joint limit"))
    return handles


def _solutions(n: int) -> str:
    return f"{n} solution{'s' if n > 1 else ''}"


@_styled
def workspace_boundaries(workspaces: Mapping[str, Accessibility]) -> Figure:
    """Workspace boundaries and regions by number of inverse solutions, [Furet2018, Fig. 3]; a panel for each design."""
    n = max(len(workspaces), 1)
    figure = _figure(max(2.7 * n + 0.6, 5.0), 3.6 if n > 2 else 4.2)
    panels = _panels(figure, n)
    counts = sorted({count for found in workspaces.values() for count in found.by_count})
    handles: dict[str, Any] = {}
    for axes, (name, found) in zip(panels, workspaces.items(), strict=False):
        for count, shape in found.by_count.items():
            _fill(axes, shape, _COUNTS.get(count, "#33608f"))
        _workspace_axes(axes, _bounds(found))
        for handle in (*_curves(axes, found), *_critical(axes, found)):
            handles.setdefault(handle.get_label(), handle)
        axes.set_title(name)
    fills = [Patch(color=_COUNTS.get(count, "#33608f"), label=_solutions(count)) for count in counts]
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
            axes.plot([x1, x2], [y1, y2], color=_FAINT, linewidth=0.7, linestyle=(0, (3, 2)), zorder=3)
    xy = np.array([value for name, value in nodes.items() if name != "P"])
    axes.plot(*xy.T, "o", markersize=2.4, color="white", markeredgecolor=colour, markeredgewidth=0.8, zorder=5)
    axes.plot(*nodes["P"], "*", markersize=7, color=_PATH, zorder=6)


@_styled
def inverse_solutions(mechanism: TwoX, solutions: Sequence[InverseSolution], target: tuple[float, float]) -> Figure:
    """The arm in every inverse solution of one target, [Furet2018, Fig. 4]."""
    n = max(len(solutions), 1)
    figure = _figure(min(2.4 * n, 10) + 0.4, 3.9)
    panels = _panels(figure, n, sharex=True, sharey=True)
    if not solutions:
        _note(panels[0], "no inverse solution")
    for axes, solution in zip(panels, solutions, strict=False):
        draw_arm(axes, mechanism, solution.configuration, _POSITIVE if solution.singularity > 0 else "#b26b00")
        t1, t2 = (alpha / 2 for alpha in solution.configuration)
        sign = ">" if solution.singularity > 0 else "<"
        axes.set_title(f"{solution.state},  det J {sign} 0\n" rf"$\theta$ = ({t1:.4f}, {t2:.4f})", fontsize=8.5)
        axes.set(aspect="equal", xlabel="x [m]")
        axes.grid(visible=False)
    panels[0].set_ylabel("y [m]")
    return figure


def _types_panel(axes: Axes, found: Accessibility, colours: Mapping[str, str], width: float) -> None:
    for types, shape in found.by_type.items():
        _fill(axes, shape, colours[types])
    for chain in found.flat.values():
        axes.plot(*tip_curve(found.mechanism, chain).T, color="#b2182b", linewidth=0.7 * width)
    _curves(axes, found, width)


@_styled
def regions_by_type(found: Accessibility) -> Figure:
    """Regions by the up and down states of their solutions, [Furet2018, Fig. 6], and a magnified part.

    Args:
        found: the workspace.
    """
    figure = _figure(9.4, 4.6)
    zoom = [part for part in found.parts(max(found.by_count, default=0)) if part.centroid.y > 0]
    panels = _panels(figure, 2 if zoom and len(found.by_count) > 1 else 1)
    ordered = sorted(found.by_type, key=lambda types: -found.by_type[types].area)
    colours = {types: _TYPES[k % len(_TYPES)] for k, types in enumerate(ordered)}
    _types_panel(panels[0], found, colours, 1.0)
    bounds = _bounds(found)
    _workspace_axes(panels[0], bounds)
    if len(panels) > 1:
        _types_panel(panels[1], found, colours, 1.3)
        x0, y0, x1, y1 = zoom[0].bounds
        _workspace_axes(panels[1], (x0, y0, x1, y1), base=False)
        panels[1].set_aspect("auto")
        panels[1].set_title("magnified (axes not to one scale)")
        panels[0].add_patch(
            PathPatch(
                Outline([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]), fill=False, edgecolor=_PATH, linewidth=0.8
            )
        )
    critical = _critical(panels[-1], found)
    lines = [Line2D([], [], color=_INK, linewidth=1.1, label="det J = 0")]
    if found.flat:
        lines.append(Line2D([], [], color="#b2182b", linewidth=0.8, label="a flat joint"))
    fills = [Patch(color=colours[types], label=types.replace("+", "+ ").replace("  ", " ")) for types in ordered]
    figure.legend(handles=[*fills, *lines, *critical], loc="outside right upper", fontsize=7.5)
    return figure


@_styled
def joint_limited(found: Accessibility) -> Figure:
    """Regions by number of solutions within joint limits, [Furet2018, Fig. 7], a three-solution sliver magnified."""
    zoom = found.parts(3)
    figure = _figure(8.6 if zoom else 5.4, 4.0)
    panels = _panels(figure, 2 if zoom else 1, width_ratios=[1.3, 1] if zoom else [1])
    for axes in panels:
        for count, shape in found.by_count.items():
            _fill(axes, shape, _COUNTS.get(count, "#33608f"))
        lines = _curves(axes, found)
        _workspace_axes(axes, _bounds(found), base=axes is panels[0])
        marks = _critical(axes, found)
    if zoom:
        x0, y0, x1, y1 = max(zoom, key=lambda part: part.centroid.x).bounds
        panels[1].set(xlim=(x0 - 0.02, x1 + 0.02), ylim=(y0 - 0.02, y1 + 0.02), aspect="auto")
        panels[1].set_title("magnified: three solutions")
    fills = [Patch(color=_COUNTS.get(count, "#33608f"), label=_solutions(count)) for count in found.by_count]
    figure.legend(handles=[*fills, *lines, *marks], loc="outside lower center", ncols=7)
    return figure


@_styled
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
    figure = _figure(9.0, 4.3)
    left, right = figure.subplots(1, 2)
    limit = float(found.mechanism.design.joint_limit)
    shades = {1: "#dbe9f6", -1: "#fdebd0"}
    for label, sign in enumerate(aspects.signs):
        rows = np.where(aspects.labels == label, 1.0, np.nan)
        left.contourf(*aspects.axes, np.nan_to_num(rows).T, levels=[0.5, 1.5], colors=[shades[sign]])
    for chain in found.singular:
        for piece in wrapped(chain):
            left.plot(*piece.T, color=_INK, linewidth=1.1)
    if not found.mechanism.design.a:
        for total in (-2 * PI, 2 * PI):
            left.plot([-limit, limit], [total + limit, total - limit], color=_INK, linewidth=0.9, linestyle=(0, (4, 2)))
    for piece in wrapped(path.configurations) if not found.limits else [path.configurations]:
        left.plot(*piece.T, color=_PATH, linewidth=1.8)
    ends = path.configurations[[0, -1]] if goal is None else np.array([path.configurations[0], goal])
    for marker, end in zip("os", ends, strict=True):
        left.plot(*end, marker, markersize=5, color="white", markeredgecolor=_PATH, markeredgewidth=1.4, zorder=6)
    _joint_axes(left, limit)
    for count, shape in found.by_count.items():
        _fill(right, shape, _COUNTS.get(count, "#33608f"))
    _curves(right, found)
    _workspace_axes(right, _bounds(found))
    right.plot(*path.tips.T, color=_PATH, linewidth=1.8)
    right.plot(*path.tips[0], "o", markersize=5, color="white", markeredgecolor=_PATH, markeredgewidth=1.4, zorder=8)
    marks = _critical(right, found)
    for axes, chosen in ((left, False), (right, True)):
        for cusp in found.cusps:
            if not chosen:
                axes.plot(*cusp.configuration, "o", markersize=4, color="white", markeredgecolor=_INK, zorder=7)
    fills = [Patch(color=_COUNTS.get(count, "#33608f"), label=_solutions(count)) for count in found.by_count]
    signs = [Patch(color=shades[s], label=f"det J {'>' if s > 0 else '<'} 0") for s in (1, -1) if s in aspects.signs]
    lines = [
        Line2D([], [], color=_INK, linewidth=1.1, label="det J = 0"),
        Line2D([], [], color=_INK, linewidth=0.9, linestyle=(0, (4, 2)), label="det J = 0, tip at base"),
        Line2D([], [], color=_PATH, linewidth=1.8, label=f"path, |det J| ≥ {path.clearance:.2g}"),
        Line2D([], [], marker="o", color="white", markeredgecolor=_PATH, linestyle="none", label="start"),
        Line2D([], [], marker="s", color="white", markeredgecolor=_PATH, linestyle="none", label="goal"),
    ]
    figure.legend(handles=[*signs, *fills, *lines, *marks], loc="outside lower center", ncols=6, fontsize=8)
    return figure


# ------------------------------------------------------------------------------------ stable wrench-feasible set


def _of_sign(mechanism: TwoX, points: np.ndarray) -> np.ndarray:
    """det J at midpoints of a chain's segments."""
    middle = (points[1:] + points[:-1]) / 2
    return np.asarray(mechanism.singularity((middle[:, 0], middle[:, 1])))


@_styled
def boundary_scan(mechanism: TwoX, intervals: Sequence[Interval], fixed: float, cloud: Cloud) -> Figure:
    """One slice, and the boundary points of both scans, [Muralidharan2022, Fig. 3].

    Args:
        mechanism: of which they are.
        intervals: of alpha_1 on the slice alpha_2 = fixed.
        fixed: its alpha_2 [rad].
        cloud: boundary points.
    """
    figure = _figure(9.6, 3.9)
    left, middle, right = figure.subplots(1, 3, width_ratios=[1.05, 1, 1])
    s = np.linspace(-CLIP, CLIP, 1500)
    tensions, stability, _ = mechanism.posture((s, np.full(len(s), fixed)))
    low, high = float(mechanism.design.min_tension), float(mechanism.design.max_tension)
    margins = {STABILITY: np.asarray(stability)}
    margins |= {name: (np.asarray(f) - low) / high for name, f in zip(mechanism.input_names, tensions, strict=True)}
    for interval in intervals:
        left.axvspan(interval.low, interval.high, color="#e6edf5", linewidth=0)
        for end, name in zip(interval[:2], interval[2:], strict=True):
            left.plot(end, 0, "o", markersize=4.5, color=_CONDITIONS.get(name, _INK), zorder=5)
            left.annotate(
                f"{end:.5f}", (end, 0), xytext=(0, -13), textcoords="offset points", ha="center", fontsize=7.5
            )
    for name, values in margins.items():
        left.plot(s, without_jumps(values), color=_CONDITIONS.get(name, _INK), linewidth=1.3, label=name)
    left.axhline(0, color=_INK, linewidth=0.8)
    left.set(xlim=(-PI, PI), ylim=(-1, 2), xlabel=_ANGLES[0], ylabel="margins [-]")
    left.set_title(rf"slice $\alpha_2$ = {fixed:g}")
    inside = np.array([name != SINGULARITY for name in cloud.conditions], bool)
    colours = np.array([_CONDITIONS.get(name, _INK) for name in cloud.conditions])
    for axes, wanted, title in (
        (middle, inside & (cloud.fixed == 1), r"scan of $\alpha_2$"),
        (right, inside, "both scans"),
    ):
        axes.scatter(*cloud.points[wanted].T, s=9, c=list(colours[wanted]), linewidths=0)
        _joint_axes(axes, PI)
        axes.set_title(title)
        if not wanted.any():
            _note(axes, "empty")
    handles = [
        Line2D([], [], marker="o", color=colour, linewidth=1.3, markersize=3.5, label=name)
        for name, colour in _CONDITIONS.items()
        if name in margins or name in set(np.array(cloud.conditions)[inside])
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


@_styled
def stable_sets(mechanism: TwoX, cloud: Cloud, joint_space: Traced, workspace: Image) -> Figure:
    """SWFJ and SWFW with the two sheets of det J, [Muralidharan2022, Fig. 4]: points, and curves through them."""
    figure = _figure(9.0, 4.5)
    left, right = figure.subplots(1, 2)
    _joint_axes(left, PI)
    if joint_space.is_empty:
        for axes in (left, right):
            _note(axes, "no stable, wrench-feasible configuration")
        return figure
    for sheet in workspace.sheets:
        colour = _POSITIVE if ">" in sheet.name else _NEGATIVE
        for component in sheet.source.components:
            shape = shapely.Polygon(component.outer.points, [hole.points for hole in component.holes])
            _fill(left, shape, colour, alpha=0.16)
            for ring in component.rings:
                left.plot(*np.vstack([ring.points, ring.points[:1]]).T, color=colour, linewidth=1.0)
        for ring_image in sheet.rings:
            closed = np.vstack([ring_image, ring_image[:1]])
            right.plot(*closed.T, color=colour, linewidth=1.0)
        position = ">" in sheet.name
        inside = [face.polygon for face in workspace.faces if face.counts[workspace.sheets.index(sheet)]]
        for polygon in inside:
            _fill(right, polygon, colour, alpha=0.16)
        chosen = (cloud.determinant > 0) if position else (cloud.determinant < 0)
        left.scatter(*cloud.points[chosen].T, s=7, color=colour, linewidths=0, zorder=4)
        right.scatter(*cloud.tips[chosen].T, s=7, color=colour, linewidths=0, zorder=4)
    fold = np.array([name == SINGULARITY for name in cloud.conditions], bool)
    left.scatter(*cloud.points[fold].T, s=7, color=_SINGULAR, linewidths=0, zorder=5)
    right.scatter(*cloud.tips[fold].T, s=7, color=_SINGULAR, linewidths=0, zorder=5)
    _workspace_axes(right, workspace.reachable.bounds)
    pieces = len(joint_space.components)
    left.set_title(
        f"SWFJ: {100 * joint_space.fraction:.3f}% of the square, in {pieces} piece{'s' if pieces > 1 else ''}"
    )
    right.set_title(f"SWFW: {workspace.area():.5g} m², overlap {workspace.overlap:.5g} m²")
    handles = [
        Line2D([], [], marker="o", markersize=3, color=_POSITIVE, linewidth=1, label="det J > 0"),
        Line2D([], [], marker="o", markersize=3, color=_NEGATIVE, linewidth=1, label="det J < 0"),
        Line2D([], [], marker="o", markersize=3, color=_SINGULAR, linewidth=0, label="det J = 0"),
        Line2D([], [], marker="^", color=_INK, linewidth=0, label="base"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


@_styled
def active_conditions(mechanism: TwoX, joint_space: Traced, workspace: Image) -> Figure:
    """What ends the SWFJ along its boundary, and the workspace by number of configurations."""
    figure = _figure(9.0, 4.5)
    left, right = figure.subplots(1, 2)
    _joint_axes(left, PI)
    if joint_space.is_empty:
        for axes in (left, right):
            _note(axes, "no stable, wrench-feasible configuration")
        return figure
    names = (*joint_space.region.names, LIMIT)
    lengths = joint_space.lengths()
    for component in joint_space.components:
        _fill(left, shapely.Polygon(component.outer.points, [hole.points for hole in component.holes]), "#eef2f7")
        for ring in component.rings:
            following = np.roll(ring.points, -1, axis=0)
            for k, name in enumerate(names):
                mine = ring.conditions == k
                pieces = np.stack([ring.points[mine], following[mine], np.full((int(mine.sum()), 2), np.nan)], axis=1)
                left.plot(*pieces.reshape(-1, 2).T, color=_CONDITIONS.get(name, _INK), linewidth=1.8)
    for sheet in workspace.sheets[:1]:
        for ring in sheet.source.rings:
            k = sheet.source.region.names.index(SINGULARITY)
            mine = ring.conditions == k
            following = np.roll(ring.points, -1, axis=0)
            pieces = np.stack([ring.points[mine], following[mine], np.full((int(mine.sum()), 2), np.nan)], axis=1)
            left.plot(*pieces.reshape(-1, 2).T, color=_SINGULAR, linewidth=1.0)
    for n, shape in workspace.regions.items():
        _fill(right, shape, _COUNTS.get(n, "#33608f"), edgecolor=_INK, linewidth=0.6)
    _workspace_axes(right, workspace.reachable.bounds)
    lines = [
        Line2D([], [], color=_CONDITIONS.get(name, _INK), linewidth=1.8, label=f"{name}: {lengths[name]:.2f} rad")
        for name in names
        if lengths[name] > 0
    ]
    lines.append(Line2D([], [], color=_SINGULAR, linewidth=1, label="det J = 0"))
    fills = [
        Patch(color=_COUNTS.get(n, "#33608f"), label=f"{n} configuration{'s' if n > 1 else ''}: {shape.area:.5g} m²")
        for n, shape in workspace.regions.items()
    ]
    figure.legend(handles=[*lines, *fills], loc="outside lower center", ncols=4)
    return figure
