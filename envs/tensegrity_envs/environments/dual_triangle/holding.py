"""Starts of the dual-triangle arm that hold a target on the axis, with all six free lengths within their bounds."""

from functools import cached_property

import numpy as np

from tensegrity_envs.compiler.kernel import Kernel
from tensegrity_envs.compiler.namespace import Component, Components, Namespace
from tensegrity_envs.compiler.pytree import Schema
from tensegrity_envs.mechanics.dual_triangle import DualTriangle, DualTriangleDesign
from tensegrity_envs.seeding import EpisodeStream

_FROM_LIMIT = 0.05  # of the joint angles [rad]
_WIDEST = 0.95  # of the first angle, as a share of the largest with which the last two links still reach the target
_CELLS = (128, 512)  # of the table, along the target and the share
_MAX_ATTEMPTS = 3200


class HoldSampler:
    """Draws starts with the tip on a target (x, 0), uniform over the first angles and elbows that can hold it there.

    At most targets a third of the first angles can be held. They are drawn from the cells of a table in which some can,
    or which lie beside such a cell, and tried; so all that can be held are equally likely, but for intervals narrower
    than a cell.

    Args:
        arm: nominal, of three segments.
        targets: smallest and largest x [m].
        highest: free length [m].
    """

    def __init__(self, arm: DualTriangle, targets: tuple[float, float], highest: float) -> None:
        self.arm, self.targets, self.highest = arm, targets, highest

    @cached_property
    def start(self) -> Kernel:
        """`hold_start` of this arm: a matrix of x, share and side to one of the posture and whether it is good."""

        def start(tried: Components) -> tuple[Component, ...]:
            x, share, side = tried
            q, good = hold_start(self.arm.design, self.arm.segments, x, share, side, self.highest)
            return *q, good

        return Kernel(start, Schema((np.zeros(1),) * 3))

    def sample(self, stream: EpisodeStream, x: np.ndarray) -> np.ndarray:
        """Postures (3, n) [rad] for targets x of shape (n,) [m].

        Raises:
            RuntimeError: for some target none was found.
        """
        q = np.zeros((self.arm.segments, len(x)))
        pending, tried, count = np.arange(len(x)), 0, 1
        while len(pending):
            if tried >= _MAX_ATTEMPTS:
                raise RuntimeError(f"no start found for {self.arm.design} in {tried} draws")
            *posture, good = self.start(
                self._tried(np.tile(x[pending], count), stream.at(pending).block(count).ravel())
            )
            stream.skip(count)
            fits = good.reshape(count, len(pending)) != 0
            found, column = fits.any(axis=0), fits.argmax(axis=0) * len(pending) + np.arange(len(pending))
            for angle, drawn in zip(q, posture, strict=True):
                angle[pending[found]] = drawn[column[found]]
            pending, tried, count = pending[~found], tried + count, 2 * count  # the same draws whatever the counts
        return q

    def _tried(self, x: np.ndarray, number: np.ndarray) -> np.ndarray:
        """What to try, from numbers uniform in [0, 1), both of shape (m,): matrix of x, share and side."""
        cells, counts = self._table
        low, high = self.targets
        column = np.clip(((x - low) / (high - low) * len(counts)).astype(np.int64), 0, len(counts) - 1)
        place = number * counts[column]
        k = place.astype(np.int64)
        cell = cells[column, k]
        side = np.where(cell < _CELLS[1], -1.0, 1.0)
        return np.stack([x, _WIDEST * (2 * (cell % _CELLS[1] + place - k) / _CELLS[1] - 1), side])

    @cached_property
    def _table(self) -> tuple[np.ndarray, np.ndarray]:
        """Open cells (columns, k), those of side -1 before those of side 1, and how many there are (columns,)."""
        columns, rows = _CELLS
        x, share, side = np.meshgrid(
            np.linspace(*self.targets, columns + 1),
            np.linspace(-_WIDEST, _WIDEST, rows + 1),
            [-1.0, 1.0],
            indexing="ij",
        )
        good = self.start(np.stack([x.ravel(), share.ravel(), side.ravel()]))[-1] != 0
        holds = np.pad(good.reshape(x.shape), ((1, 1), (1, 1), (0, 0)))
        # A cell is open if an arm holds at one of its corners, or of its neighbours' corners.
        open_ = np.any([holds[i : i + columns, j : j + rows] for i in range(4) for j in range(4)], axis=0)
        flat = open_.transpose(0, 2, 1).reshape(columns, 2 * rows)
        counts = flat.sum(axis=1)
        cells = np.argsort(~flat, axis=1, kind="stable")
        return cells, np.maximum(counts, 1)


def hold_start(
    design: DualTriangleDesign, segments: int, x: Component, share: Component, side: Component, highest: Component
) -> tuple[Components, Component]:
    """A posture with the tip at (x, 0), and whether it can be held there within all limits. Traceable.

    Args:
        design: of an arm of three segments.
        segments: three.
        x: target [m].
        share: in [-1, 1]: how far the first angle is from zero, as a share of the largest with which the last two
            links still reach the target.
        side: 1 or -1, of the elbow.
        highest: free length [m].
    """
    arm = DualTriangle(design, segments)
    xp = arm._xp(x, share)
    first, second, last = arm.link_lengths
    u = x - design.b1
    # Law of cosines: from pivot 2 to the tip it is at most second + last
    widest = _arccos(xp, (u * u + first * first - (second + last) ** 2) / (2 * u * first))
    q1 = share * widest
    px, py = u - first * xp.cos(q1), -first * xp.sin(q1)
    q3 = side * _arccos(xp, (px * px + py * py - second * second - last * last) / (2 * second * last))
    q2 = xp.atan2(py, px) - xp.atan2(last * xp.sin(q3), second + last * xp.cos(q3)) - q1
    q = (q1, q2, q3)
    lengths = arm.free_lengths(arm.control(q))
    good = arm.limit_margin(q) > _FROM_LIMIT
    for i, row in enumerate(arm.stiffness_matrix(q, lengths)):
        good = good & (row[i] > 0)  # without a load the matrix is diagonal
    for length in lengths:
        good = good & (length >= 0) & (length <= highest)
    return q, good


def _arccos(xp: Namespace, c: Component) -> Component:
    return xp.atan2(xp.sqrt(xp.maximum(1 - c * c, 0.0)), c)
