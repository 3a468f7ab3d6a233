"""Tables, words, figures, video and report, on made-up runs and on a short real pair."""

import io
import json
import math
import platform
import subprocess
from html.parser import HTMLParser
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from figure_laws import faults
from matplotlib.figure import Figure
from PIL import Image
from rich.console import Console

from tensegrity_agents.evaluation.results import COLUMNS, Run
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.evaluation.statistics import wilson_interval
from tensegrity_agents.reporting import figures, path_figures, report, style, table, video
from tensegrity_envs.mechanics.two_x import MURALIDHARAN2022, TwoX, TwoXDesign

ENV = "tensegrity/TwoXReach-v0"
NAMES = ["agent", "closed_form_ik", "pseudo_inverse", "observer", "oracle", "random", "my_$module:Class", "b" * 60]
KINDS = ["agent", "baseline", "baseline", "baseline", "oracle", "random", "baseline", "baseline"]


def made_up(
    name="agent", kind="agent", successes=90, episodes=100, training_seed=None, reason="", first_seed=7, **columns
):
    """A run that succeeds in its first episodes, in 20 steps, and in the others ends 50 mm off after 100 steps."""
    success = np.arange(episodes) < successes
    values = {key: np.full(episodes, 0.5) for key in COLUMNS} | {
        "score": np.full(episodes, np.nan),
        "settling_time_s": np.full(episodes, np.nan),
        "success": success.astype(float),
        "success_ever": success.astype(float),
        "final_error_m": np.where(success, 0.001, 0.05),
        "steps_to_target": np.where(success, 20.0, np.nan),
        "steps": np.full(episodes, 100.0),
        "unstable_share": np.zeros(episodes),
        "infeasible_share": np.zeros(episodes),
    }
    values |= {key: np.broadcast_to(np.asarray(value, float), episodes).copy() for key, value in columns.items()}
    reasons = ["" if ok else reason for ok in success]
    return Run(
        name, kind, values, first_seed + np.arange(episodes), reasons, 3.2, training_seed, notes=f"what {name} knows"
    )


def a_field(count, successes=90):
    """Runs of `count` controllers; `successes` is a number or one for each."""
    numbers = np.broadcast_to(successes, count)
    return [made_up(n, k, int(s)) for n, k, s in zip(NAMES[:count], KINDS[:count], numbers, strict=True)]


# ------------------------------------------------------------------------------------------------------------ table


def test_row_of_one_run():
    unstable = np.r_[np.zeros(90), np.full(10, 0.25)]
    steps = np.r_[np.full(90, 100.0), np.full(10, 4.0)]
    margins = np.arange(100) / 100
    run = made_up(
        training_seed=3, reason="unstable", unstable_share=unstable, steps=steps, min_stability_margin=margins
    )
    (row,) = table.summary_rows([run], reach=0.6)
    assert row["success"] == 0.9 and row["interval"] == "Wilson" and row["label"] == "1 training run"
    assert (row["success_low"], row["success_high"]) == wilson_interval(90, 100)
    assert row["error_median_mm"] == pytest.approx(1) and row["error_p95_mm"] == pytest.approx(50)
    assert row["error_p95_share"] == pytest.approx(0.05 / 0.6)
    assert row["reasons"] == {"unstable": 0.1} and table.shares_text(row["reasons"]) == "unstable 10.0 %"
    assert row["steps_median"] == 20 and row["ended_early"] == 0.1 and row["notes"] == "what agent knows"
    assert row["unstable"] == pytest.approx(10 / 9040)  # one step in each of ten episodes, of all steps
    assert row["stability_margin_p5"] == 0.04 and row["microseconds"] == 3.2 and row["effort"] == 0.5
    assert math.isnan(row["normalized"]) and row["agent_better"] is None


