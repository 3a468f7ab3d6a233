"""The comparison as numbers and as words: one row for every controller, a table, and who wins."""

import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from tensegrity_agents.evaluation.results import Run
from tensegrity_agents.evaluation.statistics import (
    Estimate,
    normalized_score,
    probability_of_improvement,
    stratified_bootstrap,
    success_rate,
)

Row = dict[str, Any]

_LARGE = 3.0  # [m], the reach from which on errors are given in metres
_NONE = "\N{EN DASH}"


def grouped(runs: list[Run]) -> dict[str, list[Run]]:
    """Runs by controller, in the order in which the controllers first appear.

    Raises:
        ValueError: a controller's runs differ in kind or in their episodes.
    """
    groups: dict[str, list[Run]] = {}
    for run in runs:
        groups.setdefault(run.controller, []).append(run)
    for name, group in groups.items():
        if any(run.kind != group[0].kind for run in group):
            raise ValueError(f"{name}: runs of different kinds, {sorted({run.kind for run in group})}")
        if not all(np.array_equal(run.seeds, group[0].seeds) for run in group) or not len(group[0].seeds):
            raise ValueError(f"{name}: its runs must all be on the same episodes, at least one")
    return groups


def summary_rows(runs: list[Run], reach: float | None = None) -> list[Row]:
    """One row for every controller; several trained runs of one controller are one row.

    Shares and rates are fractions, errors are in mm, `error_unit` is the one in which they are shown. Keys:
        controller, kind, notes; episodes; training_runs (0 where nothing was trained), label ("1 training run", ...);
        success, success_low, success_high with interval ("Wilson", or "bootstrap" over runs and episodes, success then
        being the mean over runs and episodes), success_runs (each run's), success_ever, normalized (success with
        random = 0 and oracle = 1, NaN where unknown);
        score, score_low, score_high (mean over runs and episodes, bootstrap interval; NaN where the task has none);
        error_median_mm, error_p95_mm, and with `reach` error_median_share, error_p95_share of it;
        settling_median, settling_p90 (of the time after which the tip stays on target [s], over all episodes, infinite
        where it does not; NaN where the task does not ask for it);
        steps_median (to the target, of the episodes that got there; NaN if none), ended_early (share of the episodes),
        reasons (the same share by reason, the most frequent first);
        unstable, infeasible (share of all steps); stability_margin_p5, wrench_margin_p5 (5th percentile, over episodes,
        of the smallest margin in the episode); effort; microseconds (per action);
        agent_better: probability of improvement of the best agent over this controller, an Estimate or None.

    Args:
        runs: all on the same episodes.
        reach: of the manipulator [m].

    Raises:
        ValueError: see `grouped`.
    """
    groups = grouped(runs)
    rows = [_row(group, reach) for group in groups.values()]
    by_kind = {kind: [row for row in rows if row["kind"] == kind] for kind in ("random", "oracle")}
    random, oracle = (found[0]["success"] if found else math.nan for found in by_kind.values())
    agent = best_agent(rows)
    for row in rows:
        row["normalized"] = normalized_score(row["success"], random, oracle)
        row["agent_better"] = None
        if agent is not None and row["kind"] != "agent":
            ours, theirs = groups[agent["controller"]], groups[row["controller"]]
            if np.array_equal(ours[0].seeds, theirs[0].seeds):
                row["agent_better"] = probability_of_improvement(_successes(ours), _successes(theirs))
    return rows


def _successes(group: list[Run]) -> np.ndarray:
    return np.stack([run.columns["success"] for run in group])


