"""Figures of a comparison, in one style that prints well and that colour-blind readers can read.

Every function returns a `matplotlib.figure.Figure` of its own (no pyplot, no global state); `save` writes it as PNG,
SVG and PDF. A controller looks the same in all of them: see `looks`.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import wraps
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec

import matplotlib as mpl
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox

from tensegrity_agents.evaluation.results import Run
from tensegrity_agents.reporting.table import Row, grouped, success_text
from tensegrity_envs.mechanics.two_x import TwoX, TwoXDesign
from tensegrity_envs.mechanics.workspace import stable_wrench_feasible_workspace

_STYLE: Any = {
    "figure.dpi": 100,
    "figure.facecolor": "white",
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.labelsize": 9,
    "axes.edgecolor": "#555c66",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": "#e3e6ea",
    "grid.linewidth": 0.7,
    "xtick.color": "#3a414b",
    "ytick.color": "#3a414b",
    "text.color": "#1e242c",
    "axes.labelcolor": "#1e242c",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "legend.handlelength": 2.6,
    "lines.solid_capstyle": "round",
    "figure.constrained_layout.w_pad": 0.08,
    "figure.constrained_layout.h_pad": 0.08,
    "svg.hashsalt": "tensegrity",
    "pdf.fonttype": 42,  # letters as letters, which journals ask for
}
_SMALLEST = 2e-4  # of the tolerance: smaller errors are drawn here
_GRID = 361  # points of the joint space along each axis
_SLIVER = 1e-6  # of a region: smaller holes lie between two chords of one curve
_MOST_PATHS = 40  # failures drawn
_INK, _FAINT, _GOOD, _BAD = "#1e242c", "#6b7480", "#009e73", "#d55e00"

# Okabe and Ito's colours for colour-blind readers without their yellow, which white paper swallows; then some of Tol's.
_AGENTS = ("#d55e00", "#cc79a7", "#882255", "#aa4499")
_AREA = "#e6edf5"
_BASELINES = ("#0072b2", "#009e73", "#e69f00", "#56b4e9", "#999933", "#332288")
_DASHES: tuple[Any, ...] = ("solid", (0, (5, 1.6)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)), (0, (3, 1, 1, 1, 1, 1)))
_MARKERS = "osD^vPX*"


class Look(NamedTuple):
    """How a controller is drawn."""

    colour: str
    dashes: Any
    width: float
    marker: str

    @property
    def line(self) -> dict[str, Any]:
        """Keyword arguments of a line."""
        return {"color": self.colour, "linestyle": self.dashes, "linewidth": self.width}


@dataclass(frozen=True)
class Endings:
    """Where episodes began, aimed and ended, for `workspace`.

    Attributes:
        start: tips at the start, shape (n, 2) [m].
        target: shape (n, 2) [m].
        final: tips at the end, shape (n, 2) [m].
        success: shape (n,), boolean.
        paths: the tip's path of every episode, arrays of shape (k, 2) [m]; None draws a straight line instead.
    """

    start: np.ndarray
    target: np.ndarray
    final: np.ndarray
    success: np.ndarray
    paths: Sequence[np.ndarray] | None = None


_P = ParamSpec("_P")


def _styled(function: Callable[_P, Figure]) -> Callable[_P, Figure]:
    """Draw in the style of this module, and only here."""

    @wraps(function)
    def styled(*args: _P.args, **kwargs: _P.kwargs) -> Figure:
        with mpl.rc_context(_STYLE):
            return function(*args, **kwargs)

    return styled


def save(figure: Figure, stem: Path, title: str = "") -> Path:
    """Write a figure to `stem`.png (200 dots per inch), `stem`.svg and `stem`.pdf, the same bytes for the same figure.

    Args:
        figure: to write.
        stem: path without its ending.
        title: above the figure, and in the files; none is drawn if it is empty.

    Returns:
        The path of the PNG.
    """
    png, svg, pdf = (stem.with_name(f"{stem.name}.{ending}") for ending in ("png", "svg", "pdf"))
    with mpl.rc_context(_STYLE):
        if title:
            figure.suptitle(title.replace("$", r"\$"), fontsize=10.5)
        named = {"Title": title} if title else {}
        needed = figure.get_tightbbox()
        whole = Bbox.from_bounds(0, 0, *figure.get_size_inches())
        tight: Any = {"bbox_inches": Bbox.union([whole, needed])}  # nothing is cut off, however long a name is
        figure.savefig(png, dpi=200, **tight, metadata={"Software": None, **named})
        figure.savefig(svg, dpi=200, **tight, metadata={"Date": None, **named})
        figure.savefig(pdf, dpi=200, **tight, metadata={"CreationDate": None, **named})
    return png


def without_jumps(values: np.ndarray, ratio: float = 6.0) -> np.ndarray:
    """Samples of a function with NaN where it jumps, so that no line is drawn there.

    A jump is a step that is `ratio` times larger than both steps beside it, and larger than 2% of the range.
    """
    values = np.array(values, float)
    if np.isfinite(values).sum() < 4:
        return values
    step = np.abs(np.diff(values))
    beside = np.maximum(np.append(0.0, step[:-1]), np.append(step[1:], 0.0))
    beside = np.where(np.isfinite(beside), beside, 0.0)
    size = float(np.nanmax(values) - np.nanmin(values))
    jump = (step > ratio * beside) & (step > 0.02 * size)
    values[1:][jump] = np.nan
    return values


def looks(kinds: Mapping[str, str]) -> dict[str, Look]:
    """Colour, dashes and marker of every controller.

    Args:
        kinds: "agent", "baseline", "oracle" or "random" by name of the controller.
    """
    found: dict[str, Look] = {}
    counts = {"agent": 0, "baseline": 0}
    for i, (name, kind) in enumerate(kinds.items()):
        marker = _MARKERS[i % len(_MARKERS)]
        if kind == "oracle":
            found[name] = Look("#111111", (0, (1.2, 1.6)), 1.6, marker)
        elif kind == "random":
            found[name] = Look("#8b929b", (0, (4, 2)), 1.4, marker)
        else:
            colours = _AGENTS if kind == "agent" else _BASELINES
            k = counts["agent" if kind == "agent" else "baseline"]
            counts["agent" if kind == "agent" else "baseline"] += 1
            found[name] = Look(
                colours[k % len(colours)], _DASHES[k % len(_DASHES)], 2.4 if kind == "agent" else 1.8, marker
            )
    return found


def length_unit(tolerance: float) -> tuple[str, float]:
    """The unit in which errors are told where this is a good one, and how many there are in a metre."""
    if tolerance >= 0.02:
        return "m", 1.0
    return ("mm", 1e3) if tolerance >= 2e-5 else ("µm", 1e6)


def _figure(width: float, height: float, **kwargs: Any) -> Figure:
    figure = Figure(figsize=(width, height), layout="constrained", **kwargs)
    FigureCanvasAgg(figure)
    return figure


def _short(name: str, most: int = 24) -> str:
    """A name without mathematical mode, and shortened in its middle if it is long."""
    name = name if len(name) <= most else name[: most // 2 - 1] + "…" + name[-(most - most // 2) :]
    return name.replace("$", r"\$")


def _note(axes: Axes, text: str) -> None:
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=_FAINT)


def _legend(axes: Axes, handles: Sequence[Any] | None = None) -> None:
    """A legend to the right of the axes."""
    if handles is None:
        handles = axes.get_legend_handles_labels()[0]
    if handles:
        axes.legend(handles=list(handles), loc="upper left", bbox_to_anchor=(1.01, 1.02), borderaxespad=0.2)


@_styled
def success_bars(rows: list[Row]) -> Figure:
    """Success rates with their 95% intervals; those above 90% once more, magnified."""
    look = looks({row["controller"]: row["kind"] for row in rows})
    near = [row for row in rows if row["success"] >= 0.9]
    figure = _figure(7.2, 1.25 + 0.36 * max(len(rows), 2))
    widths = [1.0, 1.0] if near else [1.0]
    panels = list(np.atleast_1d(figure.subplots(1, len(widths), sharey=True, width_ratios=widths)))
    for i, row in enumerate(rows):
        colour = look[row["controller"]].colour
        panels[0].barh(i, 100 * row["success"], height=0.62, color=colour, alpha=0.85)
        for axes in panels:
            if axes is panels[0] or row in near:
                axes.plot([100 * row["success_low"], 100 * row["success_high"]], [i, i], color=_INK, linewidth=1.3)
        panels[0].text(103.5, i, success_text(row), va="center", fontsize=8.5)
    panels[0].set(xlim=(0, 100), xlabel="success [%]")
    panels[0].set_yticks(range(len(rows)), [_short(row["controller"]) for row in rows])
    panels[0].invert_yaxis()
    panels[0].grid(visible=False, axis="y")
    if near:
        zoomed = panels[1]
        for row in near:
            i = rows.index(row)
            chosen = look[row["controller"]]
            zoomed.plot(100 * row["success"], i, chosen.marker, color=chosen.colour, markersize=6, clip_on=False)
        low = min(100 * row["success_low"] for row in near)
        span = max(100 - low, 0.5)
        zoomed.set(xlim=(low - 0.12 * span, 100), xlabel="magnified, with 95% intervals [%]")
        zoomed.tick_params(left=False)
    else:
        panels[0].set_xlabel("success, with 95% intervals [%]")
    return figure


@_styled
def error_distribution(runs: list[Run], tolerance: float = 0.005) -> Figure:
    """Share of episodes that end within a distance of the target; `tolerance` [m] is marked."""
    figure = _figure(7.2, 3.5)
    axes = figure.subplots()
    groups = grouped(runs)
    look = looks({name: group[0].kind for name, group in groups.items()})
    unit, factor = length_unit(tolerance)
    if runs[0].error_unit != "mm":
        unit, factor = runs[0].error_unit, 1000.0
    floor = _SMALLEST * factor * tolerance
    floor = 10.0 ** math.floor(math.log10(floor))
    largest = 10 * factor * tolerance
    for name, group in groups.items():
        pooled = np.concatenate([run.columns["final_error_m"] for run in group])
        error = np.sort(np.maximum(factor * np.where(np.isnan(pooled), np.inf, pooled), floor))
        share = 100 * np.arange(1, len(error) + 1) / len(error)
        finite = np.isfinite(error)
        if finite.any():
            largest = max(largest, error[finite][-1])
        x = np.concatenate([[floor / 10], error[finite], [1e9 * floor]])
        y = np.concatenate([[0.0], share[finite], [share[finite][-1] if finite.any() else 0.0]])
        axes.step(x, y, where="post", label=_short(name), **look[name].line)
    axes.axvline(factor * tolerance, color=_INK, linewidth=1.0)
    axes.annotate(
        f"tolerance {factor * tolerance:.4g} {unit}",
        (factor * tolerance, 5),
        xytext=(4, 0),
        textcoords="offset points",
        rotation=90,
        va="bottom",
        fontsize=8,
    )
    axes.set_xscale("log")
    axes.set(xlim=(0.6 * floor, 1.3 * largest), ylim=(0, 101.5))
    axes.set(xlabel=f"final error [{unit}]", ylabel="episodes within that error [%]")
    ticks = [10.0**k for k in range(round(math.log10(floor)), math.ceil(math.log10(1.3 * largest)))]
    axes.set_xticks(ticks, [f"≤{t:g}" if t == ticks[0] else f"{t:g}" for t in ticks])
    _legend(axes)
    return figure


@_styled
def success_over_steps(runs: list[Run]) -> Figure:
    """Share of episodes that have been on the target by a step, like a performance profile over time."""
    figure = _figure(7.2, 3.5)
    axes = figure.subplots()
    groups = grouped(runs)
    look = looks({name: group[0].kind for name, group in groups.items()})
    last = max((float(np.max(run.columns["steps"])) for run in runs), default=1.0)
    for name, group in groups.items():
        reached = np.concatenate([run.columns["steps_to_target"] for run in group])
        found = np.sort(reached[~np.isnan(reached)])
        x = np.concatenate([[0.0], found, [last]])
        y = 100 * np.concatenate([np.arange(len(found) + 1), [len(found)]]) / len(reached)
        axes.step(x, y, where="post", label=_short(name), **look[name].line)
    axes.set(xlim=(0, max(last, 1)), ylim=(0, 101.5))
    axes.set(xlabel="step [-]", ylabel="episodes that have been on target [%]")
    _legend(axes)
    return figure


def _joint_grid(design: TwoXDesign, count: int = _GRID) -> tuple[TwoX, np.ndarray, np.ndarray, np.ndarray]:
    """Mechanism, joint angles (count, count), and the smaller margin there: positive inside the SWFJ."""
    mechanism = TwoX(design)
    limit = design.joint_limit * (1 - 1e-9)
    a1, a2 = np.meshgrid(*[np.linspace(-limit, limit, count)] * 2, indexing="ij")
    with np.errstate(all="ignore"):
        _, stability, wrench = mechanism.posture((a1.ravel(), a2.ravel()))
    margin = np.minimum(np.broadcast_to(stability, a1.size), np.broadcast_to(wrench, a1.size)).reshape(a1.shape)
    return mechanism, a1, a2, np.where(np.isfinite(margin), margin, -1.0)


@_styled
def joint_space(
    design: TwoXDesign,
    trajectories: Mapping[str, Sequence[np.ndarray]] | None = None,
    look: Mapping[str, Look] | None = None,
) -> Figure:
    """The stable wrench-feasible joint space of a 2-X design: margin, singular curves and trajectories.

    The margin is the smaller of stability and wrench margin at the stiffest feasible tensions.

    Args:
        design: the manipulator.
        trajectories: configurations [rad] by controller, one array of shape (k, 2) for each episode.
        look: of the controllers, see `looks`; by default all are baselines.
    """
    trajectories = trajectories or {}
    look = look or looks(dict.fromkeys(trajectories, "baseline"))
    mechanism, a1, a2, margin = _joint_grid(design)
    figure = _figure(6.6, 4.7)
    axes = figure.subplots()
    axes.set_facecolor("#dfe2e6")
    axes.grid(visible=False)
    handles: list[Any] = []
    highest = float(margin.max())
    if highest > 0:
        levels = MaxNLocator(9).tick_values(0, highest)
        shades = ListedColormap(np.linspace(to_rgb("#f3f8fd"), to_rgb("#8fb4da"), len(levels) - 1))
        filled = axes.contourf(a1, a2, margin, levels=levels, cmap=shades)
        axes.contour(a1, a2, margin, levels=[0], colors=[_INK], linewidths=0.9)
        bar = figure.colorbar(filled, cax=axes.inset_axes((1.05, 0.0, 0.04, 0.5)), format="%.3g")
        bar.set_label("margin [-]")
        bar.outline.set_linewidth(0.6)
    else:
        _note(axes, "no stable, wrench-feasible configuration")
    with np.errstate(all="ignore"):
        singular = np.asarray(mechanism.singularity((a1, a2)))
    if np.nanmin(singular) < 0 < np.nanmax(singular):
        axes.contour(a1, a2, singular, levels=[0], colors=["#7b3294"], linewidths=1.2, linestyles=[(0, (6, 2))])
        handles.append(
            Line2D([], [], color="#7b3294", linewidth=1.2, linestyle=(0, (6, 2)), label="singular, det J = 0")
        )
    for name, paths in trajectories.items():
        for path in paths:
            axes.plot(*np.asarray(path).T, **(look[name].line | {"linewidth": 1.2}), alpha=0.9)
            axes.plot(*path[0], "o", markersize=3.6, color="white", markeredgecolor=look[name].colour, zorder=4)
            axes.plot(*path[-1], look[name].marker, markersize=4.2, color=look[name].colour, zorder=4)
        if len(paths):
            handles.append(
                Line2D([], [], marker=look[name].marker, markersize=4.2, label=_short(name, 20), **look[name].line)
            )
    limit = design.joint_limit
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal")
    axes.set(xlabel=r"joint 1, $\alpha_1$ [rad]", ylabel=r"joint 2, $\alpha_2$ [rad]")
    _legend(axes, handles)
    return figure


def swfw(design: TwoXDesign) -> Callable[[Any], np.ndarray]:
    """Paints the stable wrench-feasible workspace of a 2-X within its joint limits, by its exact boundary."""
    return inside(stable_wrench_feasible_workspace(TwoX(design)).reachable)


def inside(region: Any) -> Callable[[Any], np.ndarray]:
    """Paints where the tip can be, a shapely geometry [m]."""

    def paint(axes: Any) -> np.ndarray:
        path = outline(region)
        if path is None:
            return np.zeros((2, 1))
        axes.add_patch(PathPatch(path, facecolor=_AREA, edgecolor="#9fb6cf", linewidth=0.7, zorder=0))
        return np.asarray(path.vertices).T

    return paint


def outline(geometry: Any) -> Outline | None:
    """A shapely geometry's polygons as one matplotlib path, holes included; None where there is none."""
    rings = []
    smallest = _SLIVER * shapely.area(geometry)
    for polygon in shapely.get_parts(geometry):
        if polygon.geom_type == "Polygon" and not polygon.is_empty:
            oriented = shapely.geometry.polygon.orient(polygon)
            holes = [hole for hole in oriented.interiors if shapely.Polygon(hole).area > smallest]
            rings += [np.asarray(ring.coords) for ring in (oriented.exterior, *holes)]
    if not rings:
        return None
    codes = [np.r_[Outline.MOVETO, np.full(len(r) - 2, Outline.LINETO), Outline.CLOSEPOLY] for r in rings]
    return Outline(np.concatenate(rings), np.concatenate(codes))


