"""Train agents: one for every seed of a config.

A run that was stopped at any moment goes on when the same command is given again.
"""

from tensegrity_agents.command_options import EnvironmentOptions, ExperimentOptions, with_option_groups
from tensegrity_agents.console import GO_ON, clear_errors, progress_bar, say


@with_option_groups
def main(chosen: ExperimentOptions, options: EnvironmentOptions) -> None:
    """Train agents as a config says.

    Writes <out>/agent-<seed>/policy.safetensors and policy.json (load them with
    tensegrity_agents.load_policy), checkpoint.pt, progress.csv (training episodes), evaluation.csv
    (the agent without noise on validation episodes) and TensorBoard logs. Interrupt it whenever you like: the same
    command goes on.

    Example: tensegrity train TwoXReach-v0, or tensegrity train --config configs/two_x_reach.yaml --seeds 0,1,2,3,4
    """
    from tensegrity_agents.experiment import train_agents  # Torch, which completions need not wait for

    with clear_errors(GO_ON):
        experiment, folder = chosen.chosen(options)
        with progress_bar() as progress:
            agents = train_agents(experiment, folder, progress, chosen.fresh, chosen.processes)
        for seed, agent in agents.items():
            say(
                f"seed {seed}: {agent.description['timesteps']:,} steps "
                f"in {agent.description['training_seconds']:.0f} s -> {folder}/agent-{seed}"
            )
