"""Quasi-static controllers in dynamics, and the reverse: who keeps his success where he was not made for?"""

from pathlib import Path
from typing import Annotated

import typer

import tensegrity_envs  # noqa: F401  (registers the ids)
from tensegrity_agents.console import clear_errors, console, progress_bar
from tensegrity_agents.evaluation.transfer import candidates, pair_of, transfer
from tensegrity_agents.reporting.transfer_table import print_transfer, transfer_to_markdown


def main(
    env: Annotated[str, typer.Option(help="either of the two environments")] = "DualTriangleLoadedReachMuJoCo-v0",
    results: Annotated[Path, typer.Option(help="folder of the trained agents")] = Path("results"),
    episodes: Annotated[int, typer.Option(min=1)] = 1000,
) -> None:
    """Evaluate the agents and the baselines of a quasi-static environment and of its dynamic twin on both.

    Writes <results>/<dynamic environment>/transfer.md.

    Example: python scripts/transfer.py --env TwoXTensionReachMuJoCo-v0
    """
    with clear_errors():
        pair = pair_of(env if env.startswith("tensegrity/") else f"tensegrity/{env}")
        found = candidates(pair, results)
        with progress_bar() as progress:
            table = transfer(pair, found, episodes, progress)
        print_transfer(table, pair, console)
        path = results / pair[1].split("/")[1] / "transfer.md"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(transfer_to_markdown(table, pair))
        console.print(f"table: {path}")
        if not any(candidate.name == "agent" for candidate in found):
            console.print(f"no trained agents in {results}/: scripts/train.py makes them")


if __name__ == "__main__":
    typer.run(main)
