"""A mechanism as a simulation in MuJoCo that can be put in any state and stepped: one alone, or many as rows.

Configurations q [rad], inputs (tensions [N], free or actuator lengths [m]) and loads (dead force at the tip (fx, fy)
or (fx, fy, fz) [N]) are those of the analytic mechanism; where that has prismatic actuators, configurations are the
coordinates of its model with floating lengths (`simulation.floating_lengths`). Prismatic actuators move evenly from
where they are to their command within a step. Many simulations are rows: arrays of shape (m, ...). A state is a row of
numbers (time, joint angles, their rates, actuator states) from which the simulation goes on, to the bit, wherever it is
put.
"""

from collections.abc import Sequence
from copy import copy, deepcopy
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from tensegrity_envs.simulation.floating_lengths import FloatingPrism, floating_length_model
from tensegrity_envs.simulation.mujoco.building import TIP_BODY, build, input_members
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.simulation.mujoco.linkage import Linkage
from tensegrity_envs.simulation.mujoco.platform import Platform
from tensegrity_envs.simulation.mujoco.processes import Pools, without_log

_FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS
_WHOLE = mujoco.mjtState.mjSTATE_INTEGRATION
_CONTROL = int(mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_XFRC_APPLIED)
_WARNING = mujoco.mjtWarning
_DIVERGED = tuple(int(w) for w in (_WARNING.mjWARN_BADQPOS, _WARNING.mjWARN_BADQVEL, _WARNING.mjWARN_BADQACC))
_RAMPED = int(mujoco.mjtDyn.mjDYN_INTEGRATOR)
FASTEST = 1e6  # [rad/s]: joints of a real arm are far slower; faster has diverged


class RolloutResult(NamedTuple):
    """States after a rollout.

    Attributes:
        states: shape (m, state size); of a simulation that diverged, those from before the rollout.
        diverged: shape (m,).
    """

    states: np.ndarray
    diverged: np.ndarray


