"""Equilibria of any mechanism: following one by continuation, relaxing into one, finding all of them.

A mechanism appears here only as `statics`: configuration -> (gradient, Hessian) of its potential energy, both as
components (a tuple, and a tuple of rows). Nothing else about it is known.
"""

from collections.abc import Callable, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component, Components, detached, is_symbol, is_tensor, namespace_of
from tensegrity_envs.compiler.pytree import is_array, tree_leaves, tree_map
from tensegrity_envs.compiler.tracing import Path
from tensegrity_envs.mechanics.intervals import Interval

Hessian = tuple[Components, ...]
Statics = Callable[[Components], tuple[Components, Hessian]]
# (configuration, parameters: any pytree of components) -> gradient, Hessian; traceable
ParametricStatics = Callable[[Components, Any], tuple[Components, Hessian]]
# (configuration, path parameter in [0, 1]) -> gradient, Hessian; traceable
PathStatics = Callable[[Components, Component], tuple[Components, Hessian]]

_SMALLEST_CELL = 1e-7  # half of its width
_MOST_CELLS = 200_000
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
    reason: str | list[str]


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


def continuation(path: PathStatics, q: Components, resolution: float = _RESOLUTION) -> tuple[Components, Component]:
    """Follow a stable equilibrium along a path of inputs or loads from parameter 0 to 1, never onto another branch.

    For traced functions (`compiler.kernel`), which alone may call it: the statics become the code of a Newton
    step, and `continuation.follow` runs it. Where stability ends on the way, the last stable point is returned. So it
    is where stability all but ends: where a sub-step of the given resolution is still too long.

    Args:
        path: statics along the path, in any coordinates.
        q: the equilibrium at parameter 0 in those coordinates.
        resolution: length of the shortest sub-step, as a fraction of the path.

    Returns:
        The coordinates, and the fraction of the path that was covered: 1, or less (by a few times the resolution at
        most) than where stability ended.

    Raises:
        TypeError: the caller is not traced.
    """
    graphs = [component.graph for component in q if is_symbol(component)]
    if not graphs:
        raise TypeError("continuation is for traced functions: call it in one that compiler.kernel.evaluate gets")
    inner = Path(graphs[0], len(q))
    gradient, hessian = path(inner.configuration, inner.parameter)
    step, pivot, volume = solve_symmetric(hessian, gradient)
    return inner.finish(step, pivot, volume, q, resolution)


def _released(statics: ParametricStatics, start: Components, parameters: Any) -> tuple[Components, Component]:
    """Where an arm held at `start` comes to when the holding force is taken away, and how much of it could be."""
    held, _ = statics(start, parameters)

    def released(q: Components, t: Component) -> tuple[Components, Hessian]:
        gradient, hessian = statics(q, parameters)
        return tuple(g - (1 - t) * f for g, f in zip(gradient, held, strict=True)), hessian

    return continuation(released, start)


def relax(statics: ParametricStatics, start: Sequence[Component], parameters: Any, limit: float) -> Equilibrium:
    """The equilibrium that a mechanism at rest in `start` reaches when it relaxes: what held it is taken away.

    First by continuation: the force that would hold `start` is taken away gradually, and the equilibrium followed.
    Where that path loses stability, by damped Newton steps down the energy, which the reason then says. A start that
    is itself an equilibrium, even an unstable one, is returned.

    Args:
        statics: of the mechanism: (configuration, parameters) -> gradient, Hessian; a function of a module, since its
            compiled form is kept.
        start: components, floats or arrays of shape (n,).
        parameters: a pytree of floats and arrays of shape (n,): design, inputs, loads. Where a start or parameter is
            a Torch tensor, so is the result, with the gradients that the implicit function theorem gives.
        limit: |component| is at most this.
    """
    if any(True for _ in tree_leaves((tuple(start), parameters), is_tensor)):
        return _relax_tensors(statics, tuple(start), parameters, limit)
    start = tuple(qi if isinstance(qi, np.ndarray) else float(qi) for qi in start)
    arrays = list(tree_leaves((start, parameters), is_array))
    single = not arrays
    shape = np.broadcast_shapes((1,), *(value.shape for value in arrays))
    q0 = np.stack([np.broadcast_to(np.asarray(qi, float), shape) for qi in start])

    def everywhere(q: Components) -> tuple[Components, Hessian]:
        return statics(q, parameters)

    held, stiffness = _as_arrays(everywhere, q0)
    followed, fraction = evaluate(_released, statics, tuple(q0), parameters)
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


