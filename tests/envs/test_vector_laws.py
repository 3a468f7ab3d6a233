"""Laws of the native vector environments: they equal Gymnasium's own vectors of the single ones, in every mode."""

import copy
import json
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import law_rows
import tensegrity_envs
from tensegrity_envs.options import described
from tensegrity_envs.vector_env import ManipulatorVectorEnv, step_info

IDS = tensegrity_envs.ENV_IDS
COUNT = 4
# One of each kind of core; a law of the shell alone need not be run on all ids.
SHELL_IDS = [f"tensegrity/{name}-v0" for name in ("TwoXTensionReach", "DualTrianglePush", "SpatialPrismTrack")]
every_id = pytest.mark.parametrize("env_id", law_rows.ids(IDS))
some_ids = pytest.mark.parametrize("env_id", law_rows.ids(SHELL_IDS))
MODES = list(AutoresetMode)


def make_vec(env_id, count=COUNT, **options):
    if "MuJoCo" in env_id:
        pytest.importorskip("mujoco")
    return gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", **options)


def make_sync(env_id, mode, count=COUNT, **options):
    return SyncVectorEnv([lambda: gym.make(env_id, **options)] * count, autoreset_mode=mode)


def assert_same(ours, theirs, where=""):
    """Equal values, dtypes, shapes and keys, all the way down."""
    if isinstance(theirs, dict):
        assert set(ours) == set(theirs), where
        for key, value in theirs.items():
            assert_same(ours[key], value, f"{where}.{key}")
    elif isinstance(theirs, np.ndarray) and theirs.dtype == object:
        assert ours.dtype == object, where
        for mine, other in zip(ours, theirs, strict=True):
            assert_same(mine, other, where)
    elif theirs is None or isinstance(theirs, str):
        assert ours == theirs, where
    else:
        assert ours.dtype == theirs.dtype, (where, ours.dtype, theirs.dtype)
        np.testing.assert_array_equal(ours, theirs, err_msg=where)


@every_id
@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.value)
def test_each_autoreset_mode_is_that_of_gymnasiums_vector(env_id, mode):
    """Time limits of 13 steps and random actions: every way in which an episode can end."""
    ours = make_vec(env_id, autoreset_mode=mode.value, max_episode_steps=13)
    theirs = make_sync(env_id, mode, max_episode_steps=13)
    assert ours.metadata["autoreset_mode"] is mode
    for mine, other in zip(ours.reset(seed=7), theirs.reset(seed=7), strict=True):
        assert_same(mine, other)
    rng = np.random.default_rng(0)
    ended, done = 0, np.zeros(ours.num_envs, bool)
    for step in range(40):
        if mode is AutoresetMode.DISABLED and done.any():
            for mine, other in zip(*(e.reset(options={"reset_mask": done.copy()}) for e in (ours, theirs))):
                assert_same(mine, other)
        action = rng.uniform(-1, 1, ours.action_space.shape).astype(np.float32)
        mine, other = ours.step(action), theirs.step(action)
        for name, a, b in zip(("observation", "reward", "terminated", "truncated", "info"), mine, other, strict=True):
            assert_same(a, b, f"step {step}: {name}")
        done = mine[2] | mine[3]
        ended += done.sum()
    assert ended >= 2 * COUNT


@some_ids
def test_masked_resets_are_those_of_gymnasiums_vector(env_id):
    ours, theirs = make_vec(env_id), make_sync(env_id, AutoresetMode.NEXT_STEP)
    ours.reset(seed=3)
    theirs.reset(seed=3)
    rng = np.random.default_rng(0)
    for step in range(12):
        action = rng.uniform(-1, 1, ours.action_space.shape).astype(np.float32)
        for mine, other in zip(ours.step(action), theirs.step(action), strict=True):
            assert_same(mine, other)
        mask = rng.uniform(size=COUNT) < 0.4
        if mask.any():
            seed = 50 + step if step % 2 else None
            for mine, other in zip(
                ours.reset(seed=seed, options={"reset_mask": mask}),
                theirs.reset(seed=seed, options={"reset_mask": mask}),
                strict=True,
            ):
                assert_same(mine, other)


