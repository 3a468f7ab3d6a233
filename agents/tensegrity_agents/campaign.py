"""All agents of all environments, measured once: every row is kept as soon as it is there, and nothing is done twice.

A row is one training seed, or one analytic controller, on the test episodes of one id. Trainings go on from their last
checkpoint; finished rows are small files that a repository can hold (see `evaluation.records`). A row whose config has
changed since is measured again.
"""

import json
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from pydantic import TypeAdapter, ValidationError

from tensegrity_agents.config import Experiment
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.controllers.base import Controller
from tensegrity_agents.evaluation.records import Amount, Record, file_of, hash_of, name_of, read_record, recorded
from tensegrity_agents.evaluation.results import Progress, Run, kind_of
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.experiment import agent_name, train_agents
from tensegrity_agents.sb3.checkpoint import CHECKPOINT
from tensegrity_agents.sb3.policy_file import DESCRIPTION, WEIGHTS, load_policy, save_policy
from tensegrity_agents.whole_file import written_whole
from tensegrity_envs.seeding import TEST_SEED
from tensegrity_envs.uncertainty import LEVELS

FLAGS = "test_successes.txt"  # of a kept policy: one digit for each test episode
_CPU = "cpu_seconds.json"
_COST = TypeAdapter[float](Amount)
_CHECKED = 200


class Task(NamedTuple):
    """A row to measure.

    Attributes:
        experiment: of its id.
        seed: of the training; None for a controller.
        controller: its name; "" for a training.
        only: levels of uncertainty to measure beside the environment as it is; by default all that it has.
    """

    experiment: Experiment
    seed: int | None
    controller: str = ""
    only: tuple[int, ...] | None = None

    @property
    def short_id(self) -> str:
        """The id without its namespace."""
        return self.experiment.env.rpartition("/")[2]

    @property
    def name(self) -> str:
        """For messages and files."""
        return name_of(self.controller, self.seed)

    @property
    def config(self) -> str:
        """Hash of all that the row depends on."""
        given = self.experiment
        settings = {"env": given.env, "options": given.options, "episodes": given.episodes}
        if self.seed is None:
            return hash_of(settings | {"controller": self.controller})
        return hash_of(settings | {"seed": self.seed, "train": _settings(given)})

    @property
    def levels(self) -> list[str]:
        """Those to measure; "" is the environment as it is."""
        given = self.experiment
        own = gym.spec(given.env).kwargs.get("level")
        varied = (own is not None or given.train.levels is not None) and given.level is None
        return ["", *(str(k) for k in range(len(LEVELS)) if varied and (self.only is None or k in self.only))]

    def home(self, results: Path) -> Path:
        """Where it is trained: not where another config was."""
        given = self.experiment
        trained = hash_of({"options": given.options, "train": _settings(given)})
        return results / f"{self.short_id}-{trained}" / f"agent-{self.seed}"

    def file(self, records: Path) -> Path:
        """Where its record is kept."""
        return file_of(records, self.experiment.env, self.controller, self.seed)

    def kept(self, records: Path) -> Record | None:
        """Its record, if there is one of this config, which says that it is this row, with all its levels.

        Raises:
            ValueError: the file there is no record.
        """
        record = self.begun(records)
        return record if record is not None and set(self.levels) <= set(record.successes) else None

    def begun(self, records: Path) -> Record | None:
        """The same, though levels are missing.

        Raises:
            ValueError: the file there is no record.
        """
        path = self.file(records)
        if not path.is_file():
            return None
        record = read_record(path)
        return record if self._is_asked_for(record) else None

    def _is_asked_for(self, record: Record) -> bool:
        """Whether a record is of this row: the hash alone does not notice a field that was changed by hand."""
        asked = self.config, self.experiment.env, self.experiment.episodes, self.seed
        found = record.config, record.env, record.episodes, record.seed
        return found == asked and (self.seed is not None or record.controller == self.controller)


