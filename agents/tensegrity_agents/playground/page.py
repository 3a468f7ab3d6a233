"""A playground's page: what it is made of, and how it is put together."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from tensegrity_agents.web_page import as_data, as_text, write_page
from tensegrity_envs.compiler.javascript import function
from tensegrity_envs.mechanics.protocol import Mechanism

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

D = TypeVar("D", bound="DataclassInstance")

HERE = Path(__file__).parent


@dataclass(frozen=True)
class Slider:
    """A number that the reader of the page chooses.

    Attributes:
        label: with its unit.
        group: "design", "load" or "extra".
        keys: which entries of the group it sets: names, or numbers of the load's components.
        low: smallest value.
        high: largest value.
        value: at the start.
    """

    label: str
    group: str
    keys: tuple[str | int, ...]
    low: float
    high: float
    value: float

    def as_data(self) -> dict[str, Any]:
        """What the page reads."""
        return {**vars(self), "keys": list(self.keys), "step": (self.high - self.low) / 200}


@dataclass(frozen=True)
class Plane:
    """A plot: labels of its axes, and its corners (x0, y0, x1, y1).

    Attributes:
        axes: labels with units.
        bounds: corners.
        caption: below it.
        equal: whether both axes have one scale.
        project: which components of a node are drawn; none where no mechanism is drawn.
    """

    axes: tuple[str, str]
    bounds: tuple[float, float, float, float]
    caption: str
    equal: bool = True
    project: tuple[int, int] | None = None


@dataclass(frozen=True)
class Playground:
    """A mechanism to play with.

    Attributes:
        title: of the page.
        about: a sentence or two.
        script: the JavaScript file that puts the functions together, defining `MECHANISM`.
        functions: component code by its name in JavaScript, with its arguments as `compiler.javascript.function` takes
            them.
        design: numbers that the script finds as `design`.
        constants: other numbers that the script finds as `CONSTANTS`.
        main: the workspace.
        second: the plot beside it.
        start: target at the start.
        sliders: below.
        quantities: names of the numbers that are shown of a solution, with units.
        classes: what the colours of the workspace mean: label and colour, the first of what cannot be reached.
        members: kind and the two nodes of each.
    """

    title: str
    about: str
    script: str
    functions: dict[str, tuple[Callable[..., Any], dict[str, Any]]]
    design: dict[str, Any]
    constants: dict[str, Any]
    main: Plane
    second: Plane
    start: tuple[float, float]
    sliders: tuple[Slider, ...]
    quantities: tuple[str, ...]
    classes: tuple[tuple[str, str], ...]
    members: tuple[tuple[str, str, str], ...] = field(default=())

    def arithmetic(self) -> str:
        """The functions in JavaScript."""
        return "\n".join(function(name, code, **arguments) for name, (code, arguments) in self.functions.items())

    def solver(self) -> str:
        """All of the page's JavaScript that draws nothing: arithmetic, searches, and `MECHANISM`."""
        constants = f"const CONSTANTS = {json.dumps(self.constants)};"
        parts = ['"use strict";', constants, self.arithmetic(), _text("solver.js"), _text(self.script)]
        return "\n".join(parts)

    def settings(self) -> dict[str, Any]:
        """What the drawing needs to know."""
        names = ("title", "design", "start", "quantities", "classes", "members")
        return {
            **{name: getattr(self, name) for name in names},
            "main": vars(self.main),
            "second": vars(self.second),
            "sliders": [slider.as_data() for slider in self.sliders],
        }


def write_playground(playground: Playground, path: Path) -> Path:
    """Write the page, which loads nothing from anywhere.

    Returns:
        The path.
    """
    return write_page(
        path,
        HERE / "page.html",
        TITLE=as_text(playground.title),
        ABOUT=as_text(playground.about),
        SETTINGS=as_data(playground.settings()),
        SOLVER=playground.solver(),
        VIEW=_text("view.js"),
    )


def varying(design: D, *names: str) -> D:
    """A design some of whose numbers vary, for `compiler.javascript.function`."""
    return replace(design, **{name: np.array([float(getattr(design, name))]) for name in names})


def numbers_of(design: object) -> dict[str, float]:
    """The numbers of a design by name."""
    return {name: float(value) for name, value in vars(design).items() if isinstance(value, float | int)}


def members_of(
    mechanism: Mechanism, kinds: Sequence[str] = ("bar", "spring", "cable", "actuator")
) -> tuple[tuple[str, str, str], ...]:
    """Kind and nodes of a mechanism's members; of two along one line only the first."""
    found: dict[tuple[str, str], str] = {}
    for member in mechanism.members:
        if member.kind in kinds:
            found.setdefault(member.nodes, member.kind)
    return tuple((kind, *nodes) for nodes, kind in found.items())


def _text(name: str) -> str:
    return (HERE / name).read_text(encoding="utf-8")
