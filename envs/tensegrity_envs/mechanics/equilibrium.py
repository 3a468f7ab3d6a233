"""Equilibria of any mechanism: following one by continuation, settling into one, finding all of them.

A mechanism appears here only as `statics`: configuration -> (gradient, Hessian) of its potential energy, both as
components (a tuple, and a tuple of rows). Nothing else about it is known.
"""

from collections.abc import Callable, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.mechanics.namespace import Component, Components, is_batch, namespace_of

Hessian = tuple[Components, ...]
Statics = Callable[[Any], tuple[Components, Hessian]]
# (configuration, indices into the batch or None for all of it) -> gradient, Hessian
BatchStatics = Callable[[Any, Any], tuple[Components, Hessian]]
# (configuration, path parameter in [0, 1], indices into the batch or None for all of it at parameter 1) -> the same
PathStatics = Callable[[Any, Any, Any], tuple[Components, Hessian]]

_CONVERGED = 1e-6  # last Newton step [rad or m]; the error that it leaves is of the order of its square
_ITERATIONS = 6
_CONTRACTION = 0.25  # a Newton step longer than this times the one before: too far from the path
_FIRST_STEP = 0.8  # longest first step of a sub-step [rad or m]
_CHANGE = 3.0  # the determinant of the Hessian changes at most by this factor, from the start of a step to its end
_ITERATIONS_OF_SUBSTEP = 3  # leave an error that the next sub-step corrects
_SECTIONS = 12
_RESOLUTION = 2.0**-12  # shortest sub-step


class Equilibrium(NamedTuple):
    """An equilibrium, or where the search for one ended.

    Attributes:
        configuration: its components [rad or m].
        residual: norm of the energy gradient there [N m or N].
        is_stable: whether it is an equilibrium at which the stiffness matrix is positive definite.
        reason: in words, how it was reached or why there is none (for a batch: a list).
    """

    configuration: Components
    residual: Component
    is_stable: Component
    reason: Any


def solve_symmetric(matrix: Hessian, right: Components) -> tuple[Components, Component, Component]:
    """Solve a small symmetric system by L D L^T on components.

    Returns:
        The solution, the smallest pivot, positive exactly where the matrix is positive definite, and the product of the
        pivots. Where a pivot is not positive, the solution is finite and meaningless.
    """
    n = len(right)
    xp = namespace_of(right[0], matrix[0][0])
    lower: list[list[Component]] = [[0.0] * n for _ in range(n)]
    pivots: list[Component] = []
    smallest: Component = None
    y: list[Component] = []
    for i in range(n):
        for j in range(i):
            entry = matrix[i][j]
            for k in range(j):
                entry = entry - lower[i][k] * lower[j][k] * pivots[k]
            lower[i][j] = entry / pivots[j]
        pivot, value = matrix[i][i], right[i]
        for k in range(i):
            pivot = pivot - lower[i][k] * lower[i][k] * pivots[k]
            value = value - lower[i][k] * y[k]
        smallest = pivot if smallest is None else xp.minimum(smallest, pivot)
        pivots.append(xp.where(pivot > 0, pivot, 1.0))
        y.append(value)
    x: list[Component] = [0.0] * n
    for i in reversed(range(n)):
        value = y[i] / pivots[i]
        for k in range(i + 1, n):
            value = value - lower[k][i] * x[k]
        x[i] = value
    product = pivots[0]
    for pivot in pivots[1:]:
        product = product * pivot
    return tuple(x), smallest, product


def _newton(
    statics: Statics, q: Components, first: Component, iterations: int = _ITERATIONS
) -> tuple[Components, Component, Component, Component]:
    """Newton's method inside a region where the energy is convex.

    Returns the configuration, whether it failed, the last step, and the determinant of the Hessian.

    It fails at the first indefinite Hessian, the first long step, the first step that does not contract, or where the
    determinant has changed much since `first`, its value at the known equilibrium: by then it may be heading for an
    equilibrium that is not the continuation of that one [Deuflhard, Newton Methods for Nonlinear Problems]. Each
    element of a batch stops where it would stop alone, so that a batch of one and of many give the same numbers.
    """
    failed: Component = False
    done: Component = False
    longest: Component = _FIRST_STEP
    for _ in range(iterations):
        gradient, hessian = statics(q)
        step, pivot, volume = solve_symmetric(hessian, gradient)
        xp = namespace_of(pivot)
        size = abs(step[0])
        for component in step[1:]:
            size = xp.maximum(size, abs(component))
        strange = (pivot <= 0) | (volume * _CHANGE < first) | (volume > _CHANGE * first) | (size > longest)
        failed = xp.where(done, failed, strange)
        done = done | failed
        q = tuple(qi - xp.where(done, 0.0, si) for qi, si in zip(q, step, strict=True))
        done = done | (size <= _CONVERGED)
        if done if isinstance(done, bool) else done.all():
            break
        longest = xp.maximum(_CONTRACTION * size, _CONVERGED)
    return q, failed, size, volume


