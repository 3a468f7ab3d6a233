"""In which coordinates the paths of an arm among obstacles are straight, and where the arm is there."""

from typing import Any, ClassVar

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, namespace_of
from tensegrity_envs.simulation.actuator_lengths import STROKE, is_open
from tensegrity_envs.simulation.protocol import State


class JointSpace:
    """Joint angles [rad], of arms whose nodes depend on nothing else.

    Attributes:
        size: how many coordinates change along a path.
        kept: how many more there are, which stay what they are in an episode; they come last.
        limit: of the absolute value of each coordinate that changes.

    Args:
        core: of the environment.
    """

    kept: ClassVar[int] = 0

    def __init__(self, core: Any) -> None:
        self.nominal, self.sampler = core.nominal, core.sampler
        self.size = int(core.nominal.degrees_of_freedom)
        self.limit = float(core.nominal.design.joint_limit)

    def posture(self, place: Components) -> tuple[Components, Components | None]:
        """Configuration and, where the nodes depend on them, inputs at some coordinates. Traceable."""
        return place, None

    def place(self, state: State) -> Components:
        """The coordinates of a state. Traceable."""
        return state.configuration

    def ends(self, sampled: Any, target: Components) -> tuple[Components, Components]:
        """Coordinates of the starts of sampled episodes, and of what solves them; see `Solvable.solved`."""
        return sampled.configuration, target

    def inside(self, mechanism: Any, index: np.ndarray, place: Components) -> np.ndarray:
        """Whether those at `index` of a batch of mechanisms can be held at some coordinates."""
        return np.asarray(self.sampler.inside(mechanism.take(index), place))


class LengthSpace(JointSpace):
    """Actuator lengths of the planar 4-bar mechanism without a load, as rho / L - 1; and the side of CD, which is kept.

    Bars turn fast where C and D are close to each other, so that configurations would not do.
    """

    kept = 1

    def __init__(self, core: Any) -> None:
        self.nominal, self.sampler = core.nominal, core.sampler
        self.size, self.limit = 2, 2 * STROKE[1] - 1

    def lengths(self, place: Components) -> Components:
        """Actuator lengths [m]."""
        return tuple(self.nominal.length * (1 + share) for share in place[:2])

    def of_lengths(self, lengths: Components, side: Component) -> Components:
        """The coordinates."""
        return *(rho / self.nominal.length - 1 for rho in lengths), side

    def posture(self, place: Components) -> tuple[Components, Components | None]:
        """See `JointSpace.posture`."""
        lengths = self.lengths(place)
        return self.nominal.rectangle(lengths, place[2])[0], lengths

    def place(self, state: State) -> Components:
        """See `JointSpace.place`."""
        side = self.nominal.side_of(state.configuration, state.inputs)
        return self.of_lengths(state.inputs, namespace_of(side).where(side > 0, 1.0, -1.0))

    def ends(self, sampled: Any, target: Components) -> tuple[Components, Components]:
        """See `JointSpace.ends`; what solves an episode are lengths."""
        side = sampled.episode.random["side"]
        return self.of_lengths(sampled.inputs, side), self.of_lengths(target, side)

    def inside(self, mechanism: Any, index: np.ndarray, place: Components) -> np.ndarray:
        """See `JointSpace.inside`: whether the rectangle is open enough."""
        return np.asarray(is_open(self.nominal, self.lengths(place), self.sampler.safe_margin))
