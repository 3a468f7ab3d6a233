"""What all commands share: progress bars, output for machines, errors in one message, exit codes."""

import errno
import json as json_format
import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from tensegrity_agents.config import ConfigError
from tensegrity_agents.extras import MissingExtraError
from tensegrity_agents.interrupt import as_usual
from tensegrity_agents.sb3.errors import ExportError, TrainingError, TrainingInterruptedError
from tensegrity_envs.rendering import DisplayError

console = Console()
if not console.is_terminal:  # a file or a pipe has room for the whole table
    console = Console(width=110)
errors = Console(stderr=True)

# Exit codes. Beside these, a run that a signal ends has 128 + its number: 130 after Ctrl-C.
FAILURE, SLIP = 1, 2
# What no other command line mends: a full or broken disk, too little memory, too many files open.
_FAILURES = {errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.ENOMEM, errno.EMFILE, errno.ENFILE}

GO_ON = "run the same command again to go on from the last checkpoint"
AGAIN = "run the same command again to begin anew"


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
        tasks: dict[str, TaskID] = {}

        def show(what: str, done: int, total: int, remark: str = "") -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=total, remark=remark)
            bars.update(tasks[what], completed=done, total=total, remark=remark)

        yield show


def need_window(check: Callable[[], None], instead: str) -> None:
    """See that a window can be opened.

    Args:
        check: raises a `DisplayError` where there is no display.
        instead: what does without one, in a sentence.

    Raises:
        DisplayError: there is no display; the message says what to do.
    """
    try:
        check()
    except DisplayError as error:
        what = str(error).partition(":")[0]
        raise DisplayError(
            f"{what}. Over ssh, connect with ssh -X: the window then opens at your end. Without a display: {instead}. "
            "(xvfb-run makes a display that nobody sees, which is for tests.)"
        ) from error


def say(text: str) -> None:
    """Print a line as it is: paths and messages may hold what looks like markup."""
    console.print(text, markup=False, highlight=False, soft_wrap=True)


@contextmanager
def for_machines(json: bool) -> Iterator[None]:
    """With `json`, whatever is said meanwhile goes to standard error: standard output is what `tell_json` writes."""
    before, console.stderr = console.stderr, console.stderr or json
    try:
        yield
    finally:
        console.stderr = before


def tell_json(value: object) -> None:
    """Print a value as JSON, which knows neither NaN nor infinity: they become null."""
    typer.echo(json_format.dumps(_finite(value), indent=2))


def _finite(value: object) -> Any:
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@contextmanager
def clear_errors(after_interrupt: str = AGAIN) -> Iterator[None]:
    """Turn errors into one message and an exit code: 2 where another command line mends it, 1 where it does not.

    An interrupt says how to go on. Faults of the program stay what they are; Python makes them exit code 1, too.

    Args:
        after_interrupt: what to do then.
    """
    as_usual()
    try:
        yield
    except ImportError as error:
        if not isinstance(error, MissingExtraError) and error.name != "mujoco":
            raise
        _fail(str(error))
        raise typer.Exit(SLIP) from error
    except (TrainingError, ValueError, DisplayError) as error:  # config and policy errors are ValueErrors
        _fail(str(error))
        raise typer.Exit(SLIP) from error
    except OSError as error:
        named = f"{error.filename}: " if error.filename is not None else ""
        _fail(f"{named}{error.strerror or error}")
        raise typer.Exit(FAILURE if error.errno in _FAILURES else SLIP) from error
    except ExportError as error:
        _fail(str(error))
        raise typer.Exit(FAILURE) from error
    except TrainingInterruptedError as error:
        say(f"{error}: run the same command again to go on from there")
        raise typer.Exit(128 + error.number) from error
    except KeyboardInterrupt as error:
        say(f"interrupted: {after_interrupt}")
        raise typer.Exit(130) from error


def _fail(message: str) -> None:
    errors.print("error:", style="bold red", end=" ")
    errors.print(message, markup=False, highlight=False, soft_wrap=True)


def checked_folder(path: Path, option: str) -> Path:
    """A folder that results can be written into, as far as can be found out without making it.

    Raises:
        ConfigError: it is a file, or it and what is above it cannot be written.
    """
    _check_writable(path, f"{option} {path}")
    return path


def _check_writable(folder: Path, given: str) -> None:
    there = folder
    while not there.exists() and there != there.parent:
        there = there.parent
    if not there.is_dir():
        raise ConfigError(f"{given}: {there} is a file, not a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise ConfigError(f"{given}: {there}{os.sep} cannot be written")


def checked_file(path: Path, option: str) -> Path:
    """A file that can be written, as far as can be found out without making it.

    Raises:
        ConfigError: it is a folder, or cannot be written.
    """
    if path.is_dir():
        raise ConfigError(f"{option} {path}: is a folder; the name of a file is needed")
    if path.exists() and not os.access(path, os.W_OK):
        raise ConfigError(f"{option} {path}: cannot be written")
    _check_writable(path.parent, f"{option} {path}")
    return path
