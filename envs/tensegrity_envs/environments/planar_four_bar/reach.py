"""The planar 4-bar mechanism as a reaching environment, loaded or not."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, namespace_of, to_single
from tensegrity_envs.core import Core, Sampled
from tensegrity_envs.environments.planar_four_bar.sampling import Sampler
from tensegrity_envs.mechanics.design import take
from tensegrity_envs.mechanics.planar_four_bar import JI2014, PlanarFourBar, PlanarFourBarDesign
from tensegrity_envs.mechanics.planar_four_bar.inverse import rectangles
from tensegrity_envs.mechanics.planar_four_bar.statics import LARGEST_THRUST
from tensegrity_envs.observation import (
    Field,
    SoftsignRate,
    inputs_field,
    joint_angles_field,
    joint_rates_field,
    margin_fields,
    rates_of,
    tip_field,
)
from tensegrity_envs.options import Options
from tensegrity_envs.simulation.actuator_lengths import (
    LoadedLengthControl,
    RectangleControl,
    around_meeting,
    is_open,
)
from tensegrity_envs.simulation.dynamic import DynamicControl
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.simulation.protocol import Episode, State
from tensegrity_envs.tasks import InputReach, ReachWeights

# A bar of 2 kg and 10 m swings once in a second or two, so that a step takes 0.1 s.
DYNAMICS = Dynamics(joint_damping=50.0, servo_time=0.004, timestep=0.004, frame_skip=25)
# Paths lead round actuator lengths with a smaller stability margin.
_MARGIN = 0.1
_MARGIN_LOADED = 0.2


class PlanarFourBarReach(Core):
    """The planar 4-bar reaching environments.

    The side of the line CD on which an episode begins is sampled; info["random_side"] is 1 or -1.

    Args:
        load_range: if given, every episode has an unknown constant force on F, of a size within this range (times
            K L) and in any direction.
        design: the design that controllers know, by default JI2014; a mapping of some of its fields or the name of a
            published design will do, see `mechanics.designs.resolve_design`.
        reward_weights: weights of the dense reward, by name; those left out keep their default, but for effort, which
            is 0: an actuator's length is no effort.
        tolerance: success within this distance [m]; by default 5 cm for bars of 10 m, growing with them.
        backend: "quasi_static", or "mujoco" for dynamics (without a load).
        dynamics: parameters of the dynamics, some of them by name; see `simulation.mujoco.Dynamics`. By default its
            own, but for a joint damping of 50 N m s/rad, time steps and servo time of 4 ms, 25 time steps in a step.

    Raises:
        ValueError: an argument is out of range; the message names it.
        TypeError: `design` is not a design.
        ImportError: backend = "mujoco", and MuJoCo is not installed.
    """

    published = JI2014
    simulation: LoadedLengthControl | DynamicControl
    design: PlanarFourBarDesign
    input_name = "actuator_lengths"
    hidden_info_keys = ("load",)
    noise_scale = 20.0
    info_meanings: ClassVar[dict[str, tuple[str, str]]] = {
        "load": ("N", "force on F"),
        "thrusts": ("N", "thrusts of the actuators"),
        "random_side": ("-", "on which side of the line CD the episode runs, 1 or -1"),
    }
    control = "actuator_lengths"
    task_type: ClassVar[type[InputReach]] = InputReach
    default_weights = ReachWeights(effort=0.0)

    def __init__(self, load_range: tuple[float, float] | None = None, **shared: Any) -> None:
        options = Options.of(type(self), shared)
        if load_range is not None and options.is_dynamic:
            raise ValueError(f"load_range = {load_range!r}: there are no dynamics under a load yet; give None")
        applicable = {"stiffness", "actuation_delay", "tip_noise", "angle_noise"}
        applicable |= options.varied_dynamics | ({"mass"} if options.is_dynamic else set())
        self.take_options(options, applicable, f"a {options.backend} planar 4-bar mechanism")
        self.nominal = PlanarFourBar(self.design)
        self.reach = float(self.nominal.reach)
        control = (RectangleControl if load_range is None else LoadedLengthControl)(self.nominal)
        self.set_simulation(control, options, DYNAMICS)
        self.task = self.task_type(
            input_scale=2 * float(self.design.length),
            joint_span=2.5 * float(self.design.length),
            obstacle=around_meeting(self.nominal, _MARGIN if load_range is None else _MARGIN_LOADED),
            **options.scoring(self.default_weights, 0.05, self.design.length / self.published.length),
        )
        self.sampler = Sampler(self.nominal, control, load_range)
        self.set_spaces()

    def tip_region(self) -> Any:
        """The tips of stable rectangles; see `Core.tip_region`."""
        from tensegrity_envs.geometry.four_bar_workspace import output_workspace  # loads Shapely

        return output_workspace(self.nominal).reachable

    def mechanism(self, design: PlanarFourBarDesign) -> PlanarFourBar:
        """See `Core.mechanism`."""
        return PlanarFourBar(design)

    def sample(self, seed: np.ndarray, episode: np.ndarray) -> Sampled:
        """See `Core.sample`."""
        return self.solved(seed, episode)[0]

    def solved(self, seed: np.ndarray, episode: np.ndarray) -> tuple[Sampled, Components]:
        """The episodes of the given pairs, and actuator lengths that solve each of them [m]."""
        random = self.randomization.sample(seed, episode)
        start = self.sampler.sample(seed, episode, random.get("stiffness"))
        goal = tuple(to_single(component) for component in start.target)
        solutions = self._solutions(goal, start.side)
        random |= {"side": start.side}
        episodes = Episode(self.design_of(random), start.load, (), goal, solutions, random)
        return Sampled(episodes, start.configuration, start.lengths), start.target_lengths

    def placed(self, sampled: Sampled, target: Components | None, configuration: Components | None) -> Sampled:
        """See `Core.placed`. A configuration follows from the lengths: it cannot be chosen."""
        if configuration is not None:
            raise ValueError("'configuration' cannot be chosen in this environment: it follows from actuator lengths")
        assert target is not None
        goal = tuple(to_single(component) for component in target)
        x, y = (float(component[0]) for component in goal)
        side = sampled.episode.random["side"]
        load = tuple(float(force[0]) for force in sampled.episode.load)
        mechanism = PlanarFourBar(take(sampled.episode.design, 0))
        low, high = self.simulation.bounds(self.nominal)
        fits = [
            found
            for found in mechanism.inverse_kinematics(x, y, load)
            if found.is_stable and found.side == side[0] and all(low <= length <= high for length in found.lengths)
        ]
        if not fits:
            raise ValueError(
                f"target ({x:.6g}, {y:.6g}): no stable state on this episode's side, {int(side[0])}, has F there with "
                f"lengths from {float(low):.6g} to {float(high):.6g} m"
            )
        return Sampled(
            sampled.episode._replace(goal=goal, solutions=self._solutions(goal, side)),
            sampled.configuration,
            sampled.inputs,
        )

    def _solutions(self, goal: Components, side: np.ndarray) -> tuple[Components, ...]:
        """Actuator lengths of unloaded rectangles on a side, with F at goals of shape (n,) [m].

        Four; those that do not exist or are too close to a singularity are out of reach. Under a force they are off
        the target, but lead near it.
        """
        if self.task.reward_type != "dense":
            return ()
        found, sides, exists = rectangles(self.nominal, *goal)
        fits = exists & (sides == side) & is_open(self.nominal, tuple(found), self.sampler.safe_margin)
        found = np.where(fits, found, 100 * self.reach)
        return tuple((found[0, k], found[1, k]) for k in range(4))

    def design_of(self, random: dict[str, np.ndarray]) -> PlanarFourBarDesign:
        """The design with the stiffnesses sampled for the episodes; unloaded rectangles do not depend on them."""
        factor = random.get("stiffness")
        return self.design if factor is None else replace(self.design, stiffness=self.design.stiffness * factor)

    def observed(self) -> list[Field]:
        """See `Core.observed`."""
        bounds = self.simulation.bounds(self.nominal)
        fields = [tip_field(self.reach), inputs_field(self.input_name, 2, bounds, "m", "actuator lengths")]
        if self.observe_all:
            fields += [joint_angles_field(2, "angles theta and gamma of the bars DE and CF"), *margin_fields()]
        if self.observe_velocities and self.observe_all:
            fields.append(joint_rates_field(4, "rates of the angles alpha, beta, theta and gamma"))
        elif self.observe_velocities:
            scaling = SoftsignRate(self.reach)
            fields.append(Field("tip_velocity", self._tip_velocity, 2, scaling, "m/s", "velocity of the tip"))
        return fields

    def _tip_velocity(self, state: State, episode: Episode) -> Components:
        """The velocity of F [m/s]: bar BC turns C about B, and bar CF turns F about C."""
        (_, beta), gamma = self.nominal.base_angles(state.inputs), state.configuration[1]
        xp = namespace_of(beta, gamma)
        _, base, _, bar = rates_of(state, 4)
        x = base * xp.sin(beta) - bar * xp.sin(gamma)
        y = base * xp.cos(beta) + bar * xp.cos(gamma)
        return self.nominal.length * x, self.nominal.length * y

    def hidden_info(self, episode: Episode, state: State) -> dict[str, Component | Components]:
        """The force on F and the thrusts of the actuators [N]."""
        mechanism = self.mechanism(episode.design)
        return {"load": episode.load, "thrusts": mechanism.thrusts(state.configuration, state.inputs, episode.load)}

    def episode_with_goal(self, info: dict[str, np.ndarray], goal: Components) -> Episode:
        """See `Core.episode_with_goal`."""
        random = self.random_from(info)
        load = tuple(np.asarray(info["load"], float).T)
        return Episode(self.design_of(random), load, (), goal, self._solutions(goal, random["side"]))

    def places(self, sampled: Sampled) -> Iterable[Any]:
        """See `Core.places`."""
        return list(self.nominal.nodes(sampled.configuration, sampled.inputs).values())

    def scene(self, episode: Episode, state: State) -> dict[str, Any]:
        """See `Core.scene`."""
        mechanism = self.mechanism(episode.design)
        forces = mechanism.member_forces(state.configuration, state.inputs, episode.load)
        force = float(mechanism.largest_force)
        return {
            "nodes": mechanism.nodes(state.configuration, state.inputs),
            "members": mechanism.members,
            "tensions": {m.name: forces[m.name] for m in mechanism.members if m.kind != "bar"},
            "tension_bounds": (-LARGEST_THRUST * force, LARGEST_THRUST * force),
            "base": ("A", "B"),
            "load": episode.load,
            "load_scale": 0.2 * force,
        }
