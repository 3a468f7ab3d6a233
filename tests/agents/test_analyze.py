"""`tensegrity analyze`: what it writes, how it fails, and its page in a headless browser."""

import csv
import json
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from drawn_analyses import DESIGNS, drawn, of_group
from PIL import Image as Picture

from tensegrity_agents.analysis import ANALYSES, analyze, as_text, parse_design
from tensegrity_envs.mechanics.two_x import FURET2018, MURALIDHARAN2022, TwoX

ROOT = Path(__file__).parents[2]
CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
ARM, PLAIN, EMPTY = (d.replace(",", "_") for d in DESIGNS["two-x"])


@pytest.fixture(params=[pytest.param("two-x", marks=of_group("two-x"))])
def results(request):
    folder, _, numbers, shown = drawn(request.param)
    return folder, numbers, shown


def test_progress_reaches_the_end(results):
    _, _, shown = results
    for name in (ARM, PLAIN, EMPTY):
        mine = [step for step in shown if step[0] == name]
        done = [step[1] for step in mine]
        assert done == sorted(done)
        assert mine[-1][1] == mine[-1][2]


def test_numbers(results):
    folder, numbers, _ = results
    assert numbers[ARM]["SWFJ fraction of the square"] == pytest.approx(0.64212, abs=1e-5)
    assert numbers[ARM]["SWFW area [m2]"] == pytest.approx(0.75501, abs=1e-5)
    assert numbers[PLAIN]["cusps"] == 4
    assert numbers[EMPTY]["SWFJ empty"] is True
    for name, table in numbers.items():
        rows = dict(list(csv.reader((folder / name / "numbers.csv").open()))[1:])
        assert rows.keys() == table.keys()
        assert all(as_text(value) in (folder / name / "numbers.md").read_text() for value in table.values())


def test_figures_are_drawn(results):
    folder, _, _ = results
    wanted = {
        ARM: ["muralidharan_fig3_boundary_points", "muralidharan_fig4_swfj_swfw", "active_conditions"],
        EMPTY: ["muralidharan_fig3_boundary_points", "muralidharan_fig4_swfj_swfw", "active_conditions"],
        PLAIN: [
            "furet_fig4_inverse_solutions",
            "furet_fig6_regions_by_type",
            "furet_fig7_joint_limits",
            "posture_change",
        ],
        ".": ["furet_fig3_boundaries"],
    }
    for name, stems in wanted.items():
        for stem in stems:
            picture = np.asarray(Picture.open(folder / name / f"{stem}.png").convert("L"), float)
            assert picture.shape[1] > 900
            assert picture.std() > 5
            assert ElementTree.parse(folder / name / f"{stem}.svg").getroot().tag.endswith("svg")


def test_geojson(results):
    folder, numbers, _ = results
    swfj, swfw, plain = (
        json.loads((folder / name / f"{file}.geojson").read_text())["features"]
        for name, file in ((ARM, "swfj"), (ARM, "swfw"), (PLAIN, "accessibility"))
    )
    assert len(swfj) == 1
    assert shapely.geometry.shape(swfj[0]["geometry"]).area == pytest.approx(numbers[ARM]["SWFJ area [rad2]"], abs=1e-4)
    areas = {f["properties"]["configurations"]: shapely.geometry.shape(f["geometry"]).area for f in swfw}
    assert areas[2] == pytest.approx(numbers[ARM]["SWFW overlap [m2]"], abs=1e-9)
    assert sum(areas.values()) == pytest.approx(numbers[ARM]["SWFW area [m2]"], abs=1e-9)
    assert sum(f["geometry"]["type"] == "Point" for f in plain) == 6
    assert json.loads((folder / EMPTY / "swfw.geojson").read_text())["features"] == []


