"""What there is to draw, and where it is in the picture."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tensegrity_envs.mechanics.design import Member
from tensegrity_envs.rendering.colours import Colour

Point = tuple[float, float]

_LARGEST = 4096  # pixels of a picture's side


@dataclass(frozen=True)
class Scene:
    """What there is to draw.

    Attributes:
        nodes: positions (x, y) of the named nodes [m].
        members: bars, springs, cables and actuators between them; the order is that of drawing within a kind.
        tensions: forces of cables, springs and actuators, by member name [N]; a cable or actuator without one is grey.
        tension_bounds: the ends of the colour scale [N].
        tip: position of the end-effector [m].
        target: position of the goal [m], or None.
        tolerance: radius around the target that counts as success [m].
        trace: past positions of the tip [m], oldest first; the last 200 are drawn.
        margins: what must stay positive, by name; gauges end at -1 and 1.
        caption: one line at the top.
        reach: what lies this close to the centre, sideways and upwards, is in the picture [m].
        failure: why the episode failed, or "".
        base: names of the nodes that the ground carries, of which one line is drawn, from the first to the last; None
            for the first two, empty for no line.
        load: force at the tip [N]; drawn as an arrow.
        load_scale: force whose arrow is a quarter of the reach long [N].
        curve: the way of a moving goal [m].
        faces: polygons: corners [m], colour and opacity; opaque ones are painted below the members, others above. With
            faces, members are drawn in their order, the ones behind first.
        centre: what is in the middle of the picture [m].
        obstacles: polygons that the mechanism must not touch: corners [m].
        ghost: the nodes of the posture that is to be reached [m]; its bars are drawn faintly.
    """

    nodes: Mapping[str, Point]
    members: Sequence[Member]
    tensions: Mapping[str, float]
    tension_bounds: tuple[float, float]
    tip: Point
    target: Point | None
    tolerance: float
    trace: Sequence[Point]
    margins: Mapping[str, float]
    caption: str
    reach: float
    failure: str = ""
    base: Sequence[str] | None = None
    load: Point = (0.0, 0.0)
    load_scale: float = 1.0
    curve: Sequence[Point] = ()
    faces: Sequence[tuple[Sequence[Point], Colour, float]] = ()
    centre: Point = (0.0, 0.0)
    ghost: Mapping[str, Point] | None = None
    obstacles: Sequence[Sequence[Point]] = ()


@dataclass(frozen=True)
class View:
    """The place of the world in the picture: `reach` [m] and a rim around the centre, below a strip for the caption.

    Attributes:
        size: width and height of the picture [pixels].
        reach: distance from the centre that is surely visible [m].
        zoom: pixels on the canvas per pixel of the picture.
        centre: what is in the middle [m].
    """

    size: tuple[int, int]
    reach: float
    zoom: int = 1
    centre: Point = (0.0, 0.0)

    @property
    def unit(self) -> float:
        """1/600 of the shorter side [canvas pixels]."""
        return self.zoom * min(self.size) / 600

    @property
    def text(self) -> float:
        """Height of a line of text [canvas pixels], legible in small pictures too."""
        return max(17 * self.unit, 11.0 * self.zoom)

    @property
    def strip(self) -> float:
        """Height of the strip at the top that holds the caption [canvas pixels]."""
        return 1.9 * self.text

    @property
    def scale(self) -> float:
        """Canvas pixels per metre."""
        side = min(self.zoom * self.size[0], self.zoom * self.size[1] - self.strip)
        return (side / 2 - 18 * self.unit) / self.reach

    @property
    def spacing(self) -> float:
        """Distance of grid lines and length of the scale bar [m]: the largest 1, 2 or 5 times 10^n up to reach / 4."""
        decade = 10.0 ** math.floor(math.log10(self.reach / 4))
        return max(step * decade for step in (1, 2, 5) if step * decade <= self.reach / 4 * (1 + 1e-9))

    def pixel(self, point: Point) -> Point:
        """Canvas position (to the right, down) of a point of the world [m], kept within ten pictures."""
        x, y = self.size[0] * self.zoom / 2, (self.size[1] * self.zoom + self.strip) / 2
        far = 10.0 * self.zoom * max(self.size)  # pygame needs minutes for lines that are millions of pixels long
        right = self.scale * (float(point[0]) - self.centre[0])
        down = -self.scale * (float(point[1]) - self.centre[1])
        return x + max(-far, min(far, right)), y + max(-far, min(far, down))

    def point(self, pixel: Point) -> Point:
        """The point of the world [m] at a canvas position: the inverse of `pixel`."""
        right = pixel[0] - self.size[0] * self.zoom / 2
        down = pixel[1] - (self.size[1] * self.zoom + self.strip) / 2
        return self.centre[0] + right / self.scale, self.centre[1] - down / self.scale


def frame_around(places: Iterable[Sequence[np.ndarray]]) -> tuple[Point, float]:
    """The square that holds all points, with a rim for how far an arm swings beyond its starts and goals.

    Args:
        places: (x, y) of points [m], numbers or arrays.

    Returns:
        Centre [m] and half of the side [m], as `Scene.centre` and `Scene.reach`.
    """
    pairs = list(places)
    (left, right), (low, high) = (
        (min(float(np.min(p[k])) for p in pairs), max(float(np.max(p[k])) for p in pairs)) for k in (0, 1)
    )
    return ((left + right) / 2, (low + high) / 2), 0.54 * max(right - left, high - low)


def checked_size(size: object) -> tuple[int, int]:
    """Width and height of a picture [pixels], from one number or two.

    Raises:
        ValueError: they are not whole numbers from 1 to 4096.
    """
    pair = tuple(size) if isinstance(size, tuple | list) else (size, size)
    whole = all(isinstance(n, int | np.integer) and not isinstance(n, bool) for n in pair)
    if len(pair) != 2 or not whole or not all(1 <= n <= _LARGEST for n in pair):
        raise ValueError(f"render_size = {size!r}: must be a number of pixels from 1 to {_LARGEST}, or (width, height)")
    return int(pair[0]), int(pair[1])
