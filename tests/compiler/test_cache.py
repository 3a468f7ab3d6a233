"""Whatever happens to the cache of machine code: the numbers are the same, and nothing fails."""

import os
import shutil
import subprocess
import sys

import pytest

from tensegrity_envs.compiler import store

USE = """
import numpy as np
from tensegrity_envs.compiler import machine
from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.mechanics.polynomials import real_roots

made, to_object = [], machine.to_object
machine.to_object = lambda *given: made.append(1) or to_object(*given)

def area(x, y):
    return abs(x) * y + 1.0

print(evaluate(area, 0.5, -3.0), *real_roots(np.array([[-1.0, 0.0, 1.0]]))[1], len(made))
"""


def run(folder, **environment):
    """Results and how many kernels were compiled."""
    done = subprocess.run(
        [sys.executable, "-c", USE],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"TENSEGRITY_CACHE_DIR": str(folder), "TENSEGRITY_QUIET": "1"} | environment,
    )
    assert not done.stderr, done.stderr
    *numbers, made = done.stdout.split()
    assert numbers == ["-0.5", "-1.0", "1.0"]
    return int(made)


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cache")
    assert run(folder) == 2
    return folder


@pytest.fixture
def filled(original, tmp_path):
    """A copy of a cache with both kernels."""
    return shutil.copytree(original, tmp_path / "cache")


def test_code_is_compiled_once_and_nothing_but_code_is_left(filled):
    assert run(filled) == 0
    (folder,) = filled.iterdir()
    assert {path.suffix for path in folder.iterdir()} == {".bin"}


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: content[:20],
        lambda content: content[:1000],
        lambda content: content[:-1],
        lambda content: content[:2000] + bytes([content[2000] ^ 1]) + content[2001:],
        lambda content: b"another program's",
    ],
)
def test_damaged_files_are_compiled_anew_and_mended(filled, damage):
    paths = list(filled.rglob("*.bin"))
    before = {path: path.read_bytes() for path in paths}
    for path in paths:
        path.write_bytes(damage(before[path]))
    assert run(filled) == 2
    assert run(filled) == 0
    assert {path: path.read_bytes() for path in paths} == before


def test_folders_in_the_place_of_files_do_no_harm(filled):
    for path in filled.rglob("*.bin"):
        path.unlink()
        path.mkdir()
    assert run(filled) == 2


def test_a_cache_that_cannot_be_made_does_no_harm_and_leaves_nothing_behind(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "temporary").mkdir()
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        assert run(folder, TMPDIR=str(tmp_path / "temporary")) == 2
    assert not list((tmp_path / "temporary").iterdir())


@pytest.mark.skipif(os.name == "nt" or shutil.which("setpriv") is None, reason="needs Linux's setpriv")
@pytest.mark.skipif(getattr(os, "geteuid", lambda: 1)() != 0, reason="needs a user whom permissions do not stop")
def test_a_read_only_cache_is_read(filled):
    # Root writes anywhere: another user reads.
    for path in (filled, *filled.rglob("*")):
        path.chmod(0o555 if path.is_dir() else 0o444)
    code = (
        "import sys; from pathlib import Path; from tensegrity_envs.compiler import store; "
        "[store.fetch(p.stem, p.parent.name[5:], lambda: sys.exit('made')) for p in Path(sys.argv[1]).rglob('*.bin')]"
    )
    command = ["setpriv", "--clear-groups", "--inh-caps=-all", "--bounding-set=-all", sys.executable, "-c", code]
    subprocess.run([*command, str(filled)], check=True, env=os.environ | {"TENSEGRITY_CACHE_DIR": str(filled)})


def test_processes_that_start_together_compile_each_kernel_once(tmp_path):
    environment = os.environ | {"TENSEGRITY_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", USE]
    running = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) for _ in range(4)]
    lines = [process.communicate()[0].split() for process in running]
    assert {tuple(line[:3]) for line in lines} == {("-0.5", "-1.0", "1.0")}
    if os.name != "nt":
        assert sum(int(line[3]) for line in lines) == 2


def test_a_lock_that_a_dead_process_left_stops_nobody(tmp_path):
    folder = tmp_path / "code-v"
    folder.mkdir()
    (folder / "k.lock").write_text("")
    os.environ["TENSEGRITY_CACHE_DIR"], before = str(tmp_path), os.environ.get("TENSEGRITY_CACHE_DIR")
    try:
        assert store.fetch("k", "v", lambda: b"code") == b"code"
        assert store.fetch("k", "v", lambda: b"other") == b"code"
    finally:
        if before is None:
            del os.environ["TENSEGRITY_CACHE_DIR"]
        else:
            os.environ["TENSEGRITY_CACHE_DIR"] = before


def test_what_older_versions_left_is_removed_and_the_rest_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setenv("TENSEGRITY_CACHE_DIR", str(tmp_path))
    old, recent, foreign = tmp_path / "code-old", tmp_path / "code-recent", tmp_path / "notes.txt"
    for folder in (old, recent):
        folder.mkdir()
        (folder / "k.bin").write_bytes(b"0" * 100)
    foreign.write_text("mine")
    numba = tmp_path / "tensegrity_kernel_0.py"
    numba.write_text("")
    for path in (old / "k.bin", foreign, numba):
        os.utime(path, (0, 0))
    store.fetch("k", "new", lambda: b"code")
    assert not old.exists() and not numba.exists()
    assert (recent / "k.bin").exists() and foreign.exists()
    monkeypatch.setattr(store, "_LARGEST", 50)
    store.fetch("k", "newer", lambda: b"code")
    assert not recent.exists() and foreign.exists()
