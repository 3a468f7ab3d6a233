"""Designs as they are given to an analysis: names, fields, files."""

import dataclasses
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from tensegrity_agents import env_options


def parse_design(text: str, named: Mapping[str, Callable[[], Any]]) -> tuple[str, Any]:
    """A design from "name,field=value,...", or "file.yaml,field=value,..." with the design's fields in the file.

    Args:
        text: such as "muralidharan2022,payload=0.5".
        named: designs by name.

    Returns:
        A name for its folder, and the design.

    Raises:
        ValueError: unknown name or field, a value that is not a number, or a design that is not valid.
    """
    base_name, values = read_design(text, named)
    base = named[base_name]()
    fields = {field.name for field in dataclasses.fields(base)}
    if unknown := sorted(str(name) for name in values if name not in fields):
        raise ValueError(f"--design {text}: unknown {', '.join(unknown)}; the fields are {', '.join(sorted(fields))}")
    try:
        design = replace(base, **values)
    except (TypeError, ValueError) as error:
        raise ValueError(f"--design {text}: {error}") from error
    first, *changes = (part.strip() for part in text.split(","))
    stem = Path(first).stem if first not in named else first
    return re.sub(r"[^A-Za-z0-9_.=-]+", "_", "_".join([stem, *changes])), design


def read_design(text: str, named: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """The name of the design that other fields come from, and the fields that are given."""
    given = env_options.parse_design(text)
    if isinstance(given, str):
        given = {"base": given}
    base = given.pop("base", next(iter(named)))
    if base not in named:
        raise ValueError(
            f"--design {text}: must begin with one of {', '.join(named)}, or with the name of a YAML file; or name one "
            "of them as 'base'"
        )
    return str(base), given
