"""What the nominal model tells agents: against forward kinematics and simulations, in training and from a file."""

import gymnasium as gym
import numpy as np
import pytest

from tensegrity_agents.config import Experiment
from tensegrity_agents.controllers.model_features import ModelFeatures
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.sb3.augmented import AugmentedVecEnv
from tensegrity_agents.sb3.policy_file import load_policy
from tensegrity_agents.sb3.training import train
from tensegrity_agents.sb3.vec_env import VectorEnvAdapter
from tensegrity_envs.mechanics import PlanarFourBar
from tensegrity_envs.mechanics.planar_four_bar.inverse import rectangles
from tensegrity_envs.seeding import VALIDATION_SEED

REACH, LOADED = "tensegrity/PlanarFourBarReach-v0", "tensegrity/PlanarFourBarLoadedReach-v0"
ARM = PlanarFourBar()


def make_vec(env_id, count):
    return gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")


def told(env_id, count):
    """Observation, info, and the features alone."""
    observation, info = make_vec(env_id, count).reset(seed=3)
    return observation, info, alone(ModelFeatures(env_id)(observation)[0], observation)


def alone(with_hints, observation):
    return with_hints["observation"][:, observation["observation"].shape[1] :]


def test_the_gap_leads_to_the_target():
    observation, info, features = told(REACH, 500)
    lengths = info["actuator_lengths"] + 20.0 * features[:, :2]
    _, tip = ARM.rectangle(tuple(lengths.T), info["random_side"])
    off = np.abs(np.stack(tip, 1) - observation["desired_goal"]).max(axis=1)
    there = off < 2e-4
    assert 0.75 < there.mean() < 1  # at once, but for those who must go round where C and D meet
    assert np.hypot(*(lengths[~there] - 10.0).T).max() < 5.1
    np.testing.assert_allclose(features[:, 2:4], np.tanh(40.0 * features[:, :2]), atol=1e-5)
    np.testing.assert_allclose(features[:, 4:6], np.tanh(400.0 * features[:, :2]), atol=1e-3)
    assert np.abs(features[:, 10]).max() < 1e-3  # nothing pushes


def test_without_a_solution_the_gap_leads_near_the_target():
    observation, info = make_vec(LOADED, 2000).reset(seed=3)
    features = alone(ModelFeatures(REACH, {"observe": "tip_and_inputs"})(observation)[0], observation)
    lengths = info["actuator_lengths"] + 20.0 * features[:, :2]
    _, tip = ARM.rectangle(tuple(lengths.T), info["random_side"])
    off = np.hypot(*(np.stack(tip, 1) - observation["desired_goal"]).T)
    _, sides, exists = rectangles(ARM, *observation["desired_goal"].astype(float).T)
    none = ~(exists & (sides == info["random_side"])).any(axis=0)
    straight = np.hypot(*(lengths - 10.0).T) > 5.1
    assert 20 < (none & straight).sum() < 400
    # No place of a fine grid of lengths has its tip much nearer.
    grid = np.stack(np.meshgrid(*[np.linspace(0.3, 19.7, 98)] * 2), -1).reshape(-1, 2)
    square, rest = ARM.flatness(tuple(grid.T))
    grid = grid[2 * np.minimum(square, rest) > 0.2]  # like the places
    for i in np.flatnonzero(none & straight):
        _, tips = ARM.rectangle(tuple(grid.T), info["random_side"][i])
        assert off[i] < np.hypot(*(np.stack(tips, 1) - observation["desired_goal"][i]).T).min() + 2.5


class Follower:
    """Goes where the gap tells."""

    def __init__(self, env_id):
        self.features = ModelFeatures(env_id)

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        seen, state = self.features(observation, state, episode_start)
        gap = 40.0 * alone(seen, observation)[:, :2]
        return gap / np.maximum(np.abs(gap).max(axis=1, keepdims=True), 1.0), state


@pytest.mark.parametrize(("env_id", "share"), [(REACH, 0.99), (LOADED, 0.8)])
def test_who_follows_the_gaps_arrives(env_id, share):
    run = evaluate(Follower(env_id), env_id, 1000, VALIDATION_SEED, "follower")
    assert run.columns["success"].mean() > share


def test_the_step_leads_to_a_target_close_by():
    observation, info, _ = told(REACH, 500)
    angle = np.random.default_rng(0).uniform(-np.pi, np.pi, 500)
    wanted = 0.01 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    observation["desired_goal"] = observation["achieved_goal"] + wanted
    features = alone(ModelFeatures(REACH)(observation)[0], observation)[:, 6:8]
    lengths = info["actuator_lengths"] + 0.05 * np.arctanh(features)
    _, tip = ARM.rectangle(tuple(lengths.T), info["random_side"])
    left = np.hypot(*(np.stack(tip, 1) - observation["desired_goal"]).T)
    assert np.median(left) < 0.001  # a tenth of the way; where the Jacobian is nearly singular damping keeps it back
    assert (left < 0.01).mean() > 0.99


