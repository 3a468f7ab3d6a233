"""Episodes of an environment in smooth dynamics: Torch's tensors outside, JAX within."""

from collections.abc import Callable
from itertools import count
from typing import Any

import numpy as np
import torch

from tensegrity_agents.extras import need
from tensegrity_envs.compiler.pytree import Row, is_row, tree_leaves, tree_map
from tensegrity_envs.core import Core
from tensegrity_envs.randomization import Randomization
from tensegrity_envs.simulation.protocol import RUNNING

_ROOM = 0.05  # stability margin below which an arm at rest is close to buckling
_LIMIT = 0.05  # [rad] before a joint limit
# XLA fuses long chains of small operations by computing parts of them many times.
_UNFUSED = {"xla_disable_hlo_passes": "fusion,cpu-fusion,cpu-instruction-fusion"}


class SmoothEpisodes:
    """Episodes of an environment in smooth dynamics, with Torch's tensors outside and JAX within.

    Args:
        core: of the environment.
        n: how many.
        substeps: of each step.
        most_sensitive: times the median to which an episode's gradient in its state is shortened in every step, so that
            a few do not rule; what is shortened is biased. None shortens none.
    """

    def __init__(self, core: Core, n: int, substeps: int, most_sensitive: float | None = None) -> None:
        need("jax", "training through the gradient of the dynamics needs", "jax")
        import jax

        from tensegrity_envs.simulation.smooth import SmoothDynamics
        from tensegrity_envs.simulation.smooth_rest import SmoothRest

        self.core, self.n, self.most_sensitive = core, n, most_sensitive
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

    def begin(self, seed: int, numbers: np.ndarray) -> tuple[np.ndarray, torch.Tensor, dict[str, torch.Tensor]]:
        """Episodes of a seed by their numbers (n,): what stays the same, the states, the observations."""
        episodes, outcomes = self.core.begin(np.full(self.n, seed), numbers)
        rows = self.core.outcomes.rows
        parts = {"observation": rows.observation, "achieved_goal": rows.achieved, "desired_goal": rows.desired}
        seen = {
            name: torch.from_numpy(np.ascontiguousarray(outcomes[list(part)].T, np.float32))
            for name, part in parts.items()
        }
        states = torch.from_numpy(np.ascontiguousarray(outcomes[self._from], np.float32))
        return episodes, states, seen

    def go_on(self, episodes: np.ndarray) -> Any:
        """What `step` is told of episodes of `begin`."""
        import jax.numpy as jnp

        self._noise_of = self._noise(episodes)
        return jnp.asarray(episodes, jnp.float32)

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
            episodes: of `go_on`.
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
        if ctx.env.most_sensitive is not None:
            norm = np.linalg.norm(states, axis=0)
            states *= np.minimum(1.0, ctx.env.most_sensitive * np.median(norm) / np.maximum(norm, 1e-30))
        return None, None, torch.from_numpy(states), torch.from_numpy(actions), None


def _tree(rows: Any, matrix: Any) -> Any:
    """The pytree of a matrix of JAX; `Schema.unpack` is for NumPy's."""
    return tree_map(lambda row: matrix[row] != 0 if row.kind == "bool" else matrix[row], rows, is_row)
