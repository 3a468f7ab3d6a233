"""Fixtures of several files."""

import shutil

import pytest

from tensegrity_agents import pretrained


@pytest.fixture
def only_one_policy(tmp_path_factory, monkeypatch):
    """As if a policy were shipped for TwoXReach-v0 alone."""
    folder = tmp_path_factory.mktemp("policies")
    shutil.copytree(pretrained.FOLDER / "TwoXReach-v0", folder / "TwoXReach-v0")
    monkeypatch.setattr(pretrained, "FOLDER", folder)
    pretrained.pretrained_ids.cache_clear()
    yield
    pretrained.pretrained_ids.cache_clear()
