"""RLlib: episodes of its environment runner are whole ones in every way it makes vectors; PPO trains."""

import logging
import warnings
from typing import Any

import numpy as np
import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.connectors.env_to_module import FlattenObservations
from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner
from report import DYNAMIC, IDS, QUASI_STATIC, Client, must

warnings.filterwarnings("ignore")  # RLlib's own
LIMIT = 7  # steps of an episode
NATIVE, SYNC = "vector_entry_point", "sync"


def importing(env_id: str) -> str:
    """The id as Ray's workers, which have imported nothing, find it."""
    return f"tensegrity_envs:{env_id}"


def config(env_id: str, mode: str, limit: int = LIMIT) -> PPOConfig:
    """PPO on two environments in a vector of RLlib's making."""
    return (
        PPOConfig()
        .environment(importing(env_id), env_config={"max_episode_steps": limit})
        .env_runners(
            num_env_runners=0,
            num_envs_per_env_runner=2,
            gym_env_vectorize_mode=mode,
            env_to_module_connector=lambda env=None, *_, **__: FlattenObservations(),
        )
    )


def goals(episode: Any) -> np.ndarray:
    """The desired goal at each of an episode's observations."""
    seen = [episode.get_observations(i) for i in range(len(episode) + 1)]
    return np.array([o["desired_goal"] for o in seen]) if isinstance(seen[0], dict) else np.array(seen)[:, 2:4]


def whole_episodes(env_id: str, mode: str) -> str:
    """Episodes end by their time limit or by failure, have all their steps, and one target each."""
    runner = SingleAgentEnvRunner(config=config(env_id, mode), worker_index=1)
    episodes = [e for e in runner.sample(num_timesteps=20 * LIMIT, random_actions=True) if e.is_done]
    lengths = [len(e) for e in episodes]
    must(len(episodes) >= 4, f"only {len(episodes)} episodes")
    for episode, length in zip(episodes, lengths, strict=True):
        must(episode.is_terminated or length == LIMIT, f"lengths {lengths}, not {LIMIT}")
        seen = goals(episode)
        must((seen == seen[0]).all(), "the target changes inside an episode")
    targets = {tuple(goals(e)[0]) for e in episodes}
    must(len(targets) == len(episodes), "two episodes with the same target")
    return "every episode whole, one target each"


def trains(env_id: str, mode: str, workers: int) -> str:
    """One iteration of PPO."""
    settings = config(env_id, mode, 100).env_runners(num_env_runners=workers)
    algorithm = settings.training(train_batch_size_per_learner=400, minibatch_size=100, num_epochs=1).build_algo()
    result = algorithm.train()["env_runners"]
    algorithm.stop()
    must(np.isfinite(result["episode_return_mean"]), "no return")
    return "one iteration"


def main() -> None:
    """Both ways of making vectors on three ids, and training."""
    client = Client("ray")
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level=logging.ERROR)
    for env_id in IDS:
        for mode in (SYNC, NATIVE):
            client.check(env_id, f"RLlib's episodes, {mode}", whole_episodes, env_id, mode)
    for env_id in (QUASI_STATIC, DYNAMIC):
        client.check(env_id, "PPO, native vector", trains, env_id, NATIVE, 0)
        client.check(env_id, "PPO, native vectors in a worker of Ray's", trains, env_id, NATIVE, 1)
    ray.shutdown()


if __name__ == "__main__":
    main()
