"""An agent of Stable-Baselines3 that knows nothing of this package's training, scored under its protocol.

python examples/foreign_sb3_agent.py [--steps 20000] [--episodes 200]

The agent is trained here, on flat observations and with a normalization of its own, as one would on any environment. To
be scored, it needs one thing: Stable-Baselines3's `predict`, for batches of the environment's Dict. `Flat` gives it
that. Nothing is saved and nothing is loaded: a model file of Stable-Baselines3 holds a pickle, which runs whatever its
author put into it. Load your own in your own process and hand the model over, as here; never one of a stranger.
"""

import argparse

import gymnasium as gym
import numpy as np
from gymnasium.spaces import flatten_space
from gymnasium.spaces.utils import flatten
from gymnasium.wrappers import FlattenObservation
from rich.console import Console
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import tensegrity_envs  # noqa: F401  (registers)
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.evaluation.results import kind_of
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.reporting.table import print_table, summary_rows, verdict
from tensegrity_envs.seeding import TEST_SEED

ENV = "tensegrity/TwoXReach-v0"


class Flat:
    """A model of flat, normalized observations as a controller of Dict observations."""

    knows = "only what it observes"  # shown in tables

    def __init__(self, model, normalizer, space):
        self.model, self.normalizer, self.space = model, normalizer, space
        assert flatten_space(space) == model.observation_space

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """Actions for a batch of observations."""
        rows = [
            flatten(self.space, {key: value[i] for key, value in observation.items()})
            for i in range(len(observation["observation"]))
        ]
        seen = self.normalizer.normalize_obs(np.stack(rows))
        return self.model.predict(seen, state, episode_start, deterministic)


def train(steps):
    """A model and what normalizes its observations."""
    envs = VecNormalize(DummyVecEnv([lambda: FlattenObservation(gym.make(ENV))] * 8), norm_reward=False)
    model = PPO("MlpPolicy", envs, n_steps=256, batch_size=256, gamma=0.9, seed=0, device="cpu")
    model.learn(steps)
    envs.training = False
    return model, envs


def main(arguments=None):
    """Train, score on the test episodes beside a closed form and a random policy, print who wins."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--episodes", type=int, default=200)
    given = parser.parse_args(arguments)
    print(f"training on {given.steps:,} steps, which takes a while")
    try:
        model, normalizer = train(given.steps)
    except KeyboardInterrupt:
        raise SystemExit("interrupted: nothing was kept") from None
    print("scoring it")
    agent = Flat(model, normalizer, gym.make(ENV).observation_space)
    runs = [evaluate(agent, ENV, given.episodes, TEST_SEED, "plain PPO agent", "agent")]
    for name in ("closed_form_ik", "random"):
        runs.append(evaluate(make_controller(name, ENV), ENV, given.episodes, TEST_SEED, name, kind_of(name)))
    rows = summary_rows(runs)
    print_table(rows, Console())
    print(verdict(rows))
    return rows


if __name__ == "__main__":
    main()
