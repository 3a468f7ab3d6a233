"""The dynamic models agree with the analytic ones, and neither flip nor diverge unnoticed."""

import math
import subprocess
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mujoco_measurements import (
    MECHANISMS,
    drift,
    energies,
    frequencies,
    input_range,
    relax,
    stress,
)

from tensegrity_envs.mechanics import (
    FURET2018,
    MURALIDHARAN2022,
    ZHAO2021_CAPTION,
    DualTriangle,
    DualTriangleDesign,
    TwoX,
)
from tensegrity_envs.simulation.mujoco import Dynamics, MujocoModel

every_mechanism = pytest.mark.parametrize("name", MECHANISMS)
MODELS = {}


def model_of(name):
    if name not in MODELS:
        MODELS[name] = MujocoModel(MECHANISMS[name])
    return MODELS[name]


# ------------------------------------------------------------------------------------------ against the analytic models


@pytest.mark.parametrize(("name", "tolerance"), [("two-x", 1e-4), ("dual-triangle", 1e-9)])
@pytest.mark.parametrize("count", [60, pytest.param(200, marks=pytest.mark.full)])
def test_settled_equilibrium_on_random_feasible_inputs(name, tolerance, count):
    errors, loops = relax(name, count)
    assert len(errors) == count
    assert errors.max() < tolerance
    assert loops.max() < 1e-5


@pytest.mark.parametrize(("name", "tolerance"), [("two-x with payload", 1e-4), ("dual-triangle, cables", 1e-9)])
def test_settled_equilibrium_of_the_others(name, tolerance):
    errors, loops = relax(name, 20)
    assert errors.max() < tolerance
    assert loops.max() < 1e-5


@every_mechanism
def test_energy_and_its_gradient_are_the_analytic_ones(name):
    assert (energies(name, 100) < 1e-9).all()


@pytest.mark.parametrize("name", ["two-x", "dual-triangle"])
def test_plain_damping_ends_in_the_same_equilibrium(name):
    model = model_of(name)
    u = np.array([100.0, 80.0, 60.0, 70.0]) if name == "two-x" else np.array([0.02, 0.03, 0.03, 0.02, 0.02, 0.025])
    settled = model.relax(u, np.zeros(model.linkage.size)).configuration
    damped = MujocoModel(model.mechanism, Dynamics(joint_damping=0.2))
    states = damped.rollout(damped.state(np.zeros((1, model.linkage.size))), u, steps=20_000).states
    np.testing.assert_allclose(damped.configuration(states)[0], settled, rtol=0, atol=1e-6)


@every_mechanism
def test_small_oscillations_have_the_frequencies_of_hessian_and_mass_matrix(name):
    expected, simulated = frequencies(name)
    np.testing.assert_allclose(simulated, expected, rtol=1e-3)


@every_mechanism
def test_energy_drifts_little_without_damping(name):
    change, above = drift(name, "RK4", 2.0)
    assert change < 2e-3 * above
    change, above = drift(name, "implicitfast", 2.0)
    assert change < 0.5 * above


@every_mechanism
def test_mass_matrix_by_kinetic_energy(name):
    model = model_of(name)
    rng = np.random.default_rng(3)
    q, rate = rng.uniform(-1.0, 1.0, (2, model.linkage.size))
    u = input_range(model.mechanism)[0]
    moving = model.energy(model.state(q, rate), u) - model.energy(model.state(q), u)
    assert moving == pytest.approx(rate @ model.mass_matrix(q) @ rate / 2, rel=1e-9)


def test_mass_matrix_of_the_two_x_by_differences_of_its_bars():
    model = model_of("two-x with payload")
    mechanism, q, h = model.mechanism, np.array([0.7, -0.4]), 1e-6
    expected = np.zeros((2, 2))

    def rates(function):
        return np.array([(function(q + h * e) - function(q - h * e)) / (2 * h) for e in np.eye(2)])

    for bar in (m for m in mechanism.members if m.kind == "bar"):
        a, b = (rates(lambda p, n=n: np.array(mechanism.nodes(tuple(p))[n])) for n in bar.nodes)
        ends = np.array(mechanism.nodes(tuple(q))[bar.nodes[1]]) - mechanism.nodes(tuple(q))[bar.nodes[0]]
        turn = ((b - a) @ np.array([-ends[1], ends[0]])) / (ends @ ends)
        centre = (a + b) / 2
        inertia = bar.mass * (ends @ ends / 12 + bar.radius**2 / 4)  # a solid cylinder
        expected += bar.mass * centre @ centre.T + inertia * np.outer(turn, turn)
    tip = rates(lambda p: np.array(mechanism.tip(tuple(p))))
    expected += mechanism.design.payload * tip @ tip.T
    np.testing.assert_allclose(model.mass_matrix(q), expected, rtol=1e-7)


