"""The dual-triangle arm as a reaching environment, loaded or not."""

from typing import Any, ClassVar

import numpy as np

from tensegrity_envs.compiler.namespace import Components, to_single
from tensegrity_envs.core import Sampled
from tensegrity_envs.environments.dual_triangle.arm import PUBLISHED_SEGMENTS, DualTriangleCore
from tensegrity_envs.environments.dual_triangle.sampling import Sampler
from tensegrity_envs.options import Options
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.simulation.protocol import Episode
from tensegrity_envs.simulation.quasi_static import DeltaControl
from tensegrity_envs.tasks import Reach, ReachWeights


class DualTriangleReach(DualTriangleCore):
    """The dual-triangle reaching environments.

    Args:
        load_range: if given, every episode has an unknown tip force, of a size within this range (times the straight
            arm's critical load) and in any direction.
        segments: how many the arm has, two or more; the published arm has three.
        design: the design that controllers know, by default ZHAO2021_CAPTION; a mapping of some of its fields or the
            name of a published design will do, see `mechanics.designs.resolve_design`. A field may have a number for
            each segment.
        tolerance: success within this distance [m]; by default 3 mm at the published size, growing with the reach.
        dynamics: parameters of the dynamics, some of them by name; see `simulation.mujoco.Dynamics`. By default its
            own, but for ten time steps of 2 ms in a step.

    Raises:
        ValueError: an argument is out of range; the message names it.
        TypeError: `design` is not a design, or `segments` no integer.
        ImportError: backend = "mujoco", and MuJoCo is not installed.
    """

    input_name = "control_inputs"
    hidden_info_keys = ("load",)
    control = "delta"
    task_type: ClassVar[type[Reach]] = Reach
    default_weights = ReachWeights()

    def __init__(
        self, load_range: tuple[float, float] | None = None, segments: int = PUBLISHED_SEGMENTS, **shared: Any
    ) -> None:
        options = Options.of(type(self), shared)
        self.segments = _checked(segments)
        applicable = {"stiffness", "actuation_delay", "tip_noise", "angle_noise"}
        applicable |= options.varied_dynamics | ({"mass"} if options.is_dynamic else set())
        self.take_options(options, applicable, f"a {options.backend} arm of dual-triangles")
        control = DeltaControl(self.nominal)
        self.set_simulation(control, options, Dynamics(timestep=0.002, frame_skip=10))
        self.task = self.task_type(
            input_scale=float(self.design.nominal_length),
            joint_span=2 * float(self.design.joint_limit),
            **options.scoring(self.default_weights, 0.003, self.scale),
        )
        self.sampler = Sampler(self.nominal, control, load_range)
        self.set_spaces()

    def sample(self, seed: np.ndarray, episode: np.ndarray) -> Sampled:
        """See `Core.sample`."""
        return self.solved(seed, episode)[0]

    def solved(self, seed: np.ndarray, episode: np.ndarray) -> tuple[Sampled, Components]:
        """The episodes of the given pairs, and a configuration that solves each of them [rad]."""
        random = self.randomization.sample(seed, episode)
        design = self.design_of(random)
        start = self.sampler.sample(seed, episode, design)
        goal = tuple(to_single(component) for component in self.nominal.tip(start.target_configuration))
        sampled = Sampled(Episode(design, start.load, (), goal, random=random), start.configuration, start.inputs)
        return sampled, start.target_configuration

    def placed(self, sampled: Sampled, target: Components | None, configuration: Components | None) -> Sampled:
        """See `Core.placed`. The configuration is the unloaded arm's: its inputs are kept while the load is put on.

        A target is reachable where some stable posture under the load holds it; whether a path leads there is not
        checked.
        """
        arm, load = self.mechanism(sampled.episode.design), sampled.episode.load
        q, inputs = sampled.configuration, sampled.inputs
        if configuration is not None:
            q, inputs = self.sampler.start_at(arm, configuration, load)
        goal = sampled.episode.goal if target is None else tuple(to_single(component) for component in target)
        if target is not None:
            self.sampler.check_target(arm, goal, load)
        return Sampled(sampled.episode._replace(goal=goal), q, inputs)

    def episode_with_goal(self, info: dict[str, np.ndarray], goal: Components) -> Episode:
        """See `Core.episode_with_goal`."""
        design = self.design_of(self.random_from(info))
        return Episode(design, tuple(np.asarray(info["load"], float).T), (), goal)


def _checked(segments: int) -> int:
    """The number of segments.

    Raises:
        TypeError: it is no integer.
        ValueError: there are fewer than two.
    """
    if isinstance(segments, bool) or not isinstance(segments, int | np.integer):
        raise TypeError(f"segments = {segments!r}: must be an integer")
    if segments < 2:
        raise ValueError(f"segments = {segments!r}: must be 2 or more: the tip of one segment moves on a curve")
    return int(segments)
