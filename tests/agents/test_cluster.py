"""A campaign on a Ray cluster of two nodes, one of which dies: every row is there, and equals the local run's."""

import time
from threading import Thread

import numpy as np
import pytest

from tensegrity_agents.campaign import Task, run_campaign, tasks_of
from tensegrity_agents.cluster import Keeper, run_on_cluster
from tensegrity_agents.config import ConfigError, Experiment
from tensegrity_agents.sb3.checkpoint import CHECKPOINT
from tensegrity_agents.sb3.policy_file import WEIGHTS

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


@pytest.mark.full
def test_a_node_that_dies_costs_no_row_and_changes_none(tmp_path, monkeypatch):
    from ray.cluster_utils import Cluster

    monkeypatch.setenv("RAY_worker_niceness", "0")  # Ray's workers would wait for everything else on the machine
    tasks = tasks_of(EXPERIMENT)
    alone = {task.name: row for task, row in run_campaign(tasks, tmp_path / "results", tmp_path / "records", silent)}
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    victim = cluster.add_node(num_cpus=1)
    results, killed = tmp_path / "results-2", []

    def kill() -> None:
        """As soon as checkpoints of two trainings have come, so that one of them is on the second node."""
        while len(list(results.glob(f"*/agent-*/{CHECKPOINT}"))) < 2:
            time.sleep(0.2)
        killed.append([path.parent.name for path in results.glob(f"*/agent-*/{WEIGHTS}")])
        cluster.remove_node(victim, allow_graceful=False)

    killer = Thread(target=kill, daemon=True)
    killer.start()
    try:
        found = list(run_on_cluster(tasks, results, tmp_path / "records-2", silent, cluster.address))
    finally:
        cluster.shutdown()
    assert killed == [[]]  # no training had ended by then
    assert sorted(task.name for task, _ in found) == sorted(alone)
    for task, row in found:
        np.testing.assert_array_equal(row.flags(), alone[task.name].flags())
        assert (row.config, row.frames) == (alone[task.name].config, alone[task.name].frames)
        assert task.kept(tmp_path / "records-2") == row
        if task.seed is not None:
            ours, theirs = (Task.home(task, tmp_path / name) / WEIGHTS for name in ("results-2", "results"))
            assert ours.read_bytes() == theirs.read_bytes()
