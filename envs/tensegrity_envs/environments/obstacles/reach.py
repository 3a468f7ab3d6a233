"""Planar mechanisms that reach among obstacles."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce
from typing import Any, ClassVar

import numpy as np

from tensegrity_envs.compiler.namespace import Components, namespace_of
from tensegrity_envs.core import Core, Sampled
from tensegrity_envs.environments.dual_triangle import DualTriangleReach
from tensegrity_envs.environments.n_x import NXReach
from tensegrity_envs.environments.obstacles.given import checked_obstacles
from tensegrity_envs.environments.obstacles.sampling import ObstacleSampler
from tensegrity_envs.environments.obstacles.spaces import JointSpace, LengthSpace
from tensegrity_envs.environments.planar_four_bar import PlanarFourBarReach
from tensegrity_envs.environments.two_x import TwoXReach
from tensegrity_envs.geometry.clearance import Disc, Obstacle, clearance
from tensegrity_envs.geometry.own_bars import own_pairs
from tensegrity_envs.observation import Divided, Field, Softsign
from tensegrity_envs.options import Options
from tensegrity_envs.rendering import Scene
from tensegrity_envs.simulation.dynamic import Drivable
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.simulation.protocol import COLLISION, RUNNING, Episode, State
from tensegrity_envs.simulation.quasi_static import keep_where
from tensegrity_envs.tasks import ObstacleInputReach, ObstacleReach, ObstacleReachWeights, Reach, ReachWeights

Obstacles = int | Sequence[Obstacle | Mapping[str, Any]]

_LOOKS = 4  # at the arm within a step
_COUNT = 3  # discs
_WEIGHTS: ReachWeights = ObstacleReachWeights()


class ObstacleCore(Core):
    """What obstacles add to an environment, before which it stands in the bases of a class.

    Attributes:
        obstacles: how many discs are drawn, or those that there are.
        own: pairs of the mechanism's own bars that count as obstacles to each other.
        space: in which paths are straight.
        surroundings: draws starts, targets and discs.

    Args:
        obstacles: how many discs are drawn for each episode, or a sequence of `Disc`s, convex `Polygon`s and `Wall`s
            (or mappings of their fields) that are in every episode; 0 for none beside the mechanism's own bars.
        own_bars: whether bars of the mechanism that touch each other are a collision, too; see `geometry.own_bars`.

    Raises:
        ValueError: an argument is out of range; the message names it.
    """

    has_obstacles = True
    space_type: ClassVar[type[JointSpace]] = JointSpace
    task_type: ClassVar[type[Reach]] = ObstacleReach
    default_weights = _WEIGHTS
    obstacles: int | tuple[Obstacle, ...]
    own: tuple[tuple[str, str], ...]
    space: JointSpace
    surroundings: ObstacleSampler

    def __init__(self, obstacles: Obstacles = _COUNT, own_bars: bool = False, **options: Any) -> None:
        if not isinstance(own_bars, bool | np.bool_):
            raise ValueError(f"own_bars = {own_bars!r}: must be True or False")
        self.obstacles = checked_obstacles(obstacles, may_be_none=bool(own_bars))
        super().__init__(**options)
        assert isinstance(self.task, ObstacleReach)
        for disc in () if isinstance(self.obstacles, int) else self.obstacles:
            if isinstance(disc, Disc) and max(*map(abs, disc.centre), disc.radius) > self.reach:
                raise ValueError(
                    f"obstacles: {disc!r}: its numbers must be within the reach of the arm, {self.reach:.4g} m; "
                    "larger obstacles can be a Polygon or a Wall"
                )
        free: Any = self  # as the class behind this one has it
        self.own, self.space = own_pairs(self.nominal) if own_bars else (), self.space_type(self)
        self.surroundings = ObstacleSampler(free, self.obstacles, self.space, self.own)
        self.task = replace(self.task, safe=self.surroundings.safe)

    @property
    def disc_count(self) -> int:
        """The number of discs, which are observed."""
        if isinstance(self.obstacles, int):
            return self.obstacles
        return sum(isinstance(one, Disc) for one in self.obstacles)

    def sample(self, seed: np.ndarray, episode: np.ndarray) -> Sampled:
        """See `Core.sample`."""
        sampled: Sampled
        sampled, obstacles = self.surroundings.sample(seed, episode)
        return sampled._replace(episode=sampled.episode._replace(obstacles=obstacles))

    def placed(self, sampled: Sampled, target: Components | None, configuration: Components | None) -> Sampled:
        """See `Core.placed`. Start and target must be clear of the obstacles; whether a path leads to the target is not
        checked.

        Raises:
            ValueError: the target lies in an obstacle, or the start touches one.
        """
        if target is not None:
            self._check_target(sampled, target)
        placed = super().placed(sampled, target, configuration)
        inputs = placed.inputs if self.space.kept else None
        gap = float(clearance(self.nominal, placed.configuration, sampled.episode.obstacles, inputs, self.own)[0])
        if gap <= 0:
            raise ValueError(f"configuration: touches an obstacle (clearance {gap:.4g} m)")
        return placed

    def _check_target(self, sampled: Sampled, target: Components) -> None:
        x, y = (float(value[0]) for value in target[:2])
        count, own = (
            len(sampled.episode.obstacles),
            tuple(round(float(value[0]), 4) for value in sampled.episode.goal[:2]),
        )
        for k, one in enumerate(sampled.episode.obstacles):
            gap = float(np.ravel(one.clearance(((x, y), (x, y))))[0])
            if gap <= 0:
                raise ValueError(
                    f"target = ({x:.4g}, {y:.4g}): lies {-gap:.4g} m inside obstacle {k}, {_told(one)}; must be "
                    f"outside of all {count} obstacles of the episode, as its own target {own} is"
                )

    def with_clearance(self, episode: Episode, before: State, after: State) -> State:
        """An arm that touches an obstacle at one of four looks along the straight path of a step has failed
        ("collision"); it is left where it was before. Own bars, which stay crossed when they have passed each other,
        are looked at where the step ends.
        """
        xp = namespace_of(*after.configuration)
        start, end = self.space.place(before), self.space.place(after)
        gaps = []
        for k in range(1 if before is not after else _LOOKS, _LOOKS + 1):  # an episode that begins is one look
            share = k / _LOOKS
            pairs = zip(start, end, strict=True)
            place = end if k == _LOOKS else tuple(a + share * (b - a) for a, b in pairs)
            own = self.own if k == _LOOKS else ()
            if episode.obstacles or own:
                q, inputs = self.space.posture(place)
                gaps.append(clearance(self.nominal, q, episode.obstacles, inputs, own))
        least = reduce(xp.minimum, gaps)
        hit = (least <= 0) & (after.failure == RUNNING)
        failed = after._replace(failure=xp.where(hit, COLLISION, after.failure), clearance=least)
        return keep_where(xp, hit, failed, before)

    def observed(self) -> list[Field]:
        """See `Core.observed`."""

        def centres(_: State, episode: Episode) -> Components:
            return tuple(value for one in episode.obstacles if isinstance(one, Disc) for value in one.centre)

        def radii(_: State, episode: Episode) -> Components:
            return tuple(one.radius for one in episode.obstacles if isinstance(one, Disc))

        def gap(state: State, _: Episode) -> Components:
            return (state.clearance,)

        free: Any = super()
        fields, count, reach = list(free.observed()), self.disc_count, Divided(self.reach)
        if count:
            fields += [
                Field("obstacle_centres", centres, 2 * count, reach, "m", "centres (x, y) of the discs"),
                Field("obstacle_radii", radii, count, reach, "m", "radii of the discs"),
            ]
        scale = Softsign(0.1 * self.reach)
        return [*fields, Field("clearance", gap, None, scale, "m", "least clearance in the last step")]

    def episode_with_goal(self, info: dict[str, np.ndarray], goal: Components) -> Episode:
        """See `Core.episode_with_goal`: the reward depends on the clearance in `info`, and on no obstacle."""
        n = len(goal[0])
        one = self.episodes.unpack(np.ones((self.episodes.size, n))).obstacles
        free: Any = super()
        episode: Episode = free.episode_with_goal(info, goal)
        return episode._replace(obstacles=one)

    def scene(self, episode: Episode, state: State) -> dict[str, Any]:
        """See `Core.scene`."""
        free: Any = super()
        scene: dict[str, Any] = free.scene(episode, state)
        return scene | {"obstacles": [one.outline(4 * self.reach) for one in episode.obstacles]}

    def picture(self, episode: Episode, state: State, trace: list[Any], step: int) -> Scene:
        """See `Core.picture`; with the clearance of the last step."""
        scene = super().picture(episode, state, trace, step)
        return replace(scene, caption=f"{scene.caption}   clearance {self.error_text(float(state.clearance))}")


def _told(obstacle: Obstacle) -> str:
    """An obstacle of one episode, in words."""
    if not isinstance(obstacle, Disc):
        return repr(obstacle)
    x, y, radius = (float(np.ravel(value)[0]) for value in (*obstacle.centre, obstacle.radius))
    return f"a disc of radius {radius:.4g} m about ({x:.4g}, {y:.4g})"


class UnloadedObstacleCore(ObstacleCore):
    """The same for mechanisms that have loads elsewhere.

    Args:
        load_range: None: among obstacles there is no load.

    Raises:
        ValueError: an argument is out of range; the message names it.
    """

    def __init__(
        self, obstacles: Obstacles = _COUNT, own_bars: bool = False, load_range: None = None, **options: Any
    ) -> None:
        if load_range is not None:
            raise ValueError(f"load_range = {load_range!r}: must be None: among obstacles there is no load")
        super().__init__(obstacles, own_bars, **options)


class PlanarFourBarObstacleReach(UnloadedObstacleCore, PlanarFourBarReach):
    """Reaching among obstacles with the unloaded planar 4-bar mechanism; an obstacle that is touched ends the episode.

    Args:
        backend: "quasi_static": there are no dynamics of this mechanism among obstacles.

    Raises:
        ValueError: an argument is out of range; the message names it.
    """

    space_type = LengthSpace
    task_type: ClassVar[type[ObstacleInputReach]] = ObstacleInputReach
    default_weights = ObstacleReachWeights(effort=0.0)

    def set_simulation(self, control: Drivable, options: Options, usual: Dynamics) -> None:
        """See `Core.set_simulation`.

        Raises:
            ValueError: dynamics are asked for.
        """
        if options.is_dynamic:
            raise ValueError(
                f"backend = {options.backend!r}: among obstacles the planar 4-bar mechanism has 'quasi_static' alone; "
                "arms of X-joints and of dual-triangles have 'mujoco', too"
            )
        super().set_simulation(control, options, usual)


class NXObstacleReach(ObstacleCore, NXReach):
    """Reaching among obstacles with an arm of two X-joints or more; an obstacle that is touched ends the episode.

    Raises:
        ValueError: an argument is out of range; the message names it.
    """


class TwoXObstacleReach(ObstacleCore, TwoXReach):
    """Reaching among obstacles with the 2-X; an obstacle that is touched ends the episode.

    Raises:
        ValueError: an argument is out of range; the message names it.
    """


class DualTriangleObstacleReach(UnloadedObstacleCore, DualTriangleReach):
    """Reaching among obstacles with the unloaded dual-triangle arm; an obstacle that is touched ends the episode.

    Raises:
        ValueError: an argument is out of range; the message names it.
    """
