"""A mechanism as a dynamic simulation in MuJoCo.

Configurations q [rad], inputs (tensions [N], free or actuator lengths [m]) and loads (dead force at the tip (fx, fy)
or (fx, fy, fz) [N]) are those of the analytic mechanism; where that has prismatic actuators, configurations are the
coordinates of its skeleton (`simulation.skeleton`). Prismatic actuators move evenly from where they are to their
command within a step. Many simulations are rows: arrays of shape (m, ...). A state is a row of numbers (time,
joint angles, their rates, actuator states) from which the simulation goes on, to the bit, wherever it is put.
"""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from tensegrity_envs.simulation.mujoco.building import TIP_BODY, build, input_members
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.simulation.mujoco.linkage import Linkage
from tensegrity_envs.simulation.mujoco.platform import Platform
from tensegrity_envs.simulation.skeleton import PrismSkeleton, skeleton_of

_FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS
_CONTROL = int(mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_XFRC_APPLIED)
_WARNING = mujoco.mjtWarning
_DIVERGED = tuple(int(w) for w in (_WARNING.mjWARN_BADQPOS, _WARNING.mjWARN_BADQVEL, _WARNING.mjWARN_BADQACC))
_RAMPED = int(mujoco.mjtDyn.mjDYN_INTEGRATOR)
_SLOWEST = 10.0  # [rad/s], a low frequency: an arm that is let go has a speed of about the way times this
_FASTEST = 1e6  # [rad/s]: joints of a real arm are far slower; faster has diverged


def _note(message: str) -> None:
    """What MuJoCo warns of, but for divergence, which is told in another way."""
    if "unstable" not in message:
        sys.stderr.write(f"MuJoCo: {message}\n")