def test_rows_group_training_runs():
    runs = [made_up("ppo", "agent", 80 + k, training_seed=k) for k in range(8)]
    runs.insert(3, made_up("ik", "baseline", 100))
    row, baseline = table.summary_rows(runs)
    successes = np.stack([run.columns["success"] for run in runs if run.controller == "ppo"])
    assert row["success"] == pytest.approx(successes.mean()) and row["interval"] == "bootstrap"
    assert row["success_low"] < row["success"] < row["success_high"]
    assert row["training_runs"] == 8 and row["label"] == "8 training runs" and row["success_runs"][7] == 0.87
    assert baseline["training_runs"] == 0 and baseline["label"] == ""
    assert baseline["agent_better"].point == pytest.approx(0.5 - (1 - 0.835) / 2)


def test_rows_normalize_between_random_and_oracle():
    rows = table.summary_rows(
        [made_up(successes=70), made_up("o", "oracle", 90), made_up("r", "random", 10), made_up("b", "baseline", 10)]
    )
    assert [row["normalized"] for row in rows] == pytest.approx([0.75, 1, 0, 0])
    equal = table.summary_rows([made_up(successes=70), made_up("o", "oracle", 10), made_up("r", "random", 10)])
    assert all(math.isnan(row["normalized"]) for row in equal)


def test_rows_of_a_run_that_never_arrives():
    (row,) = table.summary_rows([made_up(successes=0, final_error_m=np.nan)])
    assert row["success"] == 0 and math.isnan(row["steps_median"])
    assert row["error_median_mm"] == row["error_p95_mm"] == math.inf  # a lost arm is not left out


def test_rows_reject_runs_that_do_not_belong_together():
    with pytest.raises(ValueError, match="ppo: its runs must all be on the same episodes"):
        table.summary_rows([made_up("ppo"), made_up("ppo", episodes=50)])
    with pytest.raises(ValueError, match="ppo: runs of different kinds"):
        table.summary_rows([made_up("ppo"), made_up("ppo", "baseline")])


def test_formats():
    shares = {0.0: "0", 1.0: "100", 0.9999: ">99.9", 0.0001: "<0.1", 0.5: "50.0", math.nan: "\u2013"}
    assert {share: table.percent(share) for share in shares} == shares
    lengths = {0.0: "<0.01", 0.0042: "<0.01", 1.234: "1.23", 56.78: "56.8", 567.8: "568", math.inf: "\u221e"}
    assert {length: table.millimetres(length) for length in lengths} == lengths
    metres = {0.0: "<0.00001", 1.234: "0.00123", 56.78: "0.0568", 567.8: "0.568", 20971.0: "21.0", math.inf: "\u221e"}
    assert {v: table.error_text({"error": v, "error_unit": "m"}, "error") for v in metres} == metres


def test_errors_of_large_arms_are_in_metres():
    runs = [made_up("ppo")]
    assert table.summary_rows(runs, 0.7)[0]["error_unit"] == "mm"
    (row,) = table.summary_rows(runs, 30.0)
    assert row["error_unit"] == "m"
    assert "final error [m] median" in table.to_markdown([row])
    figure = figures.error_distribution(runs, tolerance=0.05)
    assert figure.axes[0].get_xlabel() == "final error [m]"


def test_figures_of_a_comparison_keep_the_laws():
    """Axes with units, no legend on data, however long the controllers' names are."""
    runs = [*a_field(5), made_up("PPO agent with model-based features and more of them", "agent")]
    rows = table.summary_rows(runs)
    tips = np.random.default_rng(0).uniform(-0.5, 0.5, (60, 2))
    ends = path_figures.Endings(tips, tips[::-1], tips[::-1] + 0.01, np.arange(60) > 20)
    shade = path_figures.swfw(MURALIDHARAN2022)
    look = style.looks({"an agent of a rather long name": "agent"})
    paths = {"an agent of a rather long name": [tips[:4]]}
    for figure in (
        figures.success_bars(rows),
        figures.error_distribution(runs),
        figures.success_over_steps(runs),
        path_figures.joint_space(MURALIDHARAN2022, paths, look),
        path_figures.tip_paths(shade, paths, tips, look),
        path_figures.workspace(shade, ends, "agent"),
        figures.learning_curve({"seconds": [1, 2], "timesteps": [10, 20], "success": [0, 0.5], "return": [1, 2]}),
    ):
        assert [fault for fault in faults(figure) if "cut off" not in fault] == []  # `save` makes room


