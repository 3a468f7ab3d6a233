"""Training in segments, with checkpoints from which a run that was stopped at any moment goes on.

A segment begins with freshly reset environments and reseeded random numbers, both functions of (seed, segment) alone.
A checkpoint within a segment also holds the states of environments and random numbers, and is made between two
rollouts: after a time, and when the process is asked to stop (SIGINT, SIGTERM). What a teacher shows (see
`teacher_student`) is the first segment, and its rounds are rollouts. For PPO, recurrent or not, a resumed run therefore
repeats exactly what an uninterrupted one would have done (same machine, same number of threads). Off-policy algorithms
also need their replay buffer, which is not kept: after a resume they begin a new segment, and the buffer fills anew
before learning goes on, so their results differ from an uninterrupted run, though not in kind.
"""

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import VecNormalize

from tensegrity_agents import env_options
from tensegrity_agents.config import Experiment
from tensegrity_agents.sb3 import random_numbers
from tensegrity_agents.sb3.algorithms import make_environment, make_model
from tensegrity_agents.sb3.checkpoint import (
    CHECKPOINT,
    Progressed,
    adapter_of,
    go_on,
    keep,
    restore,
    running_state,
    with_later_settings,
)
from tensegrity_agents.sb3.curve import (
    CURVE,
    CURVE_COLUMNS,
    EVALUATIONS,
    CompleteEpisodes,
    Evaluations,
    read_curve,
    write_curve,
)
from tensegrity_agents.sb3.descent import Descent
from tensegrity_agents.sb3.errors import TrainingError, TrainingInterruptedError
from tensegrity_agents.sb3.policy_file import Normalization, TrainedPolicy, plain_policy, save_policy
from tensegrity_agents.sb3.privileged import PrivilegedPolicy, actor_of
from tensegrity_agents.sb3.stopping import stopping
from tensegrity_agents.sb3.teacher_student import Lessons

__all__ = [
    "CHECKPOINT",
    "CURVE",
    "CURVE_COLUMNS",
    "EVALUATIONS",
    "TrainingError",
    "TrainingInterruptedError",
    "read_curve",
    "train",
    "with_later_settings",
]
# progress(timesteps, total, success share of the latest episodes)
Progress = Callable[[int, int, float], None]