def test_next_step_is_the_default_and_each_instance_tells_its_own_mode():
    default, same = make_vec(IDS[0]), make_vec(IDS[0], autoreset_mode=AutoresetMode.SAME_STEP)
    assert default.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert same.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert ManipulatorVectorEnv.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    with pytest.raises(ValueError, match=r"'samestep'.*'NextStep', 'SameStep', 'Disabled'"):
        make_vec(IDS[0], autoreset_mode="samestep")


def test_disabled_refuses_to_step_what_has_ended():
    envs = make_vec(IDS[0], 2, autoreset_mode="Disabled", max_episode_steps=1)
    envs.reset(seed=0)
    still = np.zeros(envs.action_space.shape)
    envs.step(still)
    with pytest.raises(RuntimeError, match=r"\[0, 1\].*reset_mask"):
        envs.step(still)


def test_an_ignored_action_may_be_anything():
    envs = make_vec(IDS[0], 2, max_episode_steps=1)
    envs.reset(seed=0)
    envs.step(np.zeros((2, 2)))
    _, reward, terminated, truncated, _ = envs.step(np.full((2, 2), np.nan))
    assert not reward.any() and not terminated.any() and not truncated.any()


@some_ids
def test_nothing_handed_out_is_the_environments_own_memory(env_id):
    """What a user writes into observations and infos changes nothing that comes later; masks cannot be written to."""
    tidy, messy = make_vec(env_id, autoreset_mode="SameStep"), make_vec(env_id, autoreset_mode="SameStep")
    actions = np.random.default_rng(0).uniform(-1, 1, (30, *tidy.action_space.shape))
    results = [tidy.reset(seed=0), *(tidy.step(action) for action in actions), tidy.reset()]

    def spoil(told):
        if isinstance(told, dict):
            for value in told.values():
                spoil(value)
        elif isinstance(told, tuple):
            for value in told:
                spoil(value)
        elif isinstance(told, np.ndarray) and told.dtype != object and told.flags.writeable:
            told[...] = 0

    for step, expected in enumerate(results):
        got = messy.step(actions[step - 1].copy()) if 0 < step <= 30 else messy.reset(seed=None if step else 0)
        for mine, other in zip(got, expected, strict=True):
            assert_same(mine, other, f"step {step}")
        spoil(got)
        spoil(messy.unwrapped.episode.goal)


@pytest.mark.parametrize("copied", [lambda envs: envs, copy.deepcopy, lambda envs: pickle.loads(pickle.dumps(envs))])
def test_only_masks_cannot_be_written_to(copied):
    envs = make_vec(IDS[0], autoreset_mode="SameStep", max_episode_steps=2)
    envs.reset(seed=0, options={"stagger": True})
    envs.step(np.zeros(envs.action_space.shape))
    for _ in range(2):
        info = (envs := copied(envs)).step(np.zeros(envs.action_space.shape))[4]
        assert "_time_limit" in info["final_info"]
        for told in (info, info["final_info"]):
            for name, value in told.items():
                if isinstance(value, np.ndarray):
                    is_mask = name.startswith("_") and not name.startswith("_final")
                    assert value.flags.writeable is not is_mask, name


def test_any_number_of_threads_gives_the_same_to_the_last_bit():
    """Rows of their matrices have gaps between them."""
    env_id = "tensegrity/DualTriangleLoadedReach-v0"
    alone, many = (make_vec(env_id, 1024, autoreset_mode="SameStep", threads=threads) for threads in (1, 3))
    for mine, other in zip(alone.reset(seed=0), many.reset(seed=0), strict=True):
        assert_same(mine, other)
    rng = np.random.default_rng(0)
    for _ in range(8):
        action = rng.uniform(-1, 1, alone.action_space.shape)
        for mine, other in zip(alone.step(action), many.step(action), strict=True):
            assert_same(mine, other)
    many.close()


