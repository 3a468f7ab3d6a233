"""The native vector environment: a `gymnasium.vector.VectorEnv` shell over a `Core`."""

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from tensegrity_envs.arms import core_of
from tensegrity_envs.core import Core
from tensegrity_envs.episodes import EpisodeQueue
from tensegrity_envs.simulation.protocol import FAILURES, RUNNING, Episode

_AHEAD = 4  # episodes drawn ahead for each environment
_REASONS = np.array(FAILURES, object)


class ManipulatorVectorEnv(VectorEnv[dict[str, np.ndarray], np.ndarray, np.ndarray]):
    """`num_envs` environments stepped as one batch, equal to single ones seeded seed + i, episode by episode.

    SAME_STEP autoreset: the step in which an episode ends returns the first observation of the next one; the last
    observation and info of the one that ended are in info["final_obs"] and info["final_info"], as Gymnasium's
    SyncVectorEnv puts them.

    Args:
        arm: the name of the environments' core in `arms.ARMS`, such as "TwoXReach", or a `Core` class of your own.
        num_envs: number of environments.
        max_episode_steps: truncation, None for none.
        **options: of the core.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(
        self,
        arm: str | type[Core],
        num_envs: int = 1,
        max_episode_steps: int | None = 100,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        if render_mode is not None:
            raise ValueError(
                f"render_mode = {render_mode!r}: "
                "the vector environment does not render; use gym.make(id, render_mode=...)"
            )
        if num_envs < 1:
            raise ValueError(f"num_envs = {num_envs}: must be at least 1")
        self.core = core_of(arm, options)
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
        self._episodes: np.ndarray | None = None  # one column for each environment
        self._states: np.ndarray
        self._masks: dict[str, np.ndarray] = {}

    @property
    def design(self) -> Any:
        """The nominal design, which controllers are told."""
        return self.core.design

    @property
    def episode(self) -> Episode:
        """The present episodes, with their hidden parameters of shape (num_envs,) (privileged)."""
        return self.core.episodes.unpack(self._running())  # type: ignore[no-any-return]

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
        if self._episodes is None and not mask.all():
            raise ValueError("reset_mask: the first reset must begin all environments")
        if self._queue is None:
            self._queue = EpisodeQueue(self.core, self.np_random.integers(2**31, size=self.num_envs), _AHEAD)
        for i in np.flatnonzero(mask):
            if seeds[i] is not None:
                self._queue.restart(int(i), seeds[i])
        whole = self._episodes is None or mask.all()
        running = None if whole else self.core.tell(self._running(), self._states)
        outcomes = self._begin(np.flatnonzero(mask), running)
        if stagger and self.max_episode_steps is not None:
            self._steps[mask] = (np.arange(self.num_envs) * self.max_episode_steps // self.num_envs)[mask]
        return self._observation(outcomes), self._info(outcomes)

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
        episodes = self._running()
        array = np.array(actions, float)
        if array.shape != self.action_space.shape:
            raise ValueError(
                f"actions of shape {array.shape}: must be {self.action_space.shape}, increments in [-1, 1]"
            )
        if not np.isfinite(array).all():
            raise ValueError(
                f"actions: environment {int(np.argmin(np.isfinite(array).all(axis=1)))} got one that is not finite"
            )
        np.clip(array, -1.0, 1.0, out=array)
        outcomes = self.core.step(episodes, self._states, np.ascontiguousarray(array.T))
        self._steps += 1
        rows = self.core.outcomes.rows
        terminated = outcomes[rows.state.failure] != RUNNING
        truncated = np.zeros(self.num_envs, bool)
        if self.max_episode_steps is not None:
            truncated = self._steps >= self.max_episode_steps
        ended = terminated | truncated
        info = self._info(outcomes)
        if ended.any():
            observation, info = self._autoreset(outcomes, info, ended)
        else:
            observation = self._observation(outcomes)
            self._states = outcomes[: self.core.states.size].copy()  # info holds views, which their owner may change
        return observation, outcomes[rows.reward], terminated, truncated, info

    def _autoreset(
        self, outcomes: np.ndarray, last_info: dict[str, Any], ended: np.ndarray
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin the next episodes; what was last seen of those that ended moves into final_obs and final_info."""
        index = np.flatnonzero(ended)
        final = np.full(self.num_envs, None, object)
        last = self._observation(outcomes, index)
        each = [  # written out: where many episodes end, this takes long
            {"observation": o, "achieved_goal": a, "desired_goal": d}
            for o, a, d in zip(last["observation"], last["achieved_goal"], last["desired_goal"], strict=True)
        ]
        final[index] = np.fromiter(each, object, len(each))
        new = self._begin(index, outcomes)
        info = self._info(new)
        info["final_obs"], info["_final_obs"] = final, ended
        info["final_info"] = last_info | dict.fromkeys(self._masks, ended)
        info["_final_info"] = ended
        return self._observation(new), info

    def _running(self) -> np.ndarray:
        if self._episodes is None:
            raise RuntimeError("call reset() before the first step")
        return self._episodes

    def _begin(self, index: np.ndarray, outcomes: np.ndarray | None) -> np.ndarray:
        """Begin the next episode in the environments at `index`; returns the outcomes with theirs replaced.

        Without outcomes: in all environments.
        """
        assert self._queue is not None
        if self._episodes is None or outcomes is None:
            episodes = np.empty((self.core.episodes.size, self.num_envs))
            new = np.empty((self.core.outcomes.size, self.num_envs))
        else:
            episodes, new = self._episodes, outcomes.copy()
        self._queue.begin(index, episodes, new)
        self._episodes = episodes
        self._steps[index] = 0
        self._states = new[: self.core.states.size].copy()
        return new

    def _observation(self, outcomes: np.ndarray, index: Any = slice(None)) -> dict[str, np.ndarray]:
        """Of all environments, or of those at `index`."""
        rows = self.core.outcomes.rows
        seen = outcomes[rows.observation[0] : rows.desired[-1] + 1, index].T.astype(np.float32, order="C")
        size, end = len(rows.observation), len(rows.observation) + len(rows.achieved)
        return {
            "observation": seen[:, :size],
            "achieved_goal": seen[:, size:end],
            "desired_goal": seen[:, end:],
        }

    def _info(self, outcomes: np.ndarray) -> dict[str, Any]:
        """The info of some outcomes: views of their rows."""
        info: dict[str, Any] = {}
        for name, first, end, kind in self.core.info_entries:
            if end is not None:
                info[name] = outcomes[first:end].T
            elif kind == "float":
                info[name] = outcomes[first]
            else:
                info[name] = outcomes[first] != 0 if kind == "bool" else outcomes[first].astype(np.int64)
        info["step"] = self._steps.copy()
        info["termination_reason"] = _REASONS[info["failure"]]
        if not self._masks:
            self._masks = {f"_{key}": self._all for key in info}
        return info | self._masks

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads of a dynamic simulation."""
        if self.core.engine is not None:
            self.core.engine.model.close()

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> Any:
        """See `ManipulatorEnv.compute_reward`; `info` may also be the dict of arrays that `step` returns."""
        return self.core.compute_reward(achieved_goal, desired_goal, info)

    def compute_terminated(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> Any:
        """See `ManipulatorEnv.compute_terminated`; `info` may also be the dict of arrays that `step` returns."""
        return self.core.compute_terminated(achieved_goal, desired_goal, info)

    def compute_truncated(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: dict[str, Any]) -> Any:
        """Whether that step reached the time limit; `info` is the dict of arrays that `step` returns."""
        if self.max_episode_steps is None:
            return np.zeros(len(achieved_goal), bool)
        return np.asarray(info["step"]) >= self.max_episode_steps
