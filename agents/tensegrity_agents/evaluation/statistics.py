"""Statistics of scores that come as (training runs, episodes), after [Agarwal2021].

[Agarwal2021] Agarwal, Schwarzer, Castro, Courville, Bellemare, "Deep Reinforcement Learning at the Edge of the
Statistical Precipice", NeurIPS 2021. Its package `rliable` is archived; the few definitions that are needed are here,
as pure functions.
[Wilson1927] Wilson, "Probable inference, the law of succession, and statistical inference", J. Am. Stat. Assoc. 22.

`scores` has shape (runs, episodes): row i is one trained policy, column j one episode, the same for every row. What
is a "task" in the paper is an episode here.
"""

from collections.abc import Callable
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

_BLOCK = 64  # resamples whose weights are in memory at once


class Estimate(NamedTuple):
    """A number with its confidence interval."""

    point: float
    low: float
    high: float


def wilson_interval(successes: int, n: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval of a success rate from n independent episodes of one policy [Wilson1927].

    With p = successes / n and z the normal quantile of `confidence`, it holds all rates r with
    |p - r| <= z sqrt(r (1 - r) / n). Unlike a bootstrap's it has a width where all or no episodes succeed.

    Returns:
        (low, high), within [0, 1].

    Raises:
        ValueError: n < 1, successes outside 0 ... n, or confidence outside (0, 1).
    """
    if n < 1 or not 0 <= successes <= n:
        raise ValueError(f"{successes} successes in {n} episodes: must be 0 <= successes <= n and n >= 1")
    z = NormalDist().inv_cdf(0.5 + _checked(confidence) / 2)
    p = successes / n
    scale = 1 + z * z / n
    centre = (p + z * z / (2 * n)) / scale
    half = z / scale * (p * (1 - p) / n + z * z / (4 * n * n)) ** 0.5
    return (0.0 if successes == 0 else centre - half, 1.0 if successes == n else centre + half)


def overall_mean(scores: ArrayLike) -> float:
    """Mean over all runs and episodes: of five runs an interquartile mean would hide one that failed."""
    return float(np.asarray(scores, float).mean())


def success_rate(flags: np.ndarray, statistic: Callable[[np.ndarray], float] = overall_mean) -> tuple[Estimate, str]:
    """A success rate with its 95% interval, and whether that is of "Wilson" or of a "bootstrap" over runs and episodes.

    One run has Wilson's interval, and so have several whose episodes all succeeded, or all failed: a bootstrap would
    say that nothing else can happen. They are counted as one run then, for they went through the same episodes.

    Args:
        flags: of success, shape (runs, episodes).
        statistic: of the bootstrap.
    """
    flags = np.asarray(flags, float)
    if len(flags) == 1 or flags.min() == flags.max():
        interval = wilson_interval(int(flags[0].sum()), flags.shape[1])
        return Estimate(float(flags[0].mean()), *interval), "Wilson"
    return stratified_bootstrap(flags, statistic), "bootstrap"


def stratified_bootstrap(
    scores: ArrayLike,
    statistic: Callable[[np.ndarray], float] = overall_mean,
    *,
    confidence: float = 0.95,
    resamples: int = 2000,
    seed: int = 0,
) -> Estimate:
    """Percentile bootstrap of a statistic over training runs and episodes [Agarwal2021, section 4.1].

    Every resample takes as many runs, and as many episodes, as there are, with replacement: whole rows and whole
    columns of `scores`. All runs did share the episodes, and an episode that is hard for all of them is luck that all
    of them shared. (In the paper the tasks are fixed strata with runs of their own: only runs are drawn, for each task
    anew.) With few runs the interval is too narrow, as that of every bootstrap; one run says nothing of the spread
    over runs.

    Args:
        scores: shape (runs, episodes).
        statistic: from an array of that shape to a number.
        confidence: probability that the interval is meant to have.
        resamples: how many.
        seed: of the resampling; equal seeds, equal intervals.

    Returns:
        The statistic of `scores`, and its interval.

    Raises:
        ValueError: `scores` is not a finite, non-empty (runs, episodes) array, or confidence is outside (0, 1).
    """
    table = _runs_by_episodes("scores", scores)
    rng = np.random.default_rng(seed)
    values = np.empty(resamples)
    for k in range(resamples):
        rows, columns = (rng.integers(n, size=(n,)) for n in table.shape)
        values[k] = statistic(table[rows[:, None], columns])
    return _percentiles(float(statistic(table)), values, confidence)


def resampled_means(scores: ArrayLike, resamples: int = 5000, seed: int = 0) -> np.ndarray:
    """Means of the resamples that `stratified_bootstrap` takes: of whole runs and whole episodes, shape (resamples,).

    Args:
        scores: shape (runs, episodes).
        resamples: how many.
        seed: of the resampling.

    Raises:
        ValueError: `scores` is not a finite, non-empty (runs, episodes) array.
    """
    table = _runs_by_episodes("scores", scores)
    rng = np.random.default_rng(seed)
    rows, columns = (rng.multinomial(n, np.full(n, 1 / n), size=resamples) for n in table.shape)
    return np.asarray(((rows @ table) * columns).sum(axis=1) / table.size)


def performance_profile(scores: ArrayLike, thresholds: ArrayLike) -> np.ndarray:
    """Share of all runs and episodes with a score above each threshold: mean of 1[score > threshold].

    The run-score distribution of [Agarwal2021, section 4.2].

    Args:
        scores: any shape; a NaN is above no threshold.
        thresholds: shape (k,).

    Returns:
        Shape (k,), within [0, 1].

    Raises:
        ValueError: there are no scores.
    """
    ordered = np.sort(np.asarray(scores, float), axis=None)
    if not len(ordered):
        raise ValueError("performance profile of no scores")
    numbers = ordered[~np.isnan(ordered)]
    share: np.ndarray = (len(numbers) - np.searchsorted(numbers, np.asarray(thresholds, float), side="right")) / len(
        ordered
    )
    return share


def probability_of_improvement(
    x: ArrayLike, y: ArrayLike, *, confidence: float = 0.95, resamples: int = 2000, seed: int = 0
) -> Estimate:
    """Probability that a run of X scores higher than a run of Y on an episode, ties counting half.

    As in [Agarwal2021, section 4.3]: the mean, over episodes j and all pairs of runs (i, k), of 1 where
    x[i, j] > y[k, j], 1/2 where they are equal, else 0: the Mann-Whitney statistic of every episode, averaged. Both
    were given the same episodes, so a resample takes runs of X, runs of Y, and episodes common to both.

    Args:
        x: shape (runs of X, episodes).
        y: shape (runs of Y, episodes).
        confidence: probability that the interval is meant to have.
        resamples: how many.
        seed: of the resampling.

    Raises:
        ValueError: an array is not finite or empty, or they differ in the number of episodes.
    """
    x, y = _runs_by_episodes("x", x), _runs_by_episodes("y", y)
    if x.shape[1] != y.shape[1]:
        raise ValueError(f"{x.shape[1]} and {y.shape[1]} episodes: both must have run on the same ones")
    # Twice what each comparison gives: 0, 1 or 2, shape (runs of X, runs of Y, episodes).
    doubled = (np.sign(x[:, None, :] - y[None, :, :]) + 1).astype(np.float32)
    rng = np.random.default_rng(seed)
    values = []
    for first in range(0, resamples, _BLOCK):
        count = min(_BLOCK, resamples - first)
        # How often each run and episode is drawn. Sums of whole numbers are exact, and so are 0, 1/2 and 1.
        wx, wy, we = (rng.multinomial(n, np.full(n, 1 / n), size=count) for n in doubled.shape)
        sums = doubled @ we.T.astype(np.float32)
        values.append(np.einsum("ri,rk,ikr->r", wx, wy, sums.astype(float)) / (2 * doubled.size))
    return _percentiles(float(doubled.mean(dtype=float)) / 2, np.concatenate(values), confidence)


def normalized_score(score: ArrayLike, random: ArrayLike, oracle: ArrayLike) -> Any:
    """(score - random) / (oracle - random): 0 for the random policy, 1 for the oracle; NaN where those two are equal.

    Arguments are floats or arrays that broadcast; floats give a float.
    """
    score, random, oracle = (np.asarray(value, float) for value in (score, random, oracle))
    span = oracle - random
    differ = np.abs(span) > 1e-12 * np.maximum(np.abs(oracle), np.abs(random))
    value = np.where(differ, (score - random) / np.where(differ, span, 1.0), np.nan)
    return value if value.ndim else float(value)


def _checked(confidence: float) -> float:
    if not 0 < confidence < 1:
        raise ValueError(f"confidence = {confidence!r}: must be between 0 and 1, such as 0.95")
    return confidence


def _runs_by_episodes(name: str, scores: ArrayLike) -> np.ndarray:
    array = np.asarray(scores, float)
    if array.ndim != 2 or not array.size:
        raise ValueError(f"{name} of shape {array.shape}: must be (runs, episodes), at least one of each")
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: must be finite numbers")
    return array


def _percentiles(point: float, values: np.ndarray, confidence: float) -> Estimate:
    tail = (1 - _checked(confidence)) / 2
    low, high = np.quantile(values, [tail, 1 - tail])
    return Estimate(point, float(low), float(high))
