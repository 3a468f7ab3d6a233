"""The past in observations, and what teachers show: against episodes written down step by step, and carried out."""

import hashlib
import json

import gymnasium as gym
import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save

from tensegrity_agents.config import ConfigError, Experiment
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.sb3.augmented import AugmentedVecEnv
from tensegrity_agents.sb3.errors import TrainingError
from tensegrity_agents.sb3.history import History
from tensegrity_agents.sb3.policy_file import PolicyFileError, load_policy
from tensegrity_agents.sb3.teacher_student import Lessons, Teacher, driven
from tensegrity_agents.sb3.training import train
from tensegrity_agents.sb3.vec_env import VectorEnvAdapter
from tensegrity_envs.seeding import VALIDATION_SEED
from tensegrity_envs.vector_env import step_info

REACH, TENSION, PAYLOAD = (f"tensegrity/TwoX{name}Reach-v0" for name in ("", "Tension", "Payload"))
UNCERTAIN = {"stiffness": [0.9, 1.1], "tip_noise": 0.001, "actuation_delay": [0, 2]}


def make_vec(env_id, count, **options):
    return gym.make_vec(env_id, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **options)


def expected_past(seen, done, length):
    """What an environment should be told, from the lists of its episode's observations and actions."""
    now = seen[-1]
    told = [now]
    for back in range(1, length + 1):
        told.append(now - (seen[-1 - back] if back < len(seen) else seen[0]))
    for back in range(1, length + 1):
        told.append(done[-back] if back <= len(done) else np.zeros(4, np.float32))
    return np.concatenate([*told, seen[0]])


def test_the_past_is_that_of_the_running_episode():
    """Terminal observations have the past of the episode that ends, first ones have none."""
    history = History(3, 12, 4)
    envs = AugmentedVecEnv(VectorEnvAdapter(make_vec(TENSION, 6, max_episode_steps=7)), history)
    twin = VectorEnvAdapter(make_vec(TENSION, 6, max_episode_steps=7))
    envs.seed(1)
    twin.seed(1)
    told, plain = envs.reset(), twin.reset()
    seen = [[one] for one in plain["observation"]]
    done = [[] for _ in range(6)]
    rng, memory, ends = np.random.default_rng(0), None, 0
    begins = np.ones(6, bool)
    for _ in range(40):
        for i in range(6):
            np.testing.assert_allclose(told["observation"][i], expected_past(seen[i], done[i], 3), atol=1e-6)
        used, memory = history(plain, memory, begins)  # as a controller keeps it
        np.testing.assert_array_equal(used["observation"], told["observation"])
        actions = rng.uniform(-1.3, 1.3, (6, 4)).astype(np.float32)
        memory = history.acted(memory, actions)
        told, _, begins, infos = envs.step(actions)
        plain, _, _, plain_infos = twin.step(actions)
        for i in range(6):
            done[i].append(np.clip(actions[i], -1, 1))
            if begins[i]:
                seen[i].append(plain_infos[i]["terminal_observation"]["observation"])
                last = infos[i]["terminal_observation"]["observation"]
                np.testing.assert_allclose(last, expected_past(seen[i], done[i], 3), atol=1e-6)
                seen[i], done[i] = [], []
                ends += 1
            seen[i].append(plain["observation"][i])
    assert ends > 20


@pytest.mark.parametrize(
    ("env_id", "teacher", "options", "kick"),
    [
        (REACH, "oracle", {}, 0.5),
        (REACH, "oracle", {"randomization": {"actuation_delay": [0, 2], "tip_noise": 0.001}}, 0.1),
        (TENSION, "careful_oracle", {"randomization": UNCERTAIN}, 0.02),
        (PAYLOAD, "careful_oracle", {}, 0.02),
        ("tensegrity/DualTriangleLoadedReach-v0", "oracle", {}, 0.1),
        ("tensegrity/PlanarFourBarLoadedReach-v0", "oracle", {}, 0.1),
    ],
)
def test_what_the_teacher_shows_leads_to_the_target(env_id, teacher, options, kick):
    """Though every fifth action is another one: the path is rejoined, or planned anew."""
    envs = make_vec(env_id, 60, **options)
    envs.reset(seed=VALIDATION_SEED)
    shown = Teacher(teacher, env_id, options, envs.unwrapped, 60, 25)
    begins, running = np.ones(60, bool), np.ones(60, bool)
    success, knew = np.zeros(60, bool), None
    rng = np.random.default_rng(0)
    for step in range(90):
        actions = shown.actions(begins)
        knew = shown.knows_a_way.copy() if knew is None else knew
        disturbed = (rng.random(60) < 0.2) & (step < 40)
        actions = np.where(disturbed[:, None], actions + kick * rng.uniform(-1, 1, actions.shape), actions)
        shown.note(actions)
        _, _, terminated, truncated, info = envs.step(actions)
        success[running] = step_info(info)["is_success"][running].astype(bool)
        begins = terminated | truncated
        running &= ~begins
    assert knew.mean() >= 0.98
    assert success[knew].mean() >= 0.98


