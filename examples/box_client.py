"""A client that takes one vector at a time and knows of no batches, scored under this package's protocol.

python examples/box_client.py [--episodes 200]

Agents of other libraries, programs behind a socket, a controller in C: whatever maps a vector (a `Box` observation) to
an action. It runs in your process, as it is: the evaluation only calls `predict`, and nothing is unpickled. Here the
client is a few lines of NumPy that remember: it learns the tip's Jacobian while it moves (Broyden's update), and steps
along its inverse. It is told no model at all.
"""

import argparse

import gymnasium as gym
import numpy as np
from gymnasium.spaces.utils import flatten
from rich.console import Console

import tensegrity_envs  # noqa: F401  (registers)
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.evaluation.results import kind_of
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.reporting.table import print_table, summary_rows, verdict
from tensegrity_envs.seeding import TEST_SEED

ENV = "tensegrity/TwoXReach-v0"


class Client:
    """Acts on the vectors of one episode."""

    def __init__(self):
        self.jacobian = self.tip = self.action = None
        self.tries = 0

    def act(self, vector):
        """An action for the flat observation: achieved goal, desired goal, the rest."""
        tip, target = vector[0:2].astype(float), vector[2:4].astype(float)
        if self.tries < 2:  # first it tries both joints, a little
            action = 0.2 * np.eye(2)[self.tries]
        if self.tip is not None:
            moved = tip - self.tip
            if self.tries <= 2:
                columns = np.zeros((2, 2)) if self.jacobian is None else self.jacobian
                columns[:, self.tries - 1] = moved / 0.2
                self.jacobian = columns
            else:
                missed = moved - self.jacobian @ self.action
                self.jacobian += np.outer(missed, self.action) / (self.action @ self.action + 1e-9)
        if self.tries >= 2:
            j = self.jacobian
            action = j.T @ np.linalg.solve(j @ j.T + 1e-6 * np.eye(2), target - tip)
            action *= min(1.0, 0.8 / max(abs(action).max(), 1e-9))
        self.tries, self.tip, self.action = self.tries + 1, tip, action
        return action


class OneByOne:
    """A client of vectors as a controller of batches of Dict observations: one client for each episode."""

    knows = "only what it observes, as one vector"  # shown in tables

    def __init__(self, make, space):
        self.make, self.space = make, space

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """Actions for a batch of observations, and the clients as what is remembered."""
        count = len(observation["observation"])
        clients = [self.make() for _ in range(count)] if state is None else list(state)
        actions = []
        for i in range(count):
            if state is not None and episode_start is not None and episode_start[i]:
                clients[i] = self.make()
            one = {key: value[i] for key, value in observation.items()}
            actions.append(clients[i].act(flatten(self.space, one)))
        return np.clip(np.stack(actions), -1, 1), clients


def main(arguments=None):
    """Score on the test episodes beside two baselines, print who wins."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--episodes", type=int, default=200)
    given = parser.parse_args(arguments)
    mine = OneByOne(Client, gym.make(ENV).observation_space)
    runs = [evaluate(mine, ENV, given.episodes, TEST_SEED, "my client", "baseline")]
    for name in ("pseudo_inverse", "random"):
        runs.append(evaluate(make_controller(name, ENV), ENV, given.episodes, TEST_SEED, name, kind_of(name)))
    rows = summary_rows(runs)
    print_table(rows, Console())
    print(verdict(rows))
    return rows


if __name__ == "__main__":
    main()