@_styled
def tip_paths(
    shade: Callable[[Any], np.ndarray],
    trajectories: Mapping[str, Sequence[np.ndarray]],
    targets: np.ndarray,
    look: Mapping[str, Look],
) -> Figure:
    """The tip's paths of several controllers in the same episodes.

    Args:
        shade: paints the workspace into the axes.
        trajectories: tip positions [m] by controller, one array of shape (k, 2) for each episode.
        targets: shape (episodes, 2) [m].
        look: of the controllers, see `looks`.
    """
    figure = _figure(6.9, 4.7)
    axes = figure.subplots()
    shade(axes)
    handles: list[Any] = []
    for name, paths in trajectories.items():
        for path in paths:
            axes.plot(*path.T, **(look[name].line | {"linewidth": 1.2}), alpha=0.9)
            axes.plot(*path[0], "o", markersize=3.6, color="white", markeredgecolor=look[name].colour, zorder=4)
            axes.plot(*path[-1], look[name].marker, markersize=4.2, color=look[name].colour, zorder=4)
        handles.append(
            Line2D([], [], marker=look[name].marker, markersize=4.2, label=_short(name, 20), **look[name].line)
        )
    handles += axes.plot(*targets.T, "x", markersize=7, color=_INK, label="target", zorder=5)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    _legend(axes, handles)
    return figure


