"""Checks of numbers that users hand in."""

import functools
import inspect
import types
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np

from tensegrity_envs.compiler.namespace import Component, detached, namespace_of

Counts = tuple[int, ...]
T = TypeVar("T")


def check_finite(name: str, values: Sequence[Component], *counts: int) -> None:
    """Raise ValueError unless these are finite numbers (or arrays of them), as many as one of `counts`."""
    check_count(name, values, *counts)
    try:
        finite = all(np.isfinite(np.asarray(detached(value), float)).all() for value in values)
    except (TypeError, ValueError):  # texts, nested sequences
        finite = False
    if not finite:
        raise ValueError(f"{name} = {values!r}: must be finite numbers")


def check_numbers(name: str, values: Sequence[Component], count: int) -> None:
    """Raise ValueError unless these are `count` finite numbers, no arrays."""
    check_finite(name, values, count)
    if any(np.ndim(value) for value in values):
        raise ValueError(f"{name} = {values!r}: must be single numbers, not arrays")


def common_shape(names: str, *values: Component) -> tuple[int, ...]:
    """The shape (m,) that numbers and arrays have together.

    Raises:
        ValueError: the shapes differ, or have two axes or more.
    """
    shapes = ", ".join(str(np.shape(value)) for value in values)
    if any(np.ndim(value) > 1 for value in values):
        raise ValueError(f"{names}: shapes {shapes}: must be numbers, or arrays of one axis; ravel() makes them so")
    try:
        return np.broadcast_shapes((1,), *map(np.shape, values))
    except ValueError:
        raise ValueError(f"{names}: shapes {shapes}: must be numbers, or arrays of one shape") from None


def check_count(name: str, values: Sequence[Component], *counts: int, names: str = "") -> None:
    """Check how many components there are. Traceable: their values are not looked at.

    Args:
        name: of the argument, for the message.
        values: the components.
        counts: how many there may be.
        names: of the components, for the message.

    Raises:
        ValueError: there are more or fewer.
        TypeError: it is one number, or text.
    """
    try:
        given = len(values)
    except TypeError:
        raise TypeError(f"{name} = {values!r}: {_wanted(counts, names)}") from None
    if isinstance(values, str):
        raise TypeError(f"{name} = {values!r}: {_wanted(counts, names)}")
    if given not in counts:
        raise ValueError(f"{name}: {given} number{'s' * (given != 1)}, {_wanted(counts, names)}")


def _wanted(counts: Counts, names: str) -> str:
    return f"must be {' or '.join(map(str, counts))}{names and ': '}{names}"


def sized(**table: tuple[int | Counts | Callable[[Any], int], str]) -> Callable[[type[T]], type[T]]:
    """A class of which every public method, inherited ones too, checks the arguments in a table before it works.

    Where it is traced the check runs once, and compiled code has nothing of it.

    Args:
        table: for the name of a parameter that takes a sequence of components: how many (one of several counts, or a
            function of the mechanism), and what they are called.

    Raises (the methods):
        ValueError: an argument has too many components or too few.
        TypeError: it is one number, or NumPy arrays and Torch tensors are mixed, see `namespace_of`.
    """

    wanted = {name: ((count,) if isinstance(count, int) else count, names) for name, (count, names) in table.items()}

    def decorate(cls: type[T]) -> type[T]:
        for name in dir(cls):
            method = inspect.getattr_static(cls, name)
            if name.startswith("_") or not isinstance(method, types.FunctionType):
                continue
            parameters = list(inspect.signature(method).parameters.values())[1:]
            places = [
                (i, p.name, *wanted[p.name]) for i, p in enumerate(parameters) if p.name in wanted and _several(p)
            ]
            if places:
                setattr(cls, name, _checked(method, places))
        return cls

    return decorate


def _several(parameter: inspect.Parameter) -> bool:
    """Whether a parameter is annotated as a sequence (`load` is one number where it is the size of a force)."""
    return any(kind in str(parameter.annotation) for kind in ("Sequence[", "tuple["))


def _checked(method: Callable[..., Any], places: Sequence[tuple[int, str, Any, str]]) -> Callable[..., Any]:
    """The method with a check of the arguments at these places."""

    @functools.wraps(method)
    def checked(self: object, *args: Any, **kwargs: Any) -> Any:
        components: list[Component] = []
        for place, name, count, names in places:
            values = args[place] if place < len(args) else kwargs.get(name)
            if values is not None:
                check_count(name, values, *(count if isinstance(count, tuple) else (count(self),)), names=names)
                components.extend(values)
        namespace_of(*components)
        return method(self, *args, **kwargs)

    return checked


def check_single(probe: Component, what: str) -> None:
    """Raise ValueError for a batch of designs."""
    if isinstance(probe, np.ndarray):
        raise ValueError(f"{what} takes one design, not a batch of them; take(index) picks one")


def checked_range(
    name: str, given: Sequence[float] | None, unit: str, default: tuple[float, float] = (0.0, 0.0)
) -> tuple[float, float]:
    """(low, high) with 0 <= low <= high, from two numbers or None for the default.

    Raises:
        ValueError: it is not that.
    """
    if given is None:
        return default
    try:
        low, high = (float(end) for end in given)
        fine = not isinstance(given, str) and 0 <= low <= high and bool(np.isfinite(high))
    except (TypeError, ValueError):
        fine = False
    if not fine:
        raise ValueError(f"{name} = {given!r}: must be (low, high) with 0 <= low <= high, in {unit}")
    return low, high
