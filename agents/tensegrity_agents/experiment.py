"""Train, evaluate and report: the one place that knows all three.

Every command is one function here: `train_agents`, `compare`, `evaluate_named`, `transfer_table`. What they need comes
as arguments; what they write goes into the folder that is given.
"""

import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import yaml

from tensegrity_agents import env_options
from tensegrity_agents.config import ConfigError, Experiment
from tensegrity_agents.controllers import baselines_of, make_controller
from tensegrity_agents.controllers.base import Controller
from tensegrity_agents.evaluation.results import Comparison, Progress, Run, kind_of, write_csv
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.evaluation.transfer import Candidate, Transferred, transfer
from tensegrity_agents.pretrained import AGENT, load_pretrained
from tensegrity_agents.reporting.compare_report import write_comparison
from tensegrity_agents.reporting.table import Row
from tensegrity_agents.reporting.transfer_table import transfer_to_markdown
from tensegrity_agents.sb3.policy_file import TrainedPolicy, load_policy
from tensegrity_agents.sb3.side_by_side import train_side_by_side
from tensegrity_agents.sb3.training import CURVE, EVALUATIONS, check_trainable, read_curve, train, with_later_settings
from tensegrity_envs.env import unwrapped
from tensegrity_envs.seeding import TEST_SEED, VALIDATION_SEED


def agent_name(experiment: Experiment) -> str:
    """Name of the agent in tables, such as "PPO agent", "PPO agent with model-based features" if the nominal
    model gives some, "taught PPO agent" if a teacher came first, "taught agent" if it was all there was.
    """
    train = experiment.train
    algorithm = {"recurrent_ppo": "recurrent PPO", "crossq": "CrossQ"}.get(train.algorithm, train.algorithm.upper())
    name = f"{algorithm} agent{' with model-based features' if train.model_hints else ''}"
    if train.gradient is not None:
        alone = train.gradient.timesteps >= train.total_timesteps
        return "agent trained by gradient" if alone else f"{name} trained by gradient first"
    if train.teacher is None:
        return name
    return f"taught {name}" if train.teacher.timesteps < train.total_timesteps else "taught agent"


def train_agents(
    experiment: Experiment, folder: Path, progress: Progress, fresh: bool = False, jobs: int = 1
) -> dict[int, TrainedPolicy]:
    """One agent for every seed, in folder/agent-<seed>; those already there are loaded, those begun are gone on with.

    Args:
        experiment: what to train.
        folder: of the results.
        progress: called while training.
        fresh: train anew whatever is there.
        jobs: how many are trained at once, each in a process of its own; environments of your own, one after another.
    """
    homes = {seed: folder / f"agent-{seed}" for seed in experiment.seeds}
    if fresh and any(home.exists() for home in homes.values()):
        check_trainable(experiment)
        for home in filter(Path.exists, homes.values()):
            shutil.rmtree(home)

    def report(seed: int, done: int, total: int, success: float) -> None:
        so_far = "" if math.isnan(success) else f"success {success:4.0%}"
        progress(f"training agent (seed {seed})", done, total, so_far)

    agents = {seed: _finished(home, experiment) for seed, home in homes.items()}
    todo = {seed: homes[seed] for seed, agent in agents.items() if agent is None}
    if jobs > 1 and len(todo) > 1 and experiment.env.startswith("tensegrity/"):
        train_side_by_side(experiment, todo, jobs, report)
        return {seed: agents[seed] or load_policy(home, experiment.env) for seed, home in homes.items()}
    return {seed: agents[seed] or train(experiment, seed, home, partial(report, seed)) for seed, home in homes.items()}


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


class Reported(NamedTuple):
    """What `compare` leaves behind.

    Attributes:
        comparison: all runs.
        report: path of report.html.
        rows: of the table.
    """

    comparison: Comparison
    report: Path
    rows: list[Row]


def compare(experiment: Experiment, folder: Path, progress: Progress, fresh: bool = False, jobs: int = 1) -> Reported:
    """Train (or load) the agents, evaluate them and the controllers on the test episodes, write everything down.

    Args:
        experiment: what to compare.
        folder: of the results; is created. Gets episodes.csv, config.yaml, summary.md, figures, the film, report.html.
        progress: called while it works.
        fresh: train anew even where trained agents are there.
        jobs: how many agents are trained at once.
    """
    comparison = evaluate_all(experiment, folder, progress, fresh, jobs)
    report, rows = write_comparison(experiment, comparison, folder, progress)
    return Reported(comparison, report, rows)


