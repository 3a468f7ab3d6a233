"""Independent routes for the n-X: nodes and members by autograd, linear programmes, brute force from many starts.

Used by the tests on small counts and by n_x_measurements.py on large ones.
"""

from dataclasses import replace

import numpy as np
from brute_force import arrays, newton
from mechanism_cases import node_energy, random_n_x_design
from scipy.optimize import linprog

from tensegrity_envs.mechanics import MURALIDHARAN2022, NX, NXDesign

ROUTINGS = ("per_joint", "from_base")


def random_matrix(rng, joints):
    """A routing of more cables than joints; each joint has one on either side."""
    cables = int(rng.integers(joints + 1, 2 * joints + 2))
    while True:
        table = rng.integers(-1, 2, (cables, joints))
        if table.any(axis=1).all() and (table.min(axis=0) < 0).all() and (table.max(axis=0) > 0).all():
            return tuple(tuple(map(int, row)) for row in table)


def random_arm(seed, joints, strong=False):
    """An arm of one of the three kinds of routing, and a generator; a strong one can hold most postures."""
    rng = np.random.default_rng([seed, joints, 7])
    kind = seed % 3
    routing = ROUTINGS[kind] if kind < 2 else random_matrix(rng, joints)
    design = random_n_x_design(seed, joints, routing)
    if strong:
        design = replace(design, max_tension=3 * joints * design.max_tension, bar_radius=0.2 * design.bar_radius)
        design = replace(design, payload=0.1 * design.payload)
    return NX(design), rng


def draw(arm, rng, limit=None):
    """A configuration, tensions and a load, as floats."""
    limit = arm.design.joint_limit if limit is None else limit
    q = rng.uniform(-limit, limit, arm.degrees_of_freedom)
    tensions = rng.uniform(0, arm.design.max_tension, len(arm.input_names))
    return tuple(q.tolist()), tuple(tensions.tolist()), tuple(rng.normal(0, 5, 2).tolist())


def derivative_errors(arm, q, tensions, load):
    """Relative errors of gradient, Hessian and torque matrix, against autograd of the energy of nodes and members."""
    import torch

    n = len(q)
    given = torch.tensor([*q, *tensions], dtype=torch.float64)

    def energy(values):
        force = tuple(torch.tensor(f, dtype=torch.float64) for f in load)
        return node_energy(arm, tuple(values[:n]), tuple(values[n:]), force)

    first = torch.autograd.functional.jacobian(energy, given).numpy()
    second = torch.autograd.functional.hessian(energy, given).numpy()
    pairs = (
        (arm.energy_gradient(q, tensions, load), first[:n]),
        (arm.stiffness_matrix(q, tensions, load), second[:n, :n]),
        (arm.torque_matrix(q), -second[:n, n:]),
    )
    return [float(np.abs(np.subtract(ours, theirs)).max() / np.abs(theirs).max()) for ours, theirs in pairs]


def largest_least_tension(arm, q, load):
    """By linear programme: the largest smallest tension [N] with which tensions up to the maximum hold q, or None."""
    table, moments = np.array(arm.torque_matrix(q)), np.array(arm.passive_gradient(q, load))
    scale = np.abs(table).sum(axis=1) + 1e-300
    table, moments = table / scale[:, None], moments / scale
    m, high = table.shape[1], arm.design.max_tension
    answer = linprog(
        np.append(np.zeros(m), -1.0),
        A_ub=np.hstack([-np.eye(m), np.ones((m, 1))]),
        b_ub=np.zeros(m),
        A_eq=np.hstack([table, np.zeros((len(q), 1))]),
        b_eq=moments,
        bounds=[(None, high)] * m + [(None, None)],
        method="highs",
    )
    return -answer.fun if answer.status == 0 else None


def is_held(arm, q, load, low):
    """By linear programme: whether some tensions between `low` and the maximum hold q."""
    table, moments = np.array(arm.torque_matrix(q)), np.array(arm.passive_gradient(q, load))
    scale = np.abs(table).sum(axis=1) + 1e-300
    m = table.shape[1]
    bounds = [(low, arm.design.max_tension)] * m
    answer = linprog(np.zeros(m), A_eq=table / scale[:, None], b_eq=moments / scale, bounds=bounds, method="highs")
    return answer.status == 0


