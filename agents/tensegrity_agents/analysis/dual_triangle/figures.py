"""Figures of the dual-triangle arm, after those of [Zhao2021], for any design; and what the paper leaves out: loads.

Every function takes a mechanism and returns a `matplotlib.figure.Figure`; see `reporting.style`.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from tensegrity_agents.reporting.style import FAINT, INK, new_figure, note, styled, without_jumps
from tensegrity_envs.geometry.dual_triangle_fields import STEEP, Field, beyond, maximum, region_of, room, stiffness
from tensegrity_envs.mechanics.dual_triangle import DualTriangle, DualTriangleDesign
from tensegrity_envs.mechanics.dual_triangle.redundancy import Objective

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00")
_BLUES = LinearSegmentedColormap.from_list("pale blues", ["#eef4fa", "#7fa8d1"])
_FINE, _COARSE = 301, 181  # columns of the grids of workspaces, and of those whose measure takes long
_MOST = 1e6  # [k b], of a critical push
_OBJECTIVES: dict[Objective, str] = {"sum": "(a) sum", "max": "(b) largest", "squares": "(c) squares"}


def _symmetric(arm: DualTriangle) -> tuple[float, float, float, float]:
    """Half width, height, stiffness and free length, of a symmetric design."""
    d = arm.design
    return float(d.a1), float(d.b1), float(d.k1), float(d.free_length1)


@styled
def torque_curves(arm: DualTriangle) -> Figure:
    """Torque over angle for several nominal free lengths and no control input [Zhao2021, figure 2], with equilibria."""
    a, b, k, nominal = _symmetric(arm)
    figure = new_figure(7.2, 3.6)
    panels = figure.subplots(1, 2, sharey=True)
    flat = 0.5 * b  # a design that can be bistable, beside the given one
    for axes, half_width in zip(panels, (a, flat), strict=True):
        scale = k * b * b
        threshold = max(2 * b * (1 - (half_width / b) ** 2), 0.0)
        lengths = sorted({nominal, 0.6 * b, 1.0 * b, 1.3 * b, 1.6 * b})
        for colour, length in zip(_COLOURS, lengths, strict=False):
            segment = DualTriangle(DualTriangleDesign.symmetric(half_width, b, k, length), 1).segment
            limit = float(segment.design.joint_limit)
            q = np.linspace(-limit, limit, 400)
            pair = segment.free_lengths(0.0)
            axes.plot(q, np.asarray(segment.torque(q, pair)) / scale, color=colour, label=f"$L_0/b$ = {length / b:.3g}")
            for found in segment.equilibria(pair):
                face = colour if found.is_stable else "white"
                axes.plot(found.configuration[0], 0.0, "o", markersize=4.5, color=face, markeredgecolor=colour)
        axes.axhline(0, color=INK, linewidth=0.8)
        axes.set_title(f"a/b = {half_width / b:.3g}; monotone for L0/b > {threshold / b:.3g}")
        axes.set_xlabel("q [rad]")
    panels[0].set_ylabel("torque of the springs, M / (k b²) [-]")
    handles = [
        *panels[0].get_legend_handles_labels()[0],
        Line2D([], [], linestyle="", marker="o", color=INK, label="stable"),
        Line2D([], [], linestyle="", marker="o", color="white", markeredgecolor=INK, label="unstable"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=6)
    return figure


@styled
def control_and_sensitivity(arms: Sequence[tuple[str, DualTriangle]]) -> Figure:
    """Control input and sensitivity over the desired angle [Zhao2021, figure 3], and the limits of the free lengths."""
    figure = new_figure(7.2, 3.4)
    panels = figure.subplots(1, 2)
    for colour, (name, arm) in zip(_COLOURS, arms, strict=False):
        _, b, _, nominal = _symmetric(arm)
        segment, limit = arm.segment, float(arm.design.joint_limit)
        q = np.linspace(-limit, limit, 400)
        delta = np.asarray(segment.control(q)) / b
        inside = np.abs(delta) <= nominal / b + 1e-12
        for axes, values in zip(panels, (delta, np.asarray(segment.sensitivity(q)) / b), strict=True):
            axes.plot(q, np.where(inside, values, np.nan), color=colour, label=name)
            axes.plot(q, np.where(inside, np.nan, values), color=colour, linestyle=(0, (2, 2)), linewidth=1.0)
    panels[0].set(xlabel="desired angle q [rad]", ylabel="control input Δ / b [-]")
    panels[1].set(xlabel="desired angle q [rad]", ylabel="sensitivity dΔ/dq / b [-]", ylim=(0, None))
    for axes in panels:
        axes.axvline(0, color=FAINT, linewidth=0.6)
    handles = panels[0].get_legend_handles_labels()[0]
    handles.append(Line2D([], [], color=INK, linestyle=(0, (2, 2)), linewidth=1.0, label="a free length is negative"))
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


def draw_arm(axes: Axes, arm: DualTriangle, q: Sequence[float], colour: str, label: str | None = None) -> None:
    """The triangles of an arm, filled lightly, and its springs."""
    nodes = arm.nodes(tuple(map(float, q)))
    for i in range(1, arm.segments + 1):
        for corners in (("A", "B"), ("D", "C")):
            outline = np.array([nodes[f"{corners[0]}{i}"], nodes[f"{corners[1]}{i}"], nodes[f"O{i}"]])
            axes.fill(*outline.T, facecolor=colour, alpha=0.18, edgecolor=colour, linewidth=1.2)
        for ends in ("AD", "BC"):
            axes.plot(*np.array([nodes[f"{ends[0]}{i}"], nodes[f"{ends[1]}{i}"]]).T, color=colour, linewidth=0.6)
    axes.plot(*nodes["P"], "o", markersize=4, color=colour, label=label)


@styled
def redundancy(arm: DualTriangle, targets: Sequence[tuple[float, float]]) -> Figure:
    """Postures that the three objectives choose for the same targets [Zhao2021, figure 5], from the paper's start."""
    start = (-0.1, 0.1, 0.1)
    figure = new_figure(7.4, 4.2 * math.ceil(len(targets) / 2))
    panels = np.atleast_1d(figure.subplots(math.ceil(len(targets) / 2), 2, sharex=True, sharey=True)).ravel()
    _, b, _, _ = _symmetric(arm)
    for axes, target in zip(panels, targets, strict=False):
        for colour, (name, label) in zip(_COLOURS, _OBJECTIVES.items(), strict=False):
            found = arm.redundancy(*target, start, name)
            if found.is_reachable:
                text = ", ".join(f"{angle:.2f}" for angle in found.configuration)
                draw_arm(axes, arm, found.configuration, colour, f"{label}: {text}")
        axes.plot(*target, "x", color=INK, markersize=7)
        axes.set(aspect="equal", title=f"target ({target[0] / b:.3g} b, {target[1] / b:.3g} b)")
        axes.legend(title="angles [rad]", loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=1, fontsize=7.5)
        axes.set(xlabel="x [m]", ylabel="y [m]")
        axes.tick_params(labelbottom=True, labelleft=True)
    for axes in panels[len(targets) :]:
        axes.axis("off")
    return figure