def test_a_push_is_held():
    def words(score):
        run = made_up("ppo", episodes=50)
        run.columns["score"] = np.full(50, score)
        return report._endings([run])["names"]

    assert "held" in words(1.2)
    assert "on target" in words(math.nan)


def test_settling_times_are_those_of_all_episodes():
    """Who does not settle has never settled: he counts as infinitely late, and is not left out."""
    late = np.where(np.arange(100) < 80, np.linspace(0.5, 1.29, 100), np.inf)
    rows = table.summary_rows([made_up("agent", "agent", 80, settling_time_s=late), made_up("other", "baseline")])
    assert rows[0]["settling_median"] == pytest.approx(0.5 + 0.79 * 50 / 99) and math.isinf(rows[0]["settling_p90"])
    assert math.isnan(rows[1]["settling_median"])
    text = table.to_markdown(rows)
    assert "settling time [s] median" in text and "| 0.90 | \N{INFINITY} |" in text
    stream = io.StringIO()
    table.print_table(rows, Console(file=stream, width=100))
    assert "since" in stream.getvalue() and "0.90" in stream.getvalue()
    assert max(map(len, stream.getvalue().splitlines())) <= 100 and "3.20" in stream.getvalue()


@pytest.mark.parametrize("count", [1, 2, 8])
def test_printed_table_fits_into_100_columns(count):
    rows = table.summary_rows(a_field(count, 57))
    stream = io.StringIO()
    table.print_table(rows, Console(file=stream, width=100))
    lines = stream.getvalue().splitlines()
    assert max(map(len, lines)) <= 100 and "…" not in stream.getvalue()
    for row in rows[:6]:
        line = next(line for line in lines if line.strip().startswith(row["controller"]))
        assert "57.0 [47.2, 66.3]" in line and "3.20" in line
    assert "1 training run" in stream.getvalue() and ("best baseline" in stream.getvalue()) == (count > 1)


def test_markdown_is_one_table():
    rows = table.summary_rows([made_up("a|b*_"), made_up("c", "baseline", 0)], reach=0.6)
    lines = table.to_markdown(rows).splitlines()
    assert len(lines) == 4 and "**a\\|b\\*\\_** (1 training run)" in lines[2]
    assert len({line.replace("\\|", "").count("|") for line in lines}) == 1


def words(**successes):
    kinds = {"ppo": "agent", "oracle": "oracle", "random": "random"}
    return table.verdict(
        table.summary_rows([made_up(name, kinds.get(name, "baseline"), n, 1000) for name, n in successes.items()])
    )


def test_verdict_is_plain_about_who_wins():
    lost = words(ppo=900, ik=990, slow=700, oracle=1000, random=3)
    assert lost.startswith(
        "The agent ppo (90.0% [88.0, 91.7], one training run) loses to the best baseline, ik (99.0% ["
    )
    assert (
        "by 9.0 percentage points; the 95% intervals do not overlap. It loses to the oracle (100% [99.6, 100])" in lost
    )
    won = words(ppo=990, ik=900)
    assert "beats the best baseline, ik" in won and "oracle" not in won
    close = words(ppo=985, ik=990)
    assert "is behind the best baseline" in close and "by 0.5 percentage points; the 95% intervals overlap" in close
    assert "is ahead of" in words(ppo=990, ik=980) and "1.0 percentage point;" in words(ppo=990, ik=980)
    assert "is level with the best baseline" in words(ppo=990, ik=990)
    assert "look for an error in the simulator" in words(ppo=1000, oracle=900)
    assert "simulator" not in words(ppo=1000, oracle=999)
    assert "beats the random policy, random" in words(ppo=500, random=3)