def _settings(experiment: Experiment) -> dict[str, Any]:
    """What the training is asked for; settings that come later, and are not used, do not make it another one."""
    return experiment.train.model_dump(mode="json", exclude_defaults=True)


def tasks_of(
    experiment: Experiment, agents: bool = True, controllers: bool = True, levels: tuple[int, ...] | None = None
) -> list[Task]:
    """The rows of an id: its seeds, then its controllers.

    Args:
        experiment: of the id.
        agents: whether its seeds are wanted.
        controllers: whether its controllers are.
        levels: see `Task.only`.
    """
    found = [Task(experiment, seed, "", levels) for seed in experiment.seeds] if agents else []
    return found + ([Task(experiment, None, name, levels) for name in experiment.compared] if controllers else [])


def measure(task: Task, results: Path, records: Path, progress: Progress) -> Record:
    """Train (or go on, or load) and evaluate one row, and keep its record, level by level.

    Args:
        task: the row.
        results: of trainings, results/<id>-<hash of the config>/agent-<seed>.
        records: of rows, records/<id>/<name>.json.
        progress: called while it works.
    """
    experiment, more = task.experiment, dict[str, Any]()  # `more`: what the record says beside the episodes
    if task.seed is None:
        controller = make_controller(task.controller, experiment.env, experiment.options)
        make: Callable[[dict[str, Any]], Controller] = partial(make_controller, task.controller, experiment.env)
        knows = str(getattr(controller, "knows", ""))
    else:
        home = task.home(results)
        with _counting(home):
            agent = train_agents(experiment.changed(seeds=[task.seed]), home.parent, progress)[task.seed]

        def make(_: dict[str, Any]) -> Controller:
            return agent

        knows, about = agent.knows, agent.description
        more = {
            "seed": task.seed,
            "frames": about["timesteps"],
            "cpu_seconds": _cpu_seconds(home),
            "wall_seconds": about["training_seconds"],
        }
    record = task.begun(records)
    own = str(gym.spec(experiment.env).kwargs.get("level") or 0)
    for level in task.levels:
        if record is None:
            first = {level: _evaluated(task, make, level, progress)}
            record = replace(recorded(first, experiment.env, task.config, **more), knows=knows)
        elif level == own and level not in record.successes:
            record = record.with_level(level, record, "")
        elif level not in record.successes:
            run = _evaluated(task, make, level, progress)
            record = record.with_level(level, recorded({"": run}, experiment.env, task.config), "")
        record.write(task.file(records))
    assert record is not None
    return record


def _evaluated(task: Task, make: Callable[[dict[str, Any]], Controller], level: str, progress: Progress) -> Run:
    """The run at a level of uncertainty; "" is the environment as it is."""
    experiment = task.experiment
    options = experiment.options | ({"level": int(level)} if level else {})
    what = f"{task.short_id} {task.name}{f', level {level}' if level else ''}"
    return evaluate(
        make(options),
        experiment.env,
        task.experiment.episodes,
        TEST_SEED,
        agent_name(experiment) if task.seed is not None else task.controller,
        "agent" if task.seed is not None else kind_of(task.controller),
        options,
        lambda done, total: progress(what, done, total, "evaluated"),
    )


class _counting:
    """Adds the CPU time of this process to what the training has cost so far, however it ends."""

    def __init__(self, home: Path) -> None:
        self.home = home

    def __enter__(self) -> None:
        self.is_fresh = not any((self.home / name).is_file() for name in (DESCRIPTION, CHECKPOINT))
        self.before, self.begun = _cpu_seconds(self.home), time.process_time()

    def __exit__(self, *_: object) -> None:
        before = 0.0 if self.is_fresh else self.before
        if before is not None and self.home.is_dir():
            with written_whole(self.home / _CPU) as part:
                part.write_text(json.dumps(before + time.process_time() - self.begun))