def equilibria_case(seed, joints):
    """An arm within the flat poses, tensions (slack ones among them) and a load."""
    arm, rng = random_arm(seed, joints)
    limit = min(arm.design.joint_limit, 3.1)
    arm = NX(replace(arm.design, joint_limit=limit, gravity=9.81))
    tensions = rng.uniform(0, arm.design.max_tension, len(arm.input_names)) * rng.choice([0.0, 0.1, 1.0])
    load = rng.normal(0, 5, 2) * rng.choice([0.0, 1.0])
    return arm, tuple(tensions.tolist()), tuple(load.tolist()), rng


def equilibria_by_starts(arm, tensions, load, rng, starts):
    """Equilibria by Newton's method from random starts, shape (n, any)."""

    def statics(q):
        return arrays(*arm.statics(tuple(q), tensions, load), q.shape[1:])

    n, limit = arm.degrees_of_freedom, arm.design.joint_limit
    return newton(statics, rng.uniform(-limit, limit, (n, starts)), [limit - 1e-3] * n)


def missed_equilibria(seed, joints, starts):
    """How many equilibria the starts find, how many the solver, and which of the former it misses."""
    arm, tensions, load, rng = equilibria_case(seed, joints)
    known = [np.array(e.configuration) for e in arm.equilibria(tensions, load)]
    found = equilibria_by_starts(arm, tensions, load, rng, starts)
    missed = [q for q in found.T if not any(np.abs(q - other).max() < 1e-5 for other in known)]
    return found.shape[1], len(known), missed


def distance_after_release(seed, joints):
    """How far from a posture [rad] the arm rests under its stiffest tensions, released from beside it; None where they
    do not hold it or its stability margin is below 0.02. Infinite where it comes to rest nowhere stable.
    """
    arm, rng = random_arm(seed, joints, strong=True)
    load = tuple(rng.normal(0, 1, 2).tolist())
    q = rng.uniform(-0.5, 0.5, joints)
    tensions, stability, wrench = arm.posture(tuple(q.tolist()), load)
    if wrench < 0 or stability < 0.02:
        return None
    found = arm.equilibrium(tensions, tuple((q + rng.uniform(-0.01, 0.01, joints)).tolist()), load)
    return float(np.abs(np.subtract(found.configuration, q)).max()) if found.is_stable else np.inf


def redundancy_targets(seed, joints, count):
    """An arm (every third one unequal), targets that it reaches, and starts."""
    rng = np.random.default_rng([seed, joints, 3])
    if seed % 3 == 2:
        arm = NX(replace(random_n_x_design(seed, joints), joint_limit=2.6))
    else:
        arm = NX(replace(NXDesign.from_two_x(MURALIDHARAN2022, joints), joint_limit=(2.6, 1.2)[seed % 3]))
    limit = arm.design.joint_limit
    q = rng.uniform(-limit, limit, (joints, count))
    x, y = arm.tip(tuple(q))
    return arm, x, y, rng.uniform(-0.5, 0.5, (joints, count)), rng


