"""What the clients' scripts share: the ids they run on, and the rows in which they tell `run.py` what works."""

import importlib.metadata
import json
import traceback
from collections.abc import Callable
from typing import Any

import numpy as np

QUASI_STATIC, HIDDEN_LOAD, DYNAMIC = (
    "tensegrity/TwoXReach-v0",
    "tensegrity/DualTriangleLoadedReach-v0",
    "tensegrity/TwoXTensionReachMuJoCo-v0",
)
IDS = (QUASI_STATIC, HIDDEN_LOAD, DYNAMIC)


class Client:
    """Runs checks and prints one row for each; a check returns what it saw and raises where something is wrong.

    Args:
        package: the client's distribution, whose installed version is told.
    """

    def __init__(self, package: str) -> None:
        self.package, self.version = package, importlib.metadata.version(package)

    def check(self, env_id: str, what: str, of: Callable[..., Any], *arguments: Any) -> None:
        """Run a check.

        Args:
            env_id: the environment's id.
            what: one line, for the table.
            of: the check; an `Inapplicable` that it raises says that the client itself excludes the case.
            *arguments: of the check.
        """
        try:
            works, seen = "yes", of(*arguments)
        except Inapplicable as reason:
            works, seen = "-", reason
        except Exception as fault:
            traceback.print_exc()
            works, seen = "NO", f"{type(fault).__name__}: {fault}"
        row = {
            "client": f"{self.package} {self.version}",
            "id": env_id,
            "what": what,
            "works": works,
            "seen": str(seen),
        }
        print("ROW " + json.dumps(row), flush=True)


class Inapplicable(Exception):
    """The client does not do this with any environment of this kind."""


def same(first: Any, second: Any) -> bool:
    """Whether two trees of dicts, sequences, tensors and arrays are equal, dtypes of arrays included."""
    if isinstance(first, dict):
        return isinstance(second, dict) and set(first) == set(second) and all(same(first[k], second[k]) for k in first)
    if isinstance(first, list | tuple):
        return len(first) == len(second) and all(map(same, first, second))
    if first is None or second is None:
        return first is second
    one, other = np.asarray(first), np.asarray(second)
    if one.dtype == object:
        return one.shape == other.shape and all(map(same, one.ravel(), other.ravel()))
    return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")


def must(holds: Any, message: str) -> None:
    """Raise an AssertionError with the message where something does not hold."""
    if not holds:
        raise AssertionError(message)