def test_the_force_across_the_bar_is_the_load():
    _, info, features = told(LOADED, 500)
    across, share = features[:, 8:10], features[:, 10]
    force = (across * info["load"]).sum(axis=1) / 1000.0
    np.testing.assert_allclose(share, force, atol=2e-3)
    np.testing.assert_allclose(np.hypot(*across.T), 1.0, atol=1e-5)


def test_the_margin_is_the_simulations_without_a_load():
    _, info, features = told(REACH, 500)
    q, lengths = tuple(info["configuration"].T), tuple(info["actuator_lengths"].T)
    expected = ARM.stability_margin(q, lengths, (0.0, 0.0))
    np.testing.assert_allclose(features[:, 11], expected / (1 + np.abs(expected)), atol=1e-3)


def after_two_postures(count):
    """Observation, info, features of the first and of the second posture."""
    envs, features = make_vec(LOADED, count), ModelFeatures(LOADED)
    observation, info = envs.reset(seed=3)
    first, memory = features(observation)
    action = np.tile([0.2, -0.3], (count, 1))
    observation, _, ended, _, info = envs.step(action)
    second, _ = features(observation, memory, ended)
    return observation, info, alone(first, observation), alone(second, observation), ended


def test_two_postures_reveal_the_force():
    _, info, first, second, ended = after_two_postures(500)
    going = ~ended
    error = np.hypot(*(1000.0 * second[:, 12:14] - info["load"]).T)[going]
    assert (error < 1.0).mean() > 0.95  # of up to 200 N, from observations in single precision
    assert np.median(error) < 0.1
    assert (first[:, 14] < 1e-6).all()
    assert (second[going, 14] > 1e-4).mean() > 0.9
    margin = ARM.stability_margin(
        tuple(info["configuration"].T), tuple(info["actuator_lengths"].T), tuple(info["load"].T)
    )
    off = np.abs(second[:, 11] - margin / (1 + np.abs(margin)))[going]
    assert (off < 0.01).mean() > 0.95


def test_the_gap_under_a_force_leads_to_a_stable_equilibrium_with_the_tip_on_the_target():
    observation, info, _, second, ended = after_two_postures(300)
    lengths = info["actuator_lengths"] + 20.0 * second[:, :2]
    straight = np.hypot(*(lengths - 10.0).T) > 7.2  # beyond the corners of ways round where C and D meet
    near = []
    for i in np.flatnonzero(~ended & straight)[:60]:
        states = ARM.equilibria(tuple(lengths[i]), tuple(info["load"][i]))
        tips = np.array([ARM.tip(state.configuration, tuple(lengths[i])) for state in states if state.is_stable])
        near.append(np.hypot(*(tips - observation["desired_goal"][i]).T).min() if len(tips) else np.inf)
    assert len(near) > 30
    assert (np.array(near) < 0.02).mean() > 0.95


@pytest.mark.parametrize("env_id", [REACH, LOADED])
def test_single_observations_terminal_ones_and_batches_agree(env_id):
    features = ModelFeatures(env_id)
    envs = AugmentedVecEnv(VectorEnvAdapter(make_vec(env_id, 8)), features)
    envs.seed(0)
    observation = envs.reset()
    assert observation["observation"].shape == (8, envs.observation_space["observation"].shape[0])
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (110, 8, 2)).astype(np.float32)
    seen, ends = [observation["observation"]], np.zeros(8, int)
    for step, action in enumerate(actions):
        observation, _, done, infos = envs.step(action)
        last = observation["observation"].copy()
        for i in np.flatnonzero(done):
            last[i] = infos[i]["terminal_observation"]["observation"]
            ends[i] = ends[i] or step + 1
        seen.append(last)
    assert (ends > 0).all()
    # The first episode of each, alone.
    for i in range(3):
        env, memory = gym.make(env_id), None
        plain, _ = env.reset(seed=i)
        for step in range(ends[i] + 1):
            told, memory = features(plain, memory, np.array([step == 0]))
            np.testing.assert_allclose(told["observation"], seen[step][i], atol=1e-6)
            plain, *_ = env.step(actions[min(step, 109), i]) if step < ends[i] else (plain,)


def test_a_policy_with_hints_survives_its_file(tmp_path):
    settings = {
        "total_timesteps": 1024,
        "net_arch": [8],
        "model_hints": True,
        "ppo": {"num_envs": 64, "n_steps": 16, "n_epochs": 1},
    }
    policy = train(Experiment(env=LOADED, train=settings), 0, tmp_path)
    observation, _ = make_vec(LOADED, 16).reset(seed=0)
    again = load_policy(tmp_path, LOADED)
    np.testing.assert_array_equal(policy.predict(observation)[0], again.predict(observation)[0])
    assert "nominal model" in again.knows


def test_hints_that_there_are_not_are_refused():
    with pytest.raises(ValueError, match=r"none for tensegrity/TwoXReach-v0; there are for .*PlanarFourBarReach-v0"):
        Experiment(env="TwoXReach-v0", train={"total_timesteps": 1, "model_hints": True})
    with pytest.raises(ValueError, match="her"):
        Experiment(env=REACH, train={"total_timesteps": 1, "model_hints": True, "algorithm": "sac"})