def best_by_slides(arm, x, y, start, objective, rng, starts, rounds=160):
    """The best value of the objective that random tangential steps of shrinking length from random starts lead to.

    Projection by pseudo-inverse, tangents by projection of random directions: nothing of the package but tip and
    Jacobian (and, for "margin", the margins). The objective may be a function of configurations (n, k), to be small.
    """
    n, m = len(start), len(x)
    limit, size = arm.design.joint_limit, float(arm.reach)
    owner = np.repeat(np.arange(m), starts)
    target = np.stack([x[owner], y[owner]])

    def jacobian(q):
        return np.array([[np.broadcast_to(e, q.shape[1:]) for e in row] for row in arm.jacobian(tuple(q))])

    def project(q, target, rounds):
        for _ in range(rounds):
            step = least_step(jacobian(q), np.array(arm.tip(tuple(q))) - target)
            q = np.clip(q - step * (0.5 / np.maximum(0.5, np.abs(step).max(axis=0))), -limit, limit)
        return q, np.hypot(*(np.array(arm.tip(tuple(q))) - target)) < 1e-10 * size

    def value(q, fine, begin):
        if callable(objective):
            return np.where(fine, objective(q), np.inf)
        if objective == "margin":
            with np.errstate(all="ignore"):
                _, stability, wrench = arm.posture(tuple(q))
            return np.where(fine, -np.minimum(stability, wrench), np.inf)
        move = np.abs(q - begin)
        total = {"sum": move.sum(0), "max": move.max(0), "squares": (move**2).sum(0)}[objective]
        return np.where(fine, total, np.inf)

    q, fine = project(rng.uniform(-limit, limit, (n, len(owner))), target, 25)
    best, step = value(q, fine, start[:, owner]), np.full(len(owner), 0.1)
    for _ in range(rounds):
        going = np.flatnonzero(step > 1e-14)
        if not len(going):
            break
        here, place, begin = q[:, going], target[:, going], start[:, owner[going]]
        rows, mix = jacobian(here), rng.normal(size=here.shape)
        direction = mix - least_step(rows, (rows * mix).sum(axis=1))
        direction /= np.linalg.norm(direction, axis=0)
        improved = np.zeros(len(going), bool)
        for sign in (1, -1):
            new, fine = project(here + sign * step[going] * direction, place, 3)
            tried = value(new, fine, begin)
            better = tried < best[going]
            here, best[going] = np.where(better, new, here), np.where(better, tried, best[going])
            improved |= better
        q[:, going] = here
        step[going] *= np.where(improved, 1.3, 0.5 if n == 3 else 0.75)
        step = np.minimum(step, 0.2)
    found = np.full(m, np.inf)
    np.minimum.at(found, owner, best)
    return found


def better_beside(arm, q, objective, start, rng):
    """By how much a configuration at the same tip, up to 2e-3 rad from q (n,), is better, of 600 in all directions."""
    n, size = len(q), float(arm.reach)

    def rows(p):
        return np.array([[np.broadcast_to(e, p.shape[1:]) for e in row] for row in arm.jacobian(tuple(p))])

    def value(p):
        if objective == "margin":
            return -np.minimum(*arm.posture(tuple(p))[1:])
        move = np.abs(p - start[:, None])
        return {"sum": move.sum(0), "max": move.max(0), "squares": (move**2).sum(0)}[objective]

    here, target = q[:, None], np.array(arm.tip(tuple(q)))[:, None]
    mix = rng.normal(size=(n, 600))
    at = rows(here)
    way = mix - least_step(at, (at * mix).sum(axis=1))
    new = here + way * rng.choice([2e-3, 5e-4, 1e-4], 600) / np.abs(way).max(axis=0)
    new = np.clip(new, -arm.design.joint_limit, arm.design.joint_limit)
    for _ in range(3):
        new = new - least_step(rows(new), np.array(arm.tip(tuple(new))) - target)
    fine = np.hypot(*(np.array(arm.tip(tuple(new))) - target)) < 1e-12 * size
    fine &= (np.abs(new) <= arm.design.joint_limit).all(axis=0)
    return float(value(here)[0] - value(new[:, fine]).min(initial=np.inf))


def least_step(rows, off):
    """The least joint steps (n, k) that move tips by (2, k): the pseudo-inverse of Jacobians (2, n, k), in closed form.

    Of rows that are nearly parallel the smaller singular value counts as zero.
    """
    (a, b), (_, c) = np.einsum("ink,jnk->ijk", rows, rows)
    det, trace = a * c - b * b, a + c
    full = det > 1e-16 * trace**2
    det = np.where(full, det, 1.0)
    x = np.where(full, (c * off[0] - b * off[1]) / det, off[0] / trace)
    y = np.where(full, (a * off[1] - b * off[0]) / det, off[1] / trace)
    return rows[0] * x + rows[1] * y


def worse_than_slides(seed, joints, count, objective, starts):
    """By how much a value that slides find is better than the package's, the most of all targets."""
    arm, x, y, start, rng = redundancy_targets(seed, joints, count)
    ours = arm.redundancy(x, y, tuple(start), objective)
    assert ours.is_reachable.all()
    tips = np.array(arm.tip(ours.configuration))
    assert np.abs(tips - np.stack([x, y])).max() < 1e-10 * arm.reach
    assert np.abs(np.array(ours.configuration)).max() <= arm.design.joint_limit
    sign = -1 if objective == "margin" else 1
    return float((sign * ours.objective - best_by_slides(arm, x, y, start, objective, rng, starts)).max())