# ------------------------------------------------------------------------------------------------------ states, poses


@every_mechanism
def test_states_are_closed_and_read_back(name):
    model = model_of(name)
    rng = np.random.default_rng(4)
    q = rng.uniform(-model.linkage.limit, model.linkage.limit, (50, model.linkage.size))
    rate = rng.normal(0.0, 1.0, q.shape)
    states = model.state(q, rate)
    np.testing.assert_allclose(model.configuration(states), q, atol=1e-12)
    np.testing.assert_allclose(model.velocity(states), rate, atol=1e-9)
    assert model.loop_error(states).max() < 1e-14
    assert model.assembly_error(states).max() < 1e-12
    nodes = model.mechanism.nodes(tuple(q.T))
    for node, position in model.nodes(states).items():
        np.testing.assert_allclose(position, np.broadcast_arrays(*nodes[node]), atol=1e-14)
    np.testing.assert_allclose(model.tip(states).T, model.mechanism.tip(tuple(q.T)), atol=1e-14)
    model.reset(q[0])
    x, y = model.mechanism.tip(tuple(q[0]))
    np.testing.assert_allclose(model.data.site("tip").xpos, (x, 0.0, y), atol=1e-14)


def test_velocities_keep_the_loops_closed():
    model = model_of("two-x")
    q, rate, h = np.array([1.1, -0.8]), np.array([0.3, -0.7]), 1e-6
    by_differences = (model.linkage.joint_angles(q + h * rate) - model.linkage.joint_angles(q - h * rate)) / (2 * h)
    state = model.state(q, rate)
    np.testing.assert_allclose(state[1 + model.model.nq :][: model.model.nv], by_differences, atol=1e-9)


def test_a_flipped_loop_is_told():
    model = model_of("two-x")
    # both crossed bars of joint 1 upright, the top bar turned by pi: the loop is closed, but a parallelogram
    bodies, at = model.linkage.bodies, model.linkage.reference
    bars = [next(i for i, body in enumerate(bodies) if body.nodes == nodes) for nodes in (("A1", "C1"), ("B1", "D1"))]
    top = next(i for i, body in enumerate(bodies) if {"C1", "D1"} <= set(body.nodes))
    assert bodies[top].parent == bars[0]
    angles = np.zeros(6)
    angles[bars[0] - 1] = np.angle(1j / (at["C1"] - at["A1"]))
    angles[bars[1] - 1] = np.angle(1j / (at["D1"] - at["B1"]))
    angles[top - 1] = math.pi - angles[bars[0] - 1]
    assert model.linkage.loop_error(angles) < 1e-12
    b, l = model.mechanism.design.b, model.mechanism.design.l
    assert model.linkage.assembly_error(angles) == pytest.approx(2 * b * b / (l * l - b * b))


@pytest.mark.parametrize("threads", [1, 2])
def test_steps_and_rollouts_are_the_same_to_the_bit(threads):
    for name, lag in (("two-x", 0.0), ("dual-triangle", 10.0)):
        model = MujocoModel(MECHANISMS[name], Dynamics(actuator_bandwidth=lag, joint_friction=0.001))
        rng = np.random.default_rng(5)
        low, high = input_range(model.mechanism)
        u, loads = rng.uniform(low, high, (7, model.input_size)), rng.normal(0.0, 0.5, (7, 2))
        starts = rng.uniform(-0.5, 0.5, (7, model.linkage.size))
        states = model.state(starts, inputs=(low + high) / 2)
        for _ in range(3):
            states = model.rollout(states, u, loads, nthread=threads).states
        model.reset(starts[6], inputs=(low + high) / 2)
        for _ in range(3):
            assert model.step(u[6], loads[6])
        np.testing.assert_array_equal(model.current(), states[6])
        model.close()


def test_loads_act_at_the_tip():
    model = model_of("dual-triangle")
    u, load = np.full(6, 0.03), (0.1, 0.2)
    settled = model.relax(u, np.zeros(3), load).configuration
    np.testing.assert_allclose(
        settled, model.mechanism.equilibrium(tuple(u), (0.0,) * 3, load).configuration, atol=1e-9
    )


def test_actuators_lag_by_their_bandwidth():
    bandwidth = 5.0
    model = MujocoModel(MECHANISMS["dual-triangle"], Dynamics(actuator_bandwidth=bandwidth))
    states = model.state(np.zeros((1, 3)), inputs=np.full(6, 0.02))
    after = model.rollout(states, np.full(6, 0.04), steps=100).states
    expected = 0.04 - 0.02 * math.exp(-0.1 * 2 * math.pi * bandwidth)
    np.testing.assert_allclose(after[0, -6:], expected, rtol=1e-6)


