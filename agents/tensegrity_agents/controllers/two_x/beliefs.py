"""What model-predictive control believes of a 2-X: the identifying observer's stiffness, mass and payload."""

from typing import NamedTuple

import numpy as np

from tensegrity_agents.controllers.two_x.measurements import configuration_from_tip
from tensegrity_agents.controllers.two_x.servo import Belief, IdentifyingObserver
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation
from tensegrity_envs.simulation import Episode


class Believed(NamedTuple):
    """Parameters, and the latest configurations (n, 2) [rad]."""

    arm: Belief
    configuration: np.ndarray


class TwoXBeliefs:
    """See `mpc.Beliefs`.

    Args:
        core: of the environment, in cable control.
    """

    def __init__(self, core: Core) -> None:
        self.observer = IdentifyingObserver(core)

    def first(self, observed: DecodedObservation) -> Believed:
        """See `mpc.Beliefs`."""
        q = configuration_from_tip(self.observer.nominal, observed, None)
        return Believed(self.observer.updated(self.observer.prior(len(q)), q, observed), q)

    def updated(self, belief: Believed, observed: DecodedObservation) -> Believed:
        """See `mpc.Beliefs`."""
        q = configuration_from_tip(self.observer.nominal, observed, belief.configuration)
        return Believed(self.observer.updated(belief.arm, q, observed), q)

    def told(self, belief: Believed) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """See `mpc.Beliefs`."""
        stiffness, mass, payload = belief.arm.mean.T
        return belief.configuration, {"random_stiffness": stiffness, "random_mass": mass, "payload": payload}

    def goals(self, belief: Believed, episode: Episode) -> np.ndarray:
        """See `mpc.Beliefs`: the stiffest tensions of the solutions."""
        arm, design = self.observer.core.mechanism(episode.design), self.observer.nominal.design
        held = []
        for q in episode.solutions:  # infinite where there are fewer
            there = np.isfinite(np.stack(q)).all(axis=0)
            tensions = np.stack(arm.stiffest_tensions(tuple(np.where(there, angle, 0.0) for angle in q)), axis=1)
            held.append(np.where(there[:, None], tensions, np.nan))
        return np.asarray(np.clip(np.stack(held), design.min_tension, design.max_tension))
