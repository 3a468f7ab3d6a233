"""Training through the gradient of the dynamics: how each step of an episode changes with the policy is computed.

The policy of PPO acts, without noise, in `simulation.smooth.SmoothDynamics` for `horizon` steps from the beginning of
`num_envs` episodes. With e_k the tip's error after step k, tol the tolerance and q_k the joint angles, the parameters
take a step of Adam against the gradient of the mean over episodes and steps of

    c(e_k) + 5 sum_i max(0, |q_ki| - q_max + 0.06)^2 / 0.06^2,
    c(e) = log(1 + (2 e / tol)^2) / 2 + e / (100 tol) + e^2 / (e^2 + tol^2),

differentiated through all steps back to the first [Freeman2021: analytic policy gradients]. c falls all the way to the
target, and most where the tolerance begins: its sum is low where the tip is on target soon and stays. What comes after
an episode has failed counts as 8.

Outputs, actions and inputs are clipped. Beyond a bound, where a clipped number has no gradient, it has one here if a
step against it leads back: else a policy that has come to its bounds would stay there. Outputs beyond their bounds also
cost their squared excess, by a five-hundredth.

The statistics that normalize observations are those of the first updates; then they stay until PPO, if there is any,
goes on from there, whose rollouts count, too. Its value function begins as it is made.

[Freeman2021] Freeman, Frey, Raichuk, Girgin, Mordatch, Bachem, "Brax: a differentiable physics engine for large scale
rigid body simulation", NeurIPS Datasets and Benchmarks 2021.
"""

from collections.abc import Callable
from itertools import count
from types import SimpleNamespace
from typing import Any, cast

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from tensegrity_agents.config import Experiment
from tensegrity_agents.extras import need
from tensegrity_agents.sb3.correction import Correction, Course
from tensegrity_agents.sb3.history import History, Past, remembered, with_action
from tensegrity_agents.sb3.policy_file import augmentations, statistics_of
from tensegrity_envs.compiler.pytree import Row, is_row, tree_leaves, tree_map
from tensegrity_envs.core import Core
from tensegrity_envs.env import unwrapped
from tensegrity_envs.randomization import Randomization
from tensegrity_envs.simulation.protocol import RUNNING

_MEASURED = 50  # updates whose observations make the statistics
_ROOM = 0.05  # stability margin below which an arm at rest is close to buckling
_LIMIT = 0.06  # [rad] before a joint limit
_LIMIT_WEIGHT, _EXCESS_WEIGHT = 5.0, 0.002
_FAILED = 8.0  # what a step counts after a failure
_LARGEST_GRADIENT = 1.0  # norm beyond which it is shortened
# XLA fuses long chains of small operations by computing parts of them many times.
_UNFUSED = {"xla_disable_hlo_passes": "fusion,cpu-fusion,cpu-instruction-fusion"}
_MOST_SENSITIVE = 20.0  # times the median: what an episode's gradient in its state may come to, or a few would rule
_SEEDS = 1_000_000  # from one training seed to the next, as `training._reseed` has them


