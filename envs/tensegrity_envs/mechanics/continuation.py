"""Following a stable equilibrium along a path, for one arm. `compiling` turns this into machine code."""

from collections.abc import Callable
from typing import Any

CONVERGED = 1e-6  # last Newton step [rad or m]; the error that it leaves is of the order of its square
ITERATIONS = 6
CONTRACTION = 0.25  # a Newton step longer than this times the one before: too far from the path
FIRST_STEP = 0.8  # longest first step of a sub-step [rad or m]
CHANGE = 3.0  # the determinant of the Hessian changes at most by this factor, from the start of a step to its end
ITERATIONS_OF_SUBSTEP = 3  # leave an error that the next sub-step corrects


def follower(newton: Callable[..., None], compiled: Callable[..., Any]) -> Any:
    """The function that follows the equilibrium whose Newton steps are given.

    Args:
        newton: `newton(p, q, t, out)` writes the Newton step at configuration q and path parameter t to out[:n], then
            the smallest pivot of the Hessian (positive exactly where it is positive definite) and its determinant.
        compiled: decorator.
    """

    @compiled
    def solve(p: Any, q: Any, t: float, first: float, iterations: int, out: Any) -> bool:
        """Newton's method inside a region where the energy is convex; q is changed in place.

        It fails at the first indefinite Hessian, the first long step, the first step that does not contract, or where
        the determinant has changed much since `first`, its value at the known equilibrium: by then it may be heading
        for an equilibrium that is not the continuation of that one [Deuflhard, Newton Methods for Nonlinear Problems].
        With fewer iterations than `ITERATIONS` it need not converge, only contract.
        """
        n = q.shape[0]
        longest = FIRST_STEP
        size = 0.0
        for _ in range(iterations):
            newton(p, q, t, out)
            volume = out[n + 1]
            size = 0.0
            for i in range(n):
                size = max(size, abs(out[i]))
            fine = out[n] > 0.0 and volume * CHANGE >= first and volume <= CHANGE * first and size <= longest
            if not fine:  # NaN is not fine either
                return False
            for i in range(n):
                q[i] -= out[i]
            if size <= CONVERGED:
                return True
            longest = max(CONTRACTION * size, CONVERGED)
        return iterations < ITERATIONS

    @compiled
    def follow(p: Any, q: Any, work: Any, resolution: float) -> float:
        """Follow the stable equilibrium q from path parameter 0 to 1; q is changed in place.

        One Newton solve where its steps contract from the start; elsewhere sub-steps, shortened until they contract.

        Args:
            p: the numbers that the path was captured with.
            q: the equilibrium at parameter 0, shape (n,).
            work: shape (2, n + 2), overwritten.
            resolution: length of the shortest sub-step, as a fraction of the path.

        Returns:
            The fraction of the path that was covered: 1, or less where stability ended (or all but ended: where a
            sub-step of the given resolution is still too long); q is then the last stable point.
        """
        n = q.shape[0]
        trial, out = work[0, :n], work[1]
        newton(p, q, 0.0, out)
        if not out[n] > 0.0:
            return 0.0
        volume = out[n + 1]
        for i in range(n):
            trial[i] = q[i]
        if solve(p, trial, 1.0, volume, ITERATIONS, out):
            for i in range(n):
                q[i] = trial[i]
            return 1.0
        t, length = 0.0, 0.5
        while t < 1.0 and length > resolution:
            ahead = min(t + length, 1.0)
            for i in range(n):
                trial[i] = q[i]
            if solve(p, trial, ahead, volume, ITERATIONS_OF_SUBSTEP, out):
                t, volume = ahead, out[n + 1]
                for i in range(n):
                    q[i] = trial[i]
                length *= 2.0
            else:
                length *= 0.5
        for i in range(n):
            trial[i] = q[i]
        if solve(p, trial, t, volume, ITERATIONS, out):
            for i in range(n):
                q[i] = trial[i]
        return t

    return follow
