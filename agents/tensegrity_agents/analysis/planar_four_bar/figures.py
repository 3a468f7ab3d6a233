"""Figures of the planar 4-bar mechanism, after those of [Ji2014] with their boundaries corrected; and its statics.

Every function takes a mechanism and returns a `matplotlib.figure.Figure`; see `reporting.style`.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from contourpy import contour_generator
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from shapely.plotting import patch_from_polygon

from tensegrity_agents.reporting.style import AREA, BAD, FAINT, GOOD, INK, new_figure, styled
from tensegrity_envs.geometry.four_bar_workspace import actuator_workspace
from tensegrity_envs.geometry.overlay import Image, closed
from tensegrity_envs.mechanics.planar_four_bar import PlanarFourBar
from tensegrity_envs.mechanics.planar_four_bar.singularities import SINGULARITIES

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00")
_DOTTED = (0, (1.2, 1.2))
_DASHED = (0, (5, 2))
_COUNTS = ("#dbe9f6", "#a6cbe3", "#6aaed6", "#3787c0", "#105ba4")
_GRID = 600
_SLIVER = 1e-6  # faces between two chords of one curve are smaller, as a share of L^2


def draw(
    axes: Axes,
    arm: PlanarFourBar,
    q: Sequence[float],
    lengths: Sequence[float],
    colour: str = INK,
    labels: bool = True,
) -> None:
    """The mechanism: bars thick, springs thin, actuators dashed, F as a dot."""
    nodes = arm.nodes(tuple(q), tuple(lengths))
    styles: dict[str, dict[str, Any]] = {
        "bar": {"color": colour, "linewidth": 2.4},
        "spring": {"color": GOOD, "linewidth": 0.9},
        "actuator": {"color": FAINT, "linewidth": 1.3, "linestyle": _DASHED},
    }
    for member in arm.members:
        axes.plot(*np.array([nodes[name] for name in member.nodes]).T, **styles[member.kind])
    places: dict[tuple[float, float], str] = {}
    for name, (x, y) in nodes.items():
        axes.plot(x, y, "o", markersize=3.2, color=colour)
        near = [p for p in places if math.dist(p, (x, y)) < 0.03 * float(arm.length)]
        key = near[0] if near else (float(x), float(y))  # nodes on one place share a label
        places[key] = places.get(key, "") + name
    for place, names in places.items() if labels else ():
        axes.annotate(names, place, xytext=(3, 3), textcoords="offset points", fontsize=7)
    axes.plot(*nodes["F"], "o", markersize=5, color=_COLOURS[0])
    axes.set(aspect="equal")


def _zero_curves(arm: PlanarFourBar, name: str, side: int) -> list[np.ndarray]:
    """Where a measure of `SINGULARITIES` that belongs to rectangles is zero, as curves of lengths [m]."""
    measure = next(s.measure for s in SINGULARITIES if s.name == name)
    rho = np.linspace(1e-6, 2 * float(arm.length), _GRID)
    lengths = (rho[None, :] + 0 * rho[:, None], rho[:, None] + 0 * rho[None, :])
    square, rest = arm.flatness(lengths)
    with np.errstate(all="ignore"):
        values = np.where((rest > 0) & (square > 1e-4), measure(arm, lengths, side), np.nan)
    lines = contour_generator(rho, rho, np.ma.masked_invalid(values)).lines(0.0)
    return [np.asarray(line) for line in lines]


@styled
def actuator_workspaces(arm: PlanarFourBar) -> Figure:
    """Actuator workspace with singular curves [Ji2014, figure 2]: what is stable in which mode."""
    l = float(arm.length)
    figure = new_figure(7.4, 4.1)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    arc = np.linspace(0, math.pi / 2, 200)
    for axes, side in zip(panels, (1, -1), strict=True):
        axes.fill([0, 2 * l, 2 * l, 0], [0, 0, 2 * l, 2 * l], color="#f0ece2")
        axes.fill(*closed(actuator_workspace(arm).trace(128).rings[0].points).T, color=AREA)
        lobe = actuator_workspace(arm, "paper", side).trace(128)
        for component in lobe.components:
            axes.fill(*component.outer.points.T, color="#b9d3ec")
        axes.plot(2 * l * np.cos(arc), 2 * l * np.sin(arc), color=BAD, linewidth=2)
        axes.plot([0, 0, 2 * l], [2 * l, 0, 0], color=INK, linewidth=2)
        axes.plot([0, 2 * l, 2 * l], [2 * l, 2 * l, 0], color=INK, linewidth=1, linestyle=_DASHED)
        for name, colour in (("vii: B, C, F aligned", _COLOURS[0]), ("vii: A, D, M aligned", _COLOURS[2])):
            for curve in _zero_curves(arm, name, side):
                axes.plot(*curve.T, color=colour, linewidth=1.4)
        axes.plot(l, l, "o", color=BAD, markersize=5)
        for text, at in (("i", (0.01, 0.5)), ("ii", (0.5, 0.01)), ("iii", (0.95, 0.4)), ("iv", (0.4, 0.95))):
            axes.annotate(text, (2 * l * at[0], 2 * l * at[1]), fontsize=9, ha="left", va="bottom")
        axes.annotate("v", (1.94 * l, 1.94 * l), fontsize=9, ha="right", va="top")
        axes.annotate("vi", (l, l), xytext=(5, 3), textcoords="offset points", fontsize=9)
        axes.set(aspect="equal", xlabel=r"$\rho_1$ [m]", title=f"side {side:+d}")
    panels[0].set_ylabel(r"$\rho_2$ [m]")
    handles = [
        Patch(color=AREA, label="rectangle stable"),
        Patch(color="#b9d3ec", label=r"and $0 < \theta, \gamma < \pi$"),
        Patch(color="#f0ece2", label="flat stable"),
        Line2D([], [], color=BAD, label=r"pitchfork $\rho_1^2 + \rho_2^2 = 4L^2$ (not in the paper)"),
        Line2D([], [], color=_COLOURS[0], label=r"vii: $\sin(\beta + \gamma) = 0$"),
        Line2D([], [], color=_COLOURS[2], label=r"vii: $\Phi_3$ = 0"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8)
    return figure


def _regions(axes: Axes, found: Image, l: float) -> None:
    for count, region in found.regions.items():
        for part in getattr(region, "geoms", [region]):
            if part.area > _SLIVER * l * l:
                axes.add_patch(patch_from_polygon(part, facecolor=_COUNTS[min(count, 5) - 1], edgecolor="none"))


def _circle(axes: Axes, x: float, y: float, radius: float, label: str, colour: str, dashes: Any) -> None:
    t = np.linspace(0, 2 * math.pi, 400)
    axes.plot(
        x + radius * np.cos(t), y + radius * np.sin(t), color=colour, linestyle=dashes, linewidth=1.1, label=label
    )


@styled
def output_workspaces(arm: PlanarFourBar, workspaces: Mapping[str, Image]) -> Figure:
    """Output workspaces by mode with singular curves [Ji2014, figure 3]; the boundaries that it lacks in red."""
    l = float(arm.length)
    figure = new_figure(7.6, 3.4)
    panels = figure.subplots(1, 3, sharex=True, sharey=True)
    titles = {"rectangle": "all rectangles", "paper": r"$0 < \theta, \gamma < \pi$", "flat": "flat"}
    for axes, (mode, title) in zip(panels, titles.items(), strict=True):
        found = workspaces[mode]
        _regions(axes, found, l)
        if mode != "flat":
            for sheet in found.sheets:
                for condition, dashes in (("|AM| = 3L/2", "solid"), ("|AM| = L/2", _DASHED)):
                    wanted = sheet.source.region.names.index(condition)
                    for ring, source in zip(sheet.rings, sheet.source.rings, strict=True):
                        on = source.conditions == wanted
                        points = np.where((on | np.roll(on, 1))[:, None], ring, np.nan)
                        axes.plot(*closed(points).T, color=BAD, linewidth=1.8, linestyle=dashes)
            _circle(axes, 0, 0, l, "i: x² + y² = L²", INK, "solid")
            _circle(axes, 2 * l, 0, l, "iii as printed", FAINT, _DOTTED)
            _circle(axes, l / 2, l * math.sqrt(3) / 2, l, "vi: about C = D", _COLOURS[2], _DASHED)
            _circle(axes, l, 0, 2 * l, r"viii: $\sin(\beta + \gamma) = 0$", _COLOURS[0], "solid")
        axes.plot([0, l], [0, 0], "o", color=INK, markersize=3)
        axes.set(aspect="equal", title=f"{title}: {found.area():.4g} m²", xlabel="x [m]")
        axes.set(xlim=(-1.15 * l, 2.1 * l), ylim=(-0.5 * l, 2.1 * l))
    panels[0].set_ylabel("y [m]")
    handles, labels = panels[0].get_legend_handles_labels()
    handles += [Line2D([], [], color=BAD, linewidth=1.8, linestyle=dashes) for dashes in ("solid", _DASHED)]
    labels += [r"$\Phi_3$ = 0, |AM| = 3L/2: not in the paper", r"$\Phi_3$ = 0, |AM| = L/2: not in the paper"]
    counts: list[Any] = [Patch(color=colour, label=str(n + 1)) for n, colour in enumerate(_COUNTS[:4])]
    handles += counts
    labels += [f"{n + 1} stable solution{'s' if n else ''}" for n in range(4)]
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=7.5)
    return figure


@styled
def singular_postures(arm: PlanarFourBar) -> Figure:
    """The mechanism at, or next to, every singular configuration, and what the paper says wrongly about it."""
    l = float(arm.length)
    near = 1e-6 * l
    special = 2 * l / math.sqrt(3)
    on_fold = np.concatenate(_zero_curves(arm, "vii: B, C, F aligned", 1))
    x, y = arm.rectangle(tuple(on_fold.T), 1)[1]
    on_fold = on_fold[np.hypot(x - l, y) > 1.9 * l]  # on the other part F stays on B
    on_thales = next(c for c in _zero_curves(arm, "vii: A, D, M aligned", 1) if len(c) > 10)
    fold, thales = on_fold[len(on_fold) // 3], on_thales[len(on_thales) // 3]
    cases: list[tuple[str, tuple[float, float]]] = [
        (r"i: $\rho_1$ = 0, F on D", (near, 1.2 * l)),
        (r"ii: $\rho_2$ = 0, F on B", (1.2 * l, near)),
        (r"iii: $\rho_1$ = 2L, flat", (2 * l, 1.4 * l)),
        (r"iv: $\rho_2$ = 2L, flat", (1.4 * l, 2 * l)),
        (r"v: $\rho_1 = \rho_2 = 2L$, F on B (not A)", (2 * l, 2 * l)),
        (r"vi: $\rho_1 = \rho_2 = L$, CF turns freely", (l, l)),
        ("vii: B, C, F aligned", (float(fold[0]), float(fold[1]))),
        ("vii: A, D, M aligned", (float(thales[0]), float(thales[1]))),
        (r"both: $\rho_1 = \rho_2 = 2L/\sqrt{3}$", (special, special)),
        (r"pitchfork: $\rho_1^2 + \rho_2^2 = 4L^2$", (1.2 * l, 1.6 * l - near)),
    ]
    figure = new_figure(7.6, 3.4)
    panels = figure.subplots(2, 5, sharex=True, sharey=True).ravel()
    for axes, (title, lengths) in zip(panels, cases, strict=True):
        if title.startswith("vi:"):
            for gamma in (0.6, 1.2, 1.9, 2.6):
                first = gamma == 0.6
                draw(axes, arm, (math.pi - gamma, gamma), lengths, INK if first else "#b8bfc8", first)
        else:
            flat = arm.flatness(lengths)[1] <= 0
            q, _ = arm.flat(lengths) if flat else arm.rectangle(lengths, 1)
            draw(axes, arm, q, lengths)
        axes.set_title(title, fontsize=7)
        axes.set(xlim=(-1.1 * l, 2.1 * l), ylim=(-0.4 * l, 2.1 * l))
        axes.tick_params(labelsize=6)
    for axes in panels[5:]:
        axes.set_xlabel("x [m]", fontsize=7)
    for axes in panels[::5]:
        axes.set_ylabel("y [m]", fontsize=7)
    return figure


@styled
def thrust_map(arm: PlanarFourBar) -> Figure:
    """Thrusts of both actuators over the lengths, unloaded: compression blue, tension red; they change sign inside."""
    l, force = float(arm.length), float(arm.largest_force)
    rho = np.linspace(0.001 * l, 2 * l * 0.9999, 400)
    lengths = (rho[None, :] + 0 * rho[:, None], rho[:, None] + 0 * rho[None, :])
    square, rest = arm.flatness(lengths)
    inside = (rest > 0) & (square > 1e-9)
    with np.errstate(all="ignore"):
        thrusts = arm.thrusts(arm.rectangle(lengths, 1)[0], lengths)
    figure = new_figure(7.4, 3.4)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, values, name in zip(panels, thrusts, ("actuator AC, p1", "actuator BD, p2"), strict=True):
        shown = np.where(inside, values / force, np.nan)
        image = axes.contourf(rho, rho, shown, levels=np.linspace(-2, 2, 21), cmap="RdBu")
        axes.contour(rho, rho, shown, levels=[0.0], colors=INK, linewidths=1.2)
        axes.set(aspect="equal", title=name, xlabel=r"$\rho_1$ [m]")
    panels[0].set_ylabel(r"$\rho_2$ [m]")
    figure.colorbar(image, ax=list(panels), shrink=0.85, label="thrust / (K L), compression positive [-]")
    return figure


@styled
def energy_landscape(arm: PlanarFourBar, lengths: tuple[float, float]) -> Figure:
    """Energy over (theta, gamma) with all equilibria, and the two stable mirror images."""
    scale = float(arm.stiffness) * float(arm.length) ** 2
    first = -0.6  # so that all equilibria of the published design are well inside
    angles = first + np.linspace(0, 2 * math.pi, 300)
    energy = arm.potential_energy((angles[None, :], angles[:, None]), lengths) / scale
    figure = new_figure(7.4, 3.8)
    left, right = figure.subplots(1, 2)
    image = left.contourf(angles, angles, energy, levels=24, cmap="viridis")
    found = arm.equilibria(lengths)
    markers = {"X": "o", "IN": "s", "OUT": "^", "PAR": "D"}
    for state in found:
        face = _COLOURS[4] if state.is_stable else "white"
        place = [(angle - first) % (2 * math.pi) + first for angle in state.configuration]
        left.plot(*place, markers[state.type], color=face, markeredgecolor=INK, markersize=6)
    used = {state.type: state.is_stable for state in found}
    handles = [
        Line2D([], [], linestyle="", marker=markers[kind], markerfacecolor=_COLOURS[4] if stable else "white",
               markeredgecolor=INK, label=f"{kind}, {'stable' if stable else 'unstable'}")
        for kind, stable in used.items()
    ]  # fmt: skip
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8)
    left.set(xlabel=r"$\theta$ [rad]", ylabel=r"$\gamma$ [rad]", aspect="equal")
    left.set_title(rf"$\rho$ = ({lengths[0]:g}, {lengths[1]:g}) m")
    figure.colorbar(image, ax=left, shrink=0.85, label="energy / (K L²) [-]")
    for state, colour in zip([s for s in found if s.is_stable], (_COLOURS[0], _COLOURS[1]), strict=False):
        draw(right, arm, state.configuration, lengths, colour)
    barrier = float(arm.energy_barrier(lengths)) / scale
    right.set(title=f"mirror images, barrier {barrier:.3f} K L²", xlabel="x [m]", ylabel="y [m]")
    return figure


def numbers(arm: PlanarFourBar, workspaces: Mapping[str, Image]) -> dict[str, Any]:
    """The numbers of the table."""
    table: dict[str, Any] = {}
    for mode in ("rectangle", "paper", "flat"):
        lobes = (1, -1) if mode == "paper" else (0,)  # which touch in a point and have long cusps: a fine grid
        table[f"actuator workspace, {mode} [m2]"] = sum(
            actuator_workspace(arm, mode, lobe).trace(2048 if lobe else 256).area for lobe in lobes
        )
    for mode, found in workspaces.items():
        low_x, low_y, high_x, high_y = found.reachable.bounds
        table[f"output workspace, {mode} [m2]"] = found.area()
        table[f"output workspace, {mode}: reached twice or more [m2]"] = found.overlap
        table[f"output workspace, {mode}: x from, to [m]"] = f"{low_x:.6f}, {high_x:.6f}"
        table[f"output workspace, {mode}: y from, to [m]"] = f"{low_y:.6f}, {high_y:.6f}"
    l = float(arm.length)
    special = 2 * l / math.sqrt(3)
    table["both vii at rho1 = rho2 [m]"] = special
    table["largest energy barrier between mirror images [J]"] = float(arm.stiffness) * l**2 / 2
    for direction, text in (((0.0, -1.0), "downwards"), ((1.0, 0.0), "along +x")):
        table[f"snap load at (1.4 L, 1.2 L), {text} [N]"] = arm.critical_load((1.4 * l, 1.2 * l), 1, direction)
    return table