def evaluate_all(
    experiment: Experiment, folder: Path, progress: Progress, fresh: bool = False, jobs: int = 1
) -> Comparison:
    """What `compare` does before it draws and reports."""
    # A controller that does not load should not cost a training first.
    baselines = {name: make_controller(name, experiment.env, experiment.options) for name in experiment.compared}
    agents = train_agents(experiment, folder, progress, fresh, jobs)
    (folder / "config.yaml").write_text(yaml.safe_dump(experiment.model_dump(mode="json"), sort_keys=False))
    runs = []
    name = agent_name(experiment)
    for seed, policy in agents.items():
        run = _evaluate(experiment, policy, name, "agent", progress)
        run.training_seed = seed
        runs.append(run)
        write_csv(runs, folder / "episodes.csv")
    for key, controller in baselines.items():
        runs.append(_evaluate(experiment, controller, key, kind_of(key), progress))
        write_csv(runs, folder / "episodes.csv")
    curves = {seed: read_curve(folder / f"agent-{seed}" / CURVE) for seed in agents}
    evaluations = {seed: read_curve(folder / f"agent-{seed}" / EVALUATIONS) for seed in agents}
    descriptions = {seed: policy.description for seed, policy in agents.items()}
    return Comparison(runs, {name: next(iter(agents.values()))} | baselines, descriptions, curves, evaluations)


def _evaluate(experiment: Experiment, controller: Controller, name: str, kind: str, progress: Progress) -> Run:
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


def evaluate_named(
    env_id: str,
    names: Sequence[str],
    policies: Sequence[Path],
    options: Mapping[str, Any],
    episodes: int,
    split: str,
    progress: Progress,
    csv: Path | None = None,
    remark: Callable[[str], None] = print,
) -> list[Run]:
    """Score controllers and trained policies on the same held-out episodes.

    Args:
        env_id: Gymnasium id.
        names: of baselines, "agent" for the shipped policy, or "module:Class".
        policies: folders of trained policies. If there are neither, the environment's first baseline is scored.
        options: of the environment.
        episodes: how many.
        split: "test", or "validation" for tuning.
        progress: called while it works.
        csv: gets one row per episode.
        remark: called with what is worth saying of a policy.

    Raises:
        ConfigError: there is no such split.
    """
    if split not in ("test", "validation"):
        raise ConfigError(f"--split {split}: must be test or validation")
    own = env_options.canonical(env_id, options)
    chosen = dict.fromkeys(names or ([] if policies else list(baselines_of(env_id, options))[:1]))

    def remarked(name: str, agent: TrainedPolicy) -> tuple[str, Any, str]:
        before = agent.description.get("options") or {}
        knows_levels = set(options) == {"level"} and bool(agent.description.get("levels"))
        if before != own and not knows_levels:
            remark(f"{name}: trained with other options ({before or 'the default ones'}) than it is evaluated with")
        return name, agent, "agent"

    scored = [
        remarked(name, load_pretrained(env_id, own))
        if name == AGENT
        else (name, make_controller(name, env_id, options), kind_of(name))
        for name in chosen
    ]
    scored += [remarked(str(path), load_policy(path, env_id, own)) for path in policies]
    first = TEST_SEED if split == "test" else VALIDATION_SEED
    runs = []
    for name, controller, kind in scored:

        def report(done: int, total: int, name: str = name) -> None:
            progress(f"evaluating {name}", done, total, "")

        runs.append(evaluate(controller, env_id, episodes, first, name, kind, dict(options), report))
        if csv is not None:
            csv.parent.mkdir(parents=True, exist_ok=True)
            write_csv(runs, csv)
    return runs


def candidates(pair: tuple[str, str], results: Path, options: Mapping[str, Any] | None = None) -> list[Candidate]:
    """The agents that were trained on either, and the baselines of both.

    Args:
        pair: from `pair_of`.
        results: folder that has results/<environment>/agent-<seed>, as train.py and compare.py name them.
        options: of both environments.
    """
    options = options or {}
    found = []
    for home in pair:
        own = env_options.canonical(home, options)
        folders = sorted((results / env_options.results_name(home, options)).glob("agent-*/policy.json"))
        agents = [load_policy(path.parent, home, own) for path in folders]
        if other := [p for p, a in zip(folders, agents, strict=True) if a.description.get("options", {}) != own]:
            raise ValueError(f"{other[0].parent}: trained with other options than {own or 'the default ones'}")
        if agents:
            found.append(Candidate("agent", home, agents))
        env = unwrapped(gym.make(home, **options))
        makers = baselines_of(home, options).items()
        found += [Candidate(name, home, [make(env.core)]) for name, make in makers if name != "random"]
    return found


def transfer_table(
    pair: tuple[str, str], results: Path, options: Mapping[str, Any], episodes: int, progress: Progress
) -> tuple[list[Transferred], Path]:
    """Evaluate the agents and baselines of a quasi-static environment and of its dynamic twin on both.

    Args:
        pair: from `pair_of`.
        results: folder of the trained agents, see `candidates`.
        options: of both environments.
        episodes: how many test episodes.
        progress: called while it works.

    Returns:
        The table, and the path of its Markdown, <results>/<dynamic environment>/transfer.md.

    Raises:
        ConfigError: there is nothing to evaluate.
    """
    found = candidates(pair, results, options)
    if not found:
        raise ConfigError(f"nothing to evaluate: {pair[0]} has no baselines, and {results}/ no agents")
    table = transfer(pair, found, episodes, progress, options)
    path = results / env_options.results_name(pair[1], options) / "transfer.md"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(transfer_to_markdown(table, pair))
    return table, path
