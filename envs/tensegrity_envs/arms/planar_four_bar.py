"""The planar 4-bar mechanism as a reaching environment, loaded or not."""

from typing import Any, Literal

import numpy as np

from tensegrity_envs.arms.planar_four_bar_sampling import Sampler
from tensegrity_envs.core import Core, Drawn, sees_everything, tip_inputs_and_angles
from tensegrity_envs.mechanics.namespace import Component, Components, to_single
from tensegrity_envs.mechanics.planar_four_bar import JI2014, PlanarFourBar, PlanarFourBarDesign
from tensegrity_envs.mechanics.planar_four_bar.inverse import rectangles
from tensegrity_envs.simulation.actuator_lengths import LARGEST_THRUST, LoadedLengthControl, RectangleControl
from tensegrity_envs.simulation.protocol import Episode, State
from tensegrity_envs.tasks import InputReach, ReachWeights


class PlanarFourBarReach(Core):
    """The planar 4-bar reaching environments.

    Args:
        design: of the mechanism that controllers are told about.
        load_range: if given, every episode draws an unknown constant force on F, of a size within this range (times
            K L) and in any direction.
        observe: "full", or "tip_and_inputs" (no bar angles, no margins).
        reward_type: "dense" or "sparse".
        reward_weights: of the dense reward, by name; those left out keep their default, but for effort, which is 0:
            an actuator's length is no effort.
        tolerance: success within this distance [m].

    Raises:
        ValueError: an argument is out of range; the message names it.
        TypeError: `design` is not a design.
    """

    input_name = "actuator_lengths"
    hidden_names = ("load",)
    control = "actuator_lengths"

    def __init__(
        self,
        design: PlanarFourBarDesign = JI2014,
        load_range: tuple[float, float] | None = None,
        observe: Literal["full", "tip_and_inputs"] = "full",
        reward_type: Literal["dense", "sparse"] = "dense",
        reward_weights: dict[str, float] | ReachWeights | None = None,
        tolerance: float = 0.05,
    ) -> None:
        self.nominal = PlanarFourBar(design)
        if design.is_batch:
            raise TypeError(f"design = {design!r}: must be one design, not a batch")
        self.design = design
        self.reach = float(self.nominal.reach)
        self.observe_all = sees_everything(observe)
        kind = RectangleControl if load_range is None else LoadedLengthControl
        self.simulation: LoadedLengthControl = kind(self.nominal)
        if not isinstance(reward_weights, ReachWeights):
            reward_weights = {"effort": 0.0} | (reward_weights or {})
        self.task = InputReach(
            input_scale=2 * float(design.length),
            joint_span=2 * float(design.length),
            tolerance=tolerance,
            reward_type=reward_type,
            weights=ReachWeights.given(reward_weights),
        )
        # Under an unknown force solutions on this side and on the other cannot be told apart for relabelled goals.
        self.with_solutions = load_range is None and reward_type == "dense"
        self.sampler = Sampler(self.nominal, self.simulation, load_range)
        self.set_spaces(4 + (6 if self.observe_all else 0))

    def mechanism(self, design: PlanarFourBarDesign) -> PlanarFourBar:
        """See `Core.mechanism`."""
        return PlanarFourBar(design)

    def draw(self, seed: np.ndarray, episode: np.ndarray) -> Drawn:
        """See `Core.draw`."""
        start = self.sampler.draw(seed, episode)
        goal = tuple(to_single(component) for component in start.target)
        solutions = self._solutions(goal, start.configuration, start.lengths)
        return Drawn(Episode(self.design, start.load, (), goal, solutions), start.configuration, start.lengths)

    def _solutions(self, goal: Components, q: Components, lengths: Components) -> tuple[Components, ...]:
        """Actuator lengths of the unloaded rectangles, on the side of a state, with F at goals of shape (n,) [m].

        Four; those that do not exist are out of reach.
        """
        if not self.with_solutions:
            return ()
        found, sides, exists = rectangles(self.nominal, *goal)
        fits = exists & (sides == self.nominal.side_of(q, lengths))
        found = np.where(fits, found, 100 * self.reach)
        return tuple((found[0, k], found[1, k]) for k in range(4))

    def observation(self, state: State, episode: Episode) -> list[Component]:
        """See `core.tip_inputs_and_angles`."""
        bounds = self.simulation.bounds(self.nominal)
        return tip_inputs_and_angles(state, self.reach, bounds, self.observe_all)

    def hidden(self, episode: Episode, state: State) -> dict[str, Any]:
        """The force on F and the thrusts of the actuators [N]."""
        mechanism = self.mechanism(episode.design)
        return {"load": episode.load, "thrusts": mechanism.thrusts(state.configuration, state.inputs, episode.load)}

    def episode_of(self, info: dict[str, np.ndarray], goal: Components) -> Episode:
        """See `Core.episode_of`."""
        q, lengths = (tuple(np.asarray(info[name], float).T) for name in ("configuration", self.input_name))
        load = tuple(np.asarray(info["load"], float).T)
        return Episode(self.design, load, (), goal, self._solutions(goal, q, lengths))

    def scene(self, episode: Episode, state: State) -> dict[str, Any]:
        """See `Core.scene`."""
        mechanism = self.mechanism(episode.design)
        forces = mechanism.member_forces(state.configuration, state.inputs, episode.load)
        force, length = float(mechanism.largest_force), float(mechanism.length)
        return {
            "nodes": mechanism.nodes(state.configuration, state.inputs),
            "members": mechanism.members,
            "tensions": {m.name: forces[m.name] for m in mechanism.members if m.kind != "bar"},
            "tension_bounds": (-LARGEST_THRUST * force, LARGEST_THRUST * force),
            "base": ("A", "B"),
            "load": episode.load,
            "load_scale": 0.2 * force,
            "reach": 2.0 * length,
        }
