"""The main job: train agents, compare them with the analytic controllers on held-out episodes, and report."""

from typing import Annotated

import typer

from tensegrity_agents.command_options import EnvironmentOptions, ExperimentOptions, Json, with_option_groups
from tensegrity_agents.console import (
    GO_ON,
    clear_errors,
    console,
    for_machines,
    progress_bar,
    say,
    tell_json,
)
from tensegrity_agents.reporting.table import print_table, verdict


@with_option_groups
def main(
    chosen: ExperimentOptions,
    options: EnvironmentOptions,
    controller: Annotated[
        list[str] | None,
        typer.Option(
            help="one more controller beside those of the config, such as my_module:MyController; may be repeated. "
            "tensegrity list ID tells the baselines of an id"
        ),
    ] = None,
    episodes: Annotated[
        int | None, typer.Option(min=1, help="test episodes", show_default="as many as the config says, or 1000")
    ] = None,
    json: Json = False,
) -> None:
    """Train (or load) the agents of a config, evaluate them and the controllers on the same test episodes,
    print the table, write the report.

    Interrupt it whenever you like: the same command goes on, and agents already trained are not trained again.

    Example: tensegrity compare TwoXPayloadReach-v0
    """
    from tensegrity_agents.experiment import compare  # Torch, which completions need not wait for

    with for_machines(json), clear_errors(GO_ON):
        experiment, folder = chosen.chosen(options, episodes=episodes, more_controllers=controller)
        say(f"{experiment.env}: {len(experiment.seeds)} agent(s), {experiment.episodes} test episodes -> {folder}/")
        with progress_bar() as progress:
            found = compare(experiment, folder, progress, chosen.fresh, chosen.processes)
        if json:
            tell_json(found.rows)
        print_table(found.rows, console)
        console.print(verdict(found.rows))
        say(
            f"\nreport:  {found.report}\n"
            f"video:   {folder}/side_by_side.gif\n"
            f"numbers: {folder}/episodes.csv, {folder}/summary.md"
        )
