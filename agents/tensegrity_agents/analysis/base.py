"""What the analyses of all mechanisms share: progress, numbers, titles, files."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from tensegrity_agents.reporting.style import save
from tensegrity_envs.geometry.overlay import feature_collection

Progress = Callable[[str, int, int, str], None]
Numbers = dict[str, float | int | bool | str]


@dataclass(frozen=True)
class Analysis:
    """One mechanism's analysis.

    Attributes:
        what: it computes, in words.
        designs: named designs; more can be given as YAML files.
        default: names of designs that are analysed if none is given, with their changed fields.
        run: (designs by folder name, output folder, progress) -> numbers by folder name.
    """

    what: str
    designs: Mapping[str, Callable[[], Any]]
    default: tuple[str, ...]
    run: Callable[[Mapping[str, Any], Path, Progress], dict[str, Numbers]]


TITLES = {
    "muralidharan_fig3_boundary_points": "Boundary points of the stable wrench-feasible joint space",
    "muralidharan_fig4_swfj_swfw": "Stable wrench-feasible joint space and workspace",
    "active_conditions": "What bounds the stable wrench-feasible set",
    "furet_fig3_boundaries": "Regions by number of inverse solutions",
    "furet_fig4_inverse_solutions": "All inverse solutions",
    "furet_fig6_regions_by_type": "Regions by types of inverse solutions",
    "furet_fig7_joint_limits": "Regions by number of inverse solutions within joint limits",
    "posture_change": "A change of posture without a singularity",
    "zhao_fig2_torque": "Torque of the springs of a segment",
    "zhao_fig3_control": "Control input and its sensitivity",
    "zhao_fig5_redundancy": "Postures by three objectives",
    "zhao_fig6_control_over_targets": "Control inputs along lines of targets",
    "buckling": "Straight and buckled equilibria under an axial push",
    "loaded_workspace": "Where the tip can be held under an axial push",
    "critical_load": "Critical push by tip position",
    "ji_fig2_actuator_workspace": "Actuator workspace",
    "ji_fig3_output_workspace": "Output workspace by mode",
    "singular_configurations": "Singular configurations",
    "thrusts": "Thrusts of the actuators",
    "energy_landscape": "Energy and equilibria",
    "jahromy_fig4_forces_eq31": "Forces along the trajectory of Eq. 31",
    "jahromy_fig5_forces_eq32": "Forces along the trajectory of Eq. 32",
    "compliance": "Compliance of the unloaded platform",
    "unloading_limits": "Smallest force at which something goes slack",
    "unloading_directions": "Force at which something goes slack by its direction",
    "pictures": "The prism at rest and under load",
    "workspace": "Workspace without a load",
}


def save_titled(figure: Figure, stem: Path, remark: str = "") -> None:
    """Write a figure under its title and the name of its design, which is that of its folder."""
    name = "" if stem.name == "furet_fig3_boundaries" else stem.parent.name
    save(figure, stem, ": ".join(part for part in (name, TITLES[stem.name] + remark) if part))


class Steps:
    """Progress of one design, a step at a time."""

    def __init__(self, name: str, total: int, progress: Progress) -> None:
        self.name, self.total, self.progress, self.done = name, total, progress, 0

    def __call__(self, remark: str) -> None:
        """The next step begins."""
        self.progress(self.name, self.done, self.total, remark)
        self.done += 1

    def finish(self) -> None:
        """All steps are done."""
        self.progress(self.name, self.total, self.total, "done")


def write_geojson(features: Sequence[Mapping[str, Any]], path: Path, **properties: Any) -> None:
    """Write features as GeoJSON."""
    path.write_text(json.dumps(feature_collection(features, **properties)))
