"""What an evaluation records: one row for every episode, and the files that it is kept in."""

import csv
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

# progress(what is being done, done, of how many, remark)
Progress = Callable[[str, int, int, str], None]

# Columns of the per-episode CSV, with their units.
COLUMNS = (
    "success",  # tip within tolerance at the end, stable and wrench-feasible: 0 or 1
    "success_ever",  # the same at any step
    "final_error_m",  # tip error at the end [m]; of posture changes, the largest angle [rad]
    "steps_to_target",  # first step within tolerance, NaN if never
    "steps",  # length of the episode
    "unstable_share",  # of the steps, in which stability was lost
    "infeasible_share",  # of the steps, in which no feasible tensions held the arm
    "min_stability_margin",
    "min_wrench_margin",
    "effort",  # mean over steps and inputs of (input / scale)^2
    "return",  # sum of rewards
    "score",  # of tasks that have one (holding: largest force held, in critical loads), else NaN
    "settling_time_s",  # after which the tip stays on target, in dynamics [s]; infinite without success
)


@dataclass
class Run:
    """One controller (one trained policy) on one set of episodes.

    Attributes:
        controller: name, as in the table.
        kind: "agent", "baseline", "oracle" or "random".
        columns: COLUMNS, each of shape (episodes,).
        seeds: seed of every episode, shape (episodes,).
        reasons: why each episode was terminated, "" where it was not.
        microseconds_per_action: wall time of `predict` divided by the number of actions it gave.
        training_seed: of a trained policy, else None.
        notes: for the table.
        error_unit: of a thousandth of the final error.
    """

    controller: str
    kind: str
    columns: dict[str, np.ndarray]
    seeds: np.ndarray
    reasons: list[str]
    microseconds_per_action: float
    training_seed: int | None = None
    notes: str = ""
    error_unit: str = "mm"
    info: dict[str, object] = field(default_factory=dict)


def kind_of(name: str) -> str:
    """The kind of a baseline: "oracle" (who is told what others do not know), "random" or "baseline"."""
    return "oracle" if name == "informed" else name if name in ("oracle", "random") else "baseline"


@dataclass
class Comparison:
    """Agents and controllers on the same test episodes.

    Attributes:
        runs: one for every agent and controller.
        controllers: everything that was evaluated, by name, the agent first, for pictures and the film.
        descriptions: what is known of the trained policies, by training seed.
        curves: learning curves by training seed: of the training episodes.
        evaluations: the same of the agent without noise on validation episodes.
    """

    runs: list[Run]
    controllers: dict[str, Any]
    descriptions: dict[int, dict[str, Any]]
    curves: dict[int, dict[str, np.ndarray]]
    evaluations: dict[int, dict[str, np.ndarray]]


def write_csv(runs: list[Run], path: Path) -> None:
    """Write one row per controller and episode."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["controller", "kind", "training_seed", "episode_seed", *COLUMNS, "termination_reason"])
        for run in runs:
            for i, seed in enumerate(run.seeds):
                values = [repr(float(run.columns[name][i])) for name in COLUMNS]
                writer.writerow([run.controller, run.kind, run.training_seed, int(seed), *values, run.reasons[i]])
