"""Linear models of environments and mechanisms about a posture, for the tools of control theory.

    x[k+1] = A x[k] + B a[k],    y[k] = C x[k] + D a[k]

All are deviations from the posture. One k is one step of the environment, `a` its action, `y` what it calls
"achieved_goal". The state x holds the configuration, in dynamics its velocity and the actuators that lag, and the
inputs (tensions, free lengths or lengths), which actions increment. Bounds, noise, delays and dry friction are no part
of it.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Components
from tensegrity_envs.core import Core
from tensegrity_envs.mechanics.designs import resolve_design
from tensegrity_envs.simulation.dynamic import DynamicControl
from tensegrity_envs.simulation.protocol import RUNNING

_STEP = 1e-6  # of central differences, in units of the design; their error is of the order of its square
_STILL = 1e-6  # of the residual, over the largest stiffness: the posture is then an equilibrium


class LinearModel(NamedTuple):
    """A linear model in discrete time, for m states, k actions and p outputs; unpacks as `A, B, C, D, *_`.

    Attributes:
        A: shape (m, m).
        B: shape (m, k).
        C: shape (p, m).
        D: shape (p, k), zero: an output tells of the state before the action.
        dt: time of a step [s]; None in quasi-static models, where a step takes no given time.
        state: about which it was made, shape (m,).
        output: there, shape (p,).
        state_names: of the entries of the state.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    dt: float | None
    state: np.ndarray
    output: np.ndarray
    state_names: tuple[str, ...]

    def to_control(self) -> Any:
        """The same as a `StateSpace` of python-control, in discrete time.

        Its `dt` is that of the model, or True (discrete, of unspecified step) where that is None. Its inputs are called
        a1, a2, ..., its outputs y1, y2, ..., its states as here.

        Raises:
            ImportError: the package `control` is not installed.
        """
        try:
            import control
        except ImportError as error:
            raise ImportError("to_control needs python-control: pip install 'tensegrity-envs[control]'") from error
        names = {"inputs": _named("a", self.B.shape[1]), "outputs": _named("y", len(self.C))}
        matrices = (self.A, self.B, self.C, self.D)
        return control.ss(*matrices, self.dt or True, states=list(self.state_names), **names)


