"""How actions move a mechanism: quasi-statically, from equilibrium to equilibrium, or with its dynamics."""

from tensegrity_envs.simulation.lengths import LengthControl
from tensegrity_envs.simulation.protocol import FAILURES, Episode, Simulation, State
from tensegrity_envs.simulation.quasi_static import (
    DeltaControl,
    FreeLengthControl,
    InputControl,
    JointControl,
    TensionControl,
)

__all__ = [
    "FAILURES",
    "DeltaControl",
    "Episode",
    "FreeLengthControl",
    "InputControl",
    "JointControl",
    "LengthControl",
    "Simulation",
    "State",
    "TensionControl",
]
