"""The mast as a reaching environment with baselines of its own: `--env mast_reach:own/MastReach-v0`."""

from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np

from mast import Mast, MastDesign
from mast_controllers import ClosedFormIK, PseudoInverse
from tensegrity_agents.controllers import register_baselines
from tensegrity_envs.compiler.namespace import Component, Components, to_single
from tensegrity_envs.core import Core, Sampled
from tensegrity_envs.observation import Field, arm_fields, inputs_field
from tensegrity_envs.options import QUASI_STATIC, Options
from tensegrity_envs.seeding import EpisodeStream
from tensegrity_envs.simulation.protocol import Episode, State
from tensegrity_envs.simulation.quasi_static import InputControl
from tensegrity_envs.tasks import Reach, ReachWeights

ENV_ID = "own/MastReach-v0"
_INNER = 0.9  # share of the joint limit within which episodes begin and end
_FAR = 100.0  # [rad] of inverse solutions that do not exist: no posture is near them


class MastControl(InputControl[Mast]):
    """Actions are increments of the two tensions; the mast follows its equilibrium."""

    action_size = 2
    rate = 5.0
    rate_unit = "N"

    def bounds(self, mechanism: Mast) -> tuple[Component, Component]:
        """Lowest and highest tension [N]."""
        return mechanism.design.min_tension, mechanism.design.max_tension

    def statics(self, mechanism: Mast, u: Components, inputs: Components, load: Components) -> Any:
        """See `Mast.statics`."""
        return mechanism.statics(u, inputs, load)

    def margins(self, mechanism: Mast, q: Components, inputs: Components, load: Components) -> Components:
        """Those of the actual tensions."""
        return mechanism.stability_margin(q, inputs, load), mechanism.wrench_margin(q, inputs)

    def usual_inputs(self, mechanism: Mast, q: Components, load: Components) -> Components:
        """The tensions that hold q [N]."""
        return mechanism.holding_tensions(q, load)


class MastReach(Core):
    """Reaching with the mast: starts and targets are postures sampled uniformly within 0.9 of the joint limits.

    Args:
        tolerance: success within this distance [m]; by default 3 mm for a mast of 0.3 m, growing with it.

    Raises:
        ValueError: an argument is out of range, or the mast cannot be held everywhere within its joint limits.
        TypeError: `design` is not a design.
    """

    published = MastDesign()
    shared = QUASI_STATIC
    simulation: MastControl
    design: MastDesign
    input_name = "tensions"
    control = "tension"
    task_type = Reach
    default_weights = ReachWeights()

    def __init__(self, **shared: Any) -> None:
        options = Options.of(type(self), shared)
        self.take_options(options, {"stiffness", "actuation_delay", "tip_noise", "angle_noise"}, "a mast")
        self.nominal = Mast(self.design)
        self.reach = float(self.nominal.reach)
        self.simulation = MastControl()
        self.task = self.task_type(
            input_scale=float(self.design.max_tension),
            joint_span=2 * float(self.design.joint_limit),
            **options.scoring(self.default_weights, 0.003, self.design.l / self.published.l),
        )
        self._check_that_it_can_be_held()
        self.set_spaces()

    def _check_that_it_can_be_held(self) -> None:
        """Every posture within the limits must be: so every target can be reached from every start."""
        line = np.linspace(-_INNER, _INNER, 41) * self.design.joint_limit
        q = tuple(np.meshgrid(line, line))
        for factor in self.randomization.stiffness or (1.0,):
            mast = Mast(replace(self.design, k=self.design.k * factor))
            if not min(mast.stability_margin(q).min(), mast.wrench_margin(q).min()) > 0:
                raise ValueError(f"design = {mast.design!r}: cannot be held everywhere; lower joint_limit")

    def mechanism(self, design: MastDesign) -> Mast:
        """See `Core.mechanism`."""
        return Mast(design)

    def sample(self, seed: np.ndarray, episode: np.ndarray) -> Sampled:
        """See `Core.sample`. The start is at rest under the true design's holding tensions."""
        stream = EpisodeStream(seed, episode)
        q = (2 * stream.block(4) - 1) * _INNER * self.design.joint_limit
        random = self.randomization.sample(seed, episode)
        design = self._randomized(random)
        goal = tuple(to_single(component) for component in self.nominal.tip(tuple(q[2:])))
        return Sampled(Episode(design, (0.0, 0.0), (), goal, self._solutions(goal), random), tuple(q[:2]), None)

    def _solutions(self, goal: Components) -> tuple[Components, ...]:
        """Postures within the limits that put the tip on goals of shape (n,), for the dense reward."""
        if self.task.reward_type != "dense":
            return ()
        found = []
        for q in self.nominal.inverse_configurations(*goal):
            fits = np.logical_and.reduce([np.abs(angle) <= self.design.joint_limit for angle in q])
            found.append(tuple(np.where(fits, angle, _FAR) for angle in q))
        return tuple(found)

    def _randomized(self, random: dict[str, np.ndarray]) -> MastDesign:
        """The design with the stiffnesses that were sampled for the episodes."""
        return replace(self.design, k=self.design.k * random["stiffness"]) if "stiffness" in random else self.design

    def observed(self) -> list[Field]:
        """See `Core.observed`."""
        inputs = inputs_field("tensions", 2, self.simulation.bounds(self.nominal), "N", "cable tensions")
        return arm_fields(self.nominal, self.reach, inputs, 2, self.observe_all, self.observe_velocities)

    def episode_with_goal(self, info: dict[str, np.ndarray], goal: Components) -> Episode:
        """See `Core.episode_with_goal`."""
        design = self._randomized(self.random_from(info))
        return Episode(design, (0.0, 0.0), (), goal, self._solutions(goal))

    def scene(self, episode: Episode, state: State) -> dict[str, Any]:
        """See `Core.scene`."""
        mast = self.mechanism(episode.design)
        return {
            "nodes": mast.nodes(state.configuration),
            "members": mast.members,
            "tensions": {f"cable {name}": f for name, f in zip(mast.input_names, state.inputs, strict=True)},
            "tension_bounds": (self.design.min_tension, self.design.max_tension),
        }


gym.register(
    ENV_ID,
    entry_point="tensegrity_envs.env:ManipulatorEnv",
    vector_entry_point="tensegrity_envs.vector_env:ManipulatorVectorEnv",
    max_episode_steps=100,
    kwargs={"arm": "mast_reach:MastReach"},
)
register_baselines(ENV_ID, {"closed_form_ik": ClosedFormIK, "pseudo_inverse": PseudoInverse})
