"""Training through the gradient of the dynamics: how each step of an episode changes with the policy is computed.

The policy of PPO acts, without noise, in `simulation.smooth.SmoothDynamics` for `horizon` steps from the beginning of
`num_envs` episodes. With e_k the tip's error after step k, tol the tolerance and q_k the joint angles, the parameters
take a step of Adam against the gradient of the mean over episodes and steps of

    c(e_k) + 20 sum_i max(0, |q_ki| - q_max + 0.05)^2 / 0.05^2,
    c(e) = log(1 + (2 e / tol)^2) / 2 + e / (100 tol) + e^2 / (e^2 + tol^2),

differentiated through all steps back to the first [Freeman2021: analytic policy gradients]. c falls all the way to the
target, and most where the tolerance begins: its sum is low where the tip is on target soon and stays. A share
`settling` of c(e_k) is replaced by what the largest error to come costs, E_k, the largest of e_k, e_(k+1), ...,

    r / (1 + r) + log(1 + r) / 10,    r = (E_k / tol)^4,

whose sum tells the time to settle: a tip that leaves the tolerance again costs all the time before. What comes after an
episode has failed counts as 8. Every fourth update goes on with the episodes of the one before, from where they are, so
that the policy learns to rest on the target, too; gradients do not go back into the update before. Episodes that are
not on target at the end of an update are begun again with probability `repeat_failed`.

Outputs, actions and inputs are clipped. Beyond a bound, where a clipped number has no gradient, it has one here if a
step against it leads back: else a policy that has come to its bounds would stay there. Outputs beyond their bounds also
cost their squared excess, by a five-hundredth.

The statistics that normalize observations are those of the first updates; then they stay until PPO, if there is any,
goes on from there, whose rollouts count, too. Its value function begins as it is made.

[Freeman2021] Freeman, Frey, Raichuk, Girgin, Mordatch, Bachem, "Brax: a differentiable physics engine for large scale
rigid body simulation", NeurIPS Datasets and Benchmarks 2021.
"""

from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from tensegrity_agents.config import Experiment
from tensegrity_agents.sb3.clipping import returning
from tensegrity_agents.sb3.correction import Course
from tensegrity_agents.sb3.history import History, Past, remembered, with_action
from tensegrity_agents.sb3.policy_file import augmentations, statistics_of
from tensegrity_agents.sb3.smooth_episodes import SmoothEpisodes
from tensegrity_envs.compiler.pytree import is_array, tree_leaves, tree_map
from tensegrity_envs.env import unwrapped

_MEASURED = 50  # updates whose observations make the statistics
_LIMIT_WEIGHT, _EXCESS_WEIGHT = 20.0, 0.002
_GOES_ON = 4  # the last of so many updates goes on where the one before ended
_FAILED = 8.0  # what a step counts after a failure
_LARGEST_GRADIENT = 1.0  # norm beyond which it is shortened
_SEEDS = 1_000_000  # from one training seed to the next, as `training._reseed` has them


def _clip(values: torch.Tensor, low: float, high: float) -> torch.Tensor:
    return returning(values, low, high) if values.is_floating_point() else values.clamp(low, high)


# Torch as `Correction` knows it, but for its clipping.
_RETURNING = SimpleNamespace(
    clip=_clip,
    arange=torch.arange,
    concatenate=torch.concatenate,
    asarray=torch.as_tensor,
)


class _Running(NamedTuple):
    """Episodes on their way.

    Attributes:
        numbers: which episodes they are, shape (n,).
        episodes: what stays the same, shape (rows, n).
        begun: states with which they began, shape (rows, n).
        states: where they are.
        seen: the observations, by name.
        memory: what the agent remembers, `Past`; () if it remembers nothing.
        course: what is remembered of the controller that it corrects; () without.
        alive: 1 for those that have not failed, 0 for the others, shape (n,).
        step: how many there were.
    """

    numbers: np.ndarray
    episodes: np.ndarray
    begun: torch.Tensor
    states: torch.Tensor
    seen: dict[str, torch.Tensor]
    memory: Any
    course: Any
    alive: torch.Tensor
    step: int

    def detached(self) -> "_Running":
        """The same, which no gradient goes back from."""
        running: _Running = tree_map(lambda tensor: tensor.detach(), self, torch.is_tensor)
        return running

    def state(self) -> list[Any]:
        """As a checkpoint holds it."""
        return [*tree_leaves(self, _is_part), self.step]

    def of(self, state: list[Any]) -> "_Running":
        """From a checkpoint, into the form of this one."""
        parts = iter(state)
        found: _Running = tree_map(lambda part: _like(part, next(parts)), self, _is_part)
        return found._replace(step=int(next(parts)))


