"""Copies, pickles, forks and threads of environments go on alike, to the bit; memory does not grow."""

import copy
import multiprocessing
import os
import pickle
import subprocess
import sys
import threading

import gymnasium as gym
import numpy as np
import pytest

import tensegrity_envs
from resident_memory import needs_counters, resident

DYNAMIC = [name for name in tensegrity_envs.ENV_IDS if "MuJoCo" in name]
RANDOMIZED = {"stiffness": (0.8, 1.2), "mass": (0.8, 1.25), "damping": (0.5, 2.0)}


def made(env_id, count, **options):
    if "MuJoCo" in env_id:
        pytest.importorskip("mujoco")
    if count is None:
        return gym.make(env_id, **options)
    return gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", **options)


def told(value):
    """A step's or reset's return as nested lists, bit by bit."""
    if isinstance(value, dict):
        return {key: told(part) for key, part in value.items()}
    if isinstance(value, tuple):
        return [told(part) for part in value]
    value = np.asarray(value)
    return (
        [told(part) for part in value] if value.dtype == object and value.ndim else (str(value.dtype), value.tobytes())
    )


def run(env, actions):
    found = []
    for action in actions:
        step = env.step(action)
        found.append(told(step))
        if np.ndim(step[2]) == 0 and (step[2] or step[3]):
            found.append(told(env.reset()))
    return found


def some_actions(env, seed, count):
    rng = np.random.default_rng(seed)
    return [0.3 * rng.choice([-1.0, 1.0], env.action_space.shape) for _ in range(count)]


@pytest.mark.parametrize("env_id", tensegrity_envs.ENV_IDS)
@pytest.mark.parametrize("count", [None, 20])
def test_copies_and_pickles_go_on_alike(env_id, count):
    env = made(env_id, count)
    env.reset(seed=3)
    run(env, some_actions(env, 0, 10))
    others = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    actions = some_actions(env, 1, 50)
    expected = run(env, actions)
    for other in others:
        assert run(other, actions) == expected
        other.close()
    env.close()


@pytest.mark.parametrize("env_id", DYNAMIC)
def test_randomized_ones_do_as_well_and_keep_no_models(env_id):
    for count in (None, 20):
        env = made(env_id, count, randomization=RANDOMIZED)
        env.reset(seed=3)
        run(env, some_actions(env, 0, 10))
        others = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
        actions = some_actions(env, 1, 50)
        expected = run(env, actions)
        assert all(run(other, actions) == expected for other in others)
        for _ in range(20):
            env.reset()
            env.step(some_actions(env, 0, 1)[0])
        models = env.unwrapped.core.engine._models
        assert len(models) == (count or 1)  # of the running episodes, without textures
        assert sum(model.nbuffer for model in models.values()) < 120_000 * len(models)


def test_a_picture_follows_its_copy():
    pytest.importorskip("mujoco")
    from tensegrity_envs.simulation.mujoco.displays import choose_gl

    choose_gl()
    env = gym.make(DYNAMIC[0], render_mode="rgb_array", render_size=64)
    env.reset(seed=0)
    try:
        expected = env.render()
    except RuntimeError as error:
        pytest.skip(str(error))
    for other in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        np.testing.assert_array_equal(other.render(), expected)
        other.close()
    env.close()


def _go_on(env, actions, pipe):
    pipe.send(run(env, actions))
    env.close()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system does not fork")
def test_a_forked_child_simulates_with_threads_of_its_own():
    env = made(DYNAMIC[0], 40)
    env.unwrapped.core.engine._cores = 2
    env.reset(seed=0)
    env.step(some_actions(env, 0, 1)[0])
    actions = some_actions(env, 1, 5)
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe()
    child = context.Process(target=_go_on, args=(env, actions, theirs))
    child.start()
    assert ours.poll(60), "the child hangs"
    assert ours.recv() == run(env, actions)
    child.join(60)
    assert child.exitcode == 0
    env.close()


def test_threads_leave_the_warning_handler_in_place():
    mujoco = pytest.importorskip("mujoco")
    heard = []
    handler = heard.append
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(handler)
    try:
        envs = [made(DYNAMIC[0], None) for _ in range(4)]

        def work(env):
            env.reset(seed=0)
            run(env, some_actions(env, 0, 200))

        threads = [threading.Thread(target=work, args=(env,)) for env in envs]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert mujoco.get_mju_user_warning() is handler
    finally:
        mujoco.set_mju_user_warning(before)


PLAIN_SCRIPT = """
import sys
import gymnasium as gym

if __name__ == "__main__":
    envs = gym.vector.AsyncVectorEnv(
        [lambda: gym.make("tensegrity_envs:" + sys.argv[2])] * 2, context=sys.argv[1]
    )
    envs.reset(seed=0)
    print(envs.step(envs.action_space.sample())[1].shape)
    envs.close()
"""


@pytest.mark.parametrize("method", multiprocessing.get_all_start_methods())
def test_workers_of_a_plain_script_find_ids_with_their_module(method, tmp_path):
    pytest.importorskip("mujoco")
    script = tmp_path / "plain.py"
    script.write_text(PLAIN_SCRIPT)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, script, method, DYNAMIC[0]],
        check=False,
        capture_output=True,
        text=True,
        env=environment,
        timeout=120,
    )
    assert done.stdout.strip() == "(2,)", done.stderr


@needs_counters
def test_memory_stays_flat_over_episodes():
    env = made(DYNAMIC[-1], None, randomization=RANDOMIZED)
    env.reset(seed=0)
    env.step(np.zeros(env.action_space.shape))
    before = resident()
    for _ in range(300):
        env.reset()
        env.step(np.zeros(env.action_space.shape))
    assert resident() - before < 10  # MB; 5,000 episodes: mujoco_measurements.py


@needs_counters
@pytest.mark.parametrize("env_id", ["DualTriangleLoadedReach-v0", "DualTriangleLoadedReachMuJoCo-v0"])
def test_512_loaded_arms_take_less_than_400_megabytes(env_id):
    code = f"""
import gymnasium, tensegrity_envs
env = gymnasium.make_vec("tensegrity/{env_id}", 512, vectorization_mode="vector_entry_point")
env.reset(seed=0)
env.action_space.seed(0)
def peak():
    return int(open("/proc/self/status").read().split("VmHWM:")[1].split()[0]) / 1024
for _ in range(110):  # all begin a second episode, and episodes have been drawn ahead
    env.step(env.action_space.sample())
before = peak()
for _ in range(110):
    env.step(env.action_space.sample())
print(peak(), peak() - before)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    whole, growth = (float(part) for part in done.stdout.split())
    assert whole < 400
    assert growth < 10
