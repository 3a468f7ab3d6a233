"""What the scripts share: progress bars, errors in one line, and the way from an environment to its config."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import typer
import yaml
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from tensegrity_agents.config import ConfigError, Experiment, load_experiment
from tensegrity_agents.sb3.policy_file import PolicyFileError
from tensegrity_agents.sb3.training import TrainingError

console = Console()
if not console.is_terminal:  # a file or a pipe has room for the whole table
    console = Console(width=110)


@contextmanager
def progress_bar() -> Iterator[Callable[[str, int, int, str], None]]:
    """A function (what, done, total, remark) that keeps one bar for each `what`."""
    columns = (
        TextColumn("{task.description:32s}"),
        BarColumn(bar_width=None),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[remark]}"),
    )
    with Progress(*columns, console=console) as bars:
        tasks: dict[str, int] = {}

        def show(what: str, done: int, total: int, remark: str = "") -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=total, remark=remark)
            bars.update(tasks[what], completed=done, total=total, remark=remark)  # type: ignore[arg-type]

        yield show


@contextmanager
def clear_errors() -> Iterator[None]:
    """Turn errors that the user can mend into one message and exit code 2; an interrupt says how to go on."""
    try:
        yield
    except (ConfigError, PolicyFileError, TrainingError, ValueError) as error:
        console.print(f"[bold red]error:[/] {error}", markup=True, highlight=False, soft_wrap=True)
        raise typer.Exit(2) from error
    except KeyboardInterrupt as error:
        console.print("interrupted: run the same command again to go on from the last checkpoint")
        raise typer.Exit(130) from error


def find_experiment(config: Path | None, env: str | None, folder: Path = Path("configs")) -> Experiment:
    """The experiment of a config file, or of the config in `folder` whose environment is `env`.

    Raises:
        ConfigError: there is none.
    """
    if config is not None:
        return load_experiment(config)
    wanted = env if env is None or env.startswith("tensegrity/") else f"tensegrity/{env}"
    found: dict[str, Path] = {}
    for path in sorted(folder.glob("*.yaml")):  # of several, the one whose name comes first
        content = yaml.safe_load(path.read_text())
        found.setdefault(str(content.get("env")), path)
    if wanted not in found:
        raise ConfigError(f"no config for {env!r} in {folder}/; there are configs for {', '.join(found) or 'nothing'}")
    return load_experiment(found[wanted])
