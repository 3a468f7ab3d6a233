"""Where a mechanism can work: workspaces, singularities and cuspidality as figures, regions and numbers."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from tensegrity_agents.analysis import ANALYSES, analyze, as_text
from tensegrity_agents.console import clear_errors, console, progress_bar


def main(
    mechanism: Annotated[str, typer.Argument(help=f"one of {', '.join(ANALYSES)}")],
    design: Annotated[
        list[str] | None,
        typer.Option(help="such as muralidharan2022,payload=0.5 or my_arm.yaml; may be repeated [default: published]"),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="results folder [default: results/analysis/<mechanism>]")] = None,
) -> None:
    """Write figures (PNG, SVG, PDF), regions (GeoJSON), a page for browsing (HTML) and numbers for each design.

    Example: python scripts/analyze.py two-x --design muralidharan2022,payload=0.5
    """
    with clear_errors():
        folder = out or Path("results") / "analysis" / mechanism
        with progress_bar() as progress:
            numbers = analyze(mechanism, design or [], folder, progress)
        for name, values in numbers.items():
            table = Table("quantity", "value", title=name, title_justify="left")
            for quantity, value in values.items():
                table.add_row(Text(quantity), as_text(value))
            console.print(table)
        console.print(f"figures, regions, numbers.csv and browse.html are in {folder}/<design>/")


if __name__ == "__main__":
    typer.run(main)