def linearize(
    env: Any,
    posture: Sequence[float] | None = None,
    inputs: Sequence[float] | None = None,
    load: Sequence[float] | None = None,
    design: Any = None,
) -> LinearModel:
    """A linear model of an environment or a mechanism about a posture.

    Quasi-static models come from the sensitivities of the equilibrium, dq / du = -K^-1 dg / du with the stiffness
    matrix K and the energy gradient g; dynamic ones from MuJoCo's `mjd_transitionFD`, reduced to the free joints and
    chained over the time steps of a step.

    Args:
        env: an environment (wrappers are looked through), its `Core`, or an analytic mechanism, whose actions are the
            increments of its inputs themselves.
        posture: configuration [rad], an equilibrium; None for that of the environment at this moment.
        inputs: that hold it, tensions [N] or lengths [m]; None for the usual ones.
        load: at the tip [N]; None for none, or without a posture for that of the present episode.
        design: of an environment's mechanism, see `mechanics.designs.resolve_design`; None for the nominal one, or
            without a posture for that of the episode.

    Returns:
        The model.

    Raises:
        ValueError: sizes are wrong, a number is not finite, the posture is beyond the joint limits or no stable
            equilibrium under these inputs and load, the inputs must be told, or inputs or a load are given where
            actions turn the joints themselves.
        TypeError: the design is none, or one of another mechanism.
    """
    core: Core | None
    env = getattr(env, "unwrapped", env)
    core = env if isinstance(env, Core) else getattr(env, "core", None)
    if core is None and not hasattr(env, "stiffness_matrix"):
        raise ValueError(f"linearize: {type(env).__name__} is neither an environment, nor its core, nor a mechanism")
    if core is not None and (design is not None or posture is not None):
        design = resolve_design(design, core.design)
    if core is not None and not hasattr(core.simulation, "actuation"):
        for name, value in (("inputs", inputs), ("load", load)):
            if value is not None:
                raise ValueError(
                    f"linearize: {name} = {value!r}: must not be given in joint control, where actions turn the joints "
                    "themselves and nothing depends on it"
                )
    is_told = posture is not None
    if posture is None:
        if core is None or not hasattr(env, "get_state"):
            raise ValueError("linearize: posture must be given unless the environment runs an episode")
        state = core.outcomes.unpack(env.get_state()["outcome"][:, 0]).state
        episode = env.episode
        design = episode.design if design is None else design
        posture = tuple(state.configuration)
        inputs = tuple(state.inputs) if inputs is None and state.inputs else inputs
        load = tuple(episode.load_at(state.time)) or None if load is None else load
    mechanism = env if core is None else core.mechanism(design)
    q = _numbers("posture", posture)
    if is_told:  # dynamics may carry a running arm beyond
        _check_limits(mechanism, q)
    force = None if load is None else _numbers("load", load)
    given = None if inputs is None else _numbers("inputs", inputs)
    if core is None:
        if given is None:
            raise ValueError("linearize: of a mechanism, the inputs must be given, too")
        return _quasi_static(mechanism, _Own(), q, given, force)
    control: Any = core.simulation
    if isinstance(control, DynamicControl):
        return _dynamic(core, mechanism, q, _usual(core, mechanism, q, given, force), force)
    if not hasattr(control, "actuation"):
        return _kinematic(core, mechanism, q)
    goal = None
    if type(core).achieved is not Core.achieved:  # more than the tip

        def goal(here: np.ndarray, inputs: np.ndarray) -> Any:
            rest = control.at_rest(mechanism, _components(here), _components(inputs), force, 0.0)
            return core.achieved(rest)

    return _quasi_static(mechanism, control, q, _usual(core, mechanism, q, given, force), force, goal)


class _Own:
    """The inputs of a mechanism as those of a simulation: an action is an increment."""

    rate = 1.0

    def actuation(self, mechanism: Any, inputs: Components) -> Components:
        return inputs


def _numbers(name: str, values: Sequence[float]) -> np.ndarray:
    try:
        array = np.array(values, float)
    except (TypeError, ValueError):
        array = np.full(1, np.nan)
    if array.ndim != 1 or not np.isfinite(array).all():
        raise ValueError(f"linearize: {name} = {values!r}: must be finite numbers")
    return array


def _check_limits(mechanism: Any, q: np.ndarray) -> None:
    if q.size and hasattr(mechanism, "is_within_limits") and not mechanism.is_within_limits(_components(q)):
        limit = float(mechanism.design.joint_limit)
        raise ValueError(f"linearize: posture = {q.tolist()}: beyond the joint limits, {limit:.6g} rad")


def _usual(core: Core, mechanism: Any, q: np.ndarray, inputs: np.ndarray | None, load: np.ndarray | None) -> np.ndarray:
    """The inputs: those given, or those with which the environment starts an arm in q."""
    if inputs is not None:
        return inputs
    control: Any = getattr(core.simulation, "control", core.simulation)
    if hasattr(control, "usual_inputs"):
        force = (0.0,) * len(core.episodes.rows.goal) if load is None else tuple(load.tolist())
        return np.array(control.usual_inputs(mechanism, tuple(q.tolist()), force), float)
    if load is not None:
        raise ValueError("linearize: under a load, the inputs must be given")
    return np.array(mechanism.unloaded_lengths(tuple(q[:3].tolist())), float)


def _slopes(function: Callable[[np.ndarray], Any], at: np.ndarray, step: float = _STEP) -> np.ndarray:
    """Jacobian by central differences, shape (outputs, inputs)."""
    columns = [
        (np.array(function(at + step * e), float) - np.array(function(at - step * e), float)) / (2 * step)
        for e in np.eye(len(at))
    ]
    return np.stack(columns, axis=-1)


