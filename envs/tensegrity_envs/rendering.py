"""Draws any planar mechanism from its nodes and members, with pygame-ce; spatial ones are projected before.

`draw` paints a `Scene` into an array and needs no display; `Viewer` shows scenes in a window. pygame is imported on
first use, so that training without pictures never loads it.

Lengths in the picture are counted in units of 1/600 of its shorter side, so that a picture of any size looks the same.
"""

import math
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from tensegrity_envs.mechanics.design import Member

if TYPE_CHECKING:
    from pygame import Surface

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # the line that it prints when imported

Point = tuple[float, float]
Colour = tuple[int, int, int]

_PAPER, _GRID, _AXIS, _INK, _FAINT = (252, 253, 254), (234, 238, 243), (216, 222, 230), (52, 60, 72), (112, 121, 134)
_EARTH, _BAR, _SPRING, _TIP, _TARGET = (205, 211, 219), (58, 68, 84), (18, 138, 132), (25, 113, 194), (208, 60, 12)
_GOOD, _BAD = (43, 158, 84), (214, 40, 40)
# The "plasma" colour map [van der Walt and Smith, 2015] without its ends, which are too dark and too bright on paper.
_TENSIONS = np.array(
    [(70, 3, 159), (114, 1, 168), (156, 23, 158), (189, 55, 134), (216, 87, 107), (237, 121, 83), (251, 159, 58)]
)
_LEGENDS = {"cable": "cable tension [N]", "actuator": "axial force [N]"}  # of the colours, by kind of member
_TRACE_LENGTH = 200  # positions
_LARGEST = 4096  # pixels of a picture's side
_SUPERSAMPLING = 2
_COILS = 9  # turning points of a spring


@dataclass(frozen=True)
class Scene:
    """What there is to draw.

    Attributes:
        nodes: positions (x, y) of the named nodes [m].
        members: bars, springs, cables and actuators between them; the order is that of drawing within a kind.
        tensions: of cables, springs and actuators, by member name [N]; a cable or actuator without one is grey.
        tension_bounds: the ends of the colour scale [N].
        tip: position of the end-effector [m].
        target: position of the goal [m], or None.
        tolerance: radius around the target that counts as success [m].
        trace: past positions of the tip [m], oldest first; the last 200 are drawn.
        margins: what must stay positive, by name; gauges end at -1 and 1.
        caption: one line at the top.
        reach: what lies this close to the centre, sideways and upwards, is in the picture [m].
        failure: why the episode failed, or "".
        base: names of the nodes that the ground carries; None for the first two.
        load: force at the tip [N]; drawn as an arrow.
        load_scale: force whose arrow is a quarter of the reach long [N].
        curve: the way of a moving goal [m].
        faces: polygons: corners [m], colour and opacity; opaque ones are painted below the members, others above. With
            faces, members are drawn in their order, the ones behind first.
        centre: what is in the middle of the picture [m].
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


@dataclass(frozen=True)
class View:
    """Where the world is in the picture: `reach` [m] and a small rim around the centre, below a strip for the caption.

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


def tension_colour(tension: float, bounds: tuple[float, float]) -> Colour:
    """Colour of a cable: dark violet at the lower bound, orange at the upper one, evenly perceived between."""
    low, high = bounds
    position = np.clip((tension - low) / (high - low), 0, 1) * (len(_TENSIONS) - 1) if high > low else 0.0
    red, green, blue = (round(np.interp(position, range(len(_TENSIONS)), channel)) for channel in _TENSIONS.T)
    return red, green, blue


def checked_size(size: Any) -> tuple[int, int]:
    """Width and height of a picture [pixels], from one number or two.

    Raises:
        ValueError: they are not whole numbers from 1 to 4096.
    """
    pair = tuple(size) if isinstance(size, tuple | list) else (size, size)
    whole = all(isinstance(n, int | np.integer) and not isinstance(n, bool) for n in pair)
    if len(pair) != 2 or not whole or not all(1 <= n <= _LARGEST for n in pair):
        raise ValueError(f"render_size = {size!r}: must be a number of pixels from 1 to {_LARGEST}, or (width, height)")
    return int(pair[0]), int(pair[1])