class Simulator:
    """One mechanism with one set of parameters, compiled, to be stepped.

    Args:
        mechanism: an analytic mechanism of one design.
        dynamics: what it does not tell.

    Raises:
        ValueError: the mechanism is a batch of designs, the time step is too long for its loops, or its actuators
            cannot lag.

    Attributes:
        floating_model: what of the mechanism moves; its coordinates are the configurations.
        linkage: its bodies, hinges and loops.
        model: the MjModel, without the textures of pictures.
        data: the MjData of `reset` and `step`.
        state_size: numbers in a state.
        input_size: numbers in an input.
        input_bounds: lowest and highest inputs, shape (2, input size); MuJoCo keeps what lies outside at the bound.
        is_ramped: whether actuators move evenly to their commands within a step, as prismatic ones do.
    """

    def __init__(self, mechanism: Any, dynamics: Dynamics | None = None) -> None:
        self.mechanism = mechanism
        self.dynamics = dynamics or Dynamics()
        self.floating_model = floating_length_model(mechanism)
        self.linkage: Any = (Platform if isinstance(self.floating_model, FloatingPrism) else Linkage)(
            self.floating_model
        )
        if self.linkage.loops and self.dynamics.timestep > 0.001:
            raise ValueError(
                f"Dynamics.timestep = {self.dynamics.timestep!r}: must be 0.001 s or less for a mechanism with loops, "
                "whose joint limits cannot keep them assembled otherwise"
            )
        self.model = build(self.floating_model, self.linkage, self.dynamics, textures=False).compile()
        self.data = mujoco.MjData(self.model)
        self._scratch = mujoco.MjData(self.model)
        names = [self.model.joint(i).name for i in range(self.model.njnt)]
        if names != list(self.linkage.joints):
            raise AssertionError(f"joints {names} are not in the order of the linkage")
        self._inputs = input_members(self.floating_model.members)
        self._tip = self.model.body(TIP_BODY).id
        self.state_size = int(mujoco.mj_stateSize(self.model, int(_FULL)))
        self.input_size = int(self.model.nu)
        self.is_ramped = bool((self.model.actuator_dyntype == _RAMPED).any())
        ranges = self.model.actuator_actrange if self.is_ramped else self.model.actuator_ctrlrange
        self.input_bounds = ranges.T.copy()
        nq, nv, na = int(self.model.nq), int(self.model.nv), int(self.model.na)
        self._angles, self._rates = slice(1, 1 + nq), slice(1 + nq, 1 + nq + nv)  # after the time
        self._actuators = slice(1 + nq + nv, 1 + nq + nv + na)
        self._weights = self.model.body_mass * (1 - self.model.body_gravcomp) * -self.model.opt.gravity[2]
        tip = 6 * self._tip + self.input_size
        self._axes = [0, 2] if self.linkage.space == 2 else [0, 1, 2]  # of MuJoCo, of the mechanism's positions
        self._load_columns = [tip + i for i in self._axes]  # of a control: the inputs, then 6 numbers for every body
        self._control_size = self.input_size + 6 * int(self.model.nbody)
        self._pools = Pools()
        self.reset(np.zeros(self.linkage.size))

    @property
    def spec(self) -> mujoco.MjSpec:
        """A new MjSpec of the model, with what makes a good picture."""
        return build(self.floating_model, self.linkage, self.dynamics)

    # ------------------------------------------------------------------------------------------------------ copies

    def __getstate__(self) -> dict[str, Any]:
        """All but MuJoCo's data, of which the whole state is kept: they have 14 MB."""
        rest = {name: value for name, value in vars(self).items() if name not in ("data", "_scratch")}
        return rest | {"_kept": self._whole_state()}

    def __setstate__(self, given: dict[str, Any]) -> None:
        """Go on from that state, to the bit."""
        state = given.pop("_kept")
        vars(self).update(given)
        self.data, self._scratch = mujoco.MjData(self.model), mujoco.MjData(self.model)
        mujoco.mj_setState(self.model, self.data, state, int(_WHOLE))
        mujoco.mj_kinematics(self.model, self.data)

    def __deepcopy__(self, memo: dict[int, Any]) -> "Simulator":
        """A copy with its own model, data and threads; the mechanism and what follows from it never change."""
        other: Simulator = object.__new__(type(self))
        memo[id(self)] = other
        other.__setstate__(self.__getstate__() | {"model": copy(self.model), "_pools": Pools()})
        return other

    def __copy__(self) -> "Simulator":
        """The same: two simulations on one set of data would be one."""
        return deepcopy(self)

    def _whole_state(self) -> np.ndarray:
        state = np.empty(mujoco.mj_stateSize(self.model, int(_WHOLE)))
        mujoco.mj_getState(self.model, self.data, state, int(_WHOLE))
        return state

    # ----------------------------------------------------------------------------------------------------- checking

    def _check(self, name: str, value: ArrayLike, size: int) -> np.ndarray:
        array = np.asarray(value, float)
        if array.shape[-1:] != (size,):
            raise ValueError(f"{name} of shape {array.shape}: must be ({size},) or (m, {size})")
        if not np.isfinite(array).all():
            raise ValueError(f"{name} = {value!r}: must be finite numbers")
        return array

    def _check_configuration(self, q: ArrayLike) -> np.ndarray:
        array = self._check("configuration", q, self.linkage.size)
        if (abs(array) > self.linkage.limit + 1e-9).any():
            raise ValueError(f"configuration = {q!r}: |q| must be at most {self.linkage.limit:.4g} rad")
        return array

    def _check_load(self, load: ArrayLike | None) -> np.ndarray:
        return np.zeros(self.linkage.space) if load is None else self._check("load", load, self.linkage.space)

    def _check_inputs(self, inputs: ArrayLike) -> np.ndarray:
        array = self._check("inputs", inputs, self.input_size)
        low, high = self.input_bounds
        if (array < low - 1e-9).any() or (array > high + 1e-9).any():
            raise ValueError(f"inputs = {inputs!r}: must be within {low.tolist()} and {high.tolist()}")
        return array

    # ------------------------------------------------------------------------------------------------------- states

    def state(
        self, q: ArrayLike, velocity: ArrayLike | None = None, inputs: ArrayLike | None = None, time: float = 0.0
    ) -> np.ndarray:
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

    def reset(self, q: ArrayLike, velocity: ArrayLike | None = None, inputs: ArrayLike | None = None) -> np.ndarray:
        """Put `data` into the exactly closed state of `state`, and return that."""
        state = self.state(np.asarray(q, float).reshape(-1), velocity, inputs)
        self._load(self.data, state)
        return state

    def current(self) -> np.ndarray:
        """The state of `data`."""
        state = np.empty(self.state_size)
        mujoco.mj_getState(self.model, self.data, state, int(_FULL))
        return state

    def step(self, inputs: ArrayLike, load: ArrayLike | None = None, steps: int | None = None) -> bool:
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
        with without_log():
            mujoco.mj_step(self.model, data, nstep=steps)
        if self._has_diverged(data):
            self._load(data, before)
            return False
        mujoco.mj_kinematics(self.model, data)  # what is read from data is otherwise one time step old
        return True

    def _controls(self, inputs: np.ndarray, states: np.ndarray, steps: int) -> np.ndarray:
        """MuJoCo's controls: the inputs, or the speeds [m/s] at which ramped actuators reach them in so many steps."""
        if not self.is_ramped:
            return inputs
        return np.asarray((inputs - states[..., self._actuators]) / (steps * self.dynamics.timestep))

    def _load(self, data: mujoco.MjData, state: np.ndarray) -> None:
        mujoco.mj_resetData(self.model, data)
        mujoco.mj_setState(self.model, data, np.ascontiguousarray(state), int(_FULL))
        mujoco.mj_kinematics(self.model, data)

    def _has_diverged(self, data: mujoco.MjData) -> bool:
        warned = any(data.warning[w].number for w in _DIVERGED)
        return warned or not (abs(data.qvel) < FASTEST).all()  # NaN compares as False

    def advance(
        self, state: np.ndarray, inputs: np.ndarray, load: np.ndarray, model: mujoco.MjModel | None = None
    ) -> RolloutResult:
        """One simulation of `rollout`, to the bit, without its checks: rolling out costs more than a step's physics.

        Args:
            state: shape (state size,).
            inputs: the command, shape (input size,).
            load: at the tip [N], shape (2,), in space (3,).
            model: from `variant`; None for this one.
        """
        model = self.model if model is None else model
        data = self.put(state, inputs, load, model)
        with without_log():
            mujoco.mj_step(model, data, nstep=self.dynamics.frame_skip)
        diverged = self._has_diverged(data)
        after = state.copy()
        if not diverged:
            mujoco.mj_getState(model, data, after, int(_FULL))
        return RolloutResult(after, np.array(diverged))

    def put(
        self, state: np.ndarray, inputs: np.ndarray, load: np.ndarray, model: mujoco.MjModel | None = None
    ) -> mujoco.MjData:
        """MuJoCo's scratch data in a state, with its controls and load, at the beginning of a step; see `advance`."""
        model, data = self.model if model is None else model, self._scratch
        mujoco.mj_resetData(model, data)
        mujoco.mj_setState(model, data, state, int(_FULL))
        data.ctrl[:] = self._controls(inputs, state, self.dynamics.frame_skip)
        data.xfrc_applied[self._tip, self._axes] = load
        return data

    # ---------------------------------------------------------------------------------------------- many simulations

    def rollout(
        self,
        states: np.ndarray,
        inputs: ArrayLike,
        loads: ArrayLike | None = None,
        steps: int | None = None,
        nthread: int = 1,
        models: Sequence[mujoco.MjModel] | None = None,
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
        pool, data = self._pools.of(self.model, nthread)
        found = np.empty((m, steps, self.state_size))
        with without_log():
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
        diverged = late | ~(abs(after[:, self._rates]) < FASTEST).all(axis=1)
        return RolloutResult(np.where(diverged[:, None], states, after), diverged)

    def close(self) -> None:
        """End the threads."""
        self._pools.close()