class _Training(BaseCallback):
    """One training: its model and environments, how far it has come, and what is done between two rollouts."""

    def __init__(
        self, experiment: Experiment, seed: int, folder: Path, progress: Progress | None, checkpoint_seconds: float
    ) -> None:
        super().__init__()
        self.experiment, self.seed, self.folder = experiment, seed, folder
        self.report, self.checkpoint_seconds = progress, checkpoint_seconds
        self.settings = experiment.train
        self.on_policy = self.settings.is_on_policy
        self.options = env_options.canonical(experiment.env, experiment.options)
        self.described = {
            "env": experiment.env,
            "seed": seed,
            "options": self.options,
            **self.settings.model_dump(mode="json"),
        }
        self.env = make_environment(experiment)
        self.algorithm = make_model(experiment, self.env, seed)
        limit = experiment.training_options.get("max_episode_steps", gym.spec(experiment.env).max_episode_steps)
        self.episodes = CompleteEpisodes(self.env.num_envs, None if limit == -1 else limit, self.on_policy)
        self.evaluate = Evaluations(experiment)
        self.lessons: Lessons | None = None
        self.descent: Descent | None = None
        self.taught = 0  # time steps by a teacher or a gradient
        self.goes_on = False  # with them, also where an interrupt came before their first round
        if self.settings.teacher is not None:
            assert isinstance(self.algorithm, PPO)
            shell = adapter_of(self.env).shell
            self.lessons = Lessons(experiment, self.algorithm, self.env, shell)
            self.taught = self.lessons.timesteps
        if self.settings.gradient is not None:
            assert isinstance(self.algorithm, PPO)
            self.descent = Descent(experiment, self.algorithm, self.env, seed)
            self.taught = self.descent.timesteps
        self.rows: list[list[float]] = []
        self.evaluations: list[list[float]] = []
        self.segment, self.segment_end = 0, 0
        self.seconds = 0.0  # spent before this process
        self.begun = self.saved = self.shown = time.monotonic()

    def resume(self) -> None:
        """Go on from the checkpoint in the folder.

        Raises:
            TrainingError: it is of another experiment or cannot be read.
        """
        path = self.folder / CHECKPOINT
        found = restore(path, self.described, self.algorithm, self.env)
        self.seconds = found.seconds
        self.segment, self.rows, self.evaluations = found.segment, found.rows, found.evaluations
        if found.episodes is not None:
            self.episodes.go_on(found.episodes)
        if found.running is not None and found.segment_end is not None:
            try:
                go_on(found.running, self.algorithm, self.env)
            except (KeyError, TypeError, ValueError) as error:
                raise TrainingError(
                    f"{path}: does not fit ({error}); delete it (or use --fresh) to start anew"
                ) from error
            self.segment_end = found.segment_end
        if found.segment > 0:
            self.lessons = self.descent = None
        first = self.lessons or self.descent
        if first is not None and found.teaching is not None:
            first.go_on(found.teaching)
            self.goes_on = True

    def run(self) -> None:
        """Train to the end.

        Raises:
            TrainingInterruptedError: a signal asked to stop.
        """
        total, model = self.settings.total_timesteps, self.algorithm
        self.begun = time.monotonic() - self.seconds
        with stopping() as self.stop:
            if self.settings.corrects is not None and self.descent is None and model.num_timesteps == 0:
                _correct_nothing(model)
            if self.lessons is not None:
                self._be_taught(self.lessons)
            if self.descent is not None:
                self._descend(self.descent)
            while model.num_timesteps < total:
                if model.num_timesteps >= self.segment_end:
                    _reseed(model, self.env, self.seed, self.segment)
                    self.episodes.reset()
                    self.segment_end = min(model.num_timesteps + self.settings.segment_timesteps, total)
                amount = self.segment_end - model.num_timesteps
                model.learn(amount, callback=self, reset_num_timesteps=False, log_interval=10)
                self.segment += 1
                if model.num_timesteps >= total:
                    self._evaluate()
                self._keep(within=False)
                if self.stop.number is not None and model.num_timesteps < total:
                    raise TrainingInterruptedError(model.num_timesteps, self.stop.number)

    @property
    def share_done(self) -> float:
        """Of the training by reinforcement, from 0 to 1."""
        done, total = (count - self.taught for count in (self.algorithm.num_timesteps, self.settings.total_timesteps))
        return min(max(done / max(total, 1), 0.0), 1.0)

    def _be_taught(self, lessons: Lessons) -> None:
        """The first segment of a training with a teacher."""
        self._begin_first(lessons)
        while lessons.round < lessons.rounds:
            self._between_rollouts()
            lessons.give(self._after_step)
        self.lessons = None
        self._end_first()

    def _descend(self, descent: Descent) -> None:
        """The first segment of a training by the gradient of the dynamics."""
        self._begin_first(descent)
        self._report(descent.success)  # compiling comes first, which takes a while
        while descent.round < descent.rounds:
            self._between_rollouts()
            descent.give()
            now = time.monotonic()
            if now - self.shown >= 1.0:
                nothing = float("nan")  # no episode comes to its end
                row = [now - self.begun, float(self.algorithm.num_timesteps), descent.success, nothing, nothing]
                self.rows.append(row)
                self._report(descent.success)
        self.descent = None
        self._end_first()

    def _begin_first(self, first: Lessons | Descent) -> None:
        """Begin a first segment that is not PPO's."""
        if not self.goes_on:
            _reseed(self.algorithm, self.env, self.seed, self.segment)
            self.episodes.reset()
            first.begin()
            self.segment_end = self.taught

    def _end_first(self) -> None:
        """Go on to PPO, or to the end."""
        self.segment += 1
        if self.algorithm.num_timesteps >= self.settings.total_timesteps:
            self._evaluate()
        self._keep(within=False)

    def agent(self) -> TrainedPolicy:
        """What has been trained so far."""
        settings = self.settings
        description = {
            "env": self.experiment.env,
            "options": self.options,
            "algorithm": settings.algorithm,
            "net_arch": settings.net_arch,
            "activation": settings.activation,
            "goal_error_scales": settings.goal_error_scales,
            "goal_is_angles": settings.goal_is_angles,
            "goal_scale": settings.goal_scale,
            "model_hints": settings.model_hints,
            "history": settings.history,
            "levels": settings.levels,
            "corrects": None if settings.corrects is None else settings.corrects.model_dump(mode="json"),
            "lstm_hidden_size": settings.lstm_hidden_size,
            "seed": self.seed,
            "timesteps": self.algorithm.num_timesteps,
            "training_seconds": round(time.monotonic() - self.begun, 1),
            "train": settings.model_dump(mode="json"),
        }
        policy = self.algorithm.policy
        if isinstance(policy, PrivilegedPolicy):
            policy = actor_of(policy, plain_policy(description))
        return TrainedPolicy(policy, Normalization.of(self.env), description)

    def _on_rollout_start(self) -> None:
        self._between_rollouts()
        self._set_exploration()

    def _set_exploration(self) -> None:
        """What the settings say about exploration and about training the value function alone."""
        if not self.on_policy:
            return
        ppo, policy = self.settings.ppo, cast(Any, self.algorithm.policy)
        if ppo.log_std_end is not None:
            policy.log_std.data.fill_(ppo.log_std_init + (ppo.log_std_end - ppo.log_std_init) * self.share_done)
        done = self.algorithm.num_timesteps - self.taught
        begins_well = self.taught > 0 or self.settings.corrects is not None
        warm = begins_well and done < ppo.value_rollouts * ppo.n_steps * ppo.num_envs
        for parameters in (policy.mlp_extractor.policy_net, policy.action_net):
            parameters.requires_grad_(not warm)
        policy.log_std.requires_grad_(ppo.log_std_end is None and not warm)

    def _between_rollouts(self) -> None:
        """Evaluate, keep what there is, or stop, if it is time."""
        now = time.monotonic()
        if self.evaluate.is_due(self.algorithm.num_timesteps, self.evaluations):
            self._evaluate()
        if self.stop.number is not None:
            self._keep(within=True)
            raise TrainingInterruptedError(self.algorithm.num_timesteps, self.stop.number)
        if now - self.saved >= self.checkpoint_seconds:
            self._keep(within=True)

    def _on_step(self) -> bool:
        self._after_step(self.locals["dones"], self.locals["infos"])
        return True

    def _after_step(self, dones: np.ndarray, infos: list[dict[str, Any]]) -> None:
        """Add a step of all environments to the curve."""
        self.episodes.add(dones, infos)
        now = time.monotonic()
        if now - self.shown < (1.0 if self.on_policy else 5.0):
            return
        means = self.episodes.means()
        if means is not None:
            self.rows.append([now - self.begun, float(self.algorithm.num_timesteps), *means])
        self._report(float("nan") if means is None else means[0])

    def _report(self, success: float) -> None:
        """Show how far the training has come, and the success of its latest episodes."""
        self.shown = time.monotonic()
        if self.report is not None:
            done, total = self.algorithm.num_timesteps, self.settings.total_timesteps
            self.report(min(done, total), total, success)

    def _evaluate(self) -> None:
        """Add a point to the curve without noise; neither time nor random numbers of the training are spent."""
        begun = time.monotonic()
        kept = random_numbers.get_state()
        row = self.evaluate(self.agent(), begun - self.begun, self.algorithm.num_timesteps)
        self.evaluations.append(row)
        random_numbers.set_state(kept)
        self.begun += time.monotonic() - begun

    def _keep(self, within: bool) -> None:
        """Write a checkpoint and the curves.

        Args:
            within: a segment, else at its end.
        """
        model, env = self.algorithm, self.env
        running = running_state(model, env) if within and self.on_policy else None
        segment = self.segment + (within and running is None)
        end = self.segment_end if running else None
        seconds, episodes = time.monotonic() - self.begun, self.episodes.state()
        write_curve(self.folder / CURVE, self.rows)
        write_curve(self.folder / EVALUATIONS, self.evaluations)
        first = self.lessons or self.descent
        teaching = first.state() if within and first is not None else None
        so_far = Progressed(seconds, segment, end, self.rows, self.evaluations, episodes, running, teaching)
        keep(self.folder / CHECKPOINT, self.described, model, env, so_far)
        self.saved = time.monotonic()


