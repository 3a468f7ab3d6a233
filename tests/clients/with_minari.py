"""Minari: collect a data set, save it, load it, make its environment again, and replay its episodes."""

import os
import tempfile

os.environ["MINARI_DATASETS_PATH"] = tempfile.mkdtemp()

import gymnasium as gym
import minari
import numpy as np
from report import DYNAMIC, IDS, QUASI_STATIC, Client, must

import tensegrity_envs  # noqa: F401  (registers)

EPISODES = 3


def collect(env: gym.Env, name: str, seeds: list[int]) -> minari.MinariDataset:
    """Random actions for some episodes, with the infos recorded."""
    collector = minari.DataCollector(env, record_infos=True)
    env.action_space.seed(0)
    for seed in seeds:
        collector.reset(seed=seed)
        ended = False
        while not ended:
            *_, terminated, truncated, _ = collector.step(env.action_space.sample())
            ended = terminated or truncated
    collector.create_dataset(name, algorithm_name="random", eval_env=None)
    collector.close()
    return minari.load_dataset(name)


def round_trip(env_id: str, **options: object) -> str:
    """What was saved is what the environment that Minari recovers from the file gives again."""
    seeds = [0, 2**40, 2**63]
    name = f"tensegrity/{env_id.split('/')[1].lower().removesuffix('-v0')}{len(options)}/random-v0"
    data = collect(gym.make(env_id, **options), name, seeds)
    must(data.total_episodes == EPISODES, f"{data.total_episodes} episodes")
    env = data.recover_environment()
    must(env.spec.id == env_id, f"recovered {env.spec.id}")
    for seed, episode in zip(seeds, data.iterate_episodes(), strict=True):
        observation, _ = env.reset(seed=seed)
        for step, action in enumerate(episode.actions):
            must(
                all(np.array_equal(observation[key], episode.observations[key][step]) for key in observation),
                f"the recovered environment observes something else in step {step}",
            )
            observation, reward, terminated, truncated, _ = env.step(action)
            must(reward == episode.rewards[step], f"another reward in step {step}")
            must(terminated == episode.terminations[step] and truncated == episode.truncations[step], "ends elsewhere")
        must("is_success" in episode.infos, f"infos: {list(episode.infos)}")
    return f"{EPISODES} episodes, {data.total_steps} steps, equal when replayed"


def random_seeds(env_id: str) -> str:
    """Minari seeds resets that are given none with integers of up to 64 bits."""
    collector = minari.DataCollector(gym.make(env_id))
    for _ in range(40):
        collector.reset()
    collector.close()
    return "40 of 40"


def main() -> None:
    """All ids; and a design and a randomization by name and by mapping, which a data set keeps as JSON."""
    client = Client("minari")
    for env_id in IDS:
        client.check(env_id, "collect, save, load, recover, replay", round_trip, env_id)
        client.check(env_id, "resets with Minari's own seeds", random_seeds, env_id)
    what = "the same with design and randomization as mappings"
    for env_id in (QUASI_STATIC, DYNAMIC):
        options = {"design": {"b": 0.06}, "randomization": {"stiffness": [0.9, 1.1]}}
        client.check(env_id, what, lambda i=env_id, o=options: round_trip(i, **o))


if __name__ == "__main__":
    main()
