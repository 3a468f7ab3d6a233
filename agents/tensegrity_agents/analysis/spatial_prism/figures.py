"""Figures of the spatial prism: [Jahromy]'s figures 4 and 5, and what the paper leaves out: loads.

Every function takes a mechanism and returns a `matplotlib.figure.Figure`; see `reporting.style`.
"""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator

from tensegrity_agents.reporting.style import FAINT, INK, new_figure, styled, without_jumps
from tensegrity_envs.mechanics.spatial_prism import TRAJECTORIES, SpatialPrism
from tensegrity_envs.rendering.spatial import depth, flatten

_COLOURS = ("#0072b2", "#d55e00", "#009e73")
_BLUES = LinearSegmentedColormap.from_list("pale blues", ["#eef4fa", "#7fa8d1"])
_STILL = (0.0, 0.0, 0.0)
_HEIGHTS = (0.5, 0.8, 1.1, 1.4)  # of the maps, in base radii
_EVENTS = {1: "a strut stops pushing", 2: "a cable goes slack", 3: "the equilibrium ends"}


def _published(prism: SpatialPrism, name: str, t: np.ndarray) -> tuple[Any, ...]:
    """A trajectory of the paper, in the size of this design [m]."""
    size = float(prism.design.D) / 0.5
    return tuple(size * np.asarray(component) for component in TRAJECTORIES[name](t))


@styled
def forces_along(prism: SpatialPrism, name: str) -> Figure:
    """Thrusts of the struts and tensions of the cables along a trajectory [Jahromy, figures 4 and 5]."""
    t = np.linspace(0.0, 1.0, 801)
    r = _published(prism, name, t)
    q = (*r, *(np.zeros_like(t) for _ in range(3)))
    figure = new_figure(7.2, 3.4)
    axes = figure.subplots()
    for i, (force, colour) in enumerate(zip(prism.actuator_forces(q), _COLOURS, strict=True), 1):
        label = f"strut {i}: {force.min():.2f} to {force.max():.2f} N"
        axes.plot(t, force, color=colour, linewidth=1.8, label=label)
    tension = prism.cable_tensions(q)[0]
    axes.plot(t, np.broadcast_to(tension, t.shape), color=FAINT, linestyle=(0, (4, 2)), label="every cable's tension")
    axes.set(xlabel="time [cycles]", ylabel="force [N]", xlim=(0, 1), ylim=(0, None))
    figure.legend(ncols=2, loc="outside lower center")
    return figure


def _sector(prism: SpatialPrism, rings: int, rays: int) -> tuple[np.ndarray, np.ndarray]:
    """A polar grid over a third of a disc, of which the prism has three alike: x and y [m], shape (rays, rings)."""
    radius = 1.2 * float(prism.design.D) * np.linspace(0.0, 1.0, rings)
    angle = np.linspace(0.0, 2 * math.pi / 3, rays)[:, None]
    return radius * np.cos(angle), radius * np.sin(angle)


