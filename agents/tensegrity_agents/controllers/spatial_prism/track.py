"""The analytic controllers that follow a curve with the spatial prism, and what each of them knows."""

from typing import Any

import numpy as np

from tensegrity_agents.controllers.base import AnalyticController, Privileged
from tensegrity_agents.controllers.spatial_prism.identification import identify
from tensegrity_agents.controllers.spatial_prism.reading import read
from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.spatial_prism import SpatialPrism, SpatialPrismDesign
from tensegrity_envs.observation import DecodedObservation


class TrackController(AnalyticController):
    """Sets the lengths at which the platform will be on the goal one step ahead. Subclasses say which those are.

    Args:
        core: of the environment.
    """

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, np.ndarray]:
        """Actions (n, 3) for a batch of n observations; the state is the number of steps made, (n,)."""
        observed = read(observation, self.core)
        step = np.zeros(len(observed.tip), int) if state is None else np.asarray(state)
        if episode_start is not None:
            step = np.where(np.asarray(episode_start, bool), 0, step)
        wanted = self._lengths(observed, step)
        return np.clip((wanted - observed.lengths) / self.rate, -1.0, 1.0), step + 1

    def _lengths(self, observed: DecodedObservation, step: np.ndarray) -> np.ndarray:
        """Lengths of the struts after the step, shape (n, 3) [m]."""
        raise NotImplementedError


class ClosedFormIK(TrackController):
    """[Jahromy, Eq. 30] at the goal one step ahead, without feedback."""

    knows = "the nominal design; unloaded closed-form inverse kinematics, no feedback"

    def _lengths(self, observed: DecodedObservation, step: np.ndarray) -> np.ndarray:
        return np.stack(self.nominal.inverse_kinematics(tuple(observed.next_goal.T)), axis=1)


class PseudoInverse(TrackController):
    """Resolved rate: length steps by the unloaded Jacobian for the way from the measured position to the next goal.

    The Jacobian is square: its inverse maps lengths to positions, so no inversion is needed here.
    """

    knows = "the nominal design; feedback of the measured position"

    def _lengths(self, observed: DecodedObservation, step: np.ndarray) -> np.ndarray:
        way = observed.next_goal - observed.tip
        rows = self.nominal.jacobian(tuple(observed.tip.T))
        change = [sum(entry * part for entry, part in zip(row, way.T, strict=True)) for row in rows]
        return np.asarray(observed.lengths + np.stack(change, axis=1))


class Observer(TrackController):
    """Identifies the payload from position and lengths, then the loaded inverse kinematics."""

    knows = "the nominal design; identifies the payload from position and lengths"

    def _weight(self, observed: DecodedObservation, step: np.ndarray) -> np.ndarray:
        """The weight that will act after the step, shape (n,) [N]."""
        return identify(self.nominal, observed.tip, observed.lengths)

    def _lengths(self, observed: DecodedObservation, step: np.ndarray) -> np.ndarray:
        goal = tuple(np.ascontiguousarray(observed.next_goal.T))
        lengths = evaluate(_held, self.nominal.design, goal, self._weight(observed, step))
        return np.stack(lengths, axis=1)


class Oracle(Privileged, Observer):
    """Told the true payload and when it comes."""

    knows = "the true payload and its moment; loaded inverse kinematics"

    def _weight(self, observed: DecodedObservation, step: np.ndarray) -> np.ndarray:
        assert self.privileged is not None
        load = self.privileged.load_at(step + 1.0)
        weight: np.ndarray = np.asarray(-load[2] if load else np.zeros(step.shape), float)
        return weight


def _held(design: SpatialPrismDesign, position: Components, weight: Component) -> Components:
    return SpatialPrism(design).held(position, (0.0, 0.0, -weight))[1]
