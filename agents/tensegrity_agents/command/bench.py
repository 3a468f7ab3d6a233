"""Speeds, each as a ratio to Gymnasium's Reacher-v5 measured in the same run."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from tensegrity_agents import benchmark
from tensegrity_agents.benchmark_against import against as compare
from tensegrity_agents.benchmark_memory import memory
from tensegrity_agents.command_options import find_experiment
from tensegrity_agents.config import ConfigError, known_env
from tensegrity_agents.console import clear_errors, console, say

_PARTS = ("all", "single", "vector", "dynamics", "ppo", "redundancy", "compiling", "memory")
_COUNTS = {"vector": (1024, 64), "single": (0,)}  # environments in a batch; 0 for a single one


def main(
    only: Annotated[
        str, typer.Option(help="single, vector, dynamics, ppo, redundancy, compiling, memory, or all")
    ] = "all",
    config: Annotated[Path | None, typer.Option(help="settings of PPO", show_default="those for TwoXReach-v0")] = None,
    against: Annotated[
        Path | None, typer.Option(help="checkout of another build: compare vectors and single environments with its")
    ] = None,
    ids: Annotated[
        str,
        typer.Option(
            help="such as TwoXReach-v0, with commas between them; with --against: of those, all being the quasi-static "
            "ones; with --only compiling: of those"
        ),
    ] = "all",
    rounds: Annotated[int, typer.Option(min=1, help="with --against: blocks of steps of each build")] = 9,
) -> None:
    """Measure steps per second of single and vector environments and of PPO.

    Takes about five minutes; leave the machine alone meanwhile. With --against, only the two builds are compared, in
    CPU seconds.

    Example: tensegrity bench --only vector
    """
    with clear_errors():
        if only not in _PARTS:
            raise ConfigError(f"--only {only}: must be one of {', '.join(_PARTS)}")

        def progress(what: str) -> None:
            console.print(what, style="dim", markup=False, highlight=False)

        chosen = benchmark.RESTING if ids == "all" else tuple(known_env(name.strip()) for name in ids.split(","))
        if own := [env_id for env_id in chosen if env_id not in (*benchmark.RESTING, *benchmark.MOVING)]:
            raise ConfigError(f"--ids {own[0]}: must be ids of this package, see `tensegrity list`")
        if against is not None:
            table = Table("measured", "this build [CPU us]", "the other one [CPU us]", "ratio")
            for pair in compare(against, chosen, _COUNTS.get(only, (1024, 64, 0)), rounds, progress):
                table.add_row(pair.what, f"{1e6 * pair.ours:.3f}", f"{1e6 * pair.theirs:.3f}", f"{pair.ratio:.2f}x")
            console.print(table)
            return
        settings = find_experiment(config, None) if only in ("all", "ppo") else None
        if only in ("all", "compiling"):
            table = Table(
                "import, make, reset, step", "empty cache [CPU s]", "filled cache [CPU s]", "machine code [kB]"
            )
            everything = (*benchmark.RESTING, *benchmark.MOVING)
            for start in benchmark.compiling(everything if ids == "all" else chosen, progress):
                table.add_row(start.what, f"{start.cold:.2f}", f"{start.warm:.2f}", f"{start.kilobytes:.0f}")
            console.print(table)
        if only == "compiling":
            return
        if only in ("all", "memory"):
            table = Table("peak memory [MB] of", "imports", "a fifth of it", "all of it")
            for used in memory(progress=progress):
                table.add_row(used.what, f"{used.imported:.0f}", f"{used.fifth:.0f}", f"{used.whole:.0f}")
            console.print(table)
        if only == "memory":
            return
        lines = []
        if only in ("all", "single"):
            lines += benchmark.single(progress=progress)
        if only in ("all", "vector"):
            lines += benchmark.vector(progress=progress)
        if only in ("all", "dynamics"):
            lines += benchmark.dynamics(progress=progress)
        if settings is not None:
            lines += benchmark.ppo(settings, progress=progress)
        if only in ("all", "redundancy"):
            lines += benchmark.redundancy(progress=progress)
        table = Table("measured", "steps/s", f"ratio to {benchmark.REFERENCE}", "goal")
        for line in lines:
            met = "" if line.goal is None else f"{line.goal:g}x {'met' if line.ratio >= line.goal else 'MISSED'}"
            table.add_row(line.what, f"{line.per_second:,.0f}", f"{line.ratio:.2f}x", met)
        console.print(table)
        if only in ("all", "vector"):
            for env_id in benchmark.RESTING:
                shares = ", ".join(f"{name} {share:.0%}" for name, share in benchmark.shares(env_id).items())
                say(f"where a vector step of {env_id} goes: {shares}")