def follow(path: PathStatics, q: Components, resolution: float = _RESOLUTION) -> tuple[Components, Component]:
    """Follow a stable equilibrium along a path of inputs or loads from parameter 0 to 1, never onto another branch.

    One Newton solve where its steps contract from the start; elsewhere sub-steps, shortened until they contract. Where
    stability ends on the way, the last stable point is returned. So it is where stability all but ends: where a
    sub-step of the given resolution is still too long.

    Args:
        path: statics along the path, in any coordinates.
        q: the equilibrium at parameter 0 in those coordinates, floats or arrays of shape (n,).
        resolution: length of the shortest sub-step, as a fraction of the path.

    Returns:
        The coordinates, and the fraction of the path that was covered: 1, or less (by a few times the resolution at
        most) than where stability ended.
    """
    everything = np.arange(len(q[0])) if is_batch(*q) else 0
    q1, failed, size, _ = _newton(_at(path, 1.0, None), q, _volume(path, q, 0.0, everything))
    failed = failed | (size > _CONVERGED)
    if not is_batch(*q):
        if not failed:
            return q1, 1.0
        end, fraction = _follow_in_substeps(path, tuple(np.array([qi]) for qi in q), np.array([0]), resolution)
        return tuple(float(qi[0]) for qi in end), float(fraction[0])
    fraction = np.ones(len(q1[0]))
    index = np.flatnonzero(failed)
    if len(index):
        end, fraction[index] = _follow_in_substeps(path, tuple(qi[index] for qi in q), index, resolution)
        for whole, part in zip(q1, end, strict=True):
            whole[index] = part
    return q1, fraction


def _follow_in_substeps(
    path: PathStatics, q: Components, index: np.ndarray, resolution: float
) -> tuple[Components, np.ndarray]:
    q = tuple(qi.copy() for qi in q)
    t, reach = np.zeros(len(index)), np.ones(len(index))
    volume = _volume(path, q, t, index)
    active = np.arange(len(index))
    while len(active):
        # Many lengths at once, from the same start, by factors of sqrt(2); the longest up to which none fails is taken.
        lengths = reach[active, None] * 2.0 ** (np.arange(1 - _SECTIONS, 1) / 2)
        ahead = np.minimum(t[active, None] + lengths, 1.0).ravel()
        members = np.repeat(index[active], _SECTIONS)
        start = tuple(np.repeat(qi[active], _SECTIONS) for qi in q)
        first = np.repeat(volume[active], _SECTIONS)
        found, failed, _, reached = _newton(_at(path, ahead, members), start, first, _ITERATIONS_OF_SUBSTEP)
        good = np.logical_and.accumulate(~failed.reshape(-1, _SECTIONS), axis=1).sum(axis=1)
        moved = np.flatnonzero(good)
        row = moved * _SECTIONS + good[moved] - 1
        for whole, new in zip(q, found, strict=True):
            whole[active[moved]] = new[row]
        t[active[moved]] = ahead[row]
        volume[active[moved]] = reached[row]
        reach[active] *= 2.0 ** ((good - _SECTIONS) / 2 + 1)  # next: up to twice the last length
        active = active[(t[active] < 1.0) & (reach[active] > resolution)]
    polished, failed, _, _ = _newton(_at(path, t, index), q, volume)
    return tuple(np.where(failed, qi, p) for qi, p in zip(q, polished, strict=True)), t


def _at(path: PathStatics, t: Component, index: Any) -> Statics:
    return lambda q: path(q, t, index)


def _volume(path: PathStatics, q: Components, t: Component, index: Any) -> Component:
    """Determinant of the Hessian at the start of a step; where that is unstable -1, which `_newton` never accepts."""
    gradient, hessian = path(q, t, index)
    _, pivot, volume = solve_symmetric(hessian, gradient)
    return namespace_of(pivot).where(pivot > 0, volume, -1.0)