def draw(scene: Scene, size: tuple[int, int] = (600, 600)) -> np.ndarray:
    """The picture of a scene, the same for the same scene.

    Args:
        scene: what to draw.
        size: width and height [pixels].

    Returns:
        uint8 array of shape (height, width, 3), RGB.
    """
    import pygame

    pixels = bytearray(pygame.image.tobytes(_picture(scene, size), "RGB"))
    return np.frombuffer(pixels, np.uint8).reshape(size[1], size[0], 3)


class Viewer:
    """A window that shows scenes."""

    def __init__(self, size: tuple[int, int] = (600, 600), title: str = "tensegrity") -> None:
        """Open the window.

        Raises:
            RuntimeError: there is no display.
        """
        advice = 'set DISPLAY to a running display server, or use render_mode="rgb_array", which needs none'
        drivers = ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")
        if sys.platform.startswith("linux") and not any(os.environ.get(name) for name in drivers):
            raise RuntimeError(f"no display to open a window on: {advice}")
        import pygame

        try:
            pygame.display.init()
            # SDL falls back to invisible windows where it cannot reach the display server; some tests ask for them.
            if pygame.display.get_driver() in {"offscreen", "dummy"} and not os.environ.get("SDL_VIDEODRIVER"):
                pygame.display.quit()
                raise RuntimeError(f"the display server does not answer: {advice}")
            self._window: pygame.Window | None = pygame.Window(title, size)
        except pygame.error as error:
            raise RuntimeError(f"cannot open a window ({error}): {advice}") from error
        self._size, self._clock = size, pygame.time.Clock()

    def show(self, scene: Scene, fps: float = 30.0) -> bool:
        """Show a scene, waiting as long as it takes not to exceed `fps` pictures per second.

        Returns:
            Whether the window is open. Once the user has closed it, or other code pygame, scenes are ignored.
        """
        import pygame

        if self._window is None:
            return False
        picture = _picture(scene, self._size)
        try:
            for event in pygame.event.get(pygame.WINDOWCLOSE):
                if event.window == self._window:
                    self.close()
                    return False
                pygame.event.post(event)  # another viewer's
            self._window.get_surface().blit(picture, (0, 0))
            self._window.flip()
        except pygame.error:  # "Invalid window", "video system not initialized": no longer ours to show
            self._window = None
            return False
        self._clock.tick(fps)
        return True

    def close(self) -> None:
        """Close the window; once is enough, twice does no harm."""
        if self._window is not None:
            self._window.destroy()
            self._window = None


class _Canvas:
    """A surface with the few shapes that pictures are made of; all positions and lengths in canvas pixels."""

    def __init__(self, view: View, surface: "Surface") -> None:
        import pygame

        self.view, self.surface, self._draw = view, surface, pygame.draw
        self.width, self.height = surface.get_size()

    def line(self, start: Point, end: Point, width: float, colour: Colour) -> None:
        """A line with round ends."""
        half = width / 2
        corners = [_beside(start, start, end, half), _beside(end, start, end, half)]
        corners += [_beside(end, start, end, -half), _beside(start, start, end, -half)]
        self._draw.polygon(self.surface, colour, corners)
        self.dot(start, width / 2, colour)
        self.dot(end, width / 2, colour)

    def path(self, points: Sequence[Point], width: float, colour: Colour) -> None:
        """Lines from point to point."""
        for start, end in pairwise(points):
            self.line(start, end, width, colour)

    def dot(self, centre: Point, radius: float, colour: Colour) -> None:
        """A disc."""
        self._draw.circle(self.surface, colour, centre, radius)

    def ring(self, centre: Point, radius: float, width: float, colour: Colour) -> None:
        """A circle, its line inside the radius."""
        self._draw.circle(self.surface, colour, centre, radius, max(1, round(width)))

    def box(self, left: float, top: float, width: float, height: float, colour: Colour) -> None:
        """A filled rectangle."""
        self._draw.rect(self.surface, colour, (round(left), round(top), round(width), round(height)))

    def polygon(self, corners: Sequence[Point], colour: Colour, share: float = 1.0) -> None:
        """A filled polygon, through which `1 - share` of what is below can be seen."""
        import pygame

        if share >= 1:
            self._draw.polygon(self.surface, colour, corners)
            return
        layer = pygame.Surface(self.surface.get_size(), pygame.SRCALPHA)
        self._draw.polygon(layer, (*colour, round(255 * share)), corners)
        self.surface.blit(layer, (0, 0))

    def frame(self, width: float, colour: Colour) -> None:
        """A frame around everything."""
        self._draw.rect(self.surface, colour, self.surface.get_rect(), max(1, round(width)))

    def write(self, text: str, at: Point, anchor: str, colour: Colour = _INK, room: float = math.inf) -> float:
        """A line of text whose `anchor` (such as "midleft") is at a position, smaller if it needs more than `room`.

        Returns:
            Its width.
        """
        height = round(1.25 * self.view.text)
        image = _text(text, height, colour)
        if image.get_width() > room:
            image = _text(text, max(1, int(height * room / image.get_width())), colour)
        self.surface.blit(image, image.get_rect(**{anchor: (round(at[0]), round(at[1]))}))
        return float(image.get_width())