def test_tables_of_points(results):
    folder, _, _ = results
    rows = list(csv.DictReader((folder / ARM / "boundary_points.csv").open()))
    m = TwoX()
    for row in rows[::17]:
        assert m.tip((float(row["alpha_1"]), float(row["alpha_2"]))) == pytest.approx(
            (float(row["x"]), float(row["y"])), abs=1e-12
        )
    path = np.loadtxt(folder / PLAIN / "posture_change.csv", delimiter=",", skiprows=1)
    assert (path[:, 4] > 0).all() or (path[:, 4] < 0).all()
    assert path[0, 2:4] == pytest.approx(path[-1, 2:4], abs=1e-9)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("nonsense", "must begin with one of"),
        ("muralidharan2022,colour=3", "unknown colour"),
        ("muralidharan2022,b=wide", "field=number"),
        ("muralidharan2022,l=0.04", "l = 0.04"),
        ("furet2018,b=1.5", "l = "),
        ("missing.yaml", "cannot be read"),
    ],
)
def test_designs_that_are_refused(text, match):
    with pytest.raises(ValueError, match=match):
        parse_design(text, ANALYSES["two-x"].designs)


def test_designs_by_name_and_file(tmp_path):
    named = ANALYSES["two-x"].designs
    assert parse_design("muralidharan2022", named) == ("muralidharan2022", MURALIDHARAN2022)
    name, design = parse_design("furet2018,b=0.9", named)
    assert (name, design) == ("furet2018_b=0.9", FURET2018(0.9))
    file = tmp_path / "my arm.yaml"
    file.write_text("b: 0.06\npayload: 0.2\n")
    name, design = parse_design(f"{file},gravity=1.6", named)
    assert (design.b, design.payload, design.gravity, design.l) == (0.06, 0.2, 1.6, 0.1)
    assert "/" not in name
    assert " " not in name
    file.write_text("- 3\n")
    with pytest.raises(ValueError, match="keys and values"):
        parse_design(str(file), named)
    file.write_text("b: wide\n")
    with pytest.raises(ValueError, match="number"):
        parse_design(str(file), named)
    with pytest.raises(ValueError, match="unknown mechanism"):
        analyze("three-x", [], tmp_path, print)


def test_command_line_says_what_is_wrong(tmp_path):
    command = [sys.executable, "scripts/analyze.py", "two-x", "--design", "furet2018,b=2", "--out", str(tmp_path)]
    shown = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert shown.returncode == 2
    assert "error:" in shown.stderr
    assert "Traceback" not in shown.stdout + shown.stderr


class _References(HTMLParser):
    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attrs):
        self.found += [(tag, name, value) for name, value in attrs if name in ("src", "href", "data", "srcset")]


def test_page_is_self_contained(results):
    folder, _, _ = results
    for name in (ARM, PLAIN, EMPTY):
        text = (folder / name / "browse.html").read_text()
        parser = _References()
        parser.feed(text)
        assert parser.found == []
        assert not re.search(r"\b(fetch|XMLHttpRequest|import)\s*\(|@import|url\(", text)
        assert set(re.findall(r"https?://[^\s\"'<]+", text)) == {"http://www.w3.org/2000/svg"}
        assert len(text) < 3e6


def browse(page, tmp_path, extra=""):
    """The page's document after its scripts have run."""
    command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=10000"]
    command += [f"--user-data-dir={tmp_path}/profile", "--window-size=1300,1000", "--dump-dom", f"file://{page}{extra}"]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout


def table(document):
    rows = re.findall(r'<tr class="(in|out)">(.*?)</tr>', document)
    return [(kind, re.findall(r"<td>(.*?)</td>", cells)[1:]) for kind, cells in rows]


needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium")


@needs_chromium
@pytest.mark.parametrize("target", [(0.3, 0.3), (0.2, -0.3), (0.53, -0.1), (0.0, 0.35), (0.3, 0.1), (0.02, 0.0)])
def test_click_on_the_published_arm(results, tmp_path, target):
    """Count, angles, margins and active condition against inverse kinematics."""
    document = browse(results[0] / ARM / "browse.html", tmp_path, f"#{target[0]},{target[1]}")
    m = TwoX()
    expected = m.inverse_kinematics(*target)
    inside = [s for s in expected if s.is_stable_wrench_feasible]
    assert f'<span id="count">{len(inside)}</span>' in document
    rows = table(document)
    assert len(rows) == len(expected)
    assert sum(kind == "in" for kind, _ in rows) == len(inside)
    for (kind, cells), solution in zip(rows, expected, strict=True):
        assert (float(cells[0]), float(cells[1])) == pytest.approx(solution.configuration, abs=2e-4)
        assert cells[2] == solution.state
        assert float(cells[3]) == pytest.approx(solution.singularity, abs=2e-4)
        if kind == "in":
            assert float(cells[4]) == pytest.approx(solution.stability_margin, abs=0.01)
            margins = dict(zip(m.input_names, map(float, cells[5:9]), strict=True))
            assert min(margins.values()) == pytest.approx(solution.wrench_margin, abs=0.01)
            both = margins | {"stability": float(cells[4])}
            assert both[cells[9]] == min(both.values())
    bars = sum(member.kind != "spring" for member in m.members)
    assert document.count('class="arm"') == bars * len(expected)