@styled
def control_over_targets(arms: Sequence[tuple[str, DualTriangle]]) -> Figure:
    """Control inputs along lines of targets x = const [Zhao2021, figure 6], for each design, by objective (c)."""
    figure = new_figure(7.4, 2.5 * len(arms))
    panels = figure.subplots(len(arms), 3, sharex=True, squeeze=False)
    for row, (name, arm) in zip(panels, arms, strict=True):
        _, b, _, nominal = _symmetric(arm)
        y = np.linspace(-3.0, 3.0, 721) * b
        for colour, x in zip(_COLOURS, (4.5, 5.0, 5.5), strict=False):
            found = arm.redundancy(np.full(y.shape, x * b), y, (-0.1, 0.1, 0.1), "squares")
            delta = np.array(arm.control(found.configuration)) / b
            held = np.asarray(found.is_reachable) & (np.abs(delta).max(axis=0) <= nominal / b)
            for axes, values in zip(row, delta, strict=True):
                shown = without_jumps(np.where(held, values, np.nan))
                axes.plot(y / b, shown, color=colour, label=f"x = {x:g} b", linewidth=1.2)
        for i, axes in enumerate(row):
            axes.set_title(f"{name}, segment {i + 1}", fontsize=9)
            axes.set_ylabel(rf"$\Delta_{i + 1}$ / b [-]")
    for axes in panels[-1]:
        axes.set_xlabel("target y / b [-]")
    figure.legend(handles=panels[0][0].get_legend_handles_labels()[0], loc="outside lower center", ncols=3)
    return figure


