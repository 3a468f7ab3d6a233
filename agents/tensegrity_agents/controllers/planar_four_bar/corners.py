"""Controllers of the planar 4-bar mechanism that go from corner to corner of a path, as agents correct them.

From wherever a correction has led the lengths, they go straight on to the next corner: what was added does not stay.
"""

from abc import abstractmethod
from typing import Any, TypeVar

import numpy as np

from tensegrity_agents.controllers.correctable import Correctable
from tensegrity_agents.controllers.planar_four_bar.planning import LEGS
from tensegrity_envs.observation import DecodedObservation

Memory = TypeVar("Memory", bound=tuple[Any, ...])

_FAR = 10.0  # steps
_STRONG = 0.2  # [K L], the largest unknown force of the ids


class ByCorners(Correctable[Memory]):
    """Follows a path of actuator lengths that can be corrected."""

    looks = 0  # first steps without a plan

    @abstractmethod
    def course(self, observed: DecodedObservation, memory: Memory) -> tuple[Any, np.ndarray, np.ndarray]:
        """The path with how far it has come, a `reach.Memory`; the lengths that have been asked for, (n, 2) [m]; and
        the force that is believed in, (n, 2) [N].
        """

    @abstractmethod
    def steps(self, memory: Memory) -> np.ndarray:
        """How many steps it has acted for, (n,)."""

    def looks_at_rest(self, memory: Memory) -> np.ndarray:
        """See `Correctable.looks_at_rest`: the first steps are what identifies the force."""
        return np.asarray(self.steps(memory) <= self.looks)

    @property
    def outlook_size(self) -> int:
        """See `Correctable.outlook_size`."""
        return 7

    def outlook(self, observed: DecodedObservation, memory: Memory) -> np.ndarray:
        """See `Correctable.outlook`: the ways to the next corner and to the end, which corner that is, and the force
        that is believed in.
        """
        plan, inputs, load = self.course(observed, memory)
        places = plan.path[np.arange(len(inputs)), plan.leg], plan.path[:, -1]
        ways = [(place - inputs) / (_FAR * self.rate) for place in places]
        force = load / (_STRONG * float(self.nominal.largest_force))
        return np.concatenate([*ways, plan.leg[:, None] / LEGS, force], axis=1)
