"""Paths of the actuator lengths to a target that the mechanism can follow on its branch, known force or none.

A path has two waypoints and an end. The straight paths to all inverse solutions are tried, and those by waypoints from
a fixed table; each is followed in the nominal model. Of those that arrive, the one with the fewest steps is taken.
"""

from itertools import pairwise
from typing import Any

import numpy as np

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component, Components, namespace_of
from tensegrity_envs.mechanics.equilibrium import continuation
from tensegrity_envs.mechanics.planar_four_bar import PlanarFourBar, PlanarFourBarDesign
from tensegrity_envs.mechanics.planar_four_bar.inverse import loaded, rectangles
from tensegrity_envs.simulation.actuator_lengths import LEAST_STIFFNESS

LEGS = 3
_SAMPLES = np.linspace(0.0, 1.0, 25)
_RESOLUTION = 1 / 512  # of `continuation`, as in the simulation
_ROUNDING = 1e-4  # of targets, which are in single precision, makes so much of a length [m]
_ENOUGH = 0.1  # stability margin beyond which only the length counts
_HURRY = 40.0  # steps that a path may be longer for having this margin instead of none


def waypoints(mechanism: PlanarFourBar, count: int, seed: int = 0) -> np.ndarray:
    """Actuator lengths (count, 2) [m], uniform over those at which rectangles are stable."""
    found = np.random.default_rng(seed).uniform(0.0, 2 * float(mechanism.length), (20 * count, 2))
    square, rest = mechanism.flatness(tuple(found.T))
    return np.asarray(found[2 * np.minimum(square, rest) > 0.2][:count])


def _trip(
    design: PlanarFourBarDesign, q: Components, points: tuple[Components, ...], load: Components
) -> tuple[Components, Component, Component]:
    """Follow a state along straight legs between actuator lengths.

    Returns the tip at the end, how much of the path was covered, and the least of the stability and wrench margins at
    the ends of the legs.
    """
    mechanism = PlanarFourBar(design)
    covered: Component = 0.0
    least: Component = None
    for old, new in pairwise(points):

        def leg(u: Components, t: Component, old: Components = old, new: Components = new) -> Any:
            return mechanism.statics(u, tuple(o + t * (n - o) for o, n in zip(old, new, strict=True)), load)

        q, fraction = continuation(leg, q, _RESOLUTION)
        covered = covered + fraction
        xp = namespace_of(covered)
        margin = xp.minimum(mechanism.stability_margin(q, new, load), mechanism.wrench_margin(q, new, load))
        least = margin if least is None else xp.minimum(least, margin)
    return mechanism.tip(q, points[-1]), covered, least


