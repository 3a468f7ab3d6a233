"""Score one controller: a baseline, a trained policy, or a class of your own."""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_agents.command_options import EnvironmentChoice, EnvironmentOptions, Json, with_option_groups
from tensegrity_agents.config import ConfigError
from tensegrity_agents.console import (
    checked_file,
    clear_errors,
    console,
    for_machines,
    progress_bar,
    say,
    tell_json,
)
from tensegrity_agents.pretrained import AGENT, pretrained_ids
from tensegrity_agents.reporting.table import print_table, summary_rows

_SAME_ARM = {"level", "randomization", "tolerance"}  # options with which a shipped policy still fits


@with_option_groups
def main(
    chosen: EnvironmentChoice,
    options: EnvironmentOptions,
    controller: Annotated[
        list[str] | None,
        typer.Option(
            help="baseline, agent (the shipped policy), or your own class as my_module:MyController; may be repeated. "
            "tensegrity list ID tells the baselines of an id",
            show_default="the environment's first baseline",
        ),
    ] = None,
    policy: Annotated[list[Path] | None, typer.Option(help="folder of a trained policy; may be repeated")] = None,
    episodes: Annotated[int, typer.Option(min=1, help="how many")] = 1000,
    split: Annotated[str, typer.Option(help="test, or validation for tuning")] = "test",
    csv: Annotated[Path | None, typer.Option(help="write one row per episode")] = None,
    json: Json = False,
) -> None:
    """Evaluate controllers on the same held-out episodes and print the table.

    `--controller agent` is the policy that is shipped; `tensegrity list` tells which ids have one.

    A controller of your own is any class, called without arguments, that has predict(observation, state, episode_start,
    deterministic); observations come in batches of shape (n, ...), actions are of shape (n, size) in [-1, 1]. More by
    python -m pydoc tensegrity_agents.controllers.base.Controller.

    Example:
    tensegrity evaluate TwoXReach-v0 --controller agent --controller closed_form_ik --controller my_module:MyController
    """
    from tensegrity_agents.experiment import evaluate_named  # Torch, which completions need not wait for

    with for_machines(json), clear_errors():
        env_id = chosen.named("TwoXReach-v0")
        if csv is not None:
            checked_file(csv, "--csv")
        for folder in policy or []:
            if str(folder) == AGENT and not folder.exists():
                raise ConfigError(f"--policy {folder}: no such folder; --controller {AGENT} is the shipped policy")
        given = options.checked(env_id)
        with progress_bar() as progress:
            runs = evaluate_named(
                env_id, controller or [], policy or [], given, episodes, split, progress, csv, remark=say
            )
        rows = summary_rows(runs)
        if json:
            tell_json(rows)
        else:
            print_table(rows, console)
        if not controller and not policy and set(given) <= _SAME_ARM and env_id in pretrained_ids():
            say("a trained policy is shipped for it: --controller agent scores it")
