"""Who wins where: all ids by all controllers, of the records that a campaign has left."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tensegrity_agents.evaluation.records import Record
from tensegrity_agents.evaluation.statistics import (
    Estimate,
    probability_of_improvement,
    stratified_bootstrap,
    wilson_interval,
)
from tensegrity_agents.reporting.style import AGENTS, legend, looks, new_figure, note, styled
from tensegrity_agents.reporting.table import percent, steps_text

AGENT = "agent"  # the column of all agents, whatever their method
_NONE = "\N{EN DASH}"


class Cell(NamedTuple):
    """One controller on one id.

    Attributes:
        name: of the controller.
        kind: "agent", "baseline", "oracle" or "random".
        flags: success, (runs, episodes).
        success: mean over runs and episodes, with its interval: Wilson for one run, else bootstrap over both.
        steps: median to the target; of several runs the median of theirs; NaN if never.
        knows: what it is told beside observations.
    """

    name: str
    kind: str
    flags: np.ndarray
    success: Estimate
    steps: float
    knows: str

    @property
    def worst(self) -> float:
        """Success of the worst run."""
        return float(self.flags.mean(axis=1).min())

    @property
    def text(self) -> str:
        """Success with its interval, in per cent."""
        return f"{percent(self.success.point)} [{percent(self.success.low)}, {percent(self.success.high)}]"


def mean_success(flags: np.ndarray) -> Estimate:
    """Mean over runs and episodes with its 95% interval.

    Args:
        flags: success, (runs, episodes).
    """
    if len(flags) == 1:
        return Estimate(float(flags.mean()), *wilson_interval(int(flags.sum()), flags.size))
    return stratified_bootstrap(flags, lambda values: float(np.mean(values)))


def cells_of(records: Sequence[Record], level: str = "") -> dict[str, Cell]:
    """The cells of an id by controller, agents first.

    Args:
        records: all of one id.
        level: of uncertainty, as in `Record.successes`; records without it are left out.

    Raises:
        ValueError: some runs have fewer episodes than others.
    """
    groups: dict[str, list[Record]] = {}
    for record in sorted(records, key=lambda one: (one.kind != AGENT, -1 if one.seed is None else one.seed)):
        if level in record.successes:
            groups.setdefault(AGENT if record.kind == AGENT else record.controller, []).append(record)
    if len({record.episodes for group in groups.values() for record in group}) > 1:
        raise ValueError(f"{records[0].env}: records of different numbers of episodes; measure them again")
    cells = {}
    for name, group in groups.items():
        flags = np.stack([record.flags(level) for record in group])
        steps = [record.steps_to_target for record in group if record.steps_to_target is not None]
        median = float(np.median(steps)) if steps else math.nan
        cells[name] = Cell(name, group[0].kind, flags, mean_success(flags), median, group[0].knows)
    return cells


def best_controller(cells: Mapping[str, Cell]) -> Cell | None:
    """The analytic controller of the highest success among those that are told nothing hidden."""
    found = [cell for cell in cells.values() if cell.kind == "baseline"]
    return max(found, key=lambda cell: (cell.success.point, -cell.steps), default=None)


def lead(cells: Mapping[str, Cell]) -> Estimate | None:
    """By how much the agents are ahead of the best controller: the paired difference, with its 95% interval."""
    agent, best = cells.get(AGENT), best_controller(cells)
    if agent is None or best is None:
        return None
    difference = agent.flags.astype(float) - best.flags[:1].astype(float)
    return stratified_bootstrap(difference, lambda values: float(np.mean(values)))


def verdict_of(cells: Mapping[str, Cell]) -> str:
    """Who wins: "agent" where the interval of the paired difference is above 0 and the worst run is no worse than the
    best controller, "controller" where it is below 0, else "level"; with a dash where one of them is missing.
    """
    by, best = lead(cells), best_controller(cells)
    if by is None or best is None:
        return _NONE
    if by.high < 0:
        return "controller"
    return "agent" if by.low > 0 and cells[AGENT].worst >= best.success.point else "level"


def matrix_to_markdown(records: Mapping[str, Sequence[Record]]) -> str:
    """The table of all ids, and what each controller knows."""
    lines = [
        "| environment | agents, mean over seeds [%] | seeds | worst seed [%] | best analytic controller [%] | "
        "told more [%] | difference [points] | wins | P(improvement) | steps to target: agents, best |",
        "|---|---:|---:|---:|---|---:|---:|---|---:|---:|",
    ]
    knowing: dict[tuple[str, str], list[str]] = {}
    for env_id, group in records.items():
        cells = cells_of(group)
        for cell in cells.values():
            if cell.knows:
                knowing.setdefault((cell.name, cell.knows), []).append(env_id)
        lines.append("| " + " | ".join(_line(env_id, cells)) + " |")
    lines += ["", "| controller | what it knows | environments |", "|---|---|---|"]
    for (name, knows), ids in sorted(knowing.items()):
        lines.append(f"| {_escaped(name)} | {_escaped(knows)} | {', '.join(_short(env_id) for env_id in ids)} |")
    return "\n".join(lines) + "\n"


def matrix_rows(records: Mapping[str, Sequence[Record]]) -> list[dict[str, Any]]:
    """The same for machines: for every id, all its controllers, who wins and by how much (shares, not per cent)."""
    rows = []
    for env_id, group in records.items():
        cells = cells_of(group)
        controllers = [
            {
                "controller": cell.name,
                "kind": cell.kind,
                "success": cell.success,
                "training_runs": len(cell.flags) if cell.kind == AGENT else 0,
                "worst_run": cell.worst,
                "episodes": cell.flags.shape[1],
                "steps_median": cell.steps,
                "knows": cell.knows,
            }
            for cell in cells.values()
        ]
        rows.append({"id": env_id, "wins": verdict_of(cells), "difference": lead(cells), "controllers": controllers})
    return rows


def _line(env_id: str, cells: Mapping[str, Cell]) -> list[str]:
    agent, best, by = cells.get(AGENT), best_controller(cells), lead(cells)
    told = max((cell for cell in cells.values() if cell.kind == "oracle"), key=lambda c: c.success.point, default=None)
    better = _NONE
    if agent is not None and best is not None:
        chance = probability_of_improvement(agent.flags, best.flags)
        better = f"{chance.point:.3f} [{chance.low:.3f}, {chance.high:.3f}]"
    return [
        _short(env_id),
        _NONE if agent is None else agent.text,
        _NONE if agent is None else str(len(agent.flags)),
        _NONE if agent is None else percent(agent.worst),
        _NONE if best is None else f"{_escaped(best.name)}: {best.text}",
        _NONE if told is None else told.text,
        _NONE if by is None else f"{100 * by.point:+.1f} [{100 * by.low:+.1f}, {100 * by.high:+.1f}]",
        verdict_of(cells),
        better,
        ", ".join(_NONE if cell is None else steps_text(cell.steps) for cell in (agent, best)),
    ]


def _short(env_id: str) -> str:
    return f"`{env_id.rpartition('/')[2]}`"


def _escaped(text: str) -> str:
    return text.replace("|", "\\|").replace("_", "\\_")


@styled
def matrix_figure(records: Mapping[str, Sequence[Record]]) -> Figure:
    """Success of every controller on every id; a frame is around the best one that is told nothing hidden."""
    table = {env_id: cells_of(group) for env_id, group in records.items()}
    kinds = {cell.name: cell.kind for cells in table.values() for cell in cells.values()}
    order = {AGENT: 0, "baseline": 1, "oracle": 2, "random": 3}
    names = sorted(kinds, key=lambda name: order.get(kinds[name], 1))
    figure = new_figure(2.6 + 0.62 * max(len(names), 3), 1.5 + 0.3 * max(len(table), 2))
    axes = figure.subplots()
    if not table:
        note(axes, "no records")
        return figure
    shown = np.full((len(table), len(names)), np.nan)
    for i, cells in enumerate(table.values()):
        for name, cell in cells.items():
            shown[i, names.index(name)] = 100 * cell.success.point
            dark = cell.success.point > 0.6
            axes.text(
                names.index(name), i, percent(cell.success.point), ha="center", va="center", fontsize=7.5,
                color="white" if dark else "black",
            )  # fmt: skip
        fair = [cell for cell in cells.values() if cell.kind in (AGENT, "baseline")]
        for cell in fair:
            if cell.success.point == max(one.success.point for one in fair):
                outline = {"fill": False, "edgecolor": AGENTS[0], "linewidth": 1.8}
                axes.add_patch(_square(names.index(cell.name), i, outline))
    axes.imshow(shown, cmap="Blues", vmin=0, vmax=110, aspect="auto")
    axes.set_xticks(range(len(names)), [name.replace("_", " ") for name in names], rotation=40, ha="right")
    axes.set_yticks(range(len(table)), [env_id.rpartition("/")[2] for env_id in table])
    axes.grid(visible=False)
    axes.set_xlabel("success [%] on the test episodes; framed: the best without hidden knowledge; blank: not there")
    return figure


def _square(x: int, y: int, style: Mapping[str, object]) -> Rectangle:
    return Rectangle((x - 0.47, y - 0.47), 0.94, 0.94, **style)  # type: ignore[arg-type]


@styled
def uncertainty_figure(records: Mapping[str, Sequence[Record]]) -> Figure:
    """Success against the level of uncertainty, one panel for each id that was measured at several."""
    found = {env_id: group for env_id, group in records.items() if any(len(one.successes) > 1 for one in group)}
    figure = new_figure(max(3.2 * len(found), 4.0) + 1.8, 3.2)
    if not found:
        note(figure.subplots(), "no records at several levels")
        return figure
    panels = np.atleast_1d(figure.subplots(1, len(found), sharey=True))
    kinds = {(AGENT if one.kind == AGENT else one.controller): one.kind for group in found.values() for one in group}
    look = looks(kinds)
    for axes, (env_id, group) in zip(panels, found.items(), strict=True):
        levels = sorted({level for one in group for level in one.successes if level})
        for name in kinds:
            line = [(int(level), cells[name].success) for level in levels if name in (cells := cells_of(group, level))]
            if line:
                x, success = zip(*line, strict=True)
                chosen, y = look[name], 100 * np.array([one.point for one in success])
                axes.plot(x, y, marker=chosen.marker, markersize=4, label=name.replace("_", " "), **chosen.line)
                low, high = (100 * np.array([getattr(one, end) for one in success]) for end in ("low", "high"))
                axes.fill_between(x, low, high, color=chosen.colour, alpha=0.15, linewidth=0)
        axes.set_title(env_id.rpartition("/")[2])
        axes.set(xlabel="level of uncertainty", ylim=(-2, 102), xticks=[int(level) for level in levels])
    panels[0].set_ylabel("success [%]")
    legend(panels[-1], list({h.get_label(): h for p in panels for h in p.get_legend_handles_labels()[0]}.values()))
    return figure