# ---------------------------------------------------------------------------------------------------------- robustness


@every_mechanism
def test_bang_bang_inputs_neither_flip_nor_diverge(name):
    diverged, bad, assembly, loop, angle, _ = stress(name, 5_000)
    assert (diverged, bad) == (0, 0)
    assert assembly < 0.05
    assert loop < 0.005
    assert angle < model_of(name).linkage.limit + 0.2


@every_mechanism
def test_divergence_is_told_and_undone(name, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    model = model_of(name)
    states = model.state(np.zeros((3, model.linkage.size)))
    u = input_range(model.mechanism)[0]
    loads = np.array([[0.0, 0.0], [1e14, 1e13], [0.1, 0.0]])
    result = model.rollout(states, u, loads)
    np.testing.assert_array_equal(result.diverged, [False, True, False])
    np.testing.assert_array_equal(result.states[1], states[1])
    assert np.isfinite(result.states).all()
    start = model.reset(np.zeros(model.linkage.size))
    assert not model.step(u, loads[1])
    assert model.relax(u, np.zeros(model.linkage.size), loads[1]).reason == "diverged"
    assert not list(tmp_path.iterdir())  # MuJoCo's log
    assert capfd.readouterr() == ("", "")
    np.testing.assert_array_equal(model.current(), start)
    assert model.step(u, loads[2])


# ------------------------------------------------------------------------------------------------------------- designs


def test_other_designs():
    for mechanism in (
        TwoX(replace(MURALIDHARAN2022, a=0.0, joint_limit=2.0)),
        TwoX(replace(FURET2018(2 / 3), joint_limit=2.0)),
        TwoX(replace(MURALIDHARAN2022, bar_density=0.0, payload=0.2)),
        DualTriangle(DualTriangleDesign(0.03, 0.05, 0.04, 0.06, 400.0, 500.0, 0.05, 0.04), 4),
        DualTriangle(ZHAO2021_CAPTION, 1),
    ):
        model = MujocoModel(mechanism)
        n = mechanism.degrees_of_freedom
        rng = np.random.default_rng(6)
        q = rng.uniform(-0.9 * model.linkage.limit, 0.9 * model.linkage.limit, n)
        low, high = model.input_bounds
        u = rng.uniform(low, high)
        assert model.potential_energy(q, u) == pytest.approx(mechanism.potential_energy(tuple(q), tuple(u)), abs=1e-9)
        expected = mechanism.energy_gradient(tuple(q), tuple(u))
        np.testing.assert_allclose(model.energy_gradient(q, u), expected, rtol=0, atol=1e-9)
        assert np.linalg.eigvalsh(model.mass_matrix(q)).min() > 0


@pytest.mark.parametrize("name", MECHANISMS)
def test_variants_are_what_compiling_anew_gives(name):
    lag = Dynamics(actuator_bandwidth=10.0)
    model = MujocoModel(MECHANISMS[name], lag)
    dynamics = replace(lag, joint_damping=0.05, joint_friction=0.003, actuator_bandwidth=6.0)
    design = model.mechanism.design
    if name.startswith("two-x"):
        other = TwoX(replace(design, k1=500.0, k2=350.0, payload=0.2, bar_density=3000.0, max_tension=140.0))
    else:
        other = DualTriangle(replace(design, k1=450.0, k2=600.0))
        dynamics = replace(dynamics, bar_line_density=0.3, tip_mass=0.1)
    variant, anew = model.variant(other, dynamics), MujocoModel(other, dynamics)
    for field in ("body_mass", "body_inertia", "body_ipos", "body_invweight0", "dof_invweight0", "dof_damping",
                  "dof_frictionloss", "tendon_stiffness", "tendon_lengthspring", "tendon_invweight0",
                  "actuator_gainprm", "actuator_biasprm", "actuator_dynprm", "actuator_ctrlrange",
                  "actuator_forcerange", "actuator_acc0"):  # fmt: skip
        wanted = getattr(anew.model, field)
        np.testing.assert_allclose(getattr(variant, field), wanted, rtol=1e-9, atol=1e-12, err_msg=field)
    low, high = input_range(model.mechanism)
    u = (low + high) / 2
    states = model.state(np.full((2, model.linkage.size), 0.2), inputs=u)
    both = model.rollout(states, u, steps=100, models=[model.model, variant]).states
    np.testing.assert_array_equal(both[0], model.rollout(states, u, steps=100).states[0])
    np.testing.assert_allclose(both[1], anew.rollout(states, u, steps=100).states[1], atol=1e-9)
    assert abs(both[1] - both[0]).max() > 1e-4


def test_variants_that_need_another_model_say_so():
    model = model_of("two-x")
    for other in (replace(MURALIDHARAN2022, b=0.06), replace(MURALIDHARAN2022, bar_density=0.0)):
        with pytest.raises(ValueError, match="build another"):
            model.variant(TwoX(other))
    for dynamics in (Dynamics(timestep=0.0005), Dynamics(actuator_bandwidth=5.0)):
        with pytest.raises(ValueError, match="build another"):
            model.variant(dynamics=dynamics)
    with pytest.raises(ValueError, match="one for each"):
        model.rollout(model.state((0.0, 0.0))[None], np.full(4, 50.0), models=[])


def test_mjcf_file_holds_the_same_model(tmp_path):
    for name in MECHANISMS:
        model = MujocoModel(MECHANISMS[name], Dynamics(actuator_bandwidth=8.0, joint_friction=0.01))
        low, high = input_range(model.mechanism)
        q, u = np.full(model.linkage.size, 0.2), 0.7 * low + 0.3 * high
        path = model.to_mjcf(tmp_path / f"{name}.xml", q, u)
        reloaded = mujoco.MjModel.from_xml_path(str(path))
        for field in ("body_mass", "body_inertia", "jnt_range", "dof_damping", "tendon_stiffness", "actuator_gainprm",
                      "actuator_ctrlrange", "eq_solref", "eq_solimp", "body_gravcomp"):  # fmt: skip
            np.testing.assert_allclose(getattr(reloaded, field), getattr(model.model, field), rtol=1e-5, atol=1e-9)
        assert reloaded.opt.jacobian == model.model.opt.jacobian
        assert reloaded.opt.disableflags == model.model.opt.disableflags & ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        data = mujoco.MjData(reloaded)
        mujoco.mj_resetDataKeyframe(reloaded, data, 0)
        mujoco.mj_step(reloaded, data, nstep=200)
        model.reset(q, inputs=u)
        assert model.step(u, steps=200)
        np.testing.assert_allclose(data.qpos, model.data.qpos, atol=1e-4)


# ----------------------------------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("fields", "error", "what"),
    [
        ({"joint_damping": -1.0}, ValueError, "Dynamics.joint_damping = -1.0"),
        ({"bar_line_density": 0.0}, ValueError, "positive"),
        ({"timestep": 0.02}, ValueError, "0.005"),
        ({"timestep": math.nan}, ValueError, "finite"),
        ({"tip_mass": "heavy"}, TypeError, "number"),
        ({"frame_skip": 2.5}, TypeError, "integer"),
        ({"frame_skip": 0}, ValueError, "1 or more"),
        ({"integrator": "Euler"}, ValueError, "implicitfast"),
    ],
)
def test_bad_dynamics(fields, error, what):
    with pytest.raises(error, match=what):
        Dynamics(**fields)


