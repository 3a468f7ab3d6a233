"""MuJoCo's linear motion of a linkage with loops against that of a rigid mechanism: closed forms, implicit steps."""

import numpy as np
import pytest

from tensegrity_envs.mechanics import MURALIDHARAN2022, TwoX
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics

pytest.importorskip("mujoco")
from tensegrity_envs.simulation.mujoco.linearizing import linearize
from tensegrity_envs.simulation.mujoco.model import MujocoModel

ARM = TwoX(MURALIDHARAN2022)
TENSIONS = tuple(float(value) for value in ARM.stiffest_tensions((0.67, 1.5)))
POSTURE = ARM.equilibrium(TENSIONS, (0.67, 1.5)).configuration


def rigid(model):
    """Of loops that stay closed: v' = v - h (M + h D)^-1 (K q + D v), q' = q + h v', as often as a step has it."""
    q, h = np.array(POSTURE, float), model.dynamics.timestep
    angles, joints = model.linkage.joint_angles(q), np.eye(2)
    rates = np.stack([model.linkage.rates_of(angles, e) for e in joints], axis=1)
    mass, damping = model.mass_matrix(q), rates.T @ np.diag(model.model.dof_damping) @ rates
    stiffness = np.array(ARM.stiffness_matrix(POSTURE, TENSIONS, (0.0, 0.0)), float)
    implicit = np.linalg.inv(mass + h * damping)
    v = np.hstack([-h * implicit @ stiffness, joints - h * implicit @ damping])
    q = np.hstack([joints, 0 * joints]) + h * v
    return np.linalg.matrix_power(np.vstack([q, v]), model.dynamics.frame_skip)


def error(loops, damping, timestep=0.001):
    """Largest error of what angles do to rates, over the largest entry."""
    model = MujocoModel(ARM, Dynamics(joint_damping=damping, timestep=timestep, frame_skip=round(0.02 / timestep)))
    ours, true = linearize(model, POSTURE, TENSIONS, None, loops).a[2:4, :2], rigid(model)[2:, :2]
    return abs(ours - true).max() / abs(true).max()


@pytest.mark.parametrize(("damping", "timestep"), [(0.02, 0.001), (0.02, 0.0005), (0.0, 0.001)])
def test_whole_steps_move_as_a_rigid_mechanism(damping, timestep):
    assert error("soft", damping, timestep) < 2e-3


def test_time_steps_that_are_reduced_one_by_one_lose_what_damping_opens():
    usual = error("closed", 0.02)
    assert 0.05 < usual < 0.07
    assert error("closed", 0.01) == pytest.approx(usual / 2, rel=0.25)
    assert error("closed", 0.02, 0.0005) == pytest.approx(usual / 2, rel=0.25)
    assert error("closed", 0.0) < 1e-3
