"""What an environment is, written for one: its parts, and what happens in a step, in traceable functions.

Nothing here knows of batches. `batch` compiles the functions marked as traced and runs them on matrices.
"""

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from gymnasium import spaces

from tensegrity_envs.compiler.namespace import Component, Components, Namespace, namespace_of, to_single
from tensegrity_envs.mechanics.design import check_one_design
from tensegrity_envs.mechanics.designs import resolve_design
from tensegrity_envs.observation import Field, ObservationSchema
from tensegrity_envs.options import OPTION_NAMES, Options
from tensegrity_envs.randomization import Randomization
from tensegrity_envs.simulation.dynamic import Command, Drivable, DynamicControl, Motion
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.simulation.protocol import Episode, Simulation, State
from tensegrity_envs.tasks import Task, Weights

if TYPE_CHECKING:
    from tensegrity_envs.simulation.mujoco.engine import Engine


class Sampled(NamedTuple):
    """A batch of n sampled episodes and their initial states; components of shape (n,).

    Attributes:
        episode: what stays the same during an episode.
        configuration: at the start [rad].
        inputs: at the start, or None for the usual ones.
    """

    episode: Episode
    configuration: Components
    inputs: Components | None


class Outcome(NamedTuple):
    """All results of a step.

    Attributes:
        state: after the step.
        observation: components of the "observation" entry, each within [-1, 1].
        achieved: tip position as a float32 number [m].
        desired: the goal at this moment, as a float32 number [m].
        reward: the reward of the step, a float32 number.
        info: numbers or vectors by name; those of the state itself come on top, see `Core.info_entries`.
    """

    state: State
    observation: Components
    achieved: Components
    desired: Components
    reward: Component
    info: dict[str, Any]