def test_verdict_goes_by_the_score_where_there_is_one():
    """Both always succeed; one holds more."""
    runs = [made_up("ppo", "agent", 100), made_up("observer", "baseline", 100)]
    for run, held in zip(runs, (1.65, 1.73), strict=True):
        run.columns["score"] = held + np.linspace(-0.01, 0.01, 100)
    rows = table.summary_rows(runs)
    assert table.score_text(rows[1]).startswith("1.73 [1.7")
    assert "loses to the best baseline, observer" in table.verdict(rows)
    assert "0.08 in score (1.65 against 1.73); the 95% intervals do not overlap" in table.verdict(rows)
    console = Console(width=110, record=True)
    table.print_table(rows, console)
    assert "score" in console.export_text()
    assert "score, 95% interval" in table.to_markdown(rows)


def test_verdict_without_agents_or_success():
    assert words(ik=1000, slow=700).startswith("ik (100% [99.6, 100]) beats slow (70.0% [")
    assert words(ik=1000) == "ik (100% [99.6, 100]) ended on the target."
    assert words(ppo=0, ik=0) == "No controller ended on the target in any of the 1,000 episodes."
    assert "no other controller" in words(ppo=5)
    assert table.verdict([]) == "Nothing was evaluated."


def test_best_baseline_is_the_quicker_of_equals():
    runs = [made_up("slow", "baseline", steps_to_target=30), made_up("quick", "baseline"), made_up("o", "oracle", 100)]
    assert table.best_baseline(table.summary_rows(runs))["controller"] == "quick"
    assert table.best_baseline(table.summary_rows([made_up()])) is None
    exact = [made_up(name, "baseline", 100, final_error_m=error) for name, error in (("a", 1e-9), ("b", 1e-12))]
    assert table.best_baseline(table.summary_rows(exact))["controller"] == "a"  # the first of equals


# ---------------------------------------------------------------------------------------------------------- figures


def drawn(figure):
    """Lay out and paint, with every warning an error."""
    figure.canvas.draw()
    return figure


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("count", [1, 2, 5, 8])
@pytest.mark.parametrize("successes", [0, 95])
def test_figures_of_any_number_of_controllers(count, successes):
    runs = a_field(count, successes)
    drawn(figures.success_bars(table.summary_rows(runs)))
    drawn(figures.error_distribution(runs))
    drawn(figures.success_over_steps(runs))


@pytest.mark.filterwarnings("error")
def test_error_distribution_of_extremes():
    drawn(figures.error_distribution([made_up(final_error_m=np.nan), made_up("exact", "baseline", final_error_m=0.0)]))


def curve(figure, label):
    (line,) = [line for line in figure.axes[0].lines if line.get_label() == label]
    return np.asarray(line.get_xdata()), np.asarray(line.get_ydata())


def test_curves_show_the_shares_of_the_table():
    runs = a_field(3, [90, 40, 0])
    for run, share in zip(runs, (90, 40, 0), strict=True):
        x, y = curve(figures.error_distribution(runs), run.controller)
        assert y[x <= 5.0][-1] == share and y[-1] == 100
        x, y = curve(figures.success_over_steps(runs), run.controller)
        assert y[-1] == share and y[x < 20].max() == 0 and x[-1] == 100


def test_looks_differ_and_stay():
    kinds = dict(zip(NAMES, KINDS, strict=True))
    look = style.looks(kinds)
    assert len({(v.colour, str(v.dashes)) for v in look.values()}) == len(look)
    assert style.looks(dict(list(kinds.items())[:3]))["closed_form_ik"] == look["closed_form_ik"]