@contextmanager
def _without_log() -> Iterator[None]:
    """Keep MuJoCo from writing its warnings of divergence to the terminal and to MUJOCO_LOG.TXT."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_note)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


class Settled(NamedTuple):
    """Where an arm comes to rest.

    Attributes:
        configuration: [rad], shape (n,).
        loop_error: see `MujocoModel.loop_error` [m].
        acceleration: largest of a joint's, left [rad/s2].
        steps: time steps taken.
        reason: "at rest", "diverged", or "not at rest after ... steps".
    """

    configuration: np.ndarray
    loop_error: float
    acceleration: float
    steps: int
    reason: str


class RolloutResult(NamedTuple):
    """States after a rollout.

    Attributes:
        states: shape (m, state size); of a simulation that diverged, those from before the rollout.
        diverged: shape (m,).
    """

    states: np.ndarray
    diverged: np.ndarray


class MujocoModel:
    """One mechanism with one set of parameters, compiled.

    Args:
        mechanism: an analytic mechanism of one design.
        dynamics: what it does not tell.

    Raises:
        ValueError: the mechanism is a batch of designs, the time step is too long for its loops, or its actuators
            cannot lag.

    Attributes:
        skeleton: what of the mechanism moves; its coordinates are the configurations.
        linkage: its bodies, hinges and loops.
        spec: the MjSpec.
        model: the MjModel.
        data: the MjData of `reset` and `step`.
        state_size: numbers in a state.
        input_size: numbers in an input.
        input_bounds: lowest and highest inputs, shape (2, input size); MuJoCo keeps what lies outside at the bound.
    """

    def __init__(self, mechanism: Any, dynamics: Dynamics | None = None) -> None:
        self.mechanism = mechanism
        self.dynamics = dynamics or Dynamics()
        self.skeleton = skeleton_of(mechanism)
        self.linkage: Any = (Platform if isinstance(self.skeleton, PrismSkeleton) else Linkage)(self.skeleton)
        if self.linkage.loops and self.dynamics.timestep > 0.001:
            raise ValueError(
                f"Dynamics.timestep = {self.dynamics.timestep!r}: must be 0.001 s or less for a mechanism with loops, "
                "whose joint limits cannot keep them assembled otherwise"
            )
        self.spec = build(self.skeleton, self.linkage, self.dynamics)
        self.model = self.spec.compile()
        self.data = mujoco.MjData(self.model)
        self._scratch = mujoco.MjData(self.model)
        names = [self.model.joint(i).name for i in range(self.model.njnt)]
        if names != list(self.linkage.joints):
            raise AssertionError(f"joints {names} are not in the order of the linkage")
        self._inputs = input_members(self.skeleton.members)
        self._tip = self.model.body(TIP_BODY).id
        self.state_size = int(mujoco.mj_stateSize(self.model, int(_FULL)))
        self.input_size = int(self.model.nu)
        self._is_ramped = bool((self.model.actuator_dyntype == _RAMPED).any())
        ranges = self.model.actuator_actrange if self._is_ramped else self.model.actuator_ctrlrange
        self.input_bounds = ranges.T.copy()
        nq, nv, na = int(self.model.nq), int(self.model.nv), int(self.model.na)
        self._angles, self._rates = slice(1, 1 + nq), slice(1 + nq, 1 + nq + nv)  # after the time
        self._actuators = slice(1 + nq + nv, 1 + nq + nv + na)
        self._weights = self.model.body_mass * (1 - self.model.body_gravcomp) * -self.model.opt.gravity[2]
        tip = 6 * self._tip + self.input_size
        self._axes = [0, 2] if self.linkage.space == 2 else [0, 1, 2]  # of MuJoCo, of the mechanism's positions
        self._load_columns = [tip + i for i in self._axes]  # of a control: the inputs, then 6 numbers for every body
        self._control_size = self.input_size + 6 * int(self.model.nbody)
        self._pools: dict[int, tuple[Rollout, list[Any]]] = {}
        self.reset(np.zeros(self.linkage.size))

    # ----------------------------------------------------------------------------------------------------- checking

    def _check(self, name: str, value: Any, size: int) -> np.ndarray:
        array = np.asarray(value, float)
        if array.shape[-1:] != (size,):
            raise ValueError(f"{name} of shape {array.shape}: must be ({size},) or (m, {size})")
        if not np.isfinite(array).all():
            raise ValueError(f"{name} = {value!r}: must be finite numbers")
        return array

    def _check_configuration(self, q: Any) -> np.ndarray:
        array = self._check("configuration", q, self.linkage.size)
        if (abs(array) > self.linkage.limit + 1e-9).any():
            raise ValueError(f"configuration = {q!r}: |q| must be at most {self.linkage.limit:.4g} rad")
        return array

    def _check_load(self, load: Any) -> np.ndarray:
        return np.zeros(self.linkage.space) if load is None else self._check("load", load, self.linkage.space)

    def _check_inputs(self, inputs: Any) -> np.ndarray:
        array = self._check("inputs", inputs, self.input_size)
        low, high = self.input_bounds
        if (array < low - 1e-9).any() or (array > high + 1e-9).any():
            raise ValueError(f"inputs = {inputs!r}: must be within {low.tolist()} and {high.tolist()}")
        return array

    # ------------------------------------------------------------------------------------------------------- states

    def state(self, q: Any, velocity: Any = None, inputs: Any = None, time: float = 0.0) -> np.ndarray:
        """The state in which every loop is exactly closed.

        Args:
            q: configuration [rad], shape (n,) or (m, n).
            velocity: of q [rad/s], like q; None for rest.
            inputs: that the actuators have reached, where that takes time; None for the lowest. Shape (input size,) or
                (m, input size).
            time: since the start [s].

        Returns:
            Shape (state size,) or (m, state size).

        Raises:
            ValueError: a shape is wrong, a number is not finite, or a configuration is beyond the joint limits.
        """
        q = self._check_configuration(q)
        states = np.zeros((*q.shape[:-1], self.state_size))
        states[..., 0] = time
        states[..., self._angles] = self.linkage.joint_angles(q)
        if velocity is not None:
            velocity = np.broadcast_to(self._check("velocity", velocity, self.linkage.size), q.shape)
            for place in np.ndindex(q.shape[:-1]):
                states[place][self._rates] = self.linkage.rates_of(states[place][self._angles], velocity[place])
        if self.model.na:
            low = self.input_bounds[0] if inputs is None else self._check_inputs(inputs)
            states[..., self._actuators] = low
        return states

    def joint_angles(self, states: np.ndarray) -> np.ndarray:
        """MuJoCo's coordinates: angles of the hinges [rad], shape (..., hinges); of a platform see `Platform`."""
        return states[..., self._angles]

    def configuration(self, states: np.ndarray) -> np.ndarray:
        """The configuration [rad], shape (..., n)."""
        return np.asarray(self.linkage.configuration(states[..., self._angles]))

    def velocity(self, states: np.ndarray) -> np.ndarray:
        """The rate of the configuration [rad/s], shape (..., n)."""
        return np.asarray(self.linkage.velocity(states[..., self._angles], states[..., self._rates]))

    def nodes(self, states: np.ndarray) -> dict[str, tuple[np.ndarray, ...]]:
        """Positions (x, y) or (x, y, z) of the nodes [m], each of shape (...,)."""
        found = self.linkage.positions(states[..., self._angles])
        if self.linkage.space == 3:
            return {name: tuple(np.moveaxis(place, -1, 0)) for name, place in found.items()}
        return {name: (z.real, z.imag) for name, z in found.items()}

    def tip(self, states: np.ndarray) -> np.ndarray:
        """Position of the tip [m], shape (..., 2) or (..., 3)."""
        return np.stack(self.nodes(states)["P"], axis=-1)

    def loop_error(self, states: np.ndarray) -> np.ndarray:
        """How far apart the two sides of the worst closed loop are [m], shape (...,)."""
        return np.asarray(self.linkage.loop_error(states[..., self._angles]))

    def assembly_error(self, states: np.ndarray) -> np.ndarray:
        """Largest |left right / (l^2 - b^2) - 1| of the X-joints [-]: beyond 0.05 a loop is flipping or has flipped."""
        return np.asarray(self.linkage.assembly_error(states[..., self._angles]))

    # -------------------------------------------------------------------------------------------- one simulation

    def reset(self, q: Any, velocity: Any = None, inputs: Any = None) -> np.ndarray:
        """Put `data` into the exactly closed state of `state`, and return that."""
        state = self.state(np.asarray(q, float).reshape(-1), velocity, inputs)
        self._load(self.data, state)
        return state

    def current(self) -> np.ndarray:
        """The state of `data`."""
        state = np.empty(self.state_size)
        mujoco.mj_getState(self.model, self.data, state, int(_FULL))
        return state

    def step(self, inputs: Any, load: Sequence[float] | None = None, steps: int | None = None) -> bool:
        """Advance `data`.

        Args:
            inputs: the command, held meanwhile; beyond its bounds it saturates.
            load: at the tip [N].
            steps: time steps; None for the frame skip of the dynamics.

        Returns:
            Whether it went well; False where it diverged, and `data` is then as before.

        Raises:
            ValueError: a shape is wrong or a number is not finite.
        """
        data = self.data
        before = self.current()
        steps = steps or self.dynamics.frame_skip
        data.ctrl[:] = self._controls(self._check("inputs", inputs, self.input_size), before, steps)
        data.xfrc_applied[self._tip, self._axes] = self._check_load(load)
        data.qacc_warmstart[:] = 0.0  # a state tells all: the same steps follow, to the bit, in `rollout`
        with _without_log():
            mujoco.mj_step(self.model, data, nstep=steps)
        if self._has_diverged(data):
            self._load(data, before)
            return False
        mujoco.mj_kinematics(self.model, data)  # what is read from data is otherwise one time step old
        return True

    def _controls(self, inputs: np.ndarray, states: np.ndarray, steps: int) -> np.ndarray:
        """MuJoCo's controls: the inputs, or the speeds [m/s] at which ramped actuators reach them in so many steps."""
        if not self._is_ramped:
            return inputs
        return np.asarray((inputs - states[..., self._actuators]) / (steps * self.dynamics.timestep))

    def _load(self, data: Any, state: np.ndarray) -> None:
        mujoco.mj_resetData(self.model, data)
        mujoco.mj_setState(self.model, data, np.ascontiguousarray(state), int(_FULL))
        mujoco.mj_kinematics(self.model, data)

    def _has_diverged(self, data: Any) -> bool:
        warned = any(data.warning[w].number for w in _DIVERGED)
        return warned or not (abs(data.qvel) < _FASTEST).all()  # NaN compares as False

    def advance(self, state: np.ndarray, inputs: np.ndarray, load: np.ndarray, model: Any = None) -> RolloutResult:
        """One simulation of `rollout`, to the bit, without its checks: rolling out costs more than a step's physics.

        Args:
            state: shape (state size,).
            inputs: the command, shape (input size,).
            load: at the tip [N], shape (2,), in space (3,).
            model: from `variant`; None for this one.
        """
        model, data = self.model if model is None else model, self._scratch
        mujoco.mj_resetData(model, data)
        mujoco.mj_setState(model, data, state, int(_FULL))
        data.ctrl[:] = self._controls(inputs, state, self.dynamics.frame_skip)
        data.xfrc_applied[self._tip, self._axes] = load
        with _without_log():
            mujoco.mj_step(model, data, nstep=self.dynamics.frame_skip)
        diverged = self._has_diverged(data)
        after = state.copy()
        if not diverged:
            mujoco.mj_getState(model, data, after, int(_FULL))
        return RolloutResult(after, np.array(diverged))

    # ---------------------------------------------------------------------------------------------- many simulations

    def rollout(
        self,
        states: np.ndarray,
        inputs: Any,
        loads: Any = None,
        steps: int | None = None,
        nthread: int = 1,
        models: Sequence[Any] | None = None,
    ) -> RolloutResult:
        """The states some time steps later, each as `step` finds it, to the bit, with any number of threads.

        Args:
            states: shape (m, state size).
            inputs: the commands, held meanwhile; shape (input size,) or (m, input size).
            loads: at the tip [N], shape (2,) or (m, 2), in space (3,) or (m, 3).
            steps: time steps; None for the frame skip of the dynamics.
            nthread: threads that share the simulations.
            models: MuJoCo's model of every simulation, each from `variant`; None for this one.

        Raises:
            ValueError: a shape is wrong or a number is not finite.
        """
        states = self._check("states", states, self.state_size)
        if states.ndim != 2:
            raise ValueError(f"states of shape {states.shape}: must be (m, {self.state_size})")
        if nthread < 1:
            raise ValueError(f"nthread = {nthread!r}: must be 1 or more")
        steps = steps or self.dynamics.frame_skip
        m = len(states)
        control = np.zeros((m, 1, self._control_size))
        control[:, 0, : self.input_size] = self._controls(self._check("inputs", inputs, self.input_size), states, steps)
        control[:, 0, self._load_columns] = self._check_load(loads)
        if models is not None and len(models) != m:
            raise ValueError(f"{len(models)} models for {m} states: must be one for each")
        pool, data = self._pool(nthread)
        found = np.empty((m, steps, self.state_size))
        with _without_log():
            pool.rollout(
                [self.model] * m if models is None else list(models),
                data,
                np.ascontiguousarray(states),
                np.ascontiguousarray(np.broadcast_to(control, (m, steps, self._control_size))),
                control_spec=_CONTROL,
                nstep=steps,
                state=found,
            )
        after = found[:, -1]
        # A simulation that diverged stops where it is: its last states repeat, and their time stands still.
        late = after[:, 0] < states[:, 0] + (steps - 0.5) * self.dynamics.timestep
        diverged = late | ~(abs(after[:, self._rates]) < _FASTEST).all(axis=1)
        return RolloutResult(np.where(diverged[:, None], states, after), diverged)

    def _pool(self, nthread: int) -> tuple[Rollout, list[Any]]:
        if nthread not in self._pools:
            threads = nthread if nthread > 1 else 0
            self._pools[nthread] = Rollout(nthread=threads), [mujoco.MjData(self.model) for _ in range(nthread)]
        return self._pools[nthread]

    def variant(self, mechanism: Any = None, dynamics: Dynamics | None = None) -> Any:
        """MuJoCo's model of an arm of the same bar lengths with other parameters, without compiling anew.

        Args:
            mechanism: with another design (stiffness, payload, masses, bounds), or None for the same.
            dynamics: with other masses, damping, friction or bandwidth, or None for the same.

        Returns:
            A MjModel for `rollout`.

        Raises:
            ValueError: the geometry, time step, frame skip, integrator or whether actuators lag differ, or bar masses
                do not all change by one factor; such an arm needs a MujocoModel of its own.
        """
        mechanism, dynamics = mechanism or self.mechanism, dynamics or self.dynamics
        own = self.dynamics
        for field in ("timestep", "frame_skip", "integrator"):
            if getattr(dynamics, field) != getattr(own, field):
                raise ValueError(f"Dynamics.{field} differs from that of the model: build another MujocoModel")
        if (dynamics.time_constant > 0) != (own.time_constant > 0):
            raise ValueError("only one of Dynamics.actuator_bandwidth and that of the model is 0: build another")
        skeleton = skeleton_of(mechanism)
        if not self.linkage.fits(skeleton):
            raise ValueError("the bar lengths differ from those of the model: build another MujocoModel")
        members = skeleton.members
        model = copy(self.model)
        for member in members:
            if member.kind == "spring" and not member.is_input:
                tendon = model.tendon(member.name).id
                model.tendon_stiffness[tendon] = member.stiffness
                model.tendon_lengthspring[tendon] = 0.0 if member.goes_slack else member.free_length, member.free_length
        for i, member in enumerate(input_members(members)):
            if member.kind == "cable":
                model.actuator_ctrlrange[i] = mechanism.design.min_tension, mechanism.design.max_tension
            elif member.kind == "actuator":
                stiffness = dynamics.servo_stiffness
                model.actuator_gainprm[i, 0] = stiffness
                model.actuator_biasprm[i, 1:3] = -stiffness, -stiffness * dynamics.servo_time
            else:
                model.actuator_gainprm[i, 0], model.actuator_biasprm[i, 1] = member.stiffness, -member.stiffness
                model.actuator_forcerange[i, 0] *= member.stiffness / self._inputs[i].stiffness
            if dynamics.time_constant:
                model.actuator_dynprm[i, 0] = dynamics.time_constant
        self._scale_masses(model, members, dynamics)
        payload = getattr(mechanism.design, "payload", None)
        model.body_mass[self._tip] = dynamics.tip_mass if payload is None else payload
        model.opt.gravity[2] = -getattr(mechanism.design, "gravity", 0.0)
        # MuJoCo's damping may have coefficients of higher order behind the linear one
        turning = model.jnt_type[model.dof_jntid] != int(mujoco.mjtJoint.mjJNT_SLIDE)
        model.dof_damping.reshape(model.nv, -1)[:, 0] = np.where(turning, dynamics.joint_damping, 0.0)
        model.dof_frictionloss[:] = np.where(turning, dynamics.joint_friction, 0.0)
        mujoco.mj_setConst(model, self._scratch)
        return model

    def _scale_masses(self, model: Any, members: Sequence[Any], dynamics: Dynamics) -> None:
        own = [bar.mass for bar in self.mechanism.members if bar.kind == "bar"]
        new = [bar.mass for bar in members if bar.kind == "bar"]
        if not own:  # a platform
            factor = dynamics.platform_mass / self.dynamics.platform_mass
            model.body_mass[:] *= factor
            model.body_inertia[:] *= factor
            return
        factor = max(new) / max(own) if max(own) else dynamics.bar_line_density / self.dynamics.bar_line_density
        if not factor or max(abs(b - factor * a) for a, b in zip(own, new, strict=True)) > 1e-12 * max(own):
            raise ValueError("the bar masses do not all change by one factor: build another MujocoModel")
        if max(own) and dynamics.bar_line_density != self.dynamics.bar_line_density and min(own) == 0:
            raise ValueError("some bars have a mass of their own, others have not: build another MujocoModel")
        model.body_mass[:] *= factor
        model.body_inertia[:] *= factor

    def close(self) -> None:
        """End the threads."""
        for pool, _ in self._pools.values():
            pool.close()
        self._pools.clear()

    # ------------------------------------------------------------------------------------------------------ statics

    def settle(
        self,
        inputs: Any,
        start: Any,
        load: Sequence[float] | None = None,
        tolerance: float | None = None,
        max_steps: int = 20_000,
    ) -> Settled:
        """Where the arm comes to rest from `start`, under constant inputs.

        Joints are halted whenever the kinetic energy begins to fall (dynamic relaxation), which finds the equilibrium
        of the same equations sooner than damping does. Actuators do not lag meanwhile.

        Args:
            inputs: tensions [N] or free lengths [m].
            start: configuration [rad].
            load: at the tip [N].
            tolerance: at rest is where an arm that is let go would move by less than about this [rad]. None for 1e-7
                with loops, whose constraints are solved no better, and 1e-12 without.
            max_steps: time steps after which to give up.

        Raises:
            ValueError: a shape is wrong, a number is not finite, or inputs or start are beyond their bounds.
        """
        inputs = self._check_inputs(inputs)
        calm_speed = _SLOWEST * ((1e-7 if self.linkage.loops else 1e-12) if tolerance is None else tolerance)
        data = self._scratch
        self._load(data, self.state(np.asarray(start, float).reshape(-1), None, inputs))
        self._command(data, inputs, load)
        with _without_log():
            reason, steps = self._come_to_rest(data, calm_speed, max_steps)
        angles = data.qpos.copy()
        return Settled(
            np.asarray(self.linkage.configuration(angles)),
            float(self.linkage.loop_error(angles)),
            float(abs(data.qacc).max()),
            steps,
            reason,
        )

    def _come_to_rest(self, data: Any, calm_speed: float, max_steps: int) -> tuple[str, int]:
        before, calm = 0.0, 0
        for step in range(max_steps):
            mujoco.mj_step(self.model, data)
            energy = float(data.qvel @ data.qvel)
            if not energy < _FASTEST**2:  # NaN compares as False
                return "diverged", step + 1
            if energy < before:
                data.qvel[:] = 0.0
                calm = calm + 1 if before < calm_speed**2 else 0
                energy = 0.0
                if calm == 3:
                    return "at rest", step + 1
            before = energy
        return f"not at rest after {max_steps} steps", max_steps

    def _command(self, data: Any, inputs: np.ndarray, load: Any) -> None:
        data.ctrl[:] = 0.0 if self._is_ramped else inputs
        data.xfrc_applied[self._tip, self._axes] = self._check_load(load)

    def _at(self, q: Any, inputs: Any = None, load: Any = None) -> Any:
        """Scratch data at rest in the exactly closed configuration, with all forces but those of the constraints."""
        data = self._scratch
        inputs = self.input_bounds[0] if inputs is None else self._check_inputs(inputs)
        self._load(data, self.state(np.asarray(q, float).reshape(-1), None, inputs))
        self._command(data, inputs, load)
        mujoco.mj_fwdPosition(self.model, data)
        mujoco.mj_fwdVelocity(self.model, data)
        mujoco.mj_fwdActuation(self.model, data)
        return data

    def potential_energy(self, q: Any, inputs: Any, load: Sequence[float] | None = None) -> float:
        """Potential energy [J] of gravity, springs, cables (tension times length) and load, as MuJoCo's forces have it.

        Weights are zero at the base, and the energy equals the mechanism's own.
        """
        return self._energy_of(self._at(q, inputs, load))

    def _energy_of(self, data: Any) -> float:
        model = self.model
        energy = float(self._weights @ data.xipos[:, 2])
        low, high = model.tendon_lengthspring.T
        stretch = np.maximum(data.ten_length - high, 0.0) + np.minimum(data.ten_length - low, 0.0)
        energy += float(_first_column(model.tendon_stiffness) @ stretch**2) / 2
        commands = data.act if model.na else np.clip(data.ctrl, *self.input_bounds)
        for i, member in enumerate(self._inputs):
            length = data.ten_length[model.actuator_trnid[i, 0]]
            if member.kind == "cable":
                energy += commands[i] * length
            else:
                stretched = length - commands[i]
                stiffness = self.dynamics.servo_stiffness if member.kind == "actuator" else member.stiffness
                energy += stiffness * (max(stretched, 0.0) if member.goes_slack else stretched) ** 2 / 2
        return energy - float(data.xfrc_applied[self._tip, :3] @ data.xipos[self._tip])

    def energy(self, state: np.ndarray, inputs: Any, load: Sequence[float] | None = None) -> float:
        """Kinetic and potential energy of a state [J]."""
        data = self._scratch
        self._load(data, self._check("state", state, self.state_size))
        self._command(data, self._check_inputs(inputs), load)
        mujoco.mj_fwdPosition(self.model, data)
        return self._energy_of(data) + float(data.qvel @ self._full_mass_matrix(data) @ data.qvel) / 2

    def energy_gradient(self, q: Any, inputs: Any, load: Sequence[float] | None = None) -> np.ndarray:
        """Derivative of the potential energy in q [N m/rad], shape (n,): MuJoCo's forces, through the loops."""
        data = self._at(q, inputs, load)
        force = data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias
        applied = np.zeros(self.model.nv)
        xfrc = data.xfrc_applied[self._tip]
        mujoco.mj_applyFT(self.model, data, xfrc[:3].copy(), xfrc[3:].copy(), data.xipos[self._tip], self._tip, applied)
        return np.asarray(-(force + applied) @ self.linkage.rates_by_configuration(data.qpos.copy()))

    def mass_matrix(self, q: Any) -> np.ndarray:
        """Mass matrix in the coordinates q [kg m2], shape (n, n): kinetic energy = qdot . M qdot / 2."""
        data = self._at(q)
        rates = self.linkage.rates_by_configuration(data.qpos.copy())
        return np.asarray(rates.T @ self._full_mass_matrix(data) @ rates)

    def _full_mass_matrix(self, data: Any) -> np.ndarray:
        full = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, data, full)
        return full

    # ------------------------------------------------------------------------------------------------------- pictures

    def to_mjcf(self, path: str | Path, q: Any = None, inputs: Any = None) -> Path:
        """Write the model as an MJCF file, for `python -m mujoco.viewer --mjcf=...`, whose sliders are the inputs (of
        prismatic actuators: their speeds).

        Args:
            path: of the file.
            q: configuration of its key frame "start" [rad]; None for no key frame (the viewer begins at q = 0, with the
                inputs at their lower bounds).
            inputs: of the key frame; None for the lower bounds.

        Returns:
            The path.
        """
        spec = self.spec.copy()
        if q is not None:
            ctrl = self.input_bounds[0] if inputs is None else self._check_inputs(inputs)
            state = self.state(np.asarray(q, float).reshape(-1), None, ctrl)
            act = ctrl if self.model.na else []
            controls = np.zeros(self.input_size) if self._is_ramped else ctrl
            spec.add_key(name="start", qpos=state[self._angles], ctrl=controls, act=act)
        spec.compile()
        path = Path(path)
        path.write_text(spec.to_xml())
        return path


def _first_column(values: Any) -> np.ndarray:
    """Linear stiffnesses, of MuJoCo's polynomials or plain numbers."""
    values = np.asarray(values)
    return np.asarray(values[:, 0] if values.ndim == 2 else values)
