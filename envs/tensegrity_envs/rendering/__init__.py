"""Draws any planar mechanism from its nodes and members, with pygame-ce; spatial ones are projected before.

`draw` paints a `Scene` into an array and needs no display; `Viewer` shows scenes in a window. pygame is imported on
first use, so that training without pictures never loads it.

Lengths in the picture are counted in units of 1/600 of its shorter side, so that a picture of any size looks the same.
"""

import os

from tensegrity_envs.rendering.colours import tension_colour
from tensegrity_envs.rendering.picture import draw
from tensegrity_envs.rendering.scene import Scene, View, checked_size, frame_around
from tensegrity_envs.rendering.window import DisplayError, Viewer, need_display

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # the line that it prints when imported

__all__ = [
    "DisplayError",
    "Scene",
    "View",
    "Viewer",
    "checked_size",
    "draw",
    "frame_around",
    "need_display",
    "tension_colour",
]