def _quasi_static(
    mechanism: Any,
    control: Any,
    q: np.ndarray,
    u: np.ndarray,
    load: np.ndarray | None,
    goal: Callable[[np.ndarray, np.ndarray], Any] | None = None,
) -> LinearModel:
    """States (configuration, inputs): the configuration follows the inputs at once. Output: the goal, or the tip."""

    def seen(here: np.ndarray, inputs: np.ndarray) -> Any:
        return _tip(mechanism, control, here, inputs) if goal is None else goal(here, inputs)

    force = (0.0,) * len(_tip(mechanism, control, q, u)) if load is None else _components(load)
    response = _response(mechanism, control, q, u, force)
    n, m = len(q), len(u)
    rate = float(control.rate)
    by_q, by_u = _slopes(lambda value: seen(value, u), q), _slopes(lambda value: seen(q, value), u)
    a = np.block([[np.zeros((n, n)), response], [np.zeros((m, n)), np.eye(m)]])
    b = rate * np.vstack([response, np.eye(m)])
    c = np.hstack([by_q, by_u])
    output = np.array(seen(q, u), float)
    names = (*_named("q", n), *_named("u", m))
    return LinearModel(a, b, c, np.zeros((len(output), m)), None, np.concatenate([q, u]), output, names)


def _named(letter: str, count: int) -> tuple[str, ...]:
    return tuple(f"{letter}{i}" for i in range(1, count + 1))


def _components(values: np.ndarray) -> tuple[float, ...]:
    return tuple(values.tolist())


def _tip(mechanism: Any, control: Any, q: np.ndarray, u: np.ndarray) -> Any:
    return mechanism.tip(_components(q), control.actuation(mechanism, _components(u)))


def _response(mechanism: Any, control: Any, q: np.ndarray, u: np.ndarray, load: Components) -> np.ndarray:
    """How the equilibrium moves with the inputs, dq / du, shape (n, inputs)."""

    def actuation(inputs: np.ndarray) -> Any:
        return control.actuation(mechanism, _components(inputs))

    if hasattr(mechanism, "locked_pose"):  # lengths are imposed, the orientation w alone is elastic
        w = q[3:]
        gradient, hessian = mechanism.statics(_components(w), actuation(u), load)

        def gradient_of(inputs: np.ndarray) -> Any:
            return mechanism.statics(_components(w), actuation(inputs), load)[0]

        def placed(turn: np.ndarray, inputs: np.ndarray) -> Any:
            return (*mechanism.locked_pose(_components(turn), actuation(inputs)).position, *turn.tolist())

        if abs(np.array(placed(w, u), float) - q).max() > _STILL * mechanism.reach:
            raise ValueError(f"linearize: posture = {q.tolist()} does not have the lengths {u.tolist()} m")
        turn_by_u = _solved(np.array(hessian, float), np.array(gradient, float), _slopes(gradient_of, u))
        by_lengths, by_turn = _slopes(lambda value: placed(w, value), u), _slopes(lambda value: placed(value, u), w)
        return np.asarray(by_lengths + by_turn @ turn_by_u)
    here = _components(q)
    gradient = mechanism.energy_gradient(here, actuation(u), load)
    hessian = mechanism.stiffness_matrix(here, actuation(u), load)
    by_u = _slopes(lambda value: mechanism.energy_gradient(here, actuation(value), load), u)
    return _solved(np.array(hessian, float), np.array(gradient, float), by_u)


def _solved(hessian: np.ndarray, gradient: np.ndarray, by_u: np.ndarray) -> np.ndarray:
    """-K^-1 dg / du.

    Raises:
        ValueError: it is no stable equilibrium.
    """
    if np.linalg.norm(gradient) > _STILL * abs(hessian).max():
        raise ValueError(
            f"linearize: the posture is no equilibrium under these inputs and load (energy gradient {gradient.tolist()}"
            " N m)"
        )
    if not np.linalg.eigvalsh((hessian + hessian.T) / 2)[0] > 0:
        raise ValueError("linearize: the posture is not stable under these inputs and load")
    return np.asarray(-np.linalg.solve(hessian, by_u))


