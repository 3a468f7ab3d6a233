"""One style for all figures, which prints well and which colour-blind readers can read; how they are saved.

Figures are `matplotlib.figure.Figure`s of their own (no pyplot, no global state); `save` writes them as PNG, SVG and
PDF. A controller looks the same in all of them: see `looks`.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec

import matplotlib as mpl
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.path import Path as Outline
from matplotlib.transforms import Bbox
from shapely.geometry.base import BaseGeometry

_STYLE: Any = {
    "figure.dpi": 100,
    "figure.facecolor": "white",
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.labelsize": 9,
    "axes.edgecolor": "#555c66",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": "#e3e6ea",
    "grid.linewidth": 0.7,
    "xtick.color": "#3a414b",
    "ytick.color": "#3a414b",
    "text.color": "#1e242c",
    "axes.labelcolor": "#1e242c",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "legend.handlelength": 2.6,
    "lines.solid_capstyle": "round",
    "figure.constrained_layout.w_pad": 0.08,
    "figure.constrained_layout.h_pad": 0.08,
    "svg.hashsalt": "tensegrity",
    "pdf.fonttype": 42,  # letters as letters, which journals ask for
}
_SLIVER = 1e-6  # of a region: smaller holes lie between two chords of one curve
INK, FAINT, GOOD, BAD = "#1e242c", "#6b7480", "#009e73", "#d55e00"

# Okabe and Ito's colours for colour-blind readers without their yellow, which white paper swallows; then some of Tol's.
AGENTS = ("#d55e00", "#cc79a7", "#882255", "#aa4499")
AREA = "#e6edf5"
BASELINES = (
    "#0072b2", "#009e73", "#e69f00", "#56b4e9", "#999933", "#332288", "#661100", "#9a7bff", "#5fe3c0", "#c0b090"
)  # fmt: skip
ORACLES = ("#111111", "#5d6570")
_DASHES: tuple[Any, ...] = ("solid", (0, (5, 1.6)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)), (0, (3, 1, 1, 1, 1, 1)))
_MARKERS = "osD^vPX*"


class Look(NamedTuple):
    """How a controller is drawn."""

    colour: str
    dashes: Any
    width: float
    marker: str

    @property
    def line(self) -> dict[str, Any]:
        """Keyword arguments of a line."""
        return {"color": self.colour, "linestyle": self.dashes, "linewidth": self.width}


_P = ParamSpec("_P")


def styled(function: Callable[_P, Figure]) -> Callable[_P, Figure]:
    """Draw in the style of this module, and only here."""

    @wraps(function)
    def styled(*args: _P.args, **kwargs: _P.kwargs) -> Figure:
        with mpl.rc_context(_STYLE):
            return function(*args, **kwargs)

    return styled


def save(figure: Figure, stem: Path, title: str = "") -> Path:
    """Write a figure to `stem`.png (200 dots per inch), `stem`.svg and `stem`.pdf, the same bytes for the same figure.

    Args:
        figure: to write.
        stem: path without its ending.
        title: above the figure, and in the files; none is drawn if it is empty.

    Returns:
        The path of the PNG.
    """
    png, svg, pdf = (stem.with_name(f"{stem.name}.{ending}") for ending in ("png", "svg", "pdf"))
    with mpl.rc_context(_STYLE):
        if title:
            figure.suptitle(title.replace("$", r"\$"), fontsize=10.5)
        named = {"Title": title} if title else {}
        figure.draw_without_rendering()  # lays it out; before that, labels are not where they will be
        needed = figure.get_tightbbox()
        whole = Bbox.from_bounds(0, 0, *figure.get_size_inches())
        tight: Any = {"bbox_inches": Bbox.union([whole, needed])}  # nothing is cut off, however long a name is
        engine = figure.get_layout_engine()
        figure.set_layout_engine("none")  # it is laid out: once for all files
        figure.savefig(png, dpi=200, **tight, metadata={"Software": None, **named})
        figure.savefig(svg, dpi=200, **tight, metadata={"Date": None, **named})
        figure.savefig(pdf, dpi=200, **tight, metadata={"CreationDate": None, **named})
        figure.set_layout_engine(engine)
    return png


def without_jumps(values: np.ndarray, ratio: float = 6.0) -> np.ndarray:
    """Samples of a function, shape (n,), with NaN where it jumps, so that no line is drawn there.

    A jump is a step that is `ratio` times larger than both steps beside it, and larger than 2% of the range.
    """
    values = np.array(values, float)
    if np.isfinite(values).sum() < 4:
        return values
    step = np.abs(np.diff(values))
    beside = np.maximum(np.append(0.0, step[:-1]), np.append(step[1:], 0.0))
    beside = np.where(np.isfinite(beside), beside, 0.0)
    size = float(np.nanmax(values) - np.nanmin(values))
    jump = (step > ratio * beside) & (step > 0.02 * size)
    values[1:][jump] = np.nan
    return values


def looks(kinds: Mapping[str, str]) -> dict[str, Look]:
    """Colour, dashes and marker of every controller.

    Args:
        kinds: "agent", "baseline", "oracle" or "random" by name of the controller.
    """
    found: dict[str, Look] = {}
    colours = {"agent": AGENTS, "baseline": BASELINES, "oracle": ORACLES}
    counts = dict.fromkeys(colours, 0)
    for i, (name, given) in enumerate(kinds.items()):
        marker = _turned(_MARKERS, i)
        if given == "random":
            found[name] = Look("#8b929b", (0, (4, 2)), 1.4, marker)
            continue
        kind = given if given in colours else "baseline"
        k, counts[kind] = counts[kind], counts[kind] + 1
        colour = colours[kind][k % len(colours[kind])]
        if kind == "oracle":
            found[name] = Look(colour, (0, (1.2, 1.6 + 1.2 * k)), 1.6, marker)
        else:
            found[name] = Look(colour, _turned(_DASHES, k), 2.4 if kind == "agent" else 1.8, marker)
    return found


def _turned(values: Sequence[Any], k: int) -> Any:
    """The k-th of values that come again one place further on, so that what colours nearly share does not recur."""
    return values[(k + k // len(values)) % len(values)]


def length_unit(tolerance: float) -> tuple[str, float]:
    """The unit in which errors are given where this is a good one, and how many there are in a metre."""
    if tolerance >= 0.02:
        return "m", 1.0
    return ("mm", 1e3) if tolerance >= 2e-5 else ("µm", 1e6)


def new_figure(width: float, height: float, **kwargs: Any) -> Figure:
    """A figure with a layout that keeps labels apart; sizes in inches."""
    figure = Figure(figsize=(width, height), layout="constrained", **kwargs)
    FigureCanvasAgg(figure)
    return figure


def short(name: str, most: int = 24) -> str:
    """A name without mathematical mode, and shortened in its middle if it is long."""
    name = name if len(name) <= most else name[: most // 2 - 1] + "…" + name[-(most - most // 2) :]
    return name.replace("$", r"\$")


def note(axes: Axes, text: str) -> None:
    """A remark in the middle of empty axes."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=FAINT)


def legend(axes: Axes, handles: Sequence[Any] | None = None) -> None:
    """A legend to the right of the axes."""
    if handles is None:
        handles = axes.get_legend_handles_labels()[0]
    if handles:
        axes.legend(handles=list(handles), loc="upper left", bbox_to_anchor=(1.01, 1.02), borderaxespad=0.2)


def outline(geometry: BaseGeometry) -> Outline | None:
    """A shapely geometry's polygons as one matplotlib path, holes included; None where there is none."""
    rings = []
    smallest = _SLIVER * shapely.area(geometry)
    for polygon in shapely.get_parts(geometry):
        if polygon.geom_type == "Polygon" and not polygon.is_empty:
            oriented = shapely.geometry.polygon.orient(polygon)
            holes = [hole for hole in oriented.interiors if shapely.Polygon(hole).area > smallest]
            rings += [np.asarray(ring.coords) for ring in (oriented.exterior, *holes)]
    if not rings:
        return None
    codes = [np.r_[Outline.MOVETO, np.full(len(r) - 2, Outline.LINETO), Outline.CLOSEPOLY] for r in rings]
    return Outline(np.concatenate(rings), np.concatenate(codes))