def settle(statics: BatchStatics, start: Sequence[Component], limit: float) -> Equilibrium:
    """The equilibrium that a mechanism at rest in `start` reaches when it is let go.

    First by continuation: the force that would hold `start` is taken away gradually, and the equilibrium followed.
    Where that path loses stability, by damped Newton steps down the energy, which the reason then says. A start that
    is itself an equilibrium, even an unstable one, is returned.

    Args:
        statics: of the mechanism under its inputs and loads: configuration, indices into the batch (or None for all
            of it).
        start: components, floats or arrays of shape (n,); floats are shared by a batch of statics.
        limit: |component| is at most this.
    """
    gradient, _ = statics(tuple(start), None)
    single = not is_batch(*start, *gradient)
    shape = np.broadcast_shapes((1,), *(np.shape(value) for value in (*start, *gradient)))
    q0 = np.stack([np.broadcast_to(np.asarray(qi, float), shape) for qi in start])

    def everywhere(q: Components) -> tuple[Components, Hessian]:
        return statics(q, None)

    held, stiffness = _as_arrays(everywhere, q0)

    def released(q: Any, t: Any, index: Any) -> tuple[Components, Hessian]:
        force = held if index is None else held[:, index]
        gradient, hessian = statics(q, index)
        return tuple(g - (1 - t) * f for g, f in zip(gradient, force, strict=True)), hessian

    followed, fraction = follow(released, tuple(q0))
    q = np.stack(followed)
    lost = fraction < 1
    if lost.any():
        q = np.where(lost, _descend(everywhere, q, limit), q)
    balanced = _norm(held) <= 1e-9 * (1 + _scale(stiffness))
    q = np.where(balanced, q0, q)
    force, stiffness = _as_arrays(everywhere, q)
    residual = _norm(force)
    positive = solve_symmetric(tuple(map(tuple, stiffness)), tuple(force))[1] > 0
    inside = np.all(np.abs(q) <= limit, axis=0)
    converged = residual <= 1e-9 * (1 + _scale(stiffness))
    stable = converged & positive & inside
    jumped = lost & ~balanced
    reasons = [
        _reason(*case)
        for case in zip(inside.tolist(), converged.tolist(), positive.tolist(), jumped.tolist(), strict=True)
    ]
    if single:
        return Equilibrium(tuple(q[:, 0].tolist()), float(residual[0]), bool(stable[0]), reasons[0])
    return Equilibrium(tuple(q), residual, stable, reasons)


def _reason(inside: bool, converged: bool, positive: bool, jumped: bool) -> str:
    if not inside:
        return "no equilibrium within the joint limits was reached from the start"
    if not converged:
        return "no equilibrium found: the energy keeps falling or the search did not converge"
    if not positive:
        return "an unstable equilibrium: the stiffness matrix is not positive definite"
    if jumped:
        return "stable; the path from the start lost its stability, and this equilibrium lies further down the energy"
    return "stable; followed continuously from the start"


def _descend(statics: Statics, q: np.ndarray, limit: float) -> np.ndarray:
    """Damped Newton steps down the energy (pseudo-transient continuation: implicit Euler steps of a gradient flow)."""
    gradient, hessian = _as_arrays(statics, q)
    scale = _scale(hessian)
    damping = scale.copy()
    # On the ridge itself there is no way down: leave it along a fixed direction, so that the result is reproducible.
    ridge = _norm(gradient) < 1e-9 * (1 + scale)
    q = q + 1e-6 * np.arange(1, len(q) + 1)[:, None] * ridge
    gradient, hessian = _as_arrays(statics, q)
    for _ in range(400):
        shifted = damping
        for _ in range(60):
            moved = tuple(tuple(h + shifted * (i == j) for j, h in enumerate(row)) for i, row in enumerate(hessian))
            step, pivot, _ = solve_symmetric(moved, tuple(gradient))
            if np.all(pivot > 0):
                break
            shifted = np.where(pivot > 0, shifted, 2 * shifted + 1e-3 * scale + 1e-12)
        length = np.where(np.abs(q).max(axis=0) > limit, 0.0, np.abs(step).max(axis=0))  # what left the limits is done
        if np.all(length < 1e-13):
            break
        shrink = np.minimum(length, 0.1) / np.maximum(np.abs(step).max(axis=0), 1e-300)
        trial = q - shrink * np.stack(step)
        new_gradient, new_hessian = _as_arrays(statics, trial)
        # The slope along the step tells whether the energy fell all the way; a step far beyond the bottom is undone.
        slope, slope_there = ((g * (trial - q)).sum(axis=0) for g in (gradient, new_gradient))
        good = (slope_there <= -0.5 * slope) | (length < 1e-9)
        damping = np.where(good, 0.3 * damping, 4 * damping + 1e-3 * scale)
        q = np.where(good, trial, q)
        gradient, hessian = np.where(good, new_gradient, gradient), np.where(good, new_hessian, hessian)
    return q


def _norm(vector: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt((vector * vector).sum(axis=0)))