@_styled
def tracking_errors(errors: Mapping[str, np.ndarray], tolerance: float, cycle: int, look: Mapping[str, Look]) -> Figure:
    """Distance from a moving goal over the steps: median of the episodes, and up to their 95th percentile.

    Args:
        errors: by controller, shape (steps, episodes) [m]; NaN where an episode has failed.
        tolerance: within which success is [m].
        cycle: steps of a cycle; where the next one begins is marked.
        look: of the controllers, see `looks`.
    """
    figure = _figure(7.2, 3.5)
    axes = figure.subplots()
    unit, factor = length_unit(tolerance)
    floor = _SMALLEST * factor * tolerance
    for name, table in errors.items():
        alive = np.where(np.isnan(table), np.inf, table)  # failed: no error is larger
        middle, most = (factor * np.quantile(alive, q, axis=1, method="nearest") for q in (0.5, 0.95))
        steps = np.arange(1, len(table) + 1)
        axes.plot(steps, np.maximum(middle, floor), label=_short(name), **look[name].line)
        axes.fill_between(
            steps,
            np.maximum(middle, floor),
            np.maximum(most, floor),
            color=look[name].colour,
            alpha=0.15,
            linewidth=0,
        )
    axes.axhline(factor * tolerance, color=_INK, linewidth=1.0)
    axes.axvline(cycle, color=_FAINT, linewidth=1.0, linestyle=(0, (4, 3)))
    axes.set(yscale="log", xlabel="step [-]", ylabel=f"distance from the moving goal [{unit}]")
    _legend(axes)
    return figure


