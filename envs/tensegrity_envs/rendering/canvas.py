"""A surface of pygame with the few shapes that pictures are made of."""

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

from tensegrity_envs.rendering.colours import INK, Colour
from tensegrity_envs.rendering.scene import Point, View

if TYPE_CHECKING:
    from pygame import Surface


class Canvas:
    """A surface with the few shapes that pictures are made of; all positions and lengths in canvas pixels."""

    def __init__(self, view: View, surface: "Surface") -> None:
        import pygame

        self.view, self.surface, self._draw = view, surface, pygame.draw
        self.width, self.height = surface.get_size()

    def line(self, start: Point, end: Point, width: float, colour: Colour) -> None:
        """A line with round ends."""
        half = width / 2
        corners = [beside(start, start, end, half), beside(end, start, end, half)]
        corners += [beside(end, start, end, -half), beside(start, start, end, -half)]
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

    def write(self, text: str, at: Point, anchor: str, colour: Colour = INK, room: float = math.inf) -> float:
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


def direction(start: Point, end: Point) -> Point:
    """The unit vector from start to end; zero if they are one point."""
    x, y = end[0] - start[0], end[1] - start[1]
    length = math.hypot(x, y)
    return (x / length, y / length) if length > 0 else (0.0, 0.0)


def beside(point: Point, start: Point, end: Point, distance: float) -> Point:
    """The point moved sideways off the line from start to end, to the right as the picture shows it."""
    x, y = direction(start, end)
    return point[0] - distance * y, point[1] + distance * x


def along(start: Point, end: Point, share: float) -> Point:
    """The point that divides the line from start to end."""
    return start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])
