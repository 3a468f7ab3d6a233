"""Claims of wins: paired differences, Holm's correction, and what keeps a claim from holding."""

from dataclasses import replace

import numpy as np
import pytest

from tensegrity_agents.config import ConfigError
from tensegrity_agents.evaluation.records import Record, packed, packed_times, unpacked_times
from tensegrity_agents.evaluation.statistics import resampled_means, stratified_bootstrap
from tensegrity_agents.reporting.claims import Candidate, claims_to_markdown, holm, judged, read_candidates, scores_of

ENV = "tensegrity/DualTriangleFastReachMuJoCo-v0"
EPISODES = 300
SUCCESS, TIME = Candidate(ENV, "2", "success"), Candidate(ENV, "2", "settling_time")


def row(controller, share, time=1.0, kind="baseline", seed=None):
    rng = np.random.default_rng(5 if seed is None else seed)
    flags = rng.random(EPISODES) < share
    times = np.where(flags, time + 0.1 * rng.random(EPISODES), np.inf)
    return Record(
        ENV, controller, kind, EPISODES, {"2": packed(flags)}, "", seed=seed, settling={"2": packed_times(times)}
    )


def agents(*shares, time=1.0):
    return [row("PPO agent", share, time, "agent", seed) for seed, share in enumerate(shares)]


def wins(candidate, group):
    return claims_to_markdown([candidate], {ENV: group}).splitlines()[-1].split("|")[-2].strip()


def test_times_are_kept_to_the_millisecond():
    times = np.array([0.0, 0.02, 1.234, np.inf, 2.98])
    np.testing.assert_array_equal(unpacked_times(packed_times(times), 5), times)
    with pytest.raises(ValueError, match="5 settling times for 4 episodes"):
        unpacked_times(packed_times(times), 4)


def test_the_resampled_means_are_those_of_the_bootstrap():
    scores = np.random.default_rng(0).random((5, 80)) < 0.4
    means = resampled_means(scores)
    other = stratified_bootstrap(scores, lambda values: float(np.mean(values)), seed=3)
    np.testing.assert_allclose(np.quantile(means, [0.025, 0.975]), other[1:], atol=0.01)
    assert means.mean() == pytest.approx(scores.mean(), abs=0.005)


def test_holm_by_hand():
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.5, 0.9]) == [1.0, 1.0]
    assert holm([]) == []


@pytest.mark.parametrize(
    ("shares", "controller", "verdict"),
    [((0.95, 0.93), 0.8, "agent"), ((0.99, 0.99, 0.99, 0.7), 0.8, "no"), ((0.8, 0.8), 0.8, "no")],
)
def test_success_is_to_be_better_with_every_seed(shares, controller, verdict):
    group = [*agents(*shares), row("lqg", controller), row("ramp", 0.2), row("informed", 1.0, kind="oracle")]
    assert judged(SUCCESS, group).controller == "lqg"
    assert wins(SUCCESS, group) == verdict


@pytest.mark.parametrize(
    ("share", "time", "verdict"), [(0.95, 0.7, "agent"), (0.95, 1.0, "no"), (0.9, 0.1, "no"), (0.95, 1.3, "no")]
)
def test_time_is_no_win_at_the_cost_of_success(share, time, verdict):
    controller = row("lqg", 0.95, seed=0)  # succeeds where the first agent of as much success does
    assert wins(TIME, [row("PPO agent", share, time, "agent", 0), controller]) == verdict


def test_one_miss_of_many_does_not_decide():
    """Where the controller has all of its episodes, nobody could have more."""
    ours = [row("PPO agent", 1.0, 0.7, "agent", seed) for seed in range(4)]
    flags = np.ones(EPISODES, bool)
    flags[7] = False
    times = np.where(flags, 0.7, np.inf)
    ours[0] = replace(ours[0], successes={"2": packed(flags)}, settling={"2": packed_times(times)})
    assert wins(TIME, [*ours, row("lqg", 1.0)]) == "agent"


