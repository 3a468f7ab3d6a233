"""From a comparison to its table, figures, video and report."""

import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from matplotlib.figure import Figure

from tensegrity_agents.config import Experiment
from tensegrity_agents.controllers.base import Controller
from tensegrity_agents.env_options import short_name
from tensegrity_agents.evaluation.results import Comparison, Progress
from tensegrity_agents.evaluation.rollout import begin_episodes
from tensegrity_agents.reporting import figures, path_figures, style, table, video
from tensegrity_agents.reporting.report import collect_metadata, write_report
from tensegrity_envs.seeding import TEST_SEED
from tensegrity_envs.vector_env import step_info

_PATHS = 12  # episodes whose joint paths are drawn
_WORKSPACE_EPISODES = 300
_TITLES = {
    "success": "success by controller",
    "scores": "score by controller",
    "error": "distribution of final errors",
    "steps": "success over the steps",
    "tracking": "distance from the moving goal",
    "joint_space": "paths in joint space",
    "tip_paths": "paths of the tip",
    "workspace": "targets of the agent's episodes",
    "learning_curve": "training",
}


def write_comparison(
    experiment: Experiment, comparison: Comparison, folder: Path, progress: Progress
) -> tuple[Path, list[table.Row]]:
    """Write summary.md, figures, video and report.html.

    Returns:
        The path of report.html, and the rows of the table.
    """
    runs = comparison.runs
    envs = _vector(experiment, 1)
    core: Any = envs.unwrapped.core
    rows = table.summary_rows(runs, float(core.reach))
    (folder / "summary.md").write_text(table.to_markdown(rows) + "\n\n" + table.verdict(rows) + "\n")
    pictures = folder / "figures"
    pictures.mkdir(exist_ok=True)
    look = style.looks({run.controller: run.kind for run in runs})
    shown = {name: c for name, c in comparison.controllers.items() if name != "random"}
    agent = next(iter(comparison.controllers))
    cycle = core.task.goal_cycle
    steps = 7 if core.task.has_score or cycle else 8
    done = 0

    def drawn(what: str) -> None:
        nonlocal done
        done += 1
        progress("drawing", done, steps, what)

    made: dict[str, Path] = {}

    def keep(name: str, figure: Figure) -> None:
        made[name] = style.save(figure, pictures / name, f"{short_name(experiment.env)}: {_TITLES[name]}")
        drawn(name)

    keep("success", figures.success_bars(rows))
    if core.task.has_score:
        keep("scores", figures.scores(runs))
    else:
        keep("error", figures.error_distribution(runs, core.task.tolerance))
        keep("steps", figures.success_over_steps(runs))
    if cycle:
        errors = {name: _tracking_errors(controller, experiment) for name, controller in shown.items()}
        keep("tracking", figures.tracking_errors(errors, core.task.tolerance, cycle, look))
    region = core.tip_region()
    if region is not None:  # paths in space are left to the film
        paths = {name: _paths(controller, experiment, _PATHS) for name, controller in shown.items()}
        if core.shows_joint_space:
            joints = {name: path[0] for name, path in paths.items()}
            keep("joint_space", path_figures.joint_space(core.design, joints, look))
        else:
            tips = {name: list(ends.paths or ()) for name, (_, ends) in paths.items()}
            targets = next(iter(paths.values()))[1].target
            keep("tip_paths", path_figures.tip_paths(path_figures.inside(region), tips, targets, look))
        endings = _paths(comparison.controllers[agent], experiment, _WORKSPACE_EPISODES)[1]
        keep("workspace", path_figures.workspace(path_figures.inside(region), endings, agent))
    first = next(iter(comparison.curves))
    keep("learning_curve", figures.learning_curve(comparison.curves[first], comparison.evaluations.get(first)))
    film = video.record(
        experiment.env,
        comparison.controllers,
        TEST_SEED + experiment.video_episode,
        folder / "side_by_side.gif",
        max_steps=cycle or gym.spec(experiment.env).max_episode_steps or 100,
        env_options=experiment.options,
    )
    drawn("video")
    descriptions = list(comparison.descriptions.values())
    command = "python " + " ".join(sys.argv)
    report = write_report(
        folder,
        title=f"{short_name(experiment.env)}: {agent} against the analytic controllers",
        env_id=experiment.env,
        rows=rows,
        runs=runs,
        metadata=collect_metadata(
            command, experiment.model_dump(mode="json"), {"training": experiment.seeds, "first test episode": TEST_SEED}
        ),
        figures=made,
        video=film,
        training={
            "runs": len(descriptions),
            "timesteps": descriptions[0]["timesteps"],
            "seconds": descriptions[0]["training_seconds"],
            "config": experiment.train.model_dump(mode="json"),
        },
        command=command,
    )
    drawn("report")
    return report, rows


def _vector(experiment: Experiment, count: int) -> Any:
    return gym.make_vec(
        experiment.env,
        count,
        vectorization_mode="vector_entry_point",
        autoreset_mode="SameStep",
        **experiment.options,
    )


def _tracking_errors(controller: Controller, experiment: Experiment, count: int = 300) -> np.ndarray:
    """Distance from the moving goal [m] after every step of the first test episodes, (steps, n); NaN once failed."""
    envs = _vector(experiment, count)
    observation, _ = envs.reset(seed=TEST_SEED)
    begin_episodes(controller, envs.unwrapped, count)
    errors: list[np.ndarray] = []
    state, begun, alive = None, np.ones(count, bool), np.ones(count, bool)
    while alive.any():
        actions, state = controller.predict(observation, state=state, episode_start=begun, deterministic=True)
        observation, _, terminated, truncated, info = envs.step(actions)
        begun = terminated | truncated
        alive = alive & ~terminated
        errors.append(np.where(alive, step_info(info)["tip_error"], np.nan))
        alive = alive & ~truncated
    return np.stack(errors)


def _paths(controller: Controller, experiment: Experiment, count: int) -> tuple[list[np.ndarray], path_figures.Endings]:
    """Joint paths and tip positions of the first test episodes."""
    envs = _vector(experiment, count)
    observation, info = envs.reset(seed=TEST_SEED)
    begin_episodes(controller, envs.unwrapped, count)
    start, target = observation["achieved_goal"].copy(), observation["desired_goal"].copy()
    joints, tips = [info["configuration"]], [start]
    length = np.zeros(count, int)
    success = np.zeros(count, bool)
    state: object = None
    begun, alive = np.ones(count, bool), np.ones(count, bool)
    while alive.any():
        actions, state = controller.predict(observation, state=state, episode_start=begun, deterministic=True)
        observation, _, terminated, truncated, info = envs.step(actions)
        begun = terminated | truncated
        last, tip = step_info(info), observation["achieved_goal"].copy()
        q, hit = last["configuration"], last["is_success"]
        for i in np.flatnonzero(begun):
            tip[i] = info["final_obs"][i]["achieved_goal"]
        joints.append(q)
        tips.append(tip)
        length[alive] += 1
        success[alive] = hit[alive]
        alive &= ~begun
    all_joints, all_tips = np.stack(joints), np.stack(tips)
    ends = path_figures.Endings(
        start,
        target,
        all_tips[length, np.arange(count)],
        success,
        [all_tips[: length[i] + 1, i] for i in range(count)],
    )
    return [all_joints[: length[i] + 1, i] for i in range(count)], ends
