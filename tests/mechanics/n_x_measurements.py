"""What docs/n_x.md reports of the n-X, measured on large counts; interrupted runs go on where they stopped.

    python tests/mechanics/n_x_measurements.py WHAT [--count N] [--state FILE]

WHAT is one of the functions in `WHAT` below. Every item (an arm, a posture, a batch of targets) is one line of the
state file; the summary is printed whenever the script ends.
"""

import argparse
import json
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
from n_x_checks import (
    derivative_errors,
    distance_after_release,
    draw,
    is_held,
    missed_equilibria,
    random_arm,
    worse_than_slides,
)

OBJECTIVES = ("sum", "max", "squares", "margin")


def derivatives(k):
    """Gradient, Hessian and torque matrix against autograd of nodes and members: 200 designs of each n."""
    joints = 1 + k % 6
    arm, rng = random_arm(k // 6, joints)
    return {"joints": joints, "largest relative error": max(derivative_errors(arm, *draw(arm, rng)))}


def wrench(k):
    """Wrench feasibility against a linear programme, one posture; not within 1e-9 of the boundary."""
    joints = 1 + k % 6
    arm, rng = random_arm(k // 6, joints, strong=k // 6 % 2 == 0)
    q, _, load = draw(arm, rng, min(arm.design.joint_limit, 3.0) * rng.choice([0.2, 0.5, 1.0]))
    margin = arm.wrench_margin(q, load=load)
    held = is_held(arm, q, load, arm.design.min_tension)
    return {"joints": joints, "feasible": int(held), "mismatches": int(abs(margin) > 1e-9 and held != (margin > 0))}


def equilibria(k):
    """Equilibria against Newton's method from 2,000 starts: one arm with tensions and a load."""
    joints = 1 + k % 3
    by_starts, ours, missed = missed_equilibria(k // 3, joints, 2000)
    return {"joints": joints, "by starts": by_starts, "solver": ours, "missed": len(missed)}


def reached(k):
    """Four joints and more: whether the arm comes back to a posture under its stiffest tensions, from beside it."""
    joints = 4 + k % 3
    distance = distance_after_release(k // 3, joints)
    return {"joints": joints, "released": int(distance is not None), "farthest [rad]": distance or 0.0}


def redundancy(k):
    """The best configuration of three joints against slides from 200 starts: ten targets, one objective."""
    objective = OBJECTIVES[k % 4]
    return {"objective": objective, "targets": 10, "worse by": worse_than_slides(k // 4, 3, 10, objective, 200)}


def redundancy_of_more(k):
    """The same of four and of five joints: two targets, 200 starts."""
    objective, joints = OBJECTIVES[k % 4], 4 + k // 4 % 2
    worse = worse_than_slides(k // 8, joints, 2, objective, 200)
    return {"objective": f"{objective} of {joints}", "targets": 2, "worse by": worse}


WHAT = {
    "derivatives": (derivatives, 1200),
    "wrench": (wrench, 10_000),
    "equilibria": (equilibria, 600),
    "reached": (reached, 600),
    "redundancy": (redundancy, 200),
    "redundancy-of-more": (redundancy_of_more, 104),
}


def summary(lines):
    """Sums of counts and largest errors, by the first field."""
    groups = {}
    for line in lines:
        key = next(iter(line.items()))
        total = groups.setdefault(key, (Counter(), {}))
        total[0]["items"] += 1
        for name, value in list(line.items())[1:]:
            if isinstance(value, int):
                total[0][name] += value
            else:
                total[1][name] = max(total[1].get(name, -np.inf), value)
    for (name, value), (counts, largest) in sorted(groups.items(), key=lambda item: str(item[0])):
        print(f"{name} {value}: {dict(counts)} {largest or ''}")


def main():
    """Parse the command line, measure what the state file does not hold yet, print the summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=WHAT)
    parser.add_argument("--count", type=int, help="items; by default as many as docs/n_x.md reports")
    parser.add_argument("--state", type=Path, help="file of results so far; n_x_WHAT.jsonl by default")
    given = parser.parse_args()
    measure, count = WHAT[given.what]
    count = given.count or count
    path = given.state or Path(f"n_x_{given.what}.jsonl")
    lines = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    begun = time.monotonic()
    try:
        with path.open("a") as file:
            for k in range(len(lines), count):
                lines.append(measure(k))
                file.write(json.dumps(lines[-1]) + "\n")
                file.flush()
                if time.monotonic() - begun > 20:
                    print(f"{k + 1} of {count}", file=sys.stderr, flush=True)
                    begun = time.monotonic()
    except KeyboardInterrupt:
        print("interrupted; the same command goes on", file=sys.stderr)
    summary(lines)
    return 0


if __name__ == "__main__":
    sys.exit(main())