def test_gaps_between_the_rows_of_matrices_change_nothing():
    """Of 128 environments there are some, of 127 none: see `compiler.pytree.empty_matrix`."""
    env_id = "tensegrity/TwoXTensionReach-v0"
    even, odd = (make_vec(env_id, count, autoreset_mode="SameStep") for count in (128, 127))
    actions = np.random.default_rng(0).uniform(-1, 1, (20, *even.action_space.shape))
    results = [[envs.reset(seed=0), *(envs.step(a[: envs.num_envs]) for a in actions)] for envs in (even, odd)]
    assert even.unwrapped.get_state()["episodes"].flags.c_contiguous
    for (mine, *_, told), (other, *_, expected) in zip(*results, strict=True):
        for key, value in other.items():
            np.testing.assert_array_equal(mine[key][:127], value)
        for name in expected:
            if not name.startswith(("final", "_")):
                np.testing.assert_array_equal(told[name][:127], expected[name])


@pytest.mark.parametrize("threads", [0, -1, 1.5, True, "two"])
def test_numbers_of_threads_that_are_none_are_refused(threads):
    with pytest.raises(ValueError, match="threads"):
        make_vec(IDS[0], 2, threads=threads)


@every_id
def test_info_holds_numbers_only(env_id):
    env, envs = gym.make(env_id), make_vec(env_id)
    for info in (env.reset(seed=0)[1], env.step(env.action_space.sample())[4]):
        for name, value in info.items():
            assert value.dtype.kind in "fib", name
    for name, value in envs.reset(seed=0)[1].items():
        assert value.dtype.kind in "fib", name


@some_ids
def test_reasons_are_told_by_a_function(env_id):
    envs = make_vec(env_id, 64, autoreset_mode="SameStep")
    envs.reset(seed=0)
    for seed in range(60):
        envs.action_space.seed(seed)
        _, _, terminated, _, info = envs.step(np.sign(envs.action_space.sample()))
        reasons = tensegrity_envs.termination_reason(step_info(info)["failure"])
        assert all(bool(reason) == bool(failed) for reason, failed in zip(reasons, terminated, strict=True))
    assert tensegrity_envs.termination_reason(0) == ""
    assert tensegrity_envs.termination_reason(np.int64(3)) == "buckled"


@pytest.mark.parametrize("limit", [-1, None])
def test_no_time_limit(limit):
    envs = make_vec(IDS[0], 2, max_episode_steps=limit)
    envs.reset(seed=0)
    for _ in range(150):
        assert not envs.step(np.zeros((2, 2)))[3].any()


@pytest.mark.parametrize("limit", [0, -2, 1.5, True, "ten"])
def test_time_limits_that_are_none_are_refused(limit):
    with pytest.raises(ValueError, match="max_episode_steps"):
        make_vec(IDS[0], 2, max_episode_steps=limit)


@pytest.mark.parametrize("seed", [2**31, 2**32 + 1, 2**63 - 1, 2**63, 2**64 + 5, 2**100])
def test_any_whole_number_is_a_seed(seed):
    env, envs = gym.make(IDS[1]), make_vec(IDS[1], 3)
    batch, _ = envs.reset(seed=seed)
    for i in range(3):
        single, _ = env.reset(seed=seed + i)
        for key, value in single.items():
            np.testing.assert_array_equal(batch[key][i], value)
    assert len(np.unique(batch["desired_goal"], axis=0)) == 3
    again, _ = envs.reset(seed=[seed, None, seed])
    np.testing.assert_array_equal(again["desired_goal"][0], batch["desired_goal"][0])
    np.testing.assert_array_equal(again["desired_goal"][2], batch["desired_goal"][0])