def _row(group: list[Run], reach: float | None) -> Row:
    first = group[0]
    episodes = len(first.seeds)
    successes = _successes(group)
    success, interval = success_rate(successes)

    def column(name: str) -> np.ndarray:
        return np.concatenate([run.columns[name] for run in group])

    error = 1000 * np.where(np.isnan(column("final_error_m")), np.inf, column("final_error_m"))
    median, p95 = float(np.median(error)), float(np.percentile(error, 95, method="higher"))
    reached, steps = column("steps_to_target"), column("steps")
    reached = reached[~np.isnan(reached)]
    settling = column("settling_time_s")
    training_runs = len(group) if first.kind == "agent" or first.training_seed is not None else 0
    ended = Counter(reason for run in group for reason in run.reasons if reason)
    scores = np.stack([run.columns["score"] for run in group])
    score = Estimate(math.nan, math.nan, math.nan)
    if np.isfinite(scores).all():
        score = stratified_bootstrap(scores)
    row = {
        "controller": first.controller,
        "kind": first.kind,
        "error_unit": "m" if first.error_unit == "mm" and (reach or 0.0) >= _LARGE else first.error_unit,
        "notes": first.notes,
        "episodes": episodes,
        "training_runs": training_runs,
        "label": f"{training_runs} training run{'s' if training_runs > 1 else ''}" if training_runs else "",
        "success": success.point,
        "success_low": success.low,
        "success_high": success.high,
        "interval": interval,
        "success_runs": successes.mean(axis=1).tolist(),
        "score": score.point,
        "score_low": score.low,
        "score_high": score.high,
        "success_ever": float(column("success_ever").mean()),
        "error_median_mm": median,
        "error_p95_mm": p95,
        "steps_median": float(np.median(reached)) if len(reached) else math.nan,
        "settling_median": float(np.percentile(settling, 50, method="higher")),
        "settling_p90": float(np.percentile(settling, 90, method="higher")),
        "ended_early": ended.total() / (len(group) * episodes),
        "reasons": {reason: count / (len(group) * episodes) for reason, count in ended.most_common()},
        "effort": float(np.mean(column("effort"))),
        "microseconds": float(np.mean([run.microseconds_per_action for run in group])),
    }
    for name in ("unstable", "infeasible"):
        row[name] = float(np.sum(column(f"{name}_share") * steps) / max(np.sum(steps), 1))
    for name in ("stability_margin", "wrench_margin"):
        row[f"{name}_p5"] = float(np.percentile(column(f"min_{name}"), 5, method="lower"))
    if reach is not None:
        row["error_median_share"], row["error_p95_share"] = median / 1000 / reach, p95 / 1000 / reach
    return row


def best_agent(rows: list[Row]) -> Row | None:
    """The agent with the highest success rate, if there is an agent."""
    return _best([row for row in rows if row["kind"] == "agent"])


def best_baseline(rows: list[Row]) -> Row | None:
    """The baseline with the highest success rate, of equals the quicker one, of equally quick ones the first; oracles
    and random policies are none.
    """
    return _best([row for row in rows if row["kind"] not in ("agent", "oracle", "random")])


_EXACT = 0.01  # mm: a smaller error is none


def _best(rows: list[Row]) -> Row | None:
    def rank(row: Row) -> tuple[float, ...]:
        steps, score = row["steps_median"], row.get("score", math.nan)
        return (
            row["success"],
            0.0 if math.isnan(score) else score,
            -(math.inf if math.isnan(steps) else steps),
            -max(row["error_p95_mm"], _EXACT),
        )

    return max(rows, key=rank, default=None)


# ------------------------------------------------------------------------------------------------------- formatting


def percent(share: float, unit: str = "") -> str:
    """A share in per cent with one decimal; 100 and 0 only where it is exactly that. A dash for NaN."""
    if math.isnan(share):
        return _NONE
    if share in (0.0, 1.0):
        return f"{100 * share:.0f}{unit}"
    text = f"{100 * share:.1f}"
    return {"100.0": ">99.9", "0.0": "<0.1"}.get(text, text) + unit


def success_text(row: Row, unit: str = "") -> str:
    """Success rate with its interval, "98.1 [97.1, 98.8]" in per cent."""
    return f"{percent(row['success'], unit)} [{percent(row['success_low'])}, {percent(row['success_high'])}]"


def millimetres(value: float) -> str:
    """A length in mm with about three digits, at best to 0.01 mm."""
    if not math.isfinite(value):
        return _NONE if math.isnan(value) else "∞"
    if value < 0.01:
        return "<0.01"
    return f"{value:.{0 if value >= 100 else 1 if value >= 10 else 2}f}"


def error_text(row: Row, name: str) -> str:
    """An error of a row in the row's unit, about three digits: thousandths, or metres for arms as large as a room."""
    value = float(row[name])
    if row["error_unit"] != "m" or not math.isfinite(value):
        return millimetres(value)
    metres = value / 1000
    if metres < 1e-5:
        return "<0.00001"
    return f"{metres:.{min(5, max(0, 2 - math.floor(math.log10(metres))))}f}"


def plain(value: float, digits: int = 2) -> str:
    """A number with fixed decimals, or a dash for NaN."""
    return _NONE if math.isnan(value) else f"{value:.{digits}f}"


def microseconds(value: float) -> str:
    """A time in microseconds, three digits."""
    return _NONE if math.isnan(value) else f"{value:.{0 if value >= 100 else 1 if value >= 10 else 2}f}"


