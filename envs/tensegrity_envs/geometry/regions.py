"""Regions of a plane given by continuous margins: slices, boundary curves as closed polygons, components, areas.

Nothing here knows a mechanism. A `Region` is the part of a box in which several margins are positive; its plane may be
a joint space, a space of inputs, or any other. The boundary is not read off a grid: the grid only tells the topology.
Every vertex is a root of the condition that is active there, every corner a common root of two of them, and the
curves between are refined until their chords are as close as asked.
"""

from dataclasses import dataclass, replace

import numpy as np

from tensegrity_envs.geometry.boundary import Component2D, Map, Ring, Traced, outlines, signed_area, trace
from tensegrity_envs.geometry.conditions import LIMIT, BoundaryPoints, Conditions, Interval
from tensegrity_envs.geometry.slivers import missed

__all__ = ["LIMIT", "BoundaryPoints", "Component2D", "Interval", "Map", "Region", "Ring", "Traced", "signed_area"]

_FEWEST = 12  # crossings of grid edges by one ring


@dataclass(frozen=True)
class Region(Conditions):
    """The part of a box in which all margins are positive.

    Attributes:
        conditions: (q1, q2) -> margins, one for each name, elementwise on arrays of one shape; positive inside.
        names: of the conditions.
        lower, upper: corners of the box.
        what: in words, for exports.
        least: (q1, q2) -> the smallest of the margins, where that is cheaper than all of them.
    """

    def trace(
        self,
        resolution: int = 256,
        tolerance: float = 1e-6,
        image: Map | None = None,
        finest: int = 2048,
        lines: int = 64,
    ) -> Traced:
        """The boundary as closed polygons.

        A grid tells which of its edges the boundary crosses; it is made twice as fine, up to `finest`, while a cell is
        ambiguous or a local extremum between its nodes has the other sign. The crossings are then found exactly,
        corners are added where two conditions meet, and chords are halved until the curve is within `tolerance` of
        them.

        Args:
            resolution: cells of the grid along each coordinate.
            tolerance: largest distance between curve and chord, relative to the size of the box; with `image` also
                in the image, relative to its size.
            image: a map of the plane; its curves are then as smooth as the region's own.
            finest: largest resolution.
            lines: in each direction, along which exact slices check what the grid may have missed; 0 for no check.

        Raises:
            ValueError: resolution or tolerance is out of range.
        """
        if resolution < 4 or not 0 < tolerance < 1:
            raise ValueError(f"resolution = {resolution}, tolerance = {tolerance}: need at least 4 cells, 0 < tol < 1")
        while True:
            grids = [np.linspace(low, high, resolution + 1) for low, high in zip(self.lower, self.upper, strict=True)]
            margin = self.margin(grids[0][None, :], grids[1][:, None])
            rings, shape = outlines(margin)
            small = any(len(ring) < _FEWEST for ring in rings)
            if 2 * resolution > finest or not (small or self._is_too_coarse(margin, grids)):
                break
            resolution *= 2
        traced = trace(self, grids, margin, rings, shape, tolerance, image)
        if not lines:
            return traced
        more = missed(self, traced.rings, max(float(g[1] - g[0]) for g in grids), lines, image)
        return replace(traced, area_error=max(traced.area_error, more.area), missed_in_image=more.image)

    def _is_too_coarse(self, margin: np.ndarray, grids: list[np.ndarray]) -> bool:
        positive = margin > 0
        diagonal = (positive[:-1, :-1] == positive[1:, 1:]) & (positive[:-1, 1:] == positive[1:, :-1])
        if (diagonal & (positive[:-1, :-1] != positive[:-1, 1:])).any():
            return True
        # Nodes where |margin| is smaller than around them, and slopes that would let it reach zero within a cell.
        size = np.abs(margin)
        padded = np.pad(size, 1, mode="edge")
        signs = np.pad(positive, 1, mode="edge")
        n2, n1 = size.shape
        least, rise, alike = np.ones(size.shape, bool), np.zeros(size.shape), np.ones(size.shape, bool)
        for i, j in ((0, 0), (0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1), (2, 2)):
            neighbour = padded[i : i + n2, j : j + n1]
            least &= size <= neighbour
            rise = np.maximum(rise, neighbour - size)
            alike &= signs[i : i + n2, j : j + n1] == positive
        rows, columns = np.nonzero(least & alike & (size < rise))
        if not len(rows):
            return False
        fine = np.linspace(-1, 1, 13)
        h1, h2 = grids[0][1] - grids[0][0], grids[1][1] - grids[1][0]
        q1 = np.clip(grids[0][columns, None, None] + h1 * fine[None, :, None], self.lower[0], self.upper[0])
        q2 = np.clip(grids[1][rows, None, None] + h2 * fine[None, None, :], self.lower[1], self.upper[1])
        inside = self.margin(*np.broadcast_arrays(q1, q2)) > 0
        return bool((inside != positive[rows, columns][:, None, None]).any())
