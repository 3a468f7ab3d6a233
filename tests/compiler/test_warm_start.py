"""What is loaded, compiled ahead and said."""

import os
import subprocess
import sys

import gymnasium as gym
import pytest

import tensegrity_envs
from tensegrity_envs.compiler import notice, store

HEAVY = ("numba", "torch", "pygame", "matplotlib", "contourpy", "shapely", "mujoco", "scipy.optimize", "scipy.ndimage")


def needed_by(env_id):
    """The heavy modules that an environment may load."""
    needed = {"mujoco"} if "MuJoCo" in env_id else set()
    needed |= (
        {"scipy.ndimage"} if "TwoX" in env_id or "ThreeX" in env_id else set()
    )  # connected components of its joint space
    return needed | ({"shapely"} if "Posture" in env_id else set())


@pytest.mark.parametrize("needed", sorted({tuple(sorted(needed_by(i))) for i in tensegrity_envs.ENV_IDS}), ids=str)
def test_an_environment_loads_only_what_it_uses(needed):
    """Those that need the same share a process: what one of them loads too much is there after it."""
    ids = [env_id for env_id in tensegrity_envs.ENV_IDS if needed_by(env_id) == set(needed)]
    code = f"""
import sys, gymnasium, tensegrity_envs
for env_id in {ids}:
    env = gymnasium.make(env_id)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    print(env_id, *[m for m in {HEAVY} if m in sys.modules])
"""
    shown = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=True)
    loaded = {line.split()[0]: set(line.split()[1:]) for line in shown.stdout.splitlines()}
    assert list(loaded) == ids
    assert {env_id: modules - set(needed) for env_id, modules in loaded.items()} == {env_id: set() for env_id in ids}


def test_what_is_compiled_ahead_is_not_compiled_again(tmp_path):
    environment = os.environ | {"TENSEGRITY_CACHE_DIR": str(tmp_path), "TENSEGRITY_QUIET": "1"}
    ids = ["tensegrity/PlanarFourBarReach-v0", "tensegrity/DualTrianglePush-v0"]
    code = f"import tensegrity_envs; tensegrity_envs.compile_all({ids})"
    first = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert [line.split(":")[0] for line in first.stdout.splitlines()] == ["1 of 2", "2 of 2"]
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.bin")}
    assert before
    subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, env=environment)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.bin")} == before
    with pytest.raises(ValueError, match="PlanarFourBarReach"):
        tensegrity_envs.compile_all(["tensegrity/Missing-v0"])
    assert "tensegrity/PlanarFourBarReach-v0" in gym.registry


@pytest.mark.parametrize(("variable", "lines"), [(None, 1), ("CI", 0), ("TENSEGRITY_QUIET", 0)])
def test_one_line_says_that_it_takes_longer(variable, lines, monkeypatch, tmp_path, caplog):
    for name in ("CI", "TENSEGRITY_QUIET"):
        monkeypatch.delenv(name, raising=False)
    if variable:
        monkeypatch.setenv(variable, "1")
    monkeypatch.setenv("TENSEGRITY_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(notice, "_AFTER", 0.0)
    monkeypatch.setitem(notice._state, "said", 0.0)
    for key in ("a", "b"):
        store.fetch(key, "v", lambda: b"code")
    assert len([r for r in caplog.records if r.name == "tensegrity_envs"]) == lines
