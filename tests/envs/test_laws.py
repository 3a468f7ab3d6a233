"""Laws that hold for every registered environment; a new id is covered by being registered, your own by `--ids`."""

import dataclasses
import warnings
from collections import defaultdict
from functools import lru_cache

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st

import law_rows
import tensegrity_envs
from tensegrity_envs import termination_reason
from tensegrity_envs.simulation import FAILURES
from tensegrity_envs.simulation.mujoco.displays import has_display, require_gl
from tensegrity_envs.vector_env import step_info

IDS = law_rows.ids(tensegrity_envs.ENV_IDS)
COUNT = 4
every_id = pytest.mark.parametrize("env_id", IDS)
# The dense form of every id; the sparse one of one id for each mechanism, of all others in the full tier.
SPARSE = [
    f"tensegrity/{name}-v0"
    for name in ("TwoXPayloadReach", "DualTrianglePush", "PlanarFourBarReach", "SpatialPrismTrack")
]
FORMS = [(env_id, "dense") for env_id in IDS] + [
    pytest.param(env_id, "sparse", marks=[] if env_id in SPARSE or law_rows.IDS else pytest.mark.full) for env_id in IDS
]
every_form = pytest.mark.parametrize(("env_id", "reward_type"), FORMS)


def many(env_id):
    """How many environments a law of random actions looks at: fewer where a step takes long."""
    return 20 if is_dynamic(env_id) else 64


def is_dynamic(env_id):
    return gym.spec(env_id).kwargs.get("backend") == "mujoco"


def make(env_id, **options):
    if is_dynamic(env_id):
        pytest.importorskip("mujoco")
    return gym.make(env_id, **options)


@lru_cache(maxsize=4)
def kept(env_id, k=0):
    """An environment for all examples of a law: the k-th of its id."""
    return make(env_id)


def make_vec(env_id, count, **options):
    return gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **options)


def random_actions(envs, steps, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, (steps, *envs.action_space.shape)).astype(np.float32)


@every_form
def test_gymnasium_checker_has_nothing_to_say(env_id, reward_type):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # MuJoCo's viewer needs a display; its pictures are tested in test_mujoco_environments.py.
        blind = is_dynamic(env_id) and not has_display()
        env = make(env_id, reward_type=reward_type, render_mode=None if blind else "rgb_array")
        check_env(env.unwrapped, skip_render_check=blind)


@every_id
def test_stable_baselines_checker_has_nothing_to_say(env_id):
    sb3 = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sb3.check_env(make(env_id).unwrapped)


@every_id
def test_after_what_was_refused_an_episode_begins_and_goes_on(env_id):
    """Gymnasium 1.4's own checker would let no step pass (findings/gymnasium_checker_after_failed_reset.sh)."""
    env, twin = make(env_id), kept(env_id)
    if not gym.spec(env_id).disable_env_checker:  # an arm of somebody's own, who has left that checker on
        env = env.unwrapped
    action = np.full(env.action_space.shape, 0.25, np.float32)
    for refused in ({"seed": -1}, {"seed": 0, "options": {"no such option": 1}}):
        with pytest.raises(ValueError, match=r"must be|there are"):
            env.reset(**refused)
    with pytest.raises(ValueError, match="must be finite"):
        env.reset(seed=3)
        env.step(np.full_like(action, np.nan))
    twin.reset(seed=3)
    for _ in range(2):
        np.testing.assert_array_equal(env.step(action)[0]["observation"], twin.step(action)[0]["observation"])


@every_id
def test_making_by_module_prefix_needs_no_import(env_id):
    assert gym.make(f"tensegrity_envs:{env_id}").spec.max_episode_steps == make(env_id).spec.max_episode_steps