@lru_cache(maxsize=256)
def _text(text: str, height: int, colour: Colour) -> "Surface":
    """A line of text; kept instead of its font, which another library's pygame.quit() would invalidate."""
    import pygame

    pygame.font.init()
    return pygame.font.Font(None, height).render(text, True, colour)


def _direction(start: Point, end: Point) -> Point:
    x, y = end[0] - start[0], end[1] - start[1]
    length = math.hypot(x, y)
    return (x / length, y / length) if length > 0 else (0.0, 0.0)


def _beside(point: Point, start: Point, end: Point, distance: float) -> Point:
    """The point moved sideways off the line from start to end, to the right as the picture shows it."""
    x, y = _direction(start, end)
    return point[0] - distance * y, point[1] + distance * x


def _along(start: Point, end: Point, share: float) -> Point:
    return start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])


def _mix(colour: Colour, share: float) -> Colour:
    """A colour thinned with paper."""
    red, green, blue = (round(share * c + (1 - share) * p) for c, p in zip(colour, _PAPER))
    return red, green, blue


def _picture(scene: Scene, size: tuple[int, int]) -> "Surface":
    import pygame

    view = View(size, scene.reach, _SUPERSAMPLING, (float(scene.centre[0]), float(scene.centre[1])))
    coloured = {member.kind for member in scene.members if member.kind == "cable" or member.name in scene.tensions}
    legend = next((text for kind, text in _LEGENDS.items() if kind in coloured), "spring force [N]")
    legend = "force [N]" if {"actuator", "cable"} <= coloured else legend
    canvas = _Canvas(view, _background(view, scene.tension_bounds if coloured else None, legend).copy())
    _draw_gauges(canvas, scene)
    canvas.surface.set_clip((0, round(view.strip + view.unit), canvas.width, canvas.height))
    _draw_mechanism(canvas, scene)
    canvas.surface.set_clip(None)
    _draw_caption(canvas, scene)
    return pygame.transform.smoothscale(canvas.surface, size)