@_styled
def scores(runs: list[Run], success: float = 1.0) -> Figure:
    """Share of episodes in which at least a score was reached; where success begins is marked."""
    figure = _figure(7.2, 3.5)
    axes = figure.subplots()
    groups = grouped(runs)
    look = looks({name: group[0].kind for name, group in groups.items()})
    for name, group in groups.items():
        reached = np.sort(np.concatenate([run.columns["score"] for run in group]))
        share = 100 * (1 - np.arange(len(reached)) / len(reached))
        x, y = np.concatenate([[0.0], reached]), np.concatenate([[100.0], share])
        axes.step(np.append(x, x[-1]), np.append(y, 0.0), where="pre", label=_short(name), **look[name].line)
    axes.axvline(success, color=_INK, linewidth=1.0)
    axes.set(ylim=(0, 101.5), xlabel="score: force held / critical load of the straight arm [-]")
    axes.set(xlim=(0, None), ylabel="episodes that reach it [%]")
    _legend(axes)
    return figure


@_styled
def workspace(shade: Callable[[Any], np.ndarray], episodes: Endings, title: str = "") -> Figure:
    """The workspace, the targets that were reached, and the tip's paths where they were not.

    Args:
        shade: paints the workspace into the axes, see `swfw` and `inside`.
        episodes: of one controller.
        title: its name, say.
    """
    figure = _figure(6.9, 4.7)
    axes = figure.subplots()
    area = shade(axes)
    success = np.asarray(episodes.success, bool)
    failed = np.flatnonzero(~success)
    target, start, final = (
        np.asarray(p, float).reshape(-1, 2) for p in (episodes.target, episodes.start, episodes.final)
    )
    if success.any():
        axes.plot(*target[success].T, ".", color=_GOOD, markersize=2.6, alpha=0.55, label=f"reached: {success.sum():,}")
    points = np.concatenate([target, start, final])
    drawn = failed[:_MOST_PATHS]
    for i in drawn:
        path = np.stack([start[i], final[i]]) if episodes.paths is None else np.asarray(episodes.paths[i], float)
        axes.plot(*path.T, color=_BAD, linewidth=0.9, alpha=0.75)
        axes.plot(*np.stack([final[i], target[i]]).T, color=_FAINT, linewidth=0.7, linestyle=(0, (2, 2)))
    if len(drawn):
        which = f"\n(paths of {_MOST_PATHS})" if len(failed) > _MOST_PATHS else ""
        axes.plot(*start[drawn].T, "o", markersize=3.6, color="white", markeredgecolor=_BAD, label="their start")
        axes.plot(*final[drawn].T, "s", markersize=3.4, color=_BAD, label="their end")
        axes.plot(*target[drawn].T, "x", markersize=6, color=_INK, label=f"not reached: {len(failed):,}{which}")
    axes.plot(0, 0, "^", markersize=7, color=_INK, label="base")
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title=_short(title, 60))
    shown = [np.concatenate([v, *points.T[k : k + 1], [0.0]]) for k, v in enumerate(area)]
    rims = [0.04 * max(float(np.ptp(values)), 1e-6) for values in shown]
    left, bottom = (float(values.min()) - rim for values, rim in zip(shown, rims, strict=True))
    right, top = (float(values.max()) + rim for values, rim in zip(shown, rims, strict=True))
    axes.set(xlim=(left, right), ylim=(bottom, top))
    handles, labels = axes.get_legend_handles_labels()
    order = sorted(range(len(labels)), key=lambda k: labels[k].startswith(("their", "base")))
    _legend(axes, [handles[k] for k in order])
    return figure


