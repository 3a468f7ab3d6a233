"""Dynamic models with prismatic actuators: settled states, energies, frequencies, velocities, failures."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from prismatic_measurements import (
    DYNAMICS,
    FOUR_BAR,
    PRISM,
    drift,
    energies,
    feasible,
    frequencies,
    model_of,
    relax,
)
from scipy.spatial.transform import Rotation

from tensegrity_envs.mechanics import JAHROMY, JI2014, PlanarFourBar, SpatialPrism
from tensegrity_envs.simulation.floating_lengths import FloatingFourBar, side_of_diagonals
from tensegrity_envs.simulation.mujoco import Dynamics, MujocoModel

every_name = pytest.mark.parametrize("name", DYNAMICS)


@every_name
@pytest.mark.parametrize("loaded", [False, True])
def test_settled_tips_are_within_a_hundredth_of_a_millimetre_of_the_equilibria(name, loaded):
    errors = relax(name, 100, loaded)
    assert len(errors) == 100
    assert errors.max() < 1e-5


@every_name
def test_energy_and_its_gradient_are_those_of_nodes_and_members(name):
    energy, gradient = energies(name, 100)
    assert energy < 1e-13
    assert gradient < 1e-8  # of differences


def test_energy_at_fitting_lengths_is_the_analytic_one():
    model, rng = model_of("planar 4-bar"), np.random.default_rng(0)
    for lengths, load, _ in feasible("planar 4-bar", 20, 4, True):
        q = tuple(rng.uniform(-3, 3, 2))
        u = model.floating_model.coordinates(q, lengths)
        expected = FOUR_BAR.potential_energy(q, lengths, load)
        assert model.potential_energy(u, lengths, load) == pytest.approx(expected, abs=1e-6)
        # the servos hold what the mechanism holds by constraints: theta and gamma turn against the bars' turns t and g
        slope = model.energy_gradient(u, lengths, load)
        np.testing.assert_allclose([-slope[2], slope[3]], FOUR_BAR.energy_gradient(q, lengths, load), atol=1e-6)
    model = model_of("spatial prism")
    for _ in range(20):
        u, load = rng.uniform(-0.3, 0.3, 6) + np.array([0, 0, 0.6, 0, 0, 0]), rng.normal(0, 8.0, 3)
        expected = PRISM.potential_energy(tuple(u), None, tuple(load))
        assert model.potential_energy(u, PRISM.strut_lengths(tuple(u)), load) == pytest.approx(expected, abs=1e-6)


def test_locked_frequencies_of_the_prism_are_those_of_its_page():
    """8.36, 8.36 and 10.14 Hz with a uniform platform of 0.5 kg at (0, 0, 0.4) m."""
    u = np.array([0.0, 0.0, 0.4, 0.0, 0.0, 0.0])
    expected, simulated = frequencies("spatial prism", PRISM.unloaded_lengths(tuple(u[:3])), u)
    np.testing.assert_allclose(expected, [8.364, 8.364, 10.135], atol=0.002)
    np.testing.assert_allclose(simulated, expected, rtol=1e-3)


@every_name
def test_locked_frequencies_are_those_of_hessian_and_mass_matrix(name):
    lengths, _, u = feasible(name, 1, 3, False)[0]
    expected, simulated = frequencies(name, lengths, u)
    np.testing.assert_allclose(simulated, expected, rtol=1e-3)


@every_name
def test_energy_stays_without_damping(name):
    mean, least, most = drift(name, "implicitfast", 3.0)
    assert 0.95 < mean < 1.05
    assert 0.8 < least < most < 1.2


@every_name
def test_mass_matrix_by_kinetic_energy(name):
    model = model_of(name)
    lengths, _, u = feasible(name, 1, 6, False)[0]
    rate = np.random.default_rng(3).normal(0.0, 1.0, len(u))
    moving = model.energy(model.state(u, rate, lengths), lengths) - model.energy(
        model.state(u, inputs=lengths), lengths
    )
    # the prism rests unturned, where rates of the rotation vector are angular velocities
    assert moving == pytest.approx(rate @ model.mass_matrix(u) @ rate / 2, rel=1e-9)


def test_states_of_the_four_bar_read_back():
    model, rng = model_of("planar 4-bar"), np.random.default_rng(4)
    floating_model = FloatingFourBar(FOUR_BAR)
    lengths, q = rng.uniform(0.5, 19.5, (2, 50)), rng.uniform(-math.pi, math.pi, (2, 50))
    u = np.stack(floating_model.coordinates(tuple(q), tuple(lengths)), axis=1)
    rate = rng.normal(0.0, 1.0, u.shape)
    states = model.state(u, rate)
    found = model.configuration(states)
    np.testing.assert_allclose(np.angle(np.exp(1j * (found - u))), 0, atol=1e-12)
    np.testing.assert_allclose(model.velocity(states), rate, atol=1e-9)
    np.testing.assert_allclose(np.stack(floating_model.configuration(tuple(found.T))), q, atol=1e-12)
    np.testing.assert_allclose(floating_model.base_angles(tuple(u.T)), FOUR_BAR.base_angles(tuple(lengths)), atol=1e-12)
    nodes = FOUR_BAR.nodes(tuple(q), tuple(lengths))
    for name, place in nodes.items():
        np.testing.assert_allclose(model.nodes(states)[name], np.broadcast_arrays(*place), atol=1e-11)
    np.testing.assert_allclose(model.tip(states).T, FOUR_BAR.tip(tuple(q), tuple(lengths)), atol=1e-11)
    model.reset(u[0])
    np.testing.assert_allclose(model.data.site("tip").xpos[[0, 2]], model.tip(states)[0], atol=1e-11)


def test_states_of_the_prism_read_back():
    model, rng = model_of("spatial prism"), np.random.default_rng(4)
    w = rng.normal(size=(50, 3))
    w *= (rng.uniform(0, 3.1, 50) / np.linalg.norm(w, axis=1))[:, None]
    u = np.concatenate([rng.uniform(-0.3, 0.3, (50, 3)), w], axis=1)
    rate = rng.normal(0.0, 1.0, u.shape)
    states = model.state(u, rate)
    np.testing.assert_allclose(model.configuration(states), u, atol=1e-12)
    np.testing.assert_allclose(model.velocity(states), rate, atol=1e-12)
    quaternions = Rotation.from_rotvec(w).as_quat(scalar_first=True)
    np.testing.assert_allclose(
        states[:, 4:8] * np.sign((states[:, 4:8] * quaternions).sum(axis=1))[:, None], quaternions
    )
    mirrored = states.copy()
    mirrored[:, 4:8] *= -1  # the same rotation
    np.testing.assert_allclose(model.configuration(mirrored), u, atol=1e-12)
    for name, place in PRISM.nodes(tuple(u.T)).items():
        wanted = np.broadcast_arrays(*place, u[:, 0])[:3]
        np.testing.assert_allclose(model.nodes(states)[name], wanted, atol=1e-14)
    # the angular velocity is that of the nodes
    h = 1e-6
    later = Rotation.from_rotvec(h * rate[:, 3:]) * Rotation.from_rotvec(w)
    moved = model.state(np.concatenate([u[:, :3] + h * rate[:, :3], later.as_rotvec()], axis=1))
    data = mujoco.MjData(model.model)
    for i in (0, 7):
        data.qpos[:] = states[i, 1:8]
        data.qvel[:] = states[i, 8:14]
        mujoco.mj_integratePos(model.model, data.qpos, data.qvel, h)
        np.testing.assert_allclose(data.qpos[:3], moved[i, 1:4], atol=1e-12)
        assert abs(abs(data.qpos[3:7] @ moved[i, 4:8]) - 1) < 1e-11


def test_side_of_the_rectangle_is_told_by_its_diagonals():
    rng = np.random.default_rng(0)
    lengths = rng.uniform(0, 20, (2, 1000))
    square, rest = FOUR_BAR.flatness(tuple(lengths))
    lengths = lengths[:, np.minimum(square, rest) > 1e-3]
    for side in (1.0, -1.0):
        assert (side_of_diagonals(FOUR_BAR.rectangle(tuple(lengths), side)[0]) == side).all()


@every_name
@pytest.mark.parametrize("threads", [1, 2])
def test_steps_and_rollouts_are_the_same_to_the_bit(name, threads):
    model = model_of(name)
    rng = np.random.default_rng(5)
    found = feasible(name, 7, 5, False)
    starts, lengths = np.array([u for _, _, u in found]), np.array([lengths for lengths, _, _ in found])
    u, loads = lengths + 0.01 * rng.normal(size=lengths.shape), rng.normal(0.0, 0.5, (7, model.linkage.space))
    states = model.state(starts, inputs=lengths)
    for _ in range(3):
        states = model.rollout(states, u, loads, nthread=threads).states
    model.reset(starts[6], inputs=lengths[6])
    alone = model.current()
    for _ in range(3):
        assert model.step(u[6], loads[6])
        alone = model.advance(alone, u[6], loads[6]).states
    np.testing.assert_array_equal(model.current(), states[6])
    np.testing.assert_array_equal(alone, states[6])
    model.close()


@every_name
def test_actuators_move_evenly_and_arrive_at_the_end_of_the_step(name):
    model = model_of(name)
    lengths, _, u = feasible(name, 1, 8, False)[0]
    new = np.array(lengths) * 1.02
    skip = model.dynamics.frame_skip
    states = model.state(u, inputs=lengths)[None]
    half = model.state_size - model.input_size
    for k in range(1, skip + 1):
        # what the whole step would command, cut short
        after = model.rollout(states, lengths + (new - lengths) * k / skip, steps=k).states[0]
        np.testing.assert_allclose(after[half:], lengths + (new - lengths) * k / skip, rtol=1e-12)
    later = model.rollout(after[None], new, steps=10 * skip).states[0]
    nodes = model.nodes(later)
    for member, length in zip((m for m in model.floating_model.members if m.kind == "actuator"), new, strict=True):
        a, b = (np.array(nodes[node]) for node in member.nodes)
        assert np.linalg.norm(a - b) == pytest.approx(length, abs=1e-4)


@every_name
def test_divergence_is_told_and_undone(name):
    model = model_of(name)
    lengths, _, u = feasible(name, 1, 8, False)[0]
    states = model.state(np.tile(u, (2, 1)), inputs=lengths)
    loads = np.zeros((2, model.linkage.space))
    loads[1, 0] = 1e18
    result = model.rollout(states, lengths, loads)
    np.testing.assert_array_equal(result.diverged, [False, True])
    np.testing.assert_array_equal(result.states[1], states[1])


@every_name
def test_variants_are_what_compiling_anew_gives(name):
    model = model_of(name)
    if name == "planar 4-bar":
        other = PlanarFourBar(replace(JI2014, stiffness=140.0))
    else:
        other = SpatialPrism(replace(JAHROMY, k=140.0))
    dynamics = replace(model.dynamics, joint_damping=0.7, bar_line_density=0.3, tip_mass=0.2, platform_mass=0.8,
                       servo_stiffness=1e8, joint_friction=0.01)  # fmt: skip
    variant, anew = model.variant(other, dynamics), MujocoModel(other, dynamics)
    for field in ("body_mass", "body_inertia", "dof_damping", "dof_frictionloss", "tendon_stiffness",
                  "actuator_gainprm", "actuator_biasprm", "dof_invweight0"):  # fmt: skip
        wanted = getattr(anew.model, field)
        np.testing.assert_allclose(getattr(variant, field), wanted, rtol=1e-9, atol=1e-12, err_msg=field)
    lengths, _, u = feasible(name, 1, 8, False)[0]
    states = model.state(np.tile(u, (2, 1)), inputs=lengths)
    far = np.array(lengths) * 1.03
    both = model.rollout(states, far, models=[model.model, variant]).states
    np.testing.assert_allclose(both[1], anew.rollout(states, far).states[1], atol=1e-9)
    assert abs(both[1] - both[0]).max() > 1e-4
    with pytest.raises(ValueError, match="build another"):
        model.variant(
            PlanarFourBar(replace(JI2014, length=5.0)) if "bar" in name else SpatialPrism(replace(JAHROMY, d=0.3))
        )


@every_name
def test_mjcf_file_holds_the_same_model(name, tmp_path):
    model = model_of(name)
    lengths, _, u = feasible(name, 1, 8, False)[0]
    path = model.to_mjcf(tmp_path / "model.xml", u, lengths)
    reloaded = mujoco.MjModel.from_xml_path(str(path))
    for field in ("body_mass", "body_inertia", "dof_damping", "tendon_stiffness", "actuator_gainprm"):
        np.testing.assert_allclose(getattr(reloaded, field), getattr(model.model, field), rtol=1e-5, atol=1e-9)
    # activations count from the lengths of the key frame
    shift = np.array(lengths)[:, None]
    digits = 1e-5 * model.linkage.length  # six are in the file
    np.testing.assert_allclose(reloaded.actuator_actrange + shift, model.model.actuator_actrange, atol=digits)
    np.testing.assert_allclose(reloaded.actuator_biasprm[:, 1:], model.model.actuator_biasprm[:, 1:], rtol=1e-5)
    data = mujoco.MjData(reloaded)
    mujoco.mj_resetDataKeyframe(reloaded, data, 0)
    mujoco.mj_step(reloaded, data, nstep=100)
    model.reset(u, inputs=lengths)
    assert model.step(lengths, steps=100)
    np.testing.assert_allclose(data.qpos, model.data.qpos, atol=1e-3)


def test_what_does_not_fit_is_named():
    with pytest.raises(ValueError, match="actuator_bandwidth"):
        MujocoModel(PRISM, Dynamics(actuator_bandwidth=5.0))
    with pytest.raises(ValueError, match="servo_time"):
        MujocoModel(FOUR_BAR, Dynamics(timestep=0.004, servo_time=0.001))
    for field in ("platform_mass", "servo_stiffness"):
        with pytest.raises(ValueError, match=f"Dynamics.{field} = 0.0"):
            Dynamics(**{field: 0.0})
    with pytest.raises(ValueError, match="servo_time"):
        Dynamics(servo_time=-1.0)
    for mechanism in (PlanarFourBar(replace(JI2014, stiffness=np.array([1.0, 2.0]))),
                      SpatialPrism(replace(JAHROMY, k=np.array([1.0, 2.0])))):  # fmt: skip
        with pytest.raises(ValueError, match="one design"):
            MujocoModel(mechanism)
    model = model_of("spatial prism")
    with pytest.raises(ValueError, match="load"):
        model.step((0.8, 0.8, 0.8), (1.0, 2.0))