class SmoothEpisodes:
    """Episodes of an environment in smooth dynamics, with Torch's tensors outside and JAX within.

    Args:
        core: of the environment.
        n: how many.
        substeps: of each step.
    """

    def __init__(self, core: Core, n: int, substeps: int) -> None:
        need("jax", "training through the gradient of the dynamics needs", "jax")
        import jax

        from tensegrity_envs.simulation.smooth import SmoothDynamics
        from tensegrity_envs.simulation.smooth_rest import SmoothRest

        self.core, self.n = core, n
        self._smooth: Any = SmoothRest(core) if core.engine is None else SmoothDynamics(core, substeps)
        state = core.states.rows
        if core.engine is not None:
            # The engine's state is replaced by the inputs that the actuators have reached: in arms at rest, the inputs.
            state = state._replace(physics=state.inputs)
        numbers = count()
        self.rows: Any = tree_map(lambda row: Row(next(numbers), row.kind), state, is_row)
        self._from = [int(row) for row in tree_leaves(state, is_row)]
        self._limit = float(getattr(core.design, "joint_limit", np.inf))
        self._forward: Any = jax.jit(self._step, compiler_options=_UNFUSED)
        self._backward: Any = jax.jit(self._pulled_back, compiler_options=_UNFUSED)
        self.noisy = core.randomization.is_noisy

    def begin(self, seed: int, first: int) -> tuple[Any, torch.Tensor, dict[str, torch.Tensor]]:
        """Episodes number `first` and following of a seed: what stays the same, the states, the observations."""
        import jax.numpy as jnp

        episodes, outcomes = self.core.begin(np.full(self.n, seed), np.arange(first, first + self.n))
        rows = self.core.outcomes.rows
        parts = {"observation": rows.observation, "achieved_goal": rows.achieved, "desired_goal": rows.desired}
        seen = {
            name: torch.from_numpy(np.ascontiguousarray(outcomes[list(part)].T, np.float32))
            for name, part in parts.items()
        }
        states = torch.from_numpy(np.ascontiguousarray(outcomes[self._from], np.float32))
        self._noise_of = self._noise(episodes)
        return jnp.asarray(episodes, jnp.float32), states, seen

    def _noise(self, episodes: np.ndarray) -> Callable[[int], np.ndarray]:
        """The noise of these episodes after so many steps, as the environment has it; shape (0, n) without any."""
        count = len(self.rows.noise)
        if not self.noisy:
            return lambda step: np.zeros((0, self.n), np.float32)
        random = {name: episodes[row] for name, row in self.core.episodes.rows.random.items()}
        shares = self.core.randomization.noise_shares(random)

        def noise(step: int) -> np.ndarray:
            found = Randomization.normals(random["noise_key"], np.full(self.n, float(step)), count)
            if shares is not None:
                tip = len(self.rows.tip)
                found = np.concatenate([found[:tip] * shares[0], found[tip:] * shares[1]])
            return found.astype(np.float32)

        return noise

    def step(self, episodes: Any, states: torch.Tensor, actions: torch.Tensor, step: int) -> tuple[torch.Tensor, ...]:
        """One step of all.

        Args:
            episodes: of `begin`.
            states: shape (rows, n).
            actions: shape (n, action size).
            step: its number, from 1 on.

        Returns:
            States, observations (n, size), achieved goals (n, goal size), tip errors (n,) [m], what the joint limits
            cost (n,), and which episodes have failed (n,).
        """
        differentiable: Any = _Step.apply
        found: tuple[torch.Tensor, ...] = differentiable(self, episodes, states, actions, self._noise_of(step))
        return found

    def _step(self, episodes: Any, states: Any, actions: Any, noise: Any) -> tuple[Any, ...]:
        import jax
        import jax.numpy as jnp

        if self.noisy:
            states = states.at[jnp.array([int(row) for row in self.rows.noise])].set(noise)
        outcome, room = self._smooth.step(
            _tree(self.core.episodes.rows, episodes), _tree(self.rows, states), tuple(actions.T)
        )
        after = outcome.state

        def matrix(values: Any) -> Any:
            return jnp.stack([jnp.broadcast_to(jnp.asarray(value, jnp.float32), (self.n,)) for value in values])

        rows = matrix(tree_leaves(after, lambda value: isinstance(value, jax.Array | float | int)))
        beyond = jnp.maximum(jnp.abs(matrix(after.configuration)) - self._limit + _LIMIT, 0.0) / _LIMIT
        close = (beyond**2).sum(axis=0)
        if self.core.engine is None:
            close = close + jnp.maximum(1.0 - room / _ROOM, 0.0) ** 2
        finite = jnp.isfinite(rows).all(axis=0)
        failed = jax.lax.stop_gradient(jnp.asarray((after.failure != RUNNING) | ~finite, jnp.float32))
        told = (outcome.observation, outcome.achieved, (outcome.info[self.core.error_name], close))
        observation, achieved, (error, limits) = (jnp.where(finite, matrix(part), 0.0) for part in told)
        return jnp.where(finite, rows, states), observation.T, achieved.T, error, limits, failed

    def _pulled_back(self, episodes: Any, states: Any, actions: Any, noise: Any, gradients: Any) -> Any:
        """The gradient in states and actions, from that in the results of a step, which is computed anew for it."""
        import jax

        return jax.vjp(lambda s, a: self._step(episodes, s, a, noise), states, actions)[1](gradients)


class _Step(torch.autograd.Function):
    """A step of `SmoothEpisodes`, which Torch differentiates by JAX."""

    @staticmethod
    def forward(
        ctx: Any, env: SmoothEpisodes, episodes: Any, states: torch.Tensor, actions: torch.Tensor, noise: np.ndarray
    ) -> tuple[torch.Tensor, ...]:
        given = states.detach().numpy(), actions.detach().numpy(), noise
        ctx.env, ctx.given = env, (episodes, *given)
        return tuple(torch.from_numpy(np.array(value)) for value in env._forward(episodes, *given))

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> Any:
        found = ctx.env._backward(*ctx.given, tuple(gradient.numpy() for gradient in gradients))
        states, actions = (np.array(value) for value in found)
        lost = ~(np.isfinite(states).all(axis=0) & np.isfinite(actions).all(axis=1))  # an arm that flies apart
        states[:, lost], actions[lost] = 0.0, 0.0
        norm = np.linalg.norm(states, axis=0)
        states *= np.minimum(1.0, _MOST_SENSITIVE * np.median(norm) / np.maximum(norm, 1e-30))
        return None, None, torch.from_numpy(states), torch.from_numpy(actions), None


def _tree(rows: Any, matrix: Any) -> Any:
    """The pytree of a matrix of JAX; `Schema.unpack` is for NumPy's."""
    return tree_map(lambda row: matrix[row] != 0 if row.kind == "bool" else matrix[row], rows, is_row)


