"""Independent routes for the n-X: nodes and members by autograd, linear programmes, brute force from many starts.

Used by the tests on small counts and by n_x_measurements.py on large ones.
"""

from dataclasses import replace

import numpy as np
from brute_force import arrays, newton
from mechanism_cases import node_energy, random_n_x_design
from scipy.optimize import linprog

from tensegrity_envs.mechanics import NX

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
