"""The program `tensegrity`, which imports of its subcommands only the one that is called: some load Torch."""

from difflib import get_close_matches
from importlib import import_module
from inspect import cleandoc
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

SUBCOMMANDS = {
    "list": "The environments: id, what they are, spaces, baselines.",
    "train": "Train agents as a config says.",
    "compare": "Train agents, compare them with the analytic controllers, write the report.",
    "campaign": "Measure the agents and controllers of all environments, once.",
    "matrix": "Write who wins where, of all rows of campaigns.",
    "evaluate": "Score controllers and policies on the same held-out episodes.",
    "transfer": "Score agents and baselines at rest and in motion, made for either.",
    "tune": "Tune an analytic controller on validation episodes.",
    "watch": "Watch a controller or a policy, in a window or on film.",
    "play": "Drive an arm by keyboard and mouse.",
    "export": "Write a policy as ONNX.",
    "search": "Search for the settings of a training.",
    "record": "Write episodes as Minari datasets.",
    "analyze": "Draw workspaces, singularities, buckling: figures, regions, numbers.",
    "playground": "Write pages to play with a mechanism in a browser.",
    "compile": "Compile environments ahead of use.",
    "bench": "Measure speeds, as ratios.",
}


def reflowed(text: str) -> str:
    """A docstring with each paragraph in one line, which help wraps to the width of the terminal."""
    return "\n\n".join(" ".join(part.split()) for part in cleandoc(text).split("\n\n"))


def load(name: str) -> Any:
    """The subcommand of a name, made of the `main` of its module."""
    app = typer.Typer(add_completion=False, rich_markup_mode="rich")
    main = import_module(f"tensegrity_agents.command.{name}").main
    app.command(name, help=reflowed(main.__doc__))(main)
    command = typer.main.get_command(app)
    command.name = name
    return command


class Program(TyperGroup):
    """The group of all subcommands. Listing them (`--help`) takes their one line from the table."""

    def list_commands(self, ctx: Any) -> list[str]:
        """The names, in the order of the table."""
        return list(SUBCOMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """What stands for a subcommand in listings; None where there is none of this name."""
        return TyperCommand(cmd_name, help=SUBCOMMANDS[cmd_name]) if cmd_name in SUBCOMMANDS else None

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The subcommand that is called, imported now; one that there is not is answered with the nearest."""
        if args and args[0] not in SUBCOMMANDS and (close := get_close_matches(args[0], SUBCOMMANDS, 1)):
            ctx.fail(f"No such command {args[0]!r}. Did you mean {close[0]!r}?")
        name, stub, rest = super().resolve_command(ctx, args)
        return name, stub if name is None or stub is None else load(name), rest


app = typer.Typer(cls=Program, no_args_is_help=True)


@app.callback()
def tensegrity() -> None:
    """Tensegrity manipulators: environments, analytic controllers, agents, and who wins.

    tensegrity COMMAND --help tells more about a command.
    """


def run(name: str | None = None) -> None:
    """The entry point of the program, and of the scripts, each of which is one of its subcommands."""
    if name is None:
        app(prog_name="tensegrity")
    else:
        load(name)()
