"""Learning curves: what training episodes bring, without bias, and what the agent can do without exploration noise."""

import csv
import heapq
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from tensegrity_agents.config import Experiment
from tensegrity_agents.controllers.base import Controller
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.whole_file import written_whole
from tensegrity_envs.seeding import VALIDATION_SEED

CURVE, EVALUATIONS = "progress.csv", "evaluation.csv"
CURVE_COLUMNS = ("seconds", "timesteps", "success", "return", "length")
_POINTS = 20  # evaluations in a whole training, beside the first one
_SHARE = 0.05  # of the training's environment steps that all evaluations together may take, if that suffices


class CompleteEpisodes:
    """The latest training episodes, each counted when its time limit has passed, whether it took so long or failed.

    Counted when they end, those that fail early would come first after each reset of all environments, and the curve
    would fall there. Episodes that a reset cuts off, or whose time limit is cut short to spread the environments, are
    left out.

    Args:
        num_envs: environments that are stepped together.
        limit: time limit of an episode [steps]; None if there is none.
        is_staggered: whether the first episodes after a reset have shorter limits.
    """

    def __init__(self, num_envs: int, limit: int | None, is_staggered: bool) -> None:
        self._limit, self._is_staggered = limit or 0, is_staggered
        self._num_envs = num_envs
        self._latest: deque[tuple[float, ...]] = deque(maxlen=max(num_envs, 100))
        self.reset()

    def reset(self) -> None:
        """All environments begin new episodes."""
        self._step = 0
        self._begun = np.zeros(self._num_envs, np.int64)
        self._is_cut = np.full(self._num_envs, self._is_staggered)
        self._waiting: list[tuple[float, ...]] = []  # a heap of (when it counts, environment, success, return, length)

    def add(self, dones: np.ndarray, infos: Sequence[dict[str, Any]]) -> None:
        """A step of all n environments, as Stable-Baselines3 reports it: `dones` of shape (n,), n dicts of info."""
        self._step += 1
        for i in np.flatnonzero(dones).tolist():
            if not self._is_cut[i]:
                episode = infos[i]["episode"]
                due = max(int(self._begun[i]) + self._limit, self._step)
                success = float(infos[i].get("is_success", np.nan))
                heapq.heappush(self._waiting, (float(due), float(i), success, float(episode["r"]), float(episode["l"])))
            self._is_cut[i] = False
            self._begun[i] = self._step
        while self._waiting and self._waiting[0][0] <= self._step:
            self._latest.append(heapq.heappop(self._waiting)[2:])

    def means(self) -> tuple[float, float, float] | None:
        """Success, return and length of the latest episodes; None before there are any."""
        if not self._latest:
            return None
        success, mean_return, length = np.mean(self._latest, axis=0)
        return float(success), float(mean_return), float(length)

    def state(self) -> dict[str, Any]:
        """All that determines what follows."""
        return {
            "step": self._step,
            "begun": self._begun.copy(),
            "is_cut": self._is_cut.copy(),
            "waiting": [list(item) for item in self._waiting],
            "latest": [list(item) for item in self._latest],
        }

    def go_on(self, state: dict[str, Any]) -> None:
        """Go on where `state` was taken."""
        self._step, self._begun, self._is_cut = state["step"], state["begun"], state["is_cut"]
        self._waiting = [tuple(item) for item in state["waiting"]]
        self._latest.clear()
        self._latest.extend(tuple(item) for item in state["latest"])


class Evaluations:
    """Runs the agent without noise on a few validation episodes, at regular intervals of a training.

    Args:
        experiment: what is trained.
    """

    def __init__(self, experiment: Experiment) -> None:
        self.experiment = experiment
        self.total = experiment.train.total_timesteps
        limit = gym.spec(experiment.env).max_episode_steps or 100
        self.episodes = int(np.clip(_SHARE * self.total / (_POINTS * limit), 20, 100))

    def is_due(self, timesteps: int, rows: Sequence[Sequence[float]]) -> bool:
        """Whether it is time for one, those in `rows` having been made."""
        return not rows or timesteps * _POINTS // self.total > int(rows[-1][1]) * _POINTS // self.total

    def __call__(self, controller: Controller, seconds: float, timesteps: int) -> list[float]:
        """A row of the table."""
        e = self.experiment
        options = e.train.env_options | e.options  # the reward of the training, on the environment of the table
        run = evaluate(
            controller, e.env, self.episodes, VALIDATION_SEED, "agent", "agent", options, made_elsewhere=True
        )
        means = [float(np.mean(run.columns[name])) for name in ("success", "return", "steps")]
        return [seconds, float(timesteps), *means]


def read_curve(path: Path) -> dict[str, np.ndarray]:
    """A learning curve that `train` wrote: arrays by column, empty if there is none."""
    if not path.is_file():
        return {name: np.zeros(0) for name in CURVE_COLUMNS}
    with path.open() as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in CURVE_COLUMNS}


def write_curve(path: Path, rows: Sequence[Sequence[float]]) -> None:
    """Write a learning curve, whole or not at all."""
    with written_whole(path) as part, part.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(CURVE_COLUMNS)
        writer.writerows(rows)
