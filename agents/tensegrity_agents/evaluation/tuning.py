"""Tune a controller on validation episodes: the numbers of its class that it says are to be tuned, on a grid."""

from collections.abc import Callable, Mapping
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from tensegrity_agents.controllers import make_controller
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_envs.seeding import VALIDATION_SEED


class Tried(NamedTuple):
    """Settings of a controller, and what it did with them.

    Attributes:
        settings: by name.
        success: share of episodes.
        settling: median settling time [s], infinite where the tip did not stay; 0 where the task has none.
    """

    settings: dict[str, float]
    success: float
    settling: float = 0.0


# progress(what was tried so far, the best first, of how many)
Progress = Callable[[list[Tried], int], None]


def tune(
    name: str,
    env_id: str,
    episodes: int,
    options: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> list[Tried]:
    """Evaluate a controller with all combinations of the values in its `tunable`.

    Args:
        name: of a baseline, see `controllers.make_controller`.
        env_id: Gymnasium id.
        episodes: of the validation episodes, from the first one on.
        options: of the environment.
        progress: called after each setting.

    Returns:
        The best first: by success, then by settling time; of equally good ones, the one that comes first in the grid.

    Raises:
        ValueError: there is no such controller, or nothing of it is to be tuned.
    """
    grid: Mapping[str, tuple[float, ...]] = getattr(make_controller(name, env_id, options), "tunable", {})
    if not grid:
        raise ValueError(
            f"controller {name!r} of {env_id}: its class names nothing to tune (tunable = {{name: values}})"
        )
    tried: list[Tried] = []
    combinations = list(product(*grid.values()))
    for values in combinations:
        controller, settings = make_controller(name, env_id, options), dict(zip(grid, values, strict=True))
        for key, value in settings.items():
            setattr(controller, key, value)
        run = evaluate(controller, env_id, episodes, VALIDATION_SEED, name, env_options=dict(options or {}))
        settling = float(np.median(run.columns["settling_time_s"]))
        tried.append(Tried(settings, float(run.columns["success"].mean()), 0.0 if np.isnan(settling) else settling))
        tried.sort(key=lambda one: (-one.success, one.settling))
        if progress is not None:
            progress(list(tried), len(combinations))
    return tried
