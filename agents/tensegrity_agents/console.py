"""What the scripts share: options, progress bars, errors in one message, and the way from options to an experiment."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from tensegrity_agents import env_options
from tensegrity_agents.config import ConfigError, Experiment, known_env, load_experiment
from tensegrity_agents.controllers import BASELINES, DYNAMIC
from tensegrity_agents.interrupt import as_usual
from tensegrity_agents.sb3.training import TrainingError, TrainingInterruptedError
from tensegrity_agents.yaml_file import read_yaml

console = Console()
if not console.is_terminal:  # a file or a pipe has room for the whole table
    console = Console(width=110)

GO_ON = "run the same command again to go on from the last checkpoint"
AGAIN = "run the same command again to begin anew"

# The options that several scripts have. Typer's help takes square brackets for markup, so defaults that are computed
# are told by `show_default`.
Config = Annotated[Path | None, typer.Option(help="YAML file, such as configs/two_x_reach.yaml")]
EnvOfConfig = Annotated[
    str | None,
    typer.Option(
        help="take the config in configs/ for this id, such as TwoXTensionReach-v0", show_default="TwoXReach-v0"
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        help="results folder; with options that change the environment, a hash of these follows its name",
        show_default="results/<environment>",
    ),
]
Seeds = Annotated[
    str | None, typer.Option(help="training seeds, such as 0,1,2,3,4", show_default="those of the config")
]
Fresh = Annotated[bool, typer.Option("--fresh", help="train anew even where an agent or a checkpoint is there")]
Design = Annotated[
    str | None,
    typer.Option(
        help="an arm of your own: a published design such as muralidharan2022, fields such as b=0.06 or "
        "'{\"b\": 0.06}' (the others are those of the environment's design), both as muralidharan2022,b=0.06, or a "
        "YAML file with fields; 'base' names another design that the rest comes from",
        show_default="the environment's",
    ),
]
Randomization = Annotated[
    str | None,
    typer.Option(
        help="what differs from episode to episode, as JSON such as '{\"stiffness\": [0.9, 1.1]}' or a YAML file",
        show_default="the environment's",
    ),
]
Tolerance = Annotated[
    float | None,
    typer.Option(
        help="distance from the target that counts as reached, in m (posture change: rad)",
        show_default="the environment's",
    ),
]
LoadRange = Annotated[
    str | None,
    typer.Option(
        help="range of the unknown load, such as 0,1, in the environment's unit", show_default="the environment's"
    ),
]
PayloadRange = Annotated[
    str | None, typer.Option(help="range of the unknown payload in kg, such as 0,0.4", show_default="the environment's")
]


def list_of_baselines() -> str:
    """The names of the baselines of all environments, for help texts."""
    told = {arm: list(dict.fromkeys([*BASELINES.get(arm, {}), *DYNAMIC.get(arm, {})])) for arm in BASELINES}
    return "; ".join(f"{arm}: {', '.join(names)}" for arm, names in told.items()) + "; all: random"


@contextmanager
def progress_bar() -> Iterator[Callable[[str, int, int, str], None]]:
    """A function (what, done, total, remark) that keeps one bar for each `what`."""
    columns = (
        TextColumn("{task.description:32s}", markup=False),
        BarColumn(bar_width=None),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[remark]}", markup=False),
    )
    with Progress(*columns, console=console) as bars:
        tasks: dict[str, int] = {}

        def show(what: str, done: int, total: int, remark: str = "") -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=total, remark=remark)
            bars.update(tasks[what], completed=done, total=total, remark=remark)  # type: ignore[arg-type]

        yield show


def say(text: str) -> None:
    """Print a line as it is: paths and messages may hold what looks like markup."""
    console.print(text, markup=False, highlight=False, soft_wrap=True)


@contextmanager
def clear_errors(after_interrupt: str = AGAIN) -> Iterator[None]:
    """Turn errors that the user can mend into one message and exit code 2; an interrupt says how to go on.

    Args:
        after_interrupt: what to do then.
    """
    as_usual()
    try:
        yield
    except (TrainingError, ValueError) as error:  # config and policy errors are ValueErrors
        _fail(str(error))
        raise typer.Exit(2) from error
    except OSError as error:
        named = f"{error.filename}: " if error.filename is not None else ""
        _fail(f"{named}{error.strerror or error}")
        raise typer.Exit(2) from error
    except TrainingInterruptedError as error:
        say(f"{error}: run the same command again to go on from there")
        raise typer.Exit(128 + error.number) from error
    except KeyboardInterrupt as error:
        say(f"interrupted: {after_interrupt}")
        raise typer.Exit(130) from error


def _fail(message: str) -> None:
    console.print("error:", style="bold red", end=" ")
    say(message)


def checked_folder(path: Path, option: str) -> Path:
    """A folder that results can be written into, as far as can be told without making it.

    Raises:
        ConfigError: it is a file, or it and what is above it cannot be written.
    """
    there = path
    while not there.exists() and there != there.parent:
        there = there.parent
    if not there.is_dir():
        raise ConfigError(f"{option} {path}: {there} is a file, not a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise ConfigError(f"{option} {path}: {there}{os.sep} cannot be written")
    return path


def checked_file(path: Path, option: str) -> Path:
    """A file that can be written, as far as can be told without making it.

    Raises:
        ConfigError: it is a folder, or cannot be written.
    """
    if path.is_dir():
        raise ConfigError(f"{option} {path}: is a folder; the name of a file is needed")
    if path.exists() and not os.access(path, os.W_OK):
        raise ConfigError(f"{option} {path}: cannot be written")
    checked_folder(path.parent, option)
    return path


def parse_seeds(text: str) -> list[int]:
    """Training seeds from "0,1,2".

    Raises:
        ConfigError: they are not different whole numbers.
    """
    try:
        seeds = [int(part) for part in text.split(",")]
    except ValueError:
        raise ConfigError(f"--seeds {text}: must be whole numbers with commas between them, such as 0,1,2") from None
    if len(set(seeds)) != len(seeds):
        raise ConfigError(f"--seeds {text}: must be different numbers")
    return seeds


def parse_options(
    design: str | None = None,
    randomization: str | None = None,
    tolerance: float | None = None,
    load_range: str | None = None,
    payload_range: str | None = None,
) -> dict[str, Any]:
    """The environment's options that were given at the command line.

    Raises:
        ConfigError: one cannot be read.
    """
    options: dict[str, Any] = {}
    if design is not None:
        options["design"] = env_options.parse_design(design)
    if randomization is not None:
        options["randomization"] = env_options.parse_randomization(randomization)
    if tolerance is not None:
        options["tolerance"] = tolerance
    if load_range is not None:
        options["load_range"] = env_options.parse_range(load_range, "--load-range")
    if payload_range is not None:
        options["payload_range"] = env_options.parse_range(payload_range, "--payload-range")
    return options


def explain_options(env_id: str, options: dict[str, Any]) -> None:
    """Say which options count, and from which design the fields come that are not given."""
    for line in env_options.explain(env_id, options):
        say(line)


def find_experiment(config: Path | None, env: str | None, folder: Path = Path("configs")) -> Experiment:
    """The experiment of a config file, or of the config in `folder` whose environment is `env`.

    Args:
        config: file.
        env: id, with or without "tensegrity/"; TwoXReach-v0 if neither is given.
        folder: of configs.

    Raises:
        ConfigError: there is none, or the config is for another environment than `env`.
    """
    if config is not None:
        experiment = load_experiment(config)
        if env is not None and known_env(env) != experiment.env:
            raise ConfigError(f"--config {config} is for {experiment.env}, --env says {env}: give one of them")
        return experiment
    wanted = known_env(env or "TwoXReach-v0")
    found: dict[str, Path] = {}
    unreadable = []
    for path in sorted(folder.glob("*.yaml")):  # of several, the one whose name comes first
        try:
            given = str(read_yaml(path, "env: TwoXReach-v0").get("env"))
        except ConfigError as error:
            unreadable.append(str(error))
            continue
        found.setdefault(given if given.startswith("tensegrity/") else f"tensegrity/{given}", path)
    if wanted not in found:
        there = ", ".join(found) or "nothing"
        notes = "".join(f"\n  {note}" for note in unreadable)
        raise ConfigError(
            f"no config for {wanted} in {folder.absolute()}{os.sep}; there are configs for {there}; "
            f"--config takes a file from anywhere{notes}"
        )
    return load_experiment(found[wanted])
