"""Run any controller on a fixed set of episodes. Which controller it is, is never asked."""

import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from tensegrity_agents.controllers import baselines_of
from tensegrity_agents.controllers.base import Controller
from tensegrity_agents.evaluation.results import Run
from tensegrity_envs import termination_reason
from tensegrity_envs.core import Core
from tensegrity_envs.registration import full_id
from tensegrity_envs.tasks.reach import Reach
from tensegrity_envs.vector_env import step_info


class ControllerError(ValueError):
    """A controller that cannot be evaluated; the message says what it did."""


@contextmanager
def _blaming(name: str, method: str, what: str = "raised an error") -> Iterator[None]:
    """Say of errors within which controller they come from, and from which line."""
    try:
        yield
    except Exception as error:
        frames = traceback.extract_tb(error.__traceback__)
        where = f"{Path(frames[-1].filename).name}, line {frames[-1].lineno}"
        reason = f"{type(error).__name__}: {error} ({where})"
        raise ControllerError(f"controller {name!r}: {method} {what}: {reason}") from error


def begin_episodes(controller: Controller, envs: Any, count: int) -> None:
    """Tell a controller that all episodes of a vector environment begin, and what it asks for about them.

    Args:
        controller: `begin_episodes` of those that have it is called.
        envs: unwrapped vector environment.
        count: number of its environments.
    """
    announce(controller, envs.design, envs.episode, count)


def check_environment(controller: Controller, core: Core) -> None:
    """Ask a controller whether it was made for this environment, if it can tell.

    Raises:
        ValueError: it was made for another one; the message names both.
    """
    check = getattr(controller, "check_environment", None)
    if check is not None:
        check(core)


def announce(controller: Controller, design: Any, episodes: Any, count: int = 1) -> None:
    """The same for environments of any kind.

    Args:
        controller: likewise.
        design: the nominal one.
        episodes: the running ones, for controllers that want what is privileged.
        count: how many.
    """
    begin = getattr(controller, "begin_episodes", None)
    if begin is not None:
        begin(np.ones(count, bool), design, episodes if getattr(controller, "wants_privileged", False) else None)


def evaluate(
    controller: Controller,
    env_id: str,
    episodes: int,
    first_seed: int,
    name: str,
    kind: str = "baseline",
    env_options: dict[str, Any] | None = None,
    progress: Callable[[int, int], None] | None = None,
    batch: int = 1000,
    made_elsewhere: bool = False,
) -> Run:
    """Evaluate a controller on the first episodes of the seeds first_seed, first_seed + 1, ...

    Args:
        controller: see `controllers.base.Controller`.
        env_id: Gymnasium id, with or without "tensegrity/".
        episodes: how many; each has a seed of its own, so every controller meets the same ones.
        first_seed: for published numbers `tensegrity_envs.seeding.TEST_SEED`.
        name: for the table.
        kind: "agent", "baseline", "oracle" or "random".
        env_options: further arguments of the environment.
        progress: called with (steps done, steps at most).
        batch: environments stepped at once.
        made_elsewhere: let a controller act that says it was made for another environment, such as another level of
            uncertainty: what is it worth there?

    Raises:
        ControllerError: it was made for another environment, `predict` or `begin_episodes` raised an error, or the
            actions do not fit.
        ValueError: `episodes` or `batch` is no positive whole number.
    """
    for what, count in (("episodes", episodes), ("batch", batch)):
        if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
            raise ValueError(f"evaluate: {what} = {count!r}: must be a whole number, 1 or more")
    env_id, parts = full_id(env_id), []
    actions_given, seconds = 0, 0.0
    limit = gym.spec(env_id).max_episode_steps or 100
    for first in range(0, episodes, batch):
        count = min(batch, episodes - first)
        envs = gym.make_vec(
            env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **(env_options or {})
        )
        shell: Any = envs.unwrapped
        core = shell.core
        if first == 0 and not made_elsewhere:
            try:
                check_environment(controller, core)
            except ValueError as error:
                same = f", {dict(env_options)}" if env_options else ""
                told = f"controller {name!r}: {error}. "
                if name in baselines_of(env_id, env_options):
                    told += f"make_controller({name!r}, {env_id!r}{same}) makes one for these episodes; "
                raise ControllerError(
                    f"{told}evaluate(..., made_elsewhere=True) lets this one act all the same"
                ) from error
        record = _Record(count, limit, core.error_name, step_time(core))
        observation, info = envs.reset(seed=first_seed + first)
        record.add(info, np.zeros(count), np.ones(count, bool), initial=True)
        with _blaming(name, "begin_episodes"):
            begin_episodes(controller, shell, count)
        state: object = None
        start = np.ones(count, bool)
        alive = np.ones(count, bool)
        for step in range(limit):
            before = time.perf_counter()
            with _blaming(name, "predict"):
                actions, state = controller.predict(observation, state=state, episode_start=start, deterministic=True)
            seconds += time.perf_counter() - before
            actions_given += count
            with _blaming(name, "predict", "returned actions that do not fit"):
                observation, reward, terminated, truncated, info = envs.step(actions)
            start = terminated | truncated
            record.add(step_info(info), reward, alive)
            alive &= ~start
            if progress is not None:
                progress(first * limit + (step + 1) * count, episodes * limit)
            if not alive.any():
                break
        envs.close()
        parts.append(record)
    columns = {key: np.concatenate([part.columns()[key] for part in parts]) for key in parts[0].columns()}
    reasons = [reason for part in parts for reason in part.reasons]
    per_action = 1e6 * seconds / max(actions_given, 1)
    seeds = first_seed + np.arange(episodes)
    return Run(name, kind, columns, seeds, reasons, per_action, error_unit=core.error_unit)


