"""One self-contained HTML page to browse a workspace: hover for the regions, click to see the arm that gets there.

No script or data is loaded from anywhere. The page holds the regions as polygons, margins on a grid of the joint space,
and the mechanism's node positions as tables: those of joint 1 by its angle, those of joint 2, seen from its base, by
its own. So it knows no equation of the mechanism, only how a serial chain is put together.
"""

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from tensegrity_agents import web_page
from tensegrity_envs.geometry.regions import Region
from tensegrity_envs.mechanics.two_x import TwoX

_TABLE = 2001  # samples of a joint's angle
_GRID = 161  # of the margins, along each angle
_FINE = 3e-4  # tolerance of the drawn curves, relative to their extent


def write_page(
    path: Path,
    title: str,
    mechanism: TwoX,
    regions: Mapping[int, Any],
    tip_curves: Mapping[str, Sequence[np.ndarray]],
    joint_curves: Mapping[str, Sequence[np.ndarray]],
    limit: float,
    region: Region | None = None,
) -> Path:
    """Write the page.

    Args:
        path: of the HTML file.
        title: shown on top.
        mechanism: that is drawn; its joint 2 turns with the top of joint 1.
        regions: shapely geometry of the workspace by number of configurations [m].
        tip_curves: curves in the workspace by kind, such as "singular", arrays of shape (n, 2) [m].
        joint_curves: curves in the joint space by kind, "boundary", "singular", arrays of shape (n, 2) [rad].
        limit: |alpha_i| <= limit is shown [rad].
        region: its margins are shown, and only configurations inside count; None counts all.

    Returns:
        The path.
    """
    alpha = np.linspace(-limit, limit, _TABLE)
    first, second = mechanism.nodes((alpha, 0 * alpha)), mechanism.nodes((0 * alpha, alpha))
    base = [(np.asarray(second["A2"][k]) + np.asarray(second["B2"][k])) / 2 for k in (0, 1)]
    tables: dict[str, Any] = {}
    for name in first:
        chained = name not in ("D2", "C2", "P")
        x, y = first[name] if chained else [np.asarray(v) - o for v, o in zip(second[name], base, strict=True)]
        tables[name] = {"stage": 1 if chained else 2, "x": _packed(x), "y": _packed(y)}
    tables["_base"] = {
        "stage": 1,
        "x": _packed((np.asarray(first["A2"][0]) + np.asarray(first["B2"][0])) / 2),
        "y": _packed((np.asarray(first["A2"][1]) + np.asarray(first["B2"][1])) / 2),
    }
    margins: list[str] = []
    if region is not None:
        axis = np.linspace(-limit, limit, _GRID)
        values = np.clip(region.margins(axis[:, None], axis[None, :]), -3, 3)
        margins = [_packed(v.ravel()) for v in values]
    shapes = [
        {"count": int(n), "area": shape.area, "rings": [_rounded(ring) for ring in _rings(shape)]}
        for n, shape in regions.items()
    ]
    points = [p for shape in shapes for ring in shape["rings"] for p in ring] or [[-1.0, -1.0], [1.0, 1.0]]
    low, high = np.min(points, axis=0).tolist(), np.max(points, axis=0).tolist()
    data = {
        "title": title,
        "limit": limit,
        "samples": _TABLE,
        "tables": tables,
        "members": [[m.kind, *m.nodes] for m in mechanism.members if m.kind != "spring"],
        "names": list(region.names) if region else [],
        "gridSize": _GRID,
        "margins": margins,
        "regions": shapes,
        "bounds": [min(low[0], 0.0), min(low[1], 0.0), max(high[0], 0.0), max(high[1], 0.0)],
        "tipCurves": [[kind, _line(c)] for kind, curves in tip_curves.items() for c in curves],
        "jointCurves": [[kind, _line(c)] for kind, curves in joint_curves.items() for c in curves],
        "reach": float(mechanism.reach),
        "selfMotion": not mechanism.design.a,  # then the base is reached by infinitely many configurations
    }
    return web_page.write_page(
        path, Path(__file__).with_name("page.html"), TITLE=web_page.as_text(title), DATA=web_page.as_data(data)
    )


def _packed(values: object) -> str:
    """Numbers as base64 of little-endian 32-bit floats."""
    return base64.b64encode(np.asarray(values, "<f4").tobytes()).decode()


def _rings(shape: BaseGeometry) -> list[np.ndarray]:
    polygons = [p for p in shapely.get_parts(shape) if p.geom_type == "Polygon" and not p.is_empty]
    return [np.asarray(ring.coords) for p in polygons for ring in (p.exterior, *p.interiors)]


def _rounded(points: np.ndarray) -> list[list[float]]:
    return [[float(f"{v:.6g}") for v in p] for p in points.tolist()]


def _line(points: np.ndarray) -> list[list[float]]:
    size = max(float(np.ptp(points, axis=0).max()), 1e-9)
    return _rounded(np.asarray(shapely.LineString(points).simplify(_FINE * size).coords))
