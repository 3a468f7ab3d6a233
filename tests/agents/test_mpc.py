"""Sampling MPC: it reaches, it plans in the believed model alone, and its plans are better than what it began with."""

import gymnasium as gym
import numpy as np
import pytest

from baseline_runs import success_of
from tensegrity_agents.controllers import baselines_of, make_controller

IDS = ("tensegrity/TwoXTensionReachUncertain-v0", "tensegrity/DualTriangleLoadedReachUncertain-v0")


@pytest.mark.parametrize("env_id", IDS)
def test_it_reaches_with_noise_and_delay(env_id):
    assert success_of(env_id, "mpc") >= 0.9
    assert list(baselines_of(env_id))[-3:] == ["mpc", "informed", "random"]


@pytest.mark.parametrize(
    ("name", "env_id"),
    [
        *(("mpc", env_id) for env_id in IDS),
        *((name, "tensegrity/DualTriangleFastReachMuJoCo-v0") for name in ("lqg", "identifying_observer")),
        ("lqg", "tensegrity/DualTriangleLoadedReachUncertainMuJoCo-v0"),
        *((name, "tensegrity/TwoXTensionReachUncertainMuJoCo-v0") for name in ("servo", "identifying_observer", "lqg")),
        ("servo", "tensegrity/PlanarFourBarReachUncertainMuJoCo-v0"),
        *(
            (name, f"tensegrity/{kind}Uncertain-v0")
            for kind in ("SpatialPrismPayloadTrack", "PlanarFourBarLoadedReach")
            for name in ("servo", "identifying_observer")
        ),
    ],
)
def test_hidden_parameters_do_not_reach_the_controller(name, env_id):
    """Other arms, loads and delays behind the same observations: the same actions."""
    if "MuJoCo" in env_id:
        pytest.importorskip("mujoco")
    envs = [gym.make_vec(env_id, 2, vectorization_mode="vector_entry_point", level=2) for _ in range(2)]
    seen, other = [env.reset(seed=seed)[0] for env, seed in zip(envs, (1, 99), strict=True)]
    assert not np.array_equal(seen["observation"], other["observation"])
    controllers = [make_controller(name, env_id, {"level": 2}) for _ in range(2)]
    for controller, env in zip(controllers, envs, strict=True):
        controller.begin_episodes(np.ones(2, bool), env.unwrapped.design, None)
        assert not controller.wants_privileged
    states = [None, None]
    steps = 14 if "MuJoCo" in env_id else 3  # some look before they act
    for _ in range(steps):
        actions = []
        for i, controller in enumerate(controllers):
            action, states[i] = controller.predict(seen, states[i], None if states[i] is None else np.zeros(2, bool))
            actions.append(action)
        np.testing.assert_array_equal(*actions)
        seen = envs[0].step(actions[0].astype(np.float32))[0]
        envs[1].step(actions[0].astype(np.float32))
    assert np.abs(actions[0]).max() > 0.01


def test_episodes_that_begin_do_not_disturb_the_others():
    env_id = IDS[0]
    envs = gym.make_vec(env_id, 3, vectorization_mode="vector_entry_point")
    seen = envs.reset(seed=5)[0]
    controller = make_controller("mpc", env_id)
    action, state = controller.predict(seen)
    seen = envs.step(action.astype(np.float32))[0]
    whole, _ = controller.predict(seen, state, np.zeros(3, bool))
    mixed, memory = controller.predict(seen, state, np.array([False, True, False]))
    np.testing.assert_allclose(mixed[[0, 2]], whole[[0, 2]], atol=1e-12)
    fresh, _ = controller.predict({key: value[1:2] for key, value in seen.items()})
    np.testing.assert_allclose(mixed[1:2], fresh, atol=1e-12)
    assert memory.step.tolist() == [2, 1, 2]


def test_what_it_finds_costs_no_more_than_what_it_began_with():
    env_id = IDS[1]
    envs = gym.make_vec(env_id, 4, vectorization_mode="vector_entry_point")
    seen = envs.reset(seed=2)[0]
    controller = make_controller("mpc", env_id)
    observed = controller.decode(seen)
    memory = controller.initial(observed, np.arange(4))
    episodes = controller._episodes(memory.belief, observed.target)
    rest = np.zeros((1, *memory.actions.shape))
    best = controller._planned(episodes, memory.model, rest, np.full(4, 0.1))
    before, after = controller._costs(
        np.repeat(episodes, 2, axis=1), np.repeat(memory.model.T, 2, axis=1), np.stack([rest[0], best], axis=1)
    ).T
    assert (after < before).all()
    # The model is nominal but for the believed load.
    episode = controller.core.episodes.unpack(episodes)
    assert np.all(episode.design.k1 == controller.core.design.k1) and np.all(episode.random["actuation_delay"] == 0)
    np.testing.assert_allclose(np.stack(episode.load, axis=1), memory.belief.load)
