"""The dynamic environments agree with the quasi-static ones where both say the same, and report what goes wrong."""

import os
import shutil
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

import tensegrity_envs
from tensegrity_envs import termination_reason
from tensegrity_envs.simulation import FAILURES
from tensegrity_envs.vector_env import step_info

pytest.importorskip("mujoco")
IDS = [env_id for env_id in tensegrity_envs.ENV_IDS if "MuJoCo" in env_id]
ENDS = {"PlanarFourBarReach": ("singular", "buckled"), "SpatialPrismTrack": ("singular", "buckled")}  # of episodes
every_id = pytest.mark.parametrize("env_id", IDS)


def make_vec(env_id, count, **options):
    return gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **options)


@pytest.mark.parametrize(
    "env_id", ["tensegrity/TwoXTensionReachMuJoCo-v0", "tensegrity/DualTriangleLoadedReachMuJoCo-v0"]
)
def test_slow_and_well_damped_arms_come_to_rest_where_the_equilibrium_is_followed_to(env_id):
    moving = make_vec(env_id, 40, dynamics={"joint_damping": 0.3}, max_episode_steps=None)
    resting = make_vec(env_id.replace("MuJoCo", ""), 40, max_episode_steps=None)
    a, _ = moving.reset(seed=0)
    b, _ = resting.reset(seed=0)
    np.testing.assert_array_equal(a["desired_goal"], b["desired_goal"])
    rng = np.random.default_rng(0)
    ended = np.zeros(40, bool)
    for _ in range(3):
        leg = rng.uniform(-1, 1, moving.action_space.shape)
        for action in [*[0.1 * leg] * 10, *[0 * leg] * 120]:
            _, _, first, _, info = moving.step(action)
            _, _, second, _, other = resting.step(action)
            ended |= first | second
    assert ended.sum() < 20
    gap = np.abs(info["configuration"] - other["configuration"])[~ended]
    assert np.median(gap) < 1e-4
    assert np.quantile(gap, 0.9) < 0.01  # close to buckling, the last of the motion takes long


@every_id
def test_many_threads_and_one_give_the_same_numbers(env_id):
    envs, env = make_vec(env_id, 64), gym.make(env_id)
    many, _ = envs.reset(seed=0)
    one, _ = env.reset(seed=37)
    rng = np.random.default_rng(1)
    for _ in range(40):
        action = rng.uniform(-0.4, 0.4, envs.action_space.shape).astype(np.float32)
        many, reward, ended, _, _ = envs.step(action)
        one, single, single_ended, _, _ = env.step(action[37])
        assert (reward[37], ended[37]) == (single, single_ended)
        if single_ended:
            break
        for key, value in one.items():
            np.testing.assert_array_equal(many[key][37], value)


@every_id
def test_bang_bang_actions_neither_flip_nor_break_the_simulation(env_id):
    """The whole run is `python tests/simulation/mujoco_measurements.py stress`."""
    envs = make_vec(env_id, 64)
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(60):
        observation, reward, _, _, info = envs.step(rng.choice([-1.0, 1.0], envs.action_space.shape))
        assert all(np.isfinite(part).all() for part in observation.values())
        assert np.isfinite(reward).all()
        reasons = set(termination_reason(step_info(info)["failure"]))
        assert reasons <= {"", *ENDS.get(gym.spec(env_id).kwargs["arm"], ("joint limit",))}


def test_a_simulation_that_diverges_is_a_failure_with_that_reason():
    dynamics = {"timestep": 0.005, "bar_line_density": 1e-7, "tip_mass": 0.0, "joint_damping": 0.0}
    env = gym.make("tensegrity/DualTriangleReachMuJoCo-v0", dynamics=dynamics)
    found = set()
    for seed in range(20):
        env.reset(seed=seed)
        rng = np.random.default_rng(seed)
        for _ in range(50):
            observation, reward, terminated, _, info = env.step(rng.choice([-1.0, 1.0], 3))
            assert all(np.isfinite(part).all() for part in observation.values())
            if terminated:
                assert reward == 0
                found.add(termination_reason(info["failure"]))
                break
    assert "simulation diverged" in found, found


