"""The spatial prism as environments: following a closed curve, with or without an unknown payload."""

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.core import Core, Sampled
from tensegrity_envs.environments.spatial_prism.sampling import GRAVITY, HARMONICS, Sampler
from tensegrity_envs.mechanics.spatial_prism import JAHROMY, SpatialPrism, SpatialPrismDesign
from tensegrity_envs.observation import (
    Divided,
    Field,
    Softsign,
    SoftsignRate,
    inputs_field,
    margin_fields,
    rates_of,
    tip_field,
)
from tensegrity_envs.options import Options
from tensegrity_envs.rendering import Scene
from tensegrity_envs.rendering.spatial import project
from tensegrity_envs.simulation.dynamic import DynamicControl
from tensegrity_envs.simulation.lengths import LengthControl
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.simulation.protocol import Episode, State
from tensegrity_envs.tasks import Track, TrackWeights

AHEAD = (1, 2, 5, 10)  # steps of the look-ahead
# 200 steps, a cycle, stand for 10 s. What is at the centroid has no mass of its own.
DYNAMICS = Dynamics(tip_mass=0.0, joint_damping=0.05, servo_time=0.002, timestep=0.002, frame_skip=25)


class SpatialPrismTrack(Core):
    """The tracking environments of the spatial prism.

    The centroid of the platform is to follow a closed curve for two cycles (a cycle of 200 steps stands for 10 s); what
    counts is the second one. `desired_goal` is the curve's point of this very moment; the next ones are in the
    observation.

    Args:
        payload_range: if given, every episode attaches an unknown payload of a mass within this range [kg] at an
            unannounced moment, from a tenth to nine tenths of the first cycle.
        trajectory: "mixed", "random", or one of [Jahromy]'s two, "eq31" or "eq32"; see `Sampler`.
        cycle: steps of a cycle.
        design: the design that controllers know, by default JAHROMY; a mapping of some of its fields or the name of a
            published design will do, see `mechanics.designs.resolve_design`.
        observe: "full", or "tip_and_inputs" (no orientation, no margins).
        tolerance: success within this distance all through the second cycle [m]; by default 2 mm at the published
            size, growing with D.
        backend: "quasi_static", or "mujoco" for dynamics. A payload then has weight, but no inertia.
        dynamics: parameters of the dynamics, some of them by name; see `simulation.mujoco.Dynamics`. By default its
            own, but for no mass at the tip, a joint damping of 0.05 N m s/rad (of the orientation), time steps and
            servo time of 2 ms, 25 time steps in a step.

    Raises:
        ValueError: an argument is out of range; the message names it.
        TypeError: `design` is not a design.
        ImportError: backend = "mujoco", and MuJoCo is not installed.
    """

    published = JAHROMY
    info_meanings: ClassVar[dict[str, tuple[str, str]]] = {
        "load": ("N", "force at the centroid"),
        "configuration": ("m, rad", "position of the centroid, and orientation as a rotation vector"),
    }
    simulation: LengthControl | DynamicControl
    design: SpatialPrismDesign
    input_name = "lengths"
    control = "lengths"
    task_type: ClassVar[type[Track]] = Track
    default_weights = TrackWeights()

    def __init__(
        self,
        payload_range: tuple[float, float] | None = None,
        trajectory: str = "mixed",
        cycle: int = 200,
        **shared: Any,
    ) -> None:
        options = Options.of(type(self), shared)
        applicable = {"stiffness", "actuation_delay", "tip_noise"}
        applicable |= options.varied_dynamics | ({"mass"} if options.is_dynamic else set())
        self.take_options(options, applicable, f"a {options.backend} spatial prism")
        self.nominal = SpatialPrism(self.design)
        self.hidden_info_keys = () if payload_range is None else ("load",)
        control = LengthControl(self.nominal, payload_range is not None)
        self.set_simulation(control, options, DYNAMICS)
        self.sampler = Sampler(self.nominal, control, trajectory, cycle, payload_range)
        self.cycle = cycle
        # |r|^2 = mean (l_i^2 - |b_i - a_i|^2) at any orientation: no centroid is farther than a strut can be long
        self.reach = float(self.simulation.bounds(self.nominal)[1])
        self.task = self.task_type(
            input_scale=self.reach,
            cycle=cycle,
            **options.scoring(self.default_weights, 0.002, self.design.D / self.published.D),
        )
        self.set_spaces(goal_size=3)

    def mechanism(self, design: SpatialPrismDesign) -> SpatialPrism:
        """See `Core.mechanism`."""
        return SpatialPrism(design)

    def sample(self, seed: np.ndarray, episode: np.ndarray) -> Sampled:
        """See `Core.sample`."""
        random = self.randomization.sample(seed, episode)
        sampled = self.sampler.sample(seed, episode, random.get("stiffness"))
        load: Components = ()
        if self.hidden_info_keys:
            none = 0.0 * sampled.payload
            load = (none, none, -GRAVITY * sampled.payload)
        onset = sampled.onset if self.hidden_info_keys else None
        episodes = Episode(
            self.design_of(random),
            load,
            (),
            sampled.curve.mean,
            random=random,
            onset=onset,
            motion=sampled.curve.motion,
            cycle=self.cycle,
        )
        position = episodes.goal_at(np.zeros(len(seed)))
        still = np.zeros(len(seed))
        return Sampled(episodes, (*position, still, still, still), self.nominal.unloaded_lengths(position))

    def design_of(self, random: dict[str, np.ndarray]) -> SpatialPrismDesign:
        """The design with the stiffnesses sampled for the episodes; unloaded poses do not depend on them."""
        factor = random.get("stiffness")
        return self.design if factor is None else replace(self.design, k=self.design.k * factor)

    def observed(self) -> list[Field]:
        """See `Core.observed`."""
        bounds = self.simulation.bounds(self.nominal)
        fields = [tip_field(self.reach, 3), inputs_field("lengths", 3, bounds, "m", "lengths of the struts")]
        fields += [self._look_ahead(steps) for steps in AHEAD]
        if self.observe_all:
            meaning = "orientation of the platform, as a rotation vector"
            fields.append(
                Field("rotation", lambda state, _: state.configuration[3:], 3, Divided(np.pi), "rad", meaning)
            )
            fields += margin_fields()
        if self.observe_velocities:
            scaling, meaning = SoftsignRate(self.design.d), "velocity of the centroid"
            fields.append(Field("tip_velocity", lambda s, _: rates_of(s, 6)[:3], 3, scaling, "m/s", meaning))
        if self.observe_velocities and self.observe_all:
            meaning = "angular velocity of the platform"
            fields.append(Field("rotation_rates", lambda s, _: rates_of(s, 6)[3:], 3, SoftsignRate(), "rad/s", meaning))
        return fields

    def _look_ahead(self, steps: int) -> Field:
        """The vector from the tip to the place where the goal will be, scaled by what a tip at full rate covers."""

        def way(state: State, episode: Episode) -> Components:
            goal = episode.goal_at(state.time + steps)
            return tuple(there - here for there, here in zip(goal, state.tip, strict=True))

        meaning = f"goal {steps} step{'s' if steps > 1 else ''} ahead, minus the tip now"
        return Field(f"goal_in_{steps}", way, 3, Softsign(steps * self.simulation.rate), "m", meaning)

    def hidden_info(self, episode: Episode, state: State) -> dict[str, Component | Components]:
        """The force at the centroid [N], where there may be one."""
        return {"load": episode.load_at(state.time)} if self.hidden_info_keys else {}

    def episode_with_goal(self, info: dict[str, np.ndarray], goal: Components) -> Episode:
        """See `Core.episode_with_goal`."""
        still = np.zeros_like(goal[0])
        load = tuple(np.asarray(info["load"], float).T) if self.hidden_info_keys else ()
        onset = still if self.hidden_info_keys else None
        motion = tuple((still,) * (2 * HARMONICS) for _ in goal)
        design = self.design_of(self.random_from(info))
        return Episode(design, load, (), goal, onset=onset, motion=motion, cycle=self.cycle)

    @property
    def frame(self) -> tuple[tuple[float, float], float]:
        """See `Core.frame`; of the projection."""
        return (0.0, 0.0), 0.95 * float(self.design.D)

    def scene(self, episode: Episode, state: State) -> dict[str, Any]:
        """See `Core.scene`; positions in space, which `picture` projects."""
        prism = self.mechanism(episode.design)
        load = episode.load_at(state.time) or (0.0, 0.0, 0.0)
        q, k = state.configuration, float(prism.design.k)
        forces = [*prism.actuator_forces(q, load), *prism.cable_tensions(q, load)]
        forces += [k * length for length in prism.spring_lengths(q)]
        names = [f"{kind} {i}" for kind in ("strut", "cable", "spring") for i in (1, 2, 3)]
        return {
            "nodes": {name: place for name, place in prism.nodes(q).items() if name != "P"},
            "members": prism.members,
            "tensions": dict(zip(names, forces, strict=True)),
            "tension_bounds": (0.0, float(self.design.k) * self.reach),
            "base": (),
            "load": load,
            "load_scale": 5.0,
        }

    def picture(self, episode: Episode, state: State, trace: list[Any], step: int) -> Scene:
        """What `draw` draws: an orthographic projection, the curve and the platform's shadow on the ground."""
        return project(
            self.spatial_picture(episode, state, trace, step),
            faces=(("B1", "B2", "B3"), ("P1", "P2", "P3")),
            centre=(0.0, 0.0, 0.6 * float(self.design.D)),
        )

    def spatial_picture(self, episode: Episode, state: State, trace: list[Any], step: int) -> Scene:
        """See `Core.spatial_picture`."""
        curve = [episode.goal_at(t * self.cycle / 100) for t in range(101)]
        return replace(super().picture(episode, state, trace, step), curve=curve)
