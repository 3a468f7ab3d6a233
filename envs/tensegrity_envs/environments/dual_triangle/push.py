"""The dual-triangle arm that holds against a push."""

from typing import Any, ClassVar

import numpy as np

from tensegrity_envs.compiler.namespace import Components, to_single
from tensegrity_envs.core import Sampled
from tensegrity_envs.environments.dual_triangle.arm import DualTriangleCore
from tensegrity_envs.environments.dual_triangle.holding import HoldSampler
from tensegrity_envs.options import QUASI_STATIC, Options
from tensegrity_envs.seeding import EpisodeStream
from tensegrity_envs.simulation.protocol import Episode
from tensegrity_envs.simulation.quasi_static import FreeLengthControl
from tensegrity_envs.tasks import Hold, HoldWeights

_TARGETS = (5.0, 5.9)  # along x, in b


class DualTrianglePush(DualTriangleCore):
    """Hold the tip on a target while an axial force that is not observed grows.

    The force is in -x and grows linearly, from 0 to 0.3 k b in 150 steps; the inputs are all six free lengths, within
    0 and 1.5 times the nominal one. An episode ends where the arm loses stability or its joint limits, or the tip its
    tolerance. Score: the force at that moment, divided by the straight arm's critical load at the nominal free length;
    success from 1 on.

    Args:
        load_per_step: how much the force grows in a step, divided by k b.
        design: the design, by default ZHAO2021_CAPTION; its springs must be bilateral. See
            `mechanics.designs.resolve_design`.
        tolerance: the episode ends beyond this distance [m]; by default 6 mm at the published size, growing with it.
        randomization: there is nothing to randomize yet: None.

    Raises:
        ValueError: an argument is out of range; the message names it.
        TypeError: `design` is not a design.
    """

    shared = QUASI_STATIC
    input_name = "free_lengths"
    control = "free_lengths"
    task_type: ClassVar[type[Hold]] = Hold
    default_weights = HoldWeights()

    def __init__(self, load_per_step: float = 0.3 / 150, **shared: Any) -> None:
        options = Options.of(type(self), shared)
        self.take_options(options, (), "a push")
        if self.design.segments is not None:
            raise ValueError("design: a push is against an arm of equal segments: give one number for each field")
        if self.design.springs != "bilateral":
            raise ValueError(f"design.springs = {self.design.springs!r}: must be 'bilateral'")
        if not (np.isfinite(load_per_step) and load_per_step > 0):
            raise ValueError(f"load_per_step = {load_per_step!r}: must be positive")
        self.simulation = FreeLengthControl(self.nominal)
        self.load_rate = -load_per_step * float(self.design.k1) * float(self.design.b1)
        self.task = self.task_type(
            reference_load=self.critical_load,
            input_scale=FreeLengthControl.highest * float(self.design.free_length1),
            **options.scoring(self.default_weights, 0.006, self.scale),
        )
        b = float(self.design.b1)
        highest = float(self.simulation.bounds(self.nominal)[1])
        self.sampler = HoldSampler(self.nominal, (_TARGETS[0] * b, _TARGETS[1] * b), highest)
        self.set_spaces()

    def sample(self, seed: np.ndarray, episode: np.ndarray) -> Sampled:
        """Targets uniform in x from 5.0 b to 5.9 b, at y = 0; starts uniform over the first angles that hold them."""
        stream = EpisodeStream(seed, episode)
        x = to_single(stream.uniform(*self.sampler.targets))
        q = self.sampler.sample(stream, x)
        episodes = Episode(self.design, (0.0, 0.0), (self.load_rate, 0.0), (x, 0.0 * x))
        return Sampled(episodes, tuple(q), None)

    def placed(self, sampled: Sampled, target: Components | None, configuration: Components | None) -> Sampled:
        """See `Core.placed`. The configuration must hold the target; for a target alone a start is sampled."""
        goal = sampled.episode.goal if target is None else tuple(to_single(component) for component in target)
        if configuration is not None and target is None:
            goal = tuple(to_single(component) for component in self.nominal.tip(configuration))
        low, high = self.sampler.targets
        x, y = (float(component[0]) for component in goal)
        if not (low <= x <= high and abs(y) <= self.task.tolerance):
            raise ValueError(f"target ({x:.6g}, {y:.6g}): must be (x, 0) with x from {low:.6g} to {high:.6g} m")
        if configuration is not None:
            self._check_holds(configuration, goal)
            return Sampled(sampled.episode._replace(goal=goal), configuration, None)
        q = self.sampler.sample(EpisodeStream(np.zeros(1, np.int64), np.zeros(1, np.int64)), goal[0])
        return Sampled(sampled.episode._replace(goal=goal), tuple(q), None)

    def _check_holds(self, q: Components, goal: Components) -> None:
        """Refuse a posture that does not hold the target without a push, all limits kept."""
        tip = self.nominal.tip(q)
        distance = float(np.hypot(tip[0] - goal[0], tip[1] - goal[1])[0])
        if distance > self.task.tolerance:
            raise ValueError(f"configuration: its tip is {distance:.3g} m off the target, more than the tolerance")
        lengths = self.nominal.free_lengths(self.nominal.control(q))
        low, high = self.simulation.bounds(self.nominal)
        fits = all(bool((low <= length).all() and (length <= high).all()) for length in lengths)
        stability = float(self.nominal.stability_margin(q, lengths)[0])
        if not (fits and stability > 0 and np.all(self.nominal.is_within_limits(q))):
            raise ValueError(
                f"configuration: cannot be held within joint limits and free lengths (stability margin {stability:.3g})"
            )

    def episode_with_goal(self, info: dict[str, np.ndarray], goal: Components) -> Episode:
        """See `Core.episode_with_goal`."""
        return Episode(self.design, (0.0, 0.0), (self.load_rate, 0.0), goal)