def _thirds(x: np.ndarray, y: np.ndarray, table: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The whole disc, from a third of it."""
    turns = [2 * math.pi / 3 * k for k in range(3)]
    whole_x = [math.cos(t) * x - math.sin(t) * y for t in turns]
    whole_y = [math.sin(t) * x + math.cos(t) * y for t in turns]
    return np.concatenate(whole_x), np.concatenate(whole_y), np.concatenate([table] * 3)


def _base(axes: Axes, prism: SpatialPrism) -> None:
    D = float(prism.design.D)
    axes.add_patch(Polygon([node[:2] for node in prism.base], closed=True, fill=False, edgecolor=INK, linewidth=0.8))
    axes.set(aspect="equal", xlim=(-1.25 * D, 1.25 * D), ylim=(-1.25 * D, 1.25 * D), xlabel="x [m]")


def compliance(prism: SpatialPrism, x: np.ndarray, y: np.ndarray, z: float) -> tuple[np.ndarray, np.ndarray]:
    """Of the unloaded platform with its struts locked [mm/N]: sideways in the worst direction, and along z."""
    still = np.zeros(x.size)
    c = prism.tip_compliance((x.ravel(), y.ravel(), still + z, still, still, still))
    return 1000 * np.linalg.eigvalsh(c[:, :2, :2])[:, 1].reshape(x.shape), 1000 * c[:, 2, 2].reshape(x.shape)


@styled
def compliance_maps(prism: SpatialPrism) -> Figure:
    """How far the unloaded platform gives way to a force, sideways and along z, struts locked."""
    D = float(prism.design.D)
    figure = new_figure(8.4, 4.6)
    panels = figure.subplots(2, len(_HEIGHTS), sharex=True, sharey=True)
    tables = []
    for height in _HEIGHTS:
        x, y = _sector(prism, 41, 61)
        tables.append((x, y, *compliance(prism, x, y, height * D)))
    for row, (which, label) in enumerate(((2, "sideways, worst direction"), (3, "along z"))):
        levels = MaxNLocator(12).tick_values(0, max(float(np.percentile(table[which], 98)) for table in tables))
        for axes, table, height in zip(panels[row], tables, _HEIGHTS, strict=True):
            image = axes.contourf(*_thirds(*table[:2], table[which]), levels=levels, cmap="viridis", extend="max")
            _base(axes, prism)
            if not row:
                axes.set(title=f"z = {height * D:g} m", xlabel="")
        panels[row][0].set_ylabel(f"{label}\ny [m]")
        figure.colorbar(image, ax=list(panels[row]), shrink=0.85, label="compliance [mm/N]")
    return figure


@styled
def unloading_maps(prism: SpatialPrism) -> Figure:
    """The smallest force, over the directions sideways, up and down, at which something goes slack or is lost."""
    D, k = float(prism.design.D), float(prism.design.k)
    figure = new_figure(8.4, 4.6)
    panels = figure.subplots(2, len(_HEIGHTS), sharex=True, sharey=True)
    angles = np.arange(12) * math.pi / 6
    sideways = np.stack([np.cos(angles), np.sin(angles), 0 * angles])
    downwards = np.array([[0.0], [0.0], [-1.0]])
    largest = 8 * k * D
    for row, (ways, label) in enumerate(((sideways, "sideways, weakest direction"), (downwards, "downwards"))):
        tables = []
        for height in _HEIGHTS:
            x, y = _sector(prism, 25, 37)
            r = np.stack([x.ravel(), y.ravel(), np.full(x.size, height * D)])
            n = r.shape[1]
            lengths = [np.tile(length, ways.shape[1]) for length in prism.unloaded_lengths(tuple(r))]
            found = prism.unloading_limit(lengths, tuple(np.repeat(ways, n, axis=1)), largest)
            tables.append(found.force.reshape(-1, n).min(axis=0).reshape(x.shape))
        high = min(float(np.max(tables)), largest)
        levels = np.asarray(MaxNLocator(12).tick_values(float(np.min(tables)), high))
        levels = levels[levels <= high] if high >= largest else levels
        for axes, table, height in zip(panels[row], tables, _HEIGHTS, strict=True):
            beyond = "max" if high >= largest else "neither"
            image = axes.contourf(*_thirds(x, y, table), levels=levels, cmap="cividis", extend=beyond)
            _base(axes, prism)
            if not row:
                axes.set(title=f"z = {height * D:g} m", xlabel="")
        panels[row][0].set_ylabel(f"{label}\ny [m]")
        figure.colorbar(image, ax=list(panels[row]), shrink=0.85, label="force [N]")
    return figure


def _least(prism: SpatialPrism, r: tuple[Any, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Smallest thrust of the struts [N] and smallest distance between them [m], at positions without a load."""
    q = (*np.broadcast_arrays(*r), *(np.zeros(np.broadcast_shapes(*(np.shape(v) for v in r))) for _ in range(3)))
    return np.min(prism.actuator_forces(q), axis=0), prism.strut_clearance(q)


@styled
def workspace(prism: SpatialPrism) -> Figure:
    """Where all struts push without a load, and where they come close to each other: four horizontal sections, and a
    vertical one.
    """
    D = float(prism.design.D)
    axis = np.linspace(-2.0 * D, 2.0 * D, 301)
    x, y = np.meshgrid(axis, axis)
    figure = new_figure(10.4, 5.2)
    panels = figure.subplots(2, 3).ravel()
    up = np.linspace(0.02 * D, 2.5 * D, 301)
    across, upwards = np.meshgrid(axis, up)
    sections: list[tuple[Any, Any, tuple[Any, ...], str]] = [
        (x, y, (x, y, height * D), f"z = {height * D:g} m") for height in _HEIGHTS
    ]
    sections.append((across, upwards, (across, 0.0, upwards), "y = 0"))
    found = [_least(prism, place) for _, _, place, _ in sections]
    levels = np.asarray(MaxNLocator(10).tick_values(0, max(float(thrust.max()) for thrust, _ in found)))
    near = 0.05 * D
    for axes, (first, second, _, title), (thrust, clearance) in zip(panels, sections, found, strict=False):
        image = axes.contourf(first, second, np.maximum(thrust, -1e-9), levels=levels[levels >= 0], cmap=_BLUES)
        if thrust.min() < 0 < thrust.max():
            axes.contour(first, second, thrust, levels=[0.0], colors=[INK], linewidths=1.0)
        if clearance.min() < near < clearance.max():
            axes.contour(first, second, clearance, levels=[near], colors=[_COLOURS[1]], linewidths=1.0)
        flat = title != "y = 0"
        if flat:
            _base(axes, prism)
        axes.set(aspect="equal", title=title, xlabel="x [m]", ylabel="y [m]" if flat else "z [m]")
        axes.set(xlim=(axis[0], axis[-1]), ylim=(axis[0], axis[-1]) if flat else (0, up[-1]))
    panels[-1].set_axis_off()
    figure.colorbar(image, ax=panels[-1], shrink=0.9, location="left", label="smallest thrust of a strut [N]")
    handles = [Line2D([], [], color=INK, linewidth=0.8, label="base")]
    if any(thrust.min() < 0 for thrust, _ in found):
        handles.append(Line2D([], [], color=INK, linewidth=1.0, label="a strut stops pushing"))
    if any(clearance.min() < near for _, clearance in found):
        label = f"struts are {1000 * near:.3g} mm apart, closer outside"
        handles.append(Line2D([], [], color=_COLOURS[1], linewidth=1.0, label=label))
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


@styled
def polar_limits(prism: SpatialPrism) -> Figure:
    """The force at which something goes slack over its direction, sideways, for positions on the axis."""
    D, k = float(prism.design.D), float(prism.design.k)
    angles = np.linspace(-math.pi, math.pi, 181)
    figure = new_figure(7.2, 3.4)
    axes = figure.subplots()
    colours = {1: _COLOURS[1], 2: _COLOURS[0], 3: INK}
    styles: dict[float, Any] = {0.5: "solid", 0.8: (0, (5, 2)), 1.1: (0, (1.5, 1.5))}  # by height, in base radii
    for height, style in styles.items():
        lengths = prism.unloaded_lengths((0.0, 0.0, height * D))
        found = prism.unloading_limit(lengths, (np.cos(angles), np.sin(angles), 0 * angles), 8 * k * D)
        for event, colour in colours.items():
            force = np.where(found.event == event, found.force, np.nan)
            axes.plot(np.degrees(angles), without_jumps(force), color=colour, linestyle=style, linewidth=1.8)
    handles = [Line2D([], [], color=colours[event], label=text) for event, text in _EVENTS.items()]
    for height, style in styles.items():
        handles.append(Line2D([], [], color=FAINT, linestyle=style, label=f"z = {height * D:g} m"))
    axes.set(xlabel="direction of the sideways force [degrees from x]", ylabel="force [N]", xlim=(-180, 180))
    axes.set(ylim=(0, None), xticks=range(-180, 181, 60))
    figure.legend(handles=handles, ncols=2, loc="outside lower center")
    return figure


@styled
def pictures(prism: SpatialPrism) -> Figure:
    """The prism in space: at rest at two positions, and under two loads with the struts locked."""
    D, k = float(prism.design.D), float(prism.design.k)
    low, high = (0.0, 0.0, 0.8 * D), (0.3 * D, 0.2 * D, 1.4 * D)
    cases: list[tuple[str, tuple[float, float, float], tuple[float, float, float]]] = [
        ("at rest", low, _STILL),
        ("at rest", high, _STILL),
        (f"{k * D:g} N down", low, (0.0, 0.0, -k * D)),
        (f"{k * D:g} N along x", low, (k * D, 0.0, 0.0)),
    ]
    figure = new_figure(9.6, 3.2)
    for axes, (title, r, force) in zip(figure.subplots(1, 4, sharex=True, sharey=True), cases, strict=True):
        found = prism.loaded_equilibrium(prism.unloaded_lengths(r), force)
        if force != _STILL:
            _draw_prism(axes, prism, (*r, *_STILL), ghost=True)
        _draw_prism(axes, prism, found.configuration)
        turn = math.degrees(math.sqrt(sum(float(w) ** 2 for w in found.configuration[3:])))
        at = ", ".join(f"{component:.3g}" for component in r)
        axes.set(aspect="equal", title=f"{title}, turned {turn:.1f}°" if force != _STILL else f"{title}, ({at}) m")
        axes.set_axis_off()
    return figure


def _draw_prism(axes: Axes, prism: SpatialPrism, q: Any, ghost: bool = False) -> None:
    """In orthographic projection, members behind first."""
    nodes = prism.nodes(q)
    at = {name: flatten(place) for name, place in nodes.items()}
    styles: dict[str, dict[str, Any]] = {
        "actuator": {"color": INK, "linewidth": 3.2},
        "spring": {"color": _COLOURS[2], "linewidth": 1.3},
        "cable": {"color": _COLOURS[1], "linewidth": 1.8},
    }
    for name, colour in (("B", "#e4e9ef"), ("P", "#b9cde3")):
        corners = [at[f"{name}{i}"] for i in (1, 2, 3)]
        if name == "P" or not ghost:
            axes.add_patch(Polygon(corners, closed=True, facecolor="none" if ghost else colour, alpha=0.7, zorder=1))
    for order, member in enumerate(
        sorted(prism.members, key=lambda member: sum(depth(nodes[name]) for name in member.nodes))
    ):
        x, y = zip(*(at[name] for name in member.nodes), strict=True)
        style = styles[member.kind]
        if ghost:
            if member.kind == "cable":
                axes.plot(x, y, color=FAINT, linewidth=0.9, linestyle=(0, (3, 2)), zorder=1)
            continue
        if member.kind == "spring":
            t = np.linspace(0, 1, 200)
            length = math.dist(*(at[name] for name in member.nodes))
            side = 0.012 * np.sin(2 * math.pi * 14 * t) * ((t > 0.06) & (t < 0.94)) / max(length, 1e-9)
            wave = x[0] + t * (x[1] - x[0]) - side * (y[1] - y[0]), y[0] + t * (y[1] - y[0]) + side * (x[1] - x[0])
            axes.plot(*wave, **style, zorder=2 + order)
            continue
        axes.plot(x, y, color="white", linewidth=style["linewidth"] + 2.2, zorder=2 + order, solid_capstyle="butt")
        axes.plot(x, y, **style, zorder=2 + order)
    if not ghost:
        axes.plot(
            *zip(*(at[name] for name in at if name != "P"), strict=True), "o", color=INK, markersize=2.6, zorder=20
        )


def numbers(prism: SpatialPrism) -> dict[str, Any]:
    """The numbers of the table."""
    D, k = float(prism.design.D), float(prism.design.k)
    table: dict[str, Any] = {
        "c0: least mean square of the struts' lengths [m2]": float(prism.least_square),
        "kappa: rotational stiffness at rest [N m/rad]": float(prism.rotational_stiffness),
        "tension of every cable at rest [N]": k * D,
    }
    t = np.linspace(0.0, 1.0, 20_001)
    for name in TRAJECTORIES:
        q = (*_published(prism, name, t), *(np.zeros_like(t) for _ in range(3)))
        for i, force in enumerate(prism.actuator_forces(q), 1):
            table[f"{name}: smallest thrust of strut {i} [N]"] = float(force.min())
            table[f"{name}: largest thrust of strut {i} [N]"] = float(force.max())
        table[f"{name}: smallest distance between struts [m]"] = float(prism.strut_clearance(q).min())
    centre = (0.0, 0.0, 0.8 * D)
    lengths = prism.unloaded_lengths(centre)
    angles = np.linspace(-math.pi, math.pi, 721)
    side = prism.unloading_limit(lengths, (np.cos(angles), np.sin(angles), 0 * angles), 8 * k * D)
    table[f"unloading force sideways at (0, 0, {0.8 * D:g}) m, smallest [N]"] = float(side.force.min())
    table[f"unloading force sideways at (0, 0, {0.8 * D:g}) m, largest [N]"] = float(side.force.max())
    table[f"unloading force upwards at (0, 0, {0.8 * D:g}) m [N]"] = float(
        prism.unloading_limit(lengths, (0.0, 0.0, 1.0), 8 * k * D).force
    )
    return table
