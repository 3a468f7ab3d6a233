"""The plain 2-X changes its posture without meeting a singularity."""

import math
from collections.abc import Mapping
from functools import cache
from typing import Any, ClassVar

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, Namespace, to_single
from tensegrity_envs.core import Core, Sampled
from tensegrity_envs.environments.two_x.actuation import FULL_TURN, JointPaths
from tensegrity_envs.environments.two_x.path_table import path_table_of
from tensegrity_envs.environments.two_x.regions import TwoXRegions
from tensegrity_envs.mechanics.two_x import FURET2018, TwoX, TwoXDesign
from tensegrity_envs.observation import Field, SineAndCosine, Softsign, tip_field
from tensegrity_envs.options import QUASI_STATIC, Options
from tensegrity_envs.seeding import EpisodeStream
from tensegrity_envs.simulation.protocol import RUNNING, Episode, State
from tensegrity_envs.tasks import Posture, PostureWeights

_GRID = 400  # nodes along each angle, for telling aspects apart
_FROM_SINGULAR = 5.0  # times the smallest |det J|: starts and goals are at least that far away
_MAX_ATTEMPTS = 400


@cache
def _aspects_of(design: TwoXDesign) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], np.ndarray]:
    from tensegrity_envs.geometry.aspects import aspects  # slow to import, and only needed here

    found = aspects(TwoX(design), 2 * math.pi, FULL_TURN, _GRID)
    return found.labels, found.axes, np.array(found.signs)


