"""`compute_reward` for other goals: steps that have been taken are evaluated anew, from what `info` tells of them."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_envs.batch import Batch
from tensegrity_envs.compiler.namespace import Components
from tensegrity_envs.simulation.protocol import RUNNING, State

# The info of one step, of several in a sequence or in a dict of arrays, or none at all.
Infos = Mapping[str, Any] | Sequence[Mapping[str, Any]] | np.ndarray | None


def _is_empty(info: Infos) -> bool:
    """Whether there is no info: None, an empty dict, or several of them."""
    if info is None or isinstance(info, dict):
        return not info
    return isinstance(info, Sequence | np.ndarray) and all(one is None or one == {} for one in info)


class Relabelling(Batch):
    """Reward and end of steps that have been taken, as they would be with other goals."""

    def compute_reward(self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Infos) -> Any:
        """Reward of the dense or sparse form for any goals, as `step` gives it. See `ManipulatorEnv.compute_reward`."""
        achieved, desired, single = self._goals(achieved_goal, desired_goal)
        if not len(achieved):
            return np.zeros(0)
        if self.task.reward_type == "sparse" and self.task.goals_decide and _is_empty(info):
            if isinstance(info, Sequence | np.ndarray) and len(info) != len(achieved):
                raise ValueError(f"{len(info)} infos for {len(achieved)} goals: there must be one for each")
            error = self.error(np, tuple(achieved.T), tuple(desired.T))
            reward = np.where(error <= self.task.tolerance, 1.0, 0.0)
            return float(reward[0]) if single else reward
        outcomes, single = self._relabelled(achieved_goal, desired_goal, info)
        reward = outcomes[self.outcomes.rows.reward]
        return float(reward[0]) if single else reward

    def compute_terminated(self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Infos) -> Any:
        """Whether the episode failed in that step."""
        if np.ndim(achieved_goal) == 2 and np.shape(achieved_goal)[0] == 0:
            return np.zeros(0, bool)
        outcomes, single = self._relabelled(achieved_goal, desired_goal, info)
        failed = outcomes[self.outcomes.rows.state.failure] != RUNNING
        return bool(failed[0]) if single else failed

    def _relabelled(self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Infos) -> tuple[np.ndarray, bool]:
        """The outcomes with other goals, and whether there is one only, without a batch."""
        achieved, desired, single = self._goals(achieved_goal, desired_goal)
        batch = self.infos(info, None if single else len(achieved), self.reward_keys)
        episode = self.episode_with_goal(batch, tuple(desired.T))
        episode = episode._replace(random=self.random_from(batch))
        n = len(achieved)
        if self.randomization.is_noisy:
            achieved = np.asarray(batch["true_goal"], float)
        # What the reward does not depend on (velocities, noise, records) is left at zero.
        state = self.states.unpack(np.zeros((self.states.size, n)))._replace(
            configuration=tuple(batch["configuration"].T),
            inputs=tuple(batch[self.input_name].T) if self.input_name in batch else (),
            tip=tuple(achieved.T[: len(self.states.rows.tip)]),
            stability_margin=batch["stability_margin"],
            wrench_margin=batch["wrench_margin"],
            failure=batch["failure"],
            time=batch["step"],
            clearance=batch.get("clearance"),
        )
        state = self.with_achieved(state, tuple(achieved.T))
        return self.evaluate(self.episodes.pack(episode, n), self.states.pack(state, n)), single

    def random_from(self, info: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The randomized quantities, from `info`; see `Episode.random`."""
        return {name: np.asarray(info[f"random_{name}"], float) for name in self.episodes.rows.random}

    def with_achieved(self, state: State, achieved: Components) -> State:
        """The state whose achieved goal is this one."""
        return state._replace(tip=achieved)

    def _goals(self, achieved: ArrayLike, desired: ArrayLike) -> tuple[np.ndarray, np.ndarray, bool]:
        """Goals as (n, size) arrays, and whether there is one only, without a batch."""
        achieved, desired = np.asarray(achieved, float), np.asarray(desired, float)
        single, size = achieved.ndim == 1, self.observation_space["achieved_goal"].shape
        assert size is not None
        if achieved.shape != desired.shape or achieved.shape[-1:] != size or achieved.ndim > 2:
            raise ValueError(
                f"goals of shapes {achieved.shape} and {desired.shape}: "
                f"both must be {size} or (n, {size[0]}), in metres"
            )
        if not (np.isfinite(achieved).all() and np.isfinite(desired).all()):
            raise ValueError("goals: must be finite numbers")
        return np.atleast_2d(achieved), np.atleast_2d(desired), single

    @cached_property
    def reward_keys(self) -> list[str]:
        """Names of the entries of `info` that `compute_reward` needs."""
        keys = ["configuration", "stability_margin", "wrench_margin", "failure", "step", *self.hidden_info_keys]
        keys += [self.input_name] if self.input_name else []
        keys += [f"random_{name}" for name in self.episodes.rows.random]
        keys += ["clearance"] if self.states.rows.clearance is not None else []
        keys += ["true_goal"] if self.randomization.is_noisy else []
        return keys

    def infos(self, info: Infos, count: int | None, keys: list[str]) -> dict[str, np.ndarray]:
        """Infos as one dict of arrays.

        Args:
            info: a dict for one step; a sequence of dicts or a dict of arrays for several.
            count: the number of steps; None for one without a batch.
            keys: the entries that are needed.

        Raises:
            ValueError: entries are missing, or there are not so many.
        """
        n = 1 if count is None else count
        missing = ValueError(
            f"compute_reward needs the info of every step (the {self.task.reward_type} reward of this task "
            "depends on more than the goals): with Stable-Baselines3, HerReplayBuffer(copy_info_dict=True)"
        )
        if info is None or (isinstance(info, dict) and not info):
            raise missing
        if isinstance(info, dict) and count is None:
            info = [info]
        if isinstance(info, dict):
            if absent := [key for key in keys if key not in info]:
                raise ValueError(f"info lacks {absent}: pass the info that step returned")
            wanted = [*keys, *(["time_limit"] if "time_limit" in info else [])]
            told = {key: np.asarray(info[key]) for key in wanted}
            if wrong := [key for key, array in told.items() if array.shape[:1] != (n,)]:
                raise ValueError(f"info: {wrong[0]!r} has not {n} values, one for each goal")
            return told
        if not isinstance(info, Sequence | np.ndarray) or isinstance(info, str):
            raise ValueError(f"info = {info!r}: must be a dict, or a sequence of dicts, one for each goal")
        if len(info) != n:
            raise ValueError(f"{len(info)} infos for {n} goals: there must be one for each")
        if any(not isinstance(one, dict) or key not in one for one in info for key in keys):
            raise missing
        return {key: np.array([one[key] for one in info]) for key in keys}
