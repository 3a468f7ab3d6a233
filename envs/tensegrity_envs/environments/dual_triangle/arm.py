"""What the environments of the dual-triangle arm share."""

from dataclasses import replace
from typing import Any

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.core import Core
from tensegrity_envs.mechanics.dual_triangle import DualTriangle, DualTriangleDesign
from tensegrity_envs.observation import Field, arm_fields, inputs_field
from tensegrity_envs.simulation.dynamic import DynamicControl
from tensegrity_envs.simulation.protocol import Episode, State
from tensegrity_envs.simulation.quasi_static import DeltaControl

SEGMENTS = 3


class DualTriangleCore(Core):
    """What the environments of this arm share."""

    simulation: DeltaControl | DynamicControl
    design: DualTriangleDesign

    def _take_design(self, design: DualTriangleDesign) -> None:
        self.design = design
        self.nominal = DualTriangle(design, SEGMENTS)
        if not self.nominal.straight_critical_loads()[0] > 0:
            raise ValueError(
                f"design = {design!r}: the straight arm is unstable; "
                "condition (2) of [Zhao2021] asks for a longer nominal free length"
            )
        self.reach = float(self.nominal.reach)
        self.critical_load = float(self.nominal.straight_critical_loads()[0])

    def mechanism(self, design: DualTriangleDesign) -> DualTriangle:
        """See `Core.mechanism`."""
        return DualTriangle(design, SEGMENTS)

    def observed(self) -> list[Field]:
        """See `Core.observed`."""
        bounds, size = self.simulation.bounds(self.nominal), self.simulation.action_size
        meaning = f"{self.input_name.replace('_', ' ')} of the springs"
        inputs = inputs_field(self.input_name, size, bounds, "m", meaning)
        return arm_fields(self.nominal, self.reach, inputs, SEGMENTS, self.observe_all, self.observe_velocities)

    def _randomized(self, random: dict[str, np.ndarray]) -> DualTriangleDesign:
        """The design with the stiffnesses that episodes have drawn."""
        factor = random.get("stiffness")
        if factor is None:
            return self.design
        return replace(self.design, k1=self.design.k1 * factor, k2=self.design.k2 * factor)

    def hidden_info(self, episode: Episode, state: State) -> dict[str, Component | Components]:
        """The tip force [N]."""
        return {"load": episode.load_at(state.time)}

    def scene(self, episode: Episode, state: State) -> dict[str, Any]:
        """See `Core.scene`."""
        arm = self.mechanism(episode.design)
        lengths = self.simulation.actuation(arm, state.inputs)
        forces = arm.spring_forces(state.configuration, lengths)
        springs = [member.name for member in arm.members if member.kind == "spring"]
        largest = float(self.design.k1) * float(self.design.b1)
        return {
            "nodes": arm.nodes(state.configuration),
            "members": arm.members,
            "tensions": dict(zip(springs, forces, strict=True)),
            "tension_bounds": (-largest, largest),
            "base": ("A1", "B1"),
            "load": episode.load_at(state.time),
            "load_scale": self.critical_load,
        }
