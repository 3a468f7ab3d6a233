"""The dual-triangle arm as environments: reaching, loaded or not, and holding against a push."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from tensegrity_envs.arms.dual_triangle_holding import HoldSampler
from tensegrity_envs.arms.dual_triangle_sampling import Sampler
from tensegrity_envs.compiler.namespace import Component, Components, to_single
from tensegrity_envs.core import Core, Drawn, check_backend, scaled_tolerance, sees_everything, tip_inputs_and_angles
from tensegrity_envs.mechanics.designs import resolve_design
from tensegrity_envs.mechanics.dual_triangle import ZHAO2021_CAPTION, DualTriangle, DualTriangleDesign
from tensegrity_envs.randomization import Randomization
from tensegrity_envs.seeding import EpisodeStream
from tensegrity_envs.simulation.dynamic import DynamicControl
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.simulation.protocol import Episode, State
from tensegrity_envs.simulation.quasi_static import DeltaControl, FreeLengthControl
from tensegrity_envs.tasks import Hold, HoldWeights, Reach, ReachWeights

SEGMENTS = 3
_TARGETS = (5.0, 5.9)  # of holding, along x, in b


class _DualTriangle(Core):
    """What the environments of this arm share."""

    simulation: DeltaControl | DynamicControl
    design: DualTriangleDesign
    observe_all: bool
    observe_velocities: bool = False

    def _take_design(self, design: DualTriangleDesign) -> None:
        self.design = design
        self.nominal = DualTriangle(design, SEGMENTS)
        if not self.nominal.straight_critical_loads()[0] > 0:
            raise ValueError(
                f"design = {design!r}: the straight arm is unstable; "
                "condition (2) of [Zhao2021] asks for a longer nominal free length"
            )
        self.reach = float(self.nominal.reach)
        self.critical_load = float(self.nominal.straight_critical_loads()[0])

    def mechanism(self, design: DualTriangleDesign) -> DualTriangle:
        """See `Core.mechanism`."""
        return DualTriangle(design, SEGMENTS)

    def observation(self, state: State, episode: Episode) -> list[Component]:
        """See `core.tip_inputs_and_angles`."""
        bounds = self.simulation.bounds(self.nominal)
        velocities_of = self.nominal if self.observe_velocities else None
        return tip_inputs_and_angles(state, self.reach, bounds, self.observe_all, velocities_of)

    def _observation_size(self) -> int:
        size = 2 + self.simulation.action_size + (2 * SEGMENTS + 2 if self.observe_all else 0)
        return size + ((SEGMENTS if self.observe_all else 2) if self.observe_velocities else 0)

    def _randomized(self, random: dict[str, np.ndarray]) -> DualTriangleDesign:
        """The design with the stiffnesses that episodes have drawn."""
        factor = random.get("stiffness")
        if factor is None:
            return self.design
        return replace(self.design, k1=self.design.k1 * factor, k2=self.design.k2 * factor)

    def hidden(self, episode: Episode, state: State) -> dict[str, Any]:
        """The tip force [N]."""
        return {"load": episode.load_at(state.time)}

    def scene(self, episode: Episode, state: State) -> dict[str, Any]:
        """See `Core.scene`."""
        arm = self.mechanism(episode.design)
        lengths = self.simulation.actuation(arm, state.inputs)
        forces = arm.spring_forces(state.configuration, lengths)
        springs = [member.name for member in arm.members if member.kind == "spring"]
        largest = float(self.design.k1) * float(self.design.b1)
        return {
            "nodes": arm.nodes(state.configuration),
            "members": arm.members,
            "tensions": dict(zip(springs, forces, strict=True)),
            "tension_bounds": (-largest, largest),
            "base": ("A1", "B1"),
            "load": episode.load_at(state.time),
            "load_scale": self.critical_load,
        }


class DualTriangleReach(_DualTriangle):
    """The dual-triangle reaching environments.

    Args:
        design: of the arm that controllers are told about, by default ZHAO2021_CAPTION; a mapping of some fields or
            the name of a published one will do, see `mechanics.designs.resolve_design`.
        load_range: if given, every episode draws an unknown tip force, of a size within this range (times the straight
            arm's critical load) and in any direction.
        observe: "full", or "tip_and_inputs" (no joint angles, no margins).
        reward_type: "dense" or "sparse".
        reward_weights: of the dense reward, by name; those left out keep their default.
        tolerance: success within this distance [m]; by default 3 mm at the published size, growing with the reach.
        backend: "quasi_static", or "mujoco" for dynamics.
        dynamics: parameters of the dynamics, some of them by name; see `simulation.mujoco.Dynamics`. By default its
            own, but for ten time steps of 2 ms in a step.
        observe_velocities: whether velocities are observed; those of a quasi-static arm are zero.
        randomization: what differs from episode to episode, by name; see `randomization.Randomization`.

    Raises:
        ValueError: an argument is out of range; the message names it.
        TypeError: `design` is not a design.
        ImportError: backend = "mujoco", and MuJoCo is not installed.
    """

    input_name = "control_inputs"
    hidden_names = ("load",)
    control = "delta"

    def __init__(
        self,
        design: DualTriangleDesign | Mapping[str, Any] | str | None = None,
        load_range: tuple[float, float] | None = None,
        observe: Literal["full", "tip_and_inputs"] = "full",
        reward_type: Literal["dense", "sparse"] = "dense",
        reward_weights: dict[str, float] | ReachWeights | None = None,
        tolerance: float | None = None,
        backend: Literal["quasi_static", "mujoco"] = "quasi_static",
        dynamics: Dynamics | dict[str, Any] | None = None,
        observe_velocities: bool = False,
        randomization: Randomization | dict[str, Any] | None = None,
    ) -> None:
        design = resolve_design(design, ZHAO2021_CAPTION)
        self._take_design(design)
        self.observe_all = sees_everything(observe)
        self.observe_velocities = observe_velocities
        check_backend(backend)
        applicable = {"stiffness", "actuation_delay", "tip_noise", "angle_noise"}
        applicable |= {"mass", "damping"} if backend == "mujoco" else set()
        self.randomizable = frozenset(applicable)
        self.randomization = Randomization.given(randomization, applicable, f"a {backend} arm of dual-triangles")
        control = DeltaControl(self.nominal)
        self.set_simulation(control, backend, dynamics, Dynamics(timestep=0.002, frame_skip=10))
        self.task = Reach(
            input_scale=float(design.free_length1),
            joint_span=2 * float(design.joint_limit),
            tolerance=scaled_tolerance(tolerance, 0.003, self.reach, DualTriangle(ZHAO2021_CAPTION, SEGMENTS).reach),
            reward_type=reward_type,
            weights=ReachWeights.given(reward_weights),
        )
        self.sampler = Sampler(self.nominal, control, load_range)
        self.set_spaces(self._observation_size())

    def draw(self, seed: np.ndarray, episode: np.ndarray) -> Drawn:
        """See `Core.draw`."""
        random = self.randomization.draw(seed, episode)
        design = self._randomized(random)
        start = self.sampler.draw(seed, episode, design)
        goal = tuple(to_single(component) for component in self.nominal.tip(start.target_configuration))
        return Drawn(Episode(design, start.load, (), goal, random=random), start.configuration, start.inputs)

    def placed(self, drawn: Drawn, target: Components | None, configuration: Components | None) -> Drawn:
        """See `Core.placed`. The configuration is the unloaded arm's: its inputs are kept while the load is put on.

        A target is reachable where some stable posture under the load holds it; whether a path leads there is not
        checked.
        """
        arm, load = DualTriangle(drawn.episode.design, SEGMENTS), drawn.episode.load
        q, inputs = drawn.configuration, drawn.inputs
        if configuration is not None:
            q, inputs = self.sampler.start_at(arm, configuration, load)
        goal = drawn.episode.goal if target is None else tuple(to_single(component) for component in target)
        if target is not None:
            self.sampler.check_target(arm, goal, load)
        return Drawn(drawn.episode._replace(goal=goal), q, inputs)

    def episode_of(self, info: dict[str, np.ndarray], goal: Components) -> Episode:
        """See `Core.episode_of`."""
        design = self._randomized(self.random_of(info))
        return Episode(design, tuple(np.asarray(info["load"], float).T), (), goal)


class DualTrianglePush(_DualTriangle):
    """Hold the tip on a target while an axial force that is not observed grows.

    The force is in -x and grows linearly, from 0 to 0.3 k b in 150 steps; the inputs are all six free lengths, within
    0 and 1.5 times the nominal one. An episode ends where the arm loses stability or its joint limits, or the tip its
    tolerance. Score: the force at that moment, divided by the straight arm's critical load at the nominal free length;
    success from 1 on.

    Args:
        design: of the arm, by default ZHAO2021_CAPTION; its springs must be bilateral. See
            `mechanics.designs.resolve_design`.
        load_per_step: how much the force grows in a step, divided by k b.
        observe: "full", or "tip_and_inputs" (no joint angles, no margins).
        reward_type: "dense" or "sparse".
        reward_weights: of the dense reward, by name; those left out keep their default.
        tolerance: the episode ends beyond this distance [m]; by default 6 mm at the published size, growing with it.
        randomization: there is nothing to randomize yet: None.

    Raises:
        ValueError: an argument is out of range; the message names it.
        TypeError: `design` is not a design.
    """

    input_name = "free_lengths"
    hidden_names = ()
    control = "free_lengths"

    def __init__(
        self,
        design: DualTriangleDesign | Mapping[str, Any] | str | None = None,
        load_per_step: float = 0.3 / 150,
        observe: Literal["full", "tip_and_inputs"] = "full",
        reward_type: Literal["dense", "sparse"] = "dense",
        reward_weights: dict[str, float] | HoldWeights | None = None,
        tolerance: float | None = None,
        randomization: Randomization | Mapping[str, Any] | None = None,
    ) -> None:
        self.randomization = Randomization.given(randomization, (), "a push")
        design = resolve_design(design, ZHAO2021_CAPTION)
        self._take_design(design)
        if design.springs != "bilateral":
            raise ValueError(f"design.springs = {design.springs!r}: must be 'bilateral'")
        self.observe_all = sees_everything(observe)
        if not (np.isfinite(load_per_step) and load_per_step > 0):
            raise ValueError(f"load_per_step = {load_per_step!r}: must be positive")
        self.simulation = FreeLengthControl(self.nominal)
        self.load_rate = -load_per_step * float(design.k1) * float(design.b1)
        self.task = Hold(
            reference_load=self.critical_load,
            input_scale=FreeLengthControl.highest * float(design.free_length1),
            tolerance=scaled_tolerance(tolerance, 0.006, self.reach, DualTriangle(ZHAO2021_CAPTION, SEGMENTS).reach),
            reward_type=reward_type,
            weights=HoldWeights.given(reward_weights),
        )
        b = float(design.b1)
        highest = float(self.simulation.bounds(self.nominal)[1])
        self.sampler = HoldSampler(self.nominal, (_TARGETS[0] * b, _TARGETS[1] * b), highest)
        self.set_spaces(self._observation_size())

    def draw(self, seed: np.ndarray, episode: np.ndarray) -> Drawn:
        """Targets uniform in x from 5.0 b to 5.9 b, at y = 0; starts uniform over the first angles that hold them."""
        stream = EpisodeStream(seed, episode)
        x = to_single(stream.uniform(*self.sampler.targets))
        q = self.sampler.draw(stream, x)
        episodes = Episode(self.design, (0.0, 0.0), (self.load_rate, 0.0), (x, 0.0 * x))
        return Drawn(episodes, tuple(q), None)

    def placed(self, drawn: Drawn, target: Components | None, configuration: Components | None) -> Drawn:
        """See `Core.placed`. The configuration must hold the target; a target alone draws its start."""
        goal = drawn.episode.goal if target is None else tuple(to_single(component) for component in target)
        if configuration is not None and target is None:
            goal = tuple(to_single(component) for component in self.nominal.tip(configuration))
        low, high = self.sampler.targets
        x, y = (float(component[0]) for component in goal)
        if not (low <= x <= high and abs(y) <= self.task.tolerance):
            raise ValueError(f"target ({x:.6g}, {y:.6g}): must be (x, 0) with x from {low:.6g} to {high:.6g} m")
        if configuration is not None:
            self._check_holds(configuration, goal)
            return Drawn(drawn.episode._replace(goal=goal), configuration, None)
        q = self.sampler.draw(EpisodeStream(np.zeros(1, np.int64), np.zeros(1, np.int64)), goal[0])
        return Drawn(drawn.episode._replace(goal=goal), tuple(q), None)

    def _check_holds(self, q: Components, goal: Components) -> None:
        """Refuse a posture that does not hold the target without a push, all limits kept."""
        tip = self.nominal.tip(q)
        gap = float(np.hypot(tip[0] - goal[0], tip[1] - goal[1])[0])
        if gap > self.task.tolerance:
            raise ValueError(f"configuration: its tip is {gap:.3g} m off the target, more than the tolerance")
        lengths = self.nominal.free_lengths(self.nominal.control(q))
        low, high = self.simulation.bounds(self.nominal)
        fits = all(bool((low <= length).all() and (length <= high).all()) for length in lengths)
        stability = float(self.nominal.stability_margin(q, lengths)[0])
        if not (fits and stability > 0 and np.all(self.nominal.is_within_limits(q))):
            raise ValueError(
                f"configuration: cannot be held within joint limits and free lengths (stability margin {stability:.3g})"
            )

    def episode_of(self, info: dict[str, np.ndarray], goal: Components) -> Episode:
        """See `Core.episode_of`."""
        return Episode(self.design, (0.0, 0.0), (self.load_rate, 0.0), goal)