class _Returning(torch.autograd.Function):
    """Clipping whose gradient, beyond a bound, is that of the number itself where a step against it leads back."""

    @staticmethod
    def forward(ctx: Any, values: torch.Tensor, low: float, high: float) -> torch.Tensor:
        ctx.save_for_backward(values)
        ctx.bounds = low, high
        return values.clamp(low, high)

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> Any:
        (values,), (low, high), (gradient,) = ctx.saved_tensors, ctx.bounds, gradients
        leaves = ((values > high) & (gradient < 0)) | ((values < low) & (gradient > 0))
        return gradient.masked_fill(leaves, 0.0), None, None


def returning(values: torch.Tensor, low: float, high: float) -> torch.Tensor:
    """The values within [low, high]; see `_Returning`."""
    clipped: Any = _Returning.apply
    found: torch.Tensor = clipped(values, low, high)
    return found


def _clip(values: torch.Tensor, low: float, high: float) -> torch.Tensor:
    return returning(values, low, high) if values.is_floating_point() else values.clamp(low, high)


# Torch as `Correction` knows it, but for its clipping.
_RETURNING = SimpleNamespace(clip=_clip, arange=torch.arange, concatenate=torch.concatenate)


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
        core = unwrapped(gym.make(experiment.env, **experiment.training_options, **drawn)).core
        self.episodes = SmoothEpisodes(core, settings.num_envs, settings.substeps)
        self.tolerance = float(core.task.tolerance)
        described = {"env": experiment.env, "options": experiment.options, **experiment.train.model_dump(mode="json")}
        found = augmentations(described)
        self.history = next((one for one in found if isinstance(one, History)), None)
        self.correction = next((one for one in found if isinstance(one, Correction)), None)
        policy = cast(Any, model.policy)
        self.parameters = [*policy.mlp_extractor.policy_net.parameters(), *policy.action_net.parameters()]
        self.optimizer = torch.optim.Adam(self.parameters, lr=settings.learning_rate)
        self.round, self.rounds = 0, -(-settings.timesteps // (settings.horizon * settings.num_envs))
        self.success = float("nan")

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
        return {"optimizer": self.optimizer.state_dict(), "round": self.round}

    def go_on(self, state: dict[str, Any]) -> None:
        """Go on where `state` was told."""
        self.optimizer.load_state_dict(state["optimizer"])
        self.round = state["round"]

    def give(self) -> None:
        """One round."""
        self.optimizer.param_groups[0]["lr"] = self.settings.learning_rate * (1.0 - self.round / self.rounds)
        self.model.policy.set_training_mode(True)
        loss, seen = self._loss()
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

    def _loss(self) -> tuple[torch.Tensor, torch.Tensor]:
        """What is to be minimized, for the episodes of this round, and the observations before normalization."""
        n, env = self.settings.num_envs, self.episodes
        episodes, states, seen = env.begin(self.seed * _SEEDS + _SEEDS // 2, self.round * n)
        begun, memory = states, self._memory(seen["observation"])
        course = None
        if self.correction is not None:
            course = _of_torch(self.correction.begun({name: value.numpy() for name, value in seen.items()}))
        begins, alive = torch.ones(n, dtype=torch.bool), torch.ones(n)
        total, shown = torch.zeros(()), []
        for step in range(1, self.settings.horizon + 1):
            told = seen["observation"]
            if memory is not None:
                told, memory = remembered(torch, told, memory, begins)
            if self.correction is not None and course is not None:
                told = torch.cat([told, self.correction.shown(torch, course)], dim=1)
            begins = torch.zeros(n, dtype=torch.bool)
            shown.append(told.detach())
            output = self._output({**seen, "observation": told})
            actions = returning(output, -1.0, 1.0)
            excess = ((output.abs() - 1.0).clamp(min=0.0) ** 2).mean(dim=1)
            if self.correction is not None and course is not None:
                # Bounded, so that the environment has nothing to clip.
                actions = self.correction.action(_RETURNING, course, actions)
                actions = self.correction.bounded(_RETURNING, course, actions)
                course = self.correction.after(_RETURNING, course, actions)
            if memory is not None:
                memory = with_action(torch, memory, actions)
            states = torch.where(alive > 0, states, begun)  # what has failed would go on to fly apart
            states, observation, achieved, error, limits, failed = env.step(episodes, states, actions, step)
            seen = {**seen, "observation": observation, "achieved_goal": achieved}
            cost = self._cost(error) + _LIMIT_WEIGHT * limits + _EXCESS_WEIGHT * excess
            total = total + torch.where(alive > 0, cost, torch.full_like(cost, _FAILED)).mean()
            alive = alive * (1.0 - failed.detach())
        self.success = float((alive * (error.detach() <= self.tolerance)).mean())
        return total / self.settings.horizon, torch.cat(shown)

    def _cost(self, error: torch.Tensor) -> torch.Tensor:
        """The function c of the module."""
        ratio = error / self.tolerance
        square = ratio**2
        return 0.5 * torch.log1p(4.0 * square) + ratio / 100.0 + square / (square + 1.0)

    def _memory(self, observation: torch.Tensor) -> Past | None:
        """What an agent remembers before an episode; None if it remembers nothing."""
        if self.history is None:
            return None
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
