"""The figures of who wins where: all ids by all controllers, and success against the level of uncertainty."""

from collections.abc import Mapping, Sequence

import gymnasium as gym
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tensegrity_agents.evaluation.records import Record
from tensegrity_agents.reporting.matrix import AGENT, Cell, cells_of, is_whole, verdict_of
from tensegrity_agents.reporting.style import AGENTS, legend, looks, new_figure, note, styled
from tensegrity_agents.reporting.table import percent

_COLUMNS = 3  # panels side by side, so that their titles keep apart
_CLOSED = "closed_form"  # how the names of several begin


@styled
def matrix_figure(records: Mapping[str, Sequence[Record]]) -> Figure:
    """Success of every controller on every id, and below it how long it takes; a frame is around the best one that is
    told nothing hidden.
    """
    table = {env_id: cells_of(group) for env_id, group in records.items()}
    kinds = {cell.name: cell.kind for cells in table.values() for cell in cells.values()}
    order = {AGENT: 0, "baseline": 1, "oracle": 2, "random": 3}
    names = sorted(kinds, key=lambda name: order.get(kinds[name], 1))
    figure = new_figure(2.6 + 0.6 * max(len(names), 3), 1.5 + 0.4 * max(len(table), 2))
    axes = figure.subplots()
    if not table:
        note(axes, "no records")
        return figure
    shown = np.full((len(table), len(names)), np.nan)
    for i, cells in enumerate(table.values()):
        for name, cell in cells.items():
            k = names.index(name)
            shown[i, k] = 100 * cell.success.point
            style: dict[str, object] = {
                "ha": "center", "va": "center", "color": "white" if cell.success.point > 0.6 else "black"
            }  # fmt: skip
            star = "" if is_whole(cell, cells) else "*"
            axes.text(k, i - 0.15, percent(cell.success.point) + star, fontsize=8, **style)  # type: ignore[arg-type]
            axes.text(k, i + 0.24, cell.time_text, fontsize=6.5, **style)  # type: ignore[arg-type]
        for name in _framed(cells):
            outline = {"fill": False, "edgecolor": AGENTS[0], "linewidth": 1.8}
            axes.add_patch(_square(names.index(name), i, outline))
    axes.imshow(shown, cmap="Blues", vmin=0, vmax=110, aspect="auto")
    axes.set_xticks(range(len(names)), [name.replace("_", " ") for name in names], rotation=40, ha="right")
    axes.set_yticks(range(len(table)), [_short(env_id) for env_id in table])
    axes.grid(visible=False)
    few = sorted({cell.episodes for cells in table.values() for cell in cells.values() if not is_whole(cell, cells)})
    axes.set_xlabel(
        "above: success [%] on the test episodes; framed: the best without hidden knowledge, and agents level with it; "
        "blank: not there"
        + (f"; *: on the first {' or '.join(map(str, few))}" if few else "")
        + "\nbelow: median steps to the target, in dynamics mostly seconds until the tip stays on it, where it does"
    )
    return figure


def _framed(cells: Mapping[str, Cell]) -> list[str]:
    """The columns of the best analytic controllers of an id, and of agents as the verdict in the table says."""
    fair = [cell for cell in cells.values() if cell.kind == "baseline"]
    best = max((cell.success.point for cell in fair), default=0.0)
    framed = [] if (verdict := verdict_of(cells)) == "agent" else [c.name for c in fair if c.success.point == best]
    return framed + ([AGENT] if verdict in ("agent", "level") else [])


def _square(x: int, y: int, style: Mapping[str, object]) -> Rectangle:
    return Rectangle((x - 0.47, y - 0.47), 0.94, 0.94, **style)  # type: ignore[arg-type]


def _short(env_id: str) -> str:
    return env_id.rpartition("/")[2].removesuffix("-v0")


@styled
def uncertainty_figure(records: Mapping[str, Sequence[Record]]) -> Figure:
    """Success against the level of uncertainty, one panel for each id that was measured at several.

    Of several closed forms there is one curve in each panel, of that which does best at its levels.
    """
    found = {env_id: group for env_id, group in records.items() if any(len(one.successes) > 2 for one in group)}
    if not found:
        figure = new_figure(5.0, 3.0)
        note(figure.subplots(), "no records at several levels")
        return figure
    columns = 2 if len(found) == 4 else min(len(found), _COLUMNS)
    rows = -(-len(found) // columns)
    figure = new_figure(3.6 * columns + 1.8, 2.9 * rows)
    panels = np.atleast_1d(figure.subplots(rows, columns, sharey=True)).ravel()
    curves = {env_id: _curves(group) for env_id, group in found.items()}
    kinds = {name: cell.kind for own in curves.values() for name, line in own.items() for cell in line.values()}
    look = looks(dict(sorted(kinds.items(), key=lambda pair: pair[1] != AGENT)))
    for k, (axes, (env_id, own)) in enumerate(zip(panels, curves.items(), strict=False)):
        for name, line in own.items():
            x, success = list(line), [cell.success for cell in line.values()]
            chosen, y = look[name], 100 * np.array([one.point for one in success])
            axes.plot(x, y, marker=chosen.marker, markersize=4, label=name.replace("_", " "), **chosen.line)
            low, high = (100 * np.array([getattr(one, end) for one in success]) for end in ("low", "high"))
            axes.fill_between(x, low, high, color=chosen.colour, alpha=0.15, linewidth=0)
        axes.set_title(_short(env_id), fontsize=9)
        axes.set(
            xlabel="level of uncertainty", ylim=(-2, 102), xticks=sorted({x for line in own.values() for x in line})
        )
        if k % columns == 0:
            axes.set_ylabel("success [%]")
    for axes in panels[len(found) :]:
        axes.set_visible(False)
    handles = {h.get_label(): h for axes in panels for h in axes.get_legend_handles_labels()[0]}
    legend(panels[columns - 1], [handles[name.replace("_", " ")] for name in look if name in kinds])
    return figure


def _with_own_level(record: Record) -> Record:
    """The record in which the environment as it is counts as the level that its id has."""
    spec = gym.registry.get(record.env)
    own = "" if spec is None else str(spec.kwargs.get("level", ""))
    return record if not own or own in record.successes else record.with_level(own, record, "")


def _curves(records: Sequence[Record]) -> dict[str, dict[int, Cell]]:
    """The cells by controller and level of an id; of several closed forms the best one, as "closed_form"."""
    records = [_with_own_level(one) for one in records]
    levels = sorted({level for one in records for level in one.successes if level})
    lines: dict[str, dict[int, Cell]] = {}
    for level in levels:
        for name, cell in cells_of(records, level).items():
            lines.setdefault(name, {})[int(level)] = cell
    closed = {name: lines.pop(name) for name in list(lines) if name.startswith(_CLOSED)}
    if closed:
        best = max(closed.values(), key=lambda line: (len(line), sum(cell.success.point for cell in line.values())))
        lines[_CLOSED] = best
    return lines
