"""Who wins where: all ids by all controllers, of the records that a campaign has left."""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from tensegrity_agents.evaluation.records import Record
from tensegrity_agents.evaluation.statistics import (
    Estimate,
    probability_of_improvement,
    stratified_bootstrap,
    success_rate,
)
from tensegrity_agents.reporting.table import percent, steps_text

AGENT = "agent"  # the column of all agents, whatever their method
_NONE = "\N{EN DASH}"


_CORRECTED = re.compile(r"(?:the plan of|what) (\w+)(?: says, a controller with feedback)?, which it corrects")


class Cell(NamedTuple):
    """One controller on one id.

    Attributes:
        name: of the controller.
        kind: "agent", "baseline", "oracle" or "random".
        flags: success, (runs, episodes).
        success: mean over runs and episodes, with its interval: Wilson for one run, else bootstrap over both.
        steps: median to the target; of several runs the median of theirs; NaN if never.
        knows: what it is told beside observations.
        settling: of reaching in dynamics, median time after which the tip stays on target, of the episodes in which it
            does [s]; of several runs the median of theirs; NaN if never.
    """

    name: str
    kind: str
    flags: np.ndarray
    success: Estimate
    steps: float
    knows: str
    settling: float = math.nan

    @property
    def episodes(self) -> int:
        """How many were measured, the first ones."""
        return int(self.flags.shape[1])

    @property
    def time_text(self) -> str:
        """Time to settle, else steps to the target."""
        return steps_text(self.steps) if math.isnan(self.settling) else f"{self.settling:.2f} s"

    @property
    def corrects(self) -> str:
        """Which controller the agent corrects, "" if it acts by itself; `TrainedPolicy.knows` says so."""
        found = _CORRECTED.search(self.knows)
        return found[1] if found else ""

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
    return success_rate(flags)[0]


def cells_of(records: Sequence[Record], level: str = "") -> dict[str, Cell]:
    """The cells of an id by controller, agents first.

    Args:
        records: all of one id.
        level: of uncertainty, as in `Record.successes`; records without it are left out.

    Raises:
        ValueError: some agents have fewer episodes than others.
    """
    groups: dict[str, list[Record]] = {}
    for record in sorted(records, key=lambda one: (one.kind != AGENT, -1 if one.seed is None else one.seed)):
        if level in record.successes:
            groups.setdefault(AGENT if record.kind == AGENT else record.controller, []).append(record)
    if len({record.episodes for record in groups.get(AGENT, [])}) > 1:
        raise ValueError(f"{records[0].env}: agents on different numbers of episodes; measure them again")
    cells = {}
    for name, group in groups.items():
        flags = np.stack([record.flags(level) for record in group])
        steps = [record.steps_to_target for record in group if record.steps_to_target is not None]
        median = float(np.median(steps)) if steps else math.nan
        times = [_median(record.settling_times(level)) for record in group]
        settled = float(np.median(times)) if not any(map(math.isnan, times)) else math.nan
        cells[name] = Cell(name, group[0].kind, flags, mean_success(flags), median, group[0].knows, settled)
    return cells


def _median(times: np.ndarray | None) -> float:
    """Of those that are finite."""
    times = np.empty(0) if times is None else times[np.isfinite(times)]
    return float(np.median(times)) if len(times) else math.nan


def ahead(agents: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Paired differences of scores: of the agents, (runs, episodes), to those of a controller, (episodes,).

    Some controllers have gone through the first episodes only; these count.
    """
    count = min(agents.shape[1], len(other))
    return np.asarray(agents[:, :count].astype(float) - other[:count])


def best_controller(cells: Mapping[str, Cell]) -> Cell | None:
    """The analytic controller of the highest success among those that are told nothing hidden: the one that the agents
    are least ahead of, which is the same where all have gone through the same episodes.
    """
    found = [cell for cell in cells.values() if cell.kind == "baseline"]
    agent = cells.get(AGENT)

    def strength(cell: Cell) -> tuple[float, float]:
        by = -cell.success.point if agent is None else float(ahead(agent.flags, cell.flags[0]).mean())
        return -by, -cell.steps

    return max(found, key=strength, default=None)


def lead(cells: Mapping[str, Cell]) -> Estimate | None:
    """By how much the agents are ahead of the best controller: the paired difference, with its 95% interval."""
    agent, best = cells.get(AGENT), best_controller(cells)
    if agent is None or best is None:
        return None
    return stratified_bootstrap(ahead(agent.flags, best.flags[0]))


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
        "told more [%] | difference [points] | wins | P(improvement) | steps to target, or time to settle: "
        "agents, best |",
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
                "episodes": cell.episodes,
                "steps_median": cell.steps,
                "settling_time_median": cell.settling,
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
        chance = probability_of_improvement(agent.flags[:, : best.episodes], best.flags)
        better = f"{chance.point:.3f} [{chance.low:.3f}, {chance.high:.3f}]"
    return [
        _short(env_id),
        _NONE if agent is None else agent.text + (f"; corrects {_escaped(agent.corrects)}" if agent.corrects else ""),
        _NONE if agent is None else str(len(agent.flags)),
        _NONE if agent is None else percent(agent.worst),
        _NONE if best is None else f"{_escaped(best.name)}: {best.text}{_shortened(best, cells)}",
        _NONE if told is None else told.text,
        _NONE if by is None else f"{100 * by.point:+.1f} [{100 * by.low:+.1f}, {100 * by.high:+.1f}]",
        verdict_of(cells),
        better,
        _times(agent, best),
    ]


def _times(*cells: Cell | None) -> str:
    """Times to settle, or steps to the target where one of them was measured before times to settle were."""
    there = [cell for cell in cells if cell is not None]
    in_steps = any(math.isnan(cell.settling) for cell in there)
    texts = {cell.name: steps_text(cell.steps) if in_steps else cell.time_text for cell in there}
    return ", ".join(_NONE if cell is None else texts[cell.name] for cell in cells)


def _shortened(cell: Cell, cells: Mapping[str, Cell]) -> str:
    """Of a controller with fewer episodes than others: how many."""
    return "" if is_whole(cell, cells) else f" on the first {cell.episodes} episodes"


def is_whole(cell: Cell, cells: Mapping[str, Cell]) -> bool:
    """Whether no controller of the id has gone through more episodes."""
    return cell.episodes == max(one.episodes for one in cells.values())


def _short(env_id: str) -> str:
    return f"`{env_id.rpartition('/')[2]}`"


def _escaped(text: str) -> str:
    return text.replace("|", "\\|").replace("_", "\\_")
