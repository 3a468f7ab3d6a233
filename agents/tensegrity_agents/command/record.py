"""Episodes as Minari datasets."""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_agents.command_options import EnvironmentChoice, EnvironmentOptions, with_option_groups
from tensegrity_agents.console import checked_folder, clear_errors, progress_bar, say
from tensegrity_agents.recording import record


@with_option_groups
def main(
    chosen: EnvironmentChoice,
    options: EnvironmentOptions,
    controllers: Annotated[
        str,
        typer.Option(
            help="with commas between them: baselines, agent (the shipped policy, or that of --policy), or your own "
            "classes as my_module:MyController. tensegrity list ID tells the baselines of an id"
        ),
    ] = "oracle,random",
    episodes: Annotated[int, typer.Option(min=1, help="how many, the same for each controller")] = 100,
    policy: Annotated[Path | None, typer.Option(help="folder of a trained policy, for agent")] = None,
    out: Annotated[Path | None, typer.Option(help="folder of the datasets", show_default="Minari's own")] = None,
    seed: Annotated[int, typer.Option(min=0, help="of the first episode; test episodes cannot be recorded")] = 0,
    fresh: Annotated[bool, typer.Option("--fresh", help="write datasets anew that are there")] = False,
) -> None:
    """Write episodes of controllers as Minari datasets, one for each controller: observations, actions, rewards, infos.

    ENVIRONMENT is TwoXReach-v0 if it is left out. Read them with minari.load_dataset.

    Example: tensegrity record TwoXPayloadReach-v0 --controllers oracle,servo,random --episodes 100 --out data
    """
    with clear_errors():
        env_id = chosen.named("TwoXReach-v0")
        if out is not None:
            checked_folder(out, "--out")
        given = options.checked(env_id)
        names = [name.strip() for name in controllers.split(",")]
        with progress_bar() as progress:
            written = record(env_id, names, episodes, given, out, policy, seed, fresh, progress, say)
        for name in written:
            say(f'minari.load_dataset("{name}")')
        if out is not None:
            say(f"with MINARI_DATASETS_PATH={out}")
