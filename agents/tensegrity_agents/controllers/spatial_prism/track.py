"""The analytic controllers that follow a curve with the spatial prism, and the information set of each."""

from abc import abstractmethod
from typing import NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import AnalyticController, Observation
from tensegrity_agents.controllers.spatial_prism.identification import identify
from tensegrity_agents.controllers.spatial_prism.measurements import decoded
from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.spatial_prism import SpatialPrism, SpatialPrismDesign
from tensegrity_envs.observation import DecodedObservation


class Memory(NamedTuple):
    """What a controller carries from step to step.

    Attributes:
        step: of the episode, shape (n,).
    """

    step: np.ndarray


class TrackController(AnalyticController[Memory]):
    """Sets the lengths at which the platform will be on the goal one step ahead. Subclasses say which those are.

    Args:
        core: of the environment.
    """

    nominal: SpatialPrism

    def decode(self, observation: Observation) -> DecodedObservation:
        """See `AnalyticController.decode`."""
        return decoded(observation, self.core)

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> Memory:
        """See `AnalyticController.initial`."""
        return Memory(np.zeros(len(index), int))

    def _act(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        wanted = self.lengths(observed, memory.step)
        return (wanted - observed.lengths) / self.rate, Memory(memory.step + 1)

    @abstractmethod
    def lengths(self, observed: DecodedObservation, step: np.ndarray) -> np.ndarray:
        """Lengths of the struts after the step, shape (n, 3) [m]."""


class ClosedFormIK(TrackController):
    """[Jahromy, Eq. 30] at the goal one step ahead, without feedback."""

    knows = "the nominal design; unloaded closed-form inverse kinematics, no feedback"

    def lengths(self, observed: DecodedObservation, step: np.ndarray) -> np.ndarray:
        """See `TrackController.lengths`."""
        return np.stack(self.nominal.unloaded_lengths(tuple(observed.next_goal.T)), axis=1)


class PseudoInverse(TrackController):
    """Resolved rate: length steps by the unloaded Jacobian from the measured position to the next goal.

    The Jacobian is square: its inverse maps lengths to positions, so no inversion is needed here.
    """

    knows = "the nominal design; feedback of the measured position"

    def lengths(self, observed: DecodedObservation, step: np.ndarray) -> np.ndarray:
        """See `TrackController.lengths`."""
        ahead = observed.next_goal - observed.tip
        rows = self.nominal.strut_jacobian(tuple(observed.tip.T))
        change = [sum(entry * part for entry, part in zip(row, ahead.T, strict=True)) for row in rows]
        return np.asarray(observed.lengths + np.stack(change, axis=1))


class Observer(TrackController):
    """Identifies the payload from position and lengths, then the loaded inverse kinematics."""

    knows = "the nominal design; identifies the payload from position and lengths"

    def _weight(self, observed: DecodedObservation, step: np.ndarray) -> np.ndarray:
        """The weight that will act after the step, shape (n,) [N]."""
        return identify(self.nominal, observed.tip, observed.lengths)

    def lengths(self, observed: DecodedObservation, step: np.ndarray) -> np.ndarray:
        """See `TrackController.lengths`."""
        return held(self.nominal, observed.next_goal, self._weight(observed, step))


class Oracle(Observer):
    """Is given the true payload and the moment when it comes."""

    wants_privileged = True
    knows = "the true payload and its moment; loaded inverse kinematics"

    def _weight(self, observed: DecodedObservation, step: np.ndarray) -> np.ndarray:
        load = self.truth.load_at(step + 1.0)
        weight: np.ndarray = np.asarray(-load[2] if load else np.zeros(step.shape), float)
        return weight


def held(prism: SpatialPrism, position: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Lengths of the struts (n, 3) [m] that hold positions (n, 3) [m] under weights (n,) [N]."""
    goal = tuple(np.ascontiguousarray(position.T))
    return np.stack(evaluate(_held, prism.design, goal, weight), axis=1)


def _held(design: SpatialPrismDesign, position: Components, weight: Component) -> Components:
    return SpatialPrism(design).held(position, (0.0, 0.0, -weight))[1]