@pytest.mark.filterwarnings("error")
def test_joint_space_and_workspace():
    paths = {"agent": [np.linspace((-1, -1), (1, 1), 9)], "closed_form_ik": [], "oracle": [np.zeros((1, 2))]}
    look = style.looks(dict(zip(NAMES, KINDS, strict=True)))
    drawn(path_figures.joint_space(MURALIDHARAN2022, paths, look))
    drawn(path_figures.joint_space(MURALIDHARAN2022))
    q = np.random.default_rng(0).uniform(-1, 1, (2, 60))
    tips = np.stack(TwoX(MURALIDHARAN2022).tip((q[0], q[1])), axis=1)
    for failures in (0, 3, 60):
        success = np.arange(60) >= failures
        ends = path_figures.Endings(
            tips, tips[::-1], tips[::-1] + 0.01, success, [tips[:4]] * 60 if failures == 3 else None
        )
        figure = drawn(path_figures.workspace(path_figures.swfw(MURALIDHARAN2022), ends, "agent"))
        labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
        assert any(label.startswith(f"not reached: {failures}") for label in labels) == (failures > 0)


@pytest.mark.filterwarnings("error")
def test_joint_space_of_an_arm_that_nothing_holds():
    limp = TwoXDesign(b=0.05, l=0.1, a=0.2, k1=0.0, k2=0.0, min_tension=1.0, max_tension=1.1, payload=50.0)
    drawn(path_figures.joint_space(limp))
    nothing = np.empty((0, 2))
    drawn(
        path_figures.workspace(
            path_figures.swfw(limp), path_figures.Endings(nothing, nothing, nothing, np.empty(0, bool))
        )
    )


def test_joint_space_has_the_published_edge():
    """[Muralidharan2022]: on alpha_2 = 0 stable and feasible for |alpha_1| <= 2.41225176 rad."""
    _, a1, a2, margin = path_figures._joint_grid(MURALIDHARAN2022)
    middle = a2.shape[1] // 2
    assert abs(a2[0, middle]) < 1e-9
    inside = a1[:, 0][margin[:, middle] > 0]
    spacing = a1[1, 0] - a1[0, 0]
    assert 0 <= 2.41225176 - inside.max() <= spacing and 0 <= inside.min() + 2.41225176 <= spacing


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "progress",
    [
        {},
        {"seconds": [], "timesteps": [], "success": [], "return": []},
        {"seconds": [1.0], "timesteps": [100], "success": [math.nan], "return": [math.nan]},
        {"seconds": [1.0, 2.0], "timesteps": [100, 200], "success": [math.nan, 0.5]},
        {"seconds": [1, 2, 2, 3], "timesteps": [10, 20, 30, 40], "success": [0, 0.1, 0.2, 1], "return": [1, 2, 3, 4]},
    ],
)
def test_learning_curve(progress):
    drawn(figures.learning_curve(progress))
    drawn(figures.learning_curve(progress, {"seconds": [0.0, 4.0], "success": [0.1, 0.9], "return": [1.0, 50.0]}))
    drawn(figures.learning_curve(progress, {"seconds": [], "success": [], "return": []}))


def test_saved_figures_are_pictures_and_reproducible(tmp_path):
    before = dict(mpl.rcParams)
    rows = table.summary_rows(a_field(3))
    first, second = (style.save(figures.success_bars(rows), tmp_path / name) for name in ("v1.0", "again"))
    assert first.name == "v1.0.png" and Image.open(first).size[0] > 1000
    assert ElementTree.parse(tmp_path / "v1.0.svg").getroot().tag.endswith("svg")
    assert first.read_bytes() == second.read_bytes()
    assert (tmp_path / "v1.0.svg").read_bytes() == (tmp_path / "again.svg").read_bytes()
    assert dict(mpl.rcParams) == before


# ------------------------------------------------------------------------------------------------------------ video


class Still:
    """Does nothing, and remembers what it was given."""

    wants_privileged = True

    def __init__(self, size=2):
        self.size, self.begun, self.starts, self.shapes = size, [], [], set()

    def begin_episodes(self, mask, design, privileged):
        self.begun.append((mask.tolist(), design, privileged))

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        self.starts.append(episode_start.tolist())
        self.shapes.add(tuple(observation["observation"].shape))
        return np.zeros((len(observation["desired_goal"]), self.size)), (state or 0) + 1


