"""The `tensegrity` command: one module for each subcommand, imported when it is called."""

import tensegrity_agents.interrupt  # noqa: F401  # isort: skip  (first: see there)

from tensegrity_agents.command.program import SUBCOMMANDS, run

__all__ = ["SUBCOMMANDS", "run"]
