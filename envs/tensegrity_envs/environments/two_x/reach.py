"""The 2-X manipulator as a reaching environment."""

from dataclasses import replace
from typing import Any, ClassVar, Literal

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, to_single
from tensegrity_envs.core import Core, Sampled
from tensegrity_envs.environments.two_x.regions import TwoXRegions
from tensegrity_envs.environments.two_x.sampling import Drawn, Sampler, feasible_solutions
from tensegrity_envs.mechanics.two_x import MURALIDHARAN2022, TwoX
from tensegrity_envs.observation import Field, arm_fields, inputs_field
from tensegrity_envs.options import Options
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.simulation.protocol import Episode, State
from tensegrity_envs.simulation.quasi_static import JointControl, TensionControl
from tensegrity_envs.tasks import Reach, ReachWeights

JOINT_LIMIT = 2.6  # [rad] shared with the MuJoCo variants, where a loop could flip beyond it
CONTROLS = ("joint", "tension")


def environment_design(design: Any = MURALIDHARAN2022) -> Any:
    """The design as the environments use it: joint limits of at most 2.6 rad."""
    return replace(design, joint_limit=min(design.joint_limit, JOINT_LIMIT))


class TwoXReach(TwoXRegions, Core):
    """The 2-X reaching environments.

    Args:
        control: "joint" (two increments of at most 0.1 rad) or "tension" (four of at most 15 N).
        payload_range: if given, every episode has an unknown payload from it [kg], uniformly; it may be given in
            `randomization` instead.
        design: the design that controllers know, by default MURALIDHARAN2022; a mapping of some of its fields or the
            name of a published design will do, see `mechanics.designs.resolve_design`. Joint limits beyond 2.6 rad are
            narrowed to that.
        tolerance: success within this distance [m]; by default 5 mm at the published size, growing with the reach.
        backend: "quasi_static", or "mujoco" for dynamics (tension control only).

    Raises:
        ValueError: an argument is out of range; the message names it.
        TypeError: `design` is not a design.
        ImportError: backend = "mujoco", and MuJoCo is not installed.
    """

    published: ClassVar[Any] = MURALIDHARAN2022
    arm_name: ClassVar[str] = "2-X arm"
    sampler_type: ClassVar[type[Sampler]] = Sampler
    nominal: Any
    input_name = "tensions"
    hidden_info_keys = ("payload",)
    info_meanings: ClassVar[dict[str, tuple[str, str]]] = {"payload": ("kg", "payload at the tip")}
    task_type: ClassVar[type[Reach]] = Reach
    default_weights = ReachWeights()

    def __init__(
        self,
        control: Literal["joint", "tension"] = "joint",
        payload_range: tuple[float, float] | None = None,
        **shared: Any,
    ) -> None:
        options = Options.of(type(self), shared)
        if control not in CONTROLS:
            raise ValueError(f"control = {control!r}: must be one of {', '.join(map(repr, CONTROLS))}")
        if control == "joint" and options.is_dynamic:
            raise ValueError(
                f"backend = {options.backend!r}: needs control = 'tension' (cables pull, joints have no motors)"
            )
        applicable = {"stiffness", "mass", "payload", "actuation_delay", "tip_noise", "angle_noise"}
        applicable |= options.varied_dynamics
        self.take_options(options, applicable, f"a {options.backend} {self.arm_name}")
        if control != "tension" or payload_range is not None:
            self.randomizable -= {"payload"}
        if self.randomization.payload is not None:
            if payload_range is not None:
                raise ValueError("payload_range, and a payload in randomization: give one of them")
            payload_range = self.randomization.payload
        if payload_range is not None and control != "tension":
            raise ValueError(
                "payload_range: needs control = 'tension' (in joint control the cables would give the payload away)"
            )
        self.control = control
        self.design = environment_design(self.design)
        self.nominal = self.mechanism(self.design)
        self.reach = float(self.nominal.reach)
        if control == "joint":
            self.simulation = JointControl(self.nominal.degrees_of_freedom)
        else:
            self.set_simulation(TensionControl(len(self.nominal.input_names)), options, Dynamics())
        self.payload_range = payload_range
        self.task = self.task_type(
            input_scale=float(self.design.max_tension),
            joint_span=2 * self.design.joint_limit,
            **options.scoring(self.default_weights, 0.005, self.nominal.reach / self.mechanism(self.published).reach),
        )
        self.sampler = self.sampler_type(self.design, payload_range)
        self.set_spaces()

    def mechanism(self, design: Any) -> Any:
        """See `Core.mechanism`."""
        return TwoX(design)

    def solutions(self, mechanism: Any, goal: Components, known: Components | None = None) -> tuple[Components, ...]:
        """Configurations that solve the goals (x, y, ...), for the dense reward; see `feasible_solutions`."""
        return feasible_solutions(mechanism, goal[0], goal[1], known) if self.task.reward_type == "dense" else ()

    def drawn_goal(self, drawn: Drawn, seed: np.ndarray, episode: np.ndarray) -> Components:
        """The goals of sampled episodes, as float32 numbers."""
        return tuple(to_single(component) for component in drawn.mechanism.tip(drawn.target_configuration))

    def postures(self, mechanism: Any, x: np.ndarray, y: np.ndarray) -> tuple[Components, ...]:
        """Stable, wrench-feasible configurations of a batch of one with the tip there; infinity where there is none."""
        return feasible_solutions(mechanism, x, y)

    def sample(self, seed: np.ndarray, episode: np.ndarray) -> Sampled:
        """See `Core.sample`."""
        return self.solved(seed, episode)[0]

    def solved(self, seed: np.ndarray, episode: np.ndarray) -> tuple[Sampled, Components]:
        """The episodes of the given pairs, and a configuration that solves each of them [rad]."""
        random = self.randomization.sample(seed, episode)
        sampled = self.sampler.sample(seed, episode, self.design_of(random))
        goal = self.drawn_goal(sampled, seed, episode)
        solutions = self.solutions(sampled.mechanism, goal, sampled.target_configuration)
        episodes = Episode(sampled.mechanism.design, (0.0, 0.0), (), goal, solutions, random)
        return Sampled(episodes, sampled.configuration, sampled.tensions), sampled.target_configuration

    def placed(self, sampled: Sampled, target: Components | None, configuration: Components | None) -> Sampled:
        """See `Core.placed`. With a hidden payload the configuration is the nominal arm's, under no payload."""
        mechanism, q, tensions = self.mechanism(sampled.episode.design), sampled.configuration, sampled.inputs
        if configuration is not None:
            q, tensions = self.sampler.start_at(mechanism, configuration, tensions is not None)
        goal = sampled.episode.goal if target is None else tuple(to_single(component) for component in target)
        x, y = goal[:2]
        found = self.postures(mechanism, x, y)
        reachable = self.sampler.in_reach(mechanism, q, found)
        if not reachable.any():
            where = f"target ({float(x[0]):.6g}, {float(y[0]):.6g})"
            if not np.isfinite(found[0][0]).any():
                raise ValueError(f"{where}: no stable, wrench-feasible configuration puts the tip there")
            raise ValueError(
                f"{where}: in another connected component of the stable wrench-feasible set than the start, {q}"
            )
        solutions = self.solutions(mechanism, goal)
        return Sampled(sampled.episode._replace(goal=goal, solutions=solutions), q, tensions)

    def design_of(self, random: dict[str, np.ndarray]) -> Any:
        """The design with the stiffnesses and masses sampled for the episodes."""
        design = self.design
        if "stiffness" in random:
            design = self.stiffened(design, random["stiffness"])
        if "mass" in random:
            design = replace(design, bar_density=design.bar_density * random["mass"])
        return design

    def stiffened(self, design: Any, factor: np.ndarray) -> Any:
        """The design with springs so many times as stiff."""
        return replace(design, k1=design.k1 * factor, k2=design.k2 * factor)

    def observed(self) -> list[Field]:
        """See `Core.observed`."""
        bounds = (self.design.min_tension, self.design.max_tension)
        inputs = inputs_field("tensions", len(self.nominal.input_names), bounds, "N", "cable tensions")
        joints = self.nominal.degrees_of_freedom
        return arm_fields(self.nominal, self.reach, inputs, joints, self.observe_all, self.observe_velocities)

    def hidden_info(self, episode: Episode, state: State) -> dict[str, Component | Components]:
        """The payload [kg]."""
        return {"payload": episode.design.payload}

    def episode_with_goal(self, info: dict[str, np.ndarray], goal: Components) -> Episode:
        """See `Core.episode_with_goal`."""
        design = self.design_of(self.random_from(info))
        if self.payload_range is not None:
            design = replace(design, payload=np.asarray(info["payload"], float))
        return Episode(design, (0.0, 0.0), (), goal, self.solutions(self.mechanism(design), goal))

    def scene(self, episode: Episode, state: State) -> dict[str, Any]:
        """See `Core.scene`."""
        arm = self.mechanism(episode.design)
        return {
            "nodes": arm.nodes(state.configuration),
            "members": arm.members,
            "tensions": {f"cable {name}": f for name, f in zip(arm.input_names, state.inputs, strict=True)},
            "tension_bounds": (self.design.min_tension, self.design.max_tension),
        }
