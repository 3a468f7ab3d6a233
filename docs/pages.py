"""A page for every environment, written when the site is built; nothing in it is written by hand.

python docs/pages.py TwoXReach-v0    prints the page of an id, without its film
"""

import inspect
import re
import sys
import textwrap
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import tables
from tables import core_of, table

from tensegrity_agents.command_options import shipped_configs
from tensegrity_agents.controllers import baselines_of
from tensegrity_agents.evaluation.records import Record, read_records
from tensegrity_agents.reporting.matrix import AGENT, best_controller, cells_of
from tensegrity_agents.reporting.table import percent
from tensegrity_agents.reporting.video import record
from tensegrity_agents.yaml_file import read_yaml
from tensegrity_envs.core import Core
from tensegrity_envs.info import meanings_of
from tensegrity_envs.options import described
from tensegrity_envs.randomization import Randomization
from tensegrity_envs.registration import ENTRIES, Entry
from tensegrity_envs.simulation.dynamic import DynamicControl

HERE = Path(__file__).parent
GALLERY = "films.txt"
FILM_SEED = 0  # of the episode that is filmed; test episodes have other seeds
_MOST_STEPS = 200  # of a film
_NONE = "\N{EN DASH}"


def short(entry: Entry) -> str:
    """The id without its namespace, and the name of its page."""
    return entry.id.rpartition("/")[2]


def page(entry: Entry, films: Path | None = None) -> str:
    """The page of an environment, in Markdown.

    Args:
        entry: its row in the table of ids.
        films: folder into which its film is written; None for a page without.
    """
    core = core_of(entry)
    name = short(entry)
    parts = [f"# {name}\n", _filled(_summary(entry, core))]
    if films is not None:
        parts.append(film(entry, films))
    parts += [
        f'```python\nimport gymnasium as gym\n\nenv = gym.make("tensegrity_envs:{entry.id}")\n```\n',
        "## Action\n",
        _filled(
            f"`Box(-1, 1, ({core.simulation.action_size},), float32)`. Numbers beyond are clipped; NaN and wrong "
            "shapes raise `ValueError`."
        ),
        tables.actions(core),
        "## Observation\n",
        _filled(
            f"`Dict(observation, achieved_goal, desired_goal)`. The entry `observation` has {core.schema.size} numbers "
            "within [-1, 1]:"
        ),
        tables.observations(core),
        _filled(tables.goals(core)),
        "## Reward\n",
        reward(core),
        "## What ends an episode\n",
        ending(entry, core),
        "## Info\n",
        info(core),
        "## Randomization\n",
        randomization(core),
        "## Options\n",
        "Keyword arguments of `gym.make` and `gym.make_vec`:\n",
        options(entry, core),
        "## Baselines and results\n",
        results(entry, core),
    ]
    return "\n".join(parts)


def _filled(text: str) -> str:
    return textwrap.fill(text, tables.WIDTH, break_long_words=False, break_on_hyphens=False) + "\n"


def _summary(entry: Entry, core: Any) -> str:
    folder = type(core.nominal).__module__.split(".")[2]
    known = HERE / f"{folder}.md"
    about = f"[{_title(known)}](../{known.name})" if known.is_file() else ""
    more = f" The mechanism, its equations and its sources: {about}." if about else ""
    dynamics = " What is simulated: [the dynamics](../mujoco.md)." if core.dynamics is not None else ""
    return f"{tables.summary(entry)}{more}{dynamics} What all ids share: [using the environments](../environments.md)."


def _title(page: Path) -> str:
    return page.read_text().partition("\n")[0].removeprefix("# ")


def film(entry: Entry, folder: Path) -> str:
    """Write the film of an episode, and say who acts in it."""
    name = _acting(entry)
    path = folder / f"{short(entry)}.gif"
    folder.mkdir(parents=True, exist_ok=True)
    record(
        entry.id,
        {name: baselines_of(entry.id)[name](core_of(entry))},
        FILM_SEED,
        path,
        max_steps=min(entry.max_episode_steps, _MOST_STEPS),
    )
    return f"![{name} in an episode of {short(entry)}]({path.name})\n\n`{name}` in the episode of seed {FILM_SEED}.\n"


