"""The matrix of who wins where: its numbers by other routes, verdicts, and figures that say what the table says."""

import numpy as np
import pytest
from matplotlib.image import imread

from tensegrity_agents.evaluation.records import Record, packed
from tensegrity_agents.reporting.matrix import (
    AGENT,
    best_controller,
    cells_of,
    lead,
    matrix_figure,
    matrix_to_markdown,
    uncertainty_figure,
    verdict_of,
)
from tensegrity_agents.reporting.style import save

EPISODES = 400


def row(controller, share, kind="baseline", seed=None, levels=("",), knows=""):
    flags = np.random.default_rng(7 if seed is None else seed).random(EPISODES) < share
    return Record(
        "tensegrity/MastReach-v0",
        controller,
        kind,
        EPISODES,
        dict.fromkeys(levels, packed(flags)),
        "",
        knows,
        12.0,
        seed=seed,
    )


def agents(*shares, **more):
    return [row("PPO agent", share, AGENT, seed, **more) for seed, share in enumerate(shares)]


def test_success_is_the_mean_over_seeds_and_none_is_dropped():
    group = agents(0.9, 0.0, 0.95)
    cell = cells_of(group)[AGENT]
    assert cell.success.point == pytest.approx(np.mean([one.flags().mean() for one in group]))
    assert cell.flags.shape == (3, EPISODES)
    assert cell.worst == 0.0


@pytest.mark.parametrize(
    ("shares", "controller", "wins"),
    [
        ((0.95, 0.96), 0.6, "agent"),
        ((0.6, 0.55), 0.95, "controller"),
        ((0.9, 0.9), 0.9, "level"),
        ((0.99, 0.99, 0.99, 0.5), 0.6, "level"),  # ahead in the mean, but the worst seed is not
    ],
)
def test_verdicts(shares, controller, wins):
    group = [*agents(*shares), row("servo", controller), row("oracle", 1.0, "oracle"), row("random", 0.0, "random")]
    cells = cells_of(group)
    assert best_controller(cells).name == "servo"  # not the oracle, which is told more
    paired = np.mean([one.flags().mean() for one in group[: len(shares)]]) - group[len(shares)].flags().mean()
    assert lead(cells).point == pytest.approx(paired)
    assert verdict_of(cells) == wins


def test_an_id_without_agents_has_no_verdict():
    cells = cells_of([row("servo", 0.5)])
    assert lead(cells) is None
    assert verdict_of(cells) == "\N{EN DASH}"
    assert cells_of([]) == {}


def test_rows_of_different_lengths_are_not_mixed():
    short = Record("tensegrity/MastReach-v0", "servo", "baseline", 8, {"": "ff"}, "")
    with pytest.raises(ValueError, match=r"MastReach-v0: records of different numbers"):
        cells_of([*agents(0.5), short])


def test_the_table_names_seeds_verdicts_and_what_is_known():
    group = [*agents(0.95, 0.96), row("p_servo", 0.6, knows="the nominal model"), row("oracle", 1.0, "oracle")]
    text = matrix_to_markdown({"tensegrity/MastReach-v0": group})
    line = next(line for line in text.splitlines() if "MastReach" in line)
    cells = [cell.strip() for cell in line.split("|")]
    assert cells[3] == "2"
    assert cells[8] == "agent"
    assert "p\\_servo" in cells[5]
    assert "| p\\_servo | the nominal model | `MastReach-v0` |" in text


def texts(figure):
    return [text.get_text() for axes in figure.axes for text in axes.texts]


def test_figures_show_every_cell_and_level():
    levels = ("", "0", "1", "2", "3")
    group = [*agents(1.0, levels=levels), row("servo", 0.0, levels=levels)]
    records = {"tensegrity/MastReach-v0": group}
    assert sorted(texts(matrix_figure(records))) == ["0", "100"]
    (axes,) = uncertainty_figure(records).axes
    assert [list(line.get_xdata()) for line in axes.lines] == [[0, 1, 2, 3]] * 2
    assert [list(line.get_ydata()) for line in axes.lines] == [[100.0] * 4, [0.0] * 4]
    assert texts(matrix_figure({})) == ["no records"]
    assert texts(uncertainty_figure({"tensegrity/MastReach-v0": agents(1.0)})) == ["no records at several levels"]


def test_a_picture_has_no_empty_margins(tmp_path):
    names = ["closed_form_ik", "identifying_observer", "pseudo_inverse"]
    records = {"tensegrity/DualTriangleLoadedReachUncertain-v0": [row(name, 0.5) for name in names]}
    drawn = imread(save(matrix_figure(records), tmp_path / "matrix"))[..., :3]
    rows, columns = (np.flatnonzero((drawn != drawn[0, 0]).any(axis=(2, axis))) for axis in (1, 0))
    for used, size in ((rows, drawn.shape[0]), (columns, drawn.shape[1])):
        assert used[0] < 60 and size - used[-1] < 60  # pixels, of 200 per inch