@pytest.mark.parametrize("seed", [-1, 1.5, "3", True, np.float64(2)])
def test_what_is_no_seed_is_refused_before_anything_changes(seed):
    env, envs = gym.make(IDS[0]), make_vec(IDS[0], 2)
    env.reset(seed=0)
    envs.reset(seed=0)
    state, states = env.unwrapped.get_state(), envs.unwrapped.get_state()
    for reset in (
        lambda: env.unwrapped.reset(seed=seed),
        lambda: env.unwrapped.reset(options={"episode": seed}),
        lambda: envs.reset(seed=seed),
        lambda: envs.reset(seed=[seed, 2]),
        lambda: envs.reset(options={"episode": seed}),
        lambda: envs.reset(options={"episode": [seed, 2]}),
    ):
        with pytest.raises(ValueError, match="non-negative integer"):
            reset()
    assert_same(env.unwrapped.get_state() | {"steps": np.int64(0)}, state | {"steps": np.int64(0)})
    kept = {"is_staggered": np.bool_(False)}
    assert_same(envs.unwrapped.get_state() | kept, states | kept)


def test_episodes_of_a_vector_can_be_begun_by_their_numbers():
    env, envs = gym.make(IDS[0]), make_vec(IDS[0], 2)
    observation, _ = envs.reset(seed=5, options={"episode": [3, 0]})
    env.reset(seed=5)
    np.testing.assert_array_equal(observation["desired_goal"][0], env.reset(options={"episode": 3})[0]["desired_goal"])
    np.testing.assert_array_equal(observation["desired_goal"][1], env.reset(seed=6)[0]["desired_goal"])


