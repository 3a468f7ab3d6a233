"""How Sphinx makes the site: `make docs`."""

import re
import sys
import tomllib
from pathlib import Path

from sphinx.ext import apidoc

HERE = Path(__file__).parent
ROOT = HERE.parent
sys.path[:0] = [str(HERE), str(ROOT / "envs"), str(ROOT / "agents")]

project = "tensegrity-envs"
author = "the authors of tensegrity-envs"
release = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
]
templates_path = ["_templates"]
exclude_patterns = ["_build", "_templates"]
html_theme = "furo"
html_title = f"tensegrity-envs {release}"
html_show_sphinx = False
html_show_copyright = False
html_static_path = ["_static"]
html_css_files = ["site.css"]
EXTRA = HERE / "_build" / "extra"  # the playground's pages, see `before`
EXTRA.mkdir(parents=True, exist_ok=True)  # Sphinx looks for it before `before` has filled it
html_extra_path = [str(EXTRA)]
copybutton_prompt_text = ""

# Markdown is GitHub's, and readable there; headings can be linked to.
myst_heading_anchors = 4
myst_enable_extensions = ["strikethrough"]

# Notebooks are kept without outputs and run when the site is built; one that fails is an error.
nb_execution_mode = "force"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True

autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
# A name is described where it is defined, not again where a package hands it on.
autodoc_default_options = {"members": True, "show-inheritance": True, "ignore-module-all": True}
napoleon_numpy_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True  # attributes that a class's docstring tells of are not told of again
add_module_names = False
toc_object_entries_show_parents = "hide"
# Docstrings are plain text, and types are written as they are imported: neither is meant for cross-references.
# Links to files of the repository lead nowhere on the site; tests look whether all links lead somewhere.
suppress_warnings = ["ref.python", "myst.xref_missing"]

_CODE = re.compile(r"(?<!`)`([^`]+)`(?!`)")
_SPECIAL = re.compile(r"([*|\\]|_(?!\w))")


def as_restructured(_app, _what, _name, _object, _options, lines):
    """Docstrings as Sphinx reads them: `code` in double ticks, and no sign that has a meaning of its own there."""
    parts = _CODE.split("\n".join(lines))  # text and code in turns
    shown = [f"``{part}``\\ " if k % 2 else _SPECIAL.sub(r"\\\1", part) for k, part in enumerate(parts)]
    lines[:] = "".join(shown).split("\n")


def before(_app):
    """Write what the site is made of: a page for every module and every environment, and the playground's pages."""
    for room in ("envs", "agents"):
        templates, pages = HERE / "_templates" / "apidoc", HERE / "api" / room
        options = ["--force", "-q", "--separate", "--remove-old", "--no-toc", "--templatedir", str(templates)]
        apidoc.main([*options, "-o", str(pages), str(ROOT / room / f"tensegrity_{room}")])

    import pages

    from tensegrity_agents.playground import PLAYGROUNDS, write_playground

    pages.write_all(HERE / "environments")

    for name, page in PLAYGROUNDS.items():
        write_playground(page, EXTRA / "playground" / f"{name}.html")


def with_linked_ids(_app, docname, source):
    """Ids that begin a row of a table lead to their pages."""
    from tensegrity_envs import ENV_IDS

    above = "../" * docname.count("/")
    for env_id in ENV_IDS:
        name = env_id.rpartition("/")[2]
        linked = rf"\1[`\2{name}`]({above}environments/{name}.md)"
        source[0] = re.sub(rf"^(\| )`(tensegrity/)?{re.escape(name)}`(?= [|(])", linked, source[0], flags=re.MULTILINE)


def without_aliases(_app, _what, _name, member, skip, _options):
    """Fields of named tuples are told of by the class; their own docstrings only count them."""
    return skip or (getattr(member, "__doc__", None) or "").startswith("Alias for field number")


def setup(app):
    """Connect all."""
    app.connect("autodoc-skip-member", without_aliases)
    app.connect("builder-inited", before, priority=1)
    app.connect("source-read", with_linked_ids)
    app.connect("autodoc-process-docstring", as_restructured, priority=1)
