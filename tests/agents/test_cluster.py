"""On a Ray cluster of two nodes, one of which dies, every row of a campaign and every trial of a search is there, and
equals the local run's.
"""

import time
from contextlib import contextmanager
from threading import Thread

import numpy as np
import pytest

from tensegrity_agents.campaign import Task, run_campaign, tasks_of
from tensegrity_agents.cluster import Keeper, run_on_cluster
from tensegrity_agents.config import ConfigError, Experiment
from tensegrity_agents.sb3.checkpoint import CHECKPOINT
from tensegrity_agents.sb3.policy_file import WEIGHTS
from tensegrity_agents.search import TRIALS, search
from tensegrity_agents.search_on_cluster import on_cluster

ray = pytest.importorskip("ray", reason="Ray is not installed: pip install 'tensegrity-envs[ray]'")

TRAIN = {
    "total_timesteps": 150_000,
    "segment_timesteps": 10_000,
    "net_arch": [64],
    "ppo": {"num_envs": 64, "n_steps": 16, "batch_size": 256},
}
EXPERIMENT = Experiment(env="TwoXReach-v0", seeds=[0, 1, 2], episodes=40, controllers=["closed_form_ik"], train=TRAIN)


def silent(what, done, total, remark):
    pass


def test_files_come_back_whole(tmp_path):
    keeper = Keeper(tmp_path)
    assert keeper.get("a/agent-0") == {}
    keeper.put("a/agent-0", {"one": b"1", "two": b"22"})
    keeper.put("a/agent-0", {"one": b"111"})
    (tmp_path / "a" / "agent-0" / "three.part").write_bytes(b"3")
    assert keeper.get("a/agent-0") == {"one": b"111", "two": b"22"}


def test_an_address_without_a_cluster_is_a_slip(tmp_path):
    with pytest.raises(ConfigError, match="no Ray cluster there"):
        list(run_on_cluster([], tmp_path, tmp_path, silent, "127.0.0.1:1"))


@contextmanager
def dying_cluster(monkeypatch, results, homes):
    """The address of a cluster of two nodes, the second of which dies in the midst of two trainings."""
    from ray.cluster_utils import Cluster

    monkeypatch.setenv("RAY_worker_niceness", "0")  # Ray's workers would wait for everything else on the machine
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    victim = cluster.add_node(num_cpus=1)
    killed = []

    def kill() -> None:
        """As soon as checkpoints of two trainings have come, so that one of them is on the second node."""
        while len(list(results.glob(f"{homes}/{CHECKPOINT}"))) < 2:
            time.sleep(0.2)
        killed.append([path.parent.name for path in results.glob(f"{homes}/{WEIGHTS}")])
        cluster.remove_node(victim, allow_graceful=False)

    killer = Thread(target=kill, daemon=True)
    killer.start()
    try:
        yield cluster.address
    finally:
        cluster.shutdown()
    assert killed == [[]]  # no training had ended by then


@pytest.mark.full
def test_a_node_that_dies_costs_no_row_and_changes_none(tmp_path, monkeypatch):
    tasks = tasks_of(EXPERIMENT)
    alone = {task.name: row for task, row in run_campaign(tasks, tmp_path / "results", tmp_path / "records", silent)}
    results = tmp_path / "results-2"
    with dying_cluster(monkeypatch, results, "*/agent-*") as address:
        found = list(run_on_cluster(tasks, results, tmp_path / "records-2", silent, address))
    assert sorted(task.name for task, _ in found) == sorted(alone)
    for task, row in found:
        np.testing.assert_array_equal(row.flags(), alone[task.name].flags())
        assert (row.config, row.frames) == (alone[task.name].config, alone[task.name].frames)
        assert task.kept(tmp_path / "records-2") == row
        if task.seed is not None:
            ours, theirs = (Task.home(task, tmp_path / name) / WEIGHTS for name in ("results-2", "results"))
            assert ours.read_bytes() == theirs.read_bytes()


@pytest.mark.full
def test_a_node_that_dies_costs_no_trial_and_changes_none(tmp_path, monkeypatch):
    pytest.importorskip("optuna")
    here, there = tmp_path / "here", tmp_path / "there"
    told = []
    best = search(EXPERIMENT, here, 3, episodes=40, remark=told.append)[0].read_text()
    with dying_cluster(monkeypatch, there, "trial-*") as address:
        again = search(EXPERIMENT, there, 3, episodes=40, remark=told.append, runner=on_cluster(address))[0]
    assert again.read_text() == best
    assert (there / TRIALS).read_text() == (here / TRIALS).read_text()
    assert len(told) == 6
    policies = {path.relative_to(here): path.read_bytes() for path in here.glob(f"trial-*/{WEIGHTS}")}
    assert len(policies) == 3
    assert {path.relative_to(there): path.read_bytes() for path in there.glob(f"trial-*/{WEIGHTS}")} == policies