def test_slack_cables_beyond_their_limit_end_the_episode():
    from dataclasses import replace

    from tensegrity_envs.mechanics.dual_triangle import ZHAO2021_CAPTION
    from tensegrity_envs.simulation.dynamic import DynamicControl, Motion
    from tensegrity_envs.simulation.protocol import Episode, State
    from tensegrity_envs.simulation.quasi_static import LARGEST_SLACK

    design = replace(ZHAO2021_CAPTION, springs="cable")
    env = gym.make("tensegrity/DualTriangleReachMuJoCo-v0", design=design)
    core = env.unwrapped.core
    control = core.simulation
    assert isinstance(control, DynamicControl)
    low, high = control.bounds(core.nominal)
    for sign, inputs in ((1, high), (-1, low)):
        q = (sign * 1.2,) * 3  # the inputs free the very cables that the posture shortens
        before = State(q, (-inputs,) * 3, core.nominal.tip(q), 0.0, 0.0, 0, 1.0)
        state = control.finish_step(
            core.nominal, Episode(design, (0.0, 0.0), (), (0.1, 0.0)), before, Motion(q, q, (), 0.0, 0.0)
        )
        free = core.nominal.free_lengths(before.inputs)
        slack = max(f - length for f, length in zip(free, core.nominal.spring_lengths(q))) / design.free_length1
        assert (FAILURES[state.failure] == "cable slack") == (slack > LARGEST_SLACK)


@every_id
def test_what_does_not_fit_is_named(env_id):
    for options, message in (
        ({"backend": "bullet"}, "bullet"),
        ({"dynamics": {"joint_dampning": 1.0}}, "joint_dampning"),
        ({"dynamics": {"timestep": 0.1}}, "timestep"),
        ({"backend": "quasi_static", "dynamics": {"joint_damping": 0.1}}, "mujoco"),
    ):
        with pytest.raises(ValueError, match=message):
            gym.make(env_id, **options)
    with pytest.raises(ValueError, match="joints have no motors"):
        gym.make("tensegrity/TwoXReach-v0", backend="mujoco")


@every_id
def test_pictures_and_depths(env_id):
    from tensegrity_envs.simulation.mujoco.displays import require_gl

    try:
        require_gl()
    except RuntimeError as error:
        pytest.skip(str(error))
    env = gym.make(env_id, render_mode="rgb_array", render_size=200)
    env.reset(seed=0)
    before = env.render()
    for _ in range(5):
        env.step(np.ones(env.action_space.shape))
    after = env.render()
    assert before.shape == after.shape == (200, 200, 3)
    assert (before != after).any(axis=2).mean() > 0.001
    env.close()
    env = gym.make(env_id, render_mode="depth_array", render_size=100)
    env.reset(seed=0)
    depth = env.render()
    assert depth.shape == (100, 100)
    assert depth.min() < 0.99 * depth.max()  # the arm is in front of the wall
    env.close()


def run_python(code, **environment):
    clean = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL")}
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, env=clean | environment
    )


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="displays are told from the environment on Linux")
def test_without_a_display_windows_are_refused_in_words():
    env_id = "tensegrity/DualTriangleReachMuJoCo-v0"
    code = f"import gymnasium, tensegrity_envs; gymnasium.make({env_id!r}, render_mode='human').reset()"
    found = run_python(code)
    assert found.returncode == 1
    assert "xvfb" in found.stderr
    assert "DisplayError" in found.stderr
    code = (
        "import gymnasium, tensegrity_envs\n"
        f"env = gymnasium.make({env_id!r}, render_mode='rgb_array')\n"
        "env.reset(seed=0)\nenv.render()"
    )
    found = run_python(code, MUJOCO_GL="glfw")
    assert found.returncode == 1
    assert "apt install libegl1" in found.stderr


@pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="no xvfb-run (Debian: apt install xvfb)")
def test_the_viewer_opens_and_closes_on_a_virtual_display():
    code = (
        "import gymnasium, tensegrity_envs\n"
        "env = gymnasium.make('tensegrity/DualTriangleReachMuJoCo-v0', render_mode='human')\n"
        "env.reset(seed=0)\nenv.step(env.action_space.sample())\n"
        "print('running' if env.unwrapped._pictures._viewer.is_running() else 'closed')\nenv.close()"
    )
    command = ["xvfb-run", "-a", sys.executable, "-c", code]
    found = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    if "GLFW" in found.stderr or "OpenGL" in found.stderr:
        pytest.skip(f"no OpenGL on the virtual display: {found.stderr.strip().splitlines()[-1]}")
    assert found.returncode == 0, found.stderr
    assert "running" in found.stdout


def test_without_mujoco_the_rest_runs_and_its_ids_name_the_extra():
    code = """
import sys
sys.modules["mujoco"] = None
import gymnasium as gym, tensegrity_envs
for env_id in tensegrity_envs.ENV_IDS:
    try:
        env = gym.make(env_id)
        env.reset(seed=0)
        env.step(env.action_space.sample())
        assert "MuJoCo" not in env_id
    except ImportError as error:
        assert "MuJoCo" in env_id, env_id
        assert 'pip install "tensegrity-envs[mujoco]"' in str(error), error
"""
    found = run_python(code)
    assert found.returncode == 0, found.stderr
