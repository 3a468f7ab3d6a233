"""The picture of a scene: background, mechanism, gauges and caption."""

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from tensegrity_envs.rendering.canvas import Canvas
from tensegrity_envs.rendering.colours import AXIS, BAD, FAINT, GOOD, GRID, INK, PAPER, mix, tension_colour
from tensegrity_envs.rendering.mechanism import draw_mechanism
from tensegrity_envs.rendering.scene import Point, Scene, View

if TYPE_CHECKING:
    from pygame import Surface


_LEGENDS = {"cable": "cable tension [N]", "actuator": "axial force [N]"}  # of the colours, by kind of member
_SUPERSAMPLING = 2


def draw(scene: Scene, size: tuple[int, int] = (600, 600)) -> np.ndarray:
    """The picture of a scene, the same for the same scene.

    Args:
        scene: what to draw.
        size: width and height [pixels].

    Returns:
        uint8 array of shape (height, width, 3), RGB.
    """
    import pygame

    pixels = bytearray(pygame.image.tobytes(paint(scene, size), "RGB"))
    return np.frombuffer(pixels, np.uint8).reshape(size[1], size[0], 3)


def paint(scene: Scene, size: tuple[int, int]) -> "Surface":
    """The picture of a scene as a surface of pygame; `size` is width and height [pixels]."""
    import pygame

    view = View(size, scene.reach, _SUPERSAMPLING, (float(scene.centre[0]), float(scene.centre[1])))
    coloured = {member.kind for member in scene.members if member.kind == "cable" or member.name in scene.tensions}
    legend = next((text for kind, text in _LEGENDS.items() if kind in coloured), "spring force [N]")
    legend = "force [N]" if {"actuator", "cable"} <= coloured else legend
    obstacles = tuple(tuple((float(x), float(y)) for x, y in corners) for corners in scene.obstacles)
    canvas = Canvas(view, _background(view, scene.tension_bounds if coloured else None, legend, obstacles).copy())
    _draw_gauges(canvas, scene)
    canvas.surface.set_clip((0, round(view.strip + view.unit), canvas.width, canvas.height))
    draw_mechanism(canvas, scene)
    canvas.surface.set_clip(None)
    _draw_caption(canvas, scene)
    return pygame.transform.smoothscale(canvas.surface, size)


@lru_cache(maxsize=4)
def _background(
    view: View, bounds: tuple[float, float] | None, legend: str, obstacles: tuple[tuple[Point, ...], ...]
) -> "Surface":
    """What stays the same from picture to picture: grid, obstacles, and over them scale bar and colour bar."""
    import pygame

    surface = pygame.Surface((view.zoom * view.size[0], view.zoom * view.size[1]), 0, 32)
    surface.fill(PAPER)
    canvas, u = Canvas(view, surface), view.unit
    (x0, y0), step = view.pixel((0.0, 0.0)), view.scale * view.spacing
    for i in range(math.ceil(-x0 / step), math.floor((canvas.width - x0) / step) + 1):
        canvas.box(x0 + i * step - 0.5 * u, 0, max(u, 1), canvas.height, GRID if i else AXIS)
    for i in range(math.ceil(-y0 / step), math.floor((canvas.height - y0) / step) + 1):
        canvas.box(0, y0 + i * step - 0.5 * u, canvas.width, max(u, 1), GRID if i else AXIS)
    for corners in obstacles:
        edge = [view.pixel(corner) for corner in corners]
        canvas.polygon(edge, mix(BAD, 0.25))
        canvas.path([*edge, edge[0]], 2 * u, mix(BAD, 0.6))
    canvas.box(0, 0, canvas.width, view.strip, PAPER)
    canvas.box(0, view.strip, canvas.width, max(u, 1), AXIS)

    right, top = canvas.width - 14 * u, view.strip + 16 * u
    canvas.line((right - step, top), (right, top), 2 * u, FAINT)
    for x in (right - step, right):
        canvas.line((x, top - 4 * u), (x, top + 4 * u), 2 * u, FAINT)
    canvas.write(f"{view.spacing:g} m", (right - step / 2, top + 6 * u), "midtop", FAINT)

    if bounds:
        left, top, width, height = _colour_bar(canvas)
        for i in range(round(width)):
            canvas.box(left + i, top, 1, height, tension_colour(i / (width - 1), (0.0, 1.0)))
        canvas.write(legend, (left + width, top - 5 * u), "bottomright", FAINT)
        canvas.write(f"{bounds[0]:.4g}", (left, top + height + 5 * u), "topleft", FAINT)
        canvas.write(f"{bounds[1]:.4g}", (left + width, top + height + 5 * u), "topright", FAINT)
    return surface


def _colour_bar(canvas: Canvas) -> tuple[float, float, float, float]:
    """Left, top, width and height of the legend of tensions."""
    u, text = canvas.view.unit, canvas.view.text
    width = 7.5 * text
    return canvas.width - 14 * u - width, canvas.height - 22 * u - text, width, 9 * u


def _draw_gauges(canvas: Canvas, scene: Scene) -> None:
    """The margins, and the present tensions as marks on the colour bar."""
    u, text = canvas.view.unit, canvas.view.text
    left, row = 14 * u, 1.35 * text
    top = canvas.height - 12 * u - row * len(scene.margins) + row / 2
    gauge = left + max(
        (canvas.write(name, (left, top + i * row), "midleft") for i, name in enumerate(scene.margins)), default=0.0
    )
    gauge, half = gauge + 8 * u, 2.2 * text
    for i, value in enumerate(scene.margins.values()):
        y, colour = top + i * row, GOOD if value >= 0 else BAD
        length = half * min(1.0, abs(value)) if math.isfinite(value) else half
        canvas.box(gauge, y - 5 * u, 2 * half, 10 * u, GRID)
        canvas.box(gauge + half - (0 if value > 0 else length), y - 5 * u, length, 10 * u, colour)
        canvas.box(gauge + half - u, y - 7 * u, 2 * u, 14 * u, FAINT)
        canvas.write(f"{value:.2f}", (gauge + 2 * half + 8 * u, y), "midleft", colour)

    low, high = scene.tension_bounds
    left, top, width, height = _colour_bar(canvas)
    for tension in scene.tensions.values():
        if high > low:
            x = left + width * min(1.0, max(0.0, (tension - low) / (high - low)))
            canvas.line((x, top - 2 * u), (x, top + height + 2 * u), 2 * u, INK)


def _draw_caption(canvas: Canvas, scene: Scene) -> None:
    u, middle = canvas.view.unit, canvas.view.strip / 2
    left, right = 14 * u, canvas.width - 14 * u
    if scene.failure:
        canvas.frame(3 * u, BAD)
        right -= 14 * u + canvas.write(scene.failure, (right, middle), "midright", BAD, room=(right - left) / 2)
    canvas.write(scene.caption, (left, middle), "midleft", room=right - left)
