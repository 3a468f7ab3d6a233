"""What training alone is told: the right numbers, seen by nobody who acts, and learned from."""

import gymnasium as gym
import numpy as np
import pytest
import torch

from tensegrity_agents.config import ConfigError, Experiment
from tensegrity_agents.sb3.algorithms import make_environment, make_model
from tensegrity_agents.sb3.levels import LevelsVecEnv
from tensegrity_agents.sb3.policy_file import load_policy
from tensegrity_agents.sb3.privileged import PRIVILEGED, PrivilegedVecEnv
from tensegrity_agents.sb3.training import train
from tensegrity_agents.sb3.vec_env import VectorEnvAdapter

ENV = "tensegrity/DualTriangleLoadedReachUncertain-v0"
SETTINGS = {
    "total_timesteps": 2048,
    "net_arch": [16],
    "history": 1,
    "privileged": {"identify": 0.5},
    "ppo": {"num_envs": 32, "n_steps": 16, "batch_size": 128, "n_epochs": 2},
}


@pytest.mark.parametrize("levels", [None, [0, 2]])
def test_the_load_the_draws_and_the_true_state_are_told(levels):
    inner = VectorEnvAdapter.make(ENV, 6) if levels is None else LevelsVecEnv.make(ENV, 6, levels)
    env = PrivilegedVecEnv(inner)
    env.seed(3)
    told: dict = env.reset()
    ends, rng = 0, np.random.default_rng(0)
    for _ in range(130):
        before = told[PRIVILEGED]
        told, _, dones, infos = env.step(rng.uniform(-1, 1, (6, 3)).astype(np.float32))
        assert told[PRIVILEGED].shape == (6, *env.observation_space[PRIVILEGED].shape)
        for i in np.flatnonzero(dones):
            ends += 1
            last = infos[i]["terminal_observation"][PRIVILEGED]
            np.testing.assert_array_equal(last, before[i])
            own = dict(zip(env.told.names, last, strict=False))
            np.testing.assert_array_equal([own["load.0"], own["load.1"]], np.float32(infos[i]["load"]))
            assert own["stiffness"] == np.float32(infos[i].get("random_stiffness", 1.0))
            assert own["actuation_delay"] == infos[i].get("random_actuation_delay", 0)
            assert own["design.k1"] == pytest.approx(500.0 * own["stiffness"], rel=1e-6)
            assert not any("noise" in name for name in own)
    assert ends > 3


@pytest.mark.parametrize("env_id", [id for id in sorted(gym.registry) if id.startswith("tensegrity/")])
def test_what_is_told_differs_between_episodes_on_every_id(env_id):
    """Rows, not integers of a design such as its number of joints; only a load may be zero in all episodes."""
    env = PrivilegedVecEnv(VectorEnvAdapter.make(env_id, 8))
    env.seed(1)
    told: dict = env.reset()
    drawn = told[PRIVILEGED][:, : len(env.told.names)]
    assert np.isfinite(told[PRIVILEGED]).all()
    for name, values in zip(env.told.names, drawn.T, strict=True):
        assert len(set(values)) > 1 or (name.startswith("load") and not values.any()), name


def test_states_are_those_of_the_columns():
    env = PrivilegedVecEnv(VectorEnvAdapter.make(ENV, 4))
    env.seed(0)
    told: dict = env.reset()
    shell = env.shell
    true = shell.matrices[1][list(shell.core.outcomes.rows.state.configuration)].T
    at = len(env.told.names)
    np.testing.assert_array_equal(told[PRIVILEGED][:, at : at + 3], true.astype(np.float32))


def test_what_is_saved_acts_as_what_was_trained_and_is_told_nothing(tmp_path):
    experiment = Experiment(env=ENV, train=SETTINGS)
    agent = train(experiment, 0, tmp_path / "agent")
    loaded = load_policy(tmp_path / "agent", ENV)
    env = make_environment(experiment)
    model = make_model(experiment, env, 0)
    assert set(loaded.policy.observation_space.spaces) == set(env.observation_space.spaces) - {PRIVILEGED}
    observation = {key: space.sample()[None] for key, space in loaded.policy.observation_space.spaces.items()}
    np.testing.assert_array_equal(
        *(p.predict(observation, deterministic=True)[0] for p in (loaded.policy, agent.policy))
    )
    # The actor of a policy in training does not depend on what it is told.
    seen = {key: torch.as_tensor(value) for key, value in observation.items()}
    size = env.observation_space[PRIVILEGED].shape
    one, two = (
        model.policy.get_distribution(seen | {PRIVILEGED: torch.full((1, *size), fill)}).mode() for fill in (0.0, 5.0)
    )
    assert torch.equal(one, two)
    values = [model.policy.predict_values(seen | {PRIVILEGED: torch.full((1, *size), fill)}) for fill in (0.0, 5.0)]
    assert not torch.equal(*values)


def test_the_estimate_gets_better():
    """In a linear layer's reach: the error falls by half within a few rollouts."""
    experiment = Experiment(env=ENV, train=SETTINGS | {"net_arch": [64], "total_timesteps": 30_000})
    env = make_environment(experiment)
    model = make_model(experiment, env, 0)
    errors = []

    def error(self) -> None:
        batch = next(self.rollout_buffer.get(512))
        with torch.no_grad():
            errors.append(-float(self.policy.evaluate_actions(batch.observations, batch.actions)[2].mean()))

    learn = type(model).train

    def looked_at(self) -> None:
        error(self)
        learn(self)

    model.train = looked_at.__get__(model)
    model.learn(20_000)
    assert np.mean(errors[-3:]) < 0.5 * np.mean(errors[:3])


@pytest.mark.parametrize("changes", [{"algorithm": "recurrent_ppo"}, {"ppo": SETTINGS["ppo"] | {"ent_coef": 0.01}}])
def test_what_does_not_go_with_it_is_refused(changes):
    with pytest.raises((ConfigError, ValueError), match="privileged"):
        Experiment(env=ENV, train=SETTINGS | changes)
