"""Tianshou: SAC with its hindsight buffer, whose reward function is told the goals alone."""

from typing import Any

import gymnasium as gym
import numpy as np
import torch
from report import IDS, Client, must
from tianshou.algorithm import SAC
from tianshou.algorithm.modelfree.sac import SACPolicy
from tianshou.algorithm.optim import AdamOptimizerFactory
from tianshou.data import Batch, Collector, HERVectorReplayBuffer
from tianshou.env import DummyVectorEnv, SubprocVectorEnv
from tianshou.utils.net.common import Net
from tianshou.utils.net.continuous import ContinuousActorProbabilistic, ContinuousCritic
from tianshou.utils.torch_utils import policy_within_training_step

import tensegrity_envs  # noqa: F401  (registers)

ROWS = ("observation", "achieved_goal", "desired_goal")
STEPS, BATCH, HORIZON = 600, 256, 150
LEARNS = "SAC with HERVectorReplayBuffer, compute_reward(achieved, desired, None)"


def row(obs: Any) -> np.ndarray:
    """The Dict observation as one row."""
    return np.concatenate([np.asarray(obs[key]) for key in ROWS], axis=-1)


class Actor(ContinuousActorProbabilistic):
    """Tianshou's actor, of Dict observations."""

    def forward(self, obs: Any, state: Any = None, info: Any = None) -> Any:
        """Mean and deviation of the action."""
        return super().forward(row(obs), state)


class Critic(ContinuousCritic):
    """Tianshou's critic, of Dict observations."""

    def forward(self, obs: Any, act: Any = None, info: Any = None) -> Any:
        """The value of an action."""
        return super().forward(row(obs), act)


def learner(env: gym.Env[Any, Any]) -> SAC:
    """A small SAC."""
    space: Any = env.observation_space
    width, actions = sum(space[key].shape[0] for key in ROWS), env.action_space.shape
    assert actions is not None
    actor = Actor(
        preprocess_net=Net(state_shape=width, hidden_sizes=[64]),
        action_shape=actions,
        unbounded=True,
        conditioned_sigma=True,
    )
    critic = Critic(preprocess_net=Net(state_shape=width, action_shape=actions, hidden_sizes=[64], concat=True))
    return SAC(
        policy=SACPolicy(actor=actor, action_space=env.action_space),
        policy_optim=AdamOptimizerFactory(),
        critic=critic,
        critic_optim=AdamOptimizerFactory(),
    )


def hindsight(env_id: str) -> str:
    """Collects, relabels and learns; the relabelled rewards are those of the distance between the goals."""
    np.random.seed(0)  # noqa: NPY002  (Tianshou's buffers draw from it)
    torch.manual_seed(0)
    env = gym.make(env_id, reward_type="sparse")
    reward = env.unwrapped.compute_reward
    tolerance = env.unwrapped.core.task.tolerance
    envs = DummyVectorEnv([lambda: gym.make(env_id, reward_type="sparse") for _ in range(2)])
    buffer = HERVectorReplayBuffer(
        4 * STEPS, buffer_num=2, compute_reward_fn=lambda achieved, goal: reward(achieved, goal, None), horizon=HORIZON
    )
    algorithm = learner(env)
    collector = Collector[Any](algorithm, envs, buffer)
    collector.reset(gym_reset_kwargs={"seed": 1})
    with policy_within_training_step(algorithm.policy):
        collector.collect(n_step=STEPS)
        for _ in range(3):
            statistics = algorithm.update(buffer=buffer, sample_size=BATCH)
    must(np.isfinite(statistics.get_loss_stats_dict()["critic1_loss"]), "no finite loss")
    batch, _ = buffer.sample(BATCH)
    distance = np.linalg.norm(batch.obs_next.achieved_goal - batch.obs_next.desired_goal, axis=-1)
    relabelled = batch.rew > 0
    must(relabelled.any(), "no goal was reached in hindsight")
    must((distance[relabelled] <= tolerance).all(), "a reward beyond the tolerance")
    return f"learns; rewards after relabelling go by the {tolerance * 1000:.3g} mm"


def processes(env_id: str) -> str:
    """Environments in processes of their own give what they give in this one."""
    makers = [lambda: gym.make(f"tensegrity_envs:{env_id}") for _ in range(2)]
    here, there = DummyVectorEnv(makers), SubprocVectorEnv(makers, context="spawn")
    seen = [Batch({"obs": list(envs.reset(seed=3)[0])}) for envs in (here, there)]
    generator = np.random.default_rng(0)
    for _ in range(20):
        actions = 0.05 * generator.uniform(-1, 1, (2, *here.action_space[0].shape)).astype(np.float32)
        (_, first, *_), (_, second, *_) = here.step(actions), there.step(actions)
        must(np.array_equal(first, second), "other rewards in processes")
    must(str(seen[0]) == str(seen[1]), "other observations in processes")
    there.close()
    return "equal to DummyVectorEnv"


def main() -> None:
    """All ids."""
    client = Client("tianshou")
    for env_id in IDS:
        client.check(
            env_id, "SAC with HERVectorReplayBuffer, compute_reward(achieved, desired, None)", hindsight, env_id
        )
        client.check(env_id, "SubprocVectorEnv, spawned", processes, env_id)


if __name__ == "__main__":
    main()
