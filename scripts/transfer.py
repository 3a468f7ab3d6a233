"""Quasi-static controllers in dynamics, and the reverse: who keeps his success where he was not made for?"""

import tensegrity_agents.interrupt  # noqa: F401  # isort: skip  (first: see there)

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_agents.config import ConfigError, known_env
from tensegrity_agents.console import (
    Design,
    LoadRange,
    PayloadRange,
    Randomization,
    Tolerance,
    checked_folder,
    clear_errors,
    console,
    explain_options,
    parse_options,
    progress_bar,
    say,
)
from tensegrity_agents.env_options import check_options, results_name
from tensegrity_agents.evaluation.transfer import candidates, pair_of, transfer
from tensegrity_agents.reporting.transfer_table import print_transfer, transfer_to_markdown


def main(
    env: Annotated[str, typer.Option(help="either of the two environments")] = "DualTriangleLoadedReachMuJoCo-v0",
    results: Annotated[Path, typer.Option(help="folder of the trained agents")] = Path("results"),
    episodes: Annotated[int, typer.Option(min=1, help="how many test episodes")] = 1000,
    design: Design = None,
    randomization: Randomization = None,
    tolerance: Tolerance = None,
    load_range: LoadRange = None,
    payload_range: PayloadRange = None,
) -> None:
    """Evaluate the agents and the baselines of a quasi-static environment and of its dynamic twin on both.

    Writes <results>/<dynamic environment>/transfer.md. With options that change the environments, agents are those that
    train.py and compare.py have trained with the same options.

    Example: python scripts/transfer.py --env TwoXTensionReachMuJoCo-v0
    """
    with clear_errors():
        pair = pair_of(known_env(env))
        checked_folder(results, "--results")
        options = parse_options(design, randomization, tolerance, load_range, payload_range)
        for env_id in pair:
            check_options(env_id, options)
        explain_options(pair[1], options)
        found = candidates(pair, results, options)
        if not found:
            raise ConfigError(f"nothing to evaluate: {pair[0]} has no baselines, and {results}/ no agents")
        with progress_bar() as progress:
            table = transfer(pair, found, episodes, progress, options)
        print_transfer(table, pair, console)
        path = results / results_name(pair[1], options) / "transfer.md"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(transfer_to_markdown(table, pair))
        say(f"table: {path}")
        if not any(candidate.name == "agent" for candidate in found):
            say(f"no trained agents in {results}/: scripts/train.py makes them")


if __name__ == "__main__":
    typer.run(main)