@lru_cache(maxsize=4)
def _background(view: View, bounds: tuple[float, float] | None, legend: str) -> "Surface":
    """What stays the same from picture to picture: grid, scale bar, colour bar."""
    import pygame

    surface = pygame.Surface((view.zoom * view.size[0], view.zoom * view.size[1]), 0, 32)
    surface.fill(_PAPER)
    canvas, u = _Canvas(view, surface), view.unit
    (x0, y0), step = view.pixel((0.0, 0.0)), view.scale * view.spacing
    for i in range(math.ceil(-x0 / step), math.floor((canvas.width - x0) / step) + 1):
        canvas.box(x0 + i * step - 0.5 * u, 0, max(u, 1), canvas.height, _GRID if i else _AXIS)
    for i in range(math.ceil(-y0 / step), math.floor((canvas.height - y0) / step) + 1):
        canvas.box(0, y0 + i * step - 0.5 * u, canvas.width, max(u, 1), _GRID if i else _AXIS)
    canvas.box(0, 0, canvas.width, view.strip, _PAPER)
    canvas.box(0, view.strip, canvas.width, max(u, 1), _AXIS)

    right, top = canvas.width - 14 * u, view.strip + 16 * u
    canvas.line((right - step, top), (right, top), 2 * u, _FAINT)
    for x in (right - step, right):
        canvas.line((x, top - 4 * u), (x, top + 4 * u), 2 * u, _FAINT)
    canvas.write(f"{view.spacing:g} m", (right - step / 2, top + 6 * u), "midtop", _FAINT)

    if bounds:
        left, top, width, height = _colour_bar(canvas)
        for i in range(round(width)):
            canvas.box(left + i, top, 1, height, tension_colour(i / (width - 1), (0.0, 1.0)))
        canvas.write(legend, (left + width, top - 5 * u), "bottomright", _FAINT)
        canvas.write(f"{bounds[0]:.4g}", (left, top + height + 5 * u), "topleft", _FAINT)
        canvas.write(f"{bounds[1]:.4g}", (left + width, top + height + 5 * u), "topright", _FAINT)
    return surface


def _colour_bar(canvas: _Canvas) -> tuple[float, float, float, float]:
    """Left, top, width and height of the legend of tensions."""
    u, text = canvas.view.unit, canvas.view.text
    width = 7.5 * text
    return canvas.width - 14 * u - width, canvas.height - 22 * u - text, width, 9 * u


def _draw_gauges(canvas: _Canvas, scene: Scene) -> None:
    """The margins, and the present tensions as marks on the colour bar."""
    u, text = canvas.view.unit, canvas.view.text
    left, row = 14 * u, 1.35 * text
    top = canvas.height - 12 * u - row * len(scene.margins) + row / 2
    gauge = left + max(
        (canvas.write(name, (left, top + i * row), "midleft") for i, name in enumerate(scene.margins)), default=0.0
    )
    gauge, half = gauge + 8 * u, 2.2 * text
    for i, value in enumerate(scene.margins.values()):
        y, colour = top + i * row, _GOOD if value >= 0 else _BAD
        length = half * min(1.0, abs(value)) if math.isfinite(value) else half
        canvas.box(gauge, y - 5 * u, 2 * half, 10 * u, _GRID)
        canvas.box(gauge + half - (0 if value > 0 else length), y - 5 * u, length, 10 * u, colour)
        canvas.box(gauge + half - u, y - 7 * u, 2 * u, 14 * u, _FAINT)
        canvas.write(f"{value:.2f}", (gauge + 2 * half + 8 * u, y), "midleft", colour)

    low, high = scene.tension_bounds
    left, top, width, height = _colour_bar(canvas)
    for tension in scene.tensions.values():
        if high > low:
            x = left + width * min(1.0, max(0.0, (tension - low) / (high - low)))
            canvas.line((x, top - 2 * u), (x, top + height + 2 * u), 2 * u, _INK)


