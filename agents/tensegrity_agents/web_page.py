"""HTML pages that hold everything they need: a template, its parts put in, and the drawing that all of them share."""

import json
from pathlib import Path


def as_data(value: object) -> str:
    """JSON that may stand in a script element."""
    return json.dumps(value, separators=(",", ":")).replace("</", "<\\/")


def as_text(value: str) -> str:
    """Text that may stand in an element."""
    return value.replace("&", "&amp;").replace("<", "&lt;")


def write_page(path: Path, template: Path, **parts: str) -> Path:
    """Write a page.

    Args:
        path: of the HTML file, whose folder is made if it is missing.
        template: HTML in which `__NAME__` stands for a part; `__DRAWING__` for `web_page.js`.
        parts: by name, such as `TITLE`.

    Returns:
        The path.
    """
    page = template.read_text(encoding="utf-8")
    drawing = Path(__file__).with_suffix(".js").read_text(encoding="utf-8")
    for name, text in {"DRAWING": drawing, **parts}.items():
        page = page.replace(f"__{name}__", text)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page, encoding="utf-8")
    return path
