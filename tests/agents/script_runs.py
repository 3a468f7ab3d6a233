"""Scripts as the command line runs them, without a process of their own."""

import importlib.util
from pathlib import Path

import typer
from typer.testing import CliRunner

ROOT = Path(__file__).parents[2]


def run(script, *arguments):
    """The exit code and all that was printed; a traceback counts as such."""
    spec = importlib.util.spec_from_file_location(script, ROOT / "scripts" / f"{script}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    app = typer.Typer()
    app.command()(module.main)
    result = CliRunner().invoke(app, list(arguments), env={"COLUMNS": "200", "TERMINAL_WIDTH": "200"})
    text = result.output
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        text += f"Traceback of {result.exception!r}"
    return result.exit_code, text
