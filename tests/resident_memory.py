"""The memory of this process, for tests that it does not grow."""

import gc
import os
import sys

import pytest

needs_counters = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads Linux's memory counters")


def resident():
    """What it holds in memory now [MB]."""
    gc.collect()
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGESIZE") / 2**20
