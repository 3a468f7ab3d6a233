"""What a dynamic simulation needs and the papers do not give."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from tensegrity_envs.mechanics.design import Member, require, require_finite_numbers


@dataclass(frozen=True)
class Dynamics:
    """Parameters of the dynamics; any of them may be randomized from episode to episode, all but the last three freely.

    Attributes:
        bar_line_density: mass per length of the bars that have no mass in the analytic model (the dual-triangle's)
            [kg/m]; they have inertia but no weight, since the analytic model has none.
        tip_mass: point mass at the tip of a mechanism whose design has no payload [kg], without weight likewise.
        joint_damping: viscous damping of every hinge [N m s/rad].
        joint_friction: dry friction of every hinge [N m]; 0 for none, as in the analytic models.
        platform_mass: of the spatial prism's platform, a uniform triangle [kg]; without weight, too.
        servo_stiffness: of prismatic actuators, force by deviation from the length that is to be kept [N/m].
        servo_time: in which that deviation decays [s]; their damping is stiffness times this. Half a time step or more.
        actuator_bandwidth: at which a tension or free length follows its command, first order [Hz]; 0 for at once.
            Prismatic actuators move evenly from one length to the next within a step instead.
        timestep: of the integrator [s]; the 2-X needs 0.001 or less (its joint limits keep it from flipping), the
            others 0.005 or less.
        frame_skip: time steps in one step of an environment.
        integrator: "implicitfast"; "RK4" to validate dynamics; "discrete", implicit in positions too, which is stable
            with any servo, and damps slow motion.
    """

    bar_line_density: float = 0.2
    tip_mass: float = 0.05
    joint_damping: float = 0.02
    joint_friction: float = 0.0
    platform_mass: float = 0.5
    servo_stiffness: float = 1e10
    servo_time: float = 0.001
    actuator_bandwidth: float = 0.0
    timestep: float = 0.001
    frame_skip: int = 20
    integrator: Literal["implicitfast", "RK4", "discrete"] = "implicitfast"

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            TypeError: a field is not a number, or frame_skip not an integer.
            ValueError: a field is outside its range; the message names field and value.
        """
        require_finite_numbers(self, {"integrator"})
        name = type(self).__name__
        for field in ("bar_line_density", "platform_mass", "servo_stiffness", "timestep"):
            require(getattr(self, field) > 0, name, field, getattr(self, field), "positive")
        for field in ("tip_mass", "joint_damping", "joint_friction", "servo_time", "actuator_bandwidth"):
            require(getattr(self, field) >= 0, name, field, getattr(self, field), "zero or positive")
        require(self.timestep <= 0.005, name, "timestep", self.timestep, "at most 0.005 s (the simulation diverges)")
        if not isinstance(self.frame_skip, int):
            raise TypeError(f"{name}.frame_skip = {self.frame_skip!r}: must be an integer")
        require(self.frame_skip >= 1, name, "frame_skip", self.frame_skip, "1 or more")
        if self.integrator not in ("implicitfast", "RK4", "discrete"):
            raise ValueError(f'{name}.integrator = {self.integrator!r}: must be "implicitfast", "RK4" or "discrete"')

    @property
    def step_time(self) -> float:
        """Duration of one step of an environment [s]."""
        return self.timestep * self.frame_skip

    @property
    def time_constant(self) -> float:
        """Of the actuators [s]; 0 without lag."""
        return 1 / (2 * math.pi * self.actuator_bandwidth) if self.actuator_bandwidth else 0.0

    def bar_mass(self, bar: Member, length: float) -> float:
        """Of a bar of this length [m]: its own, or what its length weighs [kg]."""
        return float(bar.mass or self.bar_line_density * length)

    def varied(self, factors: Mapping[str, float]) -> "Dynamics":
        """These with so many times the mass, damping, friction or bandwidth; other names are left alone."""
        mass, damping, friction, bandwidth = (
            factors.get(name, 1.0) for name in ("mass", "damping", "friction", "bandwidth")
        )
        return replace(
            self,
            joint_damping=damping * self.joint_damping,
            joint_friction=friction * self.joint_friction,
            actuator_bandwidth=bandwidth * self.actuator_bandwidth,
            bar_line_density=mass * self.bar_line_density,
            tip_mass=mass * self.tip_mass,
            platform_mass=mass * self.platform_mass,
        )