def score_text(row: Row) -> str:
    """Mean score with its interval, "1.52 [1.49, 1.55]"."""
    if math.isnan(row["score"]):
        return _NONE
    return f"{row['score']:.2f} [{row['score_low']:.2f}, {row['score_high']:.2f}]"


def seconds(value: float) -> str:
    """A settling time [s], infinite where the tip does not stay on target, or a dash where nobody asks for it."""
    return _NONE if math.isnan(value) else "\N{INFINITY}" if math.isinf(value) else f"{value:.2f}"


def steps_text(value: float) -> str:
    """A median number of steps, or a dash where the target was never reached."""
    return _NONE if math.isnan(value) else f"{value:g}"


def print_table(rows: list[Row], console: Console) -> None:
    """Print the rows as a table of at most 100 columns, agents and the best baseline highlighted and named as such.

    A console narrower than that gets the table without the shares of steps and the effort, which summary.md has.
    """
    narrow = console.width < 98
    episodes = max((row["episodes"] for row in rows), default=0)
    with_score = any(not math.isnan(row["score"]) for row in rows)
    settles = any(not math.isnan(row["settling_median"]) for row in rows)
    explained = "ever: on target at any step. steps: median of the episodes that got there."
    if settles:
        explained = "ever: settled at any step. since: median time after which the tip stays on target."
    if with_score:
        explained = "score: largest force held, in critical loads of the straight arm."
    table = Table(
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
        caption=f"{episodes:,} episodes. {explained} unstable, infeasible: share of all steps.",
        caption_justify="left",
    )
    table.add_column("controller", overflow="fold", max_width=22, min_width=15)
    headers = (
        "success [%]\n95% interval",
        "score\n95% interval",
        "ever\n[%]",
        f"error [{rows[0]['error_unit'] if rows else 'mm'}]\nmedian",
        "\n95th",
        "since\n[s]" if settles else "steps\n",
        "unstab.\n[%]",
        "infeas.\n[%]",
        "effort\n[-]",
        "µs per\naction",
    )
    # A score takes the place of the error and the steps to the target.
    left_out = ({2, 3, 4, 5} if with_score else {1}) | ({6, 7, 8} if narrow else set())
    shown = [i for i in range(len(headers)) if i not in left_out]
    for i in shown:
        table.add_column(Text(headers[i]), justify="right", no_wrap=True)
    best = best_baseline(rows)
    for row in rows:
        name = Text(row["controller"])
        remark = row["label"] or ("best baseline" if row is best else "")
        if remark:
            name.append(f"\n{remark}", style="not bold dim")
        cells = (
            success_text(row),
            score_text(row),
            percent(row["success_ever"]),
            error_text(row, "error_median_mm"),
            error_text(row, "error_p95_mm"),
            seconds(row["settling_median"]) if settles else steps_text(row["steps_median"]),
            percent(row["unstable"]),
            percent(row["infeasible"]),
            plain(row["effort"]),
            microseconds(row["microseconds"]),
        )
        style = "bold cyan" if row["kind"] == "agent" else "green" if row is best else ""
        table.add_row(name, *(cells[i] for i in shown), style=style)
    console.print(table)
    if ended := [f"{row['controller']}: {shares_text(row['reasons'])}" for row in rows if row["reasons"]]:
        console.print(Text(f"Episodes that ended early. {'; '.join(ended)}.", style="dim"))


def shares_text(reasons: Mapping[str, float]) -> str:
    """Why episodes ended early, "joint limit 2.0 %, buckled 0.3 %"."""
    return ", ".join(f"{reason} {percent(share, ' %')}" for reason, share in reasons.items())


