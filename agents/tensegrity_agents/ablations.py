"""Ablations: the config of an id with one thing taken out, whose rows the campaign measures like any others."""

from collections.abc import Callable, Mapping
from typing import Any

from tensegrity_agents.config import ConfigError, Experiment
from tensegrity_agents.reporting.ablations import WHOLE

FOLDER = "ablations"  # in that of the records: a folder of rows for each variant
SEEDS = (0, 1, 2)


def _without(key: str, value: object) -> Callable[[dict[str, Any]], dict[str, Any] | None]:
    """Settings with this value; None where they have it."""
    return lambda train: train | {key: value} if train[key] != value else None


def _taught_only(train: dict[str, Any]) -> dict[str, Any] | None:
    """The steps with the teacher or through the gradient alone."""
    first = train["teacher"] or train["gradient"]
    if first is None or first["timesteps"] == train["total_timesteps"]:
        return None
    return train | {"total_timesteps": first["timesteps"]}


# What is taken out, by name: settings below `train:` without it, or None where a config does not have it.
VARIANTS: Mapping[str, Callable[[dict[str, Any]], dict[str, Any] | None]] = {
    "no_teacher": _without("teacher", None),
    "no_history": _without("history", 0),
    "no_gradient": _without("gradient", None),
    "no_plan": _without("corrects", None),
    "no_fine_tuning": _taught_only,
    "no_repeat_failed": _without("repeat_failed", 0.0),
    "no_levels": _without("levels", None),
}


def variants_of(experiment: Experiment, timesteps: int | None = None) -> dict[str, Experiment]:
    """The variants that an experiment has, by name: the same number of steps, but for `no_fine_tuning`.

    Args:
        experiment: the whole method.
        timesteps: of every variant, and of the whole method, which then is one of them; by default the method's own.

    Raises:
        ConfigError: there are no steps left after those with the teacher.
    """
    train = experiment.train.model_dump()
    if timesteps is not None:
        train |= {"total_timesteps": timesteps}
        gradient = train["gradient"]
        if gradient is not None:
            train |= {"gradient": gradient | {"timesteps": min(gradient["timesteps"], timesteps)}}
        taught = 0 if train["teacher"] is None else train["teacher"]["timesteps"]
        if timesteps <= taught:
            raise ConfigError(
                f"--timesteps {timesteps}: must be more than the {taught} steps with the teacher of {experiment.env}"
            )
    changed = {name: change(train) for name, change in VARIANTS.items()}
    found = {name: experiment.changed(train=settings) for name, settings in changed.items() if settings is not None}
    return {WHOLE: experiment.changed(train=train)} | found if found and timesteps is not None else found
