"""Every figure of every analysis: axes with units, titles that differ, no legend on data, PNG, SVG and PDF."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from drawn_analyses import DESIGNS, drawn, of_group
from PIL import Image

from tensegrity_agents.reporting.style import without_jumps

# Drawing these takes a minute together.
SLOW = ("dual-triangle", "spatial-prism")


@pytest.fixture(
    params=[pytest.param(name, marks=[of_group(name), *[pytest.mark.full] * (name in SLOW)]) for name in DESIGNS]
)
def analysis(request):
    return drawn(request.param)


def test_axes_have_units_and_legends_cover_nothing(analysis):
    assert {stem.name: found for stem, _, found in analysis.figures if found} == {}


def test_titles_differ(analysis):
    titles = [title for _, title, _ in analysis.figures]
    assert all(titles)
    assert len(set(titles)) == len(titles)


def test_there_are_three_formats_with_the_title_within(analysis):
    for stem, title, _ in analysis.figures:
        png, svg, pdf = (stem.with_name(f"{stem.name}.{ending}") for ending in ("png", "svg", "pdf"))
        assert Image.open(png).text["Title"] == title
        assert title in svg.read_text()
        assert pdf.read_bytes().startswith(b"%PDF")


def test_every_mechanism_has_a_workspace_and_a_page(analysis):
    folder, figures, *_ = analysis
    assert any("workspace" in stem.name or "boundaries" in stem.name for stem, _, _ in figures)
    pages = list(folder.rglob("browse.html"))
    assert pages
    for page in pages:
        assert 'id="work"' in page.read_text()


def test_boundaries_are_curves_not_cells(analysis):
    for stem, _, _ in analysis.figures:
        assert not re.search(r"<image", stem.with_name(stem.name + ".svg").read_text()), stem


def test_a_jump_is_not_drawn_as_a_line():
    x = np.linspace(-1, 1, 201)
    broken = without_jumps(np.where(x < 0.1, x, x + 1))
    assert np.flatnonzero(np.isnan(broken)).tolist() == [np.flatnonzero(x >= 0.1)[0]]
    for smooth in (np.sin(9 * x), np.sqrt(x + 1), np.exp(3 * x), np.abs(x), 0 * x):
        assert np.isfinite(without_jumps(smooth)).all()


NODE = shutil.which("node")
# a point, how many configurations there are, and members of one
PLACES = {
    "dual-triangle": ((0.25, 0.05), 1),
    "planar-four-bar": ((0.0, 12.0), None),
    "spatial-prism": ((0.1, 0.1), 1),
    "two-x": ((0.3, 0.3), None),
}


@pytest.mark.skipif(NODE is None, reason="no node to run the page's script")
def test_pages_have_ticks_and_show_arms(analysis, request):
    mechanism = request.node.callspec.params["analysis"]
    (x, y), count = PLACES[mechanism]
    page = analysis.folder / next(iter(analysis.numbers)) / "browse.html"
    script = Path(__file__).with_name("browse_in_node.js")
    done = subprocess.run([NODE, script, page, str(x), str(y)], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    shown = json.loads(done.stdout)
    assert len(shown["ticks"]) >= 8
    assert any(label.endswith("[m]") for label in shown["labels"])
    found = int(re.search(r'id="count">(\d+)<', shown["info"]).group(1))
    assert found == count if count else found > 0
    assert shown["arms"] >= 6 * found
