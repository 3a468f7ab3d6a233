"""One self-contained HTML page to browse a workspace of any mechanism: axes, regions, and the arm at points of a grid.

No script or data is loaded from anywhere. What is shown at a point has been computed for it, so that the page knows no
equation; the 2-X has a page that solves its inverse kinematics at every point (`analysis.two_x.page`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_agents.web_page import as_data, as_text, write_page
from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics.design import Member


@dataclass(frozen=True)
class Shape:
    """A filled region: closed rings (holes by the even-odd rule), its name and its colour."""

    label: str
    colour: str
    rings: Sequence[np.ndarray]


@dataclass
class Sample:
    """What there is at a point.

    Attributes:
        at: the point, in the page's unit.
        rows: of the table, one for each configuration.
        arms: for each configuration, its members: (kind, points of shape (n, 2)).
    """

    at: tuple[float, float]
    rows: list[list[float | str]] = field(default_factory=list)
    arms: list[list[tuple[str, Any]]] = field(default_factory=list)


def write_browse_page(
    path: Path,
    title: str,
    *,
    regions: Sequence[Shape],
    samples: Sequence[Sample],
    columns: Sequence[str],
    cell: float,
    axes: tuple[str, str] = ("x [m]", "y [m]"),
    unit: str = "m",
    what: tuple[str, str] = ("configuration", "configurations"),
    curves: Sequence[np.ndarray] = (),
) -> Path:
    """Write the page.

    Args:
        path: of the HTML file.
        title: shown on top.
        regions: that are filled.
        samples: points of a grid, see `Sample`.
        columns: names of the columns of their tables, with units.
        cell: how far from a sample its configurations are shown, in the page's unit.
        axes: labels of the axes.
        unit: of points.
        what: a row of the table is, one and many.
        curves: lines, arrays of shape (n, 2).

    Returns:
        The path.
    """
    kinds = sorted({kind for sample in samples for arm in sample.arms for kind, _ in arm})
    points = [np.asarray(ring) for shape in regions for ring in shape.rings]
    points += [np.asarray(line) for sample in samples for arm in sample.arms for _, line in arm]
    every = np.concatenate(points) if points else np.array([[-1.0, -1.0], [1.0, 1.0]])
    low, high = every.min(axis=0), every.max(axis=0)
    rim = 0.04 * float((high - low).max())
    data = {
        "axes": axes,
        "unit": unit,
        "what": what,
        "columns": list(columns),
        "cell": cell,
        "kinds": kinds,
        "bounds": [*(low - rim).tolist(), *(high + rim).tolist()],
        "regions": [
            {"label": shape.label, "colour": shape.colour, "rings": [_rounded(ring) for ring in shape.rings]}
            for shape in regions
        ],
        "curves": [_rounded(line) for line in curves],
        "samples": [
            {
                "at": [float(f"{v:.6g}") for v in sample.at],
                "rows": [[f"{c:.4g}" if isinstance(c, float) else str(c) for c in row] for row in sample.rows],
                "arms": [[[kinds.index(kind), _rounded(line)] for kind, line in arm] for arm in sample.arms],
            }
            for sample in samples
        ],
    }
    return write_page(path, Path(__file__).with_name("browse_page.html"), TITLE=as_text(title), DATA=as_data(data))


def members_of(nodes: Mapping[str, Sequence[Component]], members: Sequence[Member]) -> list[tuple[str, np.ndarray]]:
    """The members of a planar mechanism as lines between its nodes."""
    return [(m.kind, np.array([[float(v) for v in nodes[name]] for name in m.nodes])) for m in members]


def _rounded(points: ArrayLike) -> list[list[float]]:
    return [[float(f"{v:.5g}") for v in p] for p in np.asarray(points, float).tolist()]
