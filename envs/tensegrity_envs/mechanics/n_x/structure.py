"""Nodes, bars, members and weights of the chain."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from tensegrity_envs.compiler.namespace import Component, Namespace
from tensegrity_envs.mechanics.design import Member
from tensegrity_envs.mechanics.n_x.design import NXDesign
from tensegrity_envs.mechanics.n_x.routing import Routing
from tensegrity_envs.mechanics.n_x.statics import Weights

_SIDES = {-1: ("A", "D"), 1: ("B", "C")}  # base and top node of the left and of the right side


class Bar(NamedTuple):
    """A bar between two nodes: its length [m] and mass [kg]."""

    nodes: tuple[str, str]
    length: Component
    mass: Component


def bars(design: NXDesign) -> list[list[Bar]]:
    """The bars of every joint and of the offset after it, in the order of [Muralidharan2022, figure 2].

    Each joint has its crossed bars and its top bar; its offset a truss with one brace, which the base bar of the next
    joint closes, or, after the last joint, the two bars to the tip.
    """
    line = design.bar_density * math.pi * design.bar_radius**2  # mass per length [kg/m]
    b, l, a = design.each("b"), design.each("l"), design.each("a")
    found = []
    for i in range(design.joints):
        k = i + 1
        lengths = {f"A{k} C{k}": l[i], f"B{k} D{k}": l[i], f"D{k} C{k}": b[i]}
        if k < design.joints:
            side = (a[i] ** 2 + ((b[i] - b[k]) / 2) ** 2) ** 0.5
            brace = (a[i] ** 2 + ((b[i] + b[k]) / 2) ** 2) ** 0.5
            m = k + 1
            lengths |= {f"D{k} A{m}": side, f"D{k} B{m}": brace, f"C{k} B{m}": side, f"A{m} B{m}": b[k]}
        else:
            half = (a[i] ** 2 + b[i] ** 2 / 4) ** 0.5
            lengths |= {f"D{k} P": half, f"C{k} P": half}
        found.append([Bar(_pair(ends), length, line * length) for ends, length in lengths.items()])
    return found


def weights(design: NXDesign, of_joints: Sequence[Sequence[Bar]]) -> Weights:
    """Weights that the vectors of the chain lift; see `statics.Weights`."""
    g, b = design.gravity, design.each("b")
    lifted: list[Component] = []
    offset: list[Component] = []
    lateral: list[Component] = []
    beyond: Component = design.payload
    for i in reversed(range(design.joints)):
        m = [bar.mass for bar in of_joints[i]]
        crossed, top = (m[0] + m[1]) / 2, m[2]
        if i < design.joints - 1:
            truss, base = m[3] + m[4] + m[5], m[6]
            lateral.append(g * m[4] * ((b[i + 1] - b[i]) / 4))  # of the brace, from lower left to upper right
        else:
            truss, base = m[3] + m[4], 0.0
            lateral.append(0.0)
        beyond = beyond + base
        offset.append(g * (truss / 2 + beyond))
        lifted.append(g * (crossed + top + truss + beyond))
        beyond = beyond + truss + top + 2 * crossed
    return Weights(tuple(reversed(lifted)), tuple(reversed(offset)), tuple(reversed(lateral)))


def nodes(
    xp: Namespace, design: NXDesign, q: Sequence[Component], r: Sequence[Component]
) -> dict[str, tuple[Component, Component]]:
    """Positions of the nodes [m]; r are the distances of the midpoints of every joint's base and top bar [m]."""
    zero = 0.0 * sum(q[1:], q[0])
    found: dict[str, tuple[Component, Component]] = {}
    x, y, turn = zero, zero, zero
    for i, (alpha, b, a) in enumerate(zip(q, design.each("b"), design.each("a"), strict=True), start=1):
        cos, sin = b / 2 * xp.cos(turn), b / 2 * xp.sin(turn)
        found[f"A{i}"], found[f"B{i}"] = (x - cos, y - sin), (x + cos, y + sin)
        x, y = x - r[i - 1] * xp.sin(turn + alpha / 2), y + r[i - 1] * xp.cos(turn + alpha / 2)
        turn = turn + alpha
        cos, sin = b / 2 * xp.cos(turn), b / 2 * xp.sin(turn)
        found[f"D{i}"], found[f"C{i}"] = (x - cos, y - sin), (x + cos, y + sin)
        x, y = x - a * xp.sin(turn), y + a * xp.cos(turn)
    found["P"] = (x, y)
    return found


def members(
    design: NXDesign, of_joints: Sequence[Sequence[Bar]], routing: Routing, names: Sequence[str]
) -> tuple[Member, ...]:
    """Bars, springs and cables."""
    found: list[Member] = []
    for bar in (bar for joint in of_joints for bar in joint):
        name = f"bar {len(found) + 1}"
        found.append(Member(name, "bar", bar.nodes, mass=bar.mass, radius=design.bar_radius))
    for i, (left, right) in enumerate(zip(design.each("k_left"), design.each("k_right"), strict=True), start=1):
        for side, word, stiffness in ((-1, "left", left), (1, "right", right)):
            found.append(Member(f"spring {word} {i}", "spring", _span(side, i), stiffness=stiffness))
    for name, row in zip(names, routing, strict=True):
        spans = [_span(side, j) for j, side in enumerate(row, start=1) if side]
        word = name if name.startswith("cable") else f"cable {name}"
        found.append(Member(word, "cable", spans[0], more_spans=tuple(spans[1:])))
    return tuple(found)


def _span(side: int, joint: int) -> tuple[str, str]:
    base, top = _SIDES[side]
    return f"{base}{joint}", f"{top}{joint}"


def _pair(ends: str) -> tuple[str, str]:
    first, second = ends.split()
    return first, second
