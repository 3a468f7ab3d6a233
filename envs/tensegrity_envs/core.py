"""An environment as pure functions on components: mechanism x simulation x task, compiled.

A batch of n environments is two matrices: the running episodes (what stays the same) and their states, one column for
each environment. A step makes a matrix of outcomes (state, observation, reward, info). The single shell holds matrices
of one column, the vector shell of n; both run the same machine code.
"""

import hashlib
import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from tensegrity_envs.compiler.kernel import Kernel
from tensegrity_envs.compiler.namespace import Component, Components, Namespace, namespace_of, to_single
from tensegrity_envs.compiler.pytree import Schema, as_matrix, is_row, tree_leaves
from tensegrity_envs.compiler.threads import Threads
from tensegrity_envs.mechanics.designs import resolve_design
from tensegrity_envs.observation import Field, ObservationSchema
from tensegrity_envs.options import OPTION_NAMES, Options, share_options
from tensegrity_envs.randomization import Randomization
from tensegrity_envs.rendering import Scene, frame_around
from tensegrity_envs.simulation.dynamic import Command, Drivable, DynamicControl, Motion
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.simulation.protocol import FAILURES, RUNNING, Episode, Simulation, State
from tensegrity_envs.tasks import Task, Weights

if TYPE_CHECKING:
    from tensegrity_envs.simulation.mujoco.engine import Engine

_FRAMED = 256  # episodes whose starts and goals are in the frame of a picture

# The info of one step, of several in a sequence or in a dict of arrays, or none at all.
Infos = Mapping[str, Any] | Sequence[Mapping[str, Any]] | np.ndarray | None


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


class InfoEntry(NamedTuple):
    """Where an entry of `info` stands in a matrix of outcomes: in row `first`, or from there to `end`."""

    name: str
    first: int
    end: int | None
    kind: str


def _is_empty(info: Infos) -> bool:
    """Whether there is no info: None, an empty dict, or several of them."""
    if info is None or isinstance(info, dict):
        return not info
    return isinstance(info, Sequence | np.ndarray) and all(one is None or one == {} for one in info)


