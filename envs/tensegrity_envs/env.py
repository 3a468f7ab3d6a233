"""The single environment: a `gymnasium.Env` shell over `Core`, on floats."""

from typing import Any

import gymnasium as gym
import numpy as np

from tensegrity_envs.core import Core, Episode, failure_name, information, total_reward
from tensegrity_envs.episodes import EpisodeQueue, as_floats
from tensegrity_envs.mechanics.namespace import namespace_of
from tensegrity_envs.rendering import Scene, Viewer, draw
from tensegrity_envs.simulation.protocol import RUNNING, State

_TRACE = 100  # tip positions kept for the picture
_AHEAD = 16  # episodes drawn at once


class TwoXReachEnv(gym.Env[dict[str, np.ndarray], np.ndarray]):
    """Reach a target with a 2-X manipulator, staying stable and wrench-feasible.

    Observation: Dict of "observation" (see `Core.observation`; every component within [-1, 1]), "achieved_goal" (the
    tip) and "desired_goal" (the target), both in metres; all float32. Action: increments in [-1, 1], scaled by 0.1 rad
    (joint control) or 15 N (tension control); components outside are clipped, NaN, infinite or wrongly shaped ones
    raise ValueError.

    `info` holds is_success, tip_error [m], configuration [rad], tensions [N], stability_margin, wrench_margin,
    is_stable, is_wrench_feasible, payload [kg] (privileged: controllers do not see info), failure (code) with
    termination_reason (words), and every weighted term of the reward as reward_<name>.

    Args:
        render_mode: None, "rgb_array" or "human".
        render_size: width and height of the picture [pixels].
        **options: of `Core`: design, control, payload_range, observe, reward_type, reward_weights, tolerance.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 20}  # noqa: RUF012  (Gymnasium's convention)

    def __init__(self, render_mode: str | None = None, render_size: int = 600, **options: Any) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode = {render_mode!r}: must be None, 'rgb_array' or 'human'")
        self.core = Core(**options)
        self.render_mode = render_mode
        self.render_size = render_size
        # Gymnasium types a Dict as a space of spaces, not of what it samples.
        self.observation_space = self.core.observation_space  # type: ignore[assignment]
        self.action_space = self.core.action_space
        self._queue: EpisodeQueue | None = None
        self._episode: Episode | None = None
        self._state: State
        self._viewer: Viewer | None = None

    @property
    def design(self) -> Any:
        """The nominal design, which controllers are told."""
        return self.core.design

    @property
    def true_design(self) -> Any:
        """The design with the hidden parameters of the present episode (privileged)."""
        return self._running().mechanism.design

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin the next episode; with a seed, the first one of that seed.

        Args:
            seed: any non-negative integer.
            options: {"episode": k} begins the k-th episode of the seed, counted from 0.

        Raises:
            ValueError: an unknown option.
        """
        super().reset(seed=seed)
        if self._queue is None:
            self._queue = EpisodeQueue(self.core, np.array([self.np_random.integers(2**31)]), _AHEAD)
        if seed is not None:
            self._queue.restart(0, seed)
        if options:
            unknown = [key for key in options if key != "episode"]
            if unknown:
                raise ValueError(
                    f"reset options {unknown}: the only one is 'episode', the number of the episode to begin"
                )
            self._queue.restart(0, episode=int(options["episode"]))
        self._episode, self._state = as_floats(self._queue.pop(np.array([0])))
        self._desired = np.array(self._episode.goal, np.float32)
        self._steps = 0
        self._trace = [self._state.tip]
        observation, info, _ = self._outcome()
        if self.render_mode == "human":
            self.render()
        return observation, info

    def step(self, action: Any) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Advance by one step. The time limit is `gym.make`'s (TimeLimit).

        Raises:
            ValueError: the action is not a finite array of the right shape.
            RuntimeError: before the first reset, or after the episode has been terminated.
        """
        episode = self._running()
        if self._state.failure != RUNNING:
            raise RuntimeError(f"the episode was terminated ({failure_name(self._state.failure)}): call reset()")
        self._state = self.core.advance(episode, self._state, check_action(action, self.action_space.shape))
        self._steps += 1
        if self.render_mode is not None:
            self._trace = [*self._trace[-_TRACE:], self._state.tip]
        observation, info, reward = self._outcome()
        if self.render_mode == "human":
            self.render()
        return observation, reward, self._state.failure != RUNNING, False, info

    def _running(self) -> Episode:
        if self._episode is None:
            raise RuntimeError("call reset() before the first step")
        return self._episode

    def _outcome(self) -> tuple[dict[str, np.ndarray], dict[str, Any], float]:
        core, state, episode = self.core, self._state, self._running()
        achieved = np.array(state.tip, np.float32)
        xp = namespace_of(0.0)
        error = xp.hypot(float(achieved[0]) - episode.goal[0], float(achieved[1]) - episode.goal[1])
        terms = core.task.reward_terms(xp, error, state, episode.solutions)
        info = information(core, state, error, terms, float(episode.mechanism.design.payload))
        info["configuration"] = np.array(state.configuration)
        info["tensions"] = np.array(state.inputs)
        info["step"] = self._steps
        info["termination_reason"] = failure_name(state.failure)
        observation = {
            "observation": np.array(core.observation(state), np.float32),
            "achieved_goal": achieved,
            "desired_goal": self._desired.copy(),
        }
        return observation, info, total_reward(terms)

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> Any:
        """The reward that `step` would give for these goals, for one transition or a batch.

        Args:
            achieved_goal: shape (2,) or (n, 2) [m].
            desired_goal: the same shape.
            info: the info dict of the step, or a sequence of n of them.

        Raises:
            ValueError: shapes do not fit, or info is missing (Stable-Baselines3: HerReplayBuffer(copy_info_dict=True)).
        """
        return self.core.compute_reward(achieved_goal, desired_goal, info)

    def compute_terminated(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> Any:
        """Whether that step ended the episode by failure; the same for all goals. Arguments as for `compute_reward`."""
        return self.core.compute_terminated(achieved_goal, desired_goal, info)

    def compute_truncated(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> Any:
        """Never: the time limit is `gym.make`'s TimeLimit wrapper, as in Gymnasium-Robotics.

        Arguments as for `compute_reward`.
        """
        return False if np.ndim(achieved_goal) == 1 else np.zeros(len(achieved_goal), bool)

    def scene(self) -> Scene:
        """What `render` draws: the arm, its target and the trace of its tip."""
        state, episode = self._state, self._running()
        mechanism = episode.mechanism
        error = float(np.hypot(state.tip[0] - episode.goal[0], state.tip[1] - episode.goal[1]))
        return Scene(
            nodes=mechanism.nodes(state.configuration),
            members=mechanism.members,
            tensions={f"cable {name}": f for name, f in zip(mechanism.input_names, state.inputs, strict=True)},
            tension_bounds=(self.design.min_tension, self.design.max_tension),
            tip=(state.tip[0], state.tip[1]),
            target=(episode.goal[0], episode.goal[1]),
            tolerance=self.core.task.tolerance,
            trace=self._trace,
            margins={"stability": state.stability_margin, "wrench": state.wrench_margin},
            caption=f"step {self._steps}   tip error {1000 * error:.1f} mm",
            reach=self.core.reach,
            failure=failure_name(state.failure),
        )

    def render(self) -> Any:
        """The picture (rgb_array: shape (render_size, render_size, 3), uint8), or the window brought up to date
        (human).
        """
        if self.render_mode is None:
            gym.logger.warn("render() without a render_mode: pass render_mode='rgb_array' or 'human' to gym.make")
            return None
        if self.render_mode == "rgb_array":
            return draw(self.scene(), (self.render_size, self.render_size))
        if self._viewer is None:
            self._viewer = Viewer((self.render_size, self.render_size))
        self._viewer.show(self.scene(), self.metadata["render_fps"])
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None


def check_action(action: Any, shape: tuple[int, ...] | None) -> tuple[float, ...]:
    """A single action as floats, clipped to [-1, 1].

    Raises:
        ValueError: it has the wrong shape, or is not finite.
    """
    array = np.asarray(action, float)
    if array.shape != shape:
        raise ValueError(f"action of shape {array.shape}: must be {shape}, increments in [-1, 1]")
    values: list[float] = array.tolist()
    for value in values:
        if not -1.0 <= value <= 1.0 and not np.isfinite(value):
            raise ValueError(f"action = {values}: must be finite numbers")
    return tuple(min(max(value, -1.0), 1.0) for value in values)
