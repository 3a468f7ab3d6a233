"""The analysis of the planar 4-bar mechanism."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from tensegrity_agents.analysis.base import Numbers, Progress, Steps, save_titled, write_geojson
from tensegrity_agents.analysis.browse_mechanisms import four_bar_page
from tensegrity_agents.analysis.planar_four_bar import figures
from tensegrity_envs.geometry.four_bar_workspace import MODES, actuator_workspace, output_workspace
from tensegrity_envs.mechanics.planar_four_bar import PlanarFourBar, PlanarFourBarDesign


def analyze(designs: Mapping[str, PlanarFourBarDesign], out: Path, progress: Progress) -> dict[str, Numbers]:
    """Write figures, regions and a page for each design, by the name of its folder; their numbers."""
    table: dict[str, Numbers] = {}
    for name, design in designs.items():
        folder = out / name
        folder.mkdir(parents=True, exist_ok=True)
        arm, l = PlanarFourBar(design), float(design.length)
        progress(name, 0, 8, "workspaces")
        tips = {mode: output_workspace(arm, mode) for mode in MODES}
        drawings: dict[str, Callable[[], Figure]] = {
            "ji_fig2_actuator_workspace": partial(figures.actuator_workspaces, arm),
            "ji_fig3_output_workspace": partial(figures.output_workspaces, arm, tips),
            "singular_configurations": partial(figures.singular_postures, arm),
            "thrusts": partial(figures.thrust_map, arm),
            "energy_landscape": partial(figures.energy_landscape, arm, (1.4 * l, 1.2 * l)),
        }
        step = Steps(name, len(drawings) + 3, progress)
        for stem, drawing in drawings.items():
            step(stem)
            save_titled(drawing(), folder / stem)
        step("regions")
        for mode in MODES:
            inputs = actuator_workspace(arm, mode).trace()
            write_geojson(inputs.to_features(), folder / f"actuator_{mode}.geojson", coordinates="rho1, rho2 [m]")
            write_geojson(tips[mode].to_features(), folder / f"output_{mode}.geojson", coordinates="x, y [m]")
        step("page")
        four_bar_page(arm, tips, folder / "browse.html", f"Output workspace: {name}")
        step("numbers")
        table[name] = figures.numbers(arm, tips)
        step.finish()
    return table