@every_id
def test_single_and_vector_environments_run_identically_episode_by_episode(env_id):
    """250 steps or more: several episodes each, failures and time limits included."""
    envs = make_vec(env_id, COUNT)
    steps, seed = max(250, envs.unwrapped.max_episode_steps + 50), 1234
    actions = random_actions(envs, steps)
    observations, _ = envs.reset(seed=seed)
    singles = [make(env_id) for _ in range(COUNT)]
    ended, seen = 0, defaultdict(list)  # what both told, by its name: (vector, single) of all steps

    def note(tolerance, batch, single, i):
        for key, value in single.items():
            seen[key, tolerance].append((batch[key][i], value))

    for i, env in enumerate(singles):
        note(1e-7, observations, env.reset(seed=seed + i)[0], i)
    for t in range(steps):
        observations, rewards, terminated, truncated, info = envs.step(actions[t])
        for i, env in enumerate(singles):
            single, reward, term, trunc, single_info = env.step(actions[t, i])
            assert (bool(terminated[i]), bool(truncated[i])) == (term, trunc)
            note(1e-9, {"reward": rewards}, {"reward": reward}, i)
            note(1e-9, info["final_info"] if term or trunc else info, single_info, i)
            if term or trunc:
                ended += 1
                for key, value in single.items():  # the last observation of the episode that ended
                    np.testing.assert_allclose(info["final_obs"][i][key], value, rtol=0, atol=1e-7)
                single, _ = env.reset()
            note(1e-7, observations, single, i)
        assert ("final_obs" in info) == bool((terminated | truncated).any())
    assert ended >= COUNT
    for (key, tolerance), pairs in seen.items():
        np.testing.assert_allclose(*map(np.stack, zip(*pairs, strict=True)), rtol=0, atol=tolerance, err_msg=key)


@every_id
def test_same_seed_same_trajectory_whatever_ran_before(env_id):
    env, other = make(env_id), make(env_id)
    other.reset(seed=99)
    for _ in range(37):
        if other.step(other.action_space.sample())[2]:
            other.reset()
    actions = random_actions(make_vec(env_id, 1), 60)[:, 0]
    for seed in (5, 5):
        first, _ = env.reset(seed=seed)
        second, _ = other.reset(seed=seed)
        for action in actions:
            for key in first:
                np.testing.assert_array_equal(first[key], second[key])
            one, two = env.step(action), other.step(action)
            assert one[1:4] == two[1:4]
            first, second = one[0], two[0]
            if one[2]:
                first, _ = env.reset()
                second, _ = other.reset()


@every_id
def test_an_episode_can_be_begun_by_its_number(env_id):
    env = make(env_id)
    env.reset(seed=3)
    wanted = [env.reset()[0]["desired_goal"] for _ in range(4)][2]  # episode 3 of the seed
    env.reset(seed=3)
    np.testing.assert_array_equal(env.reset(options={"episode": 3})[0]["desired_goal"], wanted)
    with pytest.raises(ValueError, match="episode"):
        env.reset(options={"episodes": 3})


@every_id
def test_vector_of_other_size_and_masked_reset_give_the_same_episodes(env_id):
    small, large = make_vec(env_id, 2), make_vec(env_id, 5)
    a, _ = small.reset(seed=11)
    b, _ = large.reset(seed=10)
    np.testing.assert_array_equal(a["desired_goal"], b["desired_goal"][1:3])
    c, _ = small.reset(options={"reset_mask": np.array([False, True])})
    d, _ = large.reset()
    np.testing.assert_array_equal(c["desired_goal"][0], a["desired_goal"][0])
    np.testing.assert_array_equal(c["desired_goal"][1], d["desired_goal"][2])