def test_steps_are_whole_but_near_the_edge_of_the_stable_set():
    """As long as there is a way to go; else how long a step is would depend on where the points of the path are."""
    env_id, careful = TENSION, 5.0
    envs = make_vec(env_id, 60)
    envs.reset(seed=VALIDATION_SEED)
    bold, cautious = (
        Teacher("careful_oracle", env_id, {}, envs.unwrapped, 60, 25, 1, below) for below in (0.0, careful)
    )
    begins = np.ones(60, bool)
    for _ in range(5):
        whole, short = bold.actions(begins), cautious.actions(begins)
        left = (
            np.abs(bold.path[:, -1] - driven(envs.unwrapped.core, envs.unwrapped.matrices[1])).max(axis=1) / bold.rate
        )
        under_way = bold.knows_a_way & (left > 2.0) & (bold.off < 0.99)
        assert under_way.sum() >= 40
        assert np.abs(whole).max(axis=1)[under_way].min() == pytest.approx(1.0)
        shares = np.clip(bold.margin / careful, 0.25, 1.0)
        np.testing.assert_allclose(short, whole * shares[:, None], atol=1e-12)
        begins = np.zeros(60, bool)
        _, _, terminated, truncated, _ = envs.step(whole)
        assert not (terminated | truncated).any()


def test_those_who_wait_for_a_plan_are_shown_nothing_until_all_are_planned_for():
    env_id, every = "tensegrity/PlanarFourBarReach-v0", 4
    envs = make_vec(env_id, 40)
    envs.reset(seed=VALIDATION_SEED)
    at_once, together = (Teacher("oracle", env_id, {}, envs.unwrapped, 60, 25, turn) for turn in (1, every))
    begins, planned = np.ones(40, bool), []
    own = together._planned
    together._planned = lambda *of: planned.append(step) or own(*of)  # type: ignore[method-assign]
    for step in range(12):
        # None has failed yet: episodes that begin again are made up.
        again = (np.arange(40) % 12 == step) & (step > 0)
        first, second = at_once.actions(begins | again), together.actions(begins | again)
        if step % every == 0:
            assert second[again | begins] == pytest.approx(first[again | begins])
            np.testing.assert_array_equal(together.knows_a_way, at_once.knows_a_way)
        else:
            assert not together.knows_a_way[again].any()
            assert not second[again].any()
        envs.step(first)
        begins = np.zeros(40, bool)
    assert set(planned) <= {0, 4, 8}


def small(**changes):
    teacher = {"timesteps": 2048, "n_steps": 8, "gradient_steps": 8, "batch_size": 128} | changes.pop("teacher", {})
    settings = {
        "total_timesteps": 2048,
        "net_arch": [32],
        "history": 2,
        "teacher": teacher,
        "ppo": {"num_envs": 64, "n_steps": 8},
    }
    return Experiment(env=TENSION, train=settings | changes)


def test_a_taught_agent_is_stored_with_its_past(tmp_path):
    agent = train(small(), 0, tmp_path)
    loaded = load_policy(tmp_path, TENSION)
    runs = [evaluate(one, TENSION, 20, VALIDATION_SEED, "agent") for one in (agent, loaded)]
    for name in ("return", "final_error_m"):
        np.testing.assert_array_equal(runs[0].columns[name], runs[1].columns[name])
    assert agent.description["timesteps"] == 2048
    assert "taught" in loaded.knows
    single, _ = gym.make(TENSION).reset(seed=1)
    action, state = loaded.predict(single)
    assert action.shape == (4,)
    assert loaded.predict(single, state, np.array([False]))[0].shape == (4,)