class TwoXPostureChange(TwoXRegions, Core):
    """The plain 2-X moves from one inverse solution to another of the same tip and aspect, around the cusps.

    The goal is a configuration (theta_1, theta_2), theta = alpha / 2 on the torus (-pi, pi]. An episode ends where
    |det J| (with respect to theta) falls below a thousandth of L^2 or changes its sign. `info` tells the distance to
    that as `stability_margin`, for want of springs.

    Args:
        smallest: |det J| / L^2 at which the episode ends.
        design: without offsets, on the full torus; by default FURET2018(0.9). See `mechanics.designs.resolve_design`.
        observe: "full": nothing can be left out.
        tolerance: success within this distance in each angle [rad].
        randomization: there is nothing to randomize: None.

    Raises:
        ValueError: an argument is out of range; the message names it.
        TypeError: `design` is not a design.
    """

    published = FURET2018(0.9)
    shared = QUASI_STATIC
    option_defaults: ClassVar[Mapping[str, Any]] = {"tolerance": 0.02}
    design: TwoXDesign
    simulation: JointPaths
    task: Posture
    input_name = ""
    control = "joint"
    goal_name = "theta"
    error_name = "posture_error"
    error_unit = "mrad"
    task_type: ClassVar[type[Posture]] = Posture
    default_weights = PostureWeights()

    def __init__(self, smallest: float = 1e-3, **shared: Any) -> None:
        options = Options.of(type(self), shared)
        self.take_options(options, (), "a change of posture")
        if self.design.a != 0 or self.design.joint_limit < 2 * math.pi:
            raise ValueError(
                f"design = {self.design!r}: must be without offsets (a = 0) and on the torus (joint_limit 2 pi)"
            )
        if options.observe != "full":
            raise ValueError(f"observe = {options.observe!r}: must be 'full'")
        if not (np.isfinite(smallest) and smallest > 0):
            raise ValueError(f"smallest = {smallest!r}: must be positive")
        self.nominal = TwoX(self.design)
        self.reach = float(self.nominal.reach)
        self.simulation = JointPaths(smallest)
        self.task = self.task_type(span=math.pi, margin=0.1, **options.scoring(self.default_weights, 0.02))
        self._labels, self._axes, self._signs = _aspects_of(self.design)
        self.set_spaces(goal_bound=math.pi)

    def mechanism(self, design: TwoXDesign) -> TwoX:
        """See `Core.mechanism`."""
        return TwoX(design)

    def _aspect(self, q: Components) -> np.ndarray:
        """Which aspect configurations are in, from the nearest grid node; -1 next to a singularity."""
        places = []
        for alpha, axis in zip(q, self._axes, strict=True):
            step = axis[1] - axis[0]
            places.append(np.rint((alpha - axis[0]) / step).astype(int) % len(axis))
        label = np.asarray(self._labels[places[0], places[1]])
        here = np.sign(self.simulation.height(self.nominal, q))
        return np.where(self._signs[label] == here, label, -1)  # the nearest node may lie beyond a singularity

    def sample(self, seed: np.ndarray, episode: np.ndarray) -> Sampled:
        """Starts uniform on the torus among those that have another inverse solution in their aspect."""
        n = len(seed)
        stream = EpisodeStream(seed, episode)
        start, goal = np.zeros((2, n)), np.zeros((2, n))
        pending = np.arange(n)
        floor = _FROM_SINGULAR * self.simulation.smallest
        for _ in range(_MAX_ATTEMPTS):
            m = len(pending)
            here = stream.at(pending)
            q = tuple(here.uniform(-2 * math.pi, 2 * math.pi) for _ in range(2))
            choice = here.uniform()
            stream.skip(3)
            aspect = self._aspect(q)
            fine = (aspect >= 0) & (np.abs(self.simulation.height(self.nominal, q)) >= floor)
            fine &= np.hypot(*self.nominal.tip(q)) > 1e-3 * self.reach
            table = np.full((2, m, 8), np.nan)
            index = np.flatnonzero(fine)
            if len(index):
                found = np.stack(self.nominal.inverse_kinematics_batch(*self.nominal.tip(tuple(a[index] for a in q))))
                table[:, index, : found.shape[2]] = found
            known = np.isfinite(table[0])
            flat = (np.where(known, table[0], 0.0), np.where(known, table[1], 0.0))
            other = known & (self._aspect(flat) == aspect[:, None])
            other &= np.abs(self.simulation.height(self.nominal, flat)) >= floor
            distance = np.maximum(*(np.abs(self._turn(t - a[:, None])) for t, a in zip(flat, q, strict=True)))
            other &= distance > 10 * self.task.tolerance
            count = other.sum(axis=1)
            good = fine & (count > 0)
            rank = np.floor(choice * count).astype(int)
            picked = (np.cumsum(other, axis=1) == (rank + 1)[:, None]).argmax(axis=1)
            done = pending[good]
            start[:, done] = np.stack(q)[:, good]
            goal[:, done] = table[:, np.arange(m), picked][:, good]
            pending = pending[~good]
            if not len(pending):
                break
        else:
            raise RuntimeError(f"no pair of postures found for {self.design} in {_MAX_ATTEMPTS} attempts")
        target = tuple(to_single(alpha / 2) for alpha in goal)
        return Sampled(Episode(self.design, (0.0, 0.0), (), target), tuple(start), None)

    def placed(self, sampled: Sampled, target: Components | None, configuration: Components | None) -> Sampled:
        """See `Core.placed`. The target is a configuration, as (theta_1, theta_2)."""
        start = sampled.configuration if configuration is None else configuration
        goal = sampled.episode.goal if target is None else tuple(to_single(theta) for theta in target)
        aspects = []
        for name, q in (("configuration", start), ("target", tuple(2 * theta for theta in goal))):
            turned = tuple(self._turn(alpha) for alpha in q)
            height = float(abs(self.simulation.height(self.nominal, turned))[0])
            aspects.append(int(self._aspect(turned)[0]))
            if height < self.simulation.smallest or aspects[-1] < 0:
                raise ValueError(
                    f"{name} {tuple(float(part[0]) for part in q)}: singular, |det J| / L^2 = {height:.3g}"
                )
        if aspects[0] != aspects[1]:
            raise ValueError("target: in another aspect than the start, behind a singularity")
        return Sampled(sampled.episode._replace(goal=goal), tuple(self._turn(alpha) for alpha in start), None)

    def postprocess(self, episodes: np.ndarray, outcomes: np.ndarray) -> np.ndarray:
        """Add the potential, which is read from a table, to the dense reward."""
        if self.task.reward_type == "dense" and self.task.weights.potential:
            rows = self.outcomes.rows
            # From the goals as they are given out, so that a relabelled reward is the same number
            q, goal = (
                2 * matrix[place[0] : place[-1] + 1]
                for matrix, place in ((outcomes, rows.achieved), (episodes, self.episodes.rows.goal))
            )
            running = outcomes[rows.state.failure] == RUNNING
            share = path_table_of(self.design).shares(q, goal)
            term = self.task.weights.potential * np.where(running, 1 - share, 0.0)
            outcomes[rows.info["reward_potential"]] = term
            outcomes[rows.reward] = to_single(outcomes[rows.reward] + term)
        return outcomes

    @staticmethod
    def _turn(alpha: Component) -> Component:
        """The same difference of alphas in [-2 pi, 2 pi)."""
        return (alpha + FULL_TURN / 2) % FULL_TURN - FULL_TURN / 2

    def achieved(self, state: State) -> Components:
        """The configuration, as (theta_1, theta_2) [rad]."""
        return tuple(alpha / 2 for alpha in state.configuration)

    def with_achieved(self, state: State, achieved: Components) -> State:
        """See `Core.with_achieved`."""
        q = tuple(2 * theta for theta in achieved)
        return state._replace(configuration=q, tip=self.nominal.tip(q))

    def error(self, xp: Namespace, achieved: Components, goal: Components) -> Component:
        """The larger of the angles between the thetas [rad]."""
        angles = [abs(a - g) for a, g in zip(achieved, goal, strict=True)]
        return xp.maximum(*(xp.minimum(angle, 2 * math.pi - angle) for angle in angles))

    def observed(self) -> list[Field]:
        """See `Core.observed`."""
        turns, angles = "theta = alpha / 2, which runs once around", "alpha = 2 theta"
        margin = "distance from the singularity"
        return [
            Field("theta", lambda state, _: self.achieved(state), 2, SineAndCosine(), "rad", turns),
            Field("alpha", lambda state, _: state.configuration, 2, SineAndCosine(), "rad", angles),
            tip_field(self.reach),
            Field("stability_margin", lambda state, _: (state.stability_margin,), None, Softsign(), "-", margin),
        ]

    def episode_with_goal(self, info: dict[str, np.ndarray], goal: Components) -> Episode:
        """See `Core.episode_with_goal`."""
        return Episode(self.design, (0.0, 0.0), (), goal)

    def scene(self, episode: Episode, state: State) -> dict[str, Any]:
        """The arm without springs and cables, the goal posture and its tip, and the distance to the singularity."""
        arm = self.mechanism(episode.design)
        goal = tuple(2 * theta for theta in episode.goal)
        return {
            "nodes": arm.nodes(state.configuration),
            "members": [member for member in arm.members if member.kind == "bar"],
            "tensions": {},
            "tension_bounds": (0.0, 1.0),
            "target": arm.tip(goal),
            "ghost": arm.nodes(goal),
            "tolerance": 0.02,
            "margins": {"det J": self.simulation.height(arm, state.configuration)},
        }
