"""Evaluations that several tests look at: each is run once in a process.

Tests that take one belong to the xdist group of its environment (`of_group`).
"""

from functools import cache

import pytest

from tensegrity_agents.controllers import make_controller
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_envs.seeding import VALIDATION_SEED


def of_group(env_id):
    """The mark of tests that run where those of the environment run."""
    return pytest.mark.xdist_group(env_id.removeprefix("tensegrity/").split("-")[0])


@cache
def columns_of(env_id, name):
    """The first validation episodes of a baseline: 40; 6 of the simulated prism, where each takes long."""
    episodes = 6 if "PrismTrackMuJoCo" in env_id else 40
    return evaluate(make_controller(name, env_id), env_id, episodes, VALIDATION_SEED, name).columns