def _kinematic(core: Core, mechanism: Any, q: np.ndarray) -> LinearModel:
    """Where actions turn the joints themselves: the configuration is the state."""
    control: Any = core.simulation
    zero = np.zeros(core.simulation.action_size)
    here = _components(q)
    state = control.start(mechanism, None, here)
    if state.failure != RUNNING:
        raise ValueError(f"linearize: posture = {q.tolist()} is not feasible")
    h = 1e-3  # the increments are linear in the actions

    def moved(action: np.ndarray) -> Any:
        return control.advance(mechanism, None, state, _components(action)).configuration

    def achieved(values: np.ndarray) -> Any:
        return core.achieved(control.start(mechanism, None, _components(values)))

    b = _slopes(moved, zero, h)
    output = np.array(achieved(q), float)
    d = np.zeros((len(output), len(zero)))
    return LinearModel(np.eye(len(q)), b, _slopes(achieved, q), d, None, q, output, _named("q", len(q)))


def _dynamic(core: Core, mechanism: Any, q: np.ndarray, u: np.ndarray, load: np.ndarray | None) -> LinearModel:
    """States (coordinates, their velocities, actuators that lag, inputs)."""
    from tensegrity_envs.simulation.mujoco.linearizing import linearize as linear_motion
    from tensegrity_envs.simulation.mujoco.model import MujocoModel

    assert core.dynamics is not None and core.engine is not None and isinstance(core.simulation, DynamicControl)
    control: Any = core.simulation
    smooth = replace(core.dynamics, joint_friction=0.0)
    is_own = mechanism.design == core.design and smooth == core.dynamics
    model = core.engine.model if is_own else MujocoModel(mechanism, smooth)
    coordinates = np.array(control.coordinates(mechanism, _components(q), _components(u)), float)
    actuation = np.array(control.actuation(mechanism, _components(u)), float)
    force = np.zeros(model.linkage.space) if load is None else load
    if len(force) != model.linkage.space:
        raise ValueError(f"linearize: load = {force.tolist()}: must be {model.linkage.space} numbers")
    state = model.state(coordinates, None, actuation)
    after, diverged = model.advance(state, actuation, force)
    drift = np.inf if diverged else abs(model.configuration(after) - coordinates).max()
    if not drift < 1e-4:
        raise ValueError(
            f"linearize: the posture is no equilibrium of the dynamics under these inputs and load: within a step it "
            f"moves by {drift:.3g} rad"
        )
    motion, time = linear_motion(model, coordinates, actuation, force, "soft"), smooth.step_time
    joints, m = len(coordinates), len(u)
    by_u = _slopes(lambda value: control.actuation(mechanism, _components(value)), u)
    # Ramped actuators have reached their commands at the end of a step; their controls are (command - reached) / time.
    n = 2 * joints if model.is_ramped else len(motion.a)
    free, driven = motion.a[:n, :n], motion.b[:n] / (time if model.is_ramped else 1.0)
    drive = driven @ by_u
    a = np.block([[free, drive], [np.zeros((m, n)), np.eye(m)]])
    if model.is_ramped:  # what they have reached is the inputs of the step before
        a[:n, n:] += (motion.a[:n, n:] - driven) @ by_u
    b = float(core.simulation.rate) * np.vstack([drive, np.eye(m)])
    tip = _slopes(lambda value: model.tip(model.state(value)), coordinates)
    c = np.hstack([tip, np.zeros((len(tip), n + m - joints))])
    lag = n - 2 * joints
    names = (*_named("q", joints), *_named("v", joints), *_named("actuator", lag), *_named("u", m))
    reached = actuation if lag else np.zeros(0)
    x = np.concatenate([coordinates, np.zeros(joints), reached, u])
    output = model.tip(model.state(coordinates))
    return LinearModel(a, b, c, np.zeros((len(c), m)), time, x, output, names)