def _acting(entry: Entry) -> str:
    """The best analytic controller as measured; before it was, the strongest by the order of the tables."""
    best = best_controller(cells_of(_records().get(entry.id, ())))
    if best is not None and best.name in baselines_of(entry.id):
        return best.name
    return [name for name in baselines_of(entry.id) if name != "random"][-1]


@cache
def _records() -> dict[str, list[Record]]:
    return read_records(HERE.parent / "records")


def reward(core: Any) -> str:
    """The terms of the dense reward with their weights, and what the sparse one is."""
    task = core.task
    kinds = reversed(type(task.weights).__mro__)  # a class of weights says what its own are, its bases the others
    texts = {name: text for kind in kinds for name, text in described(kind).items()}
    names = [name.removeprefix("reward_") for name in meanings_of(core) if name.startswith("reward_")]
    rows = [(f"`{name}`", f"{getattr(task.weights, name):g}", texts.get(name, _NONE)) for name in names]
    intro = (
        f"The sum of these terms, each from 0 to its weight (`reward_weights=`, of `{type(task.weights).__name__}`). "
        'With `reward_type="sparse"` it is 1 where the term `success` counts, else 0.'
    )
    return _filled(intro) + "\n" + table(("term", "weight", "from 0 to 1"), rows)


def ending(entry: Entry, core: Any) -> str:
    """What terminates and what truncates an episode, as the classes that judge it say."""
    truncated = f"After {entry.max_episode_steps} steps it is truncated. Success does not end it."
    if not core.can_fail:
        return _filled(f"Nothing terminates it. {truncated}")
    parts = [
        _filled(
            f'{truncated} A failure terminates it; `tensegrity_envs.termination_reason(info["failure"])` names the '
            "reason, which stands in quotation marks here. Nothing else is collected after it."
        )
    ]
    if isinstance(core.simulation, DynamicControl):
        told = [*_paragraphs(DynamicControl), _paragraphs(core.simulation.control.failed)[0]]
    else:
        told = _paragraphs(_defining(type(core.simulation), "advance"))
    told += [text for text in _paragraphs(type(core.task).check_termination) if '"' in text]  # where it names a reason
    if type(core).with_clearance is not Core.with_clearance:
        told += _paragraphs(type(core).with_clearance)
    parts += [_filled(" ".join(text.split())) for text in told]
    return "\n".join(parts)


def _defining(kind: type, method: str) -> type:
    """The class of which a class has a method."""
    return next(base for base in kind.__mro__ if method in vars(base))


def _paragraphs(given: Any) -> list[str]:
    """The paragraphs of a docstring, up to the arguments."""
    return re.split(r"\n\n(?:Args|Attributes|Raises):\n", inspect.getdoc(given) or "")[0].split("\n\n")


def info(core: Any) -> str:
    """All entries of `info`."""
    told = meanings_of(core)
    return tables.info_table(told, tables.sizes_of(core), tuple(told))


def randomization(core: Any) -> str:
    """What can differ from episode to episode here, and what does by default."""
    if not core.randomizable:
        return "Nothing can be randomized here.\n"
    texts = described(Randomization)
    usual = Randomization()
    rows = []
    for name in tables.RANDOMIZED:
        if name not in core.randomizable:
            continue
        value = getattr(core.randomization, name)
        given = "to".join(f" {v:g} " for v in value).strip() if isinstance(value, tuple) else f"{value or 0:g}"
        rows.append((f"`{name}`", texts[name], _NONE if value == getattr(usual, name) else given))
    intro = "`randomization=` takes these quantities, `level=` 0 to 3 names ranges for all of them"
    intro += " ([levels](../environments.md#levels-of-uncertainty)); controllers are not told what was drawn."
    return _filled(intro) + "\n" + table(("quantity", "what it is", "by default"), rows)


