"""Linear models against finite differences of real steps of the environments, and against closed forms."""

import gymnasium as gym
import numpy as np
import pytest

from tensegrity_envs import ENV_IDS, linearize
from tensegrity_envs.mechanics.dual_triangle import DualTriangle
from tensegrity_envs.mechanics.two_x import TwoX

IDS = [env_id for env_id in ENV_IDS if "Uncertain" not in env_id]


class Rest:
    """An environment at rest under a load that stays, and inputs within their bounds, where the usual tensions are."""

    def __init__(self, env_id):
        if "MuJoCo" in env_id:
            pytest.importorskip("mujoco")
        options = {"load_per_step": 1e-9} if "Push" in env_id else {}
        if "Fast" in env_id:
            options = {"dynamics": {"joint_friction": 0.0}}  # which linear models leave out
        self.core = core = gym.make(env_id, **options).unwrapped.core
        self.episode, self.outcome = core.begin(np.array([3]), np.array([0]))
        episode = core.episodes.unpack(self.episode[:, 0])
        state = core.outcomes.unpack(self.outcome[:, 0]).state
        self.design, self.load = episode.design, tuple(episode.load_at(0.0)) or None
        self.posture, self.inputs = state.configuration, state.inputs
        if not hasattr(core.simulation, "actuation"):
            self.inputs = self.load = None
        elif core.simulation.rate_unit == "N":
            low, high = core.simulation.bounds(core.mechanism(self.design))
            self.inputs = tuple(np.clip(state.inputs, low + 5.0, high - 5.0).tolist())
            found = core.mechanism(self.design).equilibrium(self.inputs, self.posture, (0.0, 0.0))
            assert found.is_stable
            self.posture, rows = found.configuration, core.states.rows
            self.outcome[list(rows.configuration)] = np.array(self.posture)[:, None]
            self.outcome[list(rows.inputs)] = np.array(self.inputs)[:, None]
            if core.engine is not None:
                core._motion.begin(core.engine, self.outcome)

    def linearized(self):
        return linearize(self.core, self.posture, self.inputs, self.load, self.design)

    def after(self, actions, steps=1):
        """The outcomes after these actions, of shape (actions, n), and then none."""
        n = actions.shape[1]
        episodes, outcomes = np.repeat(self.episode, n, axis=1), np.repeat(self.outcome, n, axis=1)
        for step in range(steps):
            outcomes = self.core.step(episodes, outcomes, actions if step == 0 else np.zeros_like(actions))
        return outcomes

    def states(self, outcomes):
        """The states of the linear model, one column each, and the goals achieved."""
        core = self.core
        state = core.outcomes.unpack(outcomes).state
        inputs = state.inputs if self.inputs is not None else ()
        if core.engine is None:
            parts = (*state.configuration, *inputs)
        else:
            model = core.engine.model
            physics = np.stack(state.physics)
            lag = () if model.is_ramped else physics[1 + model.model.nq + model.model.nv :]
            parts = (*model.configuration(physics.T).T, *model.velocity(physics.T).T, *lag, *inputs)
        return np.stack(parts), np.stack(core.achieved(state))

    def differences(self, steps, h=1e-4):
        """How states and goals after so many steps depend on the first action."""
        k = self.core.simulation.action_size
        found = self.states(self.after(np.concatenate([h * np.eye(k), -h * np.eye(k)], axis=1), steps))
        return tuple((values[:, :k] - values[:, k:]) / (2 * h) for values in found)


@pytest.mark.parametrize("env_id", IDS)
def test_linear_models_are_the_derivatives_of_real_steps(env_id):
    rest = Rest(env_id)
    model = rest.linearized()
    still, _ = rest.states(rest.outcome)
    assert model.state == pytest.approx(still[:, 0], abs=1e-12)
    assert len(model.state_names) == len(model.state)
    loops = rest.core.engine is not None and rest.core.engine.model.linkage.loops
    share = 5e-3 if loops else 4e-5  # MuJoCo's solver closes loops, and servos hold, only so well
    for steps in (1, 2, 5):
        states, goals = rest.differences(steps)
        power = np.linalg.matrix_power(model.A, steps - 1) @ model.B
        for found, ours in ((states, power), (goals, model.C @ power)):
            assert ours == pytest.approx(found, abs=share * abs(found).max())
    assert not model.D.any() and model.D.shape == goals.shape


@pytest.mark.parametrize("env_id", IDS)
def test_running_environments_are_linearized_where_they_are(env_id):
    rest = Rest(env_id)
    env = gym.make(env_id)
    env.reset(seed=3)
    model = linearize(env)
    assert model.A.shape == rest.linearized().A.shape and model.dt == rest.linearized().dt
    assert model.output == pytest.approx(env.unwrapped._observation()["achieved_goal"], abs=1e-6)