def _cpu_seconds(home: Path) -> float | None:
    """What a training has cost; None where it was begun by another command, which does not count it, and where the file
    is damaged: a row can do without the number.
    """
    path = home / _CPU
    try:
        return round(_COST.validate_json(path.read_bytes()), 1) if path.is_file() else None
    except ValidationError:
        return None


def sorted_out(tasks: Sequence[Task], records: Path) -> tuple[list[tuple[Task, Record]], list[Task]]:
    """The rows that are there, and those still to be measured.

    Args:
        tasks: the rows.
        records: see `measure`.
    """
    found = [(task, task.kept(records)) for task in tasks]
    there = [(task, record) for task, record in found if record is not None]
    return there, [task for task, record in found if record is None]


def run_campaign(
    tasks: Sequence[Task], results: Path, records: Path, progress: Progress, jobs: int = 1
) -> Iterator[tuple[Task, Record | Exception]]:
    """Measure all rows that are not there yet; each is yielded when it is, with its record or what went wrong.

    Args:
        tasks: the rows, in the order in which they are begun.
        results: see `measure`.
        records: see `measure`.
        progress: called while it works.
        jobs: processes; with one, rows are measured in this one.
    """
    there, todo = sorted_out(tasks, records)
    yield from there
    if jobs == 1:
        for task in todo:
            try:
                yield task, measure(task, results, records, progress)
            except Exception as error:
                yield task, error
        return
    # Torch and compiled code do not survive a fork.
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        begun: dict[Future[Record], Task] = {
            pool.submit(measure, task, results, records, silent): task for task in todo
        }
        try:
            for number, future in enumerate(as_completed(begun)):
                progress("rows", number + 1, len(todo), begun[future].short_id)
                wrong = future.exception()
                yield begun[future], wrong if isinstance(wrong, Exception) else future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def silent(what: str, done: int, total: int, remark: str) -> None:
    """Progress of rows in other processes is that they are finished."""


def median_record(records: Sequence[Record]) -> Record:
    """The agent whose success is the median of all; of an even number, the lower of the two in the middle."""
    ranked = sorted(records, key=lambda one: (float(one.flags().mean()), -(one.seed or 0)))
    return ranked[(len(ranked) - 1) // 2]


def keep_median(experiment: Experiment, results: Path, records: Path, policies: Path) -> Path | None:
    """Put the policy of the median seed into policies/<id>/ with its test flags; None unless all seeds are there.

    Success in the environment as it is tells which seed is the median, so rows may lack levels of uncertainty.
    Its weights are in half precision, unless that changes any of the first `_CHECKED` flags: other processors, which
    round differently, may change some.

    Args:
        experiment: of the id.
        results: see `measure`.
        records: see `measure`.
        policies: folder of kept policies.
    """
    tasks = tasks_of(experiment, controllers=False, levels=())
    kept = [record for task in tasks if (record := task.kept(records)) is not None]
    if len(kept) < len(tasks):
        return None
    chosen = median_record(kept)
    home = Task(experiment, chosen.seed).home(results)
    target = policies / tasks[0].short_id
    if not (home / WEIGHTS).is_file():
        return None
    flags = chosen.flags()
    digits = "".join(np.where(flags, "1", "0")) + "\n"
    if (target / FLAGS).is_file() and (target / FLAGS).read_text() == digits and _described(target) == _described(home):
        return target
    policy, count = load_policy(home), min(_CHECKED, len(flags))
    save_policy(target, policy, half=True)
    found = evaluate(load_policy(target), experiment.env, count, TEST_SEED, "kept", env_options=experiment.options)
    if (found.columns["success"] != flags[:count]).any():
        save_policy(target, policy)
    (target / FLAGS).write_text(digits)
    return target


def _described(folder: Path) -> dict[str, Any]:
    """The description of a policy, whatever the precision of its weights; empty where there is none."""
    file = folder / DESCRIPTION
    return (
        {key: value for key, value in json.loads(file.read_text()).items() if key != "sha256"} if file.is_file() else {}
    )
