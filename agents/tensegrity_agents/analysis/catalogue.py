"""The table of mechanisms that can be analysed; a new one is one more row."""

import csv
from collections.abc import Sequence
from pathlib import Path

from tensegrity_agents.analysis import dual_triangle, planar_four_bar, spatial_prism, two_x
from tensegrity_agents.analysis.base import Analysis, Numbers, Progress
from tensegrity_agents.analysis.designs import parse_design, read_design
from tensegrity_envs.mechanics.dual_triangle import (
    ZHAO2021_CAPTION,
    ZHAO2021_TEXT,
)
from tensegrity_envs.mechanics.planar_four_bar import JI2014
from tensegrity_envs.mechanics.spatial_prism import JAHROMY
from tensegrity_envs.mechanics.two_x import FURET2018, MURALIDHARAN2022

ANALYSES: dict[str, Analysis] = {
    "two-x": Analysis(
        "stable wrench-feasible set; without offsets also regions by inverse solutions, cusps, posture changes",
        {"muralidharan2022": lambda: MURALIDHARAN2022, "furet2018": lambda: FURET2018(2 / 3)},
        ("muralidharan2022", "furet2018,b=0.4", "furet2018,b=0.6666666666666666", "furet2018,b=0.9"),
        two_x.analyze,
    ),
    "dual-triangle": Analysis(
        "torque, control, redundancy, buckling, what can be held under a load",
        {"zhao2021_caption": lambda: ZHAO2021_CAPTION, "zhao2021_text": lambda: ZHAO2021_TEXT},
        ("zhao2021_caption", "zhao2021_text"),
        dual_triangle.analyze,
    ),
    "planar-four-bar": Analysis(
        "actuator and output workspace, singular configurations, thrusts, energy of the mirror images",
        {"ji2014": lambda: JI2014},
        ("ji2014",),
        planar_four_bar.analyze,
    ),
    "spatial-prism": Analysis(
        "forces along the published trajectories, compliance, loads at which struts or cables go slack",
        {"jahromy": lambda: JAHROMY},
        ("jahromy",),
        spatial_prism.analyze,
    ),
}


def notes_on_designs(mechanism: str, designs: Sequence[str]) -> list[str]:
    """Lines that say from which designs those fields come that are not given.

    Raises:
        ValueError: unknown mechanism, or see `parse_design`.
    """
    notes = []
    for text in designs:
        named = _analysis_of(mechanism).designs
        parse_design(text, named)
        base, given = read_design(text, named)
        if given:
            changed = ", ".join(f"{name} = {value!r}" for name, value in given.items())
            notes.append(f"{text}: {changed}; all other fields are those of {base}")
    return notes


def _analysis_of(mechanism: str) -> Analysis:
    if mechanism not in ANALYSES:
        raise ValueError(f"unknown mechanism {mechanism!r}: there are analyses of {', '.join(ANALYSES)}")
    return ANALYSES[mechanism]


def analyze(mechanism: str, designs: Sequence[str], out: Path, progress: Progress) -> dict[str, Numbers]:
    """Analyse designs of a mechanism and write everything to `out`, a folder for each design.

    Args:
        mechanism: a key of `ANALYSES`.
        designs: see `parse_design`; none for the mechanism's published ones.
        out: folder, made if it is missing.
        progress: (what, done, total, remark).

    Returns:
        Numbers of each design.

    Raises:
        ValueError: unknown mechanism, or see `parse_design`.
    """
    chosen = _analysis_of(mechanism)
    parsed = dict(parse_design(text, chosen.designs) for text in (designs or chosen.default))
    numbers = chosen.run(parsed, out, progress)
    for name, table in numbers.items():
        _write_numbers(table, out / name)
    return numbers


def _write_numbers(table: Numbers, folder: Path) -> None:
    with (folder / "numbers.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["quantity", "value"])
        writer.writerows(table.items())
    lines = ["| quantity | value |", "|---|---:|", *(f"| {name} | {as_text(value)} |" for name, value in table.items())]
    (folder / "numbers.md").write_text("\n".join(lines) + "\n")


def as_text(value: float | int | bool | str) -> str:
    """A number for a table: seven digits."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.7g}" if isinstance(value, float) else str(value)
