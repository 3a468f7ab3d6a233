"""Numbers of designs, loads, limits and tasks that know where they come from.

While a function is traced, every float of the objects that it uses is a `Number`: a float that remembers its source,
such as "TwoXDesign.l". Arithmetic on such numbers gives such numbers, done at once. The code of a kernel names sources
and never values, which are its data: so it stays the same code when a number changes, be it to a value that another
number has. What was computed from numbers is noted, as is whatever the function has learned of a value (by comparing
it, or in any other way): see `traces`, which trace nothing twice.
"""

import dataclasses
import hashlib
import math
import types
from collections.abc import Callable
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np


class Number(float):
    """A float that remembers its source, and where it is noted what becomes of it."""

    __slots__ = ("notes", "source")
    namespace: ClassVar[types.SimpleNamespace]  # see tracing.NAMESPACE
    source: str
    notes: "list[Note] | None"

    def __new__(cls, value: float, source: str, notes: "list[Note] | None" = None) -> "Number":
        """The number of that value from there."""
        number = float.__new__(cls, value)
        number.source, number.notes = source, notes
        return number

    def __neg__(self) -> Any:
        return derived("neg", float.__neg__, self)

    def __abs__(self) -> Any:
        return derived("abs", abs, self)

    def __pos__(self) -> Any:
        return self

    def __bool__(self) -> bool:
        return bool(derived("bool", float.__bool__, self))


class Note(NamedTuple):
    """What was computed from numbers while a function was traced.

    Attributes:
        result: the source of the number that came out, or what the function has learned: True or False.
        function: of floats.
        arguments: sources of numbers, and plain numbers.
    """

    result: str | bool
    function: Callable[..., Any]
    arguments: tuple[str | float, ...]


def plain(number: float) -> float:
    """A number's value, of which the traced function learns nothing."""
    return float.__pos__(number) if isinstance(number, Number) else number


def _source(value: object) -> str:
    return value.source if isinstance(value, Number) else repr(value)


