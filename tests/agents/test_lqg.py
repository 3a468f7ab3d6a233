"""LQG: regulator, filter, delay and allocation, each by an independent route."""

from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from scipy.optimize import lsq_linear

pytest.importorskip("mujoco")

from baseline_runs import columns_of
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.controllers.believed_plant import BelievedPlant
from tensegrity_agents.controllers.delay_line import first_line, seen, sent
from tensegrity_agents.controllers.kalman import ArmFilter, corrected
from tensegrity_agents.controllers.torque_regulator import allocated, effect_of, torque_motion
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_envs.observation import DecodedObservation
from tensegrity_envs.seeding import TEST_SEED, VALIDATION_SEED
from tensegrity_envs.simulation.mujoco.linearizing import linearize

IDS = ("tensegrity/TwoXFastReachMuJoCo-v0", "tensegrity/DualTriangleFastReachMuJoCo-v0")


@pytest.mark.parametrize("delay", [0, 1, 2])
@pytest.mark.parametrize("env_id", IDS)
def test_the_linear_loop_with_filter_and_delay_is_stable(env_id, delay):
    """Arm, filter of angles and rates, and prediction through the actions on the way, in one matrix."""
    controller = make_controller("lqg", env_id, {"level": 2})
    env = gym.make(env_id)
    for seed in range(2):
        info = env.reset(seed=seed)[1]
        q, inputs = info["configuration"], np.array(info[env.unwrapped.core.input_name])
        low, high = controller.low, controller.high
        inputs = np.clip(inputs, low + 0.01 * (high - low), high - 0.01 * (high - low))
        gain = controller._gain_at(q, inputs, controller.model.mass_matrix(q))
        assert np.abs(gain).max() > 0
        actuation = controller.plant.actuation(inputs[None])
        simulation, nominal = controller.simulation, controller.core.nominal
        effect = effect_of(simulation, nominal, q[None], inputs[None], controller.rate)[1][0]
        into = (controller.plant.actuation(inputs - np.linalg.pinv(effect).T) - actuation).T
        a, b = torque_motion(linearize(controller.model, q, actuation[0]), into, controller.follows)
        joints, size = controller.joints, len(a)
        assert np.abs(np.linalg.eigvals(a - b @ gain)).max() < 1
        # The filter's steady gain, of angles and rates; torques follow from the inputs, which are measured.
        h, known = np.eye(size), [1e-9**2] * (size - 2 * joints)
        noise = np.diag([1e-3**2] * joints + [0.03**2] * joints + known)
        drift = np.diag([1e-4**2] * joints + [0.03**2] * joints + known)
        p = np.eye(size)
        for _ in range(300):
            p = a @ p @ a.T + drift
            k = p @ h.T @ np.linalg.inv(h @ p @ h.T + noise)
            p = (np.eye(size) - k @ h) @ p
        # State: true z, believed z, the actions on the way (the newest first).
        m = b.shape[1]
        ahead = np.linalg.matrix_power(a, delay)
        act = -gain @ np.hstack(
            [np.zeros((size, size)), ahead, *(np.linalg.matrix_power(a, j) @ b for j in range(delay))]
        )
        n = 2 * size + m * delay
        taken = np.hstack([np.zeros((m, n - m)), np.eye(m)]) if delay else act
        true = np.hstack([a, np.zeros((size, n - size))]) + b @ taken
        believed = np.hstack([np.zeros((size, size)), a, np.zeros((size, n - 2 * size))]) + b @ taken
        believed = believed + k @ h @ (true - believed)
        loop = np.vstack([true, believed])
        if delay:
            older = np.hstack([np.zeros((m * (delay - 1), 2 * size)), np.eye(m * (delay - 1), m * delay)])
            loop = np.vstack([loop, act, older])
        assert np.abs(np.linalg.eigvals(loop)).max() < 1 - 1e-6


