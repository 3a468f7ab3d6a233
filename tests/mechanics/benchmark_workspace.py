"""Speed of the workspace analysis against the paper's polynomials, whose reference implementation lives in the tests.

Run by `make bench`, or: python tests/mechanics/benchmark_workspace.py [--designs 1000]
"""

import argparse
import time
from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.table import Table
from two_x_polynomials import DEGREES, candidates, intervals, scan

from tensegrity_envs.geometry.workspace import (
    stable_wrench_feasible_joint_space,
    stable_wrench_feasible_size,
    stable_wrench_feasible_workspace,
)
from tensegrity_envs.mechanics import MURALIDHARAN2022, TwoX, TwoXDesign

LINES, ROUNDS = 50, 5


def random_designs(count):
    """Arms around the published one: lengths, springs, bounds and payload of another size."""
    rng = np.random.default_rng(0)
    for _ in range(count):
        b, stiffness = rng.uniform(0.03, 0.08), 10 ** rng.uniform(1.5, 3.1)
        yield TwoXDesign(
            b=b,
            l=b * rng.uniform(1.3, 3.0),
            a=rng.uniform(0.05, 0.3),
            k1=stiffness,
            k2=stiffness * rng.uniform(0.2, 1.2),
            min_tension=rng.uniform(1, 8),
            max_tension=rng.uniform(60, 250),
            payload=rng.uniform(0.0, 0.5),
        )


def seconds(function):
    begun = time.perf_counter()
    result = function()
    return time.perf_counter() - begun, result


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--designs", type=int, default=1000, help="of the sweep")
    count = parser.parse_args().designs
    console = Console(width=110)
    table = Table("measured", "time", "remark")

    # The paper's scan. Its polynomials are given; only numpy.roots is timed, and then with the choice of intervals.
    m = TwoX()
    polynomials = scan(m, LINES)
    region = stable_wrench_feasible_joint_space(m)
    roots, whole, ours = [], [], []
    for _ in range(ROUNDS):
        taken, angles = seconds(lambda: [candidates(p) for _, _, p in polynomials])
        roots.append(taken)
        taken, theirs = seconds(
            lambda angles=angles: [
                intervals(m, s, v, found) for (s, v, _), found in zip(polynomials, angles, strict=True)
            ]
        )
        whole.append(roots[-1] + taken)
        ours.append(seconds(lambda: region.scan(LINES))[0])
    found = [i for scanned in (0, 1) for i in region.slices(1 - scanned, np.linspace(*_ends(region), LINES))]
    assert [len(i) for i in found] == [len(i) for i in theirs], "the two scans found different intervals"
    gap = max(abs(a - b) for i, j in zip(found, theirs, strict=True) for u, v in zip(i, j, strict=True)
              for a, b in zip(u[:2], v, strict=True))  # fmt: skip
    roots_s, whole_s, ours_s = (float(np.median(times)) for times in (roots, whole, ours))
    degrees = ", ".join(str(d) for d in sorted({d for row in DEGREES for d in row}))
    table.add_row(
        f"polynomials, {LINES} + {LINES} grid lines", f"{1e3 * roots_s:.0f} ms",
        f"numpy.roots on {8 * len(polynomials)} of degree {degrees}; coefficients not counted",
    )  # fmt: skip
    table.add_row("  with the choice of intervals", f"{1e3 * whole_s:.0f} ms", f"{sum(map(len, theirs))} intervals")
    table.add_row(
        "ours, the same scan", f"{1e3 * ours_s:.1f} ms",
        f"{roots_s / ours_s:.1f} times faster than the roots alone "
        f"(needed 3: {'met' if roots_s > 3 * ours_s else 'MISSED'}; "
        f"goal 10: {'met' if roots_s > 10 * ours_s else 'MISSED'}); same intervals to {gap:.0e} rad",
    )  # fmt: skip
    for payload in (0.0, 0.5):
        arm = TwoX(replace(MURALIDHARAN2022, payload=payload))
        taken, space = seconds(lambda arm=arm: stable_wrench_feasible_workspace(arm))
        table.add_row(f"SWFW, payload {payload:g} kg", f"{taken:.2f} s", f"area error {space.area_error:.0e} m2")
    designs = list(random_designs(count))
    taken, sizes = seconds(lambda: [stable_wrench_feasible_size(TwoX(design)) for design in designs])
    checked = range(0, count, max(1, count // 20))
    exact = [stable_wrench_feasible_workspace(TwoX(designs[k]), tolerance=1e-5) for k in checked]
    errors = [
        max(abs(sizes[k].area - w.area()), abs(sizes[k].fraction - sum(s.source.fraction for s in w.sheets)))
        for k, w in zip(checked, exact, strict=True)
    ]
    table.add_row(
        f"sweep over {count} designs", f"{taken:.0f} s",
        f"{count / taken:.1f} designs/s; largest error of fraction and area (m2) in {len(errors)}: {max(errors):.0e}",
    )  # fmt: skip
    console.print(table)


def _ends(region):
    return region.lower[0], region.upper[0]


if __name__ == "__main__":
    main()
