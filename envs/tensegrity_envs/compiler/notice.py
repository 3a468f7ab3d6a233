"""A word while code is compiled, where that takes longer than a second."""

import logging
import os
import time
from collections.abc import Callable

_LOG = logging.getLogger("tensegrity_envs")
_AFTER = 1.0  # seconds of compiling in this process
_state = {"spent": 0.0, "said": 0.0}  # seconds in this process; whether the line is out


def compiled(make: Callable[[], bytes]) -> bytes:
    """The code that `make` compiles; from a second of compiling on, one line says so.

    Not where the environment variable CI or TENSEGRITY_QUIET is set.
    """
    begun = time.perf_counter()
    code = make()
    _state["spent"] += time.perf_counter() - begun
    if _state["spent"] > _AFTER and not _state["said"]:
        _state["said"] = 1.0
        if not (os.environ.get("CI") or os.environ.get("TENSEGRITY_QUIET")):
            # Logging shows warnings on stderr by itself, as long as nobody has configured it.
            _LOG.warning("compiling environments, %.1f s so far; once per machine, then kept on disk", _state["spent"])
    return code