class Interface(ABC):
    """What an environment is. A subclass of `Core` brings mechanism, actuation, sampling, observation and picture.

    Attributes:
        published: the default design, a published one.
        shared: the names of the options of `Options` that the constructor takes.
        option_defaults: the defaults of these options where they differ from those of `Options`.
        task_type: the class of the task; a subclass of the environment may set another.
        default_weights: weights of the dense reward that are not given, of the class that the task has.
        design: the nominal design, which controllers know.
        nominal: the mechanism of the nominal design.
        simulation: how actions move the mechanism.
        task: success, termination and reward.
        reach: an upper bound of the tip's distance from the base [m].
        input_name: the name of the inputs in `info` and in observations; empty where there are none.
        control: the name of the actuation, for controllers.
        goal_name: the name of the achieved goal in decoded observations.
        error_name: the name of the distance to the goal in `info`.
        error_unit: the unit of a thousandth of that distance, "mm" or "mrad".
        hidden_info_keys: the entries of `info` from which `episode_with_goal` restores the hidden parameters of an
            episode (a payload, a force); `compute_reward` asks for them. Empty where nothing is hidden.
        observe_all: whether joint angles and margins are observed.
        observe_velocities: whether velocities are observed.
        randomization: the ranges of what differs from episode to episode.
        randomizable: the names of what may differ.
        noise_scale: what the tip noise of the levels of uncertainty is multiplied by, for mechanisms of another size.
        info_meanings: unit and meaning of the entries of `info` that only this environment has.
        can_fail: whether episodes may be terminated; a subclass whose episodes end by the time limit alone says False.
        has_obstacles: whether there is something that the arm may meet.
        shows_joint_space: whether reports draw paths in the joint space, whose two angles decide all margins.
        dynamics: the parameters of a dynamic simulation; None in a quasi-static one.
        engine: the engine of a dynamic simulation; None in a quasi-static one.
    """

    published: ClassVar[Any]
    shared: ClassVar[tuple[str, ...]] = OPTION_NAMES
    option_defaults: ClassVar[Mapping[str, Any]] = {}
    task_type: ClassVar[type[Task]]
    default_weights: ClassVar[Weights]
    design: Any
    nominal: Any
    simulation: Simulation | DynamicControl
    task: Task
    reach: float
    input_name: str
    control: str
    goal_name: str = "tip"
    error_name: str = "tip_error"
    error_unit: str = "mm"
    hidden_info_keys: tuple[str, ...] = ()
    observe_all: bool = True
    observe_velocities: bool = False
    randomization: Randomization = Randomization()
    randomizable: frozenset[str] = frozenset()
    noise_scale: ClassVar[float] = 1.0
    info_meanings: ClassVar[dict[str, tuple[str, str]]] = {}
    can_fail: bool = True
    has_obstacles: bool = False
    shows_joint_space: bool = False
    dynamics: Dynamics | None = None
    engine: "Engine | None" = None
    observation_space: spaces.Dict
    action_space: spaces.Box

    @abstractmethod
    def mechanism(self, design: Any) -> Any:
        """The mechanism of a design."""

    @abstractmethod
    def sample(self, seed: np.ndarray, episode: np.ndarray) -> Sampled:
        """The episodes of the given (seed, episode) pairs, both of shape (n,), with their initial states.

        Every number is a function of its pair alone, never of the batch; see `seeding.EpisodeStream`.
        """

    def placed(self, sampled: Sampled, target: Components | None, configuration: Components | None) -> Sampled:
        """A sampled episode, a batch of one, with another target or start.

        Args:
            sampled: the episode as it was sampled.
            target: components of shape (1,), as "desired_goal" has them; None for the sampled one.
            configuration: at the start, likewise.

        Raises:
            ValueError: neither can be chosen in this environment, or the episode could not be solved; the message says
                why.
        """
        raise ValueError("'target' and 'configuration' cannot be chosen in this environment: its goal moves on a curve")

    def tip_region(self) -> Any:
        """Where the tip of the nominal mechanism can be without a load, for reports.

        Returns:
            A shapely geometry [m]; None where the mechanism does not move in a plane.
        """
        return None

    @property
    def goal_text(self) -> str:
        """What the numbers of a goal are, and when it is reached, for the tables of the documentation."""
        unit = "m" if self.error_unit == "mm" else "rad"
        return f"the {self.schema.fields[self.goal_name].meaning} [{unit}]; tolerance {self.task.tolerance:.5g} {unit}"

    @abstractmethod
    def observed(self) -> Sequence[Field]:
        """The fields of the entry "observation", in their order."""

    @cached_property
    def schema(self) -> ObservationSchema:
        """Encodes, decodes and describes the entry "observation"."""
        return self._new_schema()

    def _new_schema(self) -> ObservationSchema:
        # Traced code makes its own, of numbers that know where they come from: `schema` is made of plain ones.
        return ObservationSchema(self.observed(), self.goal_name, self.input_name)

    def hidden_info(self, episode: Episode, state: State) -> dict[str, Component | Components]:
        """Entries of `info` that controllers do not observe: at least those of `hidden_info_keys`. Traced."""
        return {}

    @abstractmethod
    def episode_with_goal(self, info: dict[str, np.ndarray], goal: Components) -> Episode:
        """The episodes of steps that have been taken, with other goals: what `compute_reward` evaluates anew.

        Hindsight replay asks what a step would have been worth with another goal. The reward is a function of (state,
        episode), so this rebuilds the part of the episode on which the reward depends.

        Args:
            info: arrays of shape (n, ...), of the steps: every key of `hidden_info_keys`, and "random_<name>" for
                whatever is randomized.
            goal: the other goals, at rest, components of shape (n,).
        """

    @abstractmethod
    def scene(self, episode: Episode, state: State) -> dict[str, Any]:
        """Arguments of `rendering.Scene` that depend on the mechanism."""

    def set_spaces(self, goal_size: int = 2, goal_bound: float | Sequence[float] | None = None) -> None:
        """Define the spaces; goals are within the reach [m], unless another bound is given, one for all or for each."""
        bound = np.full(goal_size, self.reach if goal_bound is None else goal_bound, np.float32)
        box = spaces.Box(-1.0, 1.0, (self.schema.size,), np.float32)
        goal = spaces.Box(-bound, bound, (goal_size,), np.float32)
        self.observation_space = spaces.Dict({"observation": box, "achieved_goal": goal, "desired_goal": goal})
        self.action_space = spaces.Box(-1.0, 1.0, (self.simulation.action_size,), np.float32)

    def take_options(self, options: Options, applicable: Collection[str], where: str) -> None:
        """Take what all constructors do alike: the nominal design, what is observed, what is randomized.

        Args:
            options: the options that were given.
            applicable: names of what may be randomized.
            where: the environment, for messages, such as "a quasi_static 2-X arm".

        Raises:
            ValueError: the design or what is randomized is unknown or out of range; the message names it.
            TypeError: the design is not one of this mechanism.
        """
        self.design = resolve_design(options.design, self.published)
        check_one_design(self.design, where)
        self.observe_all = options.observe == "full"
        self.observe_velocities = options.observe_velocities
        self.randomizable = frozenset(applicable)
        self.randomization = options.randomized(applicable, where, self.noise_scale)

    def set_simulation(self, control: Drivable, options: Options, usual: Dynamics) -> None:
        """Define how the mechanism moves.

        Args:
            control: its inputs.
            options: their backend, and parameters of its dynamics.
            usual: parameters of the dynamics that are not given.

        Raises:
            ValueError: a parameter is unknown or out of range.
            ImportError: MuJoCo is not installed.
        """
        if not options.is_dynamic:
            self.simulation = control
            return
        dynamics = options.dynamics
        if not isinstance(dynamics, Dynamics):
            unknown = [name for name in dynamics or {} if name not in Dynamics.__dataclass_fields__]
            if unknown:
                raise ValueError(
                    f"dynamics: there is no {unknown[0]!r}; there are {', '.join(Dynamics.__dataclass_fields__)}"
                )
            dynamics = replace(usual, **(dynamics or {}))
        from tensegrity_envs.simulation.mujoco import Engine

        self.dynamics = dynamics
        self.engine = Engine(self.nominal, dynamics)
        self.simulation = DynamicControl(control, self.engine.joints, self.engine.physics_size)

    def achieved(self, state: State) -> Components:
        """What is compared with the goal: the tip [m]."""
        return state.tip

    def error(self, xp: Namespace, achieved: Components, goal: Components) -> Component:
        """Distance of the achieved from the desired goal [m]."""
        distance = xp.hypot(achieved[0] - goal[0], achieved[1] - goal[1])
        for here, there in zip(achieved[2:], goal[2:], strict=True):
            distance = xp.hypot(distance, here - there)
        return distance

    def outcome(self, episode: Episode, state: State) -> Outcome:
        """The outcome of being in a state. Traced."""
        xp = namespace_of(state.tip[0])
        seen = self.measured(state)
        achieved = tuple(to_single(component) for component in self.achieved(seen))
        noisy: dict[str, Any] = {}
        true = achieved
        if self.randomization.is_noisy:
            true = tuple(to_single(component) for component in self.achieved(state))
            noisy = {"true_goal": true}
        desired = episode.goal_at(state.time)
        error = self.error(xp, true, desired)
        state = self.task.check_termination(xp, error, state)
        terms = self.task.reward_terms(xp, error, state, episode)
        total: Component = 0.0
        for term in terms.values():
            total = total + term
        info = {
            "is_success": self.task.is_success(error, state, episode),
            self.error_name: error,
            "is_stable": state.stability_margin > 0,
            "is_wrench_feasible": state.wrench_margin >= 0,
            "effort": self.task.effort(state),
            **self.hidden_info(episode, state),
            **noisy,
            **{f"random_{name}": value for name, value in episode.random.items()},
            **self.task.metrics(state, episode),
            **{f"reward_{name}": term for name, term in terms.items()},
        }
        # In single precision, so that a relabelled reward, from inverse solutions found anew, is the same number.
        seen = seen._replace(stability_margin=state.stability_margin, failure=state.failure)
        observation = tuple(self._new_schema().encode(seen, episode))
        return Outcome(state, observation, achieved, desired, to_single(total), info)

    def measured(self, state: State) -> State:
        """The state as the sensors tell it; the tip stays within the goal space."""
        if not state.noise:
            return state
        xp, k = namespace_of(state.tip[0]), len(state.tip)
        r = self.randomization
        tip = tuple(
            xp.minimum(xp.maximum(place + r.tip_noise * z, -self.reach), self.reach)
            for place, z in zip(state.tip, state.noise[:k], strict=True)
        )
        angles = tuple(q + r.angle_noise * z for q, z in zip(state.configuration, state.noise[k:], strict=True))
        return state._replace(tip=tip, configuration=angles)

    def initial(self, episode: Episode, q: Components, inputs: Components | None) -> Outcome:
        """The outcome of the initial state. Traced."""
        state = self.simulation.start(self.mechanism(episode.design), episode, q, inputs)
        state = self.with_clearance(episode, state, state)
        pending = ((0.0,) * self.simulation.action_size,) * self.randomization.longest_delay
        noise = (0.0,) * (len(state.tip) + len(q)) if self.randomization.is_noisy else ()
        return self.outcome(episode, state._replace(pending=pending, noise=noise))

    def transition(self, episode: Episode, state: State, action: Components) -> Outcome:
        """The outcome of a quasi-static step. Traced."""
        assert not isinstance(self.simulation, DynamicControl)
        action, state = self.delayed(episode, state, action)
        new = self.simulation.advance(self.mechanism(episode.design), episode, state, action)
        new = self.with_clearance(episode, state, new)
        return self.outcome(episode, new._replace(pending=state.pending, noise=state.noise, record=state.record))

    def with_clearance(self, episode: Episode, before: State, after: State) -> State:
        """The state after a step with its clearance; where the arm has met an obstacle, the state before, failed.

        Without obstacles, as here, it is the state after the step. Traced.
        """
        return after

    def delayed(self, episode: Episode, state: State, action: Components) -> tuple[Components, State]:
        """The action that is taken now, and the state in which the given one is pending."""
        if not state.pending:
            return action, state
        xp = namespace_of(*action)
        line = (action, *state.pending)
        taken = action
        for k, past in enumerate(state.pending, 1):
            due = episode.random["actuation_delay"] >= k
            taken = tuple(xp.where(due, old, new) for old, new in zip(past, taken, strict=True))
        return taken, state._replace(pending=line[:-1])

    def command(self, episode: Episode, state: State, action: Components) -> Command:
        """What a step tells the engine of a dynamic simulation: its first part. Traced."""
        assert isinstance(self.simulation, DynamicControl)
        action, state = self.delayed(episode, state, action)
        return self.simulation.command(self.mechanism(episode.design), episode, state, action)

    def finish_step(self, episode: Episode, before: State, motion: Motion) -> Outcome:
        """The outcome of what the engine has simulated: the last part of a dynamic step. Traced."""
        assert isinstance(self.simulation, DynamicControl)
        after = self.simulation.finish_step(self.mechanism(episode.design), episode, before, motion)
        return self.outcome(episode, self.with_clearance(episode, before, after))
