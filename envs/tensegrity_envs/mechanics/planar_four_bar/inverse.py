"""Inverse kinematics of the planar 4-bar mechanism: every equilibrium with F at a target, with a force or without.

C lies on the circles of radius L about B and F: two places. Without a load, in a rectangle, DM = L / 2 with M the
midpoint of bar CF (Thales), so D lies on that circle and on the one of radius L about A: two places again. Collinear
equilibria have D on the line CF: two places, and two directions of bar DE. [Ji2014, Eqs. 17-25] instead solve a quartic
whose coefficients are misprinted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Component, namespace_of
from tensegrity_envs.mechanics.planar_four_bar.equilibria import (
    INWARDS,
    LOADED,
    OUTWARDS,
    PARALLEL,
    RECTANGLE,
    describe,
    pointing,
)
from tensegrity_envs.mechanics.planar_four_bar.statics import FourBarStatics
from tensegrity_envs.mechanics.roots import bracketed_roots, hidden_sign_changes

_SAMPLES = 181  # of alpha
_TOUCHING = 1e-14  # squares of half chords, in L^2: rounding
_ON_BASE = 1e-9  # C and D may be so far below the base, in L: rounding


class InverseSolution(NamedTuple):
    """An equilibrium with F at the target.

    Attributes:
        lengths: of the actuators (rho1, rho2) [m].
        configuration: (theta, gamma) [rad].
        type: "X", "IN", "OUT", "PAR", or "loaded"; see `equilibria.FourBarEquilibrium`.
        side: of the line CD on which F lies: 1, -1, or 0.
        is_stable: whether the stiffness matrix is positive definite.
        thrusts: of the actuators (p1, p2) [N], positive in compression.
        residual: distance of F from the target [m].
    """

    lengths: tuple[float, float]
    configuration: tuple[float, float]
    type: str
    side: int
    is_stable: bool
    thrusts: tuple[float, float]
    residual: float

    @property
    def is_within_paper_range(self) -> bool:
        """Whether 0 < theta, gamma < pi, [Ji2014, Eq. 2]."""
        return all(0 < angle < math.pi for angle in self.configuration)


class Pivots(NamedTuple):
    """A place of C, or as arrays of shape (2, n) the two places for each of n targets.

    Attributes:
        c: x and y [m].
        gamma: [rad].
        rho1: [m].
        exists: whether the place is there, not below the base.
    """

    c: tuple[Component, Component]
    gamma: Component
    rho1: Component
    exists: Component


def _root(square: Component) -> Component:
    """A square root, 0 where rounding has made the square of circles that touch negative; NaN where they are apart."""
    xp = namespace_of(square)
    with np.errstate(invalid="ignore"):
        return xp.sqrt(xp.where((square < 0) & (square > -_TOUCHING), 0.0, square))


def pivots(mechanism: FourBarStatics, x: np.ndarray, y: np.ndarray) -> Pivots:
    """Where C can be for targets x, y of shape (n,) [m]."""
    return pivot(mechanism, x, y, np.array([[1.0], [-1.0]]))


def pivot(mechanism: FourBarStatics, x: Component, y: Component, sign: Component) -> Pivots:
    """Where C is for a target x, y [m], of its two places that of a sign, 1 or -1. Traceable."""
    xp = mechanism._xp(x, y)
    l = mechanism.length
    dx, dy = x - l, y
    distance = xp.hypot(dx, dy)
    with np.errstate(divide="ignore", invalid="ignore"):
        bow = _root(l * l / distance**2 - 0.25)
    cx, cy = l + dx / 2 - sign * bow * dy, dy / 2 + sign * bow * dx
    exists = xp.isfinite(bow) & (cy >= -_ON_BASE * l)
    cx, cy = xp.where(exists, cx, 0.0), xp.where(exists, xp.maximum(cy, 0.0), 0.0)
    return Pivots((cx, cy), xp.atan2(y - cy, x - cx), xp.minimum(xp.hypot(cx, cy), 2 * l), exists)


class Crossbar(NamedTuple):
    """Bar CF with F at the target: its normal, its midpoint M [m], and t . f / K - 2 t . F [m]; see `loaded`."""

    tx: Component
    ty: Component
    mx: Component
    my: Component
    offset: Component


def crossbar(
    mechanism: FourBarStatics,
    x: Component,
    y: Component,
    c: tuple[Component, Component],
    gamma: Component,
    load: Sequence[Component],
) -> Crossbar:
    """Bar CF from C at the angle gamma [rad] to F at (x, y) [m], under a load [N]. Traceable."""
    xp = mechanism._xp(x, y, gamma)
    tx, ty = -xp.sin(gamma), xp.cos(gamma)
    mx, my = (c[0] + x) / 2, (c[1] + y) / 2
    push = tx * load[0] + ty * load[1]
    return Crossbar(tx, ty, mx, my, push / mechanism.stiffness - 2 * (tx * x + ty * y))


def imbalance(mechanism: FourBarStatics, bar: Crossbar, alpha: Component, fold: Component) -> Component:
    """What is left of the balance of F across bar CF, times |M - D| / L, which keeps it bounded. Traceable."""
    xp = mechanism._xp(alpha, bar.mx)
    l = mechanism.length
    dx, dy = l * xp.cos(alpha), l * xp.sin(alpha)
    ux, uy = bar.mx - dx, bar.my - dy
    distance = xp.hypot(ux, uy)
    across = 2 * (bar.tx * dx + bar.ty * dy) + bar.offset
    return (across * distance + fold * l * (bar.tx * ux + bar.ty * uy)) / (l * l)


def rectangles(mechanism: FourBarStatics, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All unloaded rectangles with F at targets.

    Args:
        mechanism: of one design.
        x, y: shape (n,) [m].

    Returns:
        Lengths (2, 4, n) [m], sides (4, n), and which of the four exist (4, n).
    """
    l = mechanism.length
    places = pivots(mechanism, x, y)
    cx, cy = (np.repeat(v, 2, axis=0) for v in places.c)
    rho1, exists = np.repeat(places.rho1, 2, axis=0), np.repeat(places.exists, 2, axis=0)
    mx, my = (cx + x) / 2, (cy + y) / 2
    square = mx * mx + my * my
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (square + 0.75 * l * l) / (2 * square)
        bow = _root(l * l / square - along * along)
    sign = np.array([[1.0], [-1.0], [1.0], [-1.0]])
    dx, dy = along * mx - sign * bow * my, along * my + sign * bow * mx
    exists = exists & np.isfinite(bow) & (dy >= -_ON_BASE * l)
    rho2 = np.where(exists, np.minimum(np.hypot(dx - l, dy), 2 * l), 0.0)
    side = np.sign((cx - dx) * (y - dy) - (cy - dy) * (x - dx))
    return np.stack([rho1, rho2]), np.where(exists, side, 0.0), exists


