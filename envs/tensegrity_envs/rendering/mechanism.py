"""Draws a mechanism, its goal and its trace."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from tensegrity_envs.mechanics.design import Member
from tensegrity_envs.rendering.canvas import Canvas, along, beside, direction
from tensegrity_envs.rendering.colours import BAD, BAR, FAINT, PAPER, SPRING, TARGET, TIP, mix, tension_colour
from tensegrity_envs.rendering.scene import Point, Scene, View

_TRACE_LENGTH = 200  # positions
_COILS = 9  # turning points of a spring
_SPIRAL = 40  # points of a torsional spring


def draw_mechanism(canvas: Canvas, scene: Scene) -> None:
    """Trace, ground, cables, springs, bars, actuators, pivots; over them target and tip."""
    view = canvas.view
    nodes = {name: view.pixel(position) for name, position in scene.nodes.items()}
    u = view.unit * _line_weight(view, scene, nodes)
    for corners, colour, share in scene.faces:
        if share >= 1:
            canvas.polygon([view.pixel(corner) for corner in corners], colour)
    canvas.path([view.pixel(position) for position in scene.curve], 1.6 * view.unit, mix(TARGET, 0.45))
    trace = [view.pixel(position) for position in scene.trace[-_TRACE_LENGTH:]]
    for i, (start, end) in enumerate(pairwise(trace)):
        canvas.line(start, end, 2.2 * view.unit, mix(TIP, 0.1 + 0.6 * (i + 1) / len(trace)))
    ghost = scene.ghost or {}
    for member in scene.members:
        if member.is_rigid and ghost:
            start, end = (view.pixel(ghost[name]) for name in member.nodes)
            canvas.line(start, end, 4.6 * u, mix(TARGET, 0.3))
    base = [nodes[name] for name in (list(nodes)[:2] if scene.base is None else scene.base)]
    if base:
        _draw_ground(canvas, base[0], base[-1], u)

    if scene.faces:
        _draw_in_order(canvas, scene, nodes)
    for member in [] if scene.faces else scene.members:
        if member.is_rigid:
            start, end = (nodes[name] for name in member.nodes)
            canvas.line(along(start, end, 0.25), along(start, end, 0.75), 7 * u, PAPER)  # one bar is in front
            canvas.line(start, end, 4.6 * u, BAR)
        elif member.kind == "actuator":  # a cylinder and its rod
            start, end = (nodes[name] for name in member.nodes)
            force = scene.tensions.get(member.name)
            colour = FAINT if force is None else tension_colour(force, scene.tension_bounds)
            canvas.line(start, end, 2.4 * u, colour)
            canvas.line(start, along(start, end, 0.6), 6.5 * u, colour)
        elif member.kind == "torsional spring":
            _draw_torsional_spring(canvas, member, nodes, u)
    for member, start, end, lane in _lanes([] if scene.faces else scene.members, nodes):
        offset = 6 * u * lane
        if member.kind == "spring":
            turns = [along(start, end, 0.12 + 0.76 * i / (_COILS - 1)) for i in range(_COILS)]
            coil = [beside(at, start, end, offset + 3 * u * (-1) ** i) for i, at in enumerate(turns)]
            force = scene.tensions.get(member.name)
            colour, width = (SPRING, 1.3) if force is None else (tension_colour(force, scene.tension_bounds), 2.2)
            canvas.path([start, *coil, end], width * u, colour)
        else:
            tension = scene.tensions.get(member.name)
            colour = FAINT if tension is None else tension_colour(tension, scene.tension_bounds)
            canvas.line(beside(start, start, end, offset), beside(end, start, end, offset), 3 * u, colour)
    for position in nodes.values():
        canvas.dot(position, 4.2 * u, BAR)
        canvas.dot(position, 2.4 * u, PAPER)

    if scene.target is not None:
        x, y = view.pixel(scene.target)
        radius = max(scene.tolerance * view.scale, 8 * view.unit)
        arm = radius + 6 * view.unit
        canvas.line((x - arm, y), (x + arm, y), 1.4 * view.unit, TARGET)
        canvas.line((x, y - arm), (x, y + arm), 1.4 * view.unit, TARGET)
        canvas.ring((x, y), radius, 2 * view.unit, TARGET)
    tip = view.pixel(scene.tip)
    canvas.dot(tip, 6 * view.unit, PAPER)
    canvas.dot(tip, 4.8 * view.unit, TIP)
    _draw_load(canvas, scene, tip)


def _draw_in_order(canvas: Canvas, scene: Scene, nodes: Mapping[str, Point]) -> None:
    """Members of a projected mechanism, those behind first, each with a rim of paper; then the translucent faces."""
    u = canvas.view.unit
    for member in scene.members:
        start, end = (nodes[name] for name in member.nodes)
        force = scene.tensions.get(member.name)
        colour = FAINT if force is None else tension_colour(force, scene.tension_bounds)
        if member.kind == "torsional spring":
            _draw_torsional_spring(canvas, member, nodes, u)
        elif member.kind == "actuator":
            middle = along(start, end, 0.55)
            canvas.line(start, end, 14 * u, PAPER)
            canvas.line(middle, end, 4.4 * u, colour)  # the rod, and below it the cylinder, as wide as it is dark
            canvas.line(start, middle, 9.5 * u, BAR)
            canvas.line(along(start, end, 0.06), along(start, end, 0.5), 3.6 * u, colour)
        elif member.kind == "spring":
            turns = max(_COILS, round(math.dist(start, end) / (7 * u)))
            coil = [
                beside(along(start, end, 0.06 + 0.88 * i / (turns - 1)), start, end, 4 * u * (-1) ** i)
                for i in range(turns)
            ]
            canvas.line(along(start, end, 0.05), along(start, end, 0.95), 12 * u, PAPER)
            canvas.path([start, *coil, end], 2 * u, colour)
        else:
            canvas.line(start, end, 3.4 * u, colour)
    for corners, colour, share in scene.faces:
        if share < 1:
            canvas.polygon([canvas.view.pixel(corner) for corner in corners], colour, share)


def _draw_torsional_spring(canvas: Canvas, member: Member, nodes: Mapping[str, Point], u: float) -> None:
    """A spiral about the pivot, from the direction of the first node to that of the second one."""
    x, y = nodes[member.pivot or ""]
    first, second = (math.atan2(nodes[name][1] - y, nodes[name][0] - x) for name in member.nodes)
    turn = math.remainder(second - first, 2 * math.pi)
    turn += math.copysign(2 * math.pi, turn)  # once round, so that a small angle is seen, too
    spiral = []
    for i in range(_SPIRAL + 1):
        share = i / _SPIRAL
        angle, radius = first + share * turn, (7 + 6 * share) * u
        spiral.append((x + radius * math.cos(angle), y + radius * math.sin(angle)))
    canvas.path(spiral, 1.6 * u, SPRING)


def _draw_load(canvas: Canvas, scene: Scene, tip: Point) -> None:
    """The force at the tip, as an arrow that begins there."""
    size = math.hypot(*scene.load)
    if not size > 1e-3 * scene.load_scale:
        return
    u, length = canvas.view.unit, canvas.view.scale * scene.reach / 4 * min(2.0, size / scene.load_scale)
    x, y = scene.load[0] / size, -scene.load[1] / size
    head = min(length, 14 * u)
    end = tip[0] + length * x, tip[1] + length * y
    canvas.line(tip, (end[0] - head * x, end[1] - head * y), 3 * u, BAD)
    for side in (-1, 1):
        back = end[0] - head * (x - 0.5 * side * y), end[1] - head * (y + 0.5 * side * x)
        canvas.line(end, back, 3 * u, BAD)


def _line_weight(view: View, scene: Scene, nodes: Mapping[str, Point]) -> float:
    """Thinner lines for mechanisms that are small in the picture, thicker ones for large bars."""
    lengths = [math.dist(*(nodes[name] for name in member.nodes)) for member in scene.members if member.is_rigid]
    shortest = min((length for length in lengths if length > 1e-6), default=24 * view.unit)
    return round(min(1.4, max(0.5, shortest / (24 * view.unit))), 3)


def _draw_ground(canvas: Canvas, left: Point, right: Point, u: float) -> None:
    """A hatched line under the base, on the side that is below if the base goes from left to right."""
    x, y = direction(left, right) if left != right else (1.0, 0.0)
    end = 14 * u
    left, right = (left[0] - end * x, left[1] - end * y), (right[0] + end * x, right[1] + end * y)
    strokes = max(2, round(math.dist(left, right) / (6 * u)))
    for i in range(1, strokes + 1):
        at = along(left, right, i / strokes)
        canvas.line(at, (at[0] - 7 * u * (x + y), at[1] + 7 * u * (x - y)), 1.3 * u, FAINT)
    canvas.line(left, right, 2.2 * u, FAINT)


def _lanes(members: Sequence[Member], nodes: Mapping[str, Point]) -> Iterator[tuple[Member, Point, Point, float]]:
    """Cables and springs, their ends, and their offset in lanes to the right: those that share nodes lie abreast.

    They lie on the side away from where most bars at the two nodes lead, clear of those bars: cables inside.
    """
    bars = [ends for member in members if member.is_rigid for ends in (member.nodes, member.nodes[::-1])]
    soft = [member for kind in ("cable", "spring") for member in members if member.kind == kind]
    for member in soft:
        abreast = [other for other in soft if set(other.nodes) == set(member.nodes)]
        lane = abreast.index(member) + 0.4 if len(abreast) > 1 else 0.0
        start, end = (nodes[name] for name in abreast[0].nodes)
        others = [nodes[far] for near, far in bars if near in member.nodes]
        sides = [(end[0] - start[0]) * (y - start[1]) - (end[1] - start[1]) * (x - start[0]) for x, y in others]
        yield member, start, end, -lane if sum(map(np.sign, sides)) > 0 else lane