class Core(ABC):
    """An environment without its shell. A subclass brings mechanism, actuation, sampling, observation and picture.

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
        info_meanings: unit and meaning of the entries of `info` that only this environment has.
        can_fail: whether episodes may be terminated; a subclass whose episodes end by the time limit alone says False.
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
    info_meanings: ClassVar[dict[str, tuple[str, str]]] = {}
    can_fail: bool = True
    shows_joint_space: bool = False
    dynamics: Dynamics | None = None
    engine: "Engine | None" = None
    observation_space: spaces.Dict
    action_space: spaces.Box

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Show the shared options of a subclass in its signature and its help."""
        super().__init_subclass__(**kwargs)
        share_options(cls, cls.shared)

    def _made_on_use(self) -> dict[str, Any]:
        """Kernels, layouts and what else follows from the rest, as far as it has been made."""
        return {
            name: value
            for name, value in vars(self).items()
            if isinstance(getattr(type(self), name, None), cached_property)
        }

    def __getstate__(self) -> dict[str, Any]:
        """What a copy in another process needs: the rest is made anew, kernels from the disk."""
        made = self._made_on_use()
        return {name: value for name, value in vars(self).items() if name not in made}

    def __deepcopy__(self, memo: dict[int, Any]) -> "Core":
        """A copy with its own engine. Kernels and layouts never change and take long to make: both have them."""
        other = object.__new__(type(self))
        memo[id(self)] = other
        vars(other).update(deepcopy(self.__getstate__(), memo) | self._made_on_use())
        return other

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

    @cached_property
    def fingerprint(self) -> str:
        """A text by which states of this environment are known from those of others."""
        parts = (self.design, self.randomization, self.dynamics, self.task, self.episodes.rows, self.outcomes.rows)
        digest = hashlib.sha256(repr(parts).encode()).hexdigest()[:12]
        return f"{type(self).__name__} {digest}"

    def set_spaces(self, goal_size: int = 2, goal_bound: float | None = None) -> None:
        """Define the spaces; goals are within the reach [m], unless another bound is given."""
        bound = self.reach if goal_bound is None else goal_bound
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
        self.observe_all = options.observe == "full"
        self.observe_velocities = options.observe_velocities
        self.randomizable = frozenset(applicable)
        self.randomization = options.randomized(applicable, where)

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

    # ------------------------------------------------------------------------------------- what happens, traceable

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
        pending = ((0.0,) * self.simulation.action_size,) * self.randomization.longest_delay
        noise = (0.0,) * (len(state.tip) + len(q)) if self.randomization.is_noisy else ()
        return self.outcome(episode, state._replace(pending=pending, noise=noise))

    def transition(self, episode: Episode, state: State, action: Components) -> Outcome:
        """The outcome of a quasi-static step. Traced."""
        assert not isinstance(self.simulation, DynamicControl)
        action, state = self.delayed(episode, state, action)
        new = self.simulation.advance(self.mechanism(episode.design), episode, state, action)
        return self.outcome(episode, new._replace(pending=state.pending, noise=state.noise, record=state.record))

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
        return self.outcome(episode, self.simulation.arrive(self.mechanism(episode.design), episode, before, motion))

    # ------------------------------------------------------------------------------------------ batches, as matrices

    @cached_property
    def _sampled_schemas(self) -> tuple[Schema, Schema, Schema]:
        """Schemas of episodes, start configurations and start inputs, which are the same for all samples."""
        sampled = self.sample(np.zeros(1, np.int64), np.zeros(1, np.int64))
        return Schema(sampled.episode), Schema(sampled.configuration), Schema(sampled.inputs)

    @property
    def episodes(self) -> Schema:
        """The schema of a matrix of episodes."""
        return self._sampled_schemas[0]

    @cached_property
    def _begin(self) -> Kernel:
        return Kernel(self.initial, *self._sampled_schemas)

    @property
    def outcomes(self) -> Schema:
        """The schema of a matrix of outcomes."""
        return self._begin.result

    @cached_property
    def states(self) -> Schema:
        """The schema of a matrix of states, which are the first rows of a matrix of outcomes."""
        return Schema(self.outcomes.rows.state, is_row, lambda row: row.kind)

    @cached_property
    def _step(self) -> Kernel:
        actions = Schema(tuple(np.zeros(1) for _ in range(self.simulation.action_size)))
        return Kernel(self.transition, self.episodes, self.states, actions)

    @cached_property
    def _command(self) -> Kernel:
        actions = Schema(tuple(np.zeros(1) for _ in range(self.simulation.action_size)))
        return Kernel(self.command, self.episodes, self.states, actions)

    @cached_property
    def _arrive(self) -> Kernel:
        assert self.engine is not None
        return Kernel(self.finish_step, self.episodes, self.states, self.engine.motions)

    @cached_property
    def _outcome(self) -> Kernel:
        return Kernel(self.outcome, self.episodes, self.states)

    def begin(self, seed: np.ndarray, episode: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Begin the episodes of the given (seed, episode) pairs, both of shape (n,).

        Returns:
            The matrices of episodes and of outcomes.
        """
        return self.begin_sampled(self.sample(seed, episode))

    def begin_sampled(self, sampled: Sampled) -> tuple[np.ndarray, np.ndarray]:
        """Begin episodes that were sampled; see `begin`."""
        schemas, count = self._sampled_schemas, len(sampled.configuration[0])
        matrices = [schema.pack(part, count) for schema, part in zip(schemas, sampled, strict=True)]
        episodes, outcomes = matrices[0], self._begin(*matrices)
        if self.engine is not None:
            self._begin_motion(outcomes)
        if self.randomization.is_noisy:
            outcomes = self._outcome(episodes, self._with_noise(episodes, outcomes, 0))
        return episodes, self.postprocess(episodes, outcomes)

    def step(
        self, episodes: np.ndarray, states: np.ndarray, actions: np.ndarray, threads: Threads | None = None
    ) -> np.ndarray:
        """The outcomes one step later, for actions of shape (action size, n) in [-1, 1].

        Args:
            episodes: matrix of the running episodes.
            states: matrix of states, or of outcomes.
            actions: shape (action size, n).
            threads: that evaluate the kernel of a quasi-static step; None for the caller's alone.
        """
        if threads is None and self._is_one_kernel:
            return self._step(episodes, states, actions)
        if self.randomization.is_noisy:
            states = self._with_noise(episodes, states, 1)
        if self.engine is None:
            given = episodes, states, actions
            outcomes = self._step(*given) if threads is None else threads(self._step, *given)
        else:
            commands = self._command(episodes, states, actions)
            rows = self._command.result.rows
            outcomes = self._arrive(
                episodes,
                commands[: self.states.size],
                self.engine.move(
                    commands[list(rows.state.physics)],
                    commands[list(rows.actuation)],
                    commands[list(rows.load)],
                    self._models(episodes),
                ),
            )
        return as_matrix(self.postprocess(episodes, outcomes))  # which may be anybody's

    @cached_property
    def _is_one_kernel(self) -> bool:
        """Whether a step is that and nothing else."""
        is_changed = type(self).postprocess is not Core.postprocess
        return self.engine is None and not self.randomization.is_noisy and not is_changed

    def _begin_motion(self, outcomes: np.ndarray) -> None:
        """Put the engine's state of an arm at rest into the outcomes."""
        assert self.engine is not None and isinstance(self.simulation, DynamicControl)
        rows = self.states.rows
        inputs = tuple(outcomes[list(rows.inputs)])
        actuation = np.stack(self.simulation.actuation(self.nominal, inputs))
        u = self.simulation.coordinates(self.nominal, tuple(outcomes[list(rows.configuration)]), inputs)
        outcomes[list(rows.physics)] = self.engine.begin(np.stack(u), actuation)

    def _with_noise(self, episodes: np.ndarray, states: np.ndarray, later: int) -> np.ndarray:
        """The states with the noise of so many steps later."""
        rows = self.states.rows
        states = states[: self.states.size].copy()
        key = episodes[self.episodes.rows.random["noise_key"]]
        states[list(rows.noise)] = Randomization.normals(key, states[rows.time] + later, len(rows.noise))
        return states

    @cached_property
    def _varied(self) -> list[int]:
        """Rows of the matrix of episodes on which a simulation's parameters depend."""
        rows = self.episodes.rows
        random = [row for name, row in rows.random.items() if name in ("mass", "damping")]
        return [int(row) for row in (*tree_leaves(rows.design, is_row), *random)]

    def _models(self, episodes: np.ndarray) -> list[Any] | None:
        """The engine's model of every episode; None where all are the same."""
        if not self._varied:
            return None
        assert self.engine is not None
        keys = episodes[self._varied].T.tolist()
        return self.engine.models_of([tuple(key) for key in keys], lambda i: self._parameters(episodes[:, i]))

    def _parameters(self, column: np.ndarray) -> tuple[Any, Dynamics]:
        """Mechanism and dynamics of an episode."""
        assert self.dynamics is not None
        episode = self.episodes.unpack(column)
        mass, damping = (episode.random.get(name, 1.0) for name in ("mass", "damping"))
        own = self.dynamics
        dynamics = replace(
            own,
            joint_damping=damping * own.joint_damping,
            bar_line_density=mass * own.bar_line_density,
            tip_mass=mass * own.tip_mass,
            platform_mass=mass * own.platform_mass,
        )
        return self.mechanism(episode.design), dynamics

    def evaluate(self, episodes: np.ndarray, states: np.ndarray) -> np.ndarray:
        """The outcomes of being in these states."""
        return self.postprocess(episodes, self._outcome(episodes, states))

    def postprocess(self, episodes: np.ndarray, outcomes: np.ndarray) -> np.ndarray:
        """The outcomes with what compiled code cannot compute, such as look-ups in a table; unchanged here."""
        return outcomes

    @cached_property
    def info_entries(self) -> list[InfoEntry]:
        """The entries of `info`."""
        rows = self.outcomes.rows
        of_state = {
            "stability_margin": rows.state.stability_margin,
            "wrench_margin": rows.state.wrench_margin,
            "failure": rows.state.failure,
            "configuration": rows.state.configuration,
            **({self.input_name: rows.state.inputs} if self.input_name else {}),
        }
        entries = []
        for name, place in (rows.info | of_state).items():
            at = place if isinstance(place, tuple) else (place,)
            entries.append(InfoEntry(name, int(at[0]), int(at[-1]) + 1 if at is place else None, at[0].kind))
        return entries

    # ------------------------------------------------------------------------------------------------ relabelling

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

    def places(self, sampled: Sampled) -> Iterable[Any]:
        """Positions [m] of the nodes of planar arms at the start of episodes, for the frame of pictures."""
        return list(self.nominal.nodes(sampled.configuration).values())

    @cached_property
    def frame(self) -> tuple[tuple[float, float], float]:
        """Centre [m] and half of the side [m] of the square that pictures show: where the arm and its goals are."""
        sampled = self.sample(np.zeros(_FRAMED, np.int64), np.arange(_FRAMED))
        places = list(self.places(sampled))
        if self.error_unit == "mm":
            places.append(sampled.episode.goal_at(0.0))
        return frame_around(places)

    def error_text(self, error: float) -> str:
        """A distance to the goal for people: thousandths, or whole units for arms as large as a room, to a fiftieth of
        the tolerance or so.
        """
        whole = self.error_unit == "mm" and self.task.tolerance >= 0.02
        factor, unit = (1, self.error_unit.removeprefix("m")) if whole else (1000, self.error_unit)
        decimals = max(0, 1 - math.floor(math.log10(factor * self.task.tolerance)))
        return f"{factor * error:.{decimals}f} {unit}"

    def picture(self, episode: Episode, state: State, trace: list[Any], step: int) -> Scene:
        """What `render` draws."""
        error = float(self.error(np, self.achieved(state), episode.goal_at(state.time)))
        usual: dict[str, Any] = {
            "tip": state.tip,
            "target": episode.goal_at(state.time),
            "tolerance": self.task.tolerance,
            "trace": trace,
            "margins": {"stability": state.stability_margin, "wrench": state.wrench_margin},
            "caption": f"step {step}   {self.error_name.replace('_', ' ')} {self.error_text(error)}",
            "centre": self.frame[0],
            "reach": self.frame[1],
            "failure": FAILURES[state.failure],
        }
        return Scene(**(usual | self.scene(episode, state)))