class LinearPlant:
    """x' = f x + g p + push u of two joints with a parameter, in the place of a believed simulation."""

    joints, names, ranges, variance = 2, ("stiffness",), np.array([[-9.0, 9.0]]), np.array([0.5])
    f = np.array([[1.0, 0.0, 0.1, 0.0], [0.0, 1.0, 0.0, 0.1], [-0.3, 0.1, 0.9, 0.0], [0.1, -0.4, 0.0, 0.8]])
    g, push = np.array([0.0, 0.0, 0.2, -0.3]), np.array([[0.0], [0.0], [0.1], [0.2]])

    def __init__(self):
        slope = np.array([[0.5, 0.2], [-0.1, 0.4]])

        def tip(q):
            return tuple(slope @ np.stack(q))

        def jacobian(q):
            return tuple(tuple(np.full(len(q[0]), s) for s in row) for row in slope)

        nominal = SimpleNamespace(tip=tip, jacobian=jacobian)
        drawn = SimpleNamespace(angle_noise=0.02, tip_noise=0.01, is_noisy=True)
        self.core, self.slope = SimpleNamespace(nominal=nominal, randomization=drawn), slope

    def follows(self, estimates):
        return np.ones(len(estimates))

    def actuation(self, inputs):
        return inputs

    def states(self, q, rates, reached):
        return np.concatenate([q, rates], axis=1)

    def models(self, estimates):
        return [estimate[0] for estimate in estimates]

    def moved(self, states, commands, models, load):
        assert load is None
        return states @ self.f.T + np.array(models)[:, None] * self.g + commands @ self.push.T

    def read(self, states):
        return states


def test_the_filter_is_the_gaussian_posterior():
    """All states and measurements of an episode as one Gaussian, conditioned at once."""
    plant, rng, steps = LinearPlant(), np.random.default_rng(0), 6
    kalman = ArmFilter(plant)

    def seen_at(z, u):
        return DecodedObservation(
            {"joint_angles": z[None, :2], "tip": z[None, 2:4], "joint_rates": z[None, 4:], "inputs": u[None]}
            | {"target": np.zeros((1, 2))}
        )

    z, u = rng.normal(size=(steps, 6)), rng.normal(size=(steps, 1))
    belief = kalman.first(seen_at(z[0], u[0]))
    for k in range(1, steps):
        belief = kalman.measured(kalman.moved(belief, u[k][None]), seen_at(z[k], u[k]))
    # The prior of `first`: angles where they are seen, which it then measures.
    size = 5
    f = np.eye(size)
    f[:4, :4], f[:4, 4] = plant.f, plant.g
    h = np.zeros((6, size))
    h[:2, :2], h[2:4, :2], h[4:, 2:4] = np.eye(2), plant.slope, np.eye(2)
    mean, spread = np.zeros(size), np.diag([0.02**2, 0.02**2, 1e-8, 1e-8, 0.5])
    mean[:2] = z[0, :2]
    means, maps = [mean], [np.hstack([np.eye(size), np.zeros((size, size * (steps - 1)))])]
    for k in range(1, steps):
        drive = np.zeros(size)
        drive[:4] = plant.push @ u[k]
        means.append(f @ means[-1] + drive)
        step = f @ maps[-1]
        step[:, size * k : size * (k + 1)] += np.eye(size)
        maps.append(step)
    sources = np.zeros((size * steps, size * steps))
    for k in range(steps):
        sources[size * k : size * (k + 1), size * k : size * (k + 1)] = spread if k == 0 else kalman.drift
    whole = np.vstack([h @ m for m in maps])
    expected = np.concatenate([h @ m for m in means])
    noise = np.kron(np.eye(steps), kalman.noise)
    cross = maps[-1] @ sources @ whole.T
    inverse = np.linalg.inv(whole @ sources @ whole.T + noise)
    posterior = means[-1] + cross @ inverse @ (z.ravel() - expected)
    covariance = maps[-1] @ sources @ maps[-1].T - cross @ inverse @ cross.T
    np.testing.assert_allclose(belief.mean[0], posterior, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(belief.covariance[0], covariance, rtol=1e-5, atol=1e-10)


def test_a_correction_keeps_the_covariance_symmetric_and_positive():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(3, 4, 4))
    covariance = root @ root.transpose(0, 2, 1)
    _, left = corrected(np.zeros((3, 4)), covariance, np.ones((3, 2)), rng.normal(size=(3, 2, 4)), 1e-6 * np.eye(2))
    np.testing.assert_allclose(left, left.transpose(0, 2, 1), atol=1e-12)
    assert (np.linalg.eigvalsh(left) > 0).all()


