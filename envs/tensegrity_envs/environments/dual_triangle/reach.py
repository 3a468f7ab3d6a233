"""The dual-triangle arm as a reaching environment, loaded or not."""

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from tensegrity_envs.compiler.namespace import Components, to_single
from tensegrity_envs.core import Sampled, check_backend, is_fully_observed, scaled_tolerance
from tensegrity_envs.environments.dual_triangle.arm import SEGMENTS, DualTriangleCore
from tensegrity_envs.environments.dual_triangle.sampling import Sampler
from tensegrity_envs.mechanics.designs import resolve_design
from tensegrity_envs.mechanics.dual_triangle import ZHAO2021_CAPTION, DualTriangle, DualTriangleDesign
from tensegrity_envs.randomization import Randomization
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.simulation.protocol import Episode
from tensegrity_envs.simulation.quasi_static import DeltaControl
from tensegrity_envs.tasks import Reach, ReachWeights


class DualTriangleReach(DualTriangleCore):
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
    hidden_info_keys = ("load",)
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
        self.observe_all = is_fully_observed(observe)
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
        self.set_spaces()

    def sample(self, seed: np.ndarray, episode: np.ndarray) -> Sampled:
        """See `Core.sample`."""
        random = self.randomization.sample(seed, episode)
        design = self._randomized(random)
        start = self.sampler.sample(seed, episode, design)
        goal = tuple(to_single(component) for component in self.nominal.tip(start.target_configuration))
        return Sampled(Episode(design, start.load, (), goal, random=random), start.configuration, start.inputs)

    def placed(self, drawn: Sampled, target: Components | None, configuration: Components | None) -> Sampled:
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
        return Sampled(drawn.episode._replace(goal=goal), q, inputs)

    def episode_with_goal(self, info: dict[str, np.ndarray], goal: Components) -> Episode:
        """See `Core.episode_with_goal`."""
        design = self._randomized(self.random_from(info))
        return Episode(design, tuple(np.asarray(info["load"], float).T), (), goal)