def derived(code: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """The value of a function of numbers; it comes from where they come from."""
    value = function(*map(plain, arguments))
    is_learned = isinstance(value, bool)
    source = f"{code}({', '.join(map(_source, arguments))})"
    if len(source) >= 200:
        source = f"{code}:{hash_of(source)}"
    notes = next((a.notes for a in arguments if isinstance(a, Number) and a.notes is not None), None)
    if notes is not None:
        names = tuple(a.source if isinstance(a, Number) else a for a in arguments)
        notes.append(Note(value if is_learned else source, function, names))
    return value if is_learned else Number(value, source, notes)


def hash_of(content: str | bytes) -> str:
    """A short name of a text."""
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()[:24]


def _operator(name: str, swapped: bool = False) -> Any:
    of_floats = getattr(float, f"__{name}__")

    def of_numbers(x: float, y: float) -> Any:
        return of_floats(float(x), float(y))

    def call(a: Number, b: Any) -> Any:
        if not isinstance(b, float | int):
            return NotImplemented
        return derived(name, of_numbers, *((b, a) if swapped else (a, b)))

    return call


def _telling(name: str) -> Any:
    """A method after which the function knows the value."""
    of_floats = getattr(float, f"__{name}__")

    def call(a: Number, *rest: Any) -> Any:
        derived("is", _same, a, plain(a))
        return of_floats(plain(a), *rest)

    return call


for _name in ("add", "sub", "mul", "truediv", "pow", "floordiv", "mod"):
    setattr(Number, f"__{_name}__", _operator(_name))
    setattr(Number, f"__r{_name}__", _operator(_name, swapped=True))
for _name in ("lt", "le", "gt", "ge", "eq", "ne"):
    setattr(Number, f"__{_name}__", _operator(_name))
# But what is written for people, in which numbers occur, too, tells the function nothing.
for _name in ("hash", "float", "int", "trunc", "floor", "ceil", "round", "divmod", "rdivmod"):
    setattr(Number, f"__{_name}__", _telling(_name))


class Lifting:
    """Puts numbers in the place of floats in whatever a traced function uses; one for each trace.

    Containers, dataclasses and instances of this package's classes are copied, but for classes that say
    `is_traced = False`, whose instances traced code does not read, and for properties made on first use.

    Attributes:
        values: of the numbers, by source.
        notes: of what is computed from them.
        structure: text of all that the function may read and that is no number.
        objects: functions and classes among it.
        is_known: whether everything is this package's own. Of another's code, nobody knows what it reads: a global
            variable, or a float by a function that notes nothing.
    """

    def __init__(self) -> None:
        # By identity; the original is kept, so that this stays its own.
        self._copies: dict[int, tuple[Any, Any, int]] = {}
        self.values: dict[str, float] = {}
        self.notes: list[Note] = []
        self.structure: list[str] = []
        self.objects: list[Any] = []
        self.is_known = True

    def number(self, value: float, source: str) -> Number:
        """The number from a source; a second value from there gets a name of its own."""
        name, k = source, 1
        while name in self.values and not _same(self.values[name], value):
            name, k = f"{source}#{k}", k + 1
        self.values[name] = value
        self.structure.append(name)
        return Number(value, name, self.notes)

    def lift(self, value: object, source: str) -> Any:
        """The same with numbers in the place of floats."""
        kind = type(value)
        if isinstance(value, bool | int | str | type(None)):
            self.structure.append(f"{kind.__name__} {value!r} {getattr(value, 'kind', '')}")
            return value
        if isinstance(value, float):
            return self.number(plain(value), source)
        if isinstance(value, tuple | list):
            names = getattr(value, "_fields", range(len(value)))
            own = kind.__name__ if hasattr(value, "_fields") else source
            self.structure.append(f"{kind.__name__} of {len(value)}")
            parts = [self.lift(part, f"{own}.{name}") for name, part in zip(names, value, strict=True)]
            return kind(*parts) if hasattr(value, "_fields") else parts if isinstance(value, list) else tuple(parts)
        if kind is dict:
            given: dict[Any, Any] = value  # type: ignore[assignment]
            self.structure.append(f"dict {list(given)}")
            return {key: self.lift(part, f"{source}.{key}") for key, part in given.items()}
        is_object = not isinstance(value, type) and hasattr(value, "__dict__") and not callable(value)
        if not is_object or not (dataclasses.is_dataclass(value) or _holds_numbers(kind)):
            self._tell(value)
            return value
        self._note_class(kind)
        if id(value) in self._copies:
            _, copy, place = self._copies[id(value)]
            self.structure.append(f"object {place}")
            return copy
        copy = object.__new__(kind)
        self._copies[id(value)] = value, copy, len(self._copies)
        own_parts = {name: part for name, part in vars(value).items() if not _is_made_on_use(kind, name)}
        self.structure.append(f"{list(own_parts)}")
        vars(copy).update({name: self.lift(part, f"{kind.__name__}.{name}") for name, part in own_parts.items()})
        return copy

    def tell_function(self, function: Callable[..., Any]) -> None:
        """Note which function is traced; what it encloses is lifted."""
        self._note_class(function)
        self.objects.append(getattr(function, "__code__", None))
        is_inner = "<locals>" in function.__qualname__
        if self.objects[-1] is None or (is_inner and (function.__defaults__ or function.__kwdefaults__)):
            self.is_known = False

    def _tell(self, value: object) -> None:
        """Note something that stays as it is."""
        self.structure.append(type(value).__name__)
        if isinstance(value, np.ndarray):
            self.structure.append(f"{value.dtype} {value.shape} {hash_of(value.tobytes())}")
        elif isinstance(value, slice | complex | np.generic | frozenset):
            self.structure.append(repr(sorted(value, key=repr) if isinstance(value, frozenset) else value))
        elif isinstance(value, types.ModuleType):
            self.objects.append(value)
        elif isinstance(value, type | types.FunctionType):
            self._note_class(value)
            self.objects.append(value)
            if getattr(value, "__closure__", None):
                self.is_known = False
        elif callable(value) or type(value).__module__.startswith(_COMPILER):
            self.is_known = False

    def _note_class(self, kind: Any) -> None:
        """Note a class or a function, and whose it is."""
        self.structure.append(kind.__qualname__)
        if kind.__module__ != "builtins" and not kind.__module__.startswith(_PACKAGE):
            self.is_known = False


# Objects of this package, but not of the compiler, hold numbers that become data.
_PACKAGE, _COMPILER = f"{__name__.split('.')[0]}.", f"{__package__}."


def _holds_numbers(kind: type) -> bool:
    is_own = kind.__module__.startswith(_PACKAGE) and not kind.__module__.startswith(_COMPILER)
    return is_own and getattr(kind, "is_traced", True)


def _is_made_on_use(kind: type, name: str) -> bool:
    return isinstance(getattr(kind, name, None), cached_property)


def _same(a: float, b: float) -> bool:
    return (a == b and math.copysign(1, a) == math.copysign(1, b)) or (math.isnan(a) and math.isnan(b))