def _is_part(value: Any) -> bool:
    return torch.is_tensor(value) or is_array(value)


def _like(part: Any, stored: Any) -> Any:
    return torch.as_tensor(stored) if torch.is_tensor(part) else np.asarray(stored)


class Descent:
    """Updates of a policy by the gradient of the dynamics, one for each round.

    Args:
        experiment: whose `train.gradient` says how.
        model: of PPO.
        env: its environments, whose statistics normalize observations.
        seed: of the training.

    Attributes:
        round: how many are over.
        success: share of the latest round's episodes that were on target at their end.
    """

    def __init__(self, experiment: Experiment, model: PPO, env: VecNormalize, seed: int) -> None:
        settings = experiment.train.gradient
        assert settings is not None
        self.settings, self.model, self.env, self.seed = settings, model, env, seed
        levels = experiment.train.levels
        drawn: dict[str, Any] = {} if levels is None else {"level": levels}
        core = unwrapped(gym.make(experiment.env, **(experiment.training_options | drawn))).core
        self.episodes = SmoothEpisodes(core, settings.num_envs, settings.substeps, settings.most_sensitive)
        self.tolerance = float(core.task.tolerance)
        described = {"env": experiment.env, "options": experiment.options, **experiment.train.model_dump(mode="json")}
        found = augmentations(described)
        self.history = next((one for one in found if isinstance(one, History)), None)
        self.correction: Any = next((one for one in found if not isinstance(one, History)), None)
        policy = cast(Any, model.policy)
        self.parameters = [*policy.mlp_extractor.policy_net.parameters(), *policy.action_net.parameters()]
        self.optimizer = torch.optim.Adam(self.parameters, lr=settings.learning_rate)
        self.round, self.rounds = 0, -(-settings.timesteps // (settings.horizon * settings.num_envs))
        self.success = float("nan")
        self.repeats = experiment.train.repeat_failed
        self.missed = np.zeros(0, np.int64)  # numbers of episodes that were not on target
        self.running: _Running | None = None  # that the next round goes on with

    @property
    def timesteps(self) -> int:
        """How many there are in all rounds."""
        return self.rounds * self.settings.horizon * self.settings.num_envs

    def begin(self) -> None:
        """Begin episodes of the environments, which PPO goes on with."""
        self.model._last_obs = self.env.reset()
        self.model._last_episode_starts = np.ones(self.env.num_envs, bool)
        if self.correction is not None:  # at first the plan as it is
            policy = cast(Any, self.model.policy)
            with torch.no_grad():
                policy.action_net.weight *= 0.1
                policy.action_net.bias *= 0.0

    def state(self) -> dict[str, Any]:
        """All that determines what follows, beside model and statistics."""
        running = None if self.running is None else self.running.state()
        own = {"round": self.round, "running": running, "missed": self.missed}
        return {"optimizer": self.optimizer.state_dict(), **own}

    def go_on(self, state: dict[str, Any]) -> None:
        """Go on where `state` was told."""
        self.optimizer.load_state_dict(state["optimizer"])
        self.round, self.missed = state["round"], np.asarray(state["missed"])
        self.running = None if state["running"] is None else self._begun().of(state["running"])

    def give(self) -> None:
        """One round."""
        self.optimizer.param_groups[0]["lr"] = self.settings.learning_rate * (1.0 - self.round / self.rounds)
        self.model.policy.set_training_mode(True)
        begun = self.running or self._begun()
        loss, seen, reached = self._loss(begun)
        self.running = reached if self.round % _GOES_ON == _GOES_ON - 2 else None
        self.optimizer.zero_grad()
        torch.autograd.backward(loss)
        norm = torch.nn.utils.clip_grad_norm_(self.parameters, _LARGEST_GRADIENT)
        if bool(torch.isfinite(norm)):
            self.optimizer.step()
        self.model.policy.set_training_mode(False)
        if self.round < _MEASURED:
            statistics_of(self.env).update(seen.numpy())
        self.round += 1
        self.model.num_timesteps += self.settings.horizon * self.settings.num_envs

    def _begun(self) -> _Running:
        """Episodes that begin in this round."""
        n = self.settings.num_envs
        chance = np.random.default_rng((self.seed, self.round))
        again = self.missed[chance.random(len(self.missed)) < self.repeats][:n]
        numbers = np.concatenate([again, self.round * n + np.arange(n - len(again))])
        episodes, states, seen = self.episodes.begin(self.seed * _SEEDS + _SEEDS // 2, numbers)
        course: Any = ()
        if self.correction is not None:
            begun = self.correction.begun({name: value.numpy() for name, value in seen.items()})
            course = _of_torch(begun) if isinstance(begun, Course) else begun
        memory = self._memory(seen["observation"])
        return _Running(numbers, episodes, states, states, seen, memory, course, torch.ones(n), 0)

    def _loss(self, running: _Running) -> tuple[torch.Tensor, torch.Tensor, _Running]:
        """What is to be minimized, the observations before normalization, and where the episodes have come to."""
        numbers, episodes, begun, states, seen, memory, course, alive, before = running
        n, env, correction = self.settings.num_envs, self.episodes, self.correction
        told_of = env.go_on(episodes)
        begins = torch.full((n,), before == 0)
        costs, errors, lives, shown = [], [], [], []
        for step in range(before + 1, before + self.settings.horizon + 1):
            told = seen["observation"]
            if memory:
                told, memory = remembered(torch, told, memory, begins)
            if correction is not None:
                if step > 1:
                    course = correction.asked({name: value.detach().numpy() for name, value in seen.items()}, course)
                told = torch.cat([told, correction.shown(_RETURNING, course)], dim=1)
            begins = torch.zeros(n, dtype=torch.bool)
            shown.append(told.detach())
            output = self._output({**seen, "observation": told})
            actions = returning(output, -1.0, 1.0)
            excess = ((output.abs() - 1.0).clamp(min=0.0) ** 2).mean(dim=1)
            if correction is not None:
                # Bounded, so that the environment has nothing to clip.
                actions = correction.action(_RETURNING, course, actions)
                actions = correction.bounded(_RETURNING, course, actions)
                course = correction.after(_RETURNING, course, actions)
            if memory:
                memory = with_action(torch, memory, actions)
            states = torch.where(alive > 0, states, begun)  # what has failed would go on to fly apart
            states, observation, achieved, error, limits, failed = env.step(told_of, states, actions, step)
            seen = {**seen, "observation": observation, "achieved_goal": achieved}
            costs.append(_LIMIT_WEIGHT * limits + _EXCESS_WEIGHT * excess)
            errors.append(torch.where(alive > 0, error, torch.zeros_like(error)))
            lives.append(alive)
            alive = alive * (1.0 - failed.detach())
        on_target = alive * (error.detach() <= self.tolerance)
        self.success, self.missed = float(on_target.mean()), numbers[on_target.numpy() == 0]
        step = before + self.settings.horizon
        reached = _Running(numbers, episodes, begun, states, seen, memory, course, alive, step)
        cost = torch.stack(costs) + self._cost_of(torch.stack(errors))
        loss = torch.where(torch.stack(lives) > 0, cost, torch.full_like(cost, _FAILED)).mean()
        return loss, torch.cat(shown), reached.detached()

    def _cost_of(self, errors: torch.Tensor) -> torch.Tensor:
        """What tip errors (steps, n) [m] cost in each step."""
        share = self.settings.settling
        cost = self._cost(errors)
        if share:
            to_come = errors.flip(0).cummax(dim=0).values.flip(0)
            fourth = (to_come / self.tolerance) ** 4
            cost = (1.0 - share) * cost + share * (fourth / (1.0 + fourth) + 0.1 * torch.log1p(fourth))
        return cost

    def _cost(self, error: torch.Tensor) -> torch.Tensor:
        """The function c of the module."""
        ratio = error / self.tolerance
        square = ratio**2
        return 0.5 * torch.log1p(4.0 * square) + ratio / 100.0 + square / (square + 1.0)

    def _memory(self, observation: torch.Tensor) -> Any:
        """What an agent remembers before an episode; () if it remembers nothing."""
        if self.history is None:
            return ()
        n, steps, size = len(observation), self.history.length, self.history.observation_size
        actions = torch.zeros(n, steps, self.history.action_size)
        return Past(torch.zeros(n, steps, size), actions, torch.zeros(n, size))

    def _output(self, seen: dict[str, torch.Tensor]) -> torch.Tensor:
        """What the policy says, not clipped, where this is observed."""
        rms = statistics_of(self.env)
        mean = torch.as_tensor(rms.mean, dtype=torch.float32)
        deviation = torch.as_tensor(np.sqrt(rms.var + self.env.epsilon), dtype=torch.float32)
        most = float(self.env.clip_obs)
        normal = {**seen, "observation": ((seen["observation"] - mean) / deviation).clamp(-most, most)}
        output: torch.Tensor = self.model.policy.get_distribution(cast(Any, normal)).mode()
        return output


def _of_torch(course: Course) -> Course:
    """What is remembered, as tensors."""
    return Course(*(torch.from_numpy(np.ascontiguousarray(part)) for part in course))