@every_id
def test_rewards_are_computed_after_staggered_resets_too(env_id):
    envs = make_vec(env_id, 12, autoreset_mode="SameStep")
    envs.reset(seed=0, options={"stagger": True})
    rng = np.random.default_rng(0)
    for _ in range(12):
        observation, reward, terminated, truncated, info = envs.step(rng.uniform(-1, 1, envs.action_space.shape))
        goals = [observation[key].copy() for key in ("achieved_goal", "desired_goal")]
        for i in np.flatnonzero(terminated | truncated):
            for goal, key in zip(goals, ("achieved_goal", "desired_goal")):
                goal[i] = info["final_obs"][i][key]
        last = step_info(info)
        base = envs.unwrapped
        np.testing.assert_allclose(base.compute_reward(*goals, last), reward, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(base.compute_terminated(*goals, last), terminated)
        np.testing.assert_array_equal(base.compute_truncated(*goals, last), truncated)


@every_id
@pytest.mark.parametrize("nothing", [None, {}], ids=["None", "empty"])
def test_where_the_goals_decide_the_sparse_reward_needs_no_info(env_id, nothing):
    env = gym.make(env_id, reward_type="sparse").unwrapped
    observation, info = env.reset(seed=0)
    here = observation["achieved_goal"]
    there = np.stack([here, here + 2 * np.float32(env.core.task.tolerance)])
    batch = nothing if nothing is None else np.array([{}, {}])
    if not env.core.task.goals_decide:
        with pytest.raises(ValueError, match="copy_info_dict=True"):
            env.compute_reward(here, here, nothing)
        return
    assert env.compute_reward(here, here, nothing) == 1.0
    np.testing.assert_array_equal(env.compute_reward(np.stack([here, here]), there, batch), [1.0, 0.0])
    assert env.compute_reward(here, here, nothing) == env.compute_reward(here, here, info)
    dense = gym.make(env_id).unwrapped
    dense.reset(seed=0)
    with pytest.raises(ValueError, match="copy_info_dict=True"):
        dense.compute_reward(here, here, nothing)


@every_id
@pytest.mark.parametrize("kind", ["single", "vector"])
def test_a_state_that_was_kept_leads_to_the_same_future(env_id, kind):
    """Bit for bit, into the next episodes, in another environment too."""

    def make():
        return gym.make(env_id).unwrapped if kind == "single" else make_vec(env_id, autoreset_mode="SameStep").unwrapped

    env, other = make(), make()
    env.reset(seed=4)
    actions = np.random.default_rng(1).uniform(-1, 1, (25, *env.action_space.shape))

    def run(environment, steps):
        seen = []
        for action in steps:
            observation, reward, terminated, _, info = environment.step(action)
            seen += [*observation.values(), np.asarray(reward), info["configuration"]]
            if kind == "single" and terminated:
                seen += [*environment.reset()[0].values()]
        return seen

    run(env, actions[:10])
    state = env.get_state()
    first = run(env, actions[10:])
    env.reset(seed=9)
    for environment in (env, other):
        environment.set_state(state)
        for a, b in zip(run(environment, actions[10:]), first, strict=True):
            np.testing.assert_array_equal(a, b)
    with pytest.raises(ValueError, match="get_state"):
        env.set_state({})


@pytest.mark.parametrize("env_id", [IDS[0], "tensegrity/SpatialPrismTrack-v0", "tensegrity/TwoXPostureChange-v0"])
def test_pictures_of_a_vector(env_id, tmp_path):
    envs = make_vec(env_id, 3, render_mode="rgb_array", render_size=(120, 90))
    envs.reset(seed=0)
    before = envs.render()
    envs.step(envs.action_space.sample())
    after = envs.render()
    assert len(before) == 3
    for one, two in zip(before, after, strict=True):
        assert one.shape == two.shape == (90, 120, 3)
        assert (one != two).any()
    single = gym.make(env_id, render_mode="rgb_array", render_size=(120, 90))
    single.reset(seed=1)
    np.testing.assert_array_equal(single.render(), before[1])


def test_vector_videos_are_recorded(tmp_path):
    pytest.importorskip("moviepy")
    from gymnasium.wrappers.vector import RecordVideo

    envs = make_vec(IDS[0], 2, render_mode="rgb_array", render_size=64)
    envs = RecordVideo(envs, str(tmp_path), video_length=5)
    envs.reset(seed=0)
    for _ in range(8):
        envs.step(envs.action_space.sample())
    envs.close()
    assert list(tmp_path.glob("*.mp4"))


@pytest.mark.parametrize("size", [0, -3, 2.5, "big", (100,), (100, 0), (1, 2, 3), 10**6, True])
def test_picture_sizes_are_checked_at_once(size):
    for make in (gym.make, lambda env_id, **options: make_vec(env_id, 2, **options)):
        with pytest.raises(ValueError, match="render_size"):
            make(IDS[0], render_size=size)


@every_id
def test_registered_specs_survive_json(env_id):
    spec = gym.spec(env_id)
    assert EnvSpec.from_json(spec.to_json()) == spec


@pytest.mark.parametrize(
    ("env_id", "design"),
    [
        ("tensegrity/TwoXTensionReach-v0", {"b": 0.06, "l": 0.11}),
        ("tensegrity/DualTriangleReach-v0", "zhao2021_text"),
        ("tensegrity/PlanarFourBarReach-v0", {"length": 0.3, "stiffness": 2000}),
        ("tensegrity/SpatialPrismTrack-v0", {"base": "jahromy", "k": 200.0}),
        ("tensegrity/TwoXPostureChange-v0", {"b": 0.85}),
    ],
)
def test_designs_and_randomization_survive_json(env_id, design):
    """Names, mappings, and design objects, which Gymnasium turns into mappings."""
    some = {"actuation_delay": [0, 2], "tip_noise": 1e-4}
    random = {"randomization": some} if gym.make(env_id).unwrapped.core.randomizable >= set(some) else {}
    env = gym.make(env_id, design=design, **random)
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.unwrapped.design == env.unwrapped.design
    assert again.unwrapped.core.randomization == env.unwrapped.core.randomization
    for mine, other in zip(again.reset(seed=1)[0].values(), env.reset(seed=1)[0].values()):
        np.testing.assert_array_equal(mine, other)
    objects = gym.make(env_id, design=env.unwrapped.core.design, **random)
    assert gym.make(EnvSpec.from_json(objects.spec.to_json())).unwrapped.design == env.unwrapped.design
    envs = make_vec(env_id, 2, design=design, autoreset_mode="SameStep", **random)
    kwargs = json.loads(envs.unwrapped.spec.to_json())["kwargs"]
    assert kwargs["autoreset_mode"] == "SameStep"
    assert gym.make_vec(EnvSpec.from_json(envs.unwrapped.spec.to_json())).unwrapped.design == env.unwrapped.design


def test_designs_that_are_none_are_explained():
    for given, message in (
        ("muralidaran2022", "did you mean 'muralidharan2022'"),
        ("jahromy", "muralidharan2022, furet2018"),
        ({"bb": 1.0}, r"no field 'bb'.*there are b, l, a"),
        ({"base": "nobody"}, "must be one of"),
        ({"b": 2.0}, "greater than b"),
    ):
        with pytest.raises(ValueError, match=message):
            gym.make(IDS[0], design=given)


@every_id
def test_tolerances_grow_with_the_mechanism(env_id):
    core = gym.make(env_id).unwrapped.core
    if core.error_unit != "mm":
        return
    lengths = [name for name, text in described(type(core.design)).items() if "[m]" in text]
    twice = {name: 2 * value for name, value in vars(core.design).items() if name in lengths}
    assert gym.make(env_id, design=twice).unwrapped.core.task.tolerance == pytest.approx(2 * core.task.tolerance)
    assert gym.make(env_id, tolerance=0.004).unwrapped.core.task.tolerance == 0.004


@every_id
def test_what_can_be_randomized_is_told_and_the_rest_refused(env_id):
    some = {"stiffness": (0.9, 1.1), "mass": (0.9, 1.1), "damping": (0.9, 1.1), "payload": (0, 0.1)}
    some |= {"actuation_delay": (0, 1), "tip_noise": 1e-4, "angle_noise": 1e-3}
    core = gym.make(env_id).unwrapped.core
    for name, value in some.items():
        if name in core.randomizable:
            core = gym.make(env_id, randomization={name: value}, level=0).unwrapped.core
            assert core.randomization.names == [name]
        else:
            with pytest.raises(ValueError, match=name):
                gym.make(env_id, randomization={name: value})


@every_id
def test_an_unknown_backend_is_named(env_id):
    """Where there is a choice; elsewhere the option itself is unknown."""
    has_choice = "backend" in gym.make(env_id).unwrapped.core.shared
    error, message = (ValueError, "backend = 'torch'") if has_choice else (TypeError, "argument 'backend'")
    with pytest.raises(error, match=message):
        gym.make(env_id, backend="torch")


@some_ids
def test_less_info_is_a_part_of_it(env_id):
    envs = {kind: make_vec(env_id, info=kind, autoreset_mode="SameStep") for kind in ("full", "goal", "none")}
    rng = np.random.default_rng(0)
    told = {kind: [env.reset(seed=0)] for kind, env in envs.items()}
    for _ in range(30):
        action = rng.uniform(-1, 1, envs["full"].action_space.shape)
        for kind, env in envs.items():
            told[kind].append(env.step(action))
    for full, goal, none in zip(*told.values(), strict=True):
        for mine, other in zip(full[:-1], goal[:-1]):
            assert_same(mine, other)
        assert set(none[-1]) <= {"final_obs", "_final_obs", "final_info", "_final_info"}
        assert set(goal[-1]) < set(full[-1])
        for name, value in goal[-1].items():
            if name != "final_info":
                assert_same(value, full[-1][name], name)
    base, (observation, reward, terminated, truncated, info) = envs["goal"].unwrapped, told["goal"][-1]
    if not (terminated | truncated).any():
        goals = observation["achieved_goal"], observation["desired_goal"]
        np.testing.assert_allclose(base.compute_reward(*goals, info), reward, atol=1e-9)
    with pytest.raises(ValueError, match=r"info = 'some'.*'full', 'goal', 'none'"):
        make_vec(env_id, info="some")


def test_states_of_others_are_refused_and_change_nothing():
    env, other = gym.make(IDS[0]).unwrapped, gym.make(IDS[0], design={"b": 0.06}).unwrapped
    env.reset(seed=0)
    other.reset(seed=0)
    state = env.get_state()
    damaged = [{**state, "steps": 1.5}, {**state, "episode": state["episode"].astype(np.float32)}, None, 5, {}]
    damaged += [{name: value for name, value in state.items() if name != gone} for gone in state]
    for bad in (other.get_state(), make_vec(IDS[0], 1).unwrapped.core, *damaged):
        with pytest.raises(ValueError, match="state"):
            env.set_state(bad)
    for mine, kept in zip(env.get_state().values(), state.values(), strict=True):
        np.testing.assert_array_equal(mine, kept)
    envs = make_vec(IDS[0], 3).unwrapped
    envs.reset(seed=0)
    states = envs.get_state()
    for bad in ({**states, "steps": np.zeros(7, int)}, {**states, "ended": None}, {**states, "seeds": None}, state):
        with pytest.raises(ValueError, match="state"):
            envs.set_state(bad)


def test_infos_in_all_their_forms():
    envs = make_vec(IDS[1], 3, autoreset_mode="SameStep").unwrapped
    envs.reset(seed=0)
    observation, reward, _, truncated, info = envs.step(np.zeros(envs.action_space.shape))
    goals = observation["achieved_goal"], observation["desired_goal"]
    lists = {name: value.tolist() for name, value in info.items() if not name.startswith("_")}
    each = [{name: value[i] for name, value in info.items() if not name.startswith("_")} for i in range(3)]
    for form in (info, lists, each, np.array(each, object), tuple(each)):
        np.testing.assert_allclose(envs.compute_reward(*goals, form), reward, atol=1e-9)
        np.testing.assert_array_equal(envs.compute_truncated(*goals, form), truncated)
    assert envs.compute_truncated(goals[0][0], goals[1][0], each[0]) == truncated[0]
    assert envs.compute_reward(goals[0][:0], goals[1][:0], []).shape == (0,)
    for form, message in (
        (each[:2], "2 infos for 3 goals"),
        ([*each[:2], None], "copy_info_dict"),
        ([None] * 3, "copy_info_dict"),
        (each[0], "not 3 values"),
        ({"step": info["step"]}, "info lacks"),
        (5, "must be a dict"),
        (None, "copy_info_dict"),
    ):
        with pytest.raises(ValueError, match=message):
            envs.compute_reward(*goals, form)
    with pytest.raises(ValueError, match="finite"):
        envs.compute_reward(np.full_like(goals[0], np.nan), goals[1], info)


def test_a_plain_reset_forgets_staggered_limits():
    envs = make_vec(IDS[0], 4)
    assert "time_limit" in envs.reset(seed=0, options={"stagger": True})[1]
    assert "time_limit" not in envs.reset(seed=0)[1]
    for options in ({"stagger": "no"}, "stagger", 5):
        with pytest.raises(ValueError, match=r"stagger|options"):
            envs.reset(options=options)


def test_numbers_that_are_none_are_refused_by_name():
    for options, message in (
        ({"randomization": {"actuation_delay": [0, 10**9]}}, "up to 200"),
        ({"randomization": {"tip_noise": True}}, "tip_noise"),
        ({"randomization": {"stiffness": [True, True]}}, "stiffness"),
        ({"reward_weights": 3}, "reward_weights"),
        ({"reward_weights": {"distance": "a"}}, "distance"),
        ({"max_episode_steps": 2**70}, "max_episode_steps"),
    ):
        with pytest.raises(ValueError, match=message):
            make_vec(IDS[0], 2, **options)
    with pytest.raises(TypeError, match="base = 5"):
        gym.make(IDS[0], design={"base": 5})
    assert gym.make(IDS[0], randomization={"tip_noise": np.float32(0.001)})
    single, _ = gym.make(IDS[0]).reset(seed=2**64 - 1)
    batch, _ = make_vec(IDS[0], 1).reset(seed=np.uint64(2**64 - 1))
    np.testing.assert_array_equal(single["desired_goal"], batch["desired_goal"][0])
