"""The single environment: a `gymnasium.Env` shell over a `Core`."""

import math
from functools import cached_property
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from tensegrity_envs.compiler.namespace import Components
from tensegrity_envs.core import Core
from tensegrity_envs.environments import core_of
from tensegrity_envs.episodes import EpisodeQueue, checked_options, episodes_ahead
from tensegrity_envs.relabelling import Infos
from tensegrity_envs.rendering import Scene, Viewer, checked_size, draw, need_display
from tensegrity_envs.seeding import checked_episode, checked_seed
from tensegrity_envs.simulation.protocol import RUNNING, Episode, State, termination_reason

_TRACE = 100  # tip positions kept for the picture
_TRUE, _FALSE = np.array(True), np.array(False)
_WHOLE = [np.int64(number) for number in range(1000)]


class ManipulatorEnv(gym.Env[dict[str, np.ndarray], np.ndarray]):
    """A manipulator that is to bring its tip to a target, staying stable and wrench-feasible.

    Observation: Dict of "observation" (see `core.schema`; every component within [-1, 1]), "achieved_goal"
    (the tip) and "desired_goal" (the target), both in metres; all float32. Action: increments in [-1, 1], scaled by
    the rate of the core's simulation; components outside are clipped, NaN, infinite or wrongly shaped ones raise
    ValueError.

    `info` holds is_success, tip_error [m], configuration [rad], the inputs (tensions [N] or free_lengths [m]),
    stability_margin, wrench_margin, is_stable, is_wrench_feasible, effort, the hidden parameters of the episode
    (privileged: controllers do not see info), failure (a code; `termination_reason` puts it into words), step, and
    every weighted term of the reward as reward_<name>.

    Args:
        arm: the name of its core in `environments.ARMS`, such as "TwoXReach", or a `Core` class of your own, itself
            or as "module:Class", which specs can hold as JSON.
        render_mode: None, "rgb_array" or "human".
        render_size: side of the picture, or (width, height) [pixels].
        **options: of the core.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 20}  # noqa: RUF012  (Gymnasium's convention)

    def __init__(
        self,
        arm: str | type[Core],
        render_mode: str | None = None,
        render_size: int | tuple[int, int] = 600,
        **options: Any,
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode = {render_mode!r}: must be None, 'rgb_array' or 'human'")
        self.render_size = checked_size(render_size)
        self.core = core_of(arm, options)
        self.render_mode = render_mode
        # Gymnasium types a Dict as a space of spaces, not of what it samples.
        self.observation_space = self.core.observation_space  # type: ignore[assignment]
        self.action_space = self.core.action_space
        self._queue: EpisodeQueue | None = None
        self._episode: np.ndarray | None = None  # one column each
        self._outcome: np.ndarray
        self._failure: float  # of the outcome
        self._action_shape = self.action_space.shape
        self._viewer: Viewer | None = None

    def need_display(self) -> None:
        """See that render_mode "human" would find a display, without opening a window.

        Raises:
            DisplayError: there is none; the message says what to do.
        """
        need_display()

    def __getstate__(self) -> dict[str, Any]:
        """The state of a copy: all but the window, which belongs to its process."""
        return self.__dict__ | {"_viewer": None}

    @property
    def design(self) -> Any:
        """The nominal design, which controllers are told."""
        return self.core.design

    @property
    def episode(self) -> Episode:
        """The present episode, with its hidden parameters (privileged)."""
        return self.core.episodes.unpack(self._running()[:, 0])

    @property
    def episodes(self) -> Episode:
        """The same as a batch of one, for controllers (privileged)."""
        return self.core.episodes.unpack(self._running().copy())

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin the next episode; with a seed, the first one of that seed.

        Args:
            seed: any non-negative integer.
            options: {"episode": k} begins the k-th episode of the seed, counted from 0; {"target": (x, y)} and
                {"configuration": q} put a target (as "desired_goal" has it) or a start of your own in the place of the
                sampled one, where the mechanism can be there and the target can be reached.

        Raises:
            ValueError: a number that is no non-negative integer, an unknown option, a target or configuration that is
                not feasible; the message says why.
        """
        given = checked_options(options)
        episode = given.pop("episode", None)
        chosen = {name: self._chosen(name, given.pop(name, None)) for name in ("target", "configuration")}
        if given:
            raise ValueError(f"reset options {list(given)}: there are 'episode', 'target' and 'configuration'")
        episode = None if episode is None else checked_episode(episode)
        start = None if seed is None else checked_seed(seed)
        if self._queue is None:
            super().reset(seed=start)
            self._queue = EpisodeQueue(self.core, np.array([self.np_random.integers(2**31)]), episodes_ahead(1))
        if all(value is None for value in chosen.values()):
            self._go_to(start, episode)
            column, outcome = np.empty((self.core.episodes.size, 1)), np.empty((self.core.outcomes.size, 1))
            self._queue.begin(np.array([0]), column, outcome)
        else:
            key = self._queue.peek(0, start, episode)
            column, outcome = self.core.begin_sampled(self.core.placed(self.core.sample(*key), **chosen))
            self._go_to(start, episode)  # not before it is known to be feasible
            self._queue.skip(0)
        self._episode, self._outcome = column, outcome
        self._failure = self._outcome.item(self._teller.failure)
        self._steps = 0
        if self.render_mode is not None:
            self._trace = [self._state.tip]
        observation, info = self._observation(), self._info()
        if self.render_mode == "human":
            self.render()
        return observation, info

    def _go_to(self, seed: int | None, episode: int | None) -> None:
        """Let the next episode be the given one."""
        assert self._queue is not None
        super().reset(seed=seed)
        if seed is not None:
            self._queue.restart(0, seed)
        if episode is not None:
            self._queue.restart(0, episode=episode)

    def _chosen(self, name: str, value: object) -> Components | None:
        """An option of `reset` as components of shape (1,)."""
        if value is None:
            return None
        rows = self.core.outcomes.rows.state.configuration if name == "configuration" else self.core.episodes.rows.goal
        try:
            array = np.array(value, float)
        except (TypeError, ValueError):
            array = np.zeros(0)
        if array.shape != (len(rows),) or not np.isfinite(array).all():
            raise ValueError(f"reset option {name!r} = {value!r}: must be {len(rows)} finite numbers")
        return tuple(array[:, None])

    def step(self, action: ArrayLike) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Advance by one step. The time limit is `gym.make`'s (TimeLimit).

        Raises:
            ValueError: the action is not a finite array of the right shape.
            RuntimeError: before the first reset, or after the episode has been terminated.
        """
        episode, teller = self._running(), self._teller
        if self._failure != RUNNING:
            reason = termination_reason(self._info()["failure"])
            raise RuntimeError(f"the episode was terminated ({reason}): call reset()")
        self._outcome = outcome = self.core.step(episode, self._outcome, check_action(action, self._action_shape))
        self._failure = failure = outcome.item(teller.failure)
        self._steps += 1
        if self.render_mode is not None:
            self._trace = [*self._trace[-_TRACE:], self._state.tip]
        observation, info = teller.observation(outcome), teller.info(outcome, self._steps)
        if self.render_mode == "human":
            self.render()
        return observation, outcome.item(teller.reward), failure != RUNNING, False, info

    def _running(self) -> np.ndarray:
        if self._episode is None:
            raise RuntimeError("call reset() before the first step")
        return self._episode

    @property
    def _state(self) -> State:
        return self.core.outcomes.unpack(self._outcome[:, 0]).state

    def _observation(self) -> dict[str, np.ndarray]:
        return self._teller.observation(self._outcome)

    def _info(self) -> dict[str, Any]:
        return self._teller.info(self._outcome, self._steps)

    @cached_property
    def _teller(self) -> "_Teller":
        return _Teller(self.core)

    def get_state(self) -> dict[str, Any]:
        """All that determines what follows, the coming episodes included, for `set_state` of any environment of this
        id; a copy. `gym.make`'s time limit counts for itself: its `_elapsed_steps` is info["step"].

        Raises:
            RuntimeError: before the first reset.
        """
        episodes = self._running()
        assert self._queue is not None
        state: dict[str, Any] = {
            "of": self.core.fingerprint,
            "episode": episodes.copy(),
            "outcome": self._outcome.copy(),
        }
        state["steps"] = self._steps
        return {**state, **self._queue.state()}

    def set_state(self, state: dict[str, Any]) -> None:
        """Go on from a state that `get_state` told.

        Raises:
            ValueError: it is the state of another environment.
        """
        if self._queue is None:
            self._queue = EpisodeQueue(self.core, np.zeros(1, np.int64), episodes_ahead(1))
        shapes = {"episode": (self.core.episodes.size, 1), "outcome": (self.core.outcomes.size, 1)}
        self._queue.check(state, shapes, self.core.fingerprint)
        if not isinstance(state.get("steps"), int):
            raise ValueError("state: 'steps' must be a whole number, as get_state() returned it")
        self._episode, self._outcome, self._steps = state["episode"].copy(), state["outcome"].copy(), state["steps"]
        self._failure = self._outcome.item(self._teller.failure)
        self._queue.go_on(state)
        self._trace = [self._state.tip]

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Infos) -> Any:
        """The reward that `step` would give for these goals, for one transition or a batch.

        Args:
            achieved_goal: shape (2,) or (n, 2) [m].
            desired_goal: the same shape.
            info: the info dict of the step, or a sequence of n of them.

        Raises:
            ValueError: shapes do not fit, or info is missing (Stable-Baselines3: HerReplayBuffer(copy_info_dict=True)).
        """
        return self.core.compute_reward(achieved_goal, desired_goal, info)

    def compute_terminated(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Infos) -> Any:
        """Whether that step ended the episode by failure; the same for all goals. Arguments as for `compute_reward`."""
        return self.core.compute_terminated(achieved_goal, desired_goal, info)

    def compute_truncated(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Infos) -> Any:
        """Never: the time limit is `gym.make`'s TimeLimit wrapper, as in Gymnasium-Robotics.

        Arguments as for `compute_reward`.
        """
        return False if np.ndim(achieved_goal) == 1 else np.zeros(len(achieved_goal), bool)

    def scene(self) -> Scene:
        """What `rendering.draw` draws, in a plane: the arm, its target and the trace of its tip."""
        return self.core.picture(*self._shown())

    def _shown(self) -> tuple[Episode, State, list[Any], int]:
        """What pictures are made of."""
        return self.episode, self._state, getattr(self, "_trace", []), self._steps

    def render(self) -> Any:
        """The picture (rgb_array: shape (height, width, 3), uint8), or the window brought up to date
        (human).
        """
        if self.render_mode is None:
            gym.logger.warn("render() without a render_mode: pass render_mode='rgb_array' or 'human' to gym.make")
            return None
        if self.render_mode == "rgb_array":
            return draw(self.scene(), self.render_size)
        if self._viewer is None:
            self._viewer = Viewer(self.render_size)
        self._viewer.show(self.scene(), self.metadata["render_fps"])
        return None

    @property
    def window_is_open(self) -> bool:
        """Whether render_mode "human" shows a window at this moment."""
        return self._viewer is not None and self._viewer.is_open

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None


class _Teller:
    """What is told of an outcome, a matrix of one column; where it stands there is looked up once.

    Args:
        core: of the environment.

    Attributes:
        reward: its row.
        failure: likewise.
    """

    def __init__(self, core: Core) -> None:
        rows = core.outcomes.rows
        self.reward, self.failure = int(rows.reward), int(rows.state.failure)
        self._seen = slice(rows.observation[0], rows.desired[-1] + 1)
        self._goals = rows.achieved[0] - rows.observation[0], rows.desired[0] - rows.observation[0]
        singles = [entry for entry in core.info_entries if entry.end is None]
        self._floats = [entry.name for entry in singles if entry.kind == "float"]
        self._truths, self._ints = (
            [(entry.name, entry.first) for entry in singles if entry.kind == kind] for kind in ("bool", "int")
        )
        told = [entry.first for entry in singles if entry.kind == "float"]
        self._vectors = []
        for entry in core.info_entries:
            if entry.end is not None:
                self._vectors.append((entry.name, slice(len(told), len(told) + entry.end - entry.first)))
                told.extend(range(entry.first, entry.end))
        self._told = np.array(told)

    def observation(self, outcome: np.ndarray) -> dict[str, np.ndarray]:
        """The observation, in memory of its own."""
        seen, (first, second) = outcome[self._seen, 0].astype(np.float32), self._goals
        return {"observation": seen[:first], "achieved_goal": seen[first:second], "desired_goal": seen[second:]}

    def info(self, outcome: np.ndarray, steps: int) -> dict[str, Any]:
        """The info after so many steps, in memory of its own.

        All entries have a dtype, which clients ask for (TorchRL). Truths are arrays of shape (): of NumPy's bool
        scalars Gymnasium's vectors make arrays of objects.
        """
        told = outcome.take(self._told)
        info: dict[str, Any] = dict(zip(self._floats, told))  # the vectors come after the floats
        for name, row in self._truths:
            info[name] = (_TRUE if outcome.item(row) != 0 else _FALSE).copy()
        for name, row in self._ints:
            info[name] = _whole(int(outcome.item(row)))
        for name, part in self._vectors:
            info[name] = told[part]
        info["step"] = _whole(steps)
        return info


def _whole(number: int) -> np.int64:
    """A NumPy number, which takes long to make."""
    return _WHOLE[number] if 0 <= number < len(_WHOLE) else np.int64(number)


def check_action(action: ArrayLike, shape: tuple[int, ...] | None) -> np.ndarray:
    """A single action as a column of numbers, clipped to [-1, 1].

    Raises:
        ValueError: it has the wrong shape, or is not finite.
    """
    array = np.array(action, float)
    if array.shape != shape:
        raise ValueError(f"action of shape {array.shape}: must be {shape}, increments in [-1, 1]")
    values: list[float] = array.tolist()
    for i, value in enumerate(values):
        if not -1.0 <= value <= 1.0:
            if not math.isfinite(value):
                raise ValueError(f"action = {values}: must be finite numbers")
            array[i] = min(max(value, -1.0), 1.0)
    return array[:, None]


def unwrapped(env: gym.Env[Any, Any]) -> ManipulatorEnv:
    """The environment of this package within its wrappers.

    Raises:
        TypeError: it is another one.
    """
    bare = env.unwrapped
    if not isinstance(bare, ManipulatorEnv):
        raise TypeError(f"{env}: is no environment of a manipulator")
    return bare
