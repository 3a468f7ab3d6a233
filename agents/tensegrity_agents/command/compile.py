"""Compile environments ahead of use."""

from typing import Annotated

import typer

from tensegrity_agents.command_options import completed_ids
from tensegrity_agents.config import known_env
from tensegrity_agents.console import clear_errors, say
from tensegrity_envs import compile_all


def main(
    env: Annotated[
        list[str] | None,
        typer.Argument(
            help="ids, such as TwoXReach-v0", autocompletion=completed_ids, show_default="all that can be made"
        ),
    ] = None,
) -> None:
    """Compile what environments need, and keep it in the cache (see TENSEGRITY_CACHE_DIR).

    Example: tensegrity compile TwoXReach-v0
    """
    with clear_errors("run the same command again; what was compiled is kept"):
        compile_all([known_env(name) for name in env] if env else None, progress=say)