class Wild:
    """Random actions."""

    def __init__(self):
        self.rng = np.random.default_rng(0)

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return self.rng.uniform(-1, 1, (len(observation["desired_goal"]), 2)), state


def test_video(tmp_path):
    still = Still()
    path = video.record(ENV, {"still": still, "wild": Wild()}, 3, tmp_path / "film.gif", max_steps=8)
    film = Image.open(path)
    assert film.n_frames == 9 and film.size == (602, 326) and path.stat().st_size < 1_000_000
    durations = []
    for k in range(film.n_frames):
        film.seek(k)
        durations.append(film.info["duration"])
    assert durations == [50] * 8 + [900]
    assert still.begun[0][0] == [True] and still.begun[0][1] == still.begun[0][2].design
    assert still.starts == [[True]] + [[False]] * 7 and still.shapes == {(1, 12)}
    assert Image.open(path.with_suffix(".png")).size == (4 * 302 - 2, 2 * 328 - 2)


def test_video_of_a_hidden_load_and_many_controllers(tmp_path):
    many = {f"controller with a rather long name {k}": Still(4) for k in range(5)}
    path = video.record("tensegrity/TwoXPayloadReach-v0", many, 3, tmp_path / "film.gif", max_steps=2)
    assert Image.open(path).size == (3 * 302 - 2, 2 * 328 - 2)
    (still, *_) = many.values()
    _, nominal, true = still.begun[0]
    assert nominal.payload == 0 and true.design.payload.shape == (1,) and 0 < true.design.payload[0] <= 0.4


def test_video_keeps_below_its_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(video, "_MOST_BYTES", 60_000)
    path = video.record(ENV, {"wild": Wild()}, 3, tmp_path / "film.gif", max_steps=30)
    assert Image.open(path).n_frames < 31


def test_video_rejects(tmp_path):
    with pytest.raises(ValueError, match="one at least"):
        video.record(ENV, {}, 0, tmp_path / "film.gif")
    with pytest.raises(ValueError, match=r"a \.gif"):
        video.record(ENV, {"wild": Wild()}, 0, tmp_path / "film.mp4")


# ----------------------------------------------------------------------------------------------------------- report


