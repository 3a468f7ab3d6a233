"""Score one controller: a baseline, a trained policy, or a class of your own."""

from pathlib import Path
from typing import Annotated

import typer

import tensegrity_envs
from tensegrity_agents.config import ConfigError
from tensegrity_agents.console import clear_errors, console, progress_bar
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.evaluation.compare import KINDS
from tensegrity_agents.evaluation.results import write_csv
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.reporting.table import print_table, summary_rows
from tensegrity_agents.sb3.policy_file import load_policy
from tensegrity_envs.seeding import TEST_SEED, VALIDATION_SEED


def main(
    env: Annotated[str, typer.Option(help="environment, such as TwoXReach-v0")] = "TwoXReach-v0",
    controller: Annotated[
        list[str] | None, typer.Option(help="baseline, or your own class as my_module:MyController; may be repeated")
    ] = None,
    policy: Annotated[list[Path] | None, typer.Option(help="folder of a trained policy; may be repeated")] = None,
    episodes: Annotated[int, typer.Option(min=1)] = 1000,
    split: Annotated[str, typer.Option(help="test, or validation for tuning")] = "test",
    csv: Annotated[Path | None, typer.Option(help="write one row per episode")] = None,
) -> None:
    """Evaluate controllers on the same held-out episodes and print the table.

    A controller of your own is any class, called without arguments, that has predict(observation, state, episode_start,
    deterministic); observations come in batches of shape (n, ...), actions are of shape (n, size) in [-1, 1]. See
    CONTRIBUTING.md.

    Example:
    python scripts/evaluate.py --env TwoXPayloadReach-v0 --controller observer --controller my_module:MyController
    """
    with clear_errors():
        env_id = env if env.startswith("tensegrity/") else f"tensegrity/{env}"
        if env_id not in tensegrity_envs.ENV_IDS:
            raise ConfigError(f"no environment {env!r}; there are {', '.join(tensegrity_envs.ENV_IDS)}")
        if split not in ("test", "validation"):
            raise ConfigError(f"--split {split}: must be test or validation")
        if not controller and not policy:
            controller = ["closed_form_ik"]
        candidates = [(name, make_controller(name, env_id), KINDS.get(name, "baseline")) for name in controller or []]
        candidates += [(str(path), load_policy(path, env_id), "agent") for path in policy or []]
        runs = []
        with progress_bar() as progress:
            for name, candidate, kind in candidates:

                def report(done: int, total: int, name: str = name) -> None:
                    progress(f"evaluating {name}", done, total, "")

                run = evaluate(
                    candidate,
                    env_id,
                    episodes,
                    TEST_SEED if split == "test" else VALIDATION_SEED,
                    name,
                    kind,
                    progress=report,
                )
                runs.append(run)
                if csv is not None:
                    write_csv(runs, csv)
        print_table(summary_rows(runs), console)


if __name__ == "__main__":
    typer.run(main)
