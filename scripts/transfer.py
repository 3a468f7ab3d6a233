"""`tensegrity transfer`, from a checkout."""

from tensegrity_agents.command import run

if __name__ == "__main__":
    run("transfer")
