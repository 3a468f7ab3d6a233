"""Model-based features of the nominal, unloaded planar 4-bar mechanism."""

from typing import Any, cast

import numpy as np

from tensegrity_agents.controllers.base import Observation
from tensegrity_agents.controllers.planar_four_bar.measurements import (
    configuration,
    force_across,
    resolved_rate,
    side,
)
from tensegrity_agents.controllers.planar_four_bar.planning import waypoints
from tensegrity_envs.environments import PlanarFourBarReach
from tensegrity_envs.geometry.obstacle_path import shortest_path
from tensegrity_envs.mechanics.planar_four_bar.inverse import rectangles
from tensegrity_envs.observation import DecodedObservation
from tensegrity_envs.simulation.actuator_lengths import is_open
from tensegrity_envs.tasks import InputReach

_DAMPING = 0.1  # of the pseudo-inverse
_PLACES = 400  # lengths of which those are taken whose tip is nearest to the target, where there is no solution


class Features:
    """Where the target is for the nominal mechanism, and how much it is pushed.

    Which of up to four inverse solutions is the nearest is a function with many folds, hard to learn from positions.

    Args:
        core: of the environment.
    """

    size = 12

    def __init__(self, core: PlanarFourBarReach) -> None:
        self.core, self.nominal, self.rate = core, core.nominal, core.simulation.rate
        self.margin = core.sampler.safe_margin
        self.obstacle = cast(InputReach, core.task).obstacle
        self.places = waypoints(core.nominal, _PLACES)
        tips = [np.stack(core.nominal.rectangle(tuple(self.places.T), side)[1], axis=1) for side in (1.0, -1.0)]
        self.tips = np.stack(tips)

    def __call__(self, observation: Observation, memory: Any, begins: np.ndarray) -> tuple[np.ndarray, Any]:
        """The features.

        Args:
            observation: Dict of arrays of shape (n, ...).
            memory: none is needed.
            begins: shape (n,).

        Returns:
            Shape (n, 12): the distance from the actuator lengths to the nearest inverse solution on the side of the tip
            without a load, or to the corner of the path there that keeps off where C and D meet (2), as a share of 2 L,
            and as tanh of one and of ten times distance / largest step (4), where there is none to lengths of a table
            with the tip close to the target; the same tanh of ten times the step by the Jacobian (2), zero where the
            straight path is not free: it would lead to where C and D meet; the direction across bar CF (2); the force
            on F along it, divided by K L (1); the stability margin m, were that all of the force, as m / (1 + |m|) (1).
            And the memory.
        """
        observed = self.core.schema.decode(observation)
        across, force = force_across(self.nominal, observed)
        here = side(self.nominal, observed)
        end = self._end(observed, here)
        return self._columns(observed, here, end, (across, force), across * force[:, None]), memory

    def _columns(
        self,
        observed: DecodedObservation,
        here: np.ndarray,
        end: np.ndarray,
        push: tuple[np.ndarray, np.ndarray],
        load: np.ndarray,
    ) -> np.ndarray:
        """The features, for actuator lengths to go to and a force on F."""
        nominal, rate = self.nominal, self.rate
        lengths = tuple(observed.actuator_lengths.T)
        _, corner = shortest_path(lengths, tuple(end.T), self.obstacle)
        distance = np.stack(corner, axis=1) - observed.actuator_lengths
        step = resolved_rate(nominal, observed.actuator_lengths, here, observed.target - observed.tip, _DAMPING)
        step = np.where((np.stack(corner, axis=1) == end).all(axis=1, keepdims=True), step, 0.0)
        margin = np.asarray(nominal.stability_margin(tuple(configuration(nominal, observed).T), lengths, tuple(load.T)))
        across, force = push
        columns = [
            distance / (2 * float(nominal.length)),
            np.tanh(distance / rate),
            np.tanh(10 * distance / rate),
            np.tanh(10 * step / rate),
            across,
            np.clip(force / float(nominal.largest_force), -3.0, 3.0)[:, None],
            (margin / (1 + np.abs(margin)))[:, None],
        ]
        return np.concatenate(columns, axis=1)

    def _end(self, observed: DecodedObservation, here: np.ndarray) -> np.ndarray:
        """Actuator lengths to go to, shape (n, 2) [m]."""
        found, sides, exists = rectangles(self.nominal, *observed.target.T)
        fits = exists & (sides == here) & is_open(self.nominal, tuple(found), self.margin)
        length, _ = shortest_path(tuple(observed.actuator_lengths.T), tuple(found), self.obstacle)
        nearest = np.where(fits, length, np.inf).argmin(axis=0)
        end: np.ndarray = found[:, nearest, np.arange(len(nearest))].T
        none = np.flatnonzero(~fits.any(axis=0))
        tips = self.tips[np.where(here[none] > 0, 0, 1)]
        end[none] = self.places[np.linalg.norm(tips - observed.target[none, None], axis=2).argmin(axis=1)]
        return end