@every_form
def test_compute_functions_agree_with_step_on_batches(env_id, reward_type):
    env = make(env_id, reward_type=reward_type).unwrapped
    achieved, desired, infos, rewards, ends = [], [], [], [], []
    env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(10_000):
        if len(ends) >= 400 and (any(ends) or not env.core.can_fail):
            break
        observation, reward, terminated, truncated, info = env.step(np.sign(env.action_space.sample()))
        achieved.append(observation["achieved_goal"])
        desired.append(observation["desired_goal"])
        infos.append(info)
        rewards.append(reward)
        ends.append(terminated)
        one = env.unwrapped.compute_reward(observation["achieved_goal"], observation["desired_goal"], info)
        assert one == pytest.approx(reward, abs=1e-9)
        assert (
            env.unwrapped.compute_terminated(observation["achieved_goal"], observation["desired_goal"], info)
            is terminated
        )
        assert (
            env.unwrapped.compute_truncated(observation["achieved_goal"], observation["desired_goal"], info)
            is truncated
        )
        if terminated:
            env.reset()
    batch = np.array(achieved), np.array(desired), np.array(infos)
    np.testing.assert_allclose(env.unwrapped.compute_reward(*batch), rewards, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(env.unwrapped.compute_terminated(*batch), ends)
    assert not env.unwrapped.compute_truncated(*batch).any()


@every_id
def test_compute_functions_of_the_vector_environment_agree_with_its_step(env_id):
    envs = make_vec(env_id, 32)
    envs.reset(seed=0)
    for action in random_actions(envs, 130):
        observation, reward, terminated, truncated, info = envs.step(action)
        ended = terminated | truncated
        goals = [observation[key].copy() for key in ("achieved_goal", "desired_goal")]
        last = dict(info)
        for i in np.flatnonzero(ended):
            for goal, key in zip(goals, ("achieved_goal", "desired_goal")):
                goal[i] = info["final_obs"][i][key]
        if ended.any():
            for key, value in info["final_info"].items():
                if not key.startswith("_"):
                    last[key] = np.where(ended.reshape(-1, *[1] * (value.ndim - 1)), value, info[key])
        np.testing.assert_allclose(envs.unwrapped.compute_reward(*goals, last), reward, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(envs.unwrapped.compute_terminated(*goals, last), terminated)
        np.testing.assert_array_equal(envs.unwrapped.compute_truncated(*goals, last), truncated)


@every_id
def test_relabelled_goals_are_rewarded_and_missing_info_is_explained(env_id):
    env = make(env_id)
    observation, info = env.reset(seed=0)
    here = observation["achieved_goal"]
    true = np.asarray(info.get("true_goal", here), np.float32)  # the sensors may be noisy
    reward = env.unwrapped.compute_reward(here, true, info)
    assert reward > env.unwrapped.compute_reward(here, true + np.float32(0.004), info)
    with pytest.raises(ValueError, match="copy_info_dict=True"):
        env.unwrapped.compute_reward(here[None], here[None], np.array([{}]))
    with pytest.raises(ValueError, match="shape"):
        env.unwrapped.compute_reward(np.zeros(4), np.zeros(4), info)


@every_form
def test_failing_early_never_pays(env_id, reward_type):
    """No step is worth less than nothing, and the failing one is worth nothing: what is given up was never negative."""
    envs = make_vec(env_id, many(env_id), reward_type=reward_type)
    envs.reset(seed=1)
    failed = 0
    for action in random_actions(envs, 120):
        _, reward, terminated, _, info = envs.step(np.sign(action))
        assert (reward >= 0).all()
        assert (reward[terminated] == 0).all()
        last = step_info(info)
        terms = sum(last[key] for key in last if key.startswith("reward_"))
        np.testing.assert_allclose(np.where(terminated, terms, reward), reward, atol=1e-6)
        failed += terminated.sum()
    assert (failed > 0) == envs.unwrapped.core.can_fail


@every_id
def test_observations_stay_in_their_space_and_info_says_what_is_so(env_id):
    envs = make_vec(env_id, many(env_id))
    observation, info = envs.reset(seed=2)
    space, core = envs.observation_space, envs.unwrapped.core
    for t in range(150):
        assert space.contains(observation)
        actions = np.sign(random_actions(envs, 1, t)[0])
        observation, _, terminated, _, info = envs.step(actions)
        for obs in info.get("final_obs", [])[terminated] if "final_obs" in info else []:
            assert envs.single_observation_space.contains(obs)
        last = step_info(info)
        assert all(np.isfinite(v).all() for v in last.values() if isinstance(v, np.ndarray) and v.dtype == float)
        for i in np.flatnonzero(terminated):
            assert termination_reason(last["failure"])[i] in FAILURES[1:]
            assert not last["is_success"][i] or core.task.has_score  # a held push counts after it has grown too large
        if hasattr(core.simulation, "bounds"):
            low, high = core.simulation.bounds(core.nominal)
            assert (info[core.input_name] >= low - 1e-9).all()
            assert (info[core.input_name] <= high + 1e-9).all()
        assert (np.abs(info["configuration"]) <= getattr(core.design, "joint_limit", np.inf)).all()


@every_id
@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_bad_actions_are_refused_and_change_nothing(env_id, data):
    env = kept(env_id)
    if not hasattr(env, "was_reset"):
        env.reset(seed=0)
        env.was_reset = True
    size = env.action_space.shape[0]
    bad = data.draw(
        st.one_of(
            st.lists(st.floats(-1, 1), max_size=8).filter(lambda v: len(v) != size),
            st.lists(st.floats(-1, 1), min_size=size, max_size=size).flatmap(
                lambda v: st.sampled_from([np.nan, np.inf, -np.inf]).map(lambda x: [x, *v[1:]])
            ),
        )
    )
    before = env.unwrapped.scene()
    with pytest.raises(ValueError, match=r"shape|finite"):
        env.unwrapped.step(np.array(bad))
    assert env.unwrapped.scene().tip == before.tip


@every_id
@settings(max_examples=25, deadline=None)
@given(scale=st.floats(1, 1e300), seed=st.integers(0, 1000))
def test_actions_out_of_range_are_clipped(env_id, scale, seed):
    first, second = (kept(env_id, k).unwrapped for k in (1, 2))
    direction = np.random.default_rng(seed).choice([-1.0, 1.0], first.action_space.shape)
    first.reset(seed=seed)
    second.reset(seed=seed)
    a, b = first.step(scale * direction), second.step(direction)
    np.testing.assert_array_equal(a[0]["achieved_goal"], b[0]["achieved_goal"])
    assert a[1] == b[1]


@every_id
def test_vector_refuses_bad_input_with_clear_errors(env_id):
    envs = make_vec(env_id, 3)
    with pytest.raises(RuntimeError, match="reset"):
        envs.step(envs.action_space.sample())
    envs.reset(seed=0)
    bad = envs.action_space.sample()
    bad[1, 0] = np.nan
    with pytest.raises(ValueError, match="environment 1"):
        envs.step(bad)
    with pytest.raises(ValueError, match="shape"):
        envs.step(bad[:2])
    with pytest.raises(ValueError, match="3 environments"):
        envs.reset(seed=[1, 2])
    with pytest.raises(ValueError, match="reset_mask"):
        envs.reset(options={"mask": np.ones(3, bool)})
    with pytest.raises(ValueError, match="render"):
        make_vec(env_id, 2, render_mode="human")


@every_id
@pytest.mark.filterwarnings("ignore:.*render_mode='ansi'")
def test_bad_options_are_named(env_id):
    weight = dataclasses.fields(make(env_id).unwrapped.core.task.weights)[0].name
    for options, message in (
        ({"reward_type": "dence"}, "dence"),
        ({"tolerance": -1.0}, "tolerance"),
        ({"reward_weights": {"distanse": 1.0}}, "distanse"),
        ({"reward_weights": {weight: float("nan")}}, weight),
        ({"observe": "all"}, "observe"),
        ({"render_mode": "ansi"}, "render_mode"),
    ):
        with pytest.raises(ValueError, match=message):
            _ = make(env_id, **options).unwrapped.core
    with pytest.raises(TypeError, match="design"):
        make(env_id, design=3)
    with pytest.raises(TypeError, match="did you mean 'tolerance'"):
        make(env_id, tolerence=0.01)


@every_id
def test_stepping_after_the_end_or_before_the_beginning_is_an_error(env_id):
    env = make(env_id).unwrapped
    with pytest.raises(RuntimeError, match="reset"):
        env.step(env.action_space.sample())
    env.reset(seed=0)
    action = np.ones(env.action_space.shape)
    action[1::2] = -1
    for _ in range(300):
        if env.step(action)[2]:
            break
    else:
        pytest.skip("this action does not lead to failure")
    with pytest.raises(RuntimeError, match="terminated"):
        env.step(action)


@every_id
def test_rendering(env_id):
    if is_dynamic(env_id):
        try:
            require_gl()
        except RuntimeError as error:
            pytest.skip(str(error))
    env = make(env_id, render_mode="rgb_array", render_size=200)
    env.reset(seed=0)
    before = env.render()
    env.step(env.action_space.sample())
    after = env.render()
    assert before.shape == after.shape == (200, 200, 3)
    assert before.dtype == np.uint8
    assert (before != after).any()
    env.close()


@every_id
def test_staggered_episodes_reach_their_time_limit_one_after_another(env_id):
    envs = make_vec(env_id, 10)
    plain, _ = envs.reset(seed=0)
    staggered, _ = envs.reset(seed=0, options={"stagger": True})
    np.testing.assert_array_equal(plain["desired_goal"], staggered["desired_goal"])
    still = np.zeros(envs.action_space.shape)
    longest = envs.unwrapped.max_episode_steps
    ends = np.array([np.stack(envs.step(still)[2:4]) for _ in range(longest)])
    for i in range(10):
        first = ends[:, :, i].any(axis=1).argmax()  # an arm may fail before
        assert first == longest - 1 - longest * i // 10 or ends[first, 0, i]
