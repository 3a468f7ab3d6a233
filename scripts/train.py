"""Train agents: one for every seed of a config.

A killed run goes on from its last checkpoint when it is started again.
"""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_agents.console import clear_errors, console, find_experiment, progress_bar
from tensegrity_agents.evaluation.compare import train_agents

Config = Annotated[Path | None, typer.Option(help="YAML file, such as configs/two_x_reach.yaml")]
Env = Annotated[
    str | None, typer.Option(help="instead of a config: the one in configs/ for this id, such as TwoXTensionReach-v0")
]
Out = Annotated[Path | None, typer.Option(help="results folder [default: results/<environment>]")]
Seeds = Annotated[str | None, typer.Option(help="training seeds instead of the config's, such as 0,1,2")]
Fresh = Annotated[bool, typer.Option(help="train anew even where an agent or a checkpoint is there")]


def main(config: Config = None, env: Env = None, out: Out = None, seeds: Seeds = None, fresh: Fresh = False) -> None:
    """Train agents as a config says.

    Writes <out>/agent-<seed>/policy.safetensors and policy.json (load them with
    tensegrity_agents.sb3.policy_file.load_policy), checkpoint.pt, progress.csv and TensorBoard logs. Interrupt it
    whenever you like: the same command goes on.

    Example: python scripts/train.py --config configs/two_x_reach.yaml --seeds 0,1,2,3,4
    """
    with clear_errors():
        experiment = find_experiment(config, env or (None if config else "TwoXReach-v0"))
        if seeds:
            experiment = type(experiment)(
                **experiment.model_dump() | {"seeds": [int(part) for part in seeds.split(",")]}
            )
        folder = out or Path("results") / experiment.env.split("/")[1]
        with progress_bar() as progress:
            agents = train_agents(experiment, folder, progress, fresh)
        for seed, agent in agents.items():
            console.print(
                f"seed {seed}: {agent.description['timesteps']:,} steps "
                f"in {agent.description['training_seconds']:.0f} s -> {folder}/agent-{seed}"
            )


if __name__ == "__main__":
    typer.run(main)
