"""An environment as pure functions on components: mechanism x simulation x task, compiled.

A batch of n environments is two matrices: the running episodes (what stays the same) and their states, one column for
each environment. A step makes a matrix of outcomes (state, observation, reward, info). The single shell holds matrices
of one column, the vector shell of n; both run the same machine code.
"""

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from tensegrity_envs.mechanics.compiling import Kernel
from tensegrity_envs.mechanics.namespace import Component, Components, namespace_of, to_single
from tensegrity_envs.mechanics.structure import Layout, is_row
from tensegrity_envs.rendering import Scene
from tensegrity_envs.simulation.protocol import FAILURES, RUNNING, Episode, Simulation, State
from tensegrity_envs.tasks import Task


class Drawn(NamedTuple):
    """A batch of n episodes that begin; components of shape (n,).

    Attributes:
        episode: what stays the same.
        configuration: at the start [rad].
        inputs: at the start, or None for the usual ones.
    """

    episode: Episode
    configuration: Components
    inputs: Components | None


class Outcome(NamedTuple):
    """All there is to tell about a step.

    Attributes:
        state: after the step.
        observation: components of the "observation" entry, each within [-1, 1].
        achieved: tip position as a float32 number [m].
        desired: the goal at this moment, as a float32 number [m].
        reward: of the step, a float32 number.
        info: by name, numbers or vectors.
    """

    state: State
    observation: Components
    achieved: Components
    desired: Components
    reward: Component
    info: dict[str, Any]


class InfoEntry(NamedTuple):
    """Where an entry of `info` stands in a matrix of outcomes: in row `first`, or from there to `end`."""

    name: str
    first: int
    end: int | None
    kind: str


def sees_everything(observe: str) -> bool:
    """Whether joint angles and margins are observed.

    Raises:
        ValueError: `observe` is neither "full" nor "tip_and_inputs".
    """
    if observe not in ("full", "tip_and_inputs"):
        raise ValueError(f"observe = {observe!r}: must be 'full' or 'tip_and_inputs'")
    return observe == "full"


def tip_inputs_and_angles(
    state: State, reach: float, bounds: tuple[Component, Component], everything: bool
) -> list[Component]:
    """The observation that the arms share.

    tip / reach (2), inputs from -1 at their lower to 1 at their upper bound, and, if everything is observed, sine and
    cosine of each joint angle, stability and wrench margin m as m / (1 + |m|) (2).
    """
    xp = namespace_of(state.tip[0])
    low, high = bounds
    parts = [component / reach for component in state.tip]
    parts += [(2 * value - (high + low)) / (high - low) for value in state.inputs]
    if everything:
        for angle in state.configuration:
            parts += [xp.sin(angle), xp.cos(angle)]
        parts += [m / (1 + abs(m)) for m in (state.stability_margin, state.wrench_margin)]
    return parts