def _scale(hessian: np.ndarray) -> np.ndarray:
    return np.asarray(np.abs(hessian).max(axis=(0, 1)))


def find_all(statics: Statics, lower: Sequence[float], upper: Sequence[float], cells: int = 48) -> list[Equilibrium]:
    """All equilibria strictly inside a box, stable and unstable, sorted by configuration.

    Exclusion by subdivision: a cell is dropped where the linear bound of the gradient, widened by the sampled
    variation of the Hessian, says that it has no zero; Newton's method starts from every cell that survives.

    Args:
        statics: for one set of inputs, on arrays of configurations.
        lower: lower corner of the box.
        upper: upper corner.
        cells: initial cells along each component.
    """
    low, high = np.asarray(lower, float), np.asarray(upper, float)
    half = (high - low) / (2 * cells)
    axes = [np.linspace(a + h, b - h, cells) for a, b, h in zip(low, high, half, strict=True)]
    centres = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")])
    corners = np.array(list(product((-0.5, 0.5), repeat=len(low)))).T
    roots: list[np.ndarray] = []
    variation = None
    for level in range(5):
        gradient, hessian = _as_arrays(statics, centres)
        if variation is None:  # largest change of each Hessian entry across a cell, sampled
            shape = (len(low), len(low)) + (cells,) * len(low)
            entries = hessian.reshape(shape)
            variation = np.zeros(len(low))
            for axis in range(len(low)):
                jump = np.abs(np.diff(entries, axis=2 + axis)).max(axis=tuple(range(1, 2 + len(low))))
                variation += jump
        linear = np.einsum("ijn,j->in", np.abs(hessian), half)
        curved = (variation * 2.0**-level)[:, None] * half.max() * 1.5
        possible = np.all(np.abs(gradient) <= 1.2 * linear + curved, axis=0)
        centres = centres[:, possible]
        if level < 4:
            centres = (centres[:, :, None] + (half[:, None] * corners)[:, None, :]).reshape(len(low), -1)
            half = half / 2
    roots = _polish(statics, centres, low, high)
    results = []
    for root in roots:
        gradient, hessian = _as_arrays(statics, root[:, None])
        smallest = float(np.linalg.eigvalsh(hessian[..., 0])[0])
        results.append(
            Equilibrium(
                tuple(float(value) for value in root),
                float(np.linalg.norm(gradient)),
                smallest > 0,
                "stable" if smallest > 0 else "unstable: the stiffness matrix is not positive definite",
            )
        )
    return results


def _as_arrays(statics: Statics, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    n = points.shape[1]
    gradient, hessian = statics(tuple(points))
    return (
        np.stack([np.broadcast_to(g, (n,)) for g in gradient]),
        np.stack([np.stack([np.broadcast_to(h, (n,)) for h in row]) for row in hessian]),
    )


def _polish(statics: Statics, points: np.ndarray, low: np.ndarray, high: np.ndarray) -> list[np.ndarray]:
    """Newton's method from every point; the distinct zeros strictly inside the box."""
    low, high = low[:, None], high[:, None]
    for _ in range(40):
        if not points.shape[1]:
            return []
        gradient, hessian = _as_arrays(statics, points)
        scale = np.abs(hessian).max(axis=(0, 1)) + 1e-300
        # Levenberg's damping, quadratically small in the gradient: finite where the Hessian is singular.
        h = np.moveaxis(hessian, -1, 0)
        damping = (np.abs(gradient).max(axis=0) / scale) ** 2 * scale**2 * 1e-3
        normal = np.einsum("nij,nik->njk", h, h) + damping[:, None, None] * np.eye(len(low))
        normal += 1e-30 * (scale**2)[:, None, None] * np.eye(len(low))
        step = np.linalg.solve(normal, np.einsum("nij,in->nj", h, gradient)[..., None])[..., 0].T
        length = np.abs(step).max(axis=0)
        points = points - step * np.minimum(1.0, 0.2 / np.maximum(length, 1e-300))
        inside = np.all((points > low - 0.5) & (points < high + 0.5), axis=0)
        points, length = points[:, inside], length[inside]
        if len(length) and length.max() < 1e-14:
            break
    gradient, hessian = _as_arrays(statics, points)
    good = np.linalg.norm(gradient, axis=0) <= 1e-10 * (1 + np.abs(hessian).max(axis=(0, 1)))
    good &= np.all((points > low + 1e-9) & (points < high - 1e-9), axis=0)
    found: list[np.ndarray] = []
    for point in points[:, good].T:
        if not any(np.abs(point - other).max() < 1e-6 for other in found):
            found.append(point)
    return sorted(found, key=tuple)
