"""How much load the tip carries: of a posture whose tensions follow the load, and of an arm at constant tensions."""

import math
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.n_x.chain import CableArm
from tensegrity_envs.mechanics.n_x.design import NXDesign

Loaded = Callable[[Components, Any, Components, Components], tuple[Components, Component]]

RESOLUTION = 2.0**-14  # of the growing load, as a share of it
_ROUNDS = 3  # of following the last part of the path once more


class CriticalLoad(NamedTuple):
    """The largest load in a direction.

    Attributes:
        load: [N]; 0 where there is none without load, infinite where nothing ends.
        reason: what ends there: "stability", "wrench" (feasibility), or "" where nothing does.
        configuration: [rad], at this load.
    """

    load: float
    reason: Literal["stability", "wrench", ""]
    configuration: tuple[float, ...]


def critical_load(arm: CableArm, q: tuple[float, ...], direction: tuple[float, float]) -> CriticalLoad:
    """Of a posture held by the stiffest tensions under every load; see `NX.critical_load`.

    The moments are linear in the load, the numbers t of the stiffest tensions (see `tensions`) therefore concave, and
    so is the smallest eigenvalue: what is stable and wrench-feasible is an interval of loads.
    """

    def margins(load: float) -> tuple[float, float]:
        _, stability, wrench = arm.posture(q, (load * direction[0], load * direction[1]))
        return float(stability), float(wrench)

    def reason(load: float) -> Literal["stability", "wrench", ""]:
        stability, wrench = margins(load)
        return "wrench" if wrench < 0 else "" if stability > 0 else "stability"

    if reason(0.0):
        return CriticalLoad(0.0, reason(0.0), q)
    low, high = 0.0, float(arm.design.max_tension)
    largest = 1e9 * high
    while not reason(high):
        low, high = high, 2 * high
        if high > largest:
            return CriticalLoad(math.inf, "", q)
    for _ in range(200):
        middle = (low + high) / 2
        if middle in (low, high):
            break
        low, high = (low, middle) if reason(middle) else (middle, high)
    return CriticalLoad(low, reason(high), q)


def buckling_load(
    loaded: Loaded,
    parameters: tuple[NXDesign, Components],
    direction: tuple[float, float],
    start: tuple[float, ...],
    largest: float,
) -> CriticalLoad:
    """Of an arm at constant tensions whose load grows from zero; see `NX.buckling_load`.

    Args:
        loaded: (start, parameters, begin, end) -> the equilibrium while the load grows evenly from `begin` to `end`
            [N], and how much of the way it could be followed. Traceable.
        parameters: of `loaded`.
        direction: of the load, of length 1.
        start: equilibrium without load [rad].
        largest: load up to which to look [N].
    """
    q, load, end = start, 0.0, largest
    for _ in range(_ROUNDS):
        way = [tuple(size * part for part in direction) for size in (load, end)]
        found, fraction = evaluate(loaded, q, parameters, way[0], way[1])
        q = tuple(float(angle) for angle in found)
        if fraction >= 1:
            load = end
            if end == largest:
                return CriticalLoad(math.inf, "", q)
            end = largest
            continue
        reached = load + fraction * (end - load)
        load, end = reached, min(end, reached + 8 * RESOLUTION * (end - load))
    final = np.asarray(q)
    return CriticalLoad(float(load), "stability", tuple(final.tolist()))