def loaded(
    mechanism: FourBarStatics, x: np.ndarray, y: np.ndarray, load: Sequence[np.ndarray], fold: float = 1.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All equilibria under a force on F with F at targets, bar DE pointing at the midpoint M of CF or away from it.

    For each place of C the balance of F across bar CF is left, an equation for alpha:
    t . (E + D - 2 F) + t . f / K = 0 with E = D + fold L (M - D) / |M - D| and t across CF.

    Args:
        mechanism: of one design.
        x, y: shape (n,) [m].
        load: (fx, fy), each of shape (n,) [N].
        fold: 1 (the stable ones are among these) or -1.

    Returns:
        For m solutions altogether the index of the target (m,), the lengths (2, m) [m] and gamma (m,) [rad].
    """
    l = mechanism.length
    places = pivots(mechanism, x, y)
    row, target = np.nonzero(places.exists)
    cx, cy = (v[row, target] for v in places.c)
    gamma, rho1 = places.gamma[row, target], places.rho1[row, target]
    force = load[0][target], load[1][target]
    bars = crossbar(mechanism, x[target], y[target], (cx, cy), gamma, force)
    mx, my = bars.mx, bars.my

    def balance(line: np.ndarray, alpha: np.ndarray) -> np.ndarray:
        return np.asarray(imbalance(mechanism, Crossbar(*(v[line] for v in bars)), alpha, fold))

    lines = np.arange(len(target))
    step = math.pi / (_SAMPLES - 1)  # and a little beyond the ends, where a root may be
    samples = np.tile(np.linspace(-2 * step, math.pi + 2 * step, _SAMPLES + 4), (len(target), 1))
    values = balance(np.broadcast_to(lines[:, None], samples.shape), samples)
    line, i = np.nonzero((values[:, 1:] > 0) != (values[:, :-1] > 0))
    low, high = samples[line, i], samples[line, i + 1]
    hidden, place = hidden_sign_changes(balance, samples, values)
    if len(hidden):  # two roots in one cell on each side of the found point, or in its neighbours
        cell = np.clip(np.searchsorted(samples[0], place) - 1, 0, samples.shape[1] - 2)
        line = np.concatenate([line, hidden, hidden])
        low = np.concatenate([low, samples[0][cell], place])
        high = np.concatenate([high, place, samples[0][cell + 1]])
    alpha = bracketed_roots(lambda a: balance(line, a), low, high)
    square = (mx[line] - l * np.cos(alpha)) ** 2 + (my[line] - l * np.sin(alpha)) ** 2
    kept = (square > 1e-18 * l * l) & (alpha >= -_ON_BASE) & (alpha <= math.pi + _ON_BASE)
    line, alpha = line[kept], np.clip(alpha[kept], 0.0, math.pi)
    return target[line], np.stack([rho1[line], 2 * l * np.sin(alpha / 2)]), gamma[line]


def inverse_kinematics(mechanism: FourBarStatics, x: float, y: float, load: Sequence[float]) -> list[InverseSolution]:
    """Every equilibrium with F at a target, alpha and beta in [0, pi], sorted by actuator lengths.

    Without a load at most four rectangles, all stable, and eight collinear states, of which only "IN" with R > 1 is
    stable; [Ji2014] counts eight solutions altogether.

    Args:
        mechanism: of one design.
        x, y: target [m].
        load: force on F (fx, fy) [N].

    Returns:
        The solutions; an empty list where there is none.

    Raises:
        ValueError: a number is not finite, or a batch of designs.
    """
    if mechanism.design.is_batch:
        raise ValueError("inverse_kinematics takes one design, not a batch of them")
    for name, value in (("x", x), ("y", y), ("load", load)):
        if not np.isfinite(np.asarray(value, float)).all():
            raise ValueError(f"{name} = {value!r}: must be finite")
    x, y, load = float(x), float(y), tuple(map(float, load))
    found = _loaded(mechanism, x, y, load) if any(load) else _unloaded(mechanism, x, y)
    solutions = []
    for lengths, q, kind in found:
        state = describe(mechanism, q, lengths, load, kind)
        p1, p2 = mechanism.thrusts(state.configuration, lengths, load)
        residual = math.hypot(state.tip[0] - x, state.tip[1] - y)
        solutions.append(
            InverseSolution(
                lengths, state.configuration, kind, state.side, state.is_stable, (float(p1), float(p2)), residual
            )
        )
    return sorted(solutions, key=lambda s: s.lengths)


Found = tuple[tuple[float, float], tuple[float, float], str]


def _loaded(mechanism: FourBarStatics, x: float, y: float, load: tuple[float, ...]) -> list[Found]:
    force = tuple(np.array([f]) for f in load)
    found: list[Found] = []
    for fold in (1.0, -1.0):
        _, lengths, gamma = loaded(mechanism, np.array([x]), np.array([y]), force, fold)
        for rho1, rho2, angle in zip(*lengths.tolist(), gamma.tolist(), strict=True):
            theta = pointing(mechanism, (rho1, rho2), angle, fold)
            found.append(((rho1, rho2), (theta, angle), LOADED))
    return found


def _unloaded(mechanism: FourBarStatics, x: float, y: float) -> list[Found]:
    lengths, _, exists = rectangles(mechanism, np.array([x]), np.array([y]))
    places = pivots(mechanism, np.array([x]), np.array([y]))
    found: list[Found] = []
    for k in np.flatnonzero(exists[:, 0]):
        rho = (float(lengths[0, k, 0]), float(lengths[1, k, 0]))
        gamma = float(places.gamma[k // 2, 0])
        found.append((rho, (pointing(mechanism, rho, gamma), gamma), RECTANGLE))
    l = float(mechanism.length)
    for k in np.flatnonzero(places.exists[:, 0]):
        cx, cy = (float(v[k, 0]) for v in places.c)
        gamma, rho1 = float(places.gamma[k, 0]), float(places.rho1[k, 0])
        ex, ey = math.cos(gamma), math.sin(gamma)
        middle = -(cx * ex + cy * ey)
        square = middle * middle - (cx * cx + cy * cy - l * l)
        half = l * float(_root(np.array(square / (l * l))))
        for s in (
            sorted({middle + half, middle - half}, reverse=True) if half >= 0 else ()
        ):  # of D along the line from C
            dx, dy = cx + s * ex, cy + s * ey
            if dy < -_ON_BASE * l:
                continue
            rho = (rho1, min(math.hypot(dx - l, dy), 2 * l))
            for outward in (1, -1):  # E from D along the line
                theta = math.atan2(outward * ey, -outward * ex)
                kind = PARALLEL if outward == 1 else (INWARDS if s > 0 else OUTWARDS)
                found.append((rho, (theta, gamma), kind))
    return found


def choose_stable(
    mechanism: FourBarStatics, x: float, y: float, side: int, load: Sequence[Component] = (0.0, 0.0)
) -> InverseSolution:
    """The stable solution on a side with the shortest actuators.

    Raises:
        ValueError: there is none; the message says whether the target is out of reach.
    """
    solutions = [s for s in inverse_kinematics(mechanism, x, y, load) if s.is_stable]
    fitting = [s for s in solutions if s.side == side]
    if fitting:
        return fitting[0]
    others = sorted({s.side for s in solutions})
    raise ValueError(
        f"target ({x!r}, {y!r}): no stable state on side {side!r}"
        + (f"; there are stable ones on side {', '.join(map(str, others))}" if others else ", nor on any other")
    )
