"""Ctrl-C while a script or the program still imports: one line and exit code 130. They import this first.

An exception would not do: libraries turn a KeyboardInterrupt amid their import into errors of their own.
"""

import os
import signal
import sys
from multiprocessing import parent_process
from pathlib import Path
from types import FrameType


def _end(number: int, frame: FrameType | None) -> None:
    os.write(2, b"interrupted: nothing was begun yet\n")
    os._exit(130)


def as_usual() -> None:
    """From here on Ctrl-C is a KeyboardInterrupt again."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


_started = getattr(sys.modules["__main__"], "__file__", None)
if (
    _started is not None
    and (Path(_started).absolute().parent.name == "scripts" or Path(_started).stem == "tensegrity")
    and parent_process() is None
    and signal.getsignal(signal.SIGINT) is signal.default_int_handler
):
    signal.signal(signal.SIGINT, _end)