def _correct_nothing(model: BaseAlgorithm) -> None:
    """Let a policy begin as the controller that it corrects."""
    policy = cast(Any, model.policy)
    with torch.no_grad():
        policy.action_net.weight *= 0.0
        policy.action_net.bias *= 0.0


def check_trainable(experiment: Experiment) -> None:
    """Make environments and model of a training, and nothing else: what cannot be made raises its error here."""
    _Training(experiment, experiment.seeds[0], Path(), None, math.inf).env.close()


def train(
    experiment: Experiment,
    seed: int,
    folder: Path,
    progress: Progress | None = None,
    resume: bool = True,
    checkpoint_seconds: float = 30.0,
) -> TrainedPolicy:
    """Train one agent, or go on with it, and save its policy in `folder`.

    Args:
        experiment: environment and settings.
        seed: of this agent; environments, networks and exploration all follow from it.
        folder: gets checkpoint.pt, progress.csv, evaluation.csv, tensorboard/, and in the end policy.safetensors and
            policy.json.
        progress: called a few times a second.
        resume: go on from the checkpoint in the folder if there is one.
        checkpoint_seconds: a checkpoint at least so often, beside those at the ends of segments.

    Raises:
        TrainingError: the checkpoint there is of another experiment or cannot be read.
        TrainingInterruptedError: a signal asked to stop; a checkpoint is written.
    """
    torch.set_num_threads(experiment.train.threads)
    training = _Training(experiment, seed, folder, progress, checkpoint_seconds)
    model, total = training.algorithm, experiment.train.total_timesteps
    folder.mkdir(parents=True, exist_ok=True)
    if resume and (folder / CHECKPOINT).is_file():
        training.resume()
    model.set_logger(configure(str(folder / "tensorboard"), ["tensorboard"]))
    # SB3 tells a schedule the progress within one call of learn(); ours is over the whole training.
    settings = experiment.train
    rate = (settings.ppo if settings.is_on_policy else settings.off_policy).learning_rate
    model.lr_schedule = lambda _: rate * (1.0 - training.share_done)
    training.run()
    if progress is not None:
        progress(total, total, training.evaluations[-1][2] if training.evaluations else float("nan"))
    agent = training.agent()
    save_policy(folder, agent)
    training.env.close()
    model.policy.set_training_mode(False)
    return agent


def _reseed(model: BaseAlgorithm, env: VecNormalize, seed: int, segment: int) -> None:
    """Begin a segment: new episodes, and random numbers that depend on (seed, segment) alone."""
    mixed = int(np.random.SeedSequence([seed, segment]).generate_state(1)[0])
    random_numbers.reseed(mixed)
    model.action_space.seed(mixed)
    env.seed(seed * 1_000_000 + segment * env.num_envs)  # below VALIDATION_SEED
    model._last_obs = None  # learn() then resets the environments
    model.ep_info_buffer = model.ep_info_buffer or None
