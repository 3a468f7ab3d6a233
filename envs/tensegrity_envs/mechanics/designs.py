"""The published designs by name, and designs from names and mappings: what YAML, JSON and command lines can hold."""

import dataclasses
from collections.abc import Mapping
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any, TypeVar

from tensegrity_envs.mechanics.two_x import FURET2018

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

D = TypeVar("D", bound="DataclassInstance")


def _constants() -> dict[str, Any]:
    """The designs that the mechanisms' folders export as constants: names in capitals."""
    room = Path(__file__).parent
    folders = [import_module(f"{__package__}.{found.name}") for found in iter_modules([str(room)]) if found.ispkg]
    return {
        name.lower(): value
        for folder in folders
        for name, value in vars(folder).items()
        if name.isupper() and dataclasses.is_dataclass(value)
    }


PUBLISHED: dict[str, Any] = _constants() | {"furet2018": FURET2018(0.9)}


def resolve_design(given: D | Mapping[str, Any] | str | None, default: D) -> D:
    """A design of the same kind as the default one.

    Args:
        given: a design; the name of a published one, such as "muralidharan2022"; a mapping of some fields, such as
            {"b": 0.06}, whose other fields are those of the default, or of the published design that it names as
            "base"; or None for the default.
        default: of the environment.

    Raises:
        TypeError: it is none of these, or a design of another mechanism.
        ValueError: there is no such name or field, or a field is out of range; the message names it.
    """
    kind = type(default)
    if given is None:
        return default
    if isinstance(given, kind):
        return given
    if isinstance(given, str):
        return _published(given, kind)
    if not isinstance(given, Mapping):
        names = ", ".join(_names(kind))
        raise TypeError(
            f"design = {given!r}: must be a {kind.__name__}, a mapping of some of its fields, or a name: {names}"
        )
    fields = dict(given)
    base = fields.pop("base", default)
    if isinstance(base, str):
        base = _published(base, kind)
    if not isinstance(base, kind):
        raise TypeError(f"design: base = {base!r}: must be one of {', '.join(_names(kind))}")
    known = [field.name for field in dataclasses.fields(kind)]
    for name in fields:
        if name not in known:
            raise ValueError(
                f"design: {kind.__name__} has no field {name!r}{_hint(name, known)}; there are {', '.join(known)}, "
                "and 'base', the name of a published design"
            )
    return dataclasses.replace(base, **fields)


def name_of(design: object) -> str | None:
    """The name of a published design, None if it is none of them."""
    return next((name for name, known in PUBLISHED.items() if known is design or known == design), None)


def _names(kind: type[object]) -> list[str]:
    return [name for name, design in PUBLISHED.items() if isinstance(design, kind)]


def _published(name: str, kind: type[D]) -> D:
    names = _names(kind)
    if name.lower() not in names:
        raise ValueError(f"design = {name!r}: must be one of {', '.join(names)}{_hint(name.lower(), names)}")
    design: D = PUBLISHED[name.lower()]
    return design


def _hint(name: object, known: list[str]) -> str:
    close = get_close_matches(str(name), known, 1)
    return f" (did you mean {close[0]!r}?)" if close else ""
