"""The ramp with integral action at rest, and the 2-X in dynamics that is not the nominal one."""

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("mujoco")

from baseline_runs import success_of
from tensegrity_agents.controllers import make_controller
from tensegrity_envs.seeding import VALIDATION_SEED

ARM = "tensegrity/TwoXTensionReachUncertainMuJoCo-v0"


def begun(count, **options):
    """Environments that have just begun, what is observed there, and info."""
    envs = gym.make_vec(ARM, count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **options)
    return envs, *envs.reset(seed=VALIDATION_SEED)


@pytest.mark.parametrize(
    ("level", "least"),
    [
        (0, {"servo": 0.9, "identifying_observer": 0.9, "lqg": 0.98}),
        (2, {"servo": 0.75, "identifying_observer": 0.85, "lqg": 0.95}),
        (3, {"lqg": 0.95}),
    ],
)
def test_uncertain_arms_come_to_rest_on_target(level, least):
    for name, share in least.items():
        assert success_of(ARM, name, level=level) >= share
    if level:
        assert success_of(ARM, "closed_form_ramp", level=level) < 0.3


def test_the_torque_at_rest_is_what_moves_the_tip_by_the_error():
    """By differences of the nominal arm's own energy gradient and tip."""
    envs, observation, _ = begun(60, level=0)
    controller = make_controller("servo", ARM, {"level": 0})
    observed = controller.decode(observation)
    arm, q = envs.unwrapped.core.nominal, observed.joint_angles
    error = np.random.default_rng(0).uniform(-1e-4, 1e-4, (60, 2))
    torque = controller._pull(observed.replace(target=observed.tip + error), q)
    jacobian = np.moveaxis(np.array(arm.jacobian(tuple(q.T))), 2, 0)
    step = np.stack(
        [j.T @ np.linalg.solve(j @ j.T + 0.01 * np.eye(2), e) for j, e in zip(jacobian, error, strict=True)]
    )
    tensions = tuple(observed.inputs.T)
    there, here = (np.array(arm.energy_gradient(tuple(at.T), tensions)).T for at in (q + step, q - step))
    stiff = np.array(
        [np.linalg.cond(k) for k in np.moveaxis(np.array(arm.stiffness_matrix(tuple(q.T), tensions)), 2, 0)]
    )
    assert (stiff < 15).sum() > 30  # the others have an eigenvalue that is raised
    np.testing.assert_allclose(torque[stiff < 15], ((there - here) / 2)[stiff < 15], rtol=1e-3, atol=1e-9)


def test_looks_at_rest_tell_the_stiffness():
    envs, observation, info = begun(200)
    controller = make_controller("identifying_observer", ARM)
    tips, count, memory = 0.0, controller.look + 1, None
    for step in range(count):
        observed = controller.decode(observation)
        tips = tips + observed.tip / count
        action, memory = controller.predict(observation, memory)
        assert not action.any() or step == controller.look
        observation, *_, info = envs.step(action)
    told = controller.base._believed(observed.replace(tip=tips), np.arange(200))[2][:, 0]
    off = np.abs(told - info["random_stiffness"])
    assert np.median(off) < 0.01 < np.median(np.abs(info["random_stiffness"] - 1.0)) / 3


def test_the_sum_removes_what_the_model_does_not_know():
    """Behind delay and noise, and against dry friction: the error at rest goes on falling."""
    envs, observation, info = begun(40, level=1)
    controller = make_controller("servo", ARM, {"level": 1})
    memory, runs, errors = None, np.ones(40, bool), []
    for step in range(149):
        action, memory = controller.predict(observation, memory, np.full(40, step == 0))
        observation, _, terminated, _, info = envs.step(action)
        runs &= ~terminated
        errors.append(info["tip_error"])
    assert runs.sum() >= 36
    early, late = (np.median(errors[step][runs]) for step in (66, 148))
    assert late < 0.2 * early
    assert np.abs(memory.torque[runs]).max() > 0
