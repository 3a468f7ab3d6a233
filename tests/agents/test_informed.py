"""The informed controller of the uncertain and the fast ids: it is told everything, and uses nothing that is noisy."""

import gymnasium as gym
import numpy as np
import pytest

import tensegrity_envs
from baseline_runs import success_of
from tensegrity_agents.controllers import baselines_of, make_controller
from tensegrity_agents.evaluation.results import kind_of
from tensegrity_agents.evaluation.rollout import begin_episodes

IDS = [env_id for env_id in tensegrity_envs.ENV_IDS if "informed" in baselines_of(env_id)]
every_id = pytest.mark.parametrize("env_id", IDS)


@every_id
def test_who_knows_everything_hardly_fails(env_id):
    if "MuJoCo" in env_id:
        pytest.importorskip("mujoco")
    options = {} if gym.spec(env_id).kwargs.get("level") == 2 else {"level": 2}
    other = "oracle" if "oracle" in baselines_of(env_id) else "closed_form_ramp"  # of the 4-bar without a load
    told, not_told = (success_of(env_id, name, **options) for name in ("informed", other))
    assert told >= 0.95 > not_told + 0.3
    assert kind_of("informed") == "oracle"  # no baseline that others could be asked to beat


@pytest.mark.parametrize("env_id", [env_id for env_id in IDS if "MuJoCo" not in env_id])
def test_it_does_not_see_the_noise(env_id):
    """Another noise of the sensors does not change what it does, but another arm would."""
    envs = gym.make_vec(env_id, 5, vectorization_mode="vector_entry_point")
    observation, _ = envs.reset(seed=0)
    controller = make_controller("informed", env_id)
    given = []
    for shift in (0.0, 5e-4):
        begin_episodes(controller, envs.unwrapped, 5)
        noisy = observation | {"achieved_goal": observation["achieved_goal"] + np.float32(shift)}
        actions, state = controller.predict(noisy)
        again, _ = controller.predict(noisy, state, np.zeros(5, bool))
        given.append(np.stack([actions, again]))
    np.testing.assert_allclose(given[0], given[1], atol=1e-5)
    with pytest.raises(ValueError, match="needs the privileged episodes"):
        make_controller("informed", env_id).predict(observation)


def test_it_is_there_where_something_is_uncertain():
    known = {env_id for env_id in tensegrity_envs.ENV_IDS if "Uncertain" in env_id or "Fast" in env_id}
    assert known == set(IDS)
