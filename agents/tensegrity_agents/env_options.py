"""Options that make an environment one's own, in YAML and at the command line; they count wherever it is used."""

import dataclasses
import hashlib
import inspect
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
import yaml

from tensegrity_agents.yaml_file import ConfigError, parse_yaml, read_yaml
from tensegrity_envs.core import Core
from tensegrity_envs.env import unwrapped
from tensegrity_envs.mechanics.designs import PUBLISHED
from tensegrity_envs.randomization import DrawnLevel, Randomization
from tensegrity_envs.registration import full_id
from tensegrity_envs.uncertainty import DRAWN, LEVELS, checked_level

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

NAMES = ("design", "randomization", "level", "tolerance", "load_range", "payload_range")
# What `gym.make` and `gym.make_vec` keep for themselves; render_mode is chosen by commands.
_GYMNASIUM = {"render_mode", *inspect.signature(gym.make).parameters, *inspect.signature(gym.make_vec).parameters}
_DESIGN = (
    "a published design such as muralidharan2022, some fields such as '{\"b\": 0.06}' or b=0.06, both as "
    "muralidharan2022,b=0.06, or a YAML file with fields"
)


def parse_design(text: str, option: str = "--design") -> str | dict[str, Any]:
    """A design as the environments take it: its name, or a mapping of fields.

    Args:
        text: "name", "name,field=value,...", "field=value,...", "base=name,field=value,...",
            "file.yaml,field=value,...", or JSON: {"field": value}.
        option: for messages.

    Raises:
        ConfigError: it is none of these.
    """
    if text.lstrip().startswith("{"):
        return _mapping(text, option, "'{\"b\": 0.06}'")
    first, *changes = (part.strip() for part in text.split(","))
    fields: dict[str, Any] = {}
    if first.endswith((".yaml", ".yml")):
        fields |= read_yaml(Path(first), "b: 0.05")
    elif "=" in first:
        changes = [first, *changes]
    elif not changes:
        if not first:
            raise ConfigError(f"{option} {text!r}: must be {_DESIGN}")
        return first
    else:
        changes = [f"base={first}", *changes]
    given: set[str] = set()
    for change in changes:
        name, _, value = (part.strip() for part in change.partition("="))
        if name in given:
            raise ConfigError(f"{option} {text}: {name!r} is given twice")
        given.add(name)
        try:
            if not name or not value:
                raise ValueError
            fields[name] = value if name == "base" else float(value)
        except ValueError:
            raise ConfigError(f"{option} {text}: {change!r} must be field=number; {option} takes {_DESIGN}") from None
    return fields


def parse_randomization(text: str, option: str = "--randomization") -> dict[str, Any]:
    """Ranges of what differs from episode to episode, as JSON or in a YAML file.

    Raises:
        ConfigError: it is neither.
    """
    if text.endswith((".yaml", ".yml")):
        return read_yaml(Path(text), "stiffness: [0.9, 1.1]")
    return _mapping(text, option, "'{\"stiffness\": [0.9, 1.1]}'")


def parse_range(text: str, option: str) -> list[float]:
    """Two numbers, "low,high".

    Raises:
        ConfigError: it is something else.
    """
    try:
        low, high = (float(part) for part in text.strip("[]() ").split(","))
    except ValueError:
        raise ConfigError(f"{option} {text}: must be two numbers, such as 0,1") from None
    return checked_range([low, high], f"{option} {text}")


def level_numbers(text: str) -> list[int]:
    """Levels of uncertainty from "0,2".

    Raises:
        ValueError: one is none.
    """
    return [checked_level(int(part)) for part in text.split(",")]


def parse_level(text: str, option: str) -> int | list[int] | str:
    """A level of uncertainty, several of them, "0,2", or "drawn".

    Raises:
        ConfigError: it is something else.
    """
    if text == DRAWN:
        return text
    try:
        levels = level_numbers(text.strip().removeprefix("[").removesuffix("]"))
    except ValueError:
        last = len(LEVELS) - 1
        raise ConfigError(
            f"{option} {text}".lstrip() + f": must be from 0 to {last}, several such as 0,2, or drawn"
        ) from None
    return levels[0] if len(levels) == 1 else sorted(levels)


def parse_others(texts: Iterable[str], option: str = "--option") -> dict[str, Any]:
    """Arguments of the environment that have no option of their own, each as "name=value" with the value as YAML.

    Raises:
        ConfigError: one is something else, is given twice, or has an option of its own.
    """
    found: dict[str, Any] = {}
    for text in texts:
        name, is_there, value = (part.strip() for part in text.partition("="))
        if not (name.isidentifier() and is_there and value):
            raise ConfigError(f"{option} {text}: must be name=value, such as segments=4")
        if name in NAMES:
            raise ConfigError(f"{option} {text}: has an option of its own, --{name.replace('_', '-')}")
        check_own([name], f"{option} {text}")
        if name in found:
            raise ConfigError(f"{option} {text}: {name} is given twice")
        try:
            found[name] = parse_yaml(value)
        except yaml.YAMLError:
            raise ConfigError(f"{option} {text}: {value!r} is not YAML") from None
    return found


def check_own(options: Iterable[str], where: str, also: frozenset[str] = frozenset()) -> None:
    """Refuse arguments of `gym.make` among an environment's own.

    Args:
        options: names.
        where: for messages.
        also: of these the ones that are allowed.

    Raises:
        ConfigError: one is there.
    """
    for name in options:
        if name in _GYMNASIUM - also:
            raise ConfigError(f"{where}: {name} is no option of environments, but of gym.make")


