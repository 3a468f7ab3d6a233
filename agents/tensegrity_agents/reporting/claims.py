"""Claims that agents beat the analytic controllers: candidates are named first, then judged by fixed rules.

A candidate is an environment at a level of uncertainty, and what counts there: success, or, in dynamics, the time to
settle (an episode in which the tip does not stay counts as long as the whole episode). A claim holds where

- the paired difference of all seeds to the best controller that is told nothing hidden is above 0 at the level of 5%,
  two-sided, by a bootstrap over seeds and episodes, with Holm's correction for all candidates that have agents;
- the worst seed is no worse than that controller's mean;
- a claim of time does not cost success: the 95% interval of the paired difference of success, by the same bootstrap, is
  not below 0 as a whole. (Until 2026-11-30 the mean was to be no less, which a single miss of ten thousand episodes
  decides where that controller has all of its own.)

The controller to beat is the best one by what counts; a controller that was measured on the first episodes only is
compared on these. [Holm1979] Holm, "A simple sequentially rejective multiple test
procedure", Scandinavian Journal of Statistics 6.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import gymnasium as gym
import numpy as np

from tensegrity_agents.config import known_env
from tensegrity_agents.env_options import check_options
from tensegrity_agents.evaluation.records import LEVEL_NAMES, Record
from tensegrity_agents.evaluation.rollout import step_time
from tensegrity_agents.evaluation.statistics import Estimate, resampled_means
from tensegrity_agents.reporting.matrix import AGENT, ahead
from tensegrity_agents.reporting.table import percent
from tensegrity_agents.yaml_file import ConfigError, read_any_yaml

CANDIDATES = "candidates.yaml"  # in the folder of the records
_EXAMPLE = "{env: TwoXFastReachMuJoCo-v0, level: 2, counts: success}, or counts: settling_time"
_NONE = "\N{EN DASH}"
_LEVEL = 0.025  # of a one-sided test: that of a 95% interval's lower end

Counts = Literal["success", "settling_time"]


class Candidate(NamedTuple):
    """Where agents are to win.

    Attributes:
        env: Gymnasium id.
        level: of uncertainty.
        counts: what is compared.
    """

    env: str
    level: str
    counts: Counts

    @property
    def name(self) -> str:
        """For tables: the id at its level."""
        return f"`{self.env.rpartition('/')[2]}` at level {self.level}"


class Claim(NamedTuple):
    """What was found for a candidate.

    Attributes:
        candidate: which.
        agents: scores of the agents, (seeds, episodes): success, or minus the time to settle [s].
        best: scores of the best controller, (episodes,); sometimes of the first ones only.
        controller: its name.
        successes: mean success of the agents and of that controller.
        cost: their paired difference, with its 95% interval.
        difference: of the scores, paired, with its 95% interval.
        chance: one-sided p value of no difference; the share of resamples in which the agents are not ahead.
        is_whole: whether the controller has gone through all episodes of the agents.
    """

    candidate: Candidate
    agents: np.ndarray
    best: np.ndarray
    controller: str
    successes: tuple[float, float]
    cost: Estimate
    difference: Estimate
    chance: float
    is_whole: bool

    @property
    def worst(self) -> float:
        """Score of the worst seed."""
        return float(self.agents.mean(axis=1).min())

    def holds(self, adjusted: float) -> bool:
        """Whether the agents win, by the rules of the module.

        Args:
            adjusted: the p value after Holm's correction.
        """
        costs = self.candidate.counts == "settling_time" and self.cost.high < 0
        return adjusted < _LEVEL and self.worst >= self.best.mean() and not costs


def read_candidates(path: Path) -> list[Candidate]:
    """The candidates in a YAML file: a list of {env, level, counts}.

    Raises:
        ConfigError: the file holds something else, or an entry fits no environment; the message names file and entry.
    """
    content = read_any_yaml(path)
    if not isinstance(content, list):
        raise ConfigError(f"{path} holds {content!r:.60}: it must be a list of entries such as {_EXAMPLE}")
    found: list[Candidate] = []
    for number, entry in enumerate(content, 1):
        try:
            found.append(_candidate(entry))
        except ConfigError as error:
            raise ConfigError(f"{path}: entry {number}, {entry!r:.120}: {error}") from error
        if found[-1] in found[:-1]:  # which would count as another one in Holm's correction
            raise ConfigError(f"{path}: entry {number}, {entry!r:.120}: stands there twice; delete one of them")
    return found


def _candidate(entry: object) -> Candidate:
    """The candidate that an entry of the file names.

    Raises:
        ConfigError: it names none; the message says what would work.
    """
    if not isinstance(entry, dict) or set(entry) != set(Candidate._fields):
        raise ConfigError(f"must have env, level and counts, such as {_EXAMPLE}")
    level, counts = str(entry["level"]), entry["counts"]
    if level not in LEVEL_NAMES:
        raise ConfigError(f"level: must be one of {', '.join(LEVEL_NAMES)}")
    if counts not in get_args(Counts):
        raise ConfigError(f"counts: must be {' or '.join(get_args(Counts))}")
    env = known_env(str(entry["env"]))
    core = check_options(env, {"level": int(level)})
    if counts == "settling_time" and math.isnan(step_time(core)):
        raise ConfigError("counts: settling_time is measured where arms reach in dynamics; here success counts")
    return Candidate(env, level, counts)


def scores_of(record: Record, candidate: Candidate) -> np.ndarray | None:
    """What counts, the larger the better, of every episode; None where it was not measured."""
    level = level_of(candidate)
    if level not in record.successes:
        return None
    if candidate.counts == "success":
        return record.flags(level).astype(float)
    times = record.settling_times(level)
    return None if times is None else -np.minimum(times, duration_of(record.env))


def level_of(candidate: Candidate) -> str:
    """The level as records name it: "" where it is that of the environment as it is."""
    own = gym.spec(candidate.env).kwargs.get("level") or 0
    return "" if candidate.level == str(own) else candidate.level


def duration_of(env_id: str) -> float:
    """Of an episode of reaching in dynamics [s]."""
    env: Any = gym.make(env_id).unwrapped
    return float((gym.spec(env_id).max_episode_steps or 0) * step_time(env.core))


def judged(candidate: Candidate, records: Sequence[Record]) -> Claim | None:
    """The claim of a candidate; None where no agent or no controller was measured there.

    Args:
        candidate: which.
        records: all rows of its id.
    """
    scored = [(record, scores) for record in records if (scores := scores_of(record, candidate)) is not None]
    agents = [(record, scores) for record, scores in scored if record.kind == AGENT]
    controllers = [(record, scores) for record, scores in scored if record.kind == "baseline"]
    if not agents or not controllers:
        return None
    table = np.stack([scores for _, scores in agents])
    row, best = min(controllers, key=lambda pair: float(ahead(table, pair[1]).mean()))
    table = table[:, : len(best)]
    level = level_of(candidate)
    flags, own = np.stack([record.flags(level)[: len(best)] for record, _ in agents]), row.flags(level)
    difference, means = _paired(table, best)
    return Claim(
        candidate,
        table,
        best,
        row.controller,
        (float(flags.mean()), float(own.mean())),
        _paired(flags, own)[0],
        difference,
        float((1 + (means <= 0).sum()) / (1 + len(means))),
        row.episodes == agents[0][0].episodes,
    )


def _paired(agents: np.ndarray, best: np.ndarray) -> tuple[Estimate, np.ndarray]:
    """The paired difference of scores with its 95% interval, and its means in the resamples."""
    by = ahead(agents, best)
    means = resampled_means(by)
    low, high = np.quantile(means, [0.025, 0.975])
    return Estimate(float(by.mean()), float(low), float(high)), means


def holm(chances: Sequence[float]) -> list[float]:
    """P values adjusted for being several [Holm1979], in the same order."""
    adjusted, largest = [0.0] * len(chances), 0.0
    for rank, k in enumerate(sorted(range(len(chances)), key=lambda k: chances[k])):
        largest = max(largest, min(1.0, (len(chances) - rank) * chances[k]))
        adjusted[k] = largest
    return adjusted


def claims_to_markdown(candidates: Sequence[Candidate], records: Mapping[str, Sequence[Record]]) -> str:
    """The table of all candidates; those without agents have dashes."""
    found = [judged(one, records.get(one.env, [])) for one in candidates]
    adjusted = iter(holm([claim.chance for claim in found if claim is not None]))
    lines = [
        "| candidate | what counts | agents: mean over seeds | seeds | worst seed | best controller | "
        "difference | p (Holm) | success: agents, controller [%] (difference, 95% [points]) | wins |",
        "|---|---|---:|---:|---:|---|---:|---:|---:|---|",
    ]
    for one, claim in zip(candidates, found, strict=True):
        cells = [_NONE] * 8 if claim is None else _cells(claim, next(adjusted))
        lines.append("| " + " | ".join([one.name, one.counts.replace("_", " "), *cells]) + " |")
    return "\n".join(lines) + "\n"


def _cells(claim: Claim, adjusted: float) -> list[str]:
    def shown(score: float, sign: str = "") -> str:
        if claim.candidate.counts == "success":
            return f"{100 * score:{sign}.1f}"
        return f"{-score:{sign}.3f}"

    by = claim.difference
    ends = sorted((by.low, by.high), reverse=claim.candidate.counts != "success")
    unit = " %" if claim.candidate.counts == "success" else " s"
    few = "" if claim.is_whole else f" on the first {len(claim.best)} episodes"
    return [
        shown(float(claim.agents.mean())) + unit,
        str(len(claim.agents)),
        shown(claim.worst) + unit,
        claim.controller.replace("_", "\\_") + ": " + shown(float(claim.best.mean())) + unit + few,
        f"{shown(by.point, '+')} [{', '.join(shown(end, '+') for end in ends)}]",
        f"{adjusted:.4f}",
        f"{', '.join(percent(share) for share in claim.successes)} "
        f"({', '.join(f'{100 * end:+.2f}' for end in (claim.cost.low, claim.cost.high))})",
        "agent" if claim.holds(adjusted) else "no",
    ]
