"""Machine code on disk: each piece compiled once for all processes of a user, on one processor.

Whatever is wrong with the directory (it is missing, read-only, full, its files are damaged or another program's) means
that code is compiled again, and nothing else.
"""

import contextlib
import hashlib
import os
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from tensegrity_envs.compiler import notice

_MAGIC = b"tensegrity_envs machine code 1\n"
_LARGEST = 256 * 2**20  # bytes kept in all
_OLDEST = 90 * 86400.0  # seconds for which what is not used is kept
_PATIENCE = 120.0  # seconds to wait for another process that compiles the same


def directory() -> Path:
    """Where machine code is kept; it need not exist."""
    given = os.environ.get("TENSEGRITY_CACHE_DIR")
    if given:
        return Path(given)
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(home) / "tensegrity_envs"


def fetch(key: str, version: str, make: Callable[[], bytes]) -> bytes:
    """The code of a key, from disk, or else made now and left there.

    Args:
        key: of what is compiled.
        version: of the compiler; keys of other versions are other keys.
        make: compiles it.
    """
    make = partial(notice.compiled, make)
    folder = directory() / f"code-{version}"
    path = folder / f"{key}.bin"
    code = _read(path)
    if code is not None:
        return code
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return make()
    with _only_one(folder / f"{key}.lock"):
        code = _read(path)  # of a process that was faster
        if code is None:
            code = make()
            _write(path, code)
    return code


def _read(path: Path) -> bytes | None:
    try:
        content = path.read_bytes()
    except OSError:
        return None
    head = len(_MAGIC) + 32
    if content[: len(_MAGIC)] != _MAGIC or hashlib.sha256(content[head:]).digest() != content[len(_MAGIC) : head]:
        return None
    return content[head:]


def _write(path: Path, code: bytes) -> None:
    draft = path.with_suffix(f".{os.getpid()}.tmp")
    try:
        if not any(path.parent.glob("*.bin")):
            _tidy(path.parent.parent)  # a new version, or a new directory
        draft.write_bytes(_MAGIC + hashlib.sha256(code).digest() + code)
        os.replace(draft, path)  # another process may be reading
    except OSError:
        with contextlib.suppress(OSError):
            draft.unlink()


@contextlib.contextmanager
def _only_one(path: Path) -> Iterator[None]:
    """Let one process at a time do what follows, where the file system can tell them apart.

    A lock ends with its process, however that ends; whoever has waited for two minutes goes on without it.
    """
    try:
        import fcntl
    except ImportError:  # Windows: all compile, and the last one's code stays
        yield
        return
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError:
        yield
        return
    try:
        end, pause = time.monotonic() + _PATIENCE, 0.01
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > end:
                    break
                time.sleep(pause)
                pause = min(2 * pause, 0.1)
            except OSError:  # there are no locks here
                break
        yield
    finally:
        with contextlib.suppress(OSError):
            path.unlink()
        os.close(file)


def _tidy(top: Path) -> None:
    """Remove what nobody has used for long, and the oldest where there is too much."""
    found = []
    # Up to 0.1 there were Python files with Numba's caches beside them.
    for pattern in ("code-*/*", "tensegrity_*.py", "__pycache__/tensegrity_*"):
        for path in top.glob(pattern):
            with contextlib.suppress(OSError):
                status = path.stat()
                found.append((max(status.st_mtime, status.st_atime), status.st_size, path))
    found.sort(reverse=True)
    total, now = 0, time.time()
    for used, size, path in found:
        total += size
        if total > _LARGEST or now - used > _OLDEST:
            with contextlib.suppress(OSError):
                path.unlink()
    for folder in top.glob("code-*"):
        with contextlib.suppress(OSError):
            folder.rmdir()  # if it is empty
