"""The main job: train agents, run them and the analytic controllers on the same held-out episodes, write everything
down.
"""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tensegrity_agents import env_options
from tensegrity_agents.config import Experiment
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.evaluation.results import Run, write_csv
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.sb3.policy_file import TrainedPolicy, load_policy
from tensegrity_agents.sb3.training import CURVE, EVALUATIONS, read_curve, train, with_later_settings
from tensegrity_envs.seeding import TEST_SEED

KINDS = {"oracle": "oracle", "random": "random"}
# progress(what is being done, done, of how many, remark)
Progress = Callable[[str, int, int, str], None]


@dataclass
class Comparison:
    """What `compare` found.

    Attributes:
        runs: one for every agent and controller.
        agents: the trained policies by training seed.
        controllers: everything that was evaluated, by name, for the video.
        curves: learning curves by training seed: of the training episodes.
        evaluations: the same of the agent without noise on validation episodes.
    """

    runs: list[Run]
    agents: dict[int, TrainedPolicy]
    controllers: dict[str, Any]
    curves: dict[int, dict[str, np.ndarray]]
    evaluations: dict[int, dict[str, np.ndarray]]


def agent_name(experiment: Experiment) -> str:
    """Name of the agent in tables, such as "PPO agent", or "PPO agent with hints" if the nominal model gives some."""
    return f"{experiment.train.algorithm.upper()} agent{' with hints' if experiment.train.model_hints else ''}"


def train_agents(
    experiment: Experiment, folder: Path, progress: Progress, fresh: bool = False
) -> dict[int, TrainedPolicy]:
    """One agent for every seed, in folder/agent-<seed>; those already there are loaded, those begun are gone on with.

    Args:
        experiment: what to train.
        folder: of the results.
        progress: called while training.
        fresh: train anew whatever is there.
    """
    agents = {}
    for seed in experiment.seeds:
        home = folder / f"agent-{seed}"
        if fresh and home.exists():
            shutil.rmtree(home)
        finished = _finished(home, experiment)
        if finished is None:
            what = f"training agent (seed {seed})"

            def report(done: int, total: int, success: float, what: str = what) -> None:
                progress(what, done, total, f"success {success:4.0%}")

            finished = train(experiment, seed, home, report)
        agents[seed] = finished
    return agents


def _finished(home: Path, experiment: Experiment) -> TrainedPolicy | None:
    if not (home / "policy.json").is_file():
        return None
    options = env_options.canonical(experiment.env, experiment.options)
    policy = load_policy(home, experiment.env, options)
    settings = experiment.train.model_dump(mode="json")
    same = (
        with_later_settings(policy.description.get("train", {}), settings) == settings
        and policy.description["env"] == experiment.env
        and policy.description.get("options", {}) == options
    )
    return policy if same else None


def compare(experiment: Experiment, folder: Path, progress: Progress, fresh: bool = False) -> Comparison:
    """Train (or load) the agents, evaluate them and the controllers on the test episodes, write episodes.csv and
    config.yaml.

    Args:
        experiment: what to compare.
        folder: of the results; is created.
        progress: called while it works.
        fresh: train anew even where trained agents are there.
    """
    # A controller that does not load should not cost a training first.
    baselines = {name: make_controller(name, experiment.env, experiment.options) for name in experiment.compared}
    agents = train_agents(experiment, folder, progress, fresh)
    (folder / "config.yaml").write_text(yaml.safe_dump(experiment.model_dump(mode="json"), sort_keys=False))
    runs = []
    name = agent_name(experiment)
    for seed, policy in agents.items():
        run = _evaluate(experiment, policy, name, "agent", progress)
        run.training_seed = seed
        runs.append(run)
        write_csv(runs, folder / "episodes.csv")
    for key, controller in baselines.items():
        runs.append(_evaluate(experiment, controller, key, KINDS.get(key, "baseline"), progress))
        write_csv(runs, folder / "episodes.csv")
    curves = {seed: read_curve(folder / f"agent-{seed}" / CURVE) for seed in agents}
    evaluations = {seed: read_curve(folder / f"agent-{seed}" / EVALUATIONS) for seed in agents}
    return Comparison(runs, agents, {name: next(iter(agents.values()))} | baselines, curves, evaluations)


def _evaluate(experiment: Experiment, controller: Any, name: str, kind: str, progress: Progress) -> Run:
    run = evaluate(
        controller,
        experiment.env,
        experiment.episodes,
        TEST_SEED,
        name,
        kind,
        experiment.options,
        progress=lambda done, total: progress(f"evaluating {name}", done, total, ""),
    )
    run.notes = str(getattr(controller, "knows", ""))
    return run
