"""Training, policy files, configs, the SB3 adapter and the controllers."""

import json
import os
import signal
import subprocess
import sys
import time
from itertools import cycle
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from script_runs import run
from stable_baselines3 import SAC, HerReplayBuffer
from stable_baselines3.common.vec_env import VecMonitor

import tensegrity_envs
from baseline_runs import columns_of
from tensegrity_agents.config import ConfigError, Experiment, load_experiment
from tensegrity_agents.controllers import baselines_of, make_controller
from tensegrity_agents.evaluation.results import COLUMNS, write_csv
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.sb3.curve import CompleteEpisodes, Evaluations
from tensegrity_agents.sb3.policy_file import PolicyFileError, load_policy
from tensegrity_agents.sb3.training import TrainingError, TrainingInterruptedError, read_curve, train
from tensegrity_agents.sb3.vec_env import VectorEnvAdapter
from tensegrity_envs.seeding import VALIDATION_SEED

# Before any training; SIGINT is ignored where a shell runs the tests in the background.
HANDLERS = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
REACH = "tensegrity/TwoXReach-v0"
ROOT = Path(__file__).parents[2]
SMALL = {
    "env": REACH,
    "train": {
        "total_timesteps": 6144,
        "segment_timesteps": 2048,
        "net_arch": [16],
        "ppo": {"num_envs": 64, "n_steps": 16, "batch_size": 512, "n_epochs": 2},
    },
}


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    folder = tmp_path_factory.mktemp("agent")
    return train(Experiment(**SMALL), 3, folder), folder


