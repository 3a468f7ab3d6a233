"""Figures of paths: in the joint space, of the tip, and where the targets were that were reached or missed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.ticker import MaxNLocator
from shapely.geometry.base import BaseGeometry

from tensegrity_agents.reporting.style import (
    AREA,
    BAD,
    FAINT,
    GOOD,
    INK,
    Look,
    legend,
    looks,
    new_figure,
    note,
    outline,
    short,
    styled,
)
from tensegrity_envs.geometry.workspace import stable_wrench_feasible_workspace
from tensegrity_envs.mechanics.two_x import TwoX, TwoXDesign

_GRID = 361  # points of the joint space along each axis
_MOST_PATHS = 40  # failures drawn


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


def _joint_grid(design: TwoXDesign, count: int = _GRID) -> tuple[TwoX, np.ndarray, np.ndarray, np.ndarray]:
    """Mechanism, joint angles (count, count), and the smaller margin there: positive inside the SWFJ."""
    mechanism = TwoX(design)
    limit = design.joint_limit * (1 - 1e-9)
    a1, a2 = np.meshgrid(*[np.linspace(-limit, limit, count)] * 2, indexing="ij")
    with np.errstate(all="ignore"):
        _, stability, wrench = mechanism.posture((a1.ravel(), a2.ravel()))
    margin = np.minimum(np.broadcast_to(stability, a1.size), np.broadcast_to(wrench, a1.size)).reshape(a1.shape)
    return mechanism, a1, a2, np.where(np.isfinite(margin), margin, -1.0)


@styled
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
    figure = new_figure(6.6, 4.7)
    axes = figure.subplots()
    axes.set_facecolor("#dfe2e6")
    axes.grid(visible=False)
    handles: list[Any] = []
    highest = float(margin.max())
    if highest > 0:
        levels = MaxNLocator(9).tick_values(0, highest)
        shades = ListedColormap(np.linspace(to_rgb("#f3f8fd"), to_rgb("#8fb4da"), len(levels) - 1))
        filled = axes.contourf(a1, a2, margin, levels=levels, cmap=shades)
        axes.contour(a1, a2, margin, levels=[0], colors=[INK], linewidths=0.9)
        bar = figure.colorbar(filled, cax=axes.inset_axes((1.05, 0.0, 0.04, 0.5)), format="%.3g")
        bar.set_label("margin [-]")
        bar.outline.set_linewidth(0.6)
    else:
        note(axes, "no stable, wrench-feasible configuration")
    with np.errstate(all="ignore"):
        singular = np.asarray(mechanism.jacobian_determinant((a1, a2)))
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
                Line2D([], [], marker=look[name].marker, markersize=4.2, label=short(name, 20), **look[name].line)
            )
    limit = design.joint_limit
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal")
    axes.set(xlabel=r"joint 1, $\alpha_1$ [rad]", ylabel=r"joint 2, $\alpha_2$ [rad]")
    legend(axes, handles)
    return figure


def swfw(design: TwoXDesign) -> Callable[[Any], np.ndarray]:
    """Paints the stable wrench-feasible workspace of a 2-X within its joint limits, by its exact boundary."""
    return inside(stable_wrench_feasible_workspace(TwoX(design)).reachable)


def inside(region: BaseGeometry) -> Callable[[Any], np.ndarray]:
    """Paints where the tip can be, a shapely geometry [m]."""

    def paint(axes: Axes) -> np.ndarray:
        path = outline(region)
        if path is None:
            return np.zeros((2, 1))
        axes.add_patch(PathPatch(path, facecolor=AREA, edgecolor="#9fb6cf", linewidth=0.7, zorder=0))
        return np.asarray(path.vertices).T

    return paint


@styled
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
    figure = new_figure(6.9, 4.7)
    axes = figure.subplots()
    shade(axes)
    handles: list[Any] = []
    for name, paths in trajectories.items():
        for path in paths:
            axes.plot(*path.T, **(look[name].line | {"linewidth": 1.2}), alpha=0.9)
            axes.plot(*path[0], "o", markersize=3.6, color="white", markeredgecolor=look[name].colour, zorder=4)
            axes.plot(*path[-1], look[name].marker, markersize=4.2, color=look[name].colour, zorder=4)
        handles.append(
            Line2D([], [], marker=look[name].marker, markersize=4.2, label=short(name, 20), **look[name].line)
        )
    handles += axes.plot(*targets.T, "x", markersize=7, color=INK, label="target", zorder=5)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    legend(axes, handles)
    return figure


@styled
def workspace(shade: Callable[[Any], np.ndarray], episodes: Endings, title: str = "") -> Figure:
    """The workspace, the targets that were reached, and the tip's paths where they were not.

    Args:
        shade: paints the workspace into the axes, see `swfw` and `inside`.
        episodes: of one controller.
        title: its name, say.
    """
    figure = new_figure(6.9, 4.7)
    axes = figure.subplots()
    area = shade(axes)
    success = np.asarray(episodes.success, bool)
    failed = np.flatnonzero(~success)
    target, start, final = (
        np.asarray(p, float).reshape(-1, 2) for p in (episodes.target, episodes.start, episodes.final)
    )
    if success.any():
        axes.plot(*target[success].T, ".", color=GOOD, markersize=2.6, alpha=0.55, label=f"reached: {success.sum():,}")
    points = np.concatenate([target, start, final])
    drawn = failed[:_MOST_PATHS]
    for i in drawn:
        path = np.stack([start[i], final[i]]) if episodes.paths is None else np.asarray(episodes.paths[i], float)
        axes.plot(*path.T, color=BAD, linewidth=0.9, alpha=0.75)
        axes.plot(*np.stack([final[i], target[i]]).T, color=FAINT, linewidth=0.7, linestyle=(0, (2, 2)))
    if len(drawn):
        which = f"\n(paths of {_MOST_PATHS})" if len(failed) > _MOST_PATHS else ""
        axes.plot(*start[drawn].T, "o", markersize=3.6, color="white", markeredgecolor=BAD, label="their start")
        axes.plot(*final[drawn].T, "s", markersize=3.4, color=BAD, label="their end")
        axes.plot(*target[drawn].T, "x", markersize=6, color=INK, label=f"not reached: {len(failed):,}{which}")
    axes.plot(0, 0, "^", markersize=7, color=INK, label="base")
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title=short(title, 60))
    shown = [np.concatenate([v, *points.T[k : k + 1], [0.0]]) for k, v in enumerate(area)]
    rims = [0.04 * max(float(np.ptp(values)), 1e-6) for values in shown]
    left, bottom = (float(values.min()) - rim for values, rim in zip(shown, rims, strict=True))
    right, top = (float(values.max()) + rim for values, rim in zip(shown, rims, strict=True))
    axes.set(xlim=(left, right), ylim=(bottom, top))
    handles, labels = axes.get_legend_handles_labels()
    order = sorted(range(len(labels)), key=lambda k: labels[k].startswith(("their", "base")))
    legend(axes, [handles[k] for k in order])
    return figure