def test_the_level_of_the_id_itself_is_the_environment_as_it_is():
    """A nominal id at level 0, an uncertain one at level 2: whether or not the record names it."""
    nominal, uncertain = ENV, "tensegrity/DualTriangleLoadedReachUncertain-v0"
    for env, level in ((nominal, "0"), (uncertain, "2")):
        one = Record(env, "lqg", "baseline", 8, {"": "f0", "3": "80"}, "")
        assert scores_of(one, Candidate(env, level, "success")).sum() == 4
        assert scores_of(one, Candidate(env, "3", "success")).sum() == 1
        assert scores_of(one, Candidate(env, "1", "success")) is None


def test_a_controller_on_the_first_episodes_is_compared_on_these():
    ours, mpc = agents(0.6, 0.7), row("mpc", 0.9)
    few = replace(mpc, episodes=80, successes={"2": packed(mpc.flags("2")[:80])})
    claim = judged(SUCCESS, [*ours, few, row("ramp", 0.1)])
    assert (claim.controller, claim.is_whole, claim.agents.shape) == ("mpc", False, (2, 80))
    expected = np.mean([one.flags("2")[:80].mean() for one in ours]) - few.flags("2").mean()
    assert claim.difference.point == pytest.approx(expected)


def test_an_episode_that_does_not_settle_counts_as_long_as_it_is():
    claim = judged(TIME, [*agents(0.0), row("lqg", 0.0)])
    assert claim.agents.min() == claim.agents.max() == -3.0
    assert claim.difference.point == 0.0


def test_candidates_without_agents_have_dashes():
    assert judged(SUCCESS, [row("lqg", 0.5)]) is None
    line = claims_to_markdown([SUCCESS], {}).splitlines()[-1]
    assert line.startswith("| `DualTriangleFastReachMuJoCo-v0` at level 2 | success | \N{EN DASH}")


def test_a_list_of_candidates_that_is_none_is_named(tmp_path):
    path = tmp_path / "candidates.yaml"
    path.write_text(f"- {{env: {ENV}, level: 2, counts: settling_time}}\n")
    assert read_candidates(path) == [TIME]
    path.write_text("- {env: DualTriangleFastReachMuJoCo-v0, level: '2', counts: success}\n")
    assert read_candidates(path) == [SUCCESS]
    for text in ("3", "{}", "", "text", "{env: a}"):
        path.write_text(text)
        with pytest.raises(ConfigError, match=r"candidates\.yaml holds .* must be a list of entries such as {env: "):
            read_candidates(path)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("{env: a}", "must have env, level and counts"),
        ("{env: a, level: 2, counts: success, more: 1}", "must have env, level and counts"),
        ("5", "must have env, level and counts"),
        ("{env: nope, level: 2, counts: success}", "no environment 'nope'"),
        ("{env: 5, level: 2, counts: success}", "no environment '5'"),
        ("{env: tensegrity/TwoXReech-v0, level: 2, counts: success}", "did you mean TwoXReach-v0"),
        ("{env: TwoXReach-v0, level: 9, counts: success}", "level: must be one of 0, 1, 2, 3"),
        ("{env: TwoXReach-v0, level: true, counts: success}", "level: must be one of"),
        ("{env: DualTrianglePush-v0, level: 2, counts: success}", "nothing is uncertain in a push"),
        ("{env: TwoXReach-v0, level: 2, counts: speed}", "counts: must be success or settling_time"),
        ("{env: TwoXReach-v0, level: 2, counts: [success]}", "counts: must be success or settling_time"),
        ("{env: TwoXReach-v0, level: 2, counts: settling_time}", "settling_time is measured where arms reach"),
        ("{env: TwoXTensionReach-v0, level: 2, counts: success}", "stands there twice"),
    ],
)
def test_a_candidate_that_is_none_is_named(tmp_path, entry, message):
    path = tmp_path / "candidates.yaml"
    path.write_text(f"- {{env: tensegrity/TwoXTensionReach-v0, level: 2, counts: success}}\n- {entry}\n")
    with pytest.raises(ConfigError, match=rf"candidates\.yaml: entry 2, .*: .*{message}"):
        read_candidates(path)
