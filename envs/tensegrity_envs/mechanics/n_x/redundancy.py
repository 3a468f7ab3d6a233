"""Which of the configurations with the tip at a target: local optima of an objective within the joint limits.

Objectives are those of [Zhao2021, section III] ("sum", "max" and "squares" of the joints' displacements from a start)
and "margin", the smaller one of stability and wrench margin. All but "squares" have kinks where minima tend to lie.
Three joints move along curves with the tip at rest: from many points of them, found by closed forms and by projection,
points walk downhill with steps that shrink until nothing within 1e-11 rad is better. More joints move on surfaces:
sequential quadratic programmes with the kinks as constraints (SLSQP) start from many points.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.n_x.chain import CableArm
from tensegrity_envs.mechanics.n_x.inverse import last_joints
from tensegrity_envs.mechanics.n_x.routing import FROM_BASE
from tensegrity_envs.mechanics.x_joints.curve import beyond
from tensegrity_envs.mechanics.x_joints.pairs import solve

Objective = Literal["sum", "max", "squares", "margin"]
_OBJECTIVES = ("sum", "max", "squares", "margin")
_FIRST_ANGLES = 40  # of joint 1, for which all configurations of the other two are starts
_PROJECTED = 200  # starts that are projected onto the configurations of a target; of 60, one in 1,400 best was missed
_STARTS = 60  # of sequential quadratic programmes
_FIRST_STEP, _LAST_STEP, _LONGEST_STEP = 0.02, 1e-11, 0.1  # [rad] of a walk
_MOST_STEPS = 400
_SAME = 1e-4  # [rad]

# configurations (n, k) and the indices (k,) of their targets -> values (k,)
Measure = Callable[[np.ndarray, np.ndarray], np.ndarray]


class Optimum(NamedTuple):
    """A configuration with the tip at the target that no other one nearby is better than.

    Attributes:
        configuration: n angles [rad].
        objective: its value [rad; rad^2 for "squares"; - for "margin", where larger is better].
    """

    configuration: tuple[float, ...]
    objective: float


class Redundancy(NamedTuple):
    """The best configuration of a target.

    Attributes:
        configuration: n angles [rad], NaN where the target is not reached.
        objective: its value, see `Optimum`; NaN where the target is not reached.
        is_reachable: whether a configuration within the joint limits has its tip there.
        stability_margin: of the configuration at its stiffest tensions under the load, see `NX.stability_margin`.
        wrench_margin: of the configuration under the load, see `NX.wrench_margin`; negative where no tensions hold it.
    """

    configuration: Components
    objective: Component
    is_reachable: Component
    stability_margin: Component = math.nan
    wrench_margin: Component = math.nan

    @property
    def is_stable_wrench_feasible(self) -> Component:
        """Whether feasible tensions hold the configuration in stable equilibrium; False where there is none."""
        return (self.stability_margin > 0) & (self.wrench_margin >= 0)


def measure_of(arm: Any, objective: str, start: np.ndarray, load: Sequence[Component]) -> Measure:
    """What is minimized: the objective, or minus the margin, for which the arm needs a method `posture`.

    Raises:
        ValueError: there is no such objective.
    """
    if objective not in _OBJECTIVES:
        raise ValueError(f"objective = {objective!r}: must be one of {', '.join(_OBJECTIVES)}")

    def measure(q: np.ndarray, owner: np.ndarray) -> np.ndarray:
        if objective == "margin":
            with np.errstate(all="ignore"):
                _, stability, wrench = arm.posture(tuple(q), load)
            return np.asarray(-np.minimum(stability, wrench))
        move = np.abs(q - start[:, owner])
        if objective == "squares":
            return np.asarray((move * move).sum(axis=0))
        return np.asarray(move.sum(axis=0) if objective == "sum" else move.max(axis=0))

    return measure


def project(
    arm: CableArm, q: np.ndarray, x: np.ndarray, y: np.ndarray, limit: float, rounds: int = 40
) -> tuple[np.ndarray, np.ndarray]:
    """Configurations (n, k) moved to where their tips are at the targets; and which of them are, within the limits."""
    size = float(arm.reach)
    q = q.copy()
    for _ in range(rounds):
        px, py = arm.tip(tuple(q))
        ex, ey = px - x, py - y
        if max(np.abs(ex).max(initial=0.0), np.abs(ey).max(initial=0.0)) < 1e-15 * size:
            break
        step = shortest_step(arm, q, ex, ey, size)
        length = np.abs(step).max(axis=0)
        q = np.clip(q - step * (0.5 / np.maximum(0.5, length)), -limit, limit)
    px, py = arm.tip(tuple(q))
    return q, np.asarray(np.hypot(px - x, py - y) < 1e-12 * size)


def shortest_step(arm: CableArm, q: np.ndarray, ex: np.ndarray, ey: np.ndarray, size: float) -> np.ndarray:
    """The smallest joint steps (n, k) [rad] that move the tips by (ex, ey) [m] to first order; `size` is the reach."""
    rows = arm.jacobian(tuple(q))
    jx, jy = (np.stack([np.broadcast_to(entry, ex.shape) for entry in row]) for row in rows)
    damping = 1e-3 * (ex * ex + ey * ey) + 1e-30 * size**2
    a, b, c = (jx * jx).sum(0) + damping, (jx * jy).sum(0), (jy * jy).sum(0) + damping
    det = a * c - b * b
    return np.asarray(jx * ((c * ex - b * ey) / det) + jy * ((a * ey - b * ex) / det))


def starts(arm: CableArm, x: np.ndarray, y: np.ndarray, limit: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Configurations (n, k) with the tip at the targets (m,), and the indices (k,) of their targets."""
    n, m = arm.degrees_of_freedom, len(x)
    rng = np.random.default_rng(0)
    owner = np.repeat(np.arange(m), count)
    spread = rng.uniform(-limit, limit, (n, count)) * rng.choice([0.1, 0.5, 1.0], count)
    q, there = project(arm, np.tile(spread, m), x[owner], y[owner], limit)
    owner, q = owner[there], q[:, there]
    if n > 3:
        return owner, q
    angles = np.linspace(-limit, limit, _FIRST_ANGLES)
    target, first = np.repeat(np.arange(m), len(angles)), np.tile(angles, m)
    dx, dy, _ = beyond(arm.bars[0], x[target], y[target], first)
    tail = type(arm)(last_joints(arm.design, 2))
    line, others, _ = solve(tail, dx, dy)
    return np.concatenate([owner, target[line]]), np.hstack([q, np.vstack([first[line], *others])])


