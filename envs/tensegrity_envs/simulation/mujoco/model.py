"""A mechanism as a dynamic simulation in MuJoCo, with its energies, its rest, its variants and its file."""

from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.simulation.mujoco.exporting import write_mjcf
from tensegrity_envs.simulation.mujoco.processes import without_log
from tensegrity_envs.simulation.mujoco.simulator import FASTEST, RolloutResult, Simulator
from tensegrity_envs.simulation.mujoco.variants import variant_of

__all__ = ["MujocoModel", "Relaxed", "RolloutResult"]

_SLOWEST = 10.0  # [rad/s], a low frequency: an arm that is let go has a speed of about the way times this


class Relaxed(NamedTuple):
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


class MujocoModel(Simulator):
    """One mechanism with one set of parameters, compiled: stepped as a `Simulator`, and examined at rest.

    Made from, and with the attributes of, a `Simulator`.
    """

    def variant(self, mechanism: Any = None, dynamics: Dynamics | None = None) -> mujoco.MjModel:
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
        return variant_of(self, mechanism or self.mechanism, dynamics or self.dynamics)

    # ------------------------------------------------------------------------------------------------------ statics

    def relax(
        self,
        inputs: ArrayLike,
        start: ArrayLike,
        load: ArrayLike | None = None,
        tolerance: float | None = None,
        max_steps: int = 20_000,
    ) -> Relaxed:
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
        self.command(data, inputs, load)
        with without_log():
            reason, steps = self._come_to_rest(data, calm_speed, max_steps)
        angles = data.qpos.copy()
        return Relaxed(
            np.asarray(self.linkage.configuration(angles)),
            float(self.linkage.loop_error(angles)),
            float(abs(data.qacc).max()),
            steps,
            reason,
        )

    def _come_to_rest(self, data: mujoco.MjData, calm_speed: float, max_steps: int) -> tuple[str, int]:
        before, calm = 0.0, 0
        for step in range(max_steps):
            mujoco.mj_step(self.model, data)
            energy = float(data.qvel @ data.qvel)
            if not energy < FASTEST**2:  # NaN compares as False
                return "diverged", step + 1
            if energy < before:
                data.qvel[:] = 0.0
                calm = calm + 1 if before < calm_speed**2 else 0
                energy = 0.0
                if calm == 3:
                    return "at rest", step + 1
            before = energy
        return f"not at rest after {max_steps} steps", max_steps

    def command(self, data: mujoco.MjData, inputs: np.ndarray, load: ArrayLike | None) -> None:
        """Put constant inputs, and a load at the tip [N] or None, into an MjData of this model."""
        data.ctrl[:] = 0.0 if self.is_ramped else inputs
        data.xfrc_applied[self._tip, self._axes] = self._check_load(load)

    def _at(self, q: ArrayLike, inputs: ArrayLike | None = None, load: ArrayLike | None = None) -> mujoco.MjData:
        """Scratch data at rest in the exactly closed configuration, with all forces but those of the constraints."""
        data = self._scratch
        inputs = self.input_bounds[0] if inputs is None else self._check_inputs(inputs)
        self._load(data, self.state(np.asarray(q, float).reshape(-1), None, inputs))
        self.command(data, inputs, load)
        mujoco.mj_fwdPosition(self.model, data)
        mujoco.mj_fwdVelocity(self.model, data)
        mujoco.mj_fwdActuation(self.model, data)
        return data

    def potential_energy(self, q: ArrayLike, inputs: ArrayLike, load: ArrayLike | None = None) -> float:
        """Potential energy [J] of gravity, springs, cables (tension times length) and load, as MuJoCo's forces have it.

        Weights are zero at the base, and the energy equals the mechanism's own.
        """
        return self._energy_of(self._at(q, inputs, load))

    def _energy_of(self, data: mujoco.MjData) -> float:
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

    def energy(self, state: np.ndarray, inputs: ArrayLike, load: ArrayLike | None = None) -> float:
        """Kinetic and potential energy of a state [J]."""
        data = self._scratch
        self._load(data, self._check("state", state, self.state_size))
        self.command(data, self._check_inputs(inputs), load)
        mujoco.mj_fwdPosition(self.model, data)
        return self._energy_of(data) + float(data.qvel @ self._full_mass_matrix(data) @ data.qvel) / 2

    def energy_gradient(self, q: ArrayLike, inputs: ArrayLike, load: ArrayLike | None = None) -> np.ndarray:
        """Derivative of the potential energy in q [N m/rad], shape (n,): MuJoCo's forces, through the loops."""
        data = self._at(q, inputs, load)
        force = data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias
        applied = np.zeros(self.model.nv)
        xfrc = data.xfrc_applied[self._tip]
        mujoco.mj_applyFT(self.model, data, xfrc[:3].copy(), xfrc[3:].copy(), data.xipos[self._tip], self._tip, applied)
        return np.asarray(-(force + applied) @ self.linkage.rates_by_configuration(data.qpos.copy()))

    def mass_matrix(self, q: ArrayLike) -> np.ndarray:
        """Mass matrix in the coordinates q [kg m2], shape (n, n): kinetic energy = qdot . M qdot / 2."""
        data = self._at(q)
        rates = self.linkage.rates_by_configuration(data.qpos.copy())
        return np.asarray(rates.T @ self._full_mass_matrix(data) @ rates)

    def _full_mass_matrix(self, data: mujoco.MjData) -> np.ndarray:
        full = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, data, full)
        return full

    # ------------------------------------------------------------------------------------------------------- pictures

    def to_mjcf(self, path: str | Path, q: ArrayLike | None = None, inputs: ArrayLike | None = None) -> Path:
        """Write the model as an MJCF file, for `python -m mujoco.viewer --mjcf=...`, whose sliders are the inputs (of
        prismatic actuators: their speeds).

        A plain load rests: where controls of zero, which saturate at the lowest inputs, hold the arm; with prismatic
        actuators, in q, or else in the pose of `floating_model.at_rest`, from which on activations count the lengths.

        Args:
            path: of the file.
            q: configuration of its key frame "start" [rad]; None for no key frame.
            inputs: of the key frame; None for the lower bounds, with prismatic actuators for the lengths in q.

        Returns:
            The path.
        """
        return write_mjcf(self, Path(path), q, inputs)


def _first_column(values: ArrayLike) -> np.ndarray:
    """Linear stiffnesses, of MuJoCo's polynomials or plain numbers."""
    values = np.asarray(values)
    return np.asarray(values[:, 0] if values.ndim == 2 else values)
