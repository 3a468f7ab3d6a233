"""Intervals as components: any equation of this package evaluated on them gives bounds of its values.

Outward rounding is left out: whoever compares bounds with zero adds a little.
"""

import math
from types import SimpleNamespace
from typing import Union

import numpy as np
from numpy.typing import ArrayLike

Operand = Union["Interval", ArrayLike]


class Interval:
    """Intervals [low, high], arrays of shape (n,)."""

    __slots__ = ("high", "low")
    __array_ufunc__ = None  # NumPy leaves arithmetic with intervals to them
    namespace: SimpleNamespace

    def __init__(self, low: ArrayLike, high: ArrayLike) -> None:
        self.low, self.high = np.asarray(low, float), np.asarray(high, float)

    @property
    def size(self) -> np.ndarray:
        """The largest absolute value."""
        return np.asarray(np.maximum(np.abs(self.low), np.abs(self.high)))

    def __neg__(self) -> "Interval":
        return Interval(-self.high, -self.low)

    def __abs__(self) -> "Interval":
        low = np.where((self.low <= 0) & (self.high >= 0), 0.0, np.minimum(np.abs(self.low), np.abs(self.high)))
        return Interval(low, self.size)

    def __add__(self, other: Operand) -> "Interval":
        low, high = _ends(other)
        return Interval(self.low + low, self.high + high)

    def __sub__(self, other: Operand) -> "Interval":
        low, high = _ends(other)
        return Interval(self.low - high, self.high - low)

    def __rsub__(self, other: Operand) -> "Interval":
        low, high = _ends(other)
        return Interval(low - self.high, high - self.low)

    def __mul__(self, other: Operand) -> "Interval":
        if other is self:
            there = abs(self)
            return Interval(there.low * there.low, there.high * there.high)
        low, high = _ends(other)
        products = self.low * low, self.low * high, self.high * low, self.high * high
        return Interval(np.minimum.reduce(products), np.maximum.reduce(products))

    def __truediv__(self, other: Operand) -> "Interval":
        return self * _inverse(*_ends(other))

    def __rtruediv__(self, other: Operand) -> "Interval":
        quotient: Interval = _inverse(self.low, self.high) * other
        return quotient

    def __pow__(self, power: float) -> "Interval":
        if power == 2:
            square: Interval = self * self
            return square
        if power == 0.5:
            return _sqrt(self)
        raise TypeError(f"intervals have squares and square roots, no power {power!r}")

    __radd__ = __add__
    __rmul__ = __mul__


def _ends(other: Operand) -> tuple[ArrayLike, ArrayLike]:
    return (other.low, other.high) if isinstance(other, Interval) else (other, other)


def _inverse(low: ArrayLike, high: ArrayLike) -> Interval:
    low, high = np.asarray(low, float), np.asarray(high, float)
    fine = (low > 0) | (high < 0)
    with np.errstate(divide="ignore"):
        return Interval(np.where(fine, 1 / high, -np.inf), np.where(fine, 1 / low, np.inf))


def _sqrt(x: Interval) -> Interval:
    return Interval(np.sqrt(np.maximum(x.low, 0.0)), np.sqrt(np.maximum(x.high, 0.0)))


def _cos(x: Interval) -> Interval:
    ends = np.cos(x.low), np.cos(x.high)
    turn = 2 * math.pi
    has_top = np.floor(x.high / turn) >= np.ceil(x.low / turn)
    has_bottom = np.floor((x.high - math.pi) / turn) >= np.ceil((x.low - math.pi) / turn)
    return Interval(np.where(has_bottom, -1.0, np.minimum(*ends)), np.where(has_top, 1.0, np.maximum(*ends)))


def _sin(x: Interval) -> Interval:
    return _cos(x - math.pi / 2)


Interval.namespace = SimpleNamespace(sin=_sin, cos=_cos, sqrt=_sqrt)
