"""Every figure of every analysis: axes with units, titles that differ, no legend on data, PNG, SVG and PDF."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from figure_laws import faults
from PIL import Image

from tensegrity_agents.analysis import analyze, base
from tensegrity_agents.reporting.style import save, without_jumps

MECHANISMS = {
    "two-x": ["muralidharan2022", "furet2018,b=0.9"],
    "dual-triangle": ["zhao2021_caption"],
    "planar-four-bar": ["ji2014"],
    "spatial-prism": ["jahromy"],
}


# Those of one mechanism are drawn once, in one process.
GROUPS = [pytest.param(name, marks=pytest.mark.xdist_group(f"figures-{name}")) for name in MECHANISMS]


@pytest.fixture(scope="module", params=GROUPS)
def drawn(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    figures = []

    def keep(figure, stem, title=""):
        figures.append((stem, title, faults(figure)))
        return save(figure, stem, title)

    patch = pytest.MonkeyPatch()
    patch.setattr(base, "save", keep)
    analyze(request.param, MECHANISMS[request.param], folder, lambda *step: None)
    patch.undo()
    return folder, figures


def test_axes_have_units_and_legends_cover_nothing(drawn):
    assert {stem.name: found for stem, _, found in drawn[1] if found} == {}


def test_titles_differ(drawn):
    titles = [title for _, title, _ in drawn[1]]
    assert all(titles)
    assert len(set(titles)) == len(titles)


def test_there_are_three_formats_with_the_title_within(drawn):
    for stem, title, _ in drawn[1]:
        png, svg, pdf = (stem.with_name(f"{stem.name}.{ending}") for ending in ("png", "svg", "pdf"))
        assert Image.open(png).text["Title"] == title
        assert title in svg.read_text()
        assert pdf.read_bytes().startswith(b"%PDF")


def test_every_mechanism_has_a_workspace_and_a_page(drawn):
    folder, figures = drawn
    assert any("workspace" in stem.name or "boundaries" in stem.name for stem, _, _ in figures)
    pages = list(folder.rglob("browse.html"))
    assert pages
    for page in pages:
        assert 'id="work"' in page.read_text()


def test_boundaries_are_curves_not_cells(drawn):
    for stem, _, _ in drawn[1]:
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
def test_pages_have_ticks_and_show_arms(drawn, request):
    mechanism = request.node.callspec.params["drawn"]
    (x, y), count = PLACES[mechanism]
    page = next(iter(sorted(drawn[0].rglob("browse.html"), reverse=True)))
    script = Path(__file__).with_name("browse_in_node.js")
    done = subprocess.run([NODE, script, page, str(x), str(y)], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    shown = json.loads(done.stdout)
    assert len(shown["ticks"]) >= 8
    assert any(label.endswith("[m]") for label in shown["labels"])
    found = int(re.search(r'id="count">(\d+)<', shown["info"]).group(1))
    assert found == count if count else found > 0
    assert shown["arms"] >= 6 * found
