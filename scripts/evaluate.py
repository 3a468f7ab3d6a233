"""Score one controller: a baseline, a trained policy, or a class of your own."""

import tensegrity_agents.interrupt  # noqa: F401  # isort: skip  (first: see there)

from pathlib import Path
from typing import Annotated, Any

import typer

from tensegrity_agents.config import ConfigError, known_env
from tensegrity_agents.console import (
    Design,
    LoadRange,
    PayloadRange,
    Randomization,
    Tolerance,
    checked_file,
    clear_errors,
    console,
    explain_options,
    list_of_baselines,
    parse_options,
    progress_bar,
    say,
)
from tensegrity_agents.controllers import baselines_of, make_controller
from tensegrity_agents.env_options import canonical, check_options
from tensegrity_agents.evaluation.compare import KINDS
from tensegrity_agents.evaluation.results import write_csv
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.reporting.table import print_table, summary_rows
from tensegrity_agents.sb3.policy_file import load_policy
from tensegrity_envs.seeding import TEST_SEED, VALIDATION_SEED


def main(
    env: Annotated[str, typer.Option(help="environment, such as TwoXReach-v0")] = "TwoXReach-v0",
    controller: Annotated[
        list[str] | None,
        typer.Option(
            help="baseline, or your own class as my_module:MyController; may be repeated. "
            f"Baselines are: {list_of_baselines()}",
            show_default="the environment's first baseline",
        ),
    ] = None,
    policy: Annotated[list[Path] | None, typer.Option(help="folder of a trained policy; may be repeated")] = None,
    episodes: Annotated[int, typer.Option(min=1, help="how many")] = 1000,
    split: Annotated[str, typer.Option(help="test, or validation for tuning")] = "test",
    csv: Annotated[Path | None, typer.Option(help="write one row per episode")] = None,
    design: Design = None,
    randomization: Randomization = None,
    tolerance: Tolerance = None,
    load_range: LoadRange = None,
    payload_range: PayloadRange = None,
) -> None:
    """Evaluate controllers on the same held-out episodes and print the table.

    A controller of your own is any class, called without arguments, that has predict(observation, state, episode_start,
    deterministic); observations come in batches of shape (n, ...), actions are of shape (n, size) in [-1, 1]. See
    CONTRIBUTING.md.

    Example:
    python scripts/evaluate.py --env TwoXPayloadReach-v0 --controller observer --controller my_module:MyController
    """
    with clear_errors():
        env_id = known_env(env)
        if split not in ("test", "validation"):
            raise ConfigError(f"--split {split}: must be test or validation")
        if csv is not None:
            checked_file(csv, "--csv")
        options = parse_options(design, randomization, tolerance, load_range, payload_range)
        check_options(env_id, options)
        explain_options(env_id, options)
        own = canonical(env_id, options)
        names = list(dict.fromkeys(controller or ([] if policy else list(baselines_of(env_id))[:1])))
        candidates: list[tuple[str, Any, str]] = [
            (name, make_controller(name, env_id, options), KINDS.get(name, "baseline")) for name in names
        ]
        for path in policy or []:
            agent = load_policy(path, env_id, own)
            before = agent.description.get("options") or {}
            if before != own:
                say(f"{path}: trained with other options ({before or 'the default ones'}) than it is evaluated with")
            candidates.append((str(path), agent, "agent"))
        runs = []
        with progress_bar() as progress:
            for name, candidate, kind in candidates:

                def report(done: int, total: int, name: str = name) -> None:
                    progress(f"evaluating {name}", done, total, "")

                first = TEST_SEED if split == "test" else VALIDATION_SEED
                runs.append(evaluate(candidate, env_id, episodes, first, name, kind, options, report))
                if csv is not None:
                    csv.parent.mkdir(parents=True, exist_ok=True)
                    write_csv(runs, csv)
        print_table(summary_rows(runs), console)


if __name__ == "__main__":
    typer.run(main)
