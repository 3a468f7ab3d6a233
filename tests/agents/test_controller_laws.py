"""Laws of every analytic controller on every environment."""

import gymnasium as gym
import numpy as np
import pytest

import law_rows
import tensegrity_envs
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.controllers.base import AnalyticController
from tensegrity_envs.compiler.pytree import is_array, tree_leaves

COUNT = 4
CASES = law_rows.controllers(tensegrity_envs.ENV_IDS)


def flat(memory):
    return [np.array(leaf) for leaf in tree_leaves(memory, is_array)]


@pytest.mark.parametrize(("env_id", "name"), CASES)
def test_all_that_a_controller_remembers_of_an_episode_is_in_its_memory(env_id, name):
    """Memories are rows of arrays and never written to; an episode that begins later goes as one that begins first."""
    if gym.spec(env_id).kwargs.get("backend") == "mujoco":
        pytest.importorskip("mujoco")
    envs = gym.make_vec(env_id, COUNT, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    controller = make_controller(name, env_id)
    assert isinstance(controller, AnalyticController)
    observation, _ = envs.reset(seed=5)
    truth = envs.unwrapped.episode if controller.wants_privileged else None

    def begin():
        controller.begin_episodes(np.ones(COUNT, bool), envs.unwrapped.design, truth)

    begin()
    first, memory = controller.predict(observation)
    before = flat(memory)
    assert all(len(leaf) == COUNT for leaf in before)
    again, later = controller.predict(observation, memory, np.zeros(COUNT, bool))
    for old, now in zip(before, flat(memory), strict=True):
        assert all(np.array_equal(a, b, equal_nan=old.dtype.kind == "f") for a, b in zip(old, now, strict=True))
    begins = np.array([True, False, True, False])
    mixed, _ = controller.predict(observation, later, begins)
    np.testing.assert_allclose(mixed[begins], first[begins], atol=1e-9)
    repeated, _ = controller.predict(observation, memory, np.zeros(COUNT, bool))
    np.testing.assert_allclose(repeated, again, atol=1e-12)
    begin()
    np.testing.assert_array_equal(controller.predict(observation)[0], first)
    envs.close()
