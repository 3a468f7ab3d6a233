"""The tables of docs/environments.md, from the environments themselves.

python docs/tables.py            says whether the page is current
python docs/tables.py --write    writes its tables anew
"""

import sys
import textwrap
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium as gym

import tensegrity_envs
from tensegrity_envs.info import Meaning, meanings_of
from tensegrity_envs.options import described
from tensegrity_envs.randomization import Randomization
from tensegrity_envs.registration import ENTRIES, Entry

WIDTH = 120
PAGE = Path(__file__).parent / "environments.md"
RANDOMIZED = tuple(described(Randomization))
BEGIN, END = "<!-- {}: written by docs/tables.py -->\n", "<!-- end of {} -->\n"


def table(head: tuple[str, ...], rows: list[tuple[Any, ...]], centred: bool = False) -> str:
    """A table in Markdown."""
    marks = ["---", *[":-:" if centred else "---"] * (len(head) - 1)]
    escaped = [[str(cell).replace("|", "\\|") for cell in row] for row in (head, *rows)]
    lines = [escaped[0], marks, *escaped[1:]]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def span(first: int, count: int) -> str:
    """Places of numbers: "3", or "3-5"."""
    return str(first) if count == 1 else f"{first}-{first + count - 1}"


def randomization() -> str:
    """What can be randomized, for every id."""
    rows = []
    for entry in ENTRIES:
        known = core_of(entry).randomizable
        name = f"`{entry.id.removeprefix('tensegrity/')}`"
        rows.append((name, *("x" if quantity in known else "" for quantity in RANDOMIZED)))
    return table(("id", *RANDOMIZED), rows, centred=True)


def rewards() -> str:
    """The terms of the dense rewards, by the classes of their weights."""
    parts = []
    for kind in {type(core_of(entry).task.weights): None for entry in ENTRIES}:
        parts.append(f"`{kind.__name__}`:\n\n")
        for name, text in described(kind).items():
            parts.append(textwrap.fill(f"- `{name}`: {text}", WIDTH, subsequent_indent="  ") + "\n")
        parts.append("\n")
    return "".join(parts).rstrip() + "\n"


def info() -> str:
    """The entries of `info` that all ids have."""
    return info_table(meanings_of(core_of(ENTRIES[0])), sizes_of(core_of(ENTRIES[0])), shared_info())


def overview() -> str:
    """What there is, one line for each id."""
    rows = []
    for entry in ENTRIES:
        core = core_of(entry)
        what = f"{entry.summary[0].upper()}{entry.summary[1:]}"
        name = f"`{entry.id.removeprefix('tensegrity/')}`"
        rows.append((name, what, core.simulation.action_size, core.schema.size, entry.max_episode_steps))
    return table(("tensegrity/...", "what it is", "actions", "observed", "steps"), rows)


@cache
def shared_info() -> tuple[str, ...]:
    """The names of the entries of `info` that mean the same in every id, but for the reward's terms."""
    told = [meanings_of(core_of(entry)) for entry in ENTRIES]
    return tuple(
        name
        for name, meaning in told[0].items()
        if name != "configuration" and not name.startswith("reward_") and all(one.get(name) == meaning for one in told)
    )


def summary(entry: Entry) -> str:
    """What an id is, and its time limit."""
    return f"{entry.summary[0].upper()}{entry.summary[1:]}. {entry.max_episode_steps} steps."


def core_of(entry: Entry) -> Any:
    """The core of an id with its default options."""
    return _core(entry.id)


@cache
def _core(env_id: str) -> Any:
    env: Any = gym.make(env_id).unwrapped
    return env.core


def actions(core: Any) -> str:
    """What the numbers of an action do."""
    simulation = core.simulation
    moved = core.schema.fields[core.input_name].meaning if core.control != "joint" else "joint angles"
    row = (
        span(0, simulation.action_size),
        f"increments of the {moved}",
        f"{simulation.rate:.5g} {simulation.rate_unit}",
    )
    return table(("action", "meaning", "1 means, in a step"), [row])


def observations(core: Any) -> str:
    """What the numbers of the entry "observation" are."""
    rows = []
    for name, field in core.schema.fields.items():
        place = span(core.schema.places[name].start, field.width)
        rows.append((place, f"`{name}`", field.meaning, field.unit, str(field.scaling)))
    return table(("observation", "name", "x is the", "unit of x", "as a number"), rows)


def goals(core: Any) -> str:
    """What the entries "achieved_goal" and "desired_goal" are."""
    return f"Goals: {core.observation_space['desired_goal'].shape[0]} numbers, {core.goal_text}."


def sizes_of(core: Any) -> dict[str, int]:
    """How many numbers the entries of `info` have, by name."""
    return {entry.name: 1 if entry.end is None else entry.end - entry.first for entry in core.info_entries}


def info_table(told: dict[str, Meaning], sizes: dict[str, int], names: tuple[str, ...]) -> str:
    """What some entries of `info` mean."""
    rows = [(f"`{name}`", sizes.get(name, 1), *told[name]) for name in names]
    return table(("info", "numbers", "unit", "meaning"), rows)


TABLES = {"overview": overview, "randomization": randomization, "rewards": rewards, "info": info}


def current(text: str) -> str:
    """The page with current tables."""
    for name, make in TABLES.items():
        begin, end = BEGIN.format(name), END.format(name)
        before, rest = text.split(begin)
        _, after = rest.split(end)
        text = f"{before}{begin}\n{make()}\n{end}{after}"
    return text


def main(arguments: list[str]) -> int:
    """See the top of this file."""
    assert tensegrity_envs.ENV_IDS
    if arguments not in ([], ["--write"]):
        print(f"{' '.join(arguments)!r}: there is --write, or nothing", file=sys.stderr)
        return 2
    text = PAGE.read_text()
    new = current(text)
    if arguments:
        PAGE.write_text(new)
    elif new != text:
        print("docs/environments.md: its tables are not current; write them with: python docs/tables.py --write")
    return 0 if arguments or new == text else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
