"""The comparison of two builds, and the measurement of memory."""

from pathlib import Path

import pytest

from tensegrity_agents.benchmark import shares
from tensegrity_agents.benchmark_against import against
from tensegrity_agents.config import ConfigError

ROOT = Path(__file__).parents[2]


def test_what_is_no_checkout_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="must be a checkout"):
        against(tmp_path)


@pytest.mark.full
def test_a_build_is_compared_with_itself():
    told = []
    ids = ["tensegrity/TwoXReach-v0", "tensegrity/Missing-v0"]
    lines = against(ROOT, ids, (2, 0), rounds=1, progress=told.append)
    assert [line.what for line in lines] == [
        f"vector {ids[0]} x 2",
        f"single {ids[0]} step",
        f"single {ids[0]} step, resets included",
    ]
    assert all(line.ours > 0 and line.ratio > 0 for line in lines)
    assert told[-1] == f"{ids[1]}: the other checkout does not have it"


def test_where_a_vector_step_goes_is_found():
    """Every part of it has a share of the time, and they are all of it."""
    found = shares("tensegrity/TwoXReach-v0", 64, 20)
    assert sum(found.values()) == pytest.approx(1.0)
    assert min(found.values()) > 0