def _relax_tensors(statics: ParametricStatics, start: Components, parameters: Any, limit: float) -> Equilibrium:
    """`relax` on numbers, then one step of Newton's method on tensors.

    The step is zero but for rounding, and its derivative -H^-1 dg/dp is that of the equilibrium.
    """
    begin, given = tree_map(detached, (start, parameters), is_tensor)
    found = relax(statics, begin, given, limit)
    like = next(tree_leaves((start, parameters), is_tensor))
    q = tuple(like.new_tensor(np.asarray(angle)) for angle in found.configuration)
    gradient, hessian = statics(q, parameters)
    held = tuple(tuple(entry + 0.0 * like.new_zeros(()) for entry in row) for row in hessian)
    fixed = tuple(tuple(entry.detach() for entry in row) for row in held)
    step, *_ = solve_symmetric(fixed, tuple(g + 0.0 * angle for g, angle in zip(gradient, q, strict=True)))
    stable = like.new_tensor(np.asarray(found.is_stable), dtype=None).bool()
    xp = namespace_of(like)
    moved = tuple(xp.where(stable, angle - part, angle) for angle, part in zip(q, step, strict=True))
    return Equilibrium(moved, like.new_tensor(np.asarray(found.residual)), stable, found.reason)


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


def find_all(statics: Statics, lower: Sequence[float], upper: Sequence[float], cells: int = 32) -> list[Equilibrium]:
    """All equilibria strictly inside a box, stable and unstable, sorted by configuration.

    Exclusion by interval arithmetic: a cell is dropped where the bounds of the gradient leave zero out; where those of
    the Hessian leave its determinant no zero, there is one equilibrium at most, and Newton's method starts; all other
    cells are divided.

    Args:
        statics: for one set of inputs, on components: arrays and `intervals.Interval`.
        lower: lower corner of the box.
        upper: upper corner.
        cells: initial cells along each component.

    Raises:
        ValueError: the equilibria form a continuum.
    """
    low, high = np.asarray(lower, float), np.asarray(upper, float)
    half = (high - low) / (2 * cells)
    axes = [np.linspace(a + h, b - h, cells) for a, b, h in zip(low, high, half, strict=True)]
    centres = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")])
    corners = np.array(list(product((-0.5, 0.5), repeat=len(low)))).T
    starts = [centres[:, :0]]
    while centres.shape[1]:
        possible, single = _bounds(statics, centres, half)
        if possible.sum() > _MOST_CELLS:
            raise ValueError("the equilibria form a continuum: the energy is (all but) constant along it")
        is_last = half.max() < _SMALLEST_CELL
        starts.append(centres[:, possible & (single | is_last)])
        if is_last:
            break
        centres = centres[:, possible & ~single]
        centres = (centres[:, :, None] + (half[:, None] * corners)[:, None, :]).reshape(len(low), -1)
        half = half / 2
    centres = np.concatenate(starts, axis=1)
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


def _bounds(statics: Statics, centres: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which cells may hold an equilibrium, and which of them one at most."""
    cells = tuple(Interval(c - h, c + h) for c, h in zip(centres, half, strict=True))
    zero = Interval(np.zeros(centres.shape[1]), np.zeros(centres.shape[1]))
    with np.errstate(invalid="ignore", over="ignore"):
        bounds, hessian = statics(cells)
        matrix = [[zero + entry for entry in row] for row in hessian]
        gradient, _ = _as_arrays(statics, centres)
        possible = np.ones(centres.shape[1], bool)
        for value, bound, row in zip(gradient, bounds, matrix, strict=True):
            change = sum(entry.size * h for entry, h in zip(row, half, strict=True))
            slop = 1e-12 * (np.abs(value) + sum(entry.size for entry in row))
            possible &= ~(np.abs(value) > change + slop)  # NaN excludes nothing
            possible &= ~((zero + bound).low > slop) & ~((zero + bound).high < -slop)
        return possible, _is_regular(matrix)


def _is_regular(matrix: list[list[Interval]]) -> np.ndarray:
    """Where all matrices M within these bounds are regular.

    With C the inverse of the matrix in the middle, C M is regular if it differs from 1 by less than 1.
    """
    n = len(matrix)
    middle = np.stack([np.stack([(entry.low + entry.high) / 2 for entry in row], -1) for row in matrix], -2)
    radius = np.stack([np.stack([(entry.high - entry.low) / 2 for entry in row], -1) for row in matrix], -2)
    fine = np.isfinite(middle).all(axis=(-2, -1)) & np.isfinite(radius).all(axis=(-2, -1))
    middle = np.where(fine[:, None, None], middle, np.eye(n))
    fine &= np.abs(np.linalg.det(middle)) > 1e-300
    inverse = np.linalg.inv(np.where(fine[:, None, None], middle, np.eye(n)))
    off = (np.abs(inverse) @ np.where(fine[:, None, None], radius, 0.0)).sum(axis=-1).max(axis=-1)
    return np.asarray(fine & (off < 0.95))


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
