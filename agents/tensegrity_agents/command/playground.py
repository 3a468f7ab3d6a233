"""Pages to play with a mechanism in a browser: drag the tip, see all inverse solutions and their margins."""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_agents.console import checked_folder, clear_errors, say
from tensegrity_agents.playground import PLAYGROUNDS, write_playground


def main(
    mechanism: Annotated[
        list[str] | None, typer.Argument(help=f"any of {', '.join(PLAYGROUNDS)}", show_default="all of them")
    ] = None,
    out: Annotated[Path, typer.Option(help="results folder")] = Path("results/playground"),
) -> None:
    """Write one self-contained HTML page per mechanism, which needs no network.

    Example: tensegrity playground two-x
    """
    with clear_errors():
        for name in mechanism or []:
            if name not in PLAYGROUNDS:
                raise ValueError(f"unknown mechanism {name!r}: there are pages of {', '.join(PLAYGROUNDS)}")
        folder = checked_folder(out, "--out")
        for name in mechanism or PLAYGROUNDS:
            say(str(write_playground(PLAYGROUNDS[name], folder / f"{name}.html")))
