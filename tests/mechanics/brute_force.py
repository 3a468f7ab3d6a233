"""Equilibria by brute force: Newton's method from very many starts, which knows nothing of the solvers.

    python tests/mechanics/brute_force.py two-x|dual-triangle|planar-four-bar [--designs 1000] [--seed 0]

Each line counts random designs, equilibria that brute force found, and those of them that the solver missed: none.
"""

import argparse
import sys

import numpy as np

from tensegrity_envs.mechanics import (
    DualTriangle,
    DualTriangleDesign,
    PlanarFourBar,
    PlanarFourBarDesign,
    TwoX,
    TwoXDesign,
)

SAME = 1e-5  # [rad]


def newton(statics, starts, limit, steps=60):
    """Zeros of a gradient strictly inside the limits, shape (n, any), from starts of shape (n, m).

    Plain Newton steps of limited length, with the Hessian as it is: they go to minima, saddles and maxima alike.
    """
    q = starts.copy()
    for _ in range(steps):
        gradient, hessian = statics(q)
        scale = np.abs(hessian).max(axis=(0, 1)) + 1e-300
        matrix = np.moveaxis(hessian, -1, 0)
        normal = np.swapaxes(matrix, 1, 2) @ matrix + (1e-12 * scale**2)[:, None, None] * np.eye(len(q))
        step = np.linalg.solve(normal, (np.swapaxes(matrix, 1, 2) @ gradient.T[..., None]))[..., 0].T
        q = q - step * np.minimum(1.0, 0.3 / np.maximum(np.abs(step).max(axis=0), 1e-300))
        q = q[:, np.isfinite(q).all(axis=0)]
        q = q[:, (np.abs(q) < np.reshape(limit, (-1, 1)) + 1.0).all(axis=0)]
        if not q.shape[1]:
            return q
    gradient, hessian = statics(q)
    scale = np.abs(hessian).max(axis=(0, 1)) + 1e-300
    values = np.abs(np.linalg.eigvalsh(np.moveaxis(hessian, -1, 0))).min(axis=1)
    good = (np.abs(gradient).max(axis=0) < 1e-10 * scale) & (values > 1e-5 * scale)  # folds are a matter of rounding
    good &= (np.abs(q) < np.reshape(limit, (-1, 1)) - 1e-6).all(axis=0)
    return unique(q[:, good])


def unique(q):
    """One column of all that are the same."""
    kept = []
    for point in q.T:
        if not any(np.abs(point - other).max() < SAME for other in kept):
            kept.append(point)
    return np.array(kept).reshape(-1, len(q)).T


def arrays(gradient, hessian, shape):
    """A gradient and a Hessian of components as arrays."""
    rows = [np.stack([np.broadcast_to(np.asarray(h, float), shape) for h in row]) for row in hessian]
    return np.stack([np.broadcast_to(np.asarray(g, float), shape) for g in gradient]), np.stack(rows)


def random_dual_triangle(rng):
    """An arm, its free lengths and a load: bistable ones, cables and unequal triangles among them."""
    n = int(rng.integers(1, 5))
    a, b = rng.uniform(0.3, 1.5), rng.uniform(0.3, 1.5)
    springs = "cable" if rng.random() < 0.25 else "bilateral"
    if rng.random() < 0.5:
        design = DualTriangleDesign.symmetric(a, b, 1.0, rng.uniform(0, 2.5), springs)
    else:
        others = rng.uniform(0.3, 1.5, 2), rng.uniform(0.5, 2.0, 2), rng.uniform(0, 2.5, 2)
        design = DualTriangleDesign(a, b, *others[0], *others[1], *others[2], springs)
    arm = DualTriangle(design, n)
    nominal = np.array([design.free_length1, design.free_length2] * n)
    spread = rng.choice([0.0, 0.1, 0.5])
    lengths = tuple(np.abs(nominal + spread * rng.uniform(-1, 1, 2 * n)).tolist())
    size = rng.choice([0.0, 0.1, 0.5, 2.0]) * rng.random() * float(arm.stiffness_scale)
    if springs == "cable":
        size = max(size, 0.01)  # without a load slack cables leave a continuum
    angle = rng.uniform(-np.pi, np.pi)
    return arm, lengths, (float(size * np.cos(angle)), float(size * np.sin(angle)))


def missed_by_dual_triangle(rng, starts):
    """How many equilibria brute force finds, and which of them the solver does not."""
    arm, lengths, load = random_dual_triangle(rng)
    limit = float(arm.design.joint_limit)

    def statics(q):
        return arrays(*arm.statics(tuple(q), lengths, load), q.shape[1:])

    found = newton(statics, rng.uniform(-limit, limit, (arm.segments, starts)), [limit] * arm.segments)
    known = [np.array(e.configuration) for e in arm.equilibria(lengths, load)]
    missed = [q for q in found.T if not any(np.abs(q - other).max() < SAME for other in known)]
    stable = [q for q in missed if np.linalg.eigvalsh(statics(q[:, None])[1][..., 0]).min() > 0]
    return found.shape[1], len(known), missed, len(stable), (arm.design, arm.segments, lengths, load)


