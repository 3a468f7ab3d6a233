"""Controllers: whatever has `predict(observation, state, episode_start, deterministic)`, by name."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import gymnasium as gym

from tensegrity_agents.controllers import dual_triangle, n_x, planar_four_bar, spatial_prism, two_x
from tensegrity_agents.controllers.dynamic import Feedback, Ramp
from tensegrity_agents.controllers.dynamic_servo import RestingRamp
from tensegrity_agents.controllers.planar_four_bar.dynamic import DampedFeedback, PlannedPath
from tensegrity_agents.controllers.random import RandomController
from tensegrity_agents.controllers.regulated import Regulated, Shaped
from tensegrity_agents.controllers.spatial_prism.dynamic import CurveTracking, TrackingFeedback
from tensegrity_agents.controllers.two_x import posture
from tensegrity_agents.own_modules import own_module
from tensegrity_envs.core import Core

__all__ = ["BASELINES", "DYNAMIC", "baselines_of", "make_controller", "register_baselines", "teachers_of"]

# By the name of the environment's arm (tensegrity_envs.environments), then by their own: how to make each for a core.
BASELINES: dict[str, dict[str, Callable[[Core], Any]]] = {
    "TwoXReach": {
        "closed_form_ik": two_x.ClosedFormIK,
        "pseudo_inverse": two_x.PseudoInverse,
        "observer": two_x.Observer,
        "servo": two_x.Servo,
        "identifying_observer": two_x.IdentifyingObserver,
        "oracle": two_x.Oracle,
    },
    "TwoXPostureChange": {
        "pseudo_inverse": posture.PseudoInverse,
        "straight_path": posture.StraightPath,
        "planner": posture.Planner,
    },
    "DualTriangleReach": {
        "closed_form_sum": dual_triangle.ClosedFormSum,
        "closed_form_max": dual_triangle.ClosedFormMax,
        "closed_form_squares": dual_triangle.ClosedFormSquares,
        "pseudo_inverse": dual_triangle.PseudoInverse,
        "observer": dual_triangle.Observer,
        "servo": dual_triangle.Servo,
        "identifying_observer": dual_triangle.IdentifyingObserver,
        "oracle": dual_triangle.Oracle,
    },
    "DualTrianglePush": {
        "closed_form": dual_triangle.HoldInputs,
        "pseudo_inverse": dual_triangle.PushPseudoInverse,
        "observer": dual_triangle.PushObserver,
        "oracle": dual_triangle.PushOracle,
    },
    "PlanarFourBarReach": {
        "closed_form_ik": planar_four_bar.ClosedFormIK,
        "pseudo_inverse": planar_four_bar.PseudoInverse,
        "observer": planar_four_bar.Observer,
        "oracle": planar_four_bar.Oracle,
    },
    "SpatialPrismTrack": {
        "closed_form_ik": spatial_prism.ClosedFormIK,
        "pseudo_inverse": spatial_prism.PseudoInverse,
        "observer": spatial_prism.Observer,
        "oracle": spatial_prism.Oracle,
    },
    "NXReach": {
        "closed_form_ik": n_x.ClosedFormIK,
        "pseudo_inverse": n_x.PseudoInverse,
        "observer": n_x.Observer,
        "oracle": n_x.Oracle,
    },
}

# The same of the dynamic environments: quasi-static controllers, led along ramps, shaped or damped.
DYNAMIC: dict[str, dict[str, Callable[[Core], Any]]] = {
    "TwoXReach": {
        "closed_form_ramp": partial(Ramp, base=two_x.ClosedFormIK),
        "pseudo_inverse": partial(Feedback, base=two_x.PseudoInverse, slowed=0.1),
        "oracle": partial(Ramp, base=two_x.Oracle),
    },
    "DualTriangleReach": {
        "closed_form_ramp": partial(Ramp, base=dual_triangle.ClosedFormSquares),
        "pseudo_inverse": partial(Feedback, base=dual_triangle.PseudoInverse),
        "observer": partial(Ramp, base=dual_triangle.Observer),
        "identifying_observer": partial(RestingRamp, base=dual_triangle.Observer),
        "oracle": partial(Ramp, base=dual_triangle.Oracle),
    },
    "PlanarFourBarReach": {
        "closed_form_ik": partial(PlannedPath, base=planar_four_bar.ClosedFormIK, pace="full", damped=False),
        "closed_form_shaped": partial(PlannedPath, base=planar_four_bar.ClosedFormIK, pace="shaped", damped=False),
        "closed_form_damped": partial(PlannedPath, base=planar_four_bar.ClosedFormIK, pace="full"),
        "closed_form_ramp": partial(PlannedPath, base=planar_four_bar.ClosedFormIK),
        "pseudo_inverse": partial(DampedFeedback, base=planar_four_bar.PseudoInverse),
    },
    "SpatialPrismTrack": {
        "closed_form_ik": partial(CurveTracking, base=spatial_prism.ClosedFormIK, damped=False),
        "closed_form_shaped": partial(CurveTracking, base=spatial_prism.ClosedFormIK, pace="shaped", damped=False),
        "closed_form_damped": partial(CurveTracking, base=spatial_prism.ClosedFormIK),
        "pseudo_inverse": partial(TrackingFeedback, base=spatial_prism.PseudoInverse),
        "oracle": partial(CurveTracking, base=spatial_prism.Oracle),
    },
    "NXReach": {
        "closed_form_ramp": partial(Ramp, base=n_x.ClosedFormIK),
        "pseudo_inverse": partial(Feedback, base=n_x.PseudoInverse, slowed=0.1),
        "oracle": partial(Ramp, base=n_x.Oracle),
    },
}

# Fast tasks: the same, at full speed, too; ramps that wait for rest would be too late there.
DYNAMIC["TwoXFastReach"] = {
    "closed_form_ramp": partial(Ramp, base=two_x.ClosedFormIK),
    "pseudo_inverse": partial(Feedback, base=two_x.PseudoInverse, slowed=0.1),
    "closed_form_shaped": partial(Shaped, base=two_x.ClosedFormIK),
    "lqr": partial(Regulated, base=two_x.Observer, shaper=None, softness=10.0),
    "oracle": partial(Regulated, base=two_x.Oracle, shaper=None, softness=10.0),
}
DYNAMIC["DualTriangleFastReach"] = {
    "closed_form_ramp": partial(Ramp, base=dual_triangle.ClosedFormSquares),
    "pseudo_inverse": partial(Feedback, base=dual_triangle.PseudoInverse),
    "observer": partial(Ramp, base=dual_triangle.Observer),
    "closed_form_shaped": partial(Shaped, base=dual_triangle.ClosedFormSquares),
    "lqr": partial(Regulated, base=dual_triangle.Observer),
    "oracle": partial(Regulated, base=dual_triangle.Oracle),
}

# Those that are registered for one id, by that id.
_OWN: dict[str, dict[str, Callable[[Core], Any]]] = {}

# Those that only teach agents (sb3.teacher_student), beside the baselines, by the name of the arm.
TEACHERS: dict[str, dict[str, Callable[[Core], Any]]] = {
    "TwoXReach": {"careful_oracle": two_x.CarefulOracle},
    "NXReach": {"careful_oracle": n_x.CarefulOracle},
}


def teachers_of(env_id: str) -> dict[str, Callable[[Core], Any]]:
    """What can teach an agent in an environment, by name: its planners that are told the truth, its other baselines,
    and those that only teach.
    """
    baselines = {name: make for name, make in baselines_of(env_id).items() if name != "random"}
    return baselines | TEACHERS.get(gym.spec(env_id).kwargs["arm"], {})


def baselines_of(env_id: str) -> dict[str, Callable[[Core], Any]]:
    """The baselines of an environment by name, the strongest last but for the random one."""
    kwargs = gym.spec(env_id).kwargs
    table = DYNAMIC if kwargs.get("backend", "quasi_static") == "mujoco" else BASELINES
    found = _OWN.get(env_id) or table.get(kwargs["arm"], {})
    return found | {"random": RandomController}


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
        name: one of `baselines_of(env_id)`, or "module:Class"; the module is looked up on the path and in the working
            directory, the class is called without arguments.
        env_id: Gymnasium id of the environment that it will control.
        options: of that environment.

    Raises:
        ValueError: there is no such controller, or it cannot be made; the message says what there is.
    """
    baselines = baselines_of(env_id)
    if name in baselines:
        env: Any = gym.make(env_id, **(options or {})).unwrapped
        return baselines[name](env.core)
    if ":" not in name:
        raise ValueError(f"controller {name!r}: there are {', '.join(baselines)}, or your own class as 'module:Class'")
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