def test_bad_input():
    model = model_of("two-x")
    good = np.full(4, 50.0)
    for q in ([0.0], [0.0, math.nan], [0.0, 2.7]):
        with pytest.raises(ValueError, match="configuration"):
            model.state(q)
    for inputs in ([50.0] * 3, [50.0, 50.0, 50.0, math.inf], [50.0, 50.0, 50.0, 200.0]):
        with pytest.raises(ValueError, match="inputs"):
            model.relax(inputs, (0.0, 0.0))
    with pytest.raises(ValueError, match="load"):
        model.step(good, (0.0, math.nan))
    with pytest.raises(ValueError, match="states"):
        model.rollout(model.state((0.0, 0.0)), good)
    with pytest.raises(ValueError, match="nthread"):
        model.rollout(model.state((0.0, 0.0))[None], good, nthread=0)
    with pytest.raises(ValueError, match="timestep"):
        MujocoModel(model.mechanism, Dynamics(timestep=0.002))
    with pytest.raises(ValueError, match="one design"):
        MujocoModel(TwoX(replace(MURALIDHARAN2022, k1=np.array([500.0, 600.0]), a=np.array([0.2, 0.3]))))


def test_without_mujoco_the_extra_is_named():
    code = (
        "import sys; sys.modules['mujoco'] = None\n"
        "import tensegrity_envs\n"
        "from tensegrity_envs.simulation.mujoco import Dynamics\n"
        "Dynamics()\n"
        "from tensegrity_envs.simulation.mujoco import MujocoModel\n"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert shown.returncode == 1
    assert 'pip install "tensegrity-envs[mujoco]"' in shown.stderr.splitlines()[-1]