@needs_chromium
@pytest.mark.parametrize("target", [(0.0, 1.0), (0.0, -1.2), (1.8, 0.1), (-0.6, 0.2), (2.5, 0.0)])
def test_click_on_the_plain_arm(results, tmp_path, target):
    document = browse(results[0] / PLAIN / "browse.html", tmp_path, f"#{target[0]},{target[1]}")
    expected = TwoX(FURET2018(0.9)).inverse_kinematics(*target)
    assert f'<span id="count">{len(expected)}</span>' in document
    rows = table(document)
    assert len(rows) == len(expected)
    for (_, cells), solution in zip(rows, expected, strict=True):
        assert (float(cells[0]), float(cells[1])) == pytest.approx(solution.configuration, abs=2e-3)
        assert cells[2] == solution.state


@needs_chromium
def test_hover_click_and_release(results, tmp_path):
    """Moving shows the count without an arm; a click draws and keeps it; Escape lets go."""
    text = (results[0] / ARM / "browse.html").read_text()
    script = """<script>
      const log = [], box = svg.work.getBoundingClientRect();
      const at = (kind, p) => { const [u, v] = toWork(p);
        const view = svg.work.viewBox.baseVal;
        const place = {clientX: box.left + (u - view.x) * box.width / view.width,
                       clientY: box.top + (v - view.y) * box.height / view.height};
        svg.work.dispatchEvent(new PointerEvent(kind, place));
        log.push(document.getElementById("count").textContent + ":" + document.querySelectorAll(".arm").length); };
      at("pointermove", [0.3, 0.3]); at("click", [0.3, 0.3]); at("pointermove", [0.0, 0.0]);
      document.dispatchEvent(new KeyboardEvent("keydown", {key: "Escape"})); at("pointermove", [0.0, 0.05]);
      document.body.insertAdjacentHTML("beforeend", "<p id='log'>" + log.join(" ") + "</p>");
    </script></body>"""
    page = tmp_path / "page.html"
    page.write_text(text.replace("</body>", script))
    (found,) = re.findall(r'id="log">(.*?)</p>', browse(page, tmp_path))
    assert found == "2:0 2:32 2:32 0:0"


@needs_chromium
def test_page_of_an_empty_set(results, tmp_path):
    document = browse(results[0] / EMPTY / "browse.html", tmp_path, "#0.1,0.3")
    assert '<span id="count">0</span>' in document


@of_group("planar-four-bar")
def test_planar_four_bar():
    folder, _, numbers, _ = drawn("planar-four-bar")
    numbers = numbers["ji2014"]
    assert numbers["actuator workspace, rectangle [m2]"] == pytest.approx(314.159, abs=1e-3)
    assert numbers["output workspace, rectangle [m2]"] == pytest.approx(412.5, abs=0.1)
    for stem in ("ji_fig2_actuator_workspace", "ji_fig3_output_workspace", "singular_configurations", "thrusts"):
        picture = np.asarray(Picture.open(folder / "ji2014" / f"{stem}.png").convert("L"), float)
        assert picture.shape[1] > 900
        assert picture.std() > 5
    regions = json.loads((folder / "ji2014" / "output_paper.geojson").read_text())
    area = sum(shapely.geometry.shape(feature["geometry"]).area for feature in regions["features"])
    assert area == pytest.approx(numbers["output workspace, paper [m2]"], rel=1e-6)
