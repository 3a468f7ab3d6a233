"""Fast reaching: the settling time against a look back over the whole episode, and what the arms are like."""

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("mujoco")

IDS = ("tensegrity/TwoXFastReachMuJoCo-v0", "tensegrity/DualTriangleFastReachMuJoCo-v0")
every_id = pytest.mark.parametrize("env_id", IDS)


@every_id
def test_the_settling_time_is_that_of_a_look_back(env_id):
    """With a wide tolerance and random actions the tip leaves the target and comes back; then it is left alone."""
    wide = 0.25
    env = gym.make(env_id, tolerance=wide)
    core, rng, seen, settled = env.unwrapped.core, np.random.default_rng(0), set(), 0
    for seed in range(12):
        _, info = env.reset(seed=seed)
        errors = [info["tip_error"]]
        for t in range(1, 80):
            _, _, terminated, _, info = env.step((0.4 if t < 30 else 0.0) * rng.uniform(-1, 1, env.action_space.shape))
            if terminated:
                break
            errors.append(info["tip_error"])
            off = [k for k, error in enumerate(errors) if error > wide]
            since = off[-1] + 1 if off else 0
            assert info["settling_time"] == pytest.approx(0.02 * since)
            rests = errors[-1] <= wide and info["stability_margin"] > 0
            assert info["is_success"] == (rests and t - since >= 25)
            assert (info["reward_success"] > 0) == rests  # at once, or learning would have nothing to go by
            seen.add((bool(rests), bool(off)))
            settled += bool(info["is_success"])
    assert seen >= {(False, True), (True, True)} and settled > 3
    assert core.task.hold == 25 and core.task.step_time == 0.02


@every_id
def test_the_arms_are_as_documented_and_own_dynamics_go_on_top(env_id):
    own = gym.make(env_id, dynamics={"joint_damping": 0.1}).unwrapped.core.dynamics
    assert (own.joint_damping, own.joint_friction, own.actuator_bandwidth) == (0.1, 0.002, 8.0)
    assert gym.make(env_id).unwrapped.core.dynamics.joint_damping == 0.005
    with pytest.raises(ValueError, match="backend = 'mujoco'"):
        gym.make(env_id, backend="quasi_static")


@every_id
def test_friction_and_bandwidth_vary_where_there_are_any(env_id):
    ranges = {"friction": (0.5, 2.0), "bandwidth": (0.8, 1.25)}
    envs = gym.make_vec(env_id, 200, vectorization_mode="vector_entry_point", randomization=ranges)
    info = envs.reset(seed=0)[1]
    for name, (low, high) in ranges.items():
        drawn = info[f"random_{name}"]
        assert low <= drawn.min() < low + 0.1 * (high - low) and high - 0.1 * (high - low) < drawn.max() <= high
    with pytest.raises(ValueError, match="'friction' does not apply"):
        gym.make(env_id, dynamics={"joint_friction": 0.0}, randomization={"friction": (0.5, 2.0)})
    plain = env_id.replace("FastReach", "TensionReach" if "TwoX" in env_id else "Reach")
    assert not {"random_friction", "random_bandwidth"} & set(gym.make(plain, level=2).reset(seed=0)[1])


@pytest.mark.parametrize("name", ["friction", "bandwidth"])
def test_a_drawn_factor_is_the_arm_built_with_it(name):
    """The same motion as of the environment whose own dynamics have that value."""
    field, usual = {"friction": ("joint_friction", 0.002), "bandwidth": ("actuator_bandwidth", 8.0)}[name]
    drawn = gym.make(IDS[0], randomization={name: (1.5, 1.5)})
    built = gym.make(IDS[0], dynamics={field: 1.5 * usual})
    plain = gym.make(IDS[0])
    rng, q = np.random.default_rng(1), []
    for env in (drawn, built, plain):
        env.reset(seed=4)
    for action in 0.3 * rng.uniform(-1, 1, (15, 4)):
        q.append([env.step(action)[4]["configuration"] for env in (drawn, built, plain)])
    drawn, built, plain = np.swapaxes(q, 0, 1)
    np.testing.assert_allclose(drawn, built, atol=1e-9)
    assert np.abs(drawn - plain).max() > 1e-6
