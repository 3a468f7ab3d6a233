"""The entry point of the program `tensegrity`, which is part of the agents: a wheel without their extra has it, too."""

import sys
from importlib import import_module


def run() -> None:
    """Run the program, or say which extra it needs."""
    try:
        command = import_module("tensegrity_agents.command")
    except ImportError as error:
        if "tensegrity-envs[agents]" not in str(error):
            raise
        sys.exit(f"error: {error}")
    command.run()
