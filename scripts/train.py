"""Train agents: one for every seed of a config.

A run that was stopped at any moment goes on when the same command is given again.
"""

import tensegrity_agents.interrupt  # noqa: F401  # isort: skip  (first: see there)

from pathlib import Path

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
    explain_options,
    find_experiment,
    parse_options,
    parse_seeds,
    progress_bar,
    say,
)
from tensegrity_agents.evaluation.compare import train_agents


def main(
    config: Config = None,
    env: EnvOfConfig = None,
    out: Out = None,
    seeds: Seeds = None,
    design: Design = None,
    randomization: Randomization = None,
    tolerance: Tolerance = None,
    load_range: LoadRange = None,
    payload_range: PayloadRange = None,
    fresh: Fresh = False,
) -> None:
    """Train agents as a config says.

    Writes <out>/agent-<seed>/policy.safetensors and policy.json (load them with
    tensegrity_agents.sb3.policy_file.load_policy), checkpoint.pt, progress.csv (training episodes), evaluation.csv
    (the agent without noise on validation episodes) and TensorBoard logs. Interrupt it whenever you like: the same
    command goes on.

    Example: python scripts/train.py --config configs/two_x_reach.yaml --seeds 0,1,2,3,4
    """
    with clear_errors(GO_ON):
        changes = parse_options(design, randomization, tolerance, load_range, payload_range)
        if seeds is not None:
            changes["seeds"] = parse_seeds(seeds)
        experiment = find_experiment(config, env).changed(**changes)
        folder = checked_folder(out or Path("results") / experiment.results_name, "--out")
        explain_options(experiment.env, experiment.options)
        with progress_bar() as progress:
            agents = train_agents(experiment, folder, progress, fresh)
        for seed, agent in agents.items():
            say(
                f"seed {seed}: {agent.description['timesteps']:,} steps "
                f"in {agent.description['training_seconds']:.0f} s -> {folder}/agent-{seed}"
            )


if __name__ == "__main__":
    typer.run(main)
