"""The native vector environment: a `gymnasium.vector.VectorEnv` shell over a `Core`."""

from functools import cached_property
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike

from tensegrity_envs import columns
from tensegrity_envs.batch import InfoEntry
from tensegrity_envs.compiler.pytree import empty_matrix
from tensegrity_envs.compiler.threads import Threads
from tensegrity_envs.core import Core
from tensegrity_envs.environments import core_of
from tensegrity_envs.episodes import EpisodeQueue, checked_options, episodes_ahead
from tensegrity_envs.relabelling import Infos
from tensegrity_envs.rendering import checked_size
from tensegrity_envs.seeding import checked_episode, checked_seed
from tensegrity_envs.simulation.protocol import Episode
from tensegrity_envs.vector_arguments import checked_count, checked_info, checked_limit, checked_mode, for_each
from tensegrity_envs.vector_info import InfoTable, step_info
from tensegrity_envs.vector_rendering import Tiles

__all__ = ["ManipulatorVectorEnv", "step_info"]

_NOBODY = np.zeros(0, np.int64)


class ManipulatorVectorEnv(VectorEnv[dict[str, np.ndarray], np.ndarray, np.ndarray]):
    """`num_envs` environments stepped as one batch, equal to single ones seeded seed + i, episode by episode.

    What happens where an episode ends is Gymnasium's convention, by `autoreset_mode`, and equals that of a
    `SyncVectorEnv` of the single environments in the same mode:

    - "NextStep" (the default, as Gymnasium's own): the step after an episode's last one ignores the action and returns
      the first observation of the next episode, with a reward of 0.
    - "SameStep": the step in which an episode ends returns the first observation of the next one; the last observation
      and info of the one that ended are in info["final_obs"] and info["final_info"] (see `step_info`).
    - "Disabled": environments whose episode has ended must be reset with options={"reset_mask": ...}.

    Nothing that is handed out is the environment's own memory. The masks of an info are one array, which cannot be
    written to.

    Args:
        arm: the name of their core in `environments.ARMS`, such as "TwoXReach", or a `Core` class of your own, itself
            or as "module:Class", which specs can hold as JSON.
        num_envs: number of environments.
        max_episode_steps: truncation; None or -1 for none.
        autoreset_mode: "NextStep", "SameStep", "Disabled", or a `gymnasium.vector.AutoresetMode`. Only the strings
            survive `spec.to_json()`.
        info: "full", "goal" (what `compute_reward` needs, and is_success) or "none", which are cheaper; `final_obs` and
            `final_info` come in any case.
        threads: that compute the quasi-static steps of many environments, on as many processor cores: results are the
            same to the last bit. One for every 256 environments at most; a dynamic simulation has its own.
        render_mode: None or "rgb_array" (one picture for each environment).
        render_size: side of a picture, or (width, height) [pixels].
        **options: of the core.

    Raises:
        ValueError: an argument is out of range; the message names it.
        TypeError: an argument is unknown; the message says which there are.
    """

    metadata = {  # noqa: RUF012  (Gymnasium's convention)
        "render_modes": ["rgb_array"],
        "render_fps": 20,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        arm: str | type[Core],
        num_envs: int = 1,
        max_episode_steps: int | None = 100,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        info: str = "full",
        threads: int = 1,
        render_mode: str | None = None,
        render_size: int | tuple[int, int] = 300,
        **options: Any,
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ValueError(
                f"render_mode = {render_mode!r}: must be None or 'rgb_array'; "
                "the single environment, gym.make(id), has others"
            )
        count = checked_count(num_envs)
        self._wanted = checked_info(info)
        team = Threads(threads)
        self._threads = team if team.count > 1 else None
        self.max_episode_steps = checked_limit(max_episode_steps)
        self.autoreset_mode = checked_mode(autoreset_mode)
        size = checked_size(render_size)
        self.metadata = self.metadata | {"autoreset_mode": self.autoreset_mode}
        self.core = core_of(arm, options)
        self.num_envs = count
        self.render_mode = render_mode
        self.single_observation_space = self.core.observation_space
        self.single_action_space = self.core.action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._actions_shape = self.action_space.shape
        self._tiles = Tiles(self.core, self.num_envs, size) if render_mode else None
        self._queue: EpisodeQueue | None = None
        self._steps = np.zeros(self.num_envs, np.int64)  # since the episodes began
        self._ahead_of_time = np.zeros(self.num_envs, np.int64)  # by which staggered time limits come earlier
        self._is_staggered = False
        self._ended = np.zeros(self.num_envs, bool)  # in the last step, and not begun anew yet
        self._episodes: np.ndarray | None = None  # one column for each environment
        self._outcomes: np.ndarray  # of the last step, likewise
        self._some_ended = False
        self._index = np.zeros(self.num_envs + 1, np.int64)  # of those that ended, and how many
        self._wrong = np.zeros(1, np.int64)
        self._table: InfoTable | None = None

    @property
    def design(self) -> Any:
        """The nominal design, which controllers are told."""
        return self.core.design

    @property
    def episode(self) -> Episode:
        """The present episodes, with their hidden parameters of shape (num_envs,) (privileged)."""
        return self.core.episodes.unpack(self._running().copy())

    @property
    def episode_numbers(self) -> np.ndarray:
        """Numbers of the running episodes among those of their seeds, counted from 0, shape (num_envs,)."""
        self._running()
        assert self._queue is not None
        return self._queue.numbers

    @property
    def matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """Copies of the matrices of the present episodes and of the latest outcomes (privileged); see `Core`."""
        return self._running().copy(), self._outcomes.copy()

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin new episodes in all environments, or in those of options["reset_mask"].

        The info tells of the environments that begin an episode; its masks say which.

        Args:
            seed: environment i gets seed + i; or a list of one seed (or None) for each. Any non-negative integers.
            options: {"reset_mask": boolean array of shape (num_envs,)}; {"episode": k} or {"episode": [k, ...]} begins
                the k-th episode of each seed, counted from 0; {"stagger": True} spreads the time limits of these first
                episodes evenly, so that a learner never sees all environments in the same phase of an episode (info
                then tells each episode's "time_limit").

        Raises:
            ValueError: a seed list or mask of the wrong length, a number that is no whole one, an unknown option.
        """
        given = checked_options(options)
        stagger = given.pop("stagger", False)
        mask = np.array(given.pop("reset_mask", np.ones(self.num_envs, bool)))
        episode = given.pop("episode", None)
        if given:
            raise ValueError(f"reset options {list(given)}: there are 'reset_mask', 'episode' and 'stagger'")
        if not isinstance(stagger, bool):
            raise ValueError(f"stagger = {stagger!r}: must be True or False")
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise ValueError(f"reset_mask: must be a boolean array of shape ({self.num_envs},) with at least one True")
        if self._episodes is None and not mask.all():
            raise ValueError("reset_mask: the first reset must begin all environments")
        seeds = for_each(self.num_envs, seed, "seeds", checked_seed, 1)
        episodes = for_each(self.num_envs, episode, "episodes", checked_episode, 0)
        if isinstance(seed, int | np.integer):
            super().reset(seed=int(seed))
        if self._queue is None:
            own = self.np_random.integers(2**31, size=self.num_envs)
            self._queue = EpisodeQueue(self.core, own, episodes_ahead(self.num_envs))
        for i in np.flatnonzero(mask):
            if seeds[i] is not None or episodes[i] is not None:
                self._queue.restart(int(i), seeds[i], episodes[i] or 0)
        self._begin(np.flatnonzero(mask))
        self._ended = self._ended & ~mask
        self._some_ended = bool(self._ended.any())
        self._is_staggered &= not mask.all()
        if stagger and self.max_episode_steps is not None:
            self._is_staggered = True
            self._ahead_of_time[mask] = (np.arange(self.num_envs) * self.max_episode_steps // self.num_envs)[mask]
        if self._tiles is not None:
            self._tiles.follow(self._outcomes, mask)
        return self._observation(self._outcomes), self._info(
            self._outcomes, None if mask.all() else np.flatnonzero(mask)
        )

    def step(
        self, actions: ArrayLike
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance all environments by one step; see the class for what happens where an episode ends.

        Raises:
            ValueError: the actions are not a finite array of shape (num_envs, action size).
            RuntimeError: before the first reset; autoreset is disabled, and an episode that has ended was not reset.
        """
        episodes, skipped = self._running(), self._ended
        renewed = np.flatnonzero(skipped) if self._some_ended else _NOBODY
        if len(renewed) and self.autoreset_mode is AutoresetMode.DISABLED:
            raise RuntimeError(
                f"the episodes of environments {renewed.tolist()} have ended, and autoreset is disabled: "
                'call reset(options={"reset_mask": terminated | truncated}) first'
            )
        actions = self._checked_actions(actions, skipped)
        if len(renewed):  # their action is ignored; stepping them along and putting them back keeps it one batch
            self._begin(renewed)
        outcomes = self.core.step(episodes, self._outcomes, actions, self._threads)
        if len(renewed):
            columns.put_back.run(self._outcomes, renewed, outcomes)
        self._outcomes = outcomes
        n = self.num_envs
        reward, flags, ended = np.empty(n), np.empty((2, n), bool), np.empty(n, bool)
        columns.ends.run(
            self._rows_of_ends, outcomes, skipped, self._steps, self._ahead_of_time, reward, flags, ended, self._index
        )
        count = int(self._index[n])
        self._ended, self._some_ended = ended, count > 0
        if self._tiles is not None:
            self._tiles.follow(outcomes, skipped)
        final = self._same_step(count) if count and self.autoreset_mode is AutoresetMode.SAME_STEP else {}
        observation, info = self._observation(self._outcomes), self._info(self._outcomes)
        info.update(final)
        terminated, truncated = flags
        return observation, reward, terminated, truncated, info

    def _checked_actions(self, actions: ArrayLike, skipped: np.ndarray) -> np.ndarray:
        """The actions as columns, clipped to [-1, 1]; those that are skipped are 0."""
        array = np.asarray(actions)
        if array.shape != self._actions_shape:
            raise ValueError(f"actions of shape {array.shape}: must be {self._actions_shape}, increments in [-1, 1]")
        given = empty_matrix(array.shape[1], array.shape[0])
        if array.dtype == np.float32:
            columns.actions_of_singles.run(np.ascontiguousarray(array), skipped, given, self._wrong)
        else:
            columns.actions_of_doubles.run(np.ascontiguousarray(array, float), skipped, given, self._wrong)
        if self._wrong[0] < self.num_envs:
            raise ValueError(f"actions: environment {self._wrong[0]} got one that is not finite")
        return given

    def _same_step(self, count: int) -> dict[str, Any]:
        """Begin the next episodes of those that ended; what was last seen of them, as entries of info."""
        ended, index = self._ended, self._index[:count].copy()
        final = np.empty(self.num_envs, object)  # None
        last = self._observation(self._outcomes, index)
        each = zip(index.tolist(), last["observation"], last["achieved_goal"], last["desired_goal"], strict=True)
        for i, seen, at, to in each:
            final[i] = {"observation": seen, "achieved_goal": at, "desired_goal": to}
        final_info = self._info(self._outcomes, index)
        self._begin(index)
        self._ended, self._some_ended = np.zeros(self.num_envs, bool), False
        if self._tiles is not None:
            self._tiles.follow(self._outcomes, ended)
        return {"final_obs": final, "_final_obs": ended, "final_info": final_info, "_final_info": ended.copy()}

    def _running(self) -> np.ndarray:
        if self._episodes is None:
            raise RuntimeError("call reset() before the first step")
        return self._episodes

    def _begin(self, index: np.ndarray) -> None:
        """Begin the next episode in the environments at `index`."""
        assert self._queue is not None
        if self._episodes is None:
            episodes = empty_matrix(self.core.episodes.size, self.num_envs)
            outcomes = empty_matrix(self.core.outcomes.size, self.num_envs)
        else:
            episodes, outcomes = self._episodes, self._outcomes
        self._queue.begin(index, episodes, outcomes)  # which changes nothing where drawing fails
        self._episodes, self._outcomes = episodes, outcomes
        self._steps[index] = 0
        self._ahead_of_time[index] = 0

    def _observation(self, outcomes: np.ndarray, index: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Of all environments, or of those at `index`."""
        count = self.num_envs if index is None else len(index)
        size, goal_size = self._seen_sizes
        seen, achieved = np.empty((count, size), np.float32), np.empty((count, goal_size), np.float32)
        desired = np.empty((count, goal_size), np.float32)
        if index is None:
            columns.see.run(self._rows_seen, outcomes, seen, achieved, desired)
        else:
            columns.see_some.run(self._rows_seen, outcomes, index, seen, achieved, desired)
        return {"observation": seen, "achieved_goal": achieved, "desired_goal": desired}

    @cached_property
    def _rows_seen(self) -> np.ndarray:
        rows = self.core.outcomes.rows
        return np.array([rows.observation[0], rows.achieved[0], rows.desired[0]], np.int64)

    @cached_property
    def _seen_sizes(self) -> tuple[int, int]:
        rows = self.core.outcomes.rows
        return len(rows.observation), len(rows.achieved)

    @cached_property
    def _rows_of_ends(self) -> np.ndarray:
        rows = self.core.outcomes.rows
        limit = -1 if self.max_episode_steps is None else self.max_episode_steps
        return np.array([rows.reward, rows.state.failure, limit], np.int64)

    def _info(self, outcomes: np.ndarray, index: np.ndarray | None = None) -> dict[str, Any]:
        """The info of some outcomes, of all environments or of those at `index`; zero for all others."""
        if self._wanted == "none":
            return {}
        limit = self.max_episode_steps if self._is_staggered else None
        if self._table is None or self._table.limit != limit:
            self._table = InfoTable(self._entries(), self.num_envs, limit)
        return self._table.told(outcomes, self._steps, self._ahead_of_time, index)

    def _entries(self) -> list[InfoEntry]:
        """Those of `info` that are wanted."""
        entries = self.core.info_entries
        wanted = {*self.core.reward_keys, "is_success"}
        return entries if self._wanted == "full" else [entry for entry in entries if entry.name in wanted]

    def get_state(self) -> dict[str, Any]:
        """All that determines what follows, the coming episodes included, for `set_state` of any vector of this id and
        size; a copy.

        Raises:
            RuntimeError: before the first reset.
        """
        episodes = self._running()
        assert self._queue is not None
        return {
            "of": f"{self.num_envs} x {self.core.fingerprint}",
            "episodes": episodes.copy(),
            "outcomes": self._outcomes.copy(),
            "steps": self._steps.copy(),
            "ahead_of_time": self._ahead_of_time.copy(),
            "is_staggered": self._is_staggered,
            "ended": self._ended.copy(),
            **self._queue.state(),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Go on from a state that `get_state` told.

        Raises:
            ValueError: it is the state of another environment, or of another number of them.
        """
        if self._queue is None:
            self._queue = EpisodeQueue(self.core, np.zeros(self.num_envs, np.int64), episodes_ahead(self.num_envs))
        n = self.num_envs
        shapes = {"episodes": (self.core.episodes.size, n), "outcomes": (self.core.outcomes.size, n)}
        self._queue.check(state, shapes, f"{n} x {self.core.fingerprint}")
        for name, kind in (("steps", "i"), ("ahead_of_time", "i"), ("ended", "b")):
            array = state.get(name)
            if not isinstance(array, np.ndarray) or array.shape != (n,) or array.dtype.kind != kind:
                raise ValueError(f"state: {name!r} must be an array of shape ({n},), as get_state() returned it")
        if not isinstance(state.get("is_staggered"), bool):
            raise ValueError("state: 'is_staggered' must be a truth, as get_state() returned it")
        self._episodes, self._outcomes = (empty_matrix(*state[name].shape) for name in ("episodes", "outcomes"))
        self._episodes[:], self._outcomes[:] = state["episodes"], state["outcomes"]
        self._steps, self._ahead_of_time = (state[name].astype(np.int64) for name in ("steps", "ahead_of_time"))
        self._is_staggered, self._ended = state["is_staggered"], state["ended"].copy()
        self._some_ended = bool(self._ended.any())
        self._queue.go_on(state)
        if self._tiles is not None:
            self._tiles.follow(self._outcomes, np.ones(self.num_envs, bool))

    def render(self) -> tuple[np.ndarray, ...] | None:
        """One picture for each environment, as Gymnasium's vectors give them: arrays (height, width, 3), uint8."""
        if self._tiles is None:
            return None
        return self._tiles.draw(self._running(), self._outcomes, self._steps)

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads of a dynamic simulation, free what draws."""
        if self._tiles is not None:
            self._tiles.close()
        if self._threads is not None:
            self._threads.close()
        if self.core.engine is not None:
            self.core.engine.model.close()

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Infos) -> Any:
        """See `ManipulatorEnv.compute_reward`; `info` may also be the dict of arrays that `step` returns."""
        return self.core.compute_reward(achieved_goal, desired_goal, info)

    def compute_terminated(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Infos) -> Any:
        """See `ManipulatorEnv.compute_terminated`; `info` may also be the dict of arrays that `step` returns."""
        return self.core.compute_terminated(achieved_goal, desired_goal, info)

    def compute_truncated(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Infos) -> Any:
        """Whether that step reached the time limit. Arguments as for `compute_reward`."""
        single = np.ndim(achieved_goal) == 1
        if self.max_episode_steps is None:
            return False if single else np.zeros(len(achieved_goal), bool)
        told = self.core.infos(info, None if single else len(achieved_goal), ["step"])
        limits = told.get("time_limit", self.max_episode_steps)
        reached = np.asarray(told["step"]) >= limits
        return bool(reached[0]) if single else reached
