"""Statistics against independent routes: SciPy, brute force, and simulated coverage."""

import numpy as np
import pytest
from scipy import stats

from tensegrity_agents.evaluation.statistics import (
    Estimate,
    normalized_score,
    overall_mean,
    performance_profile,
    probability_of_improvement,
    stratified_bootstrap,
    success_rate,
    wilson_interval,
)


@pytest.mark.parametrize("n", [1, 2, 7, 100, 1000])
@pytest.mark.parametrize("confidence", [0.5, 0.9, 0.95, 0.999])
def test_wilson_equals_scipy(n, confidence):
    for successes in {0, 1, n // 3, n // 2, n - 1, n}:
        expected = stats.binomtest(successes, n).proportion_ci(confidence, method="wilson")
        assert wilson_interval(successes, n, confidence) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_wilson_solves_its_defining_equation():
    low, high = wilson_interval(37, 50)
    for rate in (low, high):
        assert abs(0.74 - rate) == pytest.approx(stats.norm.ppf(0.975) * np.sqrt(rate * (1 - rate) / 50))


def test_wilson_has_a_width_where_a_bootstrap_has_none():
    low, high = wilson_interval(1000, 1000)
    assert 0.995 < low < 0.998 and high == 1.0
    assert stratified_bootstrap(np.ones((1, 1000)), resamples=50)[1:] == (1.0, 1.0)
    assert wilson_interval(0, 1000) == pytest.approx((0.0, 1 - low))


@pytest.mark.parametrize("arguments", [(1, 0), (-1, 5), (6, 5), (1, 5, 0.0), (1, 5, 1.0), (1, 5, float("nan"))])
def test_wilson_rejects(arguments):
    with pytest.raises(ValueError, match="must be"):
        wilson_interval(*arguments)


def test_a_run_that_failed_counts():
    flags = np.ones((5, 100))
    flags[2] = 0
    assert success_rate(flags)[0].point == overall_mean(flags) == pytest.approx(0.8)


def test_performance_profile_equals_its_definition():
    rng = np.random.default_rng(2)
    scores = np.round(rng.normal(size=(5, 40)), 1)
    thresholds = np.round(np.linspace(-3, 3, 61), 1)  # ties with scores: strictly greater counts
    expected = [np.mean([[value > tau for value in run] for run in scores]) for tau in thresholds]
    np.testing.assert_allclose(performance_profile(scores, thresholds), expected)
    np.testing.assert_allclose(performance_profile([np.nan, 1.0], [0.0, 2.0]), [0.5, 0.0])
    with pytest.raises(ValueError, match="no scores"):
        performance_profile([], [0.0])


def test_probability_of_improvement_equals_brute_force():
    rng = np.random.default_rng(3)
    x, y = rng.integers(0, 4, (4, 25)).astype(float), rng.integers(0, 3, (6, 25)).astype(float)
    total = 0.0
    for j in range(25):
        for i in range(4):
            for k in range(6):
                total += 1.0 if x[i, j] > y[k, j] else 0.5 if x[i, j] == y[k, j] else 0.0
    ours = probability_of_improvement(x, y, resamples=100)
    assert ours.point == pytest.approx(total / (25 * 4 * 6))
    # The paper's route: Mann-Whitney's U of every task.
    u = [stats.mannwhitneyu(x[:, j], y[:, j]).statistic for j in range(25)]
    assert ours.point == pytest.approx(np.mean(u) / (4 * 6))
    assert ours.low <= ours.point <= ours.high
    assert probability_of_improvement(y, x, resamples=100).point == pytest.approx(1 - ours.point)


def test_probability_of_improvement_at_its_ends():
    assert probability_of_improvement(np.ones((3, 9)), np.zeros((2, 9)), resamples=20) == (1, 1, 1)
    assert probability_of_improvement(np.ones((3, 9)), np.ones((2, 9)), resamples=20) == (0.5, 0.5, 0.5)
    with pytest.raises(ValueError, match="same ones"):
        probability_of_improvement(np.ones((3, 9)), np.ones((3, 8)))


def test_probability_of_improvement_covers_the_truth():
    """Normal scores with a common difficulty of each episode, which pairing removes: the truth is Phi(d / sqrt 2)."""
    rng = np.random.default_rng(4)
    truth = stats.norm.cdf(0.5 / np.sqrt(2))
    inside = 0
    for trial in range(150):
        difficulty = rng.normal(scale=3, size=60)
        x = difficulty + 0.5 + rng.normal(size=(1, 60))
        y = difficulty + rng.normal(size=(1, 60))
        _, low, high = probability_of_improvement(x, y, resamples=300, seed=trial)
        inside += low <= truth <= high
    assert 0.89 <= inside / 150 <= 0.99


def coverage(run_spread, episode_spread, noise, runs, episodes, trials=150):
    """How often the interval holds the expectation over both runs and episodes (0), and its mean width."""
    rng = np.random.default_rng(5)
    inside, width = 0, 0.0
    for trial in range(trials):
        scores = run_spread * rng.normal(size=(runs, 1)) + episode_spread * rng.normal(size=(1, episodes))
        scores = scores + noise * rng.normal(size=(runs, episodes))
        _, low, high = stratified_bootstrap(scores, resamples=300, seed=trial)
        inside += low <= 0 <= high
        width += (high - low) / trials
    return inside / trials, width


@pytest.mark.parametrize(
    "spreads",
    [(1.0, 0.0, 0.5), (0.0, 1.0, 0.5), (0.5, 2.0, 0.5)],
    ids=["runs differ", "episodes differ", "both differ"],
)
def test_bootstrap_covers_the_truth(spreads):
    share, _ = coverage(*spreads, runs=12, episodes=40)
    assert 0.88 <= share <= 0.995


def test_bootstrap_sees_both_kinds_of_spread():
    """The interval is about 2 x 1.96 standard errors of a mean over 12 runs or 40 episodes."""
    for spreads, error in (((1.0, 0.0, 0.0), 1 / 12**0.5), ((0.0, 1.0, 0.0), 1 / 40**0.5)):
        _, width = coverage(*spreads, runs=12, episodes=40, trials=40)
        assert 0.85 <= width / (3.92 * error) <= 1.25


def test_bootstrap_of_the_mean_equals_the_normal_interval():
    scores = np.random.default_rng(6).normal(2.0, 1.5, (1, 4000))
    point, low, high = stratified_bootstrap(scores, lambda s: float(s.mean()))
    half = 1.96 * scores.std() / 4000**0.5
    assert point == scores.mean()
    assert (low, high) == pytest.approx((point - half, point + half), abs=0.1 * half)


def test_bootstrap_is_a_function_of_its_seed_alone():
    scores = np.random.default_rng(7).random((5, 20))
    assert stratified_bootstrap(scores, resamples=100, seed=3) == stratified_bootstrap(scores, resamples=100, seed=3)
    assert stratified_bootstrap(scores, resamples=100, seed=3) != stratified_bootstrap(scores, resamples=100, seed=4)


@pytest.mark.parametrize("scores", [[1.0, 2.0], np.empty((0, 5)), np.empty((5, 0)), [[1.0, np.nan]]])
def test_bootstrap_rejects(scores):
    with pytest.raises(ValueError, match="must be"):
        stratified_bootstrap(scores)


def test_normalized_score():
    assert normalized_score(0.2, 0.2, 0.9) == 0 and normalized_score(0.9, 0.2, 0.9) == pytest.approx(1)
    assert normalized_score(0.55, 0.2, 0.9) == pytest.approx(0.5)
    assert np.isnan(normalized_score(0.5, 0.9, 0.9)) and np.isnan(normalized_score(0.0, 0.0, 0.0))
    np.testing.assert_array_equal(normalized_score([1.0, 2.0], [0.0, 1.0], [2.0, 1.0]), [0.5, np.nan])


def test_runs_that_all_succeed_have_an_interval():
    """Five runs of 100 episodes are no 500 independent ones, and a bootstrap would say [1, 1]."""
    for value in (0.0, 1.0):
        several, one = (success_rate(np.full((runs, 100), value)) for runs in (5, 1))
        assert several == one == (Estimate(value, *wilson_interval(int(100 * value), 100)), "Wilson")
    flags = np.random.default_rng(0).random((3, 50)) < 0.8
    assert success_rate(flags) == (stratified_bootstrap(flags), "bootstrap")
