"""The main job: train agents, compare them with the analytic controllers on held-out episodes, and report."""

import tensegrity_agents.interrupt  # noqa: F401  # isort: skip  (first: see there)

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_agents.console import (
    GO_ON,
    Config,
    Design,
    EnvOfConfig,
    Fresh,
    LoadRange,
    Out,
    PayloadRange,
    Randomization,
    Seeds,
    Tolerance,
    checked_folder,
    clear_errors,
    console,
    explain_options,
    find_experiment,
    list_of_baselines,
    parse_options,
    parse_seeds,
    progress_bar,
    say,
)
from tensegrity_agents.evaluation.compare import compare
from tensegrity_agents.reporting.compare_report import write_comparison
from tensegrity_agents.reporting.table import print_table, verdict


def main(
    config: Config = None,
    env: EnvOfConfig = None,
    out: Out = None,
    controller: Annotated[
        list[str] | None,
        typer.Option(
            help="one more controller beside those of the config, such as my_module:MyController; may be repeated. "
            f"Baselines are: {list_of_baselines()}"
        ),
    ] = None,
    seeds: Seeds = None,
    episodes: Annotated[
        int | None, typer.Option(min=1, help="test episodes", show_default="as many as the config says, or 1000")
    ] = None,
    design: Design = None,
    randomization: Randomization = None,
    tolerance: Tolerance = None,
    load_range: LoadRange = None,
    payload_range: PayloadRange = None,
    fresh: Fresh = False,
) -> None:
    """Train (or load) the agents of a config, evaluate them and the controllers on the same test episodes,
    print the table, write the report.

    Interrupt it whenever you like: the same command goes on, and agents already trained are not trained again.

    Example: python scripts/compare.py --env TwoXPayloadReach-v0
    """
    with clear_errors(GO_ON):
        changes = parse_options(design, randomization, tolerance, load_range, payload_range)
        if seeds is not None:
            changes["seeds"] = parse_seeds(seeds)
        if episodes is not None:
            changes["episodes"] = episodes
        experiment = find_experiment(config, env)
        if controller:
            changes["controllers"] = list(dict.fromkeys([*experiment.compared, *controller]))
        experiment = experiment.changed(**changes)
        folder = checked_folder(out or Path("results") / experiment.results_name, "--out")
        explain_options(experiment.env, experiment.options)
        say(f"{experiment.env}: {len(experiment.seeds)} agent(s), {experiment.episodes} test episodes -> {folder}/")
        with progress_bar() as progress:
            comparison = compare(experiment, folder, progress, fresh)
            report, rows = write_comparison(experiment, comparison, folder, progress)
        print_table(rows, console)
        console.print(verdict(rows))
        say(
            f"\nreport:  {report}\n"
            f"video:   {folder}/side_by_side.gif\n"
            f"numbers: {folder}/episodes.csv, {folder}/summary.md"
        )


if __name__ == "__main__":
    typer.run(main)
