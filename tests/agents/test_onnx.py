"""Policies as ONNX files: the same actions, whatever they remember, and no file where they would differ."""

import json
from typing import get_args

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

import tensegrity_agents
from tensegrity_agents.command.program import app
from tensegrity_agents.config import Experiment, TrainConfig
from tensegrity_agents.pretrained import FOLDER, pretrained_ids
from tensegrity_agents.sb3 import onnx_policy
from tensegrity_agents.sb3.training import train

for package in ("onnx", "onnxscript", "onnxruntime"):
    pytest.importorskip(package)

FLAT, HINTED = "TwoXReach-v0", "PlanarFourBarLoadedReach-v0"
ALGORITHMS = get_args(TrainConfig.model_fields["algorithm"].annotation)
CASES = [
    *((algorithm, FLAT, {}) for algorithm in ALGORITHMS),
    ("ppo", "TwoXPayloadReach-v0", {"history": 3}),
    ("recurrent_ppo", "TwoXPayloadReach-v0", {"history": 2}),
    ("ppo", HINTED, {"model_hints": True}),
    ("ppo", HINTED, {"model_hints": True, "history": 2}),
]


@pytest.fixture(scope="module", params=CASES, ids=lambda case: "-".join([case[0], case[1], *case[2]]))
def trained(request, tmp_path_factory):
    algorithm, env, more = request.param
    settings = {
        "algorithm": algorithm,
        "total_timesteps": 64,
        "net_arch": [32, 32],
        "ppo": {"num_envs": 4, "n_steps": 8},
        "off_policy": {"her": False, "num_envs": 8, "learning_starts": 10, "batch_size": 16},
        **more,
    }
    policy = train(Experiment(env=env, train=settings), 0, tmp_path_factory.mktemp("agent"))
    with torch.no_grad():  # actions of every size, but with CrossQ's normalized layers, which would overdo it
        for parameter in policy.policy.parameters():
            parameter.mul_(1.0 if algorithm == "crossq" else 2.0)
    return policy


def test_a_file_does_what_the_policy_does(trained, tmp_path):
    path = tmp_path / "policy.onnx"
    assert tensegrity_agents.export(trained, path) <= 1e-5
    assert [file.name for file in tmp_path.iterdir()] == ["policy.onnx"]
    loaded, rng = onnx_policy.OnnxPolicy(path), np.random.default_rng(0)
    example = onnx_policy._example(trained)
    states, largest, sizes = [None, None], 0.0, []
    for step in range(10):  # observations of no episode, which begin at any time
        seen = {
            name: rng.uniform(-1, 1, (100, *example[name].shape[1:])).astype(np.float32)
            for name in ("observation", "achieved_goal", "desired_goal")
        }
        begins = np.ones(100, bool) if step == 0 else rng.random(100) < 0.3
        ours, states[0] = trained.predict(seen, states[0], begins)
        theirs, states[1] = loaded.predict(seen, states[1], begins)
        largest = max(largest, np.abs(ours - theirs).max())
        sizes.append(np.abs(ours))
    assert largest <= 2e-5
    assert np.mean(sizes) > 0.05


@pytest.mark.parametrize(
    "env_id",
    [
        pytest.param(one, marks=[] if one.endswith("TwoXPayloadReach-v0") else pytest.mark.full)
        for one in pretrained_ids()
        if not json.loads((FOLDER / one.rpartition("/")[2] / "policy.json").read_text()).get("corrects")
    ],
)
def test_shipped_policies_that_correct_nothing_can_be_exported(env_id, tmp_path):
    assert tensegrity_agents.export(env_id, tmp_path / "policy.onnx") <= onnx_policy.TOLERANCE


def test_a_file_that_would_differ_is_not_written(tmp_path, monkeypatch):
    class Wrong(onnx_policy._Graph):
        def __init__(self, trained):
            super().__init__(trained)
            self.mean += 0.1

    monkeypatch.setattr(onnx_policy, "_Graph", Wrong)
    with pytest.raises(onnx_policy.ExportError, match="differ"):
        tensegrity_agents.export("TwoXReach-v0", tmp_path / "policy.onnx")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("named", [FLAT, str(FOLDER / FLAT)], ids=["id", "folder"])
def test_the_command_writes_a_policy(tmp_path, named):
    path = tmp_path / "policy.onnx"
    done = CliRunner().invoke(app, ["export", named, str(path)])
    assert done.exit_code == 0, done.output
    import onnx

    model = onnx.load(path)
    onnx.checker.check_model(model)
    assert [one.name for one in model.graph.input] == ["observation", "achieved_goal", "desired_goal"]
    assert [one.name for one in model.graph.output] == ["action"]


def test_slips(tmp_path):
    with pytest.raises(ValueError, match=r"must end in \.onnx"):
        tensegrity_agents.export("TwoXReach-v0", tmp_path / "policy.pt")
    with pytest.raises(ValueError, match="no environment of this package"):
        tensegrity_agents.export("NoSuchReach-v0", tmp_path / "policy.onnx")
    (tmp_path / "other.onnx").write_bytes(b"nothing")
    with pytest.raises(ValueError, match="not an ONNX policy of this package"):
        onnx_policy.OnnxPolicy(tmp_path / "other.onnx")
    done = CliRunner().invoke(app, ["export", "NoSuchReach-v0", "policy.onnx"])
    assert (done.exit_code, "no environment" in done.output) == (2, True)
    (tmp_path / "policy.json").write_text("{")
    (tmp_path / "policy.safetensors").touch()
    done = CliRunner().invoke(app, ["export", str(tmp_path), str(tmp_path / "policy.onnx")])
    assert (done.exit_code, "not a description of a policy" in done.output) == (2, True)