def step_time(core: Any) -> float:
    """Duration of a step [s] where arms reach in dynamics; elsewhere nobody asks when they settle, NaN."""
    own = core.dynamics
    return float(own.step_time) if own is not None and isinstance(core.task, Reach) else float("nan")


class _Record:
    """Running totals of the episodes of one batch."""

    def __init__(self, count: int, limit: int, error_name: str, step_time: float) -> None:
        self.limit, self.error_name, self.step_time = limit, error_name, step_time
        zeros = np.zeros(count)
        self.steps, self.unstable, self.infeasible = zeros.copy(), zeros.copy(), zeros.copy()
        self.effort, self.total = zeros.copy(), zeros.copy()
        self.success, self.ever = np.zeros(count, bool), np.zeros(count, bool)
        self.first = np.full(count, np.nan)
        self.error = np.full(count, np.nan)
        self.stability, self.wrench = np.full(count, np.inf), np.full(count, np.inf)
        self.score = np.full(count, np.nan)
        self.since, self.settling = zeros.copy(), np.full(count, np.nan)
        self.reasons = [""] * count

    def add(self, info: dict[str, Any], reward: np.ndarray, alive: np.ndarray, initial: bool = False) -> None:
        """Add a step of the episodes that are still running."""
        success = info["is_success"].astype(bool)
        self.success[alive] = success[alive]
        self.error[alive] = info[self.error_name][alive]
        at = self.steps + (not initial)
        self.first[alive & success & np.isnan(self.first)] = at[alive & success & np.isnan(self.first)]
        self.ever |= success & alive
        if "score" in info:
            self.score[alive] = info["score"][alive]
        self.since[alive & ~success] = (at + 1)[alive & ~success]
        if not np.isnan(self.step_time):
            # Fast tasks tell it themselves; success takes some steps longer there.
            settled = info.get("settling_time", self.step_time * self.since)
            self.settling[alive] = np.where(success, settled, np.inf)[alive]
        self.stability[alive] = np.minimum(self.stability, info["stability_margin"])[alive]
        self.wrench[alive] = np.minimum(self.wrench, info["wrench_margin"])[alive]
        if initial:
            return
        self.steps += alive
        self.total += np.where(alive, reward, 0.0)
        self.unstable += alive & ~info["is_stable"].astype(bool)
        self.infeasible += alive & ~info["is_wrench_feasible"].astype(bool)
        self.effort += np.where(alive, info["effort"], 0.0)
        for i in np.flatnonzero(alive & (info["failure"] != 0)):
            self.reasons[i] = termination_reason(info["failure"][i])

    def columns(self) -> dict[str, np.ndarray]:
        """The columns of the table."""
        steps = np.maximum(self.steps, 1)
        return {
            "success": self.success.astype(float),
            "success_ever": self.ever.astype(float),
            "final_error_m": self.error,
            "steps_to_target": self.first,
            "steps": self.steps,
            "unstable_share": self.unstable / steps,
            "infeasible_share": self.infeasible / steps,
            "min_stability_margin": self.stability,
            "min_wrench_margin": self.wrench,
            "effort": self.effort / steps,
            "return": self.total,
            "score": self.score,
            "settling_time_s": self.settling,
        }
