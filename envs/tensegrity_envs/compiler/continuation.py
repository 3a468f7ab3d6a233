"""Following a stable equilibrium along a path, for some arms at once.

`kernel` makes machine code of it, see `lowering`; as it stands it runs too, on NumPy's matrices.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from tensegrity_envs.compiler.lowering import Matrix, Vector

CONVERGED = 1e-6  # last Newton step [rad or m]; the error that it leaves is of the order of its square
ITERATIONS = 6
CONTRACTION = 0.25  # a Newton step longer than this times the one before: too far from the path
FIRST_STEP = 0.8  # longest first step of a sub-step [rad or m]
CHANGE = 3.0  # the determinant of the Hessian changes at most by this factor, from the start of a step to its end
ITERATIONS_OF_SUBSTEP = 3  # leave an error that the next sub-step corrects
GOING_ON, FAILED, SOLVED = 0.0, 1.0, 2.0
TOGETHER = 8  # columns of which a Newton step takes care at once: `loops.LANES`


class Rows:
    """The rows of the matrix on which a path of n coordinates is followed; each of its columns is an arm.

    Attributes:
        parameter: of the path; the coordinates stand before it, in the rows from 0 on.
        step: the first of n rows with the Newton step there.
        pivot: the Hessian's smallest, positive exactly where it is positive definite.
        volume: the Hessian's determinant.
        known_volume: that at the last known equilibrium.
        longest: Newton step that is accepted.
        status: of a solution.
        last_volume: the determinant at the last step that counted.
        known: the first of n rows with the last known equilibrium.
        captured: the first row with the numbers that the path depends on.
    """

    def __init__(self, n: int) -> None:
        self.parameter, self.step = n, n + 1
        self.pivot, self.volume = 2 * n + 1, 2 * n + 2
        self.known_volume, self.longest, self.status = 2 * n + 3, 2 * n + 4, 2 * n + 5
        self.last_volume, self.known, self.captured = 2 * n + 6, 2 * n + 7, 3 * n + 7


def follower(newton: Callable[..., None], n: int, compiled: Callable[..., Any]) -> Any:
    """The function that follows the equilibrium whose Newton steps are given.

    Args:
        newton: `newton(c, w, count)` fills the rows of step, pivot and volume in the first columns of w.
        n: number of coordinates.
        compiled: decorator.
    """
    rows = Rows(n)
    PARAMETER, STEP, PIVOT, VOLUME = rows.parameter, rows.step, rows.pivot, rows.volume
    KNOWN_VOLUME, LONGEST, STATUS, KNOWN = rows.known_volume, rows.longest, rows.status, rows.known
    LAST_VOLUME = rows.last_volume

    @compiled
    def solve(c: Vector, w: Matrix, count: int, iterations: int) -> None:
        """Newton's method inside a region where the energy is convex, from the known equilibria; fills the status.

        It fails at the first indefinite Hessian, the first long step, the first step that does not contract, or where
        the determinant has changed much since the known equilibrium: by then it may be heading for an equilibrium that
        is not the continuation of that one [Deuflhard, Newton Methods for Nonlinear Problems]. With fewer iterations
        than `ITERATIONS` it need not converge, only contract.
        """
        for j in range(count):
            for i in range(n):
                w[i, j] = w[KNOWN + i, j]
            w[LONGEST, j], w[STATUS, j] = FIRST_STEP, GOING_ON
        for _ in range(iterations):
            newton(c, w, count)
            going_on = False
            for j in range(count):
                if w[STATUS, j] != GOING_ON:
                    continue
                w[LAST_VOLUME, j] = w[VOLUME, j]  # the others' next steps fill the row again
                size = 0.0
                for i in range(n):
                    size = max(size, abs(w[STEP + i, j]))
                fine = w[PIVOT, j] > 0.0 and size <= w[LONGEST, j]
                fine = fine and w[VOLUME, j] * CHANGE >= w[KNOWN_VOLUME, j]
                fine = fine and w[VOLUME, j] <= CHANGE * w[KNOWN_VOLUME, j]
                if not fine:  # NaN is not fine either
                    w[STATUS, j] = FAILED
                    continue
                for i in range(n):
                    w[i, j] -= w[STEP + i, j]
                if size <= CONVERGED:
                    w[STATUS, j] = SOLVED
                else:
                    w[LONGEST, j] = max(CONTRACTION * size, CONVERGED)
                    going_on = True
            if not going_on:
                return
        for j in range(count):
            if w[STATUS, j] == GOING_ON:
                w[STATUS, j] = SOLVED if iterations < ITERATIONS else FAILED

    @compiled
    def substeps(c: Vector, w: Matrix, count: int, resolution: float) -> None:
        """Follow the equilibria in the first columns, each in sub-steps of its own, shortened until Newton's steps
        contract.
        """
        t, length, ahead = np.zeros(w.shape[1]), np.zeros(w.shape[1]), np.zeros(w.shape[1])
        for j in range(count):
            length[j] = 0.5
        while True:
            going_on = False
            for j in range(count):
                ahead[j] = t[j]
                if t[j] < 1.0 and length[j] > resolution:
                    ahead[j] = min(t[j] + length[j], 1.0)
                    going_on = True
                w[PARAMETER, j] = ahead[j]
            if not going_on:
                break
            solve(c, w, count, ITERATIONS_OF_SUBSTEP)
            for j in range(count):
                if ahead[j] == t[j]:
                    continue
                if w[STATUS, j] == SOLVED:
                    t[j], w[KNOWN_VOLUME, j] = ahead[j], w[LAST_VOLUME, j]
                    for i in range(n):
                        w[KNOWN + i, j] = w[i, j]
                    length[j] *= 2.0
                else:
                    length[j] *= 0.5
        solve(c, w, count, ITERATIONS)
        for j in range(count):
            if w[STATUS, j] != SOLVED:
                for i in range(n):
                    w[i, j] = w[KNOWN + i, j]

    @compiled
    def follow(c: Vector, w: Matrix, alone: Matrix, count: int, resolution: float) -> None:
        """Follow the stable equilibria in the first rows from path parameter 0 to 1.

        One Newton solve for all at once; those whose steps do not contract from the start go on in sub-steps.
        Leaves the last stable points in the first rows, and in that of the parameter what fraction of the path was
        covered: 1, or less where stability ended (or all but ended: where a sub-step of the given resolution is still
        too long).

        Args:
            c: the constants.
            w: the rows that `Rows` tells, followed by those of `newton` itself.
            alone: another matrix of that shape, overwritten.
            count: how many columns are filled.
            resolution: length of the shortest sub-step, as a fraction of the path.
        """
        place = np.zeros(w.shape[1])  # of those that go on in sub-steps
        for j in range(count):
            w[PARAMETER, j] = 0.0
            for i in range(n):
                w[KNOWN + i, j] = w[i, j]
        newton(c, w, count)
        for j in range(count):
            w[KNOWN_VOLUME, j] = w[VOLUME, j] if w[PIVOT, j] > 0.0 else math.nan  # of an unstable one nothing follows
            w[PARAMETER, j] = 1.0
        solve(c, w, count, ITERATIONS)
        left = 0
        for j in range(count):
            if w[STATUS, j] == SOLVED:
                continue
            if math.isnan(w[KNOWN_VOLUME, j]):
                w[PARAMETER, j] = 0.0
                for i in range(n):
                    w[i, j] = w[KNOWN + i, j]
                continue
            place[left] = j
            left += 1
        if left == 0:
            return
        for i in range(w.shape[0]):
            for k in range((left + TOGETHER - 1) // TOGETHER * TOGETHER):
                alone[i, k] = w[i, int(place[min(k, left - 1)])]
        substeps(c, alone, left, resolution)
        for k in range(left):
            for i in range(n + 1):
                w[i, int(place[k])] = alone[i, k]

    return follow