@_styled
def learning_curve(
    progress: Mapping[str, Sequence[float] | np.ndarray],
    evaluation: Mapping[str, Sequence[float] | np.ndarray] | None = None,
) -> Figure:
    """Success and return over the time spent: of training episodes, and of the agent without exploration noise.

    Args:
        progress: "seconds", "timesteps", "success" (fractions) and "return", sequences of equal length; "success" and
            "return" may be missing or hold NaN.
        evaluation: the same of the agent without noise, on validation episodes; None if it was not evaluated.
    """
    quiet = {key: np.asarray(values, float) for key, values in (evaluation or {}).items()}
    seconds = np.asarray(progress.get("seconds", ()), float)
    timesteps = np.asarray(progress.get("timesteps", ()), float)
    panels_of = [
        (key, label, scale, colour)
        for key, label, scale, colour in (
            ("success", "success [%]", 100.0, _AGENTS[0]),
            ("return", "return [-]", 1.0, _BASELINES[0]),
        )
        if any(np.isfinite(np.asarray(told.get(key, ()), float)).any() for told in (progress, quiet))
    ]
    figure = _figure(7.2, 1.0 + 1.7 * max(len(panels_of), 1))
    panels = list(np.atleast_1d(figure.subplots(max(len(panels_of), 1), 1, sharex=True)))
    for axes, (key, label, scale, colour) in zip(panels, panels_of, strict=False):
        if key in progress:
            values = scale * np.asarray(progress[key], float)
            marker = "o" if len(seconds) < 40 else ""
            axes.plot(seconds, values, color=colour, linewidth=1.8, marker=marker, markersize=3, label="in training")
        if key in quiet:
            style = {"color": _INK, "linewidth": 1.2, "linestyle": "--", "marker": "s", "markersize": 3}
            axes.plot(quiet["seconds"], scale * quiet[key], label="without noise, validation", **style)
        axes.set_ylabel(label)
        if key == "success":
            axes.set_ylim(0, 102)
    if quiet and panels_of:
        handles, _ = panels[0].get_legend_handles_labels()
        _legend(panels[0], handles)
    if not panels_of:
        _note(panels[0], "no episode ended during training")
    panels[-1].set_xlabel("time spent training [s]")
    last = max([float(np.max(times)) for times in (seconds, quiet.get("seconds", ())) if len(times)], default=0.0)
    if last:
        panels[0].set_xlim(0, last)
    rising = (
        len(seconds) > 1 and all(b > a for a, b in pairwise(seconds)) and all(b > a for a, b in pairwise(timesteps))
    )
    if rising and len(seconds) == len(timesteps):
        scale = timesteps[-1] / seconds[-1] / 1e6
        top = panels[0].secondary_xaxis("top", functions=(lambda s: s * scale, lambda t: t / scale))
        top.set_xlabel("environment steps [million]")
        top.spines["top"].set_visible(True)
    return figure
