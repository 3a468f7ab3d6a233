"""Controllers of the planar 4-bar mechanism among obstacles."""

from typing import NamedTuple

import numpy as np

from tensegrity_agents.controllers import planar_four_bar
from tensegrity_agents.controllers.base import AnalyticController, ragged
from tensegrity_agents.controllers.obstacles.clearing import KEPT, Clearing
from tensegrity_agents.controllers.obstacles.planning import PathPlanner
from tensegrity_agents.controllers.planar_four_bar.measurements import side
from tensegrity_agents.controllers.planar_four_bar.reach import Memory
from tensegrity_envs.core import Core
from tensegrity_envs.environments.obstacles.spaces import LengthSpace
from tensegrity_envs.mechanics.planar_four_bar import PlanarFourBar
from tensegrity_envs.mechanics.planar_four_bar.inverse import rectangles
from tensegrity_envs.observation import DecodedObservation
from tensegrity_envs.simulation.actuator_lengths import is_open

_ARRIVED = 1e-4  # of a step, from a waypoint to the next


class ClosedFormIK(planar_four_bar.ClosedFormIK):
    """As without obstacles: straight to the lengths of an inverse solution, or round the singularity."""

    knows = "the nominal design; takes no notice of the obstacles"


class PseudoInverse(planar_four_bar.PseudoInverse):
    """Resolved rate with the damped pseudo-inverse; a step is cut short where it would touch an obstacle.

    Two lengths move two coordinates of the tip: there is no null space in which to keep off.
    """

    knows = "the nominal design and the obstacles; feedback of the tip error"

    def __init__(self, core: Core) -> None:
        super().__init__(core)
        self.clearing = Clearing(core)

    def _move(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        action, memory = super()._move(observed, memory)
        step = np.clip(action, -1.0, 1.0) * self.rate
        place = places(self.clearing, self.nominal, observed)
        change = np.concatenate([step.T / float(self.nominal.length), np.zeros((1, len(step)))])
        kept = self.clearing.kept_off(place, change, self.clearing.discs(observed), KEPT * self.core.reach)
        return kept[:2].T * float(self.nominal.length) / self.rate, memory


class PathMemory(NamedTuple):
    """What the planner carries from step to step, for n environments.

    Attributes:
        path: an object array (n,) of actuator lengths (k, 2) to visit one after another [m].
        leg: which of them is next, (n,).
    """

    path: np.ndarray
    leg: np.ndarray


class Planner(AnalyticController[PathMemory]):
    """Goes along a path of actuator lengths that is free in the nominal model: straight to those of an inverse
    solution, or by a sampling planner.
    """

    knows = "the nominal design and the obstacles; plans a free path of the lengths"
    nominal: PlanarFourBar

    def __init__(self, core: Core) -> None:
        super().__init__(core)
        self.planner = PathPlanner(core)

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> PathMemory:
        """See `AnalyticController.initial`."""
        clearing, space = self.planner.clearing, self.planner.space
        assert isinstance(space, LengthSpace)
        start, discs = places(clearing, self.nominal, observed).T, clearing.discs(observed).T
        found, sides, exists = rectangles(self.nominal, *observed.target.T)
        fits = exists & (sides == start[:, 2]) & is_open(self.nominal, tuple(found), space.sampler.safe_margin)
        paths = []
        for i, here in enumerate(start):
            lengths = tuple(found[:, fits[:, i], i])
            ends = np.stack(space.of_lengths(lengths, np.full_like(lengths[0], here[2])), axis=1)
            path = self.planner.path(self.nominal, here, ends, discs[i]) or [here]
            paths.append(np.stack(space.lengths(tuple(np.array(path).T)), axis=1))
        return PathMemory(ragged(paths), np.zeros(len(index), int))

    def _act(self, observed: DecodedObservation, memory: PathMemory) -> tuple[np.ndarray, PathMemory]:
        here, leg = observed.actuator_lengths, memory.leg.copy()
        for i, path in enumerate(memory.path):
            while leg[i] < len(path) - 1 and np.abs(path[leg[i]] - here[i]).max() < _ARRIVED * self.rate:
                leg[i] += 1
        change = np.stack([path[k] for path, k in zip(memory.path, leg, strict=True)]) - here
        share = np.maximum(np.abs(change).max(axis=1, keepdims=True) / self.rate, 1.0)
        return change / share / self.rate, memory._replace(leg=leg)


def places(clearing: Clearing, nominal: PlanarFourBar, observed: DecodedObservation) -> np.ndarray:
    """Coordinates (3, n) of where the mechanisms are; see `LengthSpace`."""
    space = clearing.space
    assert isinstance(space, LengthSpace)
    return np.stack(space.of_lengths(tuple(observed.actuator_lengths.T), side(nominal, observed)))