def trips(
    mechanism: PlanarFourBar, q: np.ndarray, points: np.ndarray, load: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where paths lead, and how safely.

    Args:
        mechanism: nominal.
        q: configurations at the start, shape (m, 2) [rad].
        points: actuator lengths of the start, the waypoints and the end, shape (m, LEGS + 1, 2) [m].
        load: shape (m, 2) [N].

    Returns:
        Tips (m, 2) [m], and margins (m,), negative where the mechanism snaps or exceeds its thrusts underway.
    """
    if not len(q):
        return np.zeros((0, 2)), np.zeros(0)
    # Half a leg at a time: margins are then known in the middle, too, and no long step can jump to another branch.
    halves = np.empty((len(points), 2 * LEGS + 1, 2))
    halves[:, ::2], halves[:, 1::2] = points, (points[:, 1:] + points[:, :-1]) / 2
    columns = tuple(tuple(np.ascontiguousarray(halves[:, k, i]) for i in range(2)) for k in range(2 * LEGS + 1))
    start, force = (tuple(np.ascontiguousarray(v.T)) for v in (q, load))
    tip, covered, margin = evaluate(_trip, mechanism.design, start, columns, force)
    # An unloaded rectangle also must not come near where C and D coincide, and from being flat.
    still = ~load.any(axis=1)
    if still.any():
        legs = points[still]
        path = legs[:, :-1, None] + _SAMPLES[:, None] * (legs[:, 1:, None] - legs[:, :-1, None])
        square, rest = mechanism.flatness((path[..., 0], path[..., 1]))
        clear = 2 * np.minimum(square, rest).min(axis=(1, 2)) - 1.5 * LEAST_STIFFNESS
        margin[still] = np.minimum(margin[still], clear)
    return np.stack(tip, axis=1), np.where(covered >= 2 * LEGS - 1e-9, margin, -1.0)


def ends(
    mechanism: PlanarFourBar, target: np.ndarray, load: np.ndarray, bounds: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """All inverse solutions of targets (n, 2) under loads (n, 2), those of loads on any side, within bounds.

    Returns:
        Index of the target (m,), actuator lengths (m, 2) [m].
    """
    x, y = target.T
    still = np.flatnonzero(~load.any(axis=1))
    pushed = np.flatnonzero(load.any(axis=1))
    lengths, _, exists = rectangles(mechanism, x[still], y[still])
    k, column = np.nonzero(exists)
    owner, found = [still[column]], [lengths[:, k, column].T]
    if len(pushed):
        row, more, _ = loaded(mechanism, x[pushed], y[pushed], tuple(load[pushed].T))
        owner.append(pushed[row])
        found.append(more.T)
    index, rho = np.concatenate(owner), np.concatenate(found)
    fine = ((rho >= bounds[0] - _ROUNDING) & (rho <= bounds[1] + _ROUNDING)).all(axis=1)
    return index[fine], np.clip(rho[fine], *bounds)


def plan(
    mechanism: PlanarFourBar,
    q: np.ndarray,
    start: np.ndarray,
    target: np.ndarray,
    load: np.ndarray,
    table: np.ndarray,
    rate: float,
    bounds: tuple[float, float],
    tolerance: float,
) -> tuple[np.ndarray, np.ndarray]:
    """The best path for each of n environments.

    Args:
        mechanism: nominal.
        q: shape (n, 2) [rad].
        start: actuator lengths, shape (n, 2) [m].
        target: shape (n, 2) [m].
        load: shape (n, 2) [N].
        table: pairs of waypoints that may be taken, shape (k, 2, 2) [m].
        rate: largest change of a length in a step [m].
        bounds: of the lengths [m].
        tolerance: of arriving [m].

    Returns:
        Waypoints and end, shape (n, LEGS, 2) [m], and whether they lead to the target (n,); where nothing does, the
        lengths of the start.
    """
    n = len(q)
    owner, goal = ends(mechanism, target, load, bounds)
    best = np.repeat(start[:, None], LEGS, axis=1)
    cost = np.full(n, np.inf)
    # The straight paths first; paths round obstacles only for those that have none.
    for vias in (None, table):
        open_ = ~np.isfinite(cost)
        mine = np.flatnonzero(open_[owner])
        if not len(mine):
            break
        count = 1 if vias is None else len(vias)
        row, end = np.repeat(owner[mine], count), np.repeat(goal[mine], count, axis=0)
        middle = np.repeat(end[:, None], 2, axis=1) if vias is None else np.tile(vias, (len(mine), 1, 1))
        points = np.concatenate([start[row][:, None], middle, end[:, None]], axis=1)
        tip, margin = trips(mechanism, q[row], points, load[row])
        steps = np.abs(np.diff(points, axis=1)).max(axis=2).sum(axis=1) / rate
        arrives = (np.hypot(*(tip - target[row]).T) < tolerance) & (margin > 0) & (steps < 90)
        price = np.where(arrives, steps - _HURRY * np.minimum(margin, _ENOUGH) / _ENOUGH, np.inf)
        order = np.lexsort((price, row))
        first = order[np.unique(row[order], return_index=True)[1]]
        first = first[np.isfinite(price[first])]
        best[row[first]], cost[row[first]] = points[first, 1:], price[first]
    return best, np.isfinite(cost)
