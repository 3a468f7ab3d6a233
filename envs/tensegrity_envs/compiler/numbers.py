"""Numbers of designs, loads, limits and tasks that know where they come from.

While a function is traced, every float of the objects that it uses is a `Number`: a float that remembers its source,
such as "TwoXDesign.l". Arithmetic on such numbers gives such numbers, done at once. The code of a kernel names sources
and never values, which are its data: so it stays the same code when a number changes, be it to a value that another
number has.
"""

import dataclasses
import hashlib
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, ClassVar


class Number(float):
    """A float that remembers its source."""

    namespace: ClassVar[SimpleNamespace]  # see tracing.NAMESPACE
    source: str

    def __new__(cls, value: float, source: str) -> "Number":
        """The number of that value from there."""
        number = float.__new__(cls, value)
        number.source = source
        return number

    def __neg__(self) -> Any:
        return derived("neg", lambda a: -a, self)

    def __abs__(self) -> Any:
        return derived("abs", abs, self)


def _source(value: object) -> str:
    return value.source if isinstance(value, Number) else repr(value)


def derived(code: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """The value of a function of numbers; it comes from where they come from."""
    value = function(*(float(a) if isinstance(a, Number) else a for a in arguments))
    if isinstance(value, bool):
        return value
    source = f"{code}({', '.join(map(_source, arguments))})"
    return Number(value, source if len(source) < 200 else f"{code}:{hash_of(source)}")


def hash_of(text: str) -> str:
    """A short name of a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def _operator(name: str, swapped: bool = False) -> Any:
    of_floats = getattr(float, f"__{name}__")

    def call(a: Number, b: Any) -> Any:
        if not isinstance(b, float | int):
            return NotImplemented
        pair = (b, a) if swapped else (a, b)
        return derived(name, lambda x, y: of_floats(float(x), float(y)), *pair)

    return call


for _name in ("add", "sub", "mul", "truediv", "pow"):
    setattr(Number, f"__{_name}__", _operator(_name))
    setattr(Number, f"__r{_name}__", _operator(_name, swapped=True))


class Lifting:
    """Puts numbers in the place of floats in whatever a traced function uses; one for each trace.

    Containers, dataclasses and instances of this package's classes are copied, but for what `is_leaf` says.
    """

    def __init__(self, is_leaf: Callable[[Any], bool]) -> None:
        self._is_leaf = is_leaf
        self._copies: dict[int, tuple[Any, Any]] = {}  # by identity; the original is kept, so that this stays its own
        self._values: dict[str, float] = {}

    def number(self, value: float, source: str) -> Number:
        """The number from a source; a second value from there gets a name of its own."""
        name, k = source, 1
        while name in self._values and not _same(self._values[name], value):
            name, k = f"{source}#{k}", k + 1
        self._values[name] = value
        return Number(value, name)

    def lift(self, value: object, source: str) -> Any:
        """The same with numbers in the place of floats."""
        if self._is_leaf(value) or isinstance(value, Number | bool | int | str | type(None)):
            return value
        if isinstance(value, float):
            return self.number(float(value), source)
        if isinstance(value, tuple):
            names = getattr(value, "_fields", range(len(value)))
            own = type(value).__name__ if hasattr(value, "_fields") else source
            parts = [self.lift(part, f"{own}.{name}") for name, part in zip(names, value, strict=True)]
            return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
        if isinstance(value, list):
            return [self.lift(part, f"{source}.{k}") for k, part in enumerate(value)]
        if type(value) is dict:
            return {key: self.lift(part, f"{source}.{key}") for key, part in value.items()}
        kind = type(value)
        if isinstance(value, type) or not hasattr(value, "__dict__"):
            return value
        if not (dataclasses.is_dataclass(value) or _holds_numbers(kind)) or callable(value):
            return value
        if id(value) not in self._copies:
            copy = object.__new__(kind)
            self._copies[id(value)] = value, copy
            vars(copy).update({name: self.lift(part, f"{kind.__name__}.{name}") for name, part in vars(value).items()})
        return self._copies[id(value)][1]


# Objects of this package, but not of the compiler, hold numbers that become data.
_PACKAGE, _COMPILER = f"{__name__.split('.')[0]}.", f"{__package__}."


def _holds_numbers(kind: type) -> bool:
    return kind.__module__.startswith(_PACKAGE) and not kind.__module__.startswith(_COMPILER)


def _same(a: float, b: float) -> bool:
    return (a == b and math.copysign(1, a) == math.copysign(1, b)) or (math.isnan(a) and math.isnan(b))
