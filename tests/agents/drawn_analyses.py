"""Analyses that several tests look at: each is drawn once in a process.

Tests that take one belong to the xdist group of its mechanism (`of_group`).
"""

import atexit
import io
import shutil
import tempfile
from contextlib import redirect_stdout
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest
from figure_laws import faults

from tensegrity_agents.analysis import analyze, base
from tensegrity_agents.reporting.style import save

# Published designs of each; of the 2-X besides one without offsets and one whose stable wrench-feasible set is empty.
DESIGNS = {
    "two-x": ["muralidharan2022", "furet2018,b=0.9", "muralidharan2022,k1=50,k2=25,max_tension=20"],
    "dual-triangle": ["zhao2021_caption"],
    "planar-four-bar": [],  # the default one
    "spatial-prism": ["jahromy"],
}


class Drawn(NamedTuple):
    """What an analysis did: (stem, title, faults) of each figure, numbers by design, and all steps of progress."""

    folder: Path
    figures: list
    numbers: dict
    steps: list


def of_group(mechanism):
    """The mark of tests that run where the mechanism's analysis is drawn."""
    return pytest.mark.xdist_group(f"figures-{mechanism}")


@cache
def drawn(mechanism):
    """The analysis of a mechanism's `DESIGNS`."""
    folder = Path(tempfile.mkdtemp(prefix=mechanism))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    figures, steps = [], []

    def keep(figure, stem, title=""):
        figures.append((stem, title, faults(figure)))
        return save(figure, stem, title)

    with pytest.MonkeyPatch.context() as patch, redirect_stdout(io.StringIO()) as printed:
        patch.setattr(base, "save", keep)
        numbers = analyze(mechanism, DESIGNS[mechanism], folder, lambda *step: steps.append(step))
    assert not printed.getvalue()  # standard output belongs to `--json`
    return Drawn(folder, figures, numbers, steps)
