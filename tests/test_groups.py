"""Tests of one environment run in one process of pytest-xdist, which compiles its code once."""

import os

import pytest


@pytest.mark.xdist_group("a-group")
def test_groups_hold(request):
    if "PYTEST_XDIST_WORKER" not in os.environ:
        pytest.skip("runs without pytest-xdist")
    # pytest-xdist marks the group in the name; where pytest ignores that, every worker compiles and draws everything.
    assert request.node.nodeid.endswith("@a-group")
