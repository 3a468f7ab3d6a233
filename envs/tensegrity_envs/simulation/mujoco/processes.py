"""What MuJoCo keeps for a whole process, shared by Python threads and forked children: its warning handler, threads."""

import ctypes
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from weakref import WeakSet

import mujoco
from mujoco.rollout import Rollout


class _Warnings:
    """The process has one warning handler: the first thread that simulates puts ours in, the last one takes it out."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._inside = 0
        self._theirs: Any = None

    def enter(self) -> None:
        with self._lock:
            if self._inside == 0:
                self._theirs = mujoco.get_mju_user_warning()
                mujoco.set_mju_user_warning(self._note)
            self._inside += 1

    def leave(self) -> None:
        with self._lock:
            self._inside -= 1
            if self._inside == 0:
                mujoco.set_mju_user_warning(self._theirs)
                self._theirs = None

    def forked(self) -> None:
        """Of all threads, a child has the one that forked it, which does not simulate."""
        self._lock = threading.Lock()
        if self._inside:
            self._inside = 1
            self.leave()

    def _note(self, message: str) -> None:
        """What MuJoCo warns of, but for divergence, which is told in another way."""
        theirs = self._theirs
        if "unstable" in message:
            return
        if theirs is None:
            sys.stderr.write(f"MuJoCo: {message}\n")
        else:
            theirs(message)


_warnings = _Warnings()


@contextmanager
def without_log() -> Iterator[None]:
    """Keep MuJoCo from writing its warnings of divergence to the terminal and to MUJOCO_LOG.TXT.

    A handler of the process's own is back when no thread simulates any more, and hears of all but divergence meanwhile.
    """
    _warnings.enter()
    try:
        yield
    finally:
        _warnings.leave()


class Pools:
    """Threads that simulate, with their data, for each number of threads.

    They are left behind where they cannot follow: copies and forked children start their own.
    """

    def __init__(self) -> None:
        self._pools: dict[int, tuple[Rollout, list[Any]]] = {}
        _all_pools.add(self)

    def of(self, model: mujoco.MjModel, count: int) -> tuple[Rollout, list[mujoco.MjData]]:
        """So many threads, and data of the model for each."""
        if count not in self._pools:
            data = [mujoco.MjData(model) for _ in range(count)]
            self._pools[count] = Rollout(nthread=count if count > 1 else 0), data
        return self._pools[count]

    def close(self) -> None:
        """End the threads."""
        for pool, _ in self._pools.values():
            pool.close()
        self._pools.clear()

    def forked(self) -> None:
        """Forget the parent's threads, but never free them: that would wait for their end for ever."""
        for pool, _ in self._pools.values():
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(pool))
        self._pools = {}

    def __reduce__(self) -> tuple[type["Pools"], tuple[()]]:
        """A copy has none yet."""
        return Pools, ()


_all_pools: "WeakSet[Pools]" = WeakSet()


def _forked() -> None:
    _warnings.forked()
    for pools in list(_all_pools):
        pools.forked()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)
