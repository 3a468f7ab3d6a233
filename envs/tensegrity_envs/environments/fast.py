"""Fast reaching: arms that vibrate, and a score that asks how soon the tip stays on target.

The arms differ from those of the other dynamic environments in what makes haste hard: a quarter of the joint damping,
so that they ring; cables that follow their command with a lag of first order, as a motor's current loop and a tendon's
elasticity do, at 8 Hz [time constant 20 ms, one step]; and some dry friction in every hinge, as plain bearings have,
which leaves a hysteresis. `randomization=` and `level=` vary all three.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

from tensegrity_envs.core import Core
from tensegrity_envs.environments.dual_triangle import DualTriangleReach
from tensegrity_envs.environments.two_x import TwoXReach
from tensegrity_envs.tasks import FastReach, Reach, ReachWeights

_WEIGHTS = ReachWeights(distance=0.3, potential=0.3, success=1.5, effort=0.0)
_DYNAMICS = {"joint_damping": 0.005, "joint_friction": 0.002, "actuator_bandwidth": 8.0}


class FastCore(Core):
    """What makes a reaching task a fast one; in the bases of a class it stands before the environment of the arm."""

    task_type: ClassVar[type[Reach]] = FastReach
    default_weights = _WEIGHTS
    option_defaults: ClassVar[Mapping[str, Any]] = {"dynamics": _DYNAMICS}

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        if self.dynamics is None:
            raise ValueError("backend = 'quasi_static': a fast task needs backend = 'mujoco'")
        assert isinstance(self.task, FastReach)
        self.task = replace(self.task, step_time=self.dynamics.step_time)


class TwoXFastReach(FastCore, TwoXReach):
    """Fast reaching with the 2-X in cable control: `TwoXReach` with another task and other dynamics.

    Raises:
        ValueError: an argument is out of range; the message names it.
    """


class DualTriangleFastReach(FastCore, DualTriangleReach):
    """Fast reaching with the dual-triangle arm: `DualTriangleReach` with another task and other dynamics.

    Raises:
        ValueError: an argument is out of range; the message names it.
    """
