"""The main job: train agents, compare them with the analytic controllers on held-out episodes, and report."""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_agents.console import clear_errors, console, find_experiment, progress_bar
from tensegrity_agents.evaluation.compare import compare
from tensegrity_agents.reporting.compare_report import write_comparison
from tensegrity_agents.reporting.table import print_table, verdict


def main(
    env: Annotated[
        str | None, typer.Option(help="take the config in configs/ for this id, such as TwoXTensionReach-v0")
    ] = None,
    config: Annotated[Path | None, typer.Option(help="or this YAML file")] = None,
    out: Annotated[Path | None, typer.Option(help="results folder [default: results/<environment>]")] = None,
    controller: Annotated[
        list[str] | None, typer.Option(help="one more controller, such as my_module:MyController; may be repeated")
    ] = None,
    seeds: Annotated[str | None, typer.Option(help="training seeds instead of the config's, such as 0,1,2,3,4")] = None,
    episodes: Annotated[int | None, typer.Option(min=1, help="test episodes instead of the config's")] = None,
    fresh: Annotated[bool, typer.Option(help="train anew even where a trained agent is there")] = False,
) -> None:
    """Train (or load) the agents of a config, evaluate them and the controllers on the same test episodes,
    print the table, write the report.

    Interrupt it whenever you like: the same command goes on from the last checkpoint, and agents already trained are
    not trained again.

    Example: python scripts/compare.py --env TwoXPayloadReach-v0
    """
    with clear_errors():
        experiment = find_experiment(config, env or (None if config else "TwoXReach-v0"))
        changed = {
            "seeds": [int(part) for part in seeds.split(",")] if seeds else experiment.seeds,
            "episodes": episodes or experiment.episodes,
            "controllers": [*experiment.compared, *(controller or [])],
        }
        experiment = type(experiment)(**experiment.model_dump() | changed)
        folder = out or Path("results") / experiment.env.split("/")[1]
        console.print(
            f"{experiment.env}: {len(experiment.seeds)} agent(s), {experiment.episodes} test episodes -> {folder}/"
        )
        with progress_bar() as progress:
            comparison = compare(experiment, folder, progress, fresh)
            report, rows = write_comparison(experiment, comparison, folder, progress)
        print_table(rows, console)
        console.print(verdict(rows))
        console.print(
            f"\nreport:  {report}\n"
            f"video:   {folder}/side_by_side.gif\n"
            f"numbers: {folder}/episodes.csv, {folder}/summary.md"
        )


if __name__ == "__main__":
    typer.run(main)
