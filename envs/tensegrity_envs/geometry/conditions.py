"""The part of a box in which several margins are positive: membership, slices along lines, boundary points."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics.roots import bracketed_roots, hidden_sign_changes

LIMIT = "limit"  # the name of the box's edge among the conditions


class Interval(NamedTuple):
    """A maximal interval of a slice, and the conditions that end it: names of conditions, or "limit" for the box."""

    low: float
    high: float
    low_condition: str
    high_condition: str


class BoundaryPoints(NamedTuple):
    """Boundary points found along grid lines.

    Attributes:
        points: shape (n, 2).
        conditions: n names of what is active there.
        fixed: shape (n,), the coordinate (0 or 1) that was constant on the line.
    """

    points: np.ndarray
    conditions: list[str]
    fixed: np.ndarray


@dataclass(frozen=True)
class Conditions:
    """The part of a box in which all margins are positive.

    Attributes:
        conditions: (q1, q2) -> margins, one for each name, elementwise on arrays of one shape; positive inside.
        names: of the conditions.
        lower, upper: corners of the box.
        what: in words, for exports.
        least: (q1, q2) -> the smallest of the margins, where that is cheaper than all of them.
    """

    conditions: Callable[[Component, Component], Sequence[Component]]
    names: tuple[str, ...]
    lower: tuple[float, float]
    upper: tuple[float, float]
    what: str = "region"
    least: Callable[[Component, Component], Component] | None = None

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            ValueError: the box is empty or not finite, or a name is used twice.
        """
        if not all(math.isfinite(v) for v in (*self.lower, *self.upper)):
            raise ValueError(f"box {self.lower} ... {self.upper}: must be finite")
        if not (self.lower[0] < self.upper[0] and self.lower[1] < self.upper[1]):
            raise ValueError(f"box {self.lower} ... {self.upper}: each upper bound must be above the lower one")
        if len(set(self.names)) != len(self.names) or LIMIT in self.names:
            raise ValueError(f"condition names {self.names}: must differ from one another and from {LIMIT!r}")

    @property
    def box_area(self) -> float:
        """Area of the box."""
        return (self.upper[0] - self.lower[0]) * (self.upper[1] - self.lower[1])

    def margins(self, q1: Component, q2: Component) -> np.ndarray:
        """All margins, shape (number of conditions, ...); -1 where one is not a number."""
        q1, q2 = np.broadcast_arrays(np.asarray(q1, float), np.asarray(q2, float))
        with np.errstate(all="ignore"):
            values = np.stack([np.broadcast_to(v, q1.shape) for v in self.conditions(q1, q2)])
        np.nan_to_num(values, copy=False, nan=-1.0, posinf=1e300, neginf=-1e300)
        return values

    def margin(self, q1: Component, q2: Component) -> np.ndarray:
        """The smallest margin, positive inside and continuous; the box is not part of it."""
        if self.least is None:
            return np.asarray(self.margins(q1, q2).min(axis=0))
        with np.errstate(all="ignore"):
            value = np.asarray(self.least(np.asarray(q1, float), np.asarray(q2, float)))
        return np.where(np.isnan(value), -1.0, value)

    def active(self, q1: Component, q2: Component) -> np.ndarray:
        """Index of the condition with the smallest margin."""
        return np.asarray(self.margins(q1, q2).argmin(axis=0))

    def contains(self, q1: Component, q2: Component) -> np.ndarray:
        """Whether points are inside, the box included."""
        inside = self.margin(q1, q2) > 0
        for q, low, high in zip((q1, q2), self.lower, self.upper, strict=True):
            inside = inside & (np.asarray(q) >= low) & (np.asarray(q) <= high)
        return np.asarray(inside)

    def with_condition(self, name: str, margin: Callable[[Component, Component], Component]) -> Self:
        """The part of this region in which one more margin is positive."""
        return replace(
            self,
            conditions=lambda q1, q2: (*self.conditions(q1, q2), margin(q1, q2)),
            names=(*self.names, name),
            least=lambda q1, q2: np.minimum(self.margin(q1, q2), margin(q1, q2)),
        )

    # ------------------------------------------------------------------------------------------------------ slices

    def slices(self, fixed: int, values: ArrayLike, samples: int = 129) -> list[list[Interval]]:
        """All intervals of the region on lines along one coordinate.

        Sampled, with a search for sign changes between samples (`roots.hidden_sign_changes`), then every end is
        found to the last bits. An interval is missed only if it lies between two samples that do not
        rise towards it.

        Args:
            fixed: the coordinate, 0 or 1, that is constant on each line.
            values: its value for each line, shape (lines,).
            samples: along each line.

        Returns:
            For each line its intervals in increasing order, an empty list where there is none.

        Raises:
            ValueError: fixed is neither 0 nor 1, or a value is not a finite number within the box.
        """
        if fixed not in (0, 1):
            raise ValueError(f"fixed = {fixed!r}: must be 0 or 1, the coordinate that is constant on the lines")
        lines = np.atleast_1d(np.asarray(values, float))
        low, high = self.lower[fixed], self.upper[fixed]
        if not np.all((lines >= low) & (lines <= high)):
            raise ValueError(f"values = {values!r}: must lie in [{low:g}, {high:g}]")
        return self._slices(np.full(len(lines), fixed), lines, samples)

    def _slices(self, fixed: np.ndarray, lines: np.ndarray, samples: int) -> list[list[Interval]]:
        """Intervals on lines, each with its own fixed coordinate."""
        first = fixed == 0

        def at(line: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            value, is_first = lines[line], first[line]
            return np.where(is_first, value, s), np.where(is_first, s, value)

        def margin(line: np.ndarray, s: np.ndarray) -> np.ndarray:
            return self.margin(*at(line, s))

        share = np.linspace(0.0, 1.0, samples)
        low = np.where(first, self.lower[1], self.lower[0])[:, None]
        s = low + (np.where(first, self.upper[1], self.upper[0])[:, None] - low) * share
        s[:, -1] = np.where(first, self.upper[1], self.upper[0])
        index = np.arange(len(lines))
        sampled = np.empty(s.shape)
        for k in np.unique(fixed):  # a coordinate that is constant on its line is evaluated once
            mine = np.flatnonzero(fixed == k)
            constant, along = lines[mine][:, None], s[mine[0]][None, :]
            sampled[mine] = self.margin(*((constant, along) if k == 0 else (along, constant)))
        inside = sampled > 0
        # Brackets (line, outer or inner end, other end): between samples that differ, and around hidden changes.
        line, i = np.nonzero(inside[:, 1:] != inside[:, :-1])
        begin, end = s[line, i], s[line, i + 1]
        hidden, x = hidden_sign_changes(margin, s, sampled)
        if len(hidden):
            line = np.concatenate([np.repeat(index, samples), hidden])
            place = np.concatenate([s.ravel(), x])
            flags = np.concatenate([inside.ravel(), margin(hidden, x) > 0])
            order = np.lexsort((place, line))
            line, place, flags = line[order], place[order], flags[order]
            change = np.flatnonzero((flags[1:] != flags[:-1]) & (line[1:] == line[:-1]))
            line, begin, end = line[change], place[change], place[change + 1]
        roots = bracketed_roots(lambda t: margin(line, t), begin, end)
        active = self.active(*at(line, roots))
        ends: list[list[tuple[float, str]]] = [[] for _ in lines]
        for k in np.flatnonzero(inside[:, 0]):
            ends[k].append((float(s[k, 0]), LIMIT))
        for k, root, condition in zip(line.tolist(), roots.tolist(), active.tolist(), strict=True):
            ends[k].append((root, self.names[condition]))
        for k in np.flatnonzero(inside[:, -1]):
            ends[k].append((float(s[k, -1]), LIMIT))
        return [
            [Interval(a, b, name_a, name_b) for (a, name_a), (b, name_b) in zip(found[::2], found[1::2], strict=True)]
            for found in ends
        ]

    def scan(self, lines: int = 50, samples: int = 129) -> BoundaryPoints:
        """Boundary points on equally spaced grid lines in both directions, as a cloud.

        Args:
            lines: in each direction.
            samples: along each line, see `slices`.
        """
        fixed = np.repeat([1, 0], lines)
        values = np.concatenate([np.linspace(self.lower[k], self.upper[k], lines) for k in (1, 0)])
        points: list[tuple[float, float]] = []
        names: list[str] = []
        along: list[int] = []
        for k, value, intervals in zip(
            fixed.tolist(), values.tolist(), self._slices(fixed, values, samples), strict=True
        ):
            for interval in intervals:
                for end, name in zip(interval[:2], interval[2:], strict=True):
                    points.append((value, end) if k == 0 else (end, value))
                    names.append(name)
                    along.append(k)
        return BoundaryPoints(np.array(points).reshape(-1, 2), names, np.array(along, int))