def test_a_value_function_that_nothing_has_trained_is_not_stored(tmp_path):
    taught, trained = (tmp_path / name for name in ("taught", "trained"))
    train(small(total_timesteps=1024, teacher={"timesteps": 1024}), 0, taught)
    train(small(teacher={"timesteps": 1024}), 0, trained)
    kept = [
        {name for name in load_file(folder / "policy.safetensors") if "value" in name} for folder in (taught, trained)
    ]
    assert not kept[0]
    assert kept[1]
    tensors = load_file(trained / "policy.safetensors")
    with pytest.raises(PolicyFileError, match="do not fit"):
        stored_again(trained, {name: value for name, value in tensors.items() if "value" not in name})
    load_policy(taught, TENSION)


def stored_again(folder, tensors):
    """The policy with other tensors, loaded."""
    data = save(tensors)
    description = json.loads((folder / "policy.json").read_text()) | {"sha256": hashlib.sha256(data).hexdigest()}
    (folder / "policy.safetensors").write_bytes(data)
    (folder / "policy.json").write_text(json.dumps(description))
    return load_policy(folder, TENSION)


def test_only_what_leads_to_the_target_is_learned(tmp_path, monkeypatch):
    """Without a way to any target nothing is, and the policy stays as it was made; with one it changes."""

    def weights(folder):
        policy = train(small(), 0, folder).policy
        return torch.cat([part.flatten() for part in policy.action_net.parameters()])

    taught, planned = weights(tmp_path / "a"), Teacher._planned
    kept = []

    def nowhere(self, episodes, outcomes):
        path, knows = planned(self, episodes, outcomes)
        return path, np.zeros_like(knows)

    store = Lessons._store
    monkeypatch.setattr(Teacher, "_planned", nowhere)
    monkeypatch.setattr(
        Lessons, "_store", lambda self, seen, wanted, index: (kept.append(len(index)), store(self, seen, wanted, index))
    )
    untaught = weights(tmp_path / "b")
    assert sum(kept) == 0
    assert not torch.equal(taught, untaught)
    monkeypatch.undo()
    monkeypatch.setattr(Lessons, "_train", lambda self: None)
    assert torch.equal(untaught, weights(tmp_path / "c"))


@pytest.mark.parametrize(
    ("train", "match"),
    [
        ({"algorithm": "sac", "teacher": {"timesteps": 100}}, "needs algorithm: ppo"),
        ({"teacher": {"timesteps": 2000}}, "at most total_timesteps"),
        ({"teacher": {"timesteps": 100, "controller": "nobody"}}, "there are closed_form_ik.*careful_oracle"),
        ({"teacher": {"timesteps": 100, "controler": "oracle"}}, "did you mean 'controller'"),
    ],
)
def test_teachers_that_do_not_fit_are_explained(train, match, tmp_path):
    from tensegrity_agents.config import load_experiment

    text = {"env": REACH, "train": {"total_timesteps": 1000} | train}
    (tmp_path / "config.yaml").write_text(__import__("yaml").safe_dump(text))
    with pytest.raises(ConfigError, match=match):
        load_experiment(tmp_path / "config.yaml")


def test_settings_that_came_later_had_their_default():
    """A policy that was trained before there were these settings is the same, and not trained again."""
    from tensegrity_agents.sb3.checkpoint import with_later_settings

    now = small().train.model_dump(mode="json")
    before = {key: value for key, value in now.items() if key != "history"} | {"history": 2}
    before["teacher"] = {key: value for key, value in now["teacher"].items() if key != "edge_weight"}
    before["ppo"] = {key: value for key, value in now["ppo"].items() if key not in ("log_std_end", "value_rollouts")}
    assert with_later_settings(before, now) == now
    before["teacher"]["gradient_steps"] = 9
    assert with_later_settings(before, now) != now


def test_every_task_has_something_to_learn_and_what_cannot_be_told_is_refused():
    for env_id, name in (("tensegrity/SpatialPrismTrack-v0", "oracle"), ("tensegrity/DualTrianglePush-v0", "oracle")):
        envs = make_vec(env_id, 4)
        envs.reset(seed=0)
        teacher = Teacher(name, env_id, {}, envs.unwrapped, 20, 25)
        assert np.isfinite(teacher.actions(np.ones(4, bool))).all()
        assert teacher.knows_a_way.all()
    envs = make_vec("tensegrity/DualTriangleLoadedReachUncertain-v0", 4)
    with pytest.raises(TrainingError, match=r"cannot be told what every episode draws \(stiffness\)"):
        Teacher("oracle", "tensegrity/DualTriangleLoadedReachUncertain-v0", {}, envs.unwrapped, 20, 25)