class Page(HTMLParser):
    """Tags, their attributes and the text of a page."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.attributes, self.text = [], [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, *pair) for pair in attrs]

    def handle_data(self, data):
        self.text += data


def written(folder, runs, **changes):
    arguments = {
        "title": "A comparison",
        "env_id": ENV,
        "rows": table.summary_rows(runs, reach=0.6),
        "runs": runs,
        "metadata": report.collect_metadata("make compare", {"seed": np.int64(1)}, {"test": range(3)}),
        "figures": {},
        "video": None,
        "training": None,
        "command": "make compare",
    }
    return report.write_report(folder, **(arguments | changes)).read_text("utf-8")


def assert_self_contained(text):
    page = Page(text)
    assert not {"script", "link", "iframe", "object", "a"} & set(page.tags)
    for tag, key, value in page.attributes:
        assert not key.startswith("on")
        if key in ("src", "href", "srcset", "action"):
            assert tag == "img" and value.startswith("data:image/")
    assert "http:" not in text and "https:" not in text and "url(" not in text and "@import" not in text
    return page


def test_report_of_a_real_pair(tmp_path):
    runs = [
        evaluate(Still(), ENV, 20, 5, "still", "baseline"),
        evaluate(Wild(), ENV, 20, 5, "wild", "random"),
        made_up("agent", "agent", 19, 20, training_seed=0, reason="buckled", first_seed=5),
    ]
    rows = table.summary_rows(runs, reach=0.6)
    pictures = {
        "success": style.save(figures.success_bars(rows), tmp_path / "success"),
        "learning_curve": style.save(
            figures.learning_curve({"seconds": [1, 2], "timesteps": [5, 9], "success": [0, 1]}), tmp_path / "learning"
        ).with_suffix(".svg"),
    }
    film = video.record(ENV, {"still": Still()}, 5, tmp_path / "film.gif", max_steps=2)
    training = {"config": {"gamma": 0.8}, "seconds": 10.0, "timesteps": 1000, "runs": 1, "algorithm": "PPO"}
    text = written(tmp_path / "new", runs, rows=rows, figures=pictures, video=film, training=training)
    page = assert_self_contained(text)
    assert page.tags.count("img") == 4
    for part in (
        table.verdict(rows),
        "One training run",
        "What each controller knows",
        "what agent knows",
        "buckled [%]",
        "P(agent better)",
        "95.0",
        "100 steps per second",
        '"gamma": 0.8',
        "make compare",
        "numpy",
        platform.python_version(),
    ):
        assert part in page.text, part


def test_report_escapes_everything(tmp_path):
    evil = '<script>alert("1")</script>'
    run = made_up(evil, "agent", reason=evil)
    run.notes = evil
    figure = style.save(Figure(), tmp_path / "empty")
    text = written(
        tmp_path,
        [run, made_up(evil + "2", "baseline")],
        title=evil,
        env_id=evil,
        command=evil,
        metadata=report.collect_metadata(evil, {evil: evil}, {evil: evil}),
        figures={'x" onerror="alert(1)': figure},
        training={"config": {evil: evil}, evil: evil},
        captions={},
    )
    page = assert_self_contained(text)
    assert evil in page.text


@pytest.mark.parametrize("count", [1, 8])
def test_report_of_failures_alone(tmp_path, count):
    page = assert_self_contained(written(tmp_path, a_field(count, 0), metadata={}))
    assert "No controller ended on the target" in page.text and "Training" not in page.text.split()


def test_report_of_several_training_runs(tmp_path):
    runs = [made_up("ppo", "agent", 80 + k, training_seed=k) for k in range(5)] + [made_up("ik", "baseline", 100)]
    page = assert_self_contained(written(tmp_path, runs, training={"runs": 5}))
    assert "5 training runs with different seeds" in page.text and "80.0, 81.0, 82.0, 83.0, 84.0" in page.text
    assert "bootstrap over runs and episodes" in page.text and "another training seed" not in page.text


def test_report_rejects_what_browsers_do_not_show(tmp_path):
    with pytest.raises(ValueError, match="a picture must be one of"):
        written(tmp_path, a_field(1), figures={"success": tmp_path / "success.pdf"})


def test_metadata_is_json_and_complete():
    metadata = report.collect_metadata("make compare", {"path": np.array([1, 2])}, range(3))
    assert json.loads(json.dumps(metadata)) == metadata
    assert metadata["config"] == {"path": [1, 2]} and metadata["seeds"] == [0, 1, 2]
    assert set(metadata) == {
        *("command", "config", "seeds", "versions", "git", "python", "platform", "cpu_count", "time")
    }  # no host, no user
    assert metadata["versions"]["numpy"] == np.__version__ and metadata["cpu_count"] >= 1


def test_git_revision(tmp_path):
    def git(*arguments):
        identity = ["-c", "user.name=x", "-c", "user.email=x@example.org"]
        subprocess.run(["git", "-C", tmp_path, *identity, *arguments], check=True, capture_output=True)

    file = tmp_path / "module.py"
    file.write_text("1")
    assert report._git_revision(file) is None
    git("init")
    assert report._git_revision(file) is None  # not tracked: somebody else's repository
    git("add", ".")
    git("commit", "-m", "x")
    clean = report._git_revision(file)
    assert clean is not None and len(clean["revision"]) == 40 and clean["dirty"] is False
    file.write_text("2")
    assert report._git_revision(file) == clean | {"dirty": True}
