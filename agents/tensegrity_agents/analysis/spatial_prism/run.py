"""The analysis of the spatial prism."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from tensegrity_agents.analysis.base import Numbers, Progress, Steps, save_titled
from tensegrity_agents.analysis.browse_mechanisms import spatial_prism_page
from tensegrity_agents.analysis.spatial_prism import figures
from tensegrity_envs.mechanics.spatial_prism import TRAJECTORIES, SpatialPrism, SpatialPrismDesign


def analyze(designs: Mapping[str, SpatialPrismDesign], out: Path, progress: Progress) -> dict[str, Numbers]:
    """Write figures, regions and a page for each design, by the name of its folder; their numbers."""
    numbers: dict[str, Numbers] = {}
    for name, design in designs.items():
        prism, folder = SpatialPrism(design), out / name
        folder.mkdir(parents=True, exist_ok=True)
        drawings: dict[str, Callable[[], Figure]] = {
            f"jahromy_fig{number}_forces_{trajectory}": partial(figures.forces_along, prism, trajectory)
            for number, trajectory in enumerate(TRAJECTORIES, 4)
        }
        drawings |= {
            "compliance": partial(figures.compliance_maps, prism),
            "unloading_limits": partial(figures.unloading_maps, prism),
            "unloading_directions": partial(figures.polar_limits, prism),
            "pictures": partial(figures.pictures, prism),
            "workspace": partial(figures.workspace, prism),
        }
        step = Steps(name, len(drawings) + 1, progress)
        for stem, drawing in drawings.items():
            step(stem)
            save_titled(drawing(), folder / stem)
        step("page")
        spatial_prism_page(prism, folder / "browse.html", f"Spatial prism: {name}")
        step.finish()
        numbers[name] = figures.numbers(prism)
    return numbers
