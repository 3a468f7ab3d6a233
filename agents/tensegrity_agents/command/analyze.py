"""Where a mechanism can work: workspaces, singularities and cuspidality as figures, regions and numbers."""

import time
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from tensegrity_agents.analysis import ANALYSES, analyze, as_text, notes_on_designs
from tensegrity_agents.command_options import Json
from tensegrity_agents.console import (
    checked_folder,
    clear_errors,
    console,
    for_machines,
    progress_bar,
    say,
    tell_json,
)

NAMED = "; ".join(f"{name}: {', '.join(analysis.designs)}" for name, analysis in ANALYSES.items())


def main(
    mechanism: Annotated[str, typer.Argument(help=f"one of {', '.join(ANALYSES)}")],
    design: Annotated[
        list[str] | None,
        typer.Option(
            help="such as muralidharan2022,payload=0.5 or my_arm.yaml (which may name the design that other fields "
            f"come from as 'base'); may be repeated. There are {NAMED}",
            show_default="the published ones",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="results folder", show_default="results/analysis/<mechanism>")
    ] = None,
    json: Json = False,
) -> None:
    """Write figures (PNG, SVG, PDF), a table of numbers, a page for browsing (HTML) and, where the mechanism has them,
    regions (GeoJSON), for each design.

    Example: tensegrity analyze two-x --design muralidharan2022,payload=0.5
    """
    with for_machines(json), clear_errors():
        folder = checked_folder(out or Path("results") / "analysis" / mechanism, "--out")
        for note in notes_on_designs(mechanism, design or []):
            say(note)
        begun = time.time() - 1.0
        with progress_bar() as progress:
            numbers = analyze(mechanism, design or [], folder, progress)
        if json:
            tell_json(numbers)
        for name, values in numbers.items():
            table = Table("quantity", "value", title=name, title_justify="left")
            for quantity, value in values.items():
                table.add_row(Text(quantity), as_text(value))
            console.print(table)
        for place in [folder, *(folder / name for name in numbers)]:
            written = [
                path.name for path in sorted(place.glob("*.*")) if path.is_file() and path.stat().st_mtime > begun
            ]
            if written:
                say(f"{place}/: {', '.join(written)}")
