"""The analysis of the dual-triangle arm."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from tensegrity_agents.analysis.base import Numbers, Progress, Steps, save_titled
from tensegrity_agents.analysis.browse_mechanisms import dual_triangle_page
from tensegrity_agents.analysis.dual_triangle import figures
from tensegrity_envs.mechanics.dual_triangle import (
    DualTriangle,
    DualTriangleDesign,
)


def analyze(designs: Mapping[str, DualTriangleDesign], out: Path, progress: Progress) -> dict[str, Numbers]:
    """Write figures, regions and a page for each design, by the name of its folder; their numbers."""
    arms = {name: DualTriangle(design) for name, design in designs.items()}
    for name, arm in arms.items():
        if arm.design.segments is not None or not arm.design.is_symmetric or arm.design.springs != "bilateral":
            raise ValueError(f"design {name}: the figures are of equal, symmetric segments with bilateral springs")
        if not arm.straight_critical_loads()[0] > 0:
            raise ValueError(f"design {name}: its straight arm is unstable; a longer free_length1 and 2 is needed")
    for name, arm in arms.items():
        folder = out / name
        folder.mkdir(parents=True, exist_ok=True)
        b = float(arm.design.b1)
        compared = [(name, arm), *((other, arms[other]) for other in arms if other != name)]
        targets = [(5.5 * b, -b), (5 * b, 1.5 * b), (4.5 * b, 0.0), (4 * b, 2.5 * b)]
        drawings: dict[str, Callable[[], Figure]] = {
            "zhao_fig2_torque": partial(figures.torque_curves, arm),
            "zhao_fig3_control": partial(figures.control_and_sensitivity, compared),
            "zhao_fig5_redundancy": partial(figures.redundancy, arm, targets),
            "zhao_fig6_control_over_targets": partial(figures.control_over_targets, compared),
            "buckling": partial(figures.buckling, arm),
            "loaded_workspace": partial(figures.loaded_workspace, arm),
            "critical_load": partial(figures.critical_load_map, arm),
            "workspace": partial(figures.workspace, arm),
        }
        step = Steps(name, len(drawings) + 1, progress)
        for stem, drawing in drawings.items():
            step(stem)
            save_titled(drawing(), folder / stem)
        step("page")
        dual_triangle_page(arm, folder / "browse.html", f"Workspace without a load: {name}")
        step.finish()
    return {name: figures.numbers(arm) for name, arm in arms.items()}
