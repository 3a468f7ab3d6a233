"""The site's notebooks run, its pages are all in its navigation, and it says of papers what CITATION.cff says."""

import importlib.util
import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
import yaml

import tensegrity_envs

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
MADE = {"_build", "envs", "agents", "environments"}  # folders that the site's build writes
NOTEBOOKS = sorted(path for path in DOCS.rglob("*.ipynb") if "_build" not in path.parts)


def cells(path, kind):
    return ["".join(cell["source"]) for cell in json.loads(path.read_text())["cells"] if cell["cell_type"] == kind]


@pytest.mark.parametrize(
    "path",
    [pytest.param(p, marks=pytest.mark.full) if "agent" in p.stem else p for p in NOTEBOOKS],
    ids=lambda path: path.stem,
)
def test_notebooks_run(path, tmp_path):
    code = "import matplotlib; matplotlib.use('Agg')\n" + "\n".join(cells(path, "code"))
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_kept_without_outputs(path):
    content = json.loads(path.read_text())
    for cell in content["cells"]:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None


def pages():
    return [path for path in (*DOCS.rglob("*.md"), *NOTEBOOKS) if not MADE & set(path.parts)]


def test_every_page_is_in_the_navigation():
    named = {DOCS / "index"}
    for page in DOCS.rglob("*.md"):
        for block in re.findall(r"```\{toctree\}\n(.*?)```", page.read_text(), re.DOTALL):
            for line in block.splitlines():
                if line and not line.startswith(":"):
                    named.update(p.with_suffix("") for p in page.parent.glob(f"{line}.*")) or named.add(line)
    assert {page.with_suffix("") for page in pages()} <= named


def test_links_between_pages_lead_somewhere():
    for page in pages():
        text = page.read_text() if page.suffix == ".md" else "\n".join(cells(page, "markdown"))
        for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text):
            assert re.match(r"https?://", target) or (page.parent / target).exists(), f"{page.name}: {target}"


def test_citations_agree():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    text = (DOCS / "citing.md").read_text()
    assert str(citation["version"]) == tensegrity_envs.__version__
    assert len(citation["references"]) == 5
    for paper in citation["references"]:
        for mark in (
            paper["authors"][0]["family-names"],
            paper.get("doi", ""),
            *(identifier["value"] for identifier in paper.get("identifiers", [])),
        ):
            assert mark in text


@pytest.mark.full
@pytest.mark.skipif(importlib.util.find_spec("sphinx") is None, reason="no Sphinx: pip install -e .[docs]")
def test_the_site_is_built_without_a_warning(tmp_path):
    command = [sys.executable, "-m", "sphinx", "-W", "-D", "nb_execution_mode=off", str(DOCS), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=900)
    assert done.returncode == 0, done.stderr
    assert not list(broken_links(tmp_path))


class Anchors(HTMLParser):
    """What a page links to, and what can be linked to in it."""

    def __init__(self):
        super().__init__()
        self.links, self.ids = [], set()

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.ids.add(given.get("id"))
        self.links += [given[name] for name in ("href", "src") if given.get(name)]


def broken_links(site):
    """(page, link) of all local links that lead nowhere, to a part of a page included."""
    pages = {path: Anchors() for path in site.rglob("*.html")}
    for path, found in pages.items():
        found.feed(path.read_text())
    for path, found in pages.items():
        for link in found.links:
            parts = urlsplit(link)
            if parts.scheme:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            missing = parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].ids
            if missing or not target.exists():
                yield path.name, link


def test_broken_links_are_found(tmp_path):
    (tmp_path / "a.html").write_text('<p id="here"></p><a href="b.html#there">b</a><img src="c.png"><a href="#here">')
    assert len(list(broken_links(tmp_path))) == 2
    (tmp_path / "b.html").write_text('<a href="a.html#nowhere">a</a> <a href="https://no.where">')
    (tmp_path / "c.png").write_bytes(b"")
    assert {link for _, link in broken_links(tmp_path)} == {"b.html#there", "a.html#nowhere"}
