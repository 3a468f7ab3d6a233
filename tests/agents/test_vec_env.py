"""The adapter to Stable-Baselines3: what SB3 stores is what single environments tell."""

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO, SAC, HerReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback

from tensegrity_agents.sb3.vec_env import VectorEnvAdapter

REACH = "tensegrity/TwoXTensionReach-v0"


class _Rollouts(BaseCallback):
    """Copies what the first rollout buffer holds."""

    def _on_step(self):
        return True

    def _on_rollout_end(self):
        buffer = self.model.rollout_buffer
        self.kept = {key: value.copy() for key, value in buffer.observations.items()}
        self.actions, self.rewards = buffer.actions.copy(), buffer.rewards.copy()
        self.starts = buffer.episode_starts.copy()


def test_rollout_buffers_hold_what_single_environments_tell():
    """Observations are stored after the next step: a reused buffer would corrupt them silently."""
    count, steps = 3, 64
    model = PPO(
        "MultiInputPolicy", VectorEnvAdapter.make(REACH, count), n_steps=steps, batch_size=count * steps, seed=5
    )
    kept = _Rollouts()
    model.learn(count * steps, callback=kept)
    for i in range(count):
        env = gym.make(REACH)
        observation, _ = env.reset(seed=5 + i)
        begins = True
        for t in range(steps):
            assert bool(kept.starts[t, i]) == begins
            for key, value in observation.items():
                np.testing.assert_array_equal(kept.kept[key][t, i], value)
            observation, reward, terminated, truncated, _ = env.step(np.clip(kept.actions[t, i], -1, 1))
            if not truncated:  # there SB3 adds the value of what was last seen
                assert kept.rewards[t, i] == pytest.approx(reward, abs=1e-6)
            begins = terminated or truncated
            if begins:
                observation, _ = env.reset()


@pytest.mark.parametrize("env_id", [REACH, "tensegrity/DualTrianglePush-v0"])
def test_hindsight_replay_on_the_native_vector(env_id):
    """The buffer's relabelled rewards are those that the environment computes, of goals that were achieved."""
    envs = VectorEnvAdapter.make(env_id, 4, full_info=True)
    model = SAC(
        "MultiInputPolicy",
        envs,
        replay_buffer_class=HerReplayBuffer,
        replay_buffer_kwargs={"copy_info_dict": True, "n_sampled_goal": 4},
        learning_starts=500,
        buffer_size=4000,
        policy_kwargs={"net_arch": [16]},
        seed=0,
    )
    model.learn(600)
    sample = model.replay_buffer.sample(256)
    assert np.isfinite(sample.rewards.numpy()).all()
    assert (sample.rewards.numpy() >= 0).all()


def test_without_full_info_infos_come_with_the_end_alone():
    envs = VectorEnvAdapter.make(REACH, 2, max_episode_steps=3)
    envs.reset()
    seen = [envs.step(np.zeros((2, 4)))[3] for _ in range(3)]
    assert seen[0] == seen[1] == [{}, {}]
    assert set(seen[2][0]) > {"terminal_observation", "TimeLimit.truncated", "is_success"}
    full = VectorEnvAdapter.make(REACH, 2, full_info=True)
    full.reset()
    assert {"configuration", "step", "payload"} <= set(full.step(np.zeros((2, 4)))[3][1])


def test_vectors_in_another_mode_are_refused_with_what_to_do():
    for make in (
        lambda: gym.make_vec(REACH, 2, vectorization_mode="vector_entry_point"),
        lambda: gym.make_vec("CartPole-v1", 2, vectorization_mode="sync"),
    ):
        with pytest.raises(ValueError, match='autoreset_mode="SameStep"'):
            VectorEnvAdapter(make())


def test_pictures_of_the_adapter():
    envs = VectorEnvAdapter.make(REACH, 2, render_mode="rgb_array", render_size=50)
    envs.reset()
    assert [image.shape for image in envs.get_images()] == [(50, 50, 3)] * 2
