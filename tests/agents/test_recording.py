"""Minari datasets: what was recorded is what an evaluation of the same episodes tells, read with Minari's own API."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from tensegrity_agents.command.program import app
from tensegrity_agents.config import ConfigError
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.pretrained import load_pretrained
from tensegrity_agents.recording import dataset_id, datasets_in, record, standing_in

minari = pytest.importorskip("minari")
pytest.importorskip("h5py")

EPISODES, SEED = 3, 11
CASES = {
    "tensegrity/TwoXReach-v0": ["oracle", "servo", "random", "agent"],
    "tensegrity/PlanarFourBarReachMuJoCo-v0": ["oracle", "random"],
}


class Rounded:
    """A controller whose actions are those of the action space, float32: the last digits count at a knife's edge."""

    def __init__(self, controller):
        self.controller, self.wants_privileged = controller, getattr(controller, "wants_privileged", False)

    def begin_episodes(self, mask, design, privileged):
        if hasattr(self.controller, "begin_episodes"):
            self.controller.begin_episodes(mask, design, privileged)

    def predict(self, observation, **others):
        actions, state = self.controller.predict(observation, **others)
        return actions.astype(np.float32), state


@pytest.fixture(scope="module", params=CASES)
def recorded(request, tmp_path_factory):
    folder, told = tmp_path_factory.mktemp("data"), []
    names = record(request.param, CASES[request.param], EPISODES, folder=folder, seed=SEED, remark=told.append)
    with datasets_in(folder):
        yield request.param, [minari.load_dataset(name) for name in names], told, folder


def test_returns_and_lengths_are_those_of_an_evaluation(recorded):
    env_id, datasets, _, _ = recorded
    for data in datasets:
        name = data.storage.metadata["algorithm_name"]
        if name == "random":
            continue
        controller = load_pretrained(env_id) if name == "agent" else make_controller(name, env_id)
        run = evaluate(Rounded(controller), env_id, EPISODES, SEED, name)
        episodes = list(data.iterate_episodes())
        exact = 1e-6 if name == "agent" else 1e-12  # networks round otherwise in a batch
        np.testing.assert_allclose([sum(one.rewards) for one in episodes], run.columns["return"], rtol=exact)
        assert [len(one.rewards) for one in episodes] == run.columns["steps"].tolist()
        assert [bool(one.infos["is_success"][-1]) for one in episodes] == (run.columns["success"] > 0).tolist()


def test_a_recovered_environment_gives_the_same_when_replayed(recorded):
    env_id, datasets, _, _ = recorded
    for data in datasets:
        env = data.recover_environment()
        assert (env.spec.id, data.total_episodes) == (env_id, EPISODES)
        for k, episode in enumerate(data.iterate_episodes()):
            observation, _ = env.reset(seed=SEED + k)
            for step, action in enumerate(episode.actions):
                for key, value in observation.items():
                    np.testing.assert_array_equal(value, episode.observations[key][step])
                observation, reward, terminated, truncated, _ = env.step(action)
                assert reward == episode.rewards[step]
                assert (terminated, truncated) == (episode.terminations[step], episode.truncations[step])
            assert terminated or truncated
        env.close()


def test_a_closed_form_stands_in_for_an_oracle_and_says_so(recorded):
    env_id, datasets, told, _ = recorded
    names = [data.storage.metadata["algorithm_name"] for data in datasets]
    if env_id == "tensegrity/TwoXReach-v0":
        assert (names, told) == (CASES[env_id], [])
    else:
        assert names == ["closed_form_ik", "random"]
        assert told == [f"{env_id} has no oracle: closed_form_ik stands in for it"]


def test_what_is_there_is_not_written_over(recorded):
    env_id, _, _, folder = recorded
    with pytest.raises(ConfigError, match="is there already"):
        record(env_id, ["random"], 1, folder=folder)


def test_options_have_a_name_of_their_own():
    assert dataset_id("tensegrity/TwoXReach-v0", {}, "oracle") == "tensegrity/TwoXReach/oracle-v0"
    own = dataset_id("tensegrity/TwoXReach-v0", {"tolerance": 0.01}, "mine:Best")
    assert own.startswith("tensegrity/TwoXReach-") and own.endswith("/mine-Best-v0")
    assert standing_in("tensegrity/PlanarFourBarReach-v0", "servo") == "pseudo_inverse"


def run(*words):
    done = CliRunner().invoke(app, ["record", *words], env={"COLUMNS": "200"})
    return done.exit_code, done.output


def test_the_command(tmp_path):
    words = "PlanarFourBarReach-v0", "--controllers", "oracle, random", "--episodes", "2", "--out", str(tmp_path)
    code, text = run(*words, "--tolerance", "0.05")
    assert code == 0, text
    name = dataset_id("tensegrity/PlanarFourBarReach-v0", {"tolerance": 0.05}, "random")
    assert f'minari.load_dataset("{name}")' in text
    with datasets_in(tmp_path):
        kept = json.loads(minari.load_dataset(name).env_spec.to_json())["kwargs"]
    assert kept["tolerance"] == 0.05
    code, text = run(*words, "--tolerance", "0.05")
    assert (code, "is there already" in text) == (2, True)
    assert run(*words, "--tolerance", "0.05", "--fresh")[0] == 0


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        ("TwoXRech-v0", "did you mean"),
        ("TwoXReach-v0 --controllers nobody", "there are closed_form_ik"),
        ("TwoXTensionReachUncertain-v0 --controllers agent", "--policy takes the folder"),
        ("TwoXReach-v0 --seed 2000000000", "seeds 2000000000"),
    ],
)
@pytest.mark.usefixtures("only_one_policy")
def test_slips(words, answer, tmp_path):
    code, text = run(*words.split(), "--episodes", "1", "--out", str(tmp_path))
    assert (code, answer in text) == (2, True), text
    assert not list(tmp_path.iterdir())