def walk(
    arm: CableArm, q: np.ndarray, owner: np.ndarray, x: np.ndarray, y: np.ndarray, measure: Measure, limit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Points (3, k) of the curves of their targets walk downhill until steps of 1e-11 rad lead nowhere better."""
    size = float(arm.reach)
    q, value = q.copy(), measure(q, owner)
    step, sign, failed = np.full(len(owner), _FIRST_STEP), np.ones(len(owner)), np.zeros(len(owner), bool)
    heading = np.zeros_like(q)
    active = np.arange(len(owner))
    for _ in range(_MOST_STEPS):
        if not len(active):
            break
        here, target = q[:, active], owner[active]
        (xa, xb, xc), (ya, yb, yc) = arm.jacobian(tuple(here))
        tangent = np.stack([xb * yc - xc * yb, xc * ya - xa * yc, xa * yb - xb * ya])
        tangent /= np.maximum(np.sqrt((tangent * tangent).sum(axis=0)), 1e-300)
        turn = np.where((tangent * heading[:, active]).sum(axis=0) < 0, -1.0, 1.0)
        tangent = tangent * turn
        heading[:, active] = tangent
        new = here + tangent * (sign[active] * step[active])
        for _ in range(3):
            px, py = arm.tip(tuple(new))
            new = new - shortest_step(arm, new, px - x[target], py - y[target], size)
        px, py = arm.tip(tuple(new))
        fine = np.hypot(px - x[target], py - y[target]) < 1e-12 * size
        fine &= (np.abs(new) <= limit).all(axis=0)
        fine &= np.abs(new - here).max(axis=0) < 2 * step[active]
        tried = np.where(fine, measure(np.where(fine, new, here), target), np.inf)
        better = tried < value[active]
        q[:, active[better]], value[active[better]] = new[:, better], tried[better]
        step[active] = np.where(better, np.minimum(1.5 * step[active], _LONGEST_STEP), step[active])
        worse = active[~better]
        both = failed[worse]  # neither way is better: shorter steps
        step[worse[both]] *= 0.3
        sign[worse] *= -1
        failed[worse] = ~both
        failed[active[better]] = False
        active = active[step[active] > _LAST_STEP]
    return q, value


def _margins(design: Any, q: Components, arm: Any, load: Components) -> Components:
    """Stability and wrench margin."""
    return tuple(arm(design).posture(q, load)[1:])


def programme(
    arm: CableArm,
    q: np.ndarray,
    target: tuple[float, float],
    start: np.ndarray,
    objective: str,
    load: Sequence[Component],
    limit: float,
) -> np.ndarray:
    """A local optimum by SLSQP from a configuration (n,): the kinks of the objective are constraints."""
    from scipy.optimize import minimize  # slow to import, and only needed here

    n, size = len(q), float(arm.reach)
    more = {"squares": 0, "sum": n, "max": 1, "margin": 1}[objective]
    eye = np.eye(n)
    bounds: list[tuple[float | None, float | None]] = [(-limit, limit)] * n + [(None, None)] * more

    def tip(z: np.ndarray) -> np.ndarray:
        return np.asarray(np.subtract(arm.tip(tuple(z[:n].tolist())), target) / size)

    def tip_rows(z: np.ndarray) -> np.ndarray:
        return np.hstack([np.array(arm.jacobian(tuple(z[:n].tolist()))) / size, np.zeros((2, more))])

    constraints: list[Any] = [{"type": "eq", "fun": tip, "jac": tip_rows}]
    cost = np.concatenate([np.zeros(n), np.full(more, -1.0 if objective == "margin" else 1.0)])
    if objective == "margin":

        def margins(z: np.ndarray) -> np.ndarray:
            q = tuple(z[:n].tolist())
            if arm.design.routing == FROM_BASE:  # compiled, as facets are enumerated: a hundred times as fast
                found = evaluate(_margins, arm.design, q, type(arm), tuple(map(float, load)))
            else:
                found = arm.posture(q, load)[1:]
            return np.asarray(np.array(found) - z[n])

        constraints.append({"type": "ineq", "fun": margins})
        first = np.append(q, margins(np.append(q, 0.0)).min())
    elif objective == "squares":
        first = q
    else:
        slack = eye if objective == "sum" else np.ones((n, 1))
        rows = np.vstack([np.hstack([-eye, slack]), np.hstack([eye, slack])])
        offset = np.concatenate([start, -start])
        constraints.append({"type": "ineq", "fun": lambda z: rows @ z + offset, "jac": lambda z: rows})
        move = np.abs(q - start)
        first = np.concatenate([q, move if objective == "sum" else [move.max()]])

    def value(z: np.ndarray) -> float:
        return float(((z[:n] - start) ** 2).sum()) if objective == "squares" else float(cost @ z)

    def slope(z: np.ndarray) -> np.ndarray:
        return np.asarray(2 * (z - start) if objective == "squares" else cost)

    options: Any = {"ftol": 1e-10, "maxiter": 60} if objective == "margin" else {"ftol": 1e-15, "maxiter": 300}
    found = minimize(value, first, jac=slope, bounds=bounds, constraints=constraints, method="SLSQP", options=options)
    return np.asarray(found.x[:n])


def optima(
    arm: CableArm, x: np.ndarray, y: np.ndarray, start: np.ndarray, objective: str, load: Sequence[Component]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All local optima that were found: index of the target (k,), configurations (n, k), values (k,), best first."""
    limit, n = float(arm.design.joint_limit), arm.degrees_of_freedom
    if limit <= np.pi:
        limit = min(limit, np.pi - 1e-9)  # the flat poses are left out
    measure = measure_of(arm, objective, start, load)
    owner, q = starts(arm, x, y, limit, _PROJECTED if n == 3 else _STARTS)
    if n == 3:
        q, value = walk(arm, q, owner, x, y, measure, limit)
    elif len(owner):
        ends = [
            programme(arm, column, (float(x[i]), float(y[i])), start[:, i], objective, load, limit)
            for i, column in zip(owner, q.T, strict=True)
        ]
        found, there = project(arm, np.array(ends).T, x[owner], y[owner], limit, 8)
        before, after = measure(q, owner), measure(found, owner)
        keep = there & (after <= before)
        q = np.where(keep, found, q)
        value = np.where(keep, after, before)
    else:
        value = np.zeros(0)
    order = np.lexsort((value, owner))
    owner, q, value = owner[order], q[:, order], value[order]
    kept = np.ones(len(owner), bool)
    for i in range(len(owner)):  # the best one of each cluster
        if kept[i]:
            rest = slice(i + 1, np.searchsorted(owner, owner[i], side="right"))
            kept[rest] &= np.abs(q[:, rest] - q[:, [i]]).max(axis=0) > _SAME
    return owner[kept], q[:, kept], (-value[kept] if objective == "margin" else value[kept])