def to_markdown(rows: list[Row]) -> str:
    """The rows as a Markdown table, agents in bold."""
    with_reach = all("error_p95_share" in row for row in rows)
    with_score = any(not math.isnan(row["score"]) for row in rows)
    settles = any(not math.isnan(row["settling_median"]) for row in rows)
    header = [
        "controller",
        "success [%], 95% interval",
        *(["score, 95% interval"] if with_score else []),
        "ever [%]",
        f"final error [{rows[0]['error_unit'] if rows else 'mm'}] median",
        "95th percentile",
    ]
    header += ["95th percentile [% of reach]"] if with_reach else []
    header += ["settling time [s] median", "90th percentile"] if settles else []
    header += ["steps to target", "unstable steps [%]", "infeasible steps [%]", "stability margin, 5th percentile"]
    header += ["wrench margin, 5th percentile", "effort", "µs per action"]
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" + "---:|" * (len(header) - 1)]
    for row in rows:
        name = row["controller"].replace("\\", "\\\\").replace("|", "\\|").replace("*", "\\*").replace("_", "\\_")
        name = f"**{name}**" if row["kind"] == "agent" else name
        cells = [f"{name} ({row['label']})" if row["label"] else name, success_text(row)]
        cells += [score_text(row)] if with_score else []
        cells += [percent(row["success_ever"])]
        cells += [error_text(row, "error_median_mm"), error_text(row, "error_p95_mm")]
        cells += [percent(row["error_p95_share"])] if with_reach else []
        cells += [seconds(row["settling_median"]), seconds(row["settling_p90"])] if settles else []
        cells += [steps_text(row["steps_median"]), percent(row["unstable"]), percent(row["infeasible"])]
        cells += [plain(row["stability_margin_p5"]), plain(row["wrench_margin_p5"]), plain(row["effort"])]
        lines.append("| " + " | ".join([*cells, microseconds(row["microseconds"])]) + " |")
    return "\n".join(lines) + "\n"


def verdict(rows: list[Row]) -> str:
    """Who wins, by how much, and whether the intervals overlap, in one or two sentences."""
    if not rows:
        return "Nothing was evaluated."
    if all(row["success"] == 0 for row in rows):
        return f"No controller ended on the target in any of the {max(row['episodes'] for row in rows):,} episodes."
    agent = best_agent(rows)
    if agent is None:
        ranked = sorted(rows, key=lambda row: -row["success"])
        if len(ranked) == 1:
            return f"{_named(ranked[0])} ended on the target."
        relation, by = _compare(ranked[0], ranked[1])
        return f"{_named(ranked[0])} {relation} {_named(ranked[1])}{by}."
    baseline = best_baseline(rows)
    others = [(baseline, "the best baseline, ")] if baseline else []
    others += [
        (row, "the oracle, " if row["controller"] != "oracle" else "the ") for row in rows if row["kind"] == "oracle"
    ]
    if not others:
        others = [(row, "the random policy, ") for row in rows if row["kind"] == "random"]
    name = agent["controller"]
    subject = _named(agent, "The " if "agent" in name.lower() else "The agent ")
    if not others:
        return f"{subject} had no other controller to be compared with."
    sentences = []
    for i, (other, title) in enumerate(others):
        relation, by = _compare(agent, other)
        odd = other["kind"] == "oracle" and relation == "beats"
        caution = " Since the oracle knows more, look for an error in the simulator first." if odd else ""
        sentences.append(f"{'It' if i else subject} {relation} {_named(other, title)}{by}.{caution}")
    return " ".join(sentences)


def _named(row: Row, title: str = "") -> str:
    basis = ""
    if row["training_runs"]:
        basis = ", one training run" if row["training_runs"] == 1 else f", {row['label']}"
    return f"{title}{row['controller']} ({success_text(row, '%')}{basis})"


def _compare(ours: Row, theirs: Row) -> tuple[str, str]:
    """How ours stands to theirs, and by how much: by the score where there is one, else by the success rate."""
    scores = [row.get("score", math.nan) for row in (ours, theirs)]
    if not any(math.isnan(score) for score in scores):
        lead = scores[0] - scores[1]
        if round(lead, 2) == 0:
            return "is level with", f" in score ({scores[0]:.2f})"
        by = f", by {abs(lead):.2f} in score ({scores[0]:.2f} against {scores[1]:.2f})"
        overlap = ours["score_low"] <= theirs["score_high"] and theirs["score_low"] <= ours["score_high"]
        if overlap:
            return ("is ahead of" if lead > 0 else "is behind"), f"{by}; the 95% intervals overlap"
        return ("beats" if lead > 0 else "loses to"), f"{by}; the 95% intervals do not overlap"
    points = 100 * (ours["success"] - theirs["success"])
    if points == 0:
        return "is level with", ""
    size = f"{abs(points):.1f}" if abs(points) >= 0.05 else "less than 0.1"
    by = f", by {size} percentage point{'' if size == '1.0' else 's'}"
    if ours["success_low"] <= theirs["success_high"] and theirs["success_low"] <= ours["success_high"]:
        return ("is ahead of" if points > 0 else "is behind"), f"{by}; the 95% intervals overlap"
    return ("beats" if points > 0 else "loses to"), f"{by}; the 95% intervals do not overlap"
