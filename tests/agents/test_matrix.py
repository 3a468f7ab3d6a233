"""The matrix of who wins where: its numbers by other routes, verdicts, and figures that say what the table says."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread
from typer.testing import CliRunner

from tensegrity_agents.command.program import app
from tensegrity_agents.evaluation.records import Record, packed, packed_times, read_records
from tensegrity_agents.pretrained import load_pretrained
from tensegrity_agents.reporting.ablations import ablations_to_markdown
from tensegrity_agents.reporting.matrix import (
    AGENT,
    best_controller,
    cells_of,
    lead,
    matrix_to_markdown,
    verdict_of,
)
from tensegrity_agents.reporting.matrix_figures import matrix_figure, uncertainty_figure
from tensegrity_agents.reporting.style import looks, save

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


def shortened(record, episodes):
    return replace(
        record, episodes=episodes, successes={k: packed(record.flags(k)[:episodes]) for k in record.successes}
    )


def test_a_controller_on_the_first_episodes_is_compared_on_these():
    agent, mpc, servo = agents(0.6), shortened(row("mpc", 0.7, seed=3), 48), row("servo", 0.6, seed=4)
    cells = cells_of([*agent, mpc, servo])
    ours = agent[0].flags()
    leads = {"mpc": ours[:48].mean() - mpc.flags().mean(), "servo": ours.mean() - servo.flags().mean()}
    strongest = min(leads, key=leads.get)
    assert best_controller(cells).name == strongest
    assert lead(cells).point == pytest.approx(leads[strongest])
    alone = [*agent, mpc]
    assert lead(cells_of(alone)).point == pytest.approx(leads["mpc"])
    line = next(line for line in matrix_to_markdown({"tensegrity/MastReach-v0": alone}).splitlines() if "Mast" in line)
    assert "on the first 48 episodes" in line
    figure = matrix_figure({"tensegrity/MastReach-v0": alone})
    assert any(text.endswith("*") for text in texts(figure))
    assert "first 48" in figure.axes[0].get_xlabel()
    with pytest.raises(ValueError, match="agents on different numbers"):
        cells_of([*agent, shortened(row("PPO agent", 0.5, AGENT, 5), 48)])


def test_a_cell_says_how_long_it_takes():
    times = np.array([0.5, np.inf, 0.7, 0.9] * (EPISODES // 4))
    fast = [replace(one, settling={"": packed_times(times)}) for one in agents(0.9, 0.8)]
    cell = cells_of(fast)[AGENT]
    assert cell.time_text == "0.70 s"
    assert "0.70 s" in texts(matrix_figure({"tensegrity/MastReach-v0": fast}))
    assert cells_of(agents(0.9))[AGENT].time_text == "12"
    never = replace(row("servo", 0.0), steps_to_target=None)
    assert cells_of([never])["servo"].time_text == "\N{EN DASH}"
    # beside agents that were measured in steps alone, steps
    servo = replace(row("servo", 0.9), settling={"": packed_times(times)})
    line_of = {True: "0.70 s, 0.70 s", False: "12, 12"}
    for group, timed in ((fast, True), (agents(0.9), False)):
        assert line_of[timed] in matrix_to_markdown({"tensegrity/MastReach-v0": [*group, servo]})


@pytest.mark.parametrize(
    ("env_id", "corrected"),
    [
        ("TwoXReach-v0", ""),
        ("DualTriangleFastReachMuJoCo-v0", "closed_form_plan"),
        ("PlanarFourBarLoadedReach-v0", "observer"),
    ],
)
def test_the_matrix_tells_which_controller_agents_correct(env_id, corrected):
    group = [replace(one, knows=load_pretrained(env_id).knows) for one in agents(0.9, 0.8)]
    assert cells_of(group)[AGENT].corrects == corrected
    text = matrix_to_markdown({"tensegrity/MastReach-v0": group}).replace("\\", "")
    assert ("; corrects" in text) == bool(corrected) and corrected in text


@pytest.mark.parametrize("place", ["backup/servo.json", "TwoXReach-v0/servo-copy.json", "TwoXReach-v0/oracle.json"])
def test_a_row_that_would_count_twice_is_named_with_the_other(tmp_path, place):
    one = replace(row("servo", 0.9), env="tensegrity/TwoXReach-v0")
    own = one.file(tmp_path)
    one.write(own)
    assert read_records(tmp_path) == {one.env: [one]}
    one.write(tmp_path / place)
    done = CliRunner().invoke(app, ["matrix", "--records", str(tmp_path), "--out", str(tmp_path / "out")])
    assert done.exit_code == 2
    assert f"error: {tmp_path / place}: holds the row of {own}, which is there, too; keep the right one" in done.output
    assert not (tmp_path / "out" / "matrix.md").exists()


@pytest.mark.parametrize("place", ["ThreeXReach-v0/agent-1.json", "TwoXReach-v0/agent-2.json"])
def test_a_row_that_is_not_in_its_own_file_is_named(tmp_path, place):
    one = replace(row("PPO agent", 0.9, AGENT, 1), env="tensegrity/TwoXReach-v0")
    one.write(tmp_path / place)
    with pytest.raises(
        ValueError, match=r"holds the row of \S*TwoXReach-v0/agent-1\.json, which is not there; move it"
    ):
        read_records(tmp_path)


def test_rows_of_environments_of_ones_own_are_in_the_tables(tmp_path):
    """The matrix draws rows alone, so nobody needs to have registered the ids."""
    times = {"": packed_times(np.ones(EPISODES))}
    own = [replace(one, env="mine/Elbow-v0", settling=times) for one in (*agents(0.9), row("mine:Still", 0.1))]
    for one in own:
        for folder in (tmp_path, tmp_path / "ablations" / "no_plan") if one.kind == AGENT else (tmp_path,):
            one.write(one.file(folder))
    assert (tmp_path / "Elbow-v0" / "mine-Still.json").is_file()
    assert "`Elbow-v0`" in matrix_to_markdown(read_records(tmp_path))
    assert "| no plan | 0.0 million |" in ablations_to_markdown(tmp_path / "ablations", {})


def test_controllers_look_different():
    kinds = {f"c{k}": "baseline" for k in range(10)} | {"oracle": "oracle", "informed": "oracle", "a": "agent"}
    drawn = looks(kinds)
    assert len({look.colour for look in drawn.values()}) == len(kinds)
    # Blue and indigo are hard to tell apart, so they have neither dashes nor markers in common.
    blue, indigo = drawn["c0"], drawn["c5"]
    assert blue.dashes != indigo.dashes
    assert blue.marker != indigo.marker


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
    assert sorted(texts(matrix_figure(records))) == ["0", "100", "12", "12"]
    (axes,) = uncertainty_figure(records).axes
    assert [list(line.get_xdata()) for line in axes.lines] == [[0, 1, 2, 3]] * 2
    assert [list(line.get_ydata()) for line in axes.lines] == [[100.0] * 4, [0.0] * 4]
    assert texts(matrix_figure({})) == ["no records"]
    assert texts(uncertainty_figure({"tensegrity/MastReach-v0": agents(1.0)})) == ["no records at several levels"]


def test_an_uncertain_environment_as_it_is_counts_as_its_own_level():
    """A row may be measured at levels 0 and 3 beside the environment as it is, which is at level 2."""
    env_id = "tensegrity/TwoXTensionReachUncertain-v0"
    group = [replace(row("servo", 0.5, levels=("", "0", "3")), env=env_id)]
    (axes,) = uncertainty_figure({env_id: group}).axes
    assert [list(line.get_xdata()) for line in axes.lines] == [[0, 2, 3]]


def test_of_several_closed_forms_the_best_has_a_curve():
    levels = ("", "0", "1")
    group = [row("closed_form_max", 0.2, levels=levels), row("closed_form_sum", 0.9, levels=levels)]
    (axes,) = uncertainty_figure({"tensegrity/MastReach-v0": [*group, row("servo", 0.5, levels=levels)]}).axes
    assert {line.get_label(): line.get_ydata()[0] for line in axes.lines} == {
        "closed form": pytest.approx(100 * group[1].flags().mean()),
        "servo": pytest.approx(100 * row("servo", 0.5).flags().mean()),
    }


def test_titles_of_panels_keep_apart():
    levels = ("", "0", "1")
    names = ["DualTriangleLoadedReachUncertainMuJoCo", "DualTriangleLoadedReachUncertain"]
    for count in (2, 3, 4, 5):
        figure = uncertainty_figure(
            {f"tensegrity/{names[k % 2]}-v{k}": [row("servo", 0.5, levels=levels)] for k in range(count)}
        )
        figure.draw_without_rendering()
        boxes = [axes.title.get_window_extent().padded(6) for axes in figure.axes if axes.get_visible()]
        assert len(boxes) == count
        assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])


def test_a_picture_has_no_empty_margins(tmp_path):
    names = ["closed_form_ik", "identifying_observer", "pseudo_inverse"]
    records = {"tensegrity/DualTriangleLoadedReachUncertain-v0": [row(name, 0.5) for name in names]}
    drawn = imread(save(matrix_figure(records), tmp_path / "matrix"))[..., :3]
    rows, columns = (np.flatnonzero((drawn != drawn[0, 0]).any(axis=(2, axis))) for axis in (1, 0))
    for used, size in ((rows, drawn.shape[0]), (columns, drawn.shape[1])):
        assert used[0] < 60 and size - used[-1] < 60  # pixels, of 200 per inch
