"""Quasi-static controllers in dynamics, and the reverse: who keeps his success where he was not made for?"""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_agents.command_options import EnvironmentChoice, EnvironmentOptions, with_option_groups
from tensegrity_agents.console import checked_folder, clear_errors, console, progress_bar, say
from tensegrity_agents.evaluation.transfer import pair_of
from tensegrity_agents.reporting.transfer_table import print_transfer


@with_option_groups
def main(
    chosen: EnvironmentChoice,
    options: EnvironmentOptions,
    results: Annotated[Path, typer.Option(help="folder of the trained agents")] = Path("results"),
    episodes: Annotated[int, typer.Option(min=1, help="how many test episodes")] = 1000,
) -> None:
    """Evaluate the agents and the baselines of a quasi-static environment and of its dynamic twin on both.

    ENVIRONMENT is either of the two, DualTriangleLoadedReachMuJoCo-v0 if it is left out. Writes
    <results>/<dynamic environment>/transfer.md. With options that change the environments, agents are those that
    `tensegrity train` and `tensegrity compare` have trained with the same options.

    Example: tensegrity transfer TwoXTensionReachMuJoCo-v0
    """
    from tensegrity_agents.experiment import transfer_table  # Torch, which completions need not wait for

    with clear_errors():
        pair = pair_of(chosen.named("DualTriangleLoadedReachMuJoCo-v0"))
        checked_folder(results, "--results")
        given = options.checked(*pair)
        with progress_bar() as progress:
            table, path = transfer_table(pair, results, given, episodes, progress)
        print_transfer(table, pair, console)
        say(f"table: {path}")
        if not any(found.candidate.name == "agent" for found in table):
            say(f"no trained agents in {results}/: `tensegrity train` makes them")
