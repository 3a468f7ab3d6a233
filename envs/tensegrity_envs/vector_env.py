"""The native vector environment: a `gymnasium.vector.VectorEnv` shell over `Core`, on arrays."""

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from tensegrity_envs.core import Core, Episode, information, total_reward
from tensegrity_envs.episodes import EpisodeQueue, put
from tensegrity_envs.simulation.protocol import FAILURES, RUNNING, State

_AHEAD = 4  # episodes drawn ahead for each environment
_REASONS = np.array(FAILURES, object)


class TwoXReachVectorEnv(VectorEnv[dict[str, np.ndarray], np.ndarray, np.ndarray]):
    """`num_envs` reaching environments stepped as one batch, equal to single ones seeded seed + i, episode by episode.

    SAME_STEP autoreset: the step in which an episode ends returns the first observation of the next one; the last
    observation and info of the one that ended are in info["final_obs"] and info["final_info"], as Gymnasium's
    SyncVectorEnv puts them.

    Args:
        num_envs: number of environments.
        max_episode_steps: truncation, None for none.
        **options: as for `TwoXReachEnv`.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(
        self, num_envs: int = 1, max_episode_steps: int | None = 100, render_mode: str | None = None, **options: Any
    ) -> None:
        if render_mode is not None:
            raise ValueError(
                f"render_mode = {render_mode!r}: "
                "the vector environment does not render; use gym.make(id, render_mode=...)"
            )
        if num_envs < 1:
            raise ValueError(f"num_envs = {num_envs}: must be at least 1")
        self.core = Core(**options)
        self.num_envs = num_envs
        self.max_episode_steps = max_episode_steps
        self.render_mode = None
        self.single_observation_space = self.core.observation_space
        self.single_action_space = self.core.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._queue: EpisodeQueue | None = None
        self._steps = np.zeros(num_envs, np.int64)
        self._all = np.ones(num_envs, bool)
        self._episode: Episode | None = None
        self._state: State

    @property
    def design(self) -> Any:
        """The nominal design, which controllers are told."""
        return self.core.design

    @property
    def true_design(self) -> Any:
        """The design with the hidden parameters of the present episodes, fields of shape (num_envs,) (privileged)."""
        return self._running().mechanism.design

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin new episodes in all environments, or in those of options["reset_mask"].

        Args:
            seed: environment i gets seed + i; or a list of one seed (or None) for each.
            options: {"reset_mask": boolean array of shape (num_envs,)}; {"stagger": True} spreads the time limits of
                these first episodes evenly, so that a learner never sees all environments in the same phase of an
                episode.

        Raises:
            ValueError: a seed list or mask of the wrong length, an unknown option.
        """
        given = dict(options or {})
        stagger = bool(given.pop("stagger", False))
        mask = np.asarray(given.pop("reset_mask", self._all))
        if given:
            raise ValueError(f"reset options {list(given)}: there are 'reset_mask' and 'stagger'")
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise ValueError(f"reset_mask: must be a boolean array of shape ({self.num_envs},) with at least one True")
        seeds = self._given_seeds(seed)
        if self._episode is None and not mask.all():
            raise ValueError("reset_mask: the first reset must begin all environments")
        if self._queue is None:
            self._queue = EpisodeQueue(self.core, self.np_random.integers(2**31, size=self.num_envs), _AHEAD)
        for i in np.flatnonzero(mask):
            if seeds[i] is not None:
                self._queue.restart(int(i), seeds[i])
        self._begin(np.flatnonzero(mask))
        if stagger and self.max_episode_steps is not None:
            self._steps[mask] = (np.arange(self.num_envs) * self.max_episode_steps // self.num_envs)[mask]
        episode = self._running()
        return self._observation(episode, self._state), self._outcome(episode, self._state)[1]

    def _given_seeds(self, seed: int | list[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int | np.integer):
            super().reset(seed=int(seed))
            return [int(seed) + i for i in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"{len(seed)} seeds for {self.num_envs} environments")
        return list(seed)

    def step(self, actions: Any) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance all environments by one step; those whose episode ends begin their next one.

        Raises:
            ValueError: the actions are not a finite array of shape (num_envs, action size).
            RuntimeError: before the first reset.
        """
        episode = self._running()
        array = np.asarray(actions, float)
        if array.shape != self.action_space.shape:
            raise ValueError(
                f"actions of shape {array.shape}: must be {self.action_space.shape}, increments in [-1, 1]"
            )
        if not np.isfinite(array).all():
            raise ValueError(
                f"actions: environment {int(np.argmin(np.isfinite(array).all(axis=1)))} got one that is not finite"
            )
        self._state = self.core.advance(episode, self._state, tuple(np.clip(array, -1.0, 1.0).T))
        self._steps += 1
        reward, info = self._outcome(episode, self._state)
        observation = self._observation(episode, self._state)
        terminated = self._state.failure != RUNNING
        truncated = np.zeros(self.num_envs, bool)
        if self.max_episode_steps is not None:
            truncated = self._steps >= self.max_episode_steps
        ended = terminated | truncated
        if ended.any():
            observation, info = self._autoreset(observation, info, ended)
        return observation, reward, terminated, truncated, info

    def _autoreset(
        self, observation: dict[str, np.ndarray], info: dict[str, Any], ended: np.ndarray
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin the next episodes; what was last seen of those that ended moves into final_obs and final_info."""
        index = np.flatnonzero(ended)
        final = np.full(self.num_envs, None, object)
        for i in index:
            final[i] = {key: value[i] for key, value in observation.items()}
        episode, state = self._begin(index)
        merged_observation = _put(observation, self._observation(episode, state), index)
        merged_info = _put(info, self._outcome(episode, state)[1], index)
        final_info = {key: ended if key.startswith("_") else value for key, value in info.items()}
        return merged_observation, merged_info | {
            "final_obs": final,
            "_final_obs": ended,
            "final_info": final_info,
            "_final_info": ended,
        }

    def _running(self) -> Episode:
        if self._episode is None:
            raise RuntimeError("call reset() before the first step")
        return self._episode

    def _begin(self, index: np.ndarray) -> tuple[Episode, State]:
        """Begin the next episode in the environments at `index`; returns those episodes and states."""
        assert self._queue is not None
        begun = self._queue.pop(index)
        self._steps[index] = 0
        if self._episode is None or len(index) == self.num_envs:
            self._episode, self._state = begun
        else:
            self._episode, self._state = put((self._episode, self._state), begun, index)
        return begun

    def _observation(self, episode: Episode, state: State) -> dict[str, np.ndarray]:
        parts = self.core.observation(state)
        observation = np.empty((len(state.failure), len(parts)), np.float32)
        for column, part in enumerate(parts):
            observation[:, column] = part
        return {
            "observation": observation,
            "achieved_goal": np.stack(state.tip, axis=1).astype(np.float32),
            "desired_goal": np.stack(episode.goal, axis=1).astype(np.float32),
        }

    def _outcome(self, episode: Episode, state: State) -> tuple[np.ndarray, dict[str, Any]]:
        """Reward and info of a state of all environments, or of those that have just begun."""
        core, count = self.core, len(state.failure)
        x, y = (tip.astype(np.float32).astype(float) - goal for tip, goal in zip(state.tip, episode.goal, strict=True))
        error = np.hypot(x, y)
        terms = core.task.reward_terms(np, error, state, episode.solutions)
        payload = np.broadcast_to(episode.mechanism.design.payload, (count,))
        info = information(core, state, error, terms, payload)
        info["configuration"] = np.stack(state.configuration, axis=1)
        info["tensions"] = np.stack(state.inputs, axis=1)
        info["step"] = self._steps.copy() if count == self.num_envs else np.zeros(count, np.int64)
        info["termination_reason"] = _REASONS[state.failure]
        info |= {f"_{key}": self._all for key in info}
        return np.asarray(total_reward(terms)), info

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> Any:
        """See `TwoXReachEnv.compute_reward`; `info` may also be the dict of arrays that `step` returns."""
        return self.core.compute_reward(achieved_goal, desired_goal, info)

    def compute_terminated(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> Any:
        """See `TwoXReachEnv.compute_terminated`; `info` may also be the dict of arrays that `step` returns."""
        return self.core.compute_terminated(achieved_goal, desired_goal, info)

    def compute_truncated(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: dict[str, Any]) -> Any:
        """Whether that step reached the time limit; `info` is the dict of arrays that `step` returns."""
        if self.max_episode_steps is None:
            return np.zeros(len(achieved_goal), bool)
        return np.asarray(info["step"]) >= self.max_episode_steps


def _put(whole: dict[str, Any], part: dict[str, Any], index: np.ndarray) -> dict[str, Any]:
    """Copies of the arrays in `whole` with the rows at `index` taken from `part`; masks stay as they are."""
    merged = dict(whole)
    for key, value in part.items():
        if not key.startswith("_"):
            merged[key] = whole[key].copy()
            merged[key][index] = value
    return merged
