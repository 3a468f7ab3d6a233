"""Axes, colours and fills that the figures of the 2-X share."""

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from shapely.geometry.base import BaseGeometry

from tensegrity_agents.reporting.style import INK, outline
from tensegrity_envs.geometry.accessibility import PI
from tensegrity_envs.geometry.regions import LIMIT
from tensegrity_envs.geometry.workspace import SINGULARITY, STABILITY

_FINE = 5e-5  # simplification of filled shapes, relative to their size: invisible in print
SINGULAR = "#7b3294"
PATH = "#d55e00"
COUNTS = {1: "#dbe7f3", 2: "#9ec3e0", 3: "#e69f00", 4: "#5b8fc0"}
# Okabe and Ito's colours; a cable and its antagonist share a hue
CONDITIONS = {
    STABILITY: "#d55e00",
    "left 1": "#0072b2",
    "right 1": "#56b4e9",
    "left 2": "#009e73",
    "right 2": "#66c9a8",
    SINGULARITY: SINGULAR,
    LIMIT: "#8b929b",
}
POSITIVE, NEGATIVE = "#0072b2", "#e69f00"  # det J > 0 and < 0
TYPES = (
    *("#e4ecf5", "#b3cfe8", "#fdd0a2", "#b8dfb0", "#cdbfe3", "#f7c1c1", "#f4e79a", "#a6dbd8", "#d8b08c", "#c9c9c9"),
    *("#8fa9d6", "#6f9fcb", "#f29e5c", "#7fc47c", "#a58bd0", "#e98b8b", "#d9c24a", "#63b9b4", "#b07f55", "#979797"),
    *("#5d7fb8", "#c46a3a", "#4d9a55", "#7a5fb0", "#bf5b5b", "#a8922e"),
)
ANGLES = r"$\alpha_1$ [rad]", r"$\alpha_2$ [rad]"
_TICKS = {k: v for k, v in zip((-2, -1, 0, 1, 2), (r"$-2\pi$", r"$-\pi$", "0", r"$\pi$", r"$2\pi$"), strict=True)}


def fill(axes: Axes, geometry: BaseGeometry, colour: str, **kwargs: Any) -> None:
    """Fill a shapely geometry, simplified as far as print does not show."""
    x0, y0, x1, y1 = geometry.bounds
    path = outline(geometry.simplify(_FINE * max(x1 - x0, y1 - y0)))
    if path is not None:  # not add_patch, which looks for the data's limits point by point; they are set anyway
        axes.add_artist(PathPatch(path, facecolor=colour, **({"edgecolor": "none", "linewidth": 0} | kwargs)))


def panels_of(figure: Figure, count: int, **kwargs: Any) -> list[Axes]:
    """Axes side by side."""
    return list(figure.subplots(1, count, squeeze=False, **kwargs)[0])


def workspace_axes(axes: Axes, bounds: Sequence[float], base: bool = True) -> None:
    """Axes of positions [m] around bounds (x0, y0, x1, y1), with the base of the arm."""
    x0, y0, x1, y1 = bounds
    rim = 0.05 * max(x1 - x0, y1 - y0)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", xlim=(x0 - rim, x1 + rim), ylim=(y0 - rim, y1 + rim))
    axes.grid(visible=False)
    if base:
        axes.plot(0, 0, "^", markersize=5, color=INK, zorder=6)


def joint_axes(axes: Axes, limit: float) -> None:
    """Axes of both joint angles [rad], up to a limit."""
    axes.set(xlabel=ANGLES[0], ylabel=ANGLES[1], aspect="equal", xlim=(-limit, limit), ylim=(-limit, limit))
    axes.grid(visible=False)
    if limit > 3:
        shown = [k for k in _TICKS if abs(k) * PI <= limit * 1.02]
        axes.set_xticks([k * PI for k in shown], [_TICKS[k] for k in shown])
        axes.set_yticks([k * PI for k in shown], [_TICKS[k] for k in shown])
