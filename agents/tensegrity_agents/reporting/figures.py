"""Figures of results: success, errors, scores and learning curves."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from tensegrity_agents.evaluation.results import Run
from tensegrity_agents.reporting.style import (
    AGENTS,
    BASELINES,
    FAINT,
    INK,
    Look,
    legend,
    length_unit,
    looks,
    new_figure,
    note,
    short,
    styled,
)
from tensegrity_agents.reporting.table import Row, grouped, success_text

_SMALLEST = 2e-4  # of the tolerance: smaller errors are drawn here


@styled
def success_bars(rows: list[Row]) -> Figure:
    """Success rates with their 95% intervals; those above 90% once more, magnified."""
    look = looks({row["controller"]: row["kind"] for row in rows})
    near = [row for row in rows if row["success"] >= 0.9]
    figure = new_figure(7.2, 1.25 + 0.36 * max(len(rows), 2))
    widths = [1.0, 1.0] if near else [1.0]
    panels = list(np.atleast_1d(figure.subplots(1, len(widths), sharey=True, width_ratios=widths)))
    for i, row in enumerate(rows):
        colour = look[row["controller"]].colour
        panels[0].barh(i, 100 * row["success"], height=0.62, color=colour, alpha=0.85)
        for axes in panels:
            if axes is panels[0] or row in near:
                axes.plot([100 * row["success_low"], 100 * row["success_high"]], [i, i], color=INK, linewidth=1.3)
        panels[0].text(103.5, i, success_text(row), va="center", fontsize=8.5)
    panels[0].set(xlim=(0, 100), xlabel="success [%]")
    panels[0].set_yticks(range(len(rows)), [short(row["controller"]) for row in rows])
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


@styled
def error_distribution(runs: list[Run], tolerance: float = 0.005) -> Figure:
    """Share of episodes that end within a distance of the target; `tolerance` [m] is marked."""
    figure = new_figure(7.2, 3.5)
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
        axes.step(x, y, where="post", label=short(name), **look[name].line)
    axes.axvline(factor * tolerance, color=INK, linewidth=1.0)
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
    legend(axes)
    return figure


@styled
def success_over_steps(runs: list[Run]) -> Figure:
    """Share of episodes that have been on the target by a step, like a performance profile over time."""
    figure = new_figure(7.2, 3.5)
    axes = figure.subplots()
    groups = grouped(runs)
    look = looks({name: group[0].kind for name, group in groups.items()})
    last = max((float(np.max(run.columns["steps"])) for run in runs), default=1.0)
    for name, group in groups.items():
        reached = np.concatenate([run.columns["steps_to_target"] for run in group])
        found = np.sort(reached[~np.isnan(reached)])
        x = np.concatenate([[0.0], found, [last]])
        y = 100 * np.concatenate([np.arange(len(found) + 1), [len(found)]]) / len(reached)
        axes.step(x, y, where="post", label=short(name), **look[name].line)
    axes.set(xlim=(0, max(last, 1)), ylim=(0, 101.5))
    axes.set(xlabel="step [-]", ylabel="episodes that have been on target [%]")
    legend(axes)
    return figure


@styled
def tracking_errors(errors: Mapping[str, np.ndarray], tolerance: float, cycle: int, look: Mapping[str, Look]) -> Figure:
    """Distance from a moving goal over the steps: median of the episodes, and up to their 95th percentile.

    Args:
        errors: by controller, shape (steps, episodes) [m]; NaN where an episode has failed.
        tolerance: within which success is [m].
        cycle: steps of a cycle; where the next one begins is marked.
        look: of the controllers, see `looks`.
    """
    figure = new_figure(7.2, 3.5)
    axes = figure.subplots()
    unit, factor = length_unit(tolerance)
    floor = _SMALLEST * factor * tolerance
    for name, table in errors.items():
        alive = np.where(np.isnan(table), np.inf, table)  # failed: no error is larger
        middle, most = (factor * np.quantile(alive, q, axis=1, method="nearest") for q in (0.5, 0.95))
        steps = np.arange(1, len(table) + 1)
        axes.plot(steps, np.maximum(middle, floor), label=short(name), **look[name].line)
        axes.fill_between(
            steps,
            np.maximum(middle, floor),
            np.maximum(most, floor),
            color=look[name].colour,
            alpha=0.15,
            linewidth=0,
        )
    axes.axhline(factor * tolerance, color=INK, linewidth=1.0)
    axes.axvline(cycle, color=FAINT, linewidth=1.0, linestyle=(0, (4, 3)))
    axes.set(yscale="log", xlabel="step [-]", ylabel=f"distance from the moving goal [{unit}]")
    legend(axes)
    return figure


@styled
def scores(runs: list[Run], success: float = 1.0) -> Figure:
    """Share of episodes in which at least a score was reached; where success begins is marked."""
    figure = new_figure(7.2, 3.5)
    axes = figure.subplots()
    groups = grouped(runs)
    look = looks({name: group[0].kind for name, group in groups.items()})
    for name, group in groups.items():
        reached = np.sort(np.concatenate([run.columns["score"] for run in group]))
        share = 100 * (1 - np.arange(len(reached)) / len(reached))
        x, y = np.concatenate([[0.0], reached]), np.concatenate([[100.0], share])
        axes.step(np.append(x, x[-1]), np.append(y, 0.0), where="pre", label=short(name), **look[name].line)
    axes.axvline(success, color=INK, linewidth=1.0)
    axes.set(ylim=(0, 101.5), xlabel="score: force held / critical load of the straight arm [-]")
    axes.set(xlim=(0, None), ylabel="episodes that reach it [%]")
    legend(axes)
    return figure


@styled
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
            ("success", "success [%]", 100.0, AGENTS[0]),
            ("return", "return [-]", 1.0, BASELINES[0]),
        )
        if any(np.isfinite(np.asarray(curve.get(key, ()), float)).any() for curve in (progress, quiet))
    ]
    figure = new_figure(7.2, 1.0 + 1.7 * max(len(panels_of), 1))
    panels = list(np.atleast_1d(figure.subplots(max(len(panels_of), 1), 1, sharex=True)))
    for axes, (key, label, scale, colour) in zip(panels, panels_of, strict=False):
        if key in progress:
            values = scale * np.asarray(progress[key], float)
            marker = "o" if len(seconds) < 40 else ""
            axes.plot(seconds, values, color=colour, linewidth=1.8, marker=marker, markersize=3, label="in training")
        if key in quiet:
            style = {"color": INK, "linewidth": 1.2, "linestyle": "--", "marker": "s", "markersize": 3}
            axes.plot(quiet["seconds"], scale * quiet[key], label="without noise, validation", **style)
        axes.set_ylabel(label)
        if key == "success":
            axes.set_ylim(0, 102)
    if quiet and panels_of:
        handles, _ = panels[0].get_legend_handles_labels()
        legend(panels[0], handles)
    if not panels_of:
        note(panels[0], "no episode ended during training")
    panels[-1].set_xlabel("time spent training [s]")
    last = max([float(np.max(times)) for times in (seconds, quiet.get("seconds", ())) if len(times)], default=0.0)
    if last:
        panels[0].set_xlim(0, last)
    rising = (
        len(seconds) > 1 and all(b > a for a, b in pairwise(seconds)) and all(b > a for a, b in pairwise(timesteps))
    )
    if rising and len(seconds) == len(timesteps):
        # Not every step takes as long: a teacher's are slower than those of PPO.
        when, done = (np.concatenate([[0.0], values, [2 * values[-1]]]) for values in (seconds, timesteps / 1e6))
        top = panels[0].secondary_xaxis(
            "top", functions=(lambda s: np.interp(s, when, done), lambda t: np.interp(t, done, when))
        )
        top.set_xlabel("environment steps [million]")
        top.spines["top"].set_visible(True)
    return figure