def checked_range(value: Sequence[float], where: str) -> list[float]:
    """A range [low, high] with 0 <= low <= high.

    Raises:
        ConfigError: it is none.
    """
    try:
        low, high = (float(part) for part in value)
        fine = 0 <= low <= high < math.inf and not isinstance(value, str)
    except (TypeError, ValueError):
        fine = False
    if not fine:
        raise ConfigError(f"{where}: must be two finite numbers with 0 <= low <= high, such as 0,1")
    return [low, high]


def check_options(env_id: str, options: Mapping[str, Any]) -> Core:
    """The core of the environment with these options.

    Raises:
        ConfigError: the environment does not take them; the message says what it takes.
    """
    for name in ("load_range", "payload_range"):
        if name in options:
            checked_range(options[name], f"{name} = {options[name]!r}")
    try:
        env = unwrapped(gym.make(env_id, **options))
    except (TypeError, ValueError, gym.error.Error) as error:
        reason = str(error).split(" was raised from the environment creator")[0]
        raise ConfigError(f"{env_id}: {reason}") from error
    core = env.core
    env.close()
    return core


def canonical(env_id: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """The same options without those that change nothing, as JSON has them; however they were spelt.

    Raises:
        ConfigError: see `check_options`.
    """
    options = {name: value for name, value in options.items() if value is not None}
    if not options:
        return {}
    env_id = full_id(env_id)
    core, usual = check_options(env_id, options), check_options(env_id, {})
    result: dict[str, Any] = {}
    if core.design != usual.design:
        result["design"] = {
            field.name: _plain(getattr(core.design, field.name)) for field in dataclasses.fields(core.design)
        }
    if core.randomization != usual.randomization:
        ranges = core.randomization
        names: Iterable[str] = ranges.names
        if usual.randomization.names:  # of the level that the id has; without it, the ranges are all there is
            result["level"] = 0
        if isinstance(ranges, DrawnLevel):  # each level has ranges of its own, but for those that were given for all
            result["level"] = list(ranges.levels)
            given = Randomization.given(options.get("randomization"), core.randomizable, env_id)
            names = [name for name in given.names if _overrides(env_id, options, name, ranges)]
        result["randomization"] = {name: _plain(getattr(ranges, name)) for name in names}
    if "tolerance" in options:
        scaled = check_options(env_id, {key: value for key, value in options.items() if key != "tolerance"})
        if core.task.tolerance != scaled.task.tolerance:
            result["tolerance"] = float(options["tolerance"])
    for name in ("load_range", "payload_range"):
        if name in options and _plain(options[name]) != _plain(gym.spec(env_id).kwargs.get(name)):
            result[name] = [float(value) for value in options[name]]
    others = {name: value for name, value in options.items() if name not in NAMES}
    result |= json.loads(json.dumps(others, default=_plain))
    return result


def _overrides(env_id: str, options: Mapping[str, Any], name: str, ranges: Randomization) -> bool:
    """Whether a range that was given for all levels is not what they have without it."""
    given = options["randomization"]
    fields = given if isinstance(given, Mapping) else {key: getattr(given, key) for key in given.names}
    others = {key: value for key, value in fields.items() if key != name}
    return bool(check_options(env_id, {**options, "randomization": others}).randomization != ranges)


def short_name(env_id: str) -> str:
    """An id without its namespace."""
    return env_id.rpartition("/")[2]


def results_name(env_id: str, options: Mapping[str, Any]) -> str:
    """Name of the folder for results: that of the environment, and a short hash where options differ from its own.

    Args:
        env_id: Gymnasium id.
        options: see `canonical`, which is applied.
    """
    name = short_name(env_id)
    if found := canonical(env_id, options):
        name += "-" + hashlib.sha256(json.dumps(found, sort_keys=True).encode()).hexdigest()[:8]
    return name


def explain(env_id: str, options: Mapping[str, Any]) -> list[str]:
    """Lines that say which options count, and from which design those fields come that are not given."""
    lines = []
    for name, value in options.items():
        if name == "design" and isinstance(value, Mapping):
            given = {key: field for key, field in value.items() if key != "base"}
            base = value.get("base") or _in_words(check_options(env_id, {}).design)
            fields = ", ".join(f"{key} = {field!r}" for key, field in given.items())
            lines.append(f"design: {fields or 'no field given'}; all other fields are those of {base}")
        else:
            lines.append(f"{name}: {value}")
    return lines


def _in_words(design: "DataclassInstance") -> str:
    """A design as the published one next to it and what differs."""

    def differing(name: str) -> list[str]:
        fields = [field.name for field in dataclasses.fields(design)]
        return [key for key in fields if _plain(getattr(design, key)) != _plain(getattr(PUBLISHED[name], key))]

    alike = [name for name, known in PUBLISHED.items() if isinstance(known, type(design))]
    if not alike:
        return "the environment's own design"
    base = min(alike, key=lambda name: len(differing(name)))
    changed = ", ".join(f"{key} = {_plain(getattr(design, key))}" for key in differing(base))
    return f"{base}{f' with {changed}' if changed else ''}, which is the environment's"


def _mapping(text: str, option: str, example: str) -> dict[str, Any]:
    try:
        content = parse_yaml(text)  # JSON is YAML
    except yaml.YAMLError:
        content = None
    if not isinstance(content, dict):
        raise ConfigError(f"{option} {text}: must be JSON such as {example}, or a YAML file")
    return content


def _plain(value: Any) -> Any:
    """As JSON has it: numbers as floats."""
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if isinstance(value, bool | str) or value is None:
        return value
    return float(value)
