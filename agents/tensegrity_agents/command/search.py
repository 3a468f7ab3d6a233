"""Search for the settings of a training."""

from typing import Annotated

import typer

from tensegrity_agents.command_options import EnvironmentOptions, ExperimentOptions, with_option_groups
from tensegrity_agents.console import clear_errors, progress_bar, say
from tensegrity_agents.search import needs_optuna, search


@with_option_groups
def main(
    chosen: ExperimentOptions,
    options: EnvironmentOptions,
    trials: Annotated[int, typer.Option(min=1, help="how many there are to be, those already there included")] = 20,
    share: Annotated[float, typer.Option(min=0.001, max=1.0, help="of the config's steps, of each trial")] = 0.5,
    episodes: Annotated[int, typer.Option(min=1, help="validation episodes of each trial")] = 200,
    search_seed: Annotated[int, typer.Option(min=0, help="of the search")] = 0,
    ray: Annotated[
        str | None, typer.Option(help="address of a Ray cluster to train on, such as auto or host:port")
    ] = None,
) -> None:
    """Search for the settings of a config with Optuna, and write the best as a config.

    Begins with the config's own settings. Every trial trains one agent with the first seed and scores it on validation
    episodes; test episodes are not touched. Interrupt it whenever you like: the same command goes on.

    Writes into results/<environment>-search, or --out: best.yaml, which `tensegrity train --config` takes, trials.csv,
    and search.db (SQLite, which other tools of Optuna read).

    With --ray as many trials run at a time as the cluster has cores for; the package is installed on its nodes, and
    trials whose node dies go on from their last checkpoint, which is kept here.

    Example: tensegrity search TwoXReach-v0 --trials 20 --share 0.3
    """
    with clear_errors("run the same command again to go on"):
        needs_optuna()
        experiment, folder = chosen.chosen(options)
        folder = folder if chosen.out is not None else folder.with_name(f"{folder.name}-search")
        runner = None
        if ray is not None:
            from tensegrity_agents.search_on_cluster import on_cluster

            runner = on_cluster(ray)
        with progress_bar() as progress:
            best, score = search(
                experiment, folder, trials, share, episodes, search_seed, chosen.fresh, progress, say, runner
            )
        say(f"best: {score:.1%} of {episodes} validation episodes\ntensegrity compare --config {best}")