class Core(ABC):
    """What the shells run. A subclass brings a mechanism, the way it is driven and drawn, and what is seen of it.

    Attributes:
        design: nominal, which controllers are told.
        nominal: the mechanism of that design.
        simulation: how actions move it.
        task: what is wanted.
        reach: an upper bound of the tip's distance from the base [m].
        input_name: of the inputs, in `info`; empty where there are none.
        control: how it is driven, for controllers.
        error_name: of the distance to the goal, in `info`.
        error_unit: in which a thousandth of it is told, "mm" or "mrad".
        hidden_names: of the entries of `info` that tell hidden parameters.
    """

    design: Any
    nominal: Any
    simulation: Simulation
    task: Task
    reach: float
    input_name: str
    control: str
    error_name: str = "tip_error"
    error_unit: str = "mm"
    hidden_names: tuple[str, ...]
    observation_space: spaces.Dict
    action_space: spaces.Box

    @abstractmethod
    def mechanism(self, design: Any) -> Any:
        """The mechanism of a design."""

    @abstractmethod
    def draw(self, seed: np.ndarray, episode: np.ndarray) -> Drawn:
        """Draw the episodes of the given (seed, episode) pairs, both of shape (n,)."""

    @abstractmethod
    def observation(self, state: State, episode: Episode) -> list[Component]:
        """Components of the "observation" entry, each within [-1, 1]."""

    @abstractmethod
    def hidden(self, episode: Episode, state: State) -> dict[str, Any]:
        """Entries of `info` that tell the hidden parameters of the episode, by the names in `hidden_names`."""

    @abstractmethod
    def episode_of(self, info: dict[str, np.ndarray], goal: Components) -> Episode:
        """The episode whose hidden parameters `info` tells, with this goal at rest, arrays of shape (n,)."""

    @abstractmethod
    def scene(self, episode: Episode, state: State) -> dict[str, Any]:
        """Arguments of `rendering.Scene` that depend on the mechanism."""

    def set_spaces(self, observation_size: int, goal_size: int = 2, goal_bound: float | None = None) -> None:
        """Define the spaces; goals are within the reach [m], unless another bound is given."""
        bound = self.reach if goal_bound is None else goal_bound
        box = spaces.Box(-1.0, 1.0, (observation_size,), np.float32)
        goal = spaces.Box(-bound, bound, (goal_size,), np.float32)
        self.observation_space = spaces.Dict({"observation": box, "achieved_goal": goal, "desired_goal": goal})
        self.action_space = spaces.Box(-1.0, 1.0, (self.simulation.action_size,), np.float32)

    # ------------------------------------------------------------------------------------- what happens, traceable

    def achieved(self, state: State) -> Components:
        """What is compared with the goal: the tip [m]."""
        return state.tip

    def error(self, xp: Any, achieved: Components, goal: Components) -> Component:
        """Distance of the achieved from the desired goal [m]."""
        distance = xp.hypot(achieved[0] - goal[0], achieved[1] - goal[1])
        for here, there in zip(achieved[2:], goal[2:], strict=True):
            distance = xp.hypot(distance, here - there)
        return distance

    def outcome(self, episode: Episode, state: State) -> Outcome:
        """What is to be told about a state."""
        xp = namespace_of(state.tip[0])
        achieved = tuple(to_single(component) for component in self.achieved(state))
        desired = episode.goal_at(state.time)
        error = self.error(xp, achieved, desired)
        state = self.task.judge(xp, error, state)
        terms = self.task.reward_terms(xp, error, state, episode)
        total: Component = 0.0
        for term in terms.values():
            total = total + term
        info = {
            "is_success": self.task.is_success(error, state, episode),
            self.error_name: error,
            "stability_margin": state.stability_margin,
            "wrench_margin": state.wrench_margin,
            "is_stable": state.stability_margin > 0,
            "is_wrench_feasible": state.wrench_margin >= 0,
            "failure": state.failure,
            "effort": self.task.effort(state),
            "configuration": state.configuration,
            **({self.input_name: state.inputs} if self.input_name else {}),
            **self.hidden(episode, state),
            **self.task.measures(state, episode),
            **{f"reward_{name}": term for name, term in terms.items()},
        }
        # In single precision, so that a relabelled reward, from inverse solutions found anew, is the same number.
        return Outcome(state, tuple(self.observation(state, episode)), achieved, desired, to_single(total), info)

    def begun(self, episode: Episode, q: Components, inputs: Components | None) -> Outcome:
        """The outcome of beginning an episode."""
        return self.outcome(episode, self.simulation.start(self.mechanism(episode.design), episode, q, inputs))

    def stepped(self, episode: Episode, state: State, action: Components) -> Outcome:
        """The outcome of a step."""
        return self.outcome(episode, self.simulation.advance(self.mechanism(episode.design), episode, state, action))

    # ------------------------------------------------------------------------------------------ batches, as matrices

    @cached_property
    def _drawn_layouts(self) -> tuple[Layout, Layout, Layout]:
        """Layouts of episodes, start configurations and start inputs, which are those of any draw."""
        drawn = self.draw(np.zeros(1, np.int64), np.zeros(1, np.int64))
        return Layout(drawn.episode), Layout(drawn.configuration), Layout(drawn.inputs)

    @property
    def episodes(self) -> Layout:
        """Of a matrix of episodes."""
        return self._drawn_layouts[0]

    @cached_property
    def _begin(self) -> Kernel:
        return Kernel(self.begun, *self._drawn_layouts)

    @property
    def outcomes(self) -> Layout:
        """Of a matrix of outcomes."""
        return self._begin.result

    @cached_property
    def states(self) -> Layout:
        """Of a matrix of states: the first rows of a matrix of outcomes."""
        return Layout(self.outcomes.rows.state, is_row, lambda row: row.kind)

    @cached_property
    def _step(self) -> Kernel:
        actions = Layout(tuple(np.zeros(1) for _ in range(self.simulation.action_size)))
        return Kernel(self.stepped, self.episodes, self.states, actions)

    @cached_property
    def _outcome(self) -> Kernel:
        return Kernel(self.outcome, self.episodes, self.states)

    def begin(self, seed: np.ndarray, episode: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Begin the episodes of the given (seed, episode) pairs, both of shape (n,).

        Returns:
            The matrices of episodes and of outcomes.
        """
        drawn = self.draw(seed, episode)
        layouts = self._drawn_layouts
        matrices = [layout.pack(part, len(seed)) for layout, part in zip(layouts, drawn, strict=True)]
        return matrices[0], self.complete(matrices[0], self._begin(*matrices))

    def step(self, episodes: np.ndarray, states: np.ndarray, actions: np.ndarray) -> np.ndarray:
        """The outcomes one step later, for actions of shape (action size, n) in [-1, 1]."""
        return self.complete(episodes, self._step(episodes, states, actions))

    def tell(self, episodes: np.ndarray, states: np.ndarray) -> np.ndarray:
        """The outcomes of being in these states."""
        return self.complete(episodes, self._outcome(episodes, states))

    def complete(self, episodes: np.ndarray, outcomes: np.ndarray) -> np.ndarray:
        """The outcomes with what compiled code could not tell; nothing here."""
        return outcomes

    @cached_property
    def info_entries(self) -> list[InfoEntry]:
        """The entries of `info`."""
        entries = []
        for name, place in self.outcomes.rows.info.items():
            rows = place if isinstance(place, tuple) else (place,)
            entries.append(InfoEntry(name, int(rows[0]), int(rows[-1]) + 1 if rows is place else None, rows[0].kind))
        return entries

    # ------------------------------------------------------------------------------------------------ relabelling

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """Reward of the dense or sparse form for any goals, as `step` gives it. See `ManipulatorEnv.compute_reward`."""
        outcomes, single = self._relabelled(achieved_goal, desired_goal, info)
        reward = outcomes[self.outcomes.rows.reward]
        return float(reward[0]) if single else reward

    def compute_terminated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """Whether the episode failed in that step."""
        outcomes, single = self._relabelled(achieved_goal, desired_goal, info)
        failed = outcomes[self.outcomes.rows.state.failure] != RUNNING
        return bool(failed[0]) if single else failed

    def _relabelled(self, achieved_goal: Any, desired_goal: Any, info: Any) -> tuple[np.ndarray, bool]:
        """The outcomes with other goals, and whether there is one only, without a batch."""
        achieved, desired, batch, single = self._goals(achieved_goal, desired_goal, info)
        episode = self.episode_of(batch, tuple(desired.T))
        n = len(achieved)
        state = State(
            tuple(batch["configuration"].T),
            tuple(batch[self.input_name].T) if self.input_name in batch else (),
            tuple(achieved.T[: len(self.states.rows.tip)]),
            batch["stability_margin"],
            batch["wrench_margin"],
            batch["failure"],
            batch["step"],
            tuple(np.zeros(n) for _ in self.states.rows.record),  # no reward depends on it
        )
        state = self.with_achieved(state, tuple(achieved.T))
        return self.tell(self.episodes.pack(episode, n), self.states.pack(state, n)), single

    def with_achieved(self, state: State, achieved: Components) -> State:
        """The state of which `achieved` tells that."""
        return state._replace(tip=achieved)

    def _goals(
        self, achieved: Any, desired: Any, info: Any
    ) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray], bool]:
        """Goals as (n, size) arrays and the infos as one dict of arrays."""
        achieved, desired = np.asarray(achieved, float), np.asarray(desired, float)
        single, size = achieved.ndim == 1, self.observation_space["achieved_goal"].shape
        assert size is not None
        if achieved.shape != desired.shape or achieved.shape[-1:] != size or achieved.ndim > 2:
            raise ValueError(
                f"goals of shapes {achieved.shape} and {desired.shape}: "
                f"both must be {size} or (n, {size[0]}), in metres"
            )
        keys = ["configuration", "stability_margin", "wrench_margin", "failure", "step", *self.hidden_names]
        keys += [self.input_name] if self.input_name else []
        infos = [info] if isinstance(info, dict) and single else info
        if not isinstance(infos, dict):
            if len(infos) != (1 if single else len(achieved)) or any(key not in i for i in infos for key in keys):
                raise ValueError(
                    "compute_reward needs the info of every step (the reward depends on inputs and margins, "
                    "not on the goals alone): with Stable-Baselines3, HerReplayBuffer(copy_info_dict=True)"
                )
            infos = {key: np.array([i[key] for i in infos]) for key in keys}
        elif any(key not in infos for key in keys):
            raise ValueError(
                f"info lacks {[key for key in keys if key not in infos]}: pass the info that step returned"
            )
        return np.atleast_2d(achieved), np.atleast_2d(desired), infos, single

    def picture(self, episode: Episode, state: State, trace: list[Any], step: int) -> Scene:
        """What `render` draws."""
        error = float(self.error(np, self.achieved(state), episode.goal_at(state.time)))
        usual: dict[str, Any] = {
            "tip": state.tip,
            "target": episode.goal_at(state.time),
            "tolerance": self.task.tolerance,
            "trace": trace,
            "margins": {"stability": state.stability_margin, "wrench": state.wrench_margin},
            "caption": f"step {step}   {self.error_name.replace('_', ' ')} {1000 * error:.1f} {self.error_unit}",
            "reach": self.reach,
            "failure": FAILURES[state.failure],
        }
        return Scene(**(usual | self.scene(episode, state)))
