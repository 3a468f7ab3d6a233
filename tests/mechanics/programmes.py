"""Local optima of unloaded arms of dual-triangles by sequential quadratic programmes of the tests' own.

Kinematics by hand; of the package only the stiffness matrix (diagonal without a load) and the control law. Of equal
segments all margins depend on the size of the joint's angle alone, so that kinks are where two sizes are equal.
"""

from itertools import combinations

import numpy as np
from scipy.optimize import minimize


def tip_and_jacobian(arm, q):
    """Of one configuration (n,): the tip (2,), and its derivatives (2, n)."""
    turn, lengths = np.cumsum(q), np.array(arm.link_lengths)
    links = lengths * np.array([np.cos(turn), np.sin(turn)])
    beyond = np.cumsum(links[:, ::-1], axis=1)[:, ::-1]
    return np.array([float(arm.base_height), 0.0]) + links.sum(axis=1), np.array([-beyond[1], beyond[0]])


def margins_of_joints(arm, q):
    """What the margin is the least of, each a function of one joint's angle: 3 n values."""
    lengths = np.array(arm.free_lengths(arm.control(tuple(q))))
    stiffness = np.array([row[i] for i, row in enumerate(arm.stiffness_matrix(tuple(q), tuple(lengths)))], float)
    first = arm.chain[0].design
    room = lengths.reshape(-1, 2).T.ravel() * 2 / (first.b1 + first.b2)
    return np.concatenate([stiffness / arm.stiffness_scale, room])


def programme(arm, objective, target, start, begin):
    """Where SLSQP ends from `begin`: angles z[:n], and n values or one that bound what is to be small."""
    n, limit = len(begin), float(arm.design.joint_limit)
    more, eye = {"sum": n, "max": 1, "squares": 0, "margin": 1}[objective], np.eye(len(begin))
    size = float(arm.reach)

    def padded(table):
        return np.hstack([table, np.zeros((2, more))])

    rules = [
        {
            "type": "eq",
            "fun": lambda z: (tip_and_jacobian(arm, z[:n])[0] - target) / size,
            "jac": lambda z: padded(tip_and_jacobian(arm, z[:n])[1] / size),
        }
    ]
    bounding = np.zeros(0)
    if objective == "margin":
        bounding = np.array([margins_of_joints(arm, begin).min()])
        ones = np.ones((3 * n, 1))

        def slopes(q, h=1e-6):
            each = (margins_of_joints(arm, q + h) - margins_of_joints(arm, q - h)) / (2 * h)
            return np.vstack([np.diag(part) for part in each.reshape(3, n)])

        rules.append(
            {
                "type": "ineq",
                "fun": lambda z: margins_of_joints(arm, z[:n]) - z[n],
                "jac": lambda z: np.hstack([slopes(z[:n]), -ones]),
            }
        )
    elif more:
        slack = eye if objective == "sum" else np.ones((n, 1))
        table = np.vstack([np.hstack([-eye, slack]), np.hstack([eye, slack])])
        offset = np.concatenate([start, -start])
        move = np.abs(begin - start)
        bounding = move if objective == "sum" else move.max(keepdims=True)
        rules.append({"type": "ineq", "fun": lambda z: table @ z + offset, "jac": lambda z: table})
    cost = np.concatenate([np.zeros(n), np.full(more, -1.0 if objective == "margin" else 1.0)])
    found = minimize(
        lambda z: cost @ z if more else ((z - start) ** 2).sum(),
        np.concatenate([begin, bounding]),
        jac=lambda z: cost if more else 2 * (z - start),
        bounds=[(-limit, limit)] * n + [(None, None)] * more,
        constraints=rules,
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 200},
    )
    return found.x[:n] if found.success else None


def optima_by_programmes(arm, objective, x, y, start, starts, rng):
    """Where programmes from random configurations end, of which some joints are at limits; each once."""
    n, limit, target, found = arm.segments, float(arm.design.joint_limit), np.array([x, y]), []
    for _ in range(starts):
        begin = rng.uniform(-limit, limit, n) * rng.choice([0.3, 1.0])
        held = rng.permutation(n)[: rng.integers(0, n - 1)]
        begin[held] = limit * rng.choice([-1, 1], len(held))
        free = np.setdiff1d(np.arange(n), held)
        for _ in range(40):  # Newton's method in the joints that are not at limits
            off, rows = tip_and_jacobian(arm, begin)
            step = np.linalg.lstsq(rows[:, free], off - target, rcond=1e-6)[0]
            begin[free] = np.clip(begin[free] - step * (0.5 / max(0.5, np.abs(step).max())), -limit, limit)
            if np.abs(step).max() < 1e-12:
                break
        end = programme(arm, objective, target, start, begin)
        if end is None or np.abs(tip_and_jacobian(arm, end)[0] - target).max() > 1e-9 * float(arm.reach):
            continue
        if all(np.abs(end - one).max() > 1e-3 for one in found):
            found.append(end)
    return found


def along_kinks(arm, objective, q, start, rng, steps=(2e-3, 5e-4, 1e-4)):
    """Configurations (n, any) beside q (n,) that stay on some of the kinks and limits which q is on."""
    n, target, eye = len(q), tip_and_jacobian(arm, q)[0], np.eye(len(q))
    from_start = q - (start if objective in ("sum", "max") else 0.0)
    rows = [eye[i] for i in np.flatnonzero(np.abs(np.abs(q) - float(arm.design.joint_limit)) < 1e-6)]
    if objective == "sum":
        rows += [eye[i] for i in np.flatnonzero(np.abs(from_start) < 1e-6)]
    elif objective in ("max", "margin"):
        size, sign = np.abs(from_start), np.sign(from_start)
        rows += [
            sign[i] * eye[i] - sign[j] * eye[j] for i, j in combinations(range(n), 2) if abs(size[i] - size[j]) < 1e-6
        ]
    found = []
    for kept in (kept for k in range(1, n - 2) for kept in combinations(rows, k)):
        table = np.vstack([tip_and_jacobian(arm, q)[1], *kept])
        free = np.linalg.svd(table)[2][len(table) :]
        for way in np.concatenate([free, rng.normal(size=(4, len(free))) @ free]):
            for step in (sign * size / np.abs(way).max() for size in steps for sign in (1, -1)):
                new = q + step * way
                for _ in range(6):
                    off, turned = tip_and_jacobian(arm, new)
                    rest = np.concatenate([off - target, [row @ (new - q) for row in kept]])
                    new = new - np.linalg.lstsq(np.vstack([turned, *kept]), rest, rcond=1e-9)[0]
                if np.abs(rest).max() < 1e-10 and np.abs(new - q).max() < 3 * abs(step):
                    found.append(new)
    return np.array(found).reshape(-1, n).T
