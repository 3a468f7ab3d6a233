"""Scripts as the command line runs them, without a process of their own."""

import re
from importlib import import_module
from pathlib import Path

import typer
from typer.testing import CliRunner

ROOT = Path(__file__).parents[2]


def run(script, *arguments):
    """The exit code and all that was printed; a traceback counts as such."""
    name = re.search(r'^    run\("(\w+)"\)$', (ROOT / "scripts" / f"{script}.py").read_text(), re.MULTILINE)[1]
    app = typer.Typer()
    app.command()(import_module(f"tensegrity_agents.command.{name}").main)
    result = CliRunner().invoke(app, list(arguments), env={"COLUMNS": "200", "TERMINAL_WIDTH": "200"})
    text = result.output
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        text += f"Traceback of {result.exception!r}"
    return result.exit_code, text
