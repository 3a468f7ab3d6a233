"""The random numbers of a training: those of Python, NumPy (which Stable-Baselines3 draws from) and Torch."""

import random
from typing import Any

import numpy as np
import torch


def reseed(seed: int) -> None:
    """Begin all three anew."""
    random.seed(seed)
    np.random.seed(seed)  # noqa: NPY002
    torch.manual_seed(seed)


def get_state() -> dict[str, Any]:
    """All that the numbers to come depend on, in lists and tensors."""
    name, keys, *rest = np.random.get_state()  # noqa: NPY002
    return {
        "torch": torch.get_rng_state(),
        "numpy": [name, np.asarray(keys).tolist(), *rest],
        "python": random.getstate(),
    }


def set_state(state: dict[str, Any]) -> None:
    """Go on where `get_state` was taken."""
    torch.set_rng_state(torch.as_tensor(state["torch"]))
    name, keys, *rest = state["numpy"]
    np.random.set_state((name, np.array(keys, np.uint32), *rest))  # noqa: NPY002
    version, internal, gauss = state["python"]
    random.setstate((version, tuple(internal), gauss))
