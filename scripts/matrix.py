"""`tensegrity matrix`, from a checkout."""

import tensegrity_agents.interrupt  # noqa: F401  # isort: skip  (first: see there)

import typer

from tensegrity_agents.command.matrix import main

if __name__ == "__main__":
    typer.run(main)