def test_the_delay_is_found_from_the_inputs():
    rng, n, rate = np.random.default_rng(2), 12, 0.1
    true = np.arange(n) % 4
    inputs = np.zeros((n, 2))
    line, given = first_line(inputs, (0, 3)), []
    assert (line.delay == 1).all()  # the mean of the range, 1.5, halves downwards
    for k in range(8):
        line = seen(line, inputs, rate, -1.0, 1.0)
        action = rng.uniform(-1, 1, (n, 2))
        line = sent(line, inputs, action)
        given.append(action)
        taken = np.stack([given[k - d][i] if k >= d else np.zeros(2) for i, d in enumerate(true)])
        inputs = np.clip(inputs + rate * taken, -1, 1)
    assert np.array_equal(line.delay, true) and (line.possible.sum(axis=1) == 1).all()


def test_allocation_makes_the_torques_that_bounds_allow():
    """Where the bounds allow it; else about as near as bounded least squares come."""
    rng = np.random.default_rng(3)
    effect, near = rng.normal(size=(200, 2, 4)), rng.uniform(0, 1, (200, 4))
    wanted = np.einsum("nij,nj->ni", effect, rng.uniform(0.0, 1.0, (200, 4)))
    found = allocated(effect, wanted, near, 0.0, 1.0)
    assert (found >= 0).all() and (found <= 1).all()
    left = np.linalg.norm(np.einsum("nij,nj->ni", effect, found) - wanted, axis=1)
    assert np.mean(left < 1e-4) > 0.9
    # Torques that cannot be made.
    beyond = 3 * wanted
    found = allocated(effect, beyond, near, 0.0, 1.0)
    left = np.linalg.norm(np.einsum("nij,nj->ni", effect, found) - beyond, axis=1)
    best = [2 * lsq_linear(e, w, (0.0, 1.0)).cost for e, w in zip(effect[:40], beyond[:40], strict=True)]
    assert np.median(left[:40] - np.sqrt(best)) < 0.2


@pytest.mark.parametrize("env_id", IDS)
def test_estimates_are_those_of_the_simulation(env_id):
    """At the true parameters the believed simulation is the environment's own, to within the grid of the models."""
    env = gym.make(env_id, level=2)
    info = env.reset(seed=4)[1]
    core = env.unwrapped.core
    plant = BelievedPlant(core)
    told = np.array([plant._told(name, float(info[f"random_{name}"])) for name in plant.names])[None]
    q, inputs = info["configuration"][None], np.array(info[core.input_name])[None]
    states = plant.states(q, 0 * q, plant.actuation(inputs))
    assert plant.factors(told)["stiffness"][0] == pytest.approx(float(info["random_stiffness"]))
    for k in range(4):
        action = 0.5 * np.cos(np.arange(inputs.shape[1]) + k)
        info = env.step(action.astype(np.float32))[4]
        states = plant.moved(states, plant.actuation(np.array(info[core.input_name])[None]), plant.models(told))
    assert plant.read(states)[0, : plant.joints] == pytest.approx(info["configuration"], abs=2e-3)


@pytest.mark.parametrize("env_id", IDS)
def test_it_settles_sooner_than_the_regulator(env_id):
    settled = {}
    for name in ("lqr", "lqg"):
        columns = columns_of(env_id, name)
        settled[name] = np.median(columns["settling_time_s"])
        assert name == "lqr" or columns["success"].mean() >= 0.96
    assert settled["lqg"] < settled["lqr"]


@pytest.mark.full
@pytest.mark.parametrize("env_id", IDS)
def test_it_holds_at_level_2(env_id):
    options = {"level": 2}
    columns = evaluate(
        make_controller("lqg", env_id, options), env_id, 20, VALIDATION_SEED, "lqg", env_options=options
    ).columns
    assert columns["success"].mean() >= 0.9


def test_the_path_of_an_arm_that_begins_elsewhere_stays_within_the_joint_limits():
    """There the nominal arm would rest 0.46 rad from where this one begins, and the path led to 2.83 rad: an error."""
    env_id, options = "tensegrity/TwoXTensionReachUncertainMuJoCo-v0", {"level": 3}
    controller, env = make_controller("lqg", env_id, options), gym.make(env_id, **options)
    seen = {key: value[None] for key, value in env.reset(seed=TEST_SEED + 14)[0].items()}
    action, memory = controller.predict(seen)
    limit = controller.model.linkage.limit
    assert np.abs(memory.path).max() == pytest.approx(limit)
    assert np.isfinite(action).all()
    env.close()