def options(entry: Entry, core: Any) -> str:
    """The keyword arguments of the environment, with the defaults that this id has."""
    texts = described(type(core), "Args")
    rows = []
    for name, parameter in inspect.signature(type(core)).parameters.items():
        value = entry.options.get(name, parameter.default)
        if parameter.kind not in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL):
            shown = _NONE if value is parameter.empty else f"`{value!r}`"
            rows.append((f"`{name}`", shown, texts.get(name, _NONE)))
    return table(("option", "default", "meaning"), rows)


def results(entry: Entry, core: Any) -> str:
    """Baselines, what they know, and what was measured of them and of agents."""
    cells = cells_of(_records().get(entry.id, ()))
    rows = []
    if AGENT in cells:
        agent = cells[AGENT]
        runs = f"{len(agent.flags)} training run{'s' if len(agent.flags) > 1 else ''}"
        rows.append((f"**agents**, {runs}", agent.knows, agent.text, agent.time_text))
    for name, make in baselines_of(entry.id).items():
        cell = cells.get(name)
        knows = str(getattr(make(core), "knows", "")) if cell is None else cell.knows
        measured = (_NONE, _NONE) if cell is None else (cell.text, cell.time_text)
        rows.append((f"`{name}`", knows, *measured))
    head = (
        "controller",
        "what it knows beside observations",
        "success [%], 95% interval",
        "median steps, or time to settle",
    )
    parts = [table(head, rows), *map(_filled, _told(entry, cells))]
    return "\n".join(parts)


def _told(entry: Entry, cells: dict[str, Any]) -> Iterable[str]:
    """Where the numbers come from, and where there are more."""
    name = short(entry)
    if cells:
        episodes = next(iter(cells.values())).flags.shape[1]
        yield f"From the files of `records/{name}/`: {episodes:,} test episodes, the same for all (`make benchmark`)."
        agent, best = cells.get(AGENT), best_controller(cells)
        if agent is not None and best is not None:
            yield f"The worst training run has {percent(agent.worst)}%, the best analytic controller is `{best.name}`."
    if _is_in_results(name):
        yield f"More of it, errors and intervals included: [results](../results.md#{name.lower()})."
    elif not cells:
        yield "It has not been measured yet."
    if entry.id in _configured():
        yield f"`make compare ENV={name}` trains agents, measures all of them, and writes a report."


def _is_in_results(name: str) -> bool:
    return bool(re.search(rf"^## {re.escape(name)}$", (HERE / "results.md").read_text(), re.MULTILINE))


@cache
def _configured() -> set[str]:
    """The ids for which there is a config."""
    found = {str(read_yaml(path, "env: TwoXReach-v0").get("env")) for path in shipped_configs().glob("*.yaml")}
    return {f"tensegrity/{name.rpartition('/')[2]}" for name in found}


def gallery(names: Iterable[str], folder: str) -> str:
    """All films, each leading to the page of its environment, for docs/gallery.md."""
    films = [f"[![{name}]({folder}/{name}.gif)<br>{name}]({folder}/{name}.md)\n" for name in names]
    return "\n".join(["```{container} films", *films, "```\n"])


def write_all(folder: Path, entries: Sequence[Entry] = ENTRIES) -> None:
    """Write the pages of all ids, their films and the gallery; pages of ids that are gone are removed."""
    folder.mkdir(parents=True, exist_ok=True)
    kept = {short(entry) for entry in entries}
    for old in [*folder.glob("*.md"), *folder.glob("*.gif"), *folder.glob("*.png")]:
        if old.stem not in kept:
            old.unlink()
    for entry in entries:
        text = page(entry, folder)
        target = folder / f"{short(entry)}.md"
        if not target.is_file() or target.read_text() != text:
            target.write_text(text)
    (folder / GALLERY).write_text(gallery(sorted(kept), folder.name))


def main(arguments: list[str]) -> int:
    """See the top of this file."""
    known = {short(entry): entry for entry in ENTRIES}
    if len(arguments) != 1 or arguments[0] not in known:
        print(f"{' '.join(arguments)!r}: must be one of {', '.join(known)}", file=sys.stderr)
        return 2
    print(page(known[arguments[0]]))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