def _draw_mechanism(canvas: _Canvas, scene: Scene) -> None:
    """Trace, ground, cables, springs, bars, actuators, pivots; over them target and tip."""
    view = canvas.view
    nodes = {name: view.pixel(position) for name, position in scene.nodes.items()}
    u = view.unit * _line_weight(view, scene, nodes)
    for corners, colour, share in scene.faces:
        if share >= 1:
            canvas.polygon([view.pixel(corner) for corner in corners], colour)
    canvas.path([view.pixel(position) for position in scene.curve], 1.6 * view.unit, _mix(_TARGET, 0.45))
    trace = [view.pixel(position) for position in scene.trace[-_TRACE_LENGTH:]]
    for i, (start, end) in enumerate(pairwise(trace)):
        canvas.line(start, end, 2.2 * view.unit, _mix(_TIP, 0.1 + 0.6 * (i + 1) / len(trace)))
    ghost = scene.ghost or {}
    for member in scene.members:
        if member.kind == "bar" and ghost:
            start, end = (view.pixel(ghost[name]) for name in member.nodes)
            canvas.line(start, end, 4.6 * u, _mix(_TARGET, 0.3))
    base = [nodes[name] for name in (list(nodes)[:2] if scene.base is None else scene.base)]
    if base:
        _draw_ground(canvas, base[0], base[-1], u)

    if scene.faces:
        _draw_in_order(canvas, scene, nodes)
    for member in [] if scene.faces else scene.members:
        if member.kind == "bar":
            start, end = (nodes[name] for name in member.nodes)
            canvas.line(_along(start, end, 0.25), _along(start, end, 0.75), 7 * u, _PAPER)  # one bar is in front
            canvas.line(start, end, 4.6 * u, _BAR)
        elif member.kind == "actuator":  # a cylinder and its rod
            start, end = (nodes[name] for name in member.nodes)
            force = scene.tensions.get(member.name)
            colour = _FAINT if force is None else tension_colour(force, scene.tension_bounds)
            canvas.line(start, end, 2.4 * u, colour)
            canvas.line(start, _along(start, end, 0.6), 6.5 * u, colour)
    for member, start, end, lane in _lanes([] if scene.faces else scene.members, nodes):
        offset = 6 * u * lane
        if member.kind == "spring":
            turns = [_along(start, end, 0.12 + 0.76 * i / (_COILS - 1)) for i in range(_COILS)]
            coil = [_beside(at, start, end, offset + 3 * u * (-1) ** i) for i, at in enumerate(turns)]
            force = scene.tensions.get(member.name)
            colour, width = (_SPRING, 1.3) if force is None else (tension_colour(force, scene.tension_bounds), 2.2)
            canvas.path([start, *coil, end], width * u, colour)
        else:
            tension = scene.tensions.get(member.name)
            colour = _FAINT if tension is None else tension_colour(tension, scene.tension_bounds)
            canvas.line(_beside(start, start, end, offset), _beside(end, start, end, offset), 3 * u, colour)
    for position in nodes.values():
        canvas.dot(position, 4.2 * u, _BAR)
        canvas.dot(position, 2.4 * u, _PAPER)

    if scene.target is not None:
        x, y = view.pixel(scene.target)
        radius = max(scene.tolerance * view.scale, 8 * view.unit)
        arm = radius + 6 * view.unit
        canvas.line((x - arm, y), (x + arm, y), 1.4 * view.unit, _TARGET)
        canvas.line((x, y - arm), (x, y + arm), 1.4 * view.unit, _TARGET)
        canvas.ring((x, y), radius, 2 * view.unit, _TARGET)
    tip = view.pixel(scene.tip)
    canvas.dot(tip, 6 * view.unit, _PAPER)
    canvas.dot(tip, 4.8 * view.unit, _TIP)
    _draw_load(canvas, scene, tip)


def _draw_in_order(canvas: _Canvas, scene: Scene, nodes: Mapping[str, Point]) -> None:
    """Members of a projected mechanism, those behind first, each with a rim of paper; then the translucent faces."""
    u = canvas.view.unit
    for member in scene.members:
        start, end = (nodes[name] for name in member.nodes)
        force = scene.tensions.get(member.name)
        colour = _FAINT if force is None else tension_colour(force, scene.tension_bounds)
        if member.kind == "actuator":
            middle = _along(start, end, 0.55)
            canvas.line(start, end, 14 * u, _PAPER)
            canvas.line(middle, end, 4.4 * u, colour)  # the rod, and below it the cylinder, as wide as it is dark
            canvas.line(start, middle, 9.5 * u, _BAR)
            canvas.line(_along(start, end, 0.06), _along(start, end, 0.5), 3.6 * u, colour)
        elif member.kind == "spring":
            turns = max(_COILS, round(math.dist(start, end) / (7 * u)))
            coil = [
                _beside(_along(start, end, 0.06 + 0.88 * i / (turns - 1)), start, end, 4 * u * (-1) ** i)
                for i in range(turns)
            ]
            canvas.line(_along(start, end, 0.05), _along(start, end, 0.95), 12 * u, _PAPER)
            canvas.path([start, *coil, end], 2 * u, colour)
        else:
            canvas.line(start, end, 3.4 * u, colour)
    for corners, colour, share in scene.faces:
        if share < 1:
            canvas.polygon([canvas.view.pixel(corner) for corner in corners], colour, share)


