"""What the environments of the dual-triangle arm share."""

from collections.abc import Collection
from typing import Any, ClassVar

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.core import Core
from tensegrity_envs.mechanics.dual_triangle import ZHAO2021_CAPTION, DualTriangle, DualTriangleDesign
from tensegrity_envs.observation import Field, arm_fields, inputs_field
from tensegrity_envs.options import Options
from tensegrity_envs.simulation.dynamic import DynamicControl
from tensegrity_envs.simulation.protocol import Episode, State
from tensegrity_envs.simulation.quasi_static import DeltaControl

PUBLISHED_SEGMENTS = 3


class DualTriangleCore(Core):
    """What the environments of this arm share.

    Attributes:
        segments: how many the arm has.
    """

    info_meanings: ClassVar[dict[str, tuple[str, str]]] = {"load": ("N", "force at the tip")}
    published = ZHAO2021_CAPTION
    simulation: DeltaControl | DynamicControl
    design: DualTriangleDesign
    segments: int = PUBLISHED_SEGMENTS

    def take_options(self, options: Options, applicable: Collection[str], where: str) -> None:
        """See `Core.take_options`.

        Raises:
            ValueError: the straight arm is unstable.
        """
        super().take_options(options, applicable, where)
        self.nominal = DualTriangle(self.design, self.segments)
        critical_load = self.nominal.straight_critical_loads()[0]
        if not critical_load > 0:
            raise ValueError(
                f"design = {self.design!r}: the straight arm is unstable; "
                "condition (2) of [Zhao2021] asks for a longer nominal free length"
            )
        self.reach, self.critical_load = float(self.nominal.reach), float(critical_load)

    @property
    def scale(self) -> float:
        """How many times as far as the published arm this one reaches."""
        return self.reach / float(DualTriangle(self.published, PUBLISHED_SEGMENTS).reach)

    def tip_region(self) -> Any:
        """Within the limits of joints and inputs, of three equal segments; see `Core.tip_region`."""
        if self.segments != PUBLISHED_SEGMENTS or self.design.segments is not None:
            return None
        from tensegrity_envs.geometry.dual_triangle_fields import maximum, region_of  # loads Shapely

        simulation: Any = self.simulation
        low, high = (float(bound) for bound in simulation.bounds(self.nominal))
        limit = float(self.design.joint_limit)
        control = getattr(simulation, "control", simulation)  # of a dynamic one, the inputs that it moves

        def room(q: tuple[np.ndarray, ...]) -> np.ndarray:
            still = (np.zeros_like(q[0]), np.zeros_like(q[0]))
            inputs = np.array(control.usual_inputs(self.nominal, tuple(np.clip(a, -limit, limit) for a in q), still))
            margin = np.minimum(inputs - low, high - inputs).min(axis=0) / (high - low)
            return np.asarray(np.nan_to_num(np.minimum(margin, (limit - np.abs(np.array(q))).min(axis=0)), nan=-1.0))

        return region_of(maximum(self.nominal, room, 301, mirrored=False), float(self.design.b1))

    def mechanism(self, design: DualTriangleDesign) -> DualTriangle:
        """See `Core.mechanism`."""
        return DualTriangle(design, self.segments)

    def observed(self) -> list[Field]:
        """See `Core.observed`."""
        bounds, size = self.simulation.bounds(self.nominal), self.simulation.action_size
        meaning = f"{self.input_name.replace('_', ' ')} of the springs"
        inputs = inputs_field(self.input_name, size, bounds, "m", meaning)
        return arm_fields(self.nominal, self.reach, inputs, self.segments, self.observe_all, self.observe_velocities)

    def design_of(self, random: dict[str, np.ndarray]) -> DualTriangleDesign:
        """The design with the stiffnesses sampled for the episodes."""
        factor = random.get("stiffness")
        if factor is None:
            return self.design
        return self.design.stiffened(factor)

    def hidden_info(self, episode: Episode, state: State) -> dict[str, Component | Components]:
        """The tip force [N]."""
        return {"load": episode.load_at(state.time)}

    def scene(self, episode: Episode, state: State) -> dict[str, Any]:
        """See `Core.scene`."""
        arm = self.mechanism(episode.design)
        lengths = self.simulation.actuation(arm, state.inputs)
        forces = arm.spring_forces(state.configuration, lengths)
        springs = [member.name for member in arm.members if member.kind == "spring"]
        largest = float(np.max(self.design.k1)) * float(np.max(self.design.b1))
        return {
            "nodes": arm.nodes(state.configuration),
            "members": arm.members,
            "tensions": dict(zip(springs, forces, strict=True)),
            "tension_bounds": (-largest, largest),
            "base": ("A1", "B1"),
            "load": episode.load_at(state.time),
            "load_scale": self.critical_load,
        }