def random_two_x(rng):
    """An arm, tensions and a load: nearly equal bars and slack cables among them."""
    b = rng.choice([rng.uniform(0.1, 0.95), 1 - 10 ** rng.uniform(-8, -1)])
    design = TwoXDesign(
        b=b,
        l=1.0,
        a=rng.choice([0.0, rng.uniform(0, 2)]),
        k1=10 ** rng.uniform(0, 3),
        k2=10 ** rng.uniform(0, 3),
        min_tension=0.0,
        max_tension=1000.0,
        payload=rng.choice([0.0, 2.0]),
        joint_limit=rng.choice([2.6, np.pi]),
    )
    tensions = (rng.choice([0.0, 10.0, 300.0]) * rng.random(4)).tolist()
    load = (rng.choice([0.0, 10.0, 100.0]) * rng.normal(size=2)).tolist()
    return TwoX(design), tuple(tensions), tuple(load)


def missed_by_two_x(rng, starts):
    """See `missed_by_dual_triangle`."""
    arm, tensions, load = random_two_x(rng)
    limit = float(arm.design.joint_limit)

    def statics(q):
        return arrays(*arm.statics(tuple(q), tensions, load), q.shape[1:])

    q = rng.uniform(-limit, limit, (2, starts))
    q[:, ::3] *= 10 ** rng.uniform(-6, 0, q[:, ::3].shape)  # nearly equal bars: much happens at the straight posture
    found = newton(statics, q, [limit - 1e-3] * 2)
    known = [np.array(e.configuration) for e in arm.equilibria(tensions, load)]
    missed = [q for q in found.T if not any(np.abs(q - other).max() < SAME for other in known)]
    stable = [q for q in missed if np.linalg.eigvalsh(statics(q[:, None])[1][..., 0]).min() > 0]
    return found.shape[1], len(known), missed, len(stable), (arm.design, tensions, load)


def missed_by_planar_four_bar(rng, starts):
    """See `missed_by_dual_triangle`; equal lengths and forces along the axes among the cases."""
    mechanism = PlanarFourBar(PlanarFourBarDesign(length=1.0, stiffness=1.0))
    lengths = rng.uniform(0, 2, 2)
    if rng.random() < 0.3:
        lengths[1] = lengths[0]
    lengths = np.where(rng.random(2) < 0.1, rng.choice([1.0, 2.0], 2), lengths)
    force = rng.choice([0.1, 0.5, 2.0, 5.0]) * rng.normal(size=2) * rng.choice([[1, 0], [0, 1], [1, 1]])
    lengths, load = tuple(lengths.tolist()), tuple(force.tolist())

    def statics(q):
        return arrays(*mechanism.statics(tuple(q), lengths, load), q.shape[1:])

    found = newton(statics, rng.uniform(-np.pi, np.pi, (2, starts)), [4 * np.pi] * 2)
    found = unique((found + np.pi) % (2 * np.pi) - np.pi)
    known = [np.array(e.configuration) for e in mechanism.equilibria(lengths, load)]

    def gap(q, other):
        return np.abs((q - other + np.pi) % (2 * np.pi) - np.pi).max()

    missed = [q for q in found.T if not any(gap(q, other) < SAME for other in known)]
    stable = [q for q in missed if np.linalg.eigvalsh(statics(q[:, None])[1][..., 0]).min() > 0]
    return found.shape[1], len(known), missed, len(stable), (lengths, load)


CASES = {
    "dual-triangle": missed_by_dual_triangle,
    "two-x": missed_by_two_x,
    "planar-four-bar": missed_by_planar_four_bar,
}


def main():
    """Parse the command line, print the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mechanism", choices=CASES)
    parser.add_argument("--designs", type=int, default=1000)
    parser.add_argument("--starts", type=int, default=1500)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    found = known = lost = stable = 0
    for k in range(given.designs):
        count, ours, missed, of_them_stable, what = CASES[given.mechanism](
            np.random.default_rng([given.seed, k]), given.starts
        )
        found, known, lost, stable = found + count, known + ours, lost + len(missed), stable + of_them_stable
        for q in missed:
            print(f"design {k} {what}: missed {q.tolist()}")
        if k % 50 == 49:
            print(
                f"{k + 1} designs: brute force {found}, solver {known}, missed {lost}, stable ones {stable}", flush=True
            )
    return int(lost > 0)


if __name__ == "__main__":
    sys.exit(main())