def _draw_load(canvas: _Canvas, scene: Scene, tip: Point) -> None:
    """The force at the tip, as an arrow that begins there."""
    size = math.hypot(*scene.load)
    if not size > 1e-3 * scene.load_scale:
        return
    u, length = canvas.view.unit, canvas.view.scale * scene.reach / 4 * min(2.0, size / scene.load_scale)
    x, y = scene.load[0] / size, -scene.load[1] / size
    head = min(length, 14 * u)
    end = tip[0] + length * x, tip[1] + length * y
    canvas.line(tip, (end[0] - head * x, end[1] - head * y), 3 * u, _BAD)
    for side in (-1, 1):
        back = end[0] - head * (x - 0.5 * side * y), end[1] - head * (y + 0.5 * side * x)
        canvas.line(end, back, 3 * u, _BAD)


def _line_weight(view: View, scene: Scene, nodes: Mapping[str, Point]) -> float:
    """Thinner lines for mechanisms that are small in the picture, thicker ones for large bars."""
    lengths = [math.dist(*(nodes[name] for name in member.nodes)) for member in scene.members if member.kind == "bar"]
    shortest = min((length for length in lengths if length > 1e-6), default=24 * view.unit)
    return round(min(1.4, max(0.5, shortest / (24 * view.unit))), 3)


def _draw_ground(canvas: _Canvas, left: Point, right: Point, u: float) -> None:
    """A hatched line under the base, on the side that is below if the base goes from left to right."""
    x, y = _direction(left, right) if left != right else (1.0, 0.0)
    end = 14 * u
    left, right = (left[0] - end * x, left[1] - end * y), (right[0] + end * x, right[1] + end * y)
    strokes = max(2, round(math.dist(left, right) / (6 * u)))
    for i in range(1, strokes + 1):
        at = _along(left, right, i / strokes)
        canvas.line(at, (at[0] - 7 * u * (x + y), at[1] + 7 * u * (x - y)), 1.3 * u, _FAINT)
    canvas.line(left, right, 2.2 * u, _FAINT)


def _lanes(members: Sequence[Member], nodes: Mapping[str, Point]) -> Iterator[tuple[Member, Point, Point, float]]:
    """Cables and springs, their ends, and their offset in lanes to the right: those that share nodes lie abreast.

    They lie on the side away from where most bars at the two nodes lead, clear of those bars: cables inside.
    """
    bars = [ends for member in members if member.kind == "bar" for ends in (member.nodes, member.nodes[::-1])]
    soft = [member for kind in ("cable", "spring") for member in members if member.kind == kind]
    for member in soft:
        abreast = [other for other in soft if set(other.nodes) == set(member.nodes)]
        lane = abreast.index(member) + 0.4 if len(abreast) > 1 else 0.0
        start, end = (nodes[name] for name in abreast[0].nodes)
        others = [nodes[far] for near, far in bars if near in member.nodes]
        sides = [(end[0] - start[0]) * (y - start[1]) - (end[1] - start[1]) * (x - start[0]) for x, y in others]
        yield member, start, end, -lane if sum(map(np.sign, sides)) > 0 else lane


def _draw_caption(canvas: _Canvas, scene: Scene) -> None:
    u, middle = canvas.view.unit, canvas.view.strip / 2
    left, right = 14 * u, canvas.width - 14 * u
    if scene.failure:
        canvas.frame(3 * u, _BAD)
        right -= 14 * u + canvas.write(scene.failure, (right, middle), "midright", _BAD, room=(right - left) / 2)
    canvas.write(scene.caption, (left, middle), "midleft", room=right - left)
