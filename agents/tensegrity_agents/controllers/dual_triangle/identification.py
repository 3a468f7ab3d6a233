"""Which postures and loads explain a tip position under known inputs, for whole batches of measurements.

The stable stationary points of the springs' energy along the self-motion curve of the tip: five equations (tip,
equilibrium) for five unknowns (three angles, two force components). There may be several stationary points, but never
was more than one of them stable in 36,000 random postures of three designs under random loads of up to three critical
ones; so one measurement is enough. (Were there several, the one with the smallest load would be taken.)
"""

import math
from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.dual_triangle import DualTriangle, DualTriangleDesign
from tensegrity_envs.mechanics.dual_triangle.self_motion import SINGLE, self_motions
from tensegrity_envs.mechanics.equilibrium import continuation

_SAMPLES = 512  # of the self-motion curve or curves of one tip
_BISECTIONS = 30
_RESOLUTION = 1 / 512  # of `continuation`, as in the simulation


class Estimate(NamedTuple):
    """What explains the measurements of n environments.

    Attributes:
        configuration: shape (n, 3) [rad].
        load: shape (n, 2) [N].
        explanations: how many stable explanations there are, of which this one has the smallest load, shape (n,).
    """

    configuration: np.ndarray
    load: np.ndarray
    explanations: np.ndarray


def links(arm: DualTriangle) -> tuple[float, float, float]:
    """What `self_motions` asks for: x of pivot 1, length of links 1 and 2, length of link 3 [m]."""
    return float(arm.base_height), float(arm.link_lengths[0]), float(arm.link_lengths[2])


def _slope(design: DualTriangleDesign, segments: int, q: Components, free_lengths: Components) -> Component:
    """Derivative of the springs' energy along the null vector of the Jacobian [N m3]."""
    arm = DualTriangle(design, segments)
    x, y = arm.jacobian(q)
    g = arm.energy_gradient(q, free_lengths)
    return g[0] * (x[1] * y[2] - x[2] * y[1]) + g[1] * (x[2] * y[0] - x[0] * y[2]) + g[2] * (x[0] * y[1] - x[1] * y[0])


def explain(arm: DualTriangle, tip: np.ndarray, free_lengths: np.ndarray) -> Estimate:
    """The stable explanation of measured tips, as `DualTriangle.identify` finds it one by one.

    Args:
        arm: nominal.
        tip: shape (n, 2) [m].
        free_lengths: shape (n, 6) [m].

    Returns:
        Configuration and load; where there is no explanation at all, the straight arm without load.
    """
    n = len(tip)
    found = Estimate(np.zeros((n, 3)), np.zeros((n, 2)), np.zeros(n, int))
    limit = float(arm.design.joint_limit)
    owners, starts = [np.zeros(0, int)], [np.zeros((3, 0))]
    for index, curve in self_motions(tip[:, 0], tip[:, 1], *links(arm)):
        loop, s, _, after = curve.grid(_SAMPLES)
        width = 2 * math.pi / (_SAMPLES if curve.kind == SINGLE else _SAMPLES // 2)
        owner = np.repeat(np.arange(len(index)), _SAMPLES)

        def slope(owner: np.ndarray, q: Components, index: np.ndarray = index) -> np.ndarray:
            lengths = tuple(free_lengths[index[owner]].T)
            return np.asarray(evaluate(_slope, arm.design, arm.segments, q, lengths))

        q = curve.at(owner, np.tile(loop, len(index)), np.tile(s, len(index)))
        values = slope(owner, q).reshape(len(index), _SAMPLES)
        near = (np.abs(np.stack(q)).max(axis=0) < limit + 0.05).reshape(len(index), _SAMPLES)
        cell = near & near[:, after] & (values * values[:, after] <= 0)
        row, column = np.nonzero(cell)
        low, high, loops = s[column], s[column] + width, loop[column]
        sign = np.sign(values[row, column])
        for _ in range(_BISECTIONS if len(row) else 0):
            middle = (low + high) / 2
            same = np.sign(slope(row, curve.at(row, loops, middle))) == sign
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        owners.append(index[row])
        starts.append(np.stack(curve.at(row, loops, low)).reshape(3, -1))
    own, start = np.concatenate(owners), np.concatenate(starts, axis=1)
    if not len(own):
        return found
    lengths = tuple(free_lengths[own].T)
    force = np.stack(arm.estimate_load(tuple(start), lengths))
    fine = np.isfinite(force).all(axis=0)
    own, start, force, lengths = own[fine], start[:, fine], force[:, fine], tuple(v[fine] for v in lengths)
    state = arm.identify_from(tip[own, 0], tip[own, 1], lengths, tuple(start), tuple(force), 8)
    angles, load = np.stack(state.configuration), np.stack(state.load)
    moved = ~(np.abs(angles - start).max(axis=0) < 1e-4)  # Newton's method led elsewhere, or nowhere
    angles, load = np.where(moved, start, angles), np.where(moved, force, load)
    stable = arm.stability_margin(tuple(angles), lengths, tuple(load)) > 0
    good = np.flatnonzero(stable & (np.abs(angles).max(axis=0) <= limit + 1e-9))
    for i in good[np.argsort(-np.hypot(*load[:, good]), kind="stable")]:  # the smallest load comes last
        row = own[i]
        found.explanations[row] += (
            found.explanations[row] == 0 or np.abs(found.configuration[row] - angles[:, i]).max() > 1e-7
        )
        found.configuration[row], found.load[row] = angles[:, i], load[:, i]
    return found


def _advanced(
    design: DualTriangleDesign, segments: int, q: Components, old: Components, new: Components, load: Components
) -> tuple[Components, Component, Components]:
    arm = DualTriangle(design, segments)

    def path(u: Components, t: Component) -> Any:
        return arm.statics(u, arm.free_lengths(tuple(o + t * (n - o) for o, n in zip(old, new, strict=True))), load)

    end, fraction = continuation(path, q, _RESOLUTION)
    return end, fraction, arm.tip(end)


def advance(
    arm: DualTriangle, q: np.ndarray, old: np.ndarray, new: np.ndarray, load: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What a change of the control inputs does to arms at rest in q under constant loads.

    Args:
        arm: nominal.
        q: shape (n, 3) [rad].
        old: control inputs, shape (n, 3) [m].
        new: control inputs, shape (n, 3) [m].
        load: shape (n, 2) [N].

    Returns:
        Configurations (n, 3) [rad], whether the arms stay stable and within their joint limits (n,), and tips (n, 2)
        [m].
    """
    if not len(q):
        return q, np.zeros(0, bool), np.zeros((0, 2))
    columns = [tuple(np.ascontiguousarray(v.T)) for v in (q, old, new, load)]
    end, fraction, tip = evaluate(_advanced, arm.design, arm.segments, *columns)
    after = np.stack(end, axis=1)
    inside = np.abs(after).max(axis=1) <= float(arm.design.joint_limit)
    return after, (fraction >= 1) & inside, np.stack(tip, axis=1)