def test_adapter_hands_on_what_ppo_needs():
    """Terminal observations, time limits apart from failures, episode statistics; equal to the vector environment
    below.
    """
    envs = VecMonitor(
        VectorEnvAdapter(gym.make_vec(REACH, 16, vectorization_mode="vector_entry_point", autoreset_mode="SameStep"))
    )
    twin = gym.make_vec(REACH, 16, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    envs.seed(5)
    observation = envs.reset()
    expected, _ = twin.reset(seed=5)
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(130):
        for key, value in expected.items():
            np.testing.assert_array_equal(observation[key], value)
        action = np.sign(rng.uniform(-1, 1, (16, 2))).astype(np.float32) * (rng.random((16, 1)) < 0.5)
        observation, reward, done, infos = envs.step(action)
        expected, twin_reward, terminated, truncated, info = twin.step(action)
        np.testing.assert_allclose(reward, twin_reward, rtol=1e-6)
        np.testing.assert_array_equal(done, terminated | truncated)
        for i in np.flatnonzero(done):
            assert infos[i]["TimeLimit.truncated"] == bool(truncated[i] and not terminated[i])
            np.testing.assert_array_equal(
                infos[i]["terminal_observation"]["observation"], info["final_obs"][i]["observation"]
            )
            assert infos[i]["is_success"] == info["final_info"]["is_success"][i]
            assert infos[i]["episode"]["l"] == info["final_info"]["step"][i]
            seen.add(infos[i]["TimeLimit.truncated"])
    assert seen == {True, False}
    with pytest.raises(ValueError, match="SAME_STEP"):
        VectorEnvAdapter(gym.make_vec("CartPole-v1", 2, vectorization_mode="sync"))


def test_failed_episodes_are_begun_again():
    """The same episode, in about the given share of cases; what succeeded is followed by the next one."""
    envs = VectorEnvAdapter.make("tensegrity/TwoXReach-v0", 64, repeat_failed=0.75, max_episode_steps=30)
    planner = make_controller("closed_form_ik", "tensegrity/TwoXReach-v0")
    envs.seed(3)
    seen, state, start = envs.reset(), None, np.ones(64, bool)
    half = np.arange(64) < 32  # which the planner drives
    again = {True: [], False: []}
    rng = np.random.default_rng(0)
    for _ in range(200):
        before, goals = envs.shell.episode_numbers, seen["desired_goal"].copy()
        planned, state = planner.predict(seen, state, start, True)
        actions = np.where(half[:, None], planned, rng.uniform(-1, 1, planned.shape)).astype(np.float32)
        seen, _, start, infos = envs.step(actions)
        after = envs.shell.episode_numbers
        np.testing.assert_array_equal(after[~start], before[~start])
        for i in np.flatnonzero(start):
            repeated = after[i] == before[i]
            assert repeated or after[i] == before[i] + 1
            assert np.array_equal(seen["desired_goal"][i], goals[i]) == repeated
            again[bool(infos[i]["is_success"])].append(repeated)
    assert len(again[True]) > 20
    assert not any(again[True])
    assert len(again[False]) > 200
    assert 0.65 < np.mean(again[False]) < 0.85


def test_a_policy_survives_its_file(trained):
    policy, folder = trained
    loaded = load_policy(folder, REACH)
    envs = gym.make_vec(REACH, 32, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    observation, _ = envs.reset(seed=0)
    np.testing.assert_array_equal(policy.predict(observation)[0], loaded.predict(observation)[0])
    assert loaded.description["seed"] == 3
    curve = read_curve(folder / "progress.csv")
    assert all(len(values) == len(curve["seconds"]) for values in curve.values())


def test_unusable_policy_files_are_explained(trained, tmp_path):
    _, folder = trained
    weights, description = (
        (folder / "policy.safetensors").read_bytes(),
        json.loads((folder / "policy.json").read_text()),
    )

    def attempt(data, text, match, env_id=None):
        (tmp_path / "policy.safetensors").write_bytes(data)
        (tmp_path / "policy.json").write_text(text)
        with pytest.raises(PolicyFileError, match=match):
            load_policy(tmp_path, env_id)

    import hashlib

    good = json.dumps(description)
    attempt(weights[:-10], good, "truncated")
    attempt(weights, "{", "not a description")
    attempt(weights, json.dumps({"a": 1}), "not a description")
    attempt(weights, json.dumps(description | {"algorithm": "dqn"}), "dqn")
    attempt(weights, json.dumps(description | {"net_arch": [17]}), "do not fit")
    attempt(weights, json.dumps(description | {"env": "tensegrity/Nothing-v0"}), "no policy can be made")
    attempt(weights, good, "does not fit", "tensegrity/TwoXPayloadReach-v0")
    pickled = b"\x80\x04\x95\x10\x00\x00\x00\x00\x00\x00\x00\x8c\x02os\x94\x8c\x06system\x94\x93\x94."
    attempt(
        pickled, json.dumps(description | {"sha256": hashlib.sha256(pickled).hexdigest()}), "not a safetensors file"
    )
    (tmp_path / "policy.json").unlink()
    with pytest.raises(PolicyFileError, match=r"policy\.json"):
        load_policy(tmp_path)


@settings(max_examples=30, deadline=None)
@given(cut=st.integers(0, 4000), flip=st.integers(0, 255))
def test_damaged_policy_files_never_load(trained, tmp_path_factory, cut, flip):
    _, folder = trained
    home = tmp_path_factory.mktemp("damaged")
    data = bytearray((folder / "policy.safetensors").read_bytes())
    data[cut % len(data)] ^= flip or 1
    (home / "policy.safetensors").write_bytes(bytes(data))
    (home / "policy.json").write_bytes((folder / "policy.json").read_bytes())
    with pytest.raises(PolicyFileError):
        load_policy(home)


def parameters(policy):
    return torch.cat([value.flatten() for value in policy.policy.state_dict().values()])


def test_a_killed_training_goes_on_to_the_same_policy(trained, tmp_path):
    """Killed with SIGKILL after its first checkpoint, started again: the same parameters as the uninterrupted one,
    bit for bit.
    """
    policy, _ = trained
    (tmp_path / "small.json").write_text(json.dumps(SMALL))
    code = (
        "import json, sys; from pathlib import Path; from tensegrity_agents.config import Experiment; "
        "from tensegrity_agents.sb3.training import train\n"
        f"if __name__ == '__main__': "
        f"train(Experiment(**json.loads(Path({str(tmp_path / 'small.json')!r}).read_text())), "
        f"3, Path({str(tmp_path / 'run')!r}))"
    )
    process = subprocess.Popen([sys.executable, "-c", code])
    checkpoint = tmp_path / "run" / "checkpoint.pt"
    for _ in range(1200):
        if checkpoint.exists() or process.poll() is not None:
            break
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert checkpoint.exists()
    assert torch.load(checkpoint, weights_only=True)["num_timesteps"] <= 6144
    resumed = train(Experiment(**SMALL), 3, tmp_path / "run")
    assert torch.equal(parameters(resumed), parameters(policy))
    np.testing.assert_array_equal(resumed.normalization.mean, policy.normalization.mean)
    other = SMALL | {"train": SMALL["train"] | {"net_arch": [8]}}
    with pytest.raises(TrainingError, match="net_arch"):
        train(Experiment(**other), 3, tmp_path / "run")


VARIANTS = {
    "plain": SMALL,
    "one segment": SMALL | {"train": SMALL["train"] | {"segment_timesteps": 500_000}},
    "dynamic": {
        "env": "tensegrity/DualTriangleReachMuJoCo-v0",
        "train": SMALL["train"]
        | {"total_timesteps": 1024, "segment_timesteps": 768, "ppo": SMALL["train"]["ppo"] | {"num_envs": 16}},
    },
    "recurrent": SMALL
    | {
        "train": SMALL["train"]
        | {
            "algorithm": "recurrent_ppo",
            "total_timesteps": 2048,
            "segment_timesteps": 1536,
            "lstm_hidden_size": 8,
            "ppo": SMALL["train"]["ppo"] | {"num_envs": 16},
        },
    },
    "hints": {
        "env": "tensegrity/PlanarFourBarLoadedReach-v0",
        "train": SMALL["train"] | {"total_timesteps": 4096, "segment_timesteps": 500_000, "model_hints": True},
    },
    "taught": SMALL
    | {
        "train": SMALL["train"]
        | {
            "segment_timesteps": 500_000,
            "history": 2,
            "repeat_failed": 0.5,
            "teacher": {
                "timesteps": 3072,
                "n_steps": 8,
                "gradient_steps": 4,
                "batch_size": 64,
                "buffer_size": 2000,
                "plan_every": 3,
                "careful_below": 0.2,
            },
            "ppo": SMALL["train"]["ppo"] | {"log_std_end": -1.5, "value_rollouts": 1},
        },
        "randomization": {"actuation_delay": [0, 2], "tip_noise": 0.001},
    },
    "told": {
        "env": "tensegrity/DualTriangleLoadedReach-v0",
        "train": SMALL["train"] | {"segment_timesteps": 500_000, "history": 1, "privileged": {"identify": 0.5}},
    },
    "corrected": {
        "env": "tensegrity/DualTriangleLoadedReachUncertain-v0",
        "train": SMALL["train"]
        | {
            "segment_timesteps": 500_000,
            "history": 1,
            "corrects": {"controller": "identifying_observer", "by": 1.0},
            "ppo": SMALL["train"]["ppo"] | {"value_rollouts": 1},
        },
    },
    "randomized": SMALL
    | {"randomization": {"stiffness": [0.9, 1.1], "actuation_delay": [0, 2], "tip_noise": 0.001}, "tolerance": 0.02},
}


@pytest.mark.parametrize(
    ("variant", "number"),
    # Which signal it was matters to none of them: both of the first, then in turn.
    [("plain", signal.SIGTERM), *zip(VARIANTS, cycle((signal.SIGINT, signal.SIGTERM)))],
    ids=lambda value: getattr(value, "name", value),
)
def test_an_interrupted_training_goes_on_to_the_same_policy_from_any_rollout(variant, number, tmp_path, monkeypatch):
    """Interrupted after each of its rollouts, whose number falls into segments or not: the same policy to the bit."""
    experiment = Experiment(**VARIANTS[variant])
    whole = train(experiment, 3, tmp_path / "whole")
    steps = 0
    adapter_step = VectorEnvAdapter.step_wait

    def step_wait(self):
        nonlocal steps
        steps += 1
        if steps % 16 == 7:  # in the middle of a rollout
            os.kill(os.getpid(), number)
        return adapter_step(self)

    monkeypatch.setattr(VectorEnvAdapter, "step_wait", step_wait)
    interrupts = 0
    done = []
    while True:
        try:
            agent = train(experiment, 3, tmp_path / "parts")
            break
        except TrainingInterruptedError as error:
            interrupts += 1
            done.append(error.timesteps)
            assert error.number == number
    assert interrupts >= 3
    assert done == sorted(set(done))
    assert torch.equal(parameters(agent), parameters(whole))
    np.testing.assert_array_equal(agent.normalization.mean, whole.normalization.mean)
    np.testing.assert_array_equal(agent.normalization.variance, whole.normalization.variance)
    curves = [read_curve(tmp_path / run / "evaluation.csv") for run in ("whole", "parts")]
    for name in ("timesteps", "success", "return", "length"):
        np.testing.assert_array_equal(*(curve[name] for curve in curves))


def test_an_interrupt_during_the_last_rollout_loses_nothing(trained, tmp_path, monkeypatch):
    """The training then ends as if nothing had happened."""
    policy, _ = trained
    adapter_step, steps = VectorEnvAdapter.step_wait, 0

    def step_wait(self):
        nonlocal steps
        steps += 1
        if steps == 6144 // 64:
            os.kill(os.getpid(), signal.SIGINT)
        return adapter_step(self)

    monkeypatch.setattr(VectorEnvAdapter, "step_wait", step_wait)
    assert torch.equal(parameters(train(Experiment(**SMALL), 3, tmp_path)), parameters(policy))


def test_a_second_interrupt_acts_at_once_and_checkpoints_by_time_remain(trained, tmp_path, monkeypatch):
    policy, _ = trained
    adapter_step, steps = VectorEnvAdapter.step_wait, 0

    def step_wait(self):
        nonlocal steps
        steps += 1
        if steps in (40, 41):
            os.kill(os.getpid(), signal.SIGINT)
        return adapter_step(self)

    with monkeypatch.context() as patch:
        patch.setattr(VectorEnvAdapter, "step_wait", step_wait)
        with pytest.raises(KeyboardInterrupt):
            train(Experiment(**SMALL), 3, tmp_path, checkpoint_seconds=0.0)
    assert torch.load(tmp_path / "checkpoint.pt", weights_only=True)["num_timesteps"] == 2 * 16 * 64
    assert torch.equal(parameters(train(Experiment(**SMALL), 3, tmp_path)), parameters(policy))


def test_evaluations_and_checkpoints_do_not_change_the_training(trained, tmp_path, monkeypatch):
    policy, _ = trained
    monkeypatch.setattr(Evaluations, "is_due", lambda *_: False)
    monkeypatch.setattr(Evaluations, "__call__", lambda *_: [0.0] * 5)
    bare = train(Experiment(**SMALL), 3, tmp_path, checkpoint_seconds=1e9)
    assert torch.equal(parameters(bare), parameters(policy))
    np.testing.assert_array_equal(bare.normalization.mean, policy.normalization.mean)


def test_signals_are_handled_as_before_after_a_training(trained):
    assert {number: signal.getsignal(number) for number in HANDLERS} == HANDLERS


def test_the_learning_curve_counts_complete_episodes_alike():
    """A made-up process: half of the episodes fail in their first steps. Resets of all environments, after which these
    end first, do not show in the curve; a mean over the latest ends would fall there.
    """
    rng = np.random.default_rng(0)
    count, limit = 200, 50
    curve = CompleteEpisodes(count, limit, is_staggered=True)
    naive, seen, worst = [], [], []
    for segment in range(4):
        curve.reset()
        end = np.minimum(np.where(rng.random(count) < 0.5, 3, limit), np.arange(count) * limit // count + 1)
        age = np.zeros(count, int)
        for step in range(400):
            age += 1
            done = age >= end
            infos = [{"episode": {"r": float(n), "l": float(n)}, "is_success": n == limit} for n in age]
            curve.add(done, infos)
            naive += age[done].tolist()
            if segment and step < 100:
                worst.append(np.mean(naive[-count:]))
            if (means := curve.means()) is not None and segment:
                seen.append(means)
            end[done] = np.where(rng.random(done.sum()) < 0.5, 3, limit)
            age[done] = 0
    seen = np.array(seen)
    assert np.abs(seen[:, 0] - 0.5).max() < 0.17  # 200 episodes: four standard deviations are 0.14
    assert abs(seen[:, 0].mean() - 0.5) < 0.02
    np.testing.assert_allclose(seen[:, 1], 3 + (limit - 3) * seen[:, 0])
    assert min(worst) < 12 < seen[:, 1].min()


def test_the_curve_without_noise_is_that_of_the_policy(trained):
    """Its last point is what `evaluate` finds on the same validation episodes."""
    policy, folder = trained
    curve = read_curve(folder / "evaluation.csv")
    assert (np.diff(curve["timesteps"]) > 0).all()
    assert curve["timesteps"][0] == 0
    assert curve["timesteps"][-1] == 6144
    run = evaluate(policy, REACH, 20, VALIDATION_SEED, "agent")
    assert curve["success"][-1] == run.columns["success"].mean()
    assert curve["return"][-1] == run.columns["return"].mean()


ALGORITHMS = {
    "recurrent_ppo": {"ppo": {"num_envs": 4, "n_steps": 16, "batch_size": 32, "n_epochs": 2}, "lstm_hidden_size": 8},
    "sac": {"env_options": {"reward_type": "sparse"}, "off_policy": {"learning_starts": 150, "batch_size": 32}},
    "tqc": {"env_options": {"reward_type": "sparse"}, "off_policy": {"learning_starts": 150, "batch_size": 32}},
    "td3": {"off_policy": {"learning_starts": 220, "batch_size": 32, "num_envs": 2}},
    "crossq": {"off_policy": {"learning_starts": 50, "batch_size": 32, "num_envs": 4, "her": False}},
}


@pytest.mark.parametrize("algorithm", list(ALGORITHMS))
def test_every_algorithm_trains_and_its_policy_is_stored(algorithm, tmp_path):
    """The stored policy does what the trained one does, also over an episode and with a history."""
    settings = {"algorithm": algorithm, "total_timesteps": 300, "segment_timesteps": 200, "net_arch": [16]}
    experiment = Experiment(env=REACH, train=settings | ALGORITHMS[algorithm] | {"history": 1})
    policy = train(experiment, 0, tmp_path)
    loaded = load_policy(tmp_path, REACH)
    env = gym.make(REACH)
    observation, _ = env.reset(seed=0)
    states = [None, None]
    for _ in range(5):
        actions = []
        for k, agent in enumerate((policy, loaded)):
            action, states[k] = agent.predict(observation, states[k], np.array([states[k] is None]))
            actions.append(action)
        assert actions[0].shape == (2,)
        np.testing.assert_array_equal(*actions)
        observation, *_ = env.step(actions[0])


def test_every_algorithm_of_a_config_is_there():
    """Beside PPO, which most tests train, each has a model, a policy class and a row in the test above."""
    from typing import get_args

    from tensegrity_agents.config import TrainConfig
    from tensegrity_agents.sb3.algorithms import _MODELS
    from tensegrity_agents.sb3.policy_file import POLICIES

    names = set(get_args(TrainConfig.model_fields["algorithm"].annotation))
    assert names == set(_MODELS) == set(POLICIES) == {"ppo", *ALGORITHMS}


def test_crossq_sees_what_the_others_see():
    """Its flat observation is what the features extractor of the others makes of theirs."""
    from tensegrity_agents.sb3.features import GoalErrorExtractor
    from tensegrity_agents.sb3.flat import Flattening

    env = gym.make(REACH)
    extractor = GoalErrorExtractor(env.observation_space, (0.5, 0.1), 0.3)
    observation, _ = env.reset(seed=3)
    flat = Flattening(extractor)(observation)
    error = observation["desired_goal"] - observation["achieved_goal"]
    by_hand = [
        observation["observation"],
        observation["desired_goal"] / 0.3,
        np.tanh(error / 0.5),
        np.tanh(error / 0.1),
    ]
    np.testing.assert_allclose(flat, np.concatenate(by_hand), rtol=1e-6)
    assert flat.shape == Flattening(extractor).space.shape


def test_hindsight_relabels_with_the_dense_reward_too():
    env = gym.make(REACH)
    kwargs = {"n_sampled_goal": 4, "goal_selection_strategy": "future", "copy_info_dict": True}
    model = SAC(
        "MultiInputPolicy",
        env,
        replay_buffer_class=HerReplayBuffer,
        replay_buffer_kwargs=kwargs,
        learning_starts=200,
        batch_size=64,
    )
    model.learn(210)
    data = model.replay_buffer.sample(256)
    assert torch.isfinite(data.rewards).all()
    assert (data.rewards >= 0).all()
    assert float(data.rewards.max()) > 0.9  # relabelled goals are reached


@pytest.mark.parametrize(
    ("env_id", "name"), [(env_id, name) for env_id in tensegrity_envs.ENV_IDS for name in baselines_of(env_id)]
)
def test_every_baseline_runs_on_every_environment(env_id, name):
    columns = columns_of(env_id, name)
    assert set(columns) == set(COLUMNS)
    success = columns["success"].mean()
    if name == "random":
        assert success < 0.1
    elif "Uncertain" in env_id:
        assert success <= 1.0  # nominal controllers fail there; how much is what tables tell
    elif "Obstacle" in env_id:
        assert success >= {"planner": 0.95, "pseudo_inverse": 0.15}.get(name, 0.0)  # those that take no notice collide
    elif "Push" in env_id:
        assert success >= {"closed_form": 0.0, "pseudo_inverse": 0.7}.get(name, 1.0)
    elif "DualTriangle" in env_id:
        weak = {"closed_form_plan": 0.0}  # at full speed and without feedback the arm swings
        if "Loaded" in env_id:
            weak = {"pseudo_inverse": 0.6, "observer": 0.95, "lqg": 0.975, "oracle": 0.975}
        assert success >= weak.get(name, 0.0 if "Loaded" in env_id else 0.975)
    elif "ThreeX" in env_id and "MuJoCo" in env_id:
        # Where nothing is fed back, the arm falls into other equilibria: docs/n_x.md.
        assert success >= {"pseudo_inverse": 0.0, "closed_form_plan": 0.0, "lqr": 0.8}.get(name, 0.95)
    elif "MuJoCo" in env_id and name == "closed_form_ik":
        assert success >= 0.85  # at full speed the mechanism still swings at the end
    elif name == "oracle" or (
        "Payload" not in env_id and "Loaded" not in env_id and name in ("closed_form_ik", "observer")
    ):
        assert success >= 0.95
    elif name == "observer":
        assert success >= 0.9
    assert not np.isnan(columns["final_error_m"]).any()


def test_the_observer_finds_the_payload():
    from tensegrity_agents.controllers.two_x.measurements import estimate_payload
    from tensegrity_envs.mechanics import TwoX

    envs = gym.make_vec(
        "tensegrity/TwoXPayloadReach-v0", 200, vectorization_mode="vector_entry_point", autoreset_mode="SameStep"
    )
    observation, info = envs.reset(seed=0)
    estimate = estimate_payload(TwoX(envs.unwrapped.design), envs.unwrapped.core.schema.decode(observation))
    right = np.abs(estimate.payload - info["payload"]) < 1e-3
    assert right.mean() >= 0.98
    np.testing.assert_allclose(estimate.configuration[right], info["configuration"][right], atol=1e-4)


def test_batches_of_the_evaluation_do_not_matter(tmp_path):
    whole = evaluate(make_controller("closed_form_ik", REACH), REACH, 30, VALIDATION_SEED, "ik")
    parts = evaluate(make_controller("closed_form_ik", REACH), REACH, 30, VALIDATION_SEED, "ik", batch=7)
    for key in COLUMNS:
        np.testing.assert_allclose(whole.columns[key], parts.columns[key], atol=1e-9)
    write_csv([whole], tmp_path / "episodes.csv")
    assert len((tmp_path / "episodes.csv").read_text().splitlines()) == 31


def test_a_controller_of_ones_own(tmp_path, monkeypatch):
    (tmp_path / "my_controllers.py").write_text(
        "import numpy as np\nclass Still:\n"
        "    def predict(self, observation, state=None, episode_start=None, deterministic=True):\n"
        "        return np.zeros((len(observation['achieved_goal']), 2)), None\nclass Broken: pass\n"
    )
    monkeypatch.chdir(tmp_path)
    run = evaluate(make_controller("my_controllers:Still", REACH), REACH, 5, VALIDATION_SEED, "still")
    assert (run.columns["steps"] == 100).all()
    for name, match in (
        ("closed_form", "closed_form_ik"),
        ("my_controllers:Stil", "Still"),
        ("nothing:X", "nothing"),
        ("my_controllers:Broken", "predict"),
    ):
        with pytest.raises(ValueError, match=match):
            make_controller(name, REACH)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("env: tensegrity/TwoXReach-v0\ntrain: {total_timestep: 5}", "total_timesteps"),
        ("env: tensegrity/TwoXReech-v0\ntrain: {total_timesteps: 5}", "did you mean TwoXReach-v0"),
        ("env: TwoXReach-v0\ntrain: {total_timesteps: lots}", "train.total_timesteps"),
        ("env: TwoXReach-v0\ntrain: {total_timesteps: 5, ppo: {gama: 0.9}}", "'gamma'"),
        ("env: TwoXReach-v0\ntrain: {total_timesteps: 5, ppo: {gamma: .nan}}", "gamma"),
        ("env: TwoXReach-v0\ntrain: {total_timesteps: 5, algorithm: sac, repeat_failed: 0.5}", "repeat_failed: needs"),
        ("env: TwoXReach-v0\nseeds: [0, 0]\ntrain: {total_timesteps: 5}", "seeds"),
        ("env: TwoXReach-v0\ncontrollers: [ik]\ntrain: {total_timesteps: 5}", "closed_form_ik"),
        ("env: TwoXReach-v0\ntrain: {total_timesteps: 5, env_options: {reward: 1}}", "reward"),
        ("env: [", "not valid YAML"),
        ("- 1", "keys and values"),
    ],
)
def test_config_errors_say_what_would_work(tmp_path, text, match):
    path = tmp_path / "config.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=match):
        load_experiment(path)
    with pytest.raises(ConfigError, match=r"config\.yaml"):
        load_experiment(tmp_path / "other.yaml")


@pytest.mark.parametrize("path", sorted((ROOT / "configs").glob("*.yaml")), ids=lambda p: p.name)
def test_shipped_configs_are_valid(path):
    load_experiment(path)


def test_a_script_is_a_program():
    command = [sys.executable, str(ROOT / "scripts" / "train.py"), "--help"]
    assert "--config" in subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT).stdout


@pytest.mark.parametrize("script", ["train", "evaluate", "compare", "benchmark", "tune"])
def test_scripts_teach_and_refuse(script):
    """--help names what the script does; a misspelt option or environment is answered with what exists."""
    code, shown = run(script, "--help")
    assert (code, "--" in shown) == (0, True)
    code, _ = run(script, "--confg", "x")
    assert code == 2
    if script in ("evaluate", "compare", "train", "tune"):
        code, told = run(script, "--env", "TwoXRech-v0")
        assert code == 2
        assert "TwoXReach-v0" in told
        assert "Traceback" not in told


def test_every_environment_has_a_config_that_compares_the_agent_with_all_its_baselines():
    experiments = [load_experiment(path) for path in Path("configs").glob("*.yaml")]
    assert {experiment.env for experiment in experiments} == set(tensegrity_envs.ENV_IDS)
    for experiment in experiments:
        assert experiment.compared == list(baselines_of(experiment.env))
        assert "random" in experiment.compared
