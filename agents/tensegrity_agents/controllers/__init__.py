"""Controllers: whatever has `predict(observation, state, episode_start, deterministic)`, by name."""

from collections.abc import Callable, Mapping
from difflib import get_close_matches
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

import gymnasium as gym

from tensegrity_agents.controllers.base import Makers
from tensegrity_agents.controllers.random import RandomController
from tensegrity_agents.own_modules import own_module
from tensegrity_envs.core import Core
from tensegrity_envs.env import unwrapped
from tensegrity_envs.registration import full_id

__all__ = ["BASELINES", "DYNAMIC", "arm_of", "baselines_of", "make_controller", "register_baselines", "teachers_of"]

# A folder for each mechanism, which has its tables (`base.Makers`).
FOLDERS = [import_module(f"{__name__}.{found.name}") for found in iter_modules(__path__) if found.ispkg]


def _collected(table: str) -> Makers:
    return {arm: made for folder in FOLDERS for arm, made in getattr(folder, table, {}).items()}


BASELINES, DYNAMIC, TEACHERS = _collected("BASELINES"), _collected("DYNAMIC"), _collected("TEACHERS")

# Those that are registered for one id, by that id.
_OWN: Makers = {}

# Of some ids, by their names: those that only they need.
_UNCERTAIN = _collected("UNCERTAIN")

# Of uncertain ids, by their names: who is told all that was drawn. It says how much of an error is due to not knowing.
_INFORMED = _collected("INFORMED")


def teachers_of(env_id: str, options: Mapping[str, Any] | None = None) -> dict[str, Callable[[Core], Any]]:
    """What can teach an agent in an environment, by name: its planners that are told the truth, its other baselines,
    and those that only teach.

    Args:
        env_id: Gymnasium id.
        options: of that environment.
    """
    baselines = {name: make for name, make in baselines_of(env_id, options).items() if name != "random"}
    return baselines | TEACHERS.get(arm_of(env_id, options), {})


def arm_of(env_id: str, options: Mapping[str, Any] | None = None) -> Any:
    """An environment's arm, by its name or as a class: that of its id, unless its options say another."""
    return (options or {}).get("arm") or gym.spec(full_id(env_id)).kwargs["arm"]


def baselines_of(env_id: str, options: Mapping[str, Any] | None = None) -> dict[str, Callable[[Core], Any]]:
    """The baselines of an environment by name, the strongest last but for the random one.

    Args:
        env_id: Gymnasium id.
        options: of that environment; with another `arm` or `backend` it has the baselines of these.
    """
    env_id = full_id(env_id)
    kwargs = gym.spec(env_id).kwargs
    backends = [given.get("backend", "quasi_static") for given in (kwargs, {**kwargs, **(options or {})})]
    table = DYNAMIC if backends[1] == "mujoco" else BASELINES
    arm = arm_of(env_id, options)
    if arm != kwargs["arm"] or backends[0] != backends[1]:
        return {**table.get(arm, {}), "random": RandomController}
    found = _OWN.get(env_id) or table.get(arm, {})
    name = env_id.removeprefix("tensegrity/").removesuffix("-v0")
    return {**found, **_UNCERTAIN.get(name, {}), **_INFORMED.get(name, {})} | {"random": RandomController}


def register_baselines(env_id: str, baselines: Mapping[str, Callable[[Core], Any]]) -> None:
    """Add baselines of an environment, most often of your own: `compare` and `evaluate` then list them by name.

    Call it where the environment is registered, so that "module:id" as the name of the environment brings both.

    Args:
        env_id: Gymnasium id.
        baselines: what makes each of them for the core of the environment, such as a subclass of
            `controllers.base.AnalyticController`, by name, the strongest last.

    Raises:
        ValueError: a name that is empty, "random", or has a colon, as classes given as "module:Class" have.
    """
    for name in baselines:
        if not name or name == "random" or ":" in name:
            raise ValueError(f"baseline {name!r} of {env_id}: must be a name without a colon, other than 'random'")
    _OWN[env_id] = {name: make for name, make in baselines_of(env_id).items() if name != "random"} | dict(baselines)


def make_controller(name: str, env_id: str, options: Mapping[str, Any] | None = None) -> Any:
    """A baseline by name, or a class of your own as "module:Class".

    Args:
        name: one of `baselines_of(env_id, options)`, or "module:Class"; the module is looked up on the path and in the
            working directory, the class is called without arguments.
        env_id: Gymnasium id of the environment that it will control, with or without "tensegrity/".
        options: of that environment.

    Raises:
        ValueError: there is no such controller, or it cannot be made; the message says what there is.
    """
    env_id = full_id(env_id)
    baselines = baselines_of(env_id, options)
    if name in baselines:
        env = unwrapped(gym.make(env_id, **(options or {})))
        return baselines[name](env.core)
    if ":" not in name:
        close = get_close_matches(name, baselines, 1)
        hint = f"did you mean {close[0]!r}? There" if close else "there"
        raise ValueError(f"controller {name!r}: {hint} are {', '.join(baselines)}, or your own class as 'module:Class'")
    module_name, _, class_name = name.partition(":")
    try:
        module = own_module(module_name)
    except ImportError as error:
        raise ValueError(f"controller {name!r}: {error}") from error
    made = getattr(module, class_name, None)
    if not callable(made):
        classes = [key for key, value in vars(module).items() if isinstance(value, type)]
        raise ValueError(
            f"controller {name!r}: {module_name} has no class {class_name!r}; "
            f"it has {', '.join(classes) or 'no classes'}"
        )
    try:
        controller = made()
    except Exception as error:
        raise ValueError(
            f"controller {name!r}: {class_name}(), called without arguments, raises {type(error).__name__}: {error}"
        ) from error
    if not callable(getattr(controller, "predict", None)):
        raise ValueError(
            f"controller {name!r}: it has no predict(observation, state, episode_start, deterministic) method"
        )
    return controller
