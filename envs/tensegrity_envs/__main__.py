"""`python -m tensegrity_envs` is the `tensegrity` command."""

from tensegrity_envs.program import run

if __name__ == "__main__":
    run()
