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
def run_of(env_id, name, **options):
    """The first validation episodes of a baseline: 40; 6 of the simulated prism, where each takes long."""
    episodes = 6 if "PrismTrackMuJoCo" in env_id else 40
    controller = make_controller(name, env_id, options)
    return evaluate(controller, env_id, episodes, VALIDATION_SEED, name, env_options=options)


def columns_of(env_id, name, **options):
    """Its numbers by episode, and shares of success."""
    return run_of(env_id, name, **options).columns


def success_of(env_id, name, **options):
    """Its share of success."""
    return columns_of(env_id, name, **options)["success"].mean()