@styled
def buckling(arm: DualTriangle) -> Figure:
    """Straight and buckled equilibria over an axial push: tip deflection and smallest stiffness."""
    _, b, k, _ = _symmetric(arm)
    figure = new_figure(7.4, 3.5)
    panels = figure.subplots(1, 2)
    critical = [float(load) for load in arm.straight_critical_loads()]
    most = 3 * critical[0]
    straight = np.linspace(0, most, 200)
    zeros = (np.zeros(1),) * arm.segments
    lengths = arm.free_lengths((0.0,) * arm.segments)
    margin = np.array([float(arm.stability_margin(zeros, lengths, (-p, 0.0))[0]) for p in straight])
    panels[1].plot(straight / (k * b), margin, color=INK, label="straight")
    for ok, style in ((margin > 0, "-"), (margin <= 0, (0, (3, 2)))):
        panels[0].plot(straight[ok] / (k * b), 0 * straight[ok], color=INK, linestyle=style)
    for mode, colour in zip(range(1, 3), _COLOURS, strict=False):
        if critical[mode - 1] > most:
            continue
        for side in (1, -1):
            branch = arm.buckled_branch(mode, side, max_load=most)
            y = np.array([arm.tip(tuple(q))[1] for q in np.asarray(branch.configuration)])
            load = np.asarray(branch.load) / (k * b)
            stable = np.asarray(branch.is_stable)
            panels[0].plot(load, np.where(stable, y, np.nan) / b, color=colour)
            panels[0].plot(load, np.where(stable, np.nan, y) / b, color=colour, linestyle=(0, (3, 2)))
            if side == 1:
                panels[1].plot(load, branch.stability_margin, color=colour, label=f"buckled, mode {mode}")
            if branch.reason:
                panels[0].plot(load[-1], y[-1] / b, "s", color=colour, markersize=4)
    imperfect = tuple(float(arm.segment.control(0.05)) for _ in range(arm.segments))
    start = arm.equilibrium(arm.free_lengths(imperfect), (0.05,) * arm.segments)
    bent = arm.load_branch(arm.free_lengths(imperfect), (-1.0, 0.0), start.configuration, max_load=most)
    y = np.array([arm.tip(tuple(q))[1] for q in np.asarray(bent.configuration)])
    load = np.asarray(bent.load) / (k * b)
    panels[0].plot(load, y / b, color=_COLOURS[2], linewidth=1.1)
    panels[1].plot(load, bent.stability_margin, color=_COLOURS[2], label="bent by 0.05 rad per joint", linewidth=1.1)
    for axes in panels:
        axes.axvline(critical[0] / (k * b), color=FAINT, linewidth=0.8, linestyle=(0, (1, 2)))
        axes.set_xlabel("push / (k b) [-]")
    panels[0].set_ylabel("tip deflection y / b [-]")
    panels[1].set(ylabel="smallest stiffness / (k b²) [-]")
    panels[1].axhline(0, color=INK, linewidth=0.6)
    handles = panels[1].get_legend_handles_labels()[0]
    handles += [
        Line2D([], [], color=INK, linestyle=(0, (3, 2)), label="unstable"),
        Line2D([], [], color=FAINT, linestyle=(0, (1, 2)), label="critical push"),
        Line2D([], [], color=INK, linestyle="", marker="s", markersize=4, label="an angle reaches its limit"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


def _filled(axes: Axes, field: Field, values: np.ndarray, **colours: Any) -> Any:
    """Filled contours of values inside the field's boundary, which is drawn, and is where the measure is zero."""
    inside = field.value > 0
    drawn = axes.contourf(field.x, field.y, beyond(values, inside), **colours)
    if inside.any():
        edge = axes.contour(field.x, field.y, field.value, levels=[0.0], colors=[INK], linewidths=0.9)
        drawn.set_clip_path(edge.get_paths()[0], transform=axes.transData)
    else:
        drawn.set_visible(False)
        note(axes, "nothing can be held")
    axes.set(aspect="equal", xlabel="x / b [-]")
    axes.grid(visible=False)
    return drawn


@styled
def workspace(arm: DualTriangle) -> Figure:
    """Where the tip can be without a load: how far the best posture is from its limits, and the arm in three places."""
    _, b, _, _ = _symmetric(arm)
    field = maximum(arm, room(arm), _FINE)
    figure = new_figure(6.4, 4.8)
    axes = figure.subplots()
    levels = MaxNLocator(9).tick_values(0, field.value.max())
    image = _filled(axes, field, field.value, levels=levels, cmap=_BLUES)
    small = DualTriangle(replace(arm.design, a1=arm.design.a1 / b, a2=arm.design.a2 / b, b1=1.0, b2=1.0), arm.segments)
    limit = float(arm.segment.control_limit)
    for colour, q in zip(_COLOURS[1:], ((0.0,) * 3, (0.75 * limit,) * 3, (-limit, -limit, 0.5 * limit)), strict=False):
        draw_arm(axes, small, q, colour)
    axes.set(ylabel="y / b [-]", xlim=(field.x[0], field.x[-1]))
    figure.colorbar(image, ax=axes, shrink=0.8, label="smallest free length / b, angle to its limit / rad [-]")
    return figure


@styled
def loaded_workspace(arm: DualTriangle, multiples: Sequence[float] = (0.0, 0.75, 1.0, 1.5)) -> Figure:
    """Where the tip can be held stably, within all limits, under axial pushes: the best stiffness of the postures."""
    critical = float(arm.straight_critical_loads()[0])
    figure = new_figure(9.0, 3.0)
    panels = figure.subplots(1, len(multiples), sharex=True, sharey=True)
    fields = [maximum(arm, stiffness(arm, (-multiple * critical, 0.0)), _FINE) for multiple in multiples]
    levels = MaxNLocator(11).tick_values(0, max(float(field.value.max()) for field in fields))
    for axes, multiple, field in zip(panels, multiples, fields, strict=True):
        image = _filled(axes, field, field.value, levels=levels, cmap="viridis")
        axes.set_title(f"push {multiple:g} $P_1$" if multiple else "no load")
    panels[0].set_ylabel("y / b [-]")
    figure.colorbar(image, ax=list(panels), shrink=0.8, format="%.2g", label="best smallest\nstiffness / (k b²) [-]")
    return figure


@styled
def critical_load_map(arm: DualTriangle) -> Figure:
    """The axial push at which a tip position can no longer be held, with the best and with the worst posture there."""
    _, b, k, _ = _symmetric(arm)
    limit, inside = float(arm.design.joint_limit), room(arm)

    def push(q: tuple[np.ndarray, ...]) -> np.ndarray:
        found = arm.critical_load(tuple(np.clip(qi, -limit, limit) for qi in q), (-1.0, 0.0))
        return np.minimum(np.asarray(found) / (k * b), _MOST)

    best = maximum(arm, lambda q: np.minimum(push(q), STEEP * inside(q)), _COARSE)
    worst = maximum(arm, lambda q: np.minimum(1e3 * inside(q), 0.0) - push(q), _COARSE)
    allowed = best.value > 0
    highest = np.where(allowed, push(tuple(np.nan_to_num(best.best))), np.nan)
    lowest = np.where(allowed, np.minimum(-worst.value, highest), np.nan)  # thin ends of curves may be missed
    top = float(np.nanpercentile(highest, 95))
    low = max(float(np.nanmin(lowest)), top / 100)
    levels = np.geomspace(low, top, 15)
    figure = new_figure(8.6, 3.6)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, values, title in zip(panels, (highest, lowest), ("best posture", "worst posture"), strict=True):
        image = _filled(
            axes,
            best,
            np.clip(values, low, 2 * top),
            levels=levels,
            cmap="cividis",
            norm=LogNorm(low, top),
            extend="max",
        )
        axes.set_title(title)
    panels[0].set_ylabel("y / b [-]")
    ticks = [t for t in (m * 10.0**e for e in range(-5, 4) for m in (1, 2, 5)) if low <= t <= top]
    bar = figure.colorbar(image, ax=list(panels), shrink=0.8, label="critical push / (k b) [-]")
    bar.set_ticks(ticks, labels=[f"{t:g}" for t in ticks])
    bar.minorticks_off()
    return figure


def numbers(arm: DualTriangle) -> dict[str, Any]:
    """The numbers of the table."""
    a, b, k, nominal = _symmetric(arm)
    segment = arm.segment
    loads = [float(load) for load in arm.straight_critical_loads()]
    table: dict[str, Any] = {
        "a / b": a / b,
        "L0 / b": nominal / b,
        "monotone torque, condition (2)": bool(segment.is_monotone()),
        "joint limit [rad]": float(arm.design.joint_limit),
        "angle at the largest control input [rad]": float(segment.control_limit),
    }
    for m, load in enumerate(loads, 1):
        table[f"critical push of the straight arm, mode {m} [k b]"] = load / (k * b)
        table[f"critical push of the straight arm, mode {m} [N]"] = load
    branch = arm.buckled_branch(1, 1, max_load=20 * loads[0])
    table["workspace without a load [m2]"] = region_of(maximum(arm, room(arm), _FINE), b).area
    table["push at the end of the buckled branch [k b]"] = float(branch.load[-1]) / (k * b)
    table["why it ends"] = branch.reason
    return table
