"""A policy as an ONNX file."""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_agents.command_options import completed_ids
from tensegrity_agents.config import known_env
from tensegrity_agents.console import checked_file, clear_errors, say


def main(
    environment: Annotated[
        str,
        typer.Argument(
            help="id, such as TwoXReach-v0, or the folder of a trained policy", autocompletion=completed_ids
        ),
    ],
    out: Annotated[Path, typer.Argument(help="file, such as policy.onnx")],
    policy: Annotated[
        Path | None, typer.Option(help="folder of a trained policy", show_default="the shipped one")
    ] = None,
) -> None:
    """Write a policy as ONNX, for machines without Torch, and check it against the policy on 1,000 observations.

    The file takes the raw observation of the environment; what a policy remembers are further inputs and outputs.

    Example: tensegrity export TwoXReach-v0 policy.onnx
    """
    with clear_errors():
        is_policy = policy is None and (Path(environment) / "policy.json").is_file()
        source = environment if is_policy else known_env(environment)
        checked_file(out, "OUT")
        from tensegrity_agents.exporting import export

        if policy is None:
            largest = export(source, out)
        else:
            from tensegrity_agents.sb3.policy_file import load_policy

            largest = export(load_policy(policy, source), out)
        say(f"{out}: {out.stat().st_size / 1000:.0f} kB, its actions are within {largest:.1g} of the policy's")