def test_mechanisms_move_by_their_own_stiffness():
    # One segment in closed form: M(q, delta) = 0 along the equilibrium.
    arm = DualTriangle(segments=3)
    q = (0.3, -0.2, 0.1)
    lengths = arm.free_lengths(arm.control(q, None))
    model = linearize(arm, q, lengths)
    h = 1e-5
    for i in range(6):
        moved = [
            arm.equilibrium(tuple(np.array(lengths) + sign * h * np.eye(6)[i]), q, (0.0, 0.0)).configuration
            for sign in (1, -1)
        ]
        assert model.B[:3, i] == pytest.approx((np.array(moved[0]) - np.array(moved[1])) / (2 * h), abs=1e-6)


def test_slips_are_told():
    arm = TwoX()
    with pytest.raises(ValueError, match="inputs must be given"):
        linearize(arm, (0.3, 0.2))
    with pytest.raises(ValueError, match="no equilibrium"):
        linearize(arm, (0.3, 0.2), (10.0, 5.0, 5.0, 40.0))
    with pytest.raises(ValueError, match="finite"):
        linearize(arm, (0.3, float("nan")), (10.0, 5.0, 5.0, 40.0))
    with pytest.raises(ValueError, match="neither an environment"):
        linearize(3.0, (0.3, 0.2))
    with pytest.raises(ValueError, match="runs an episode"):
        linearize(gym.make("tensegrity/TwoXReach-v0").unwrapped.core)
    with pytest.raises(ValueError, match="lengths"):
        linearize(gym.make("tensegrity/PlanarFourBarReach-v0"), (0.3, 0.2))


@pytest.mark.parametrize(
    "env_id", ["TwoXStiffnessReach-v0", "ThreeXStiffnessReach-v0", "TwoXReach-v0", "DualTriangleReach-v0"]
)
def test_postures_are_within_the_joint_limits(env_id):
    core = gym.make(f"tensegrity/{env_id}").unwrapped.core
    n, limit = len(core.states.rows.configuration), float(core.design.joint_limit)
    for posture in ((99.0,) * n, (0.0,) * (n - 1) + (-limit - 1e-6,)):
        with pytest.raises(ValueError, match=f"beyond the joint limits, {limit:.6g} rad"):
            linearize(core, posture)
    for size in (0, n - 1, n + 1):
        with pytest.raises(ValueError, match=r"numbers?, must be"):
            linearize(core, (0.1,) * size)
    with pytest.raises(ValueError, match="finite"):
        linearize(core, (float("nan"),) * n)


@pytest.mark.parametrize("env_id", ["ThreeXObstacleReach-v0", "TwoXReach-v0"])
def test_joint_control_has_neither_inputs_nor_loads(env_id):
    core = gym.make(f"tensegrity/{env_id}").unwrapped.core
    posture = (0.1,) * len(core.states.rows.configuration)
    assert len(linearize(core, posture).state) == len(posture)
    for given in ({"load": (0.0, 0.0)}, {"inputs": (1.0,) * 7}):
        with pytest.raises(ValueError, match="joint control"):
            linearize(core, posture, **given)


def test_designs_are_resolved():
    core = gym.make("tensegrity/TwoXTensionReach-v0").unwrapped.core
    with pytest.raises(TypeError, match="design = 3"):
        linearize(core, (0.1, 0.2), design=3)
    with pytest.raises(ValueError, match=r"joint limits, 1\.5 rad"):
        linearize(core, (1.6, 0.2), design={"joint_limit": 1.5})


@pytest.mark.parametrize("env_id", ["TwoXReach-v0", "TwoXTensionReach-v0", "DualTriangleReachMuJoCo-v0"])
def test_the_state_space_of_python_control_responds_as_the_environment(env_id):
    control = pytest.importorskip("control")
    rest = Rest(f"tensegrity/{env_id}")
    model = rest.linearized()
    system = model.to_control()
    assert isinstance(system, control.StateSpace) and system.isdtime(strict=True)
    assert system.dt is True if model.dt is None else system.dt == 0.02
    assert system.state_labels == list(model.state_names)
    assert (system.input_labels[0], system.output_labels) == ("a1", ["y1", "y2"])
    for name in "ABCD":
        np.testing.assert_array_equal(getattr(system, name), getattr(model, name))
    steps, k = 4, system.ninputs
    pulses = np.zeros((k, steps + 1))
    real = {n: rest.differences(n) for n in range(1, steps + 1)}
    times = np.arange(steps + 1) * (model.dt or 1.0)
    for i in range(k):
        pulses[:] = 0.0
        pulses[i, 0] = 1.0
        found = control.forced_response(system, times, pulses)
        for n, (states, goals) in real.items():
            assert found.states[:, n] == pytest.approx(states[:, i], abs=4e-5 * abs(states).max())
            assert found.outputs[:, n] == pytest.approx(goals[:, i], abs=4e-5 * abs(goals).max())
