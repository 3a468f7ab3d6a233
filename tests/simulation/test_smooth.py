"""Smooth dynamics against MuJoCo's steps, the balance of energy, and differences."""

from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import tensegrity_envs  # noqa: F401 registers the environments
from tensegrity_envs.compiler.pytree import is_row, tree_leaves, tree_map
from tensegrity_envs.env import unwrapped
from tensegrity_envs.simulation.dynamic import check_smooth
from tensegrity_envs.simulation.protocol import RUNNING

jax = pytest.importorskip("jax")
pytest.importorskip("mujoco")

import jax.numpy as jnp  # noqa: E402

from tensegrity_envs.simulation.smooth import SmoothDynamics  # noqa: E402

N = 48
FAST, TWO_X, THREE_X, LOADED = (
    f"tensegrity/{name}MuJoCo-v0"
    for name in ("DualTriangleFastReach", "TwoXFastReach", "ThreeXTensionReach", "DualTriangleLoadedReach")
)
FREE = {"joint_friction": 0.0}
compiled = partial(jax.jit, compiler_options={"xla_disable_hlo_passes": "fusion,cpu-fusion,cpu-instruction-fusion"})


@pytest.fixture(autouse=True, scope="module")
def _double_precision():
    """JAX computes in float64 for these tests alone."""
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


def core_of(env_id: str, **options: Any) -> Any:
    return unwrapped(gym.make(env_id, **options)).core


def kept(rows: Any, matrix: Any) -> Any:
    """The pytree of a matrix, with JAX's arrays."""
    return tree_map(lambda row: jnp.asarray(matrix[row] != 0 if row.kind == "bool" else matrix[row]), rows, is_row)


def is_of_jax(value: object) -> bool:
    return isinstance(value, jax.Array)


class Both:
    """The same episodes in an environment and in smooth dynamics."""

    def __init__(self, core: Any, n: int = N) -> None:
        self.core, self.n = core, n
        self.episodes, self.engine = core.begin(np.full(n, 5), np.arange(n))
        self.episode = kept(core.episodes.rows, self.episodes)
        # In arms at rest the actuators have reached the inputs; the engine's own state is for the engine alone.
        self.state = kept(core.states.rows._replace(physics=core.states.rows.inputs), self.engine)
        self.dynamics = SmoothDynamics(core)
        self.ended = np.zeros(n, bool)

        def step(leaves, actions):
            state = self.dynamics.step(self.episode, self._state(leaves), tuple(actions))[0].state
            numbers = tree_leaves(state, lambda value: isinstance(value, jax.Array | float | int))
            return [jnp.broadcast_to(jnp.asarray(one, float), (n,)) for one in numbers]

        self._step = compiled(step)
        self.leaves = [jnp.asarray(one, float) for one in tree_leaves(self.state, is_of_jax)]

    def _state(self, leaves: Any) -> Any:
        given = iter(leaves)
        return tree_map(lambda _: next(given), self.state, is_of_jax)

    def step(self, actions: np.ndarray) -> tuple[Any, Any]:
        """The states of both after actions of shape (n, inputs)."""
        self.engine = self.core.step(self.episodes, self.engine, np.ascontiguousarray(actions.T))
        self.leaves = self._step(self.leaves, jnp.asarray(actions.T))
        theirs, ours = self.core.outcomes.unpack(self.engine).state, self._state(self.leaves)
        self.ended |= (np.asarray(theirs.failure) != RUNNING) | (np.asarray(ours.failure) != RUNNING)
        return theirs, ours

    def off(self, actions: list[np.ndarray]) -> np.ndarray:
        """How far the tips are apart [m], of the episodes that go on, shape (steps, episodes)."""
        found = []
        for action in actions:
            theirs, ours = self.step(action)
            found.append(np.hypot(*(np.asarray(a) - np.asarray(b) for a, b in zip(theirs.tip, ours.tip, strict=True))))
        assert self.ended.mean() < 0.3
        moved = np.hypot(*(np.asarray(a) for a in theirs.velocity[:2]))[~self.ended]
        assert np.median(moved) > 0.05  # [rad/s]: there is something to compare
        return np.array(found)[:, ~self.ended]


def drawn_actions(core: Any, steps: int = 10, n: int = N) -> list[np.ndarray]:
    """Actions that change twice, so that arms move, but not beyond their limits."""
    rng, size = np.random.default_rng(0), core.simulation.action_size
    turns = [0.3 * rng.uniform(-1, 1, (n, size)) for _ in range(-(-steps // 5))]
    return [turns[k // 5] for k in range(steps)]


@pytest.mark.parametrize("level", [0, 3])
def test_an_open_chain_moves_as_in_the_engine(level):
    """Bars of another mass, springs, damping, delays: whatever is drawn. An open chain has no constraints to solve."""
    core = core_of(FAST, level=level, dynamics=FREE)
    assert Both(core).off(drawn_actions(core)).max() < 1e-9


def test_a_loaded_chain_moves_as_in_the_engine():
    core = core_of(LOADED, dynamics=FREE)
    assert Both(core).off(drawn_actions(core)).max() < 1e-9


@pytest.mark.parametrize(("env_id", "options"), [(TWO_X, {}), (TWO_X, {"level": 3}), (THREE_X, {})])
def test_loops_are_closed_as_in_the_engine(env_id, options):
    """There by constraints of some stiffness, here exactly."""
    core = core_of(env_id, dynamics=FREE, **options)
    assert np.median(Both(core).off(drawn_actions(core)), axis=1).max() < 1e-4


@pytest.mark.parametrize("env_id", [FAST, TWO_X])
def test_dry_friction_is_nearly_that_of_the_engine(env_id):
    """There it holds what is at rest, here it is smooth: a third of a millimetre. Without it tips are farther apart."""
    with_it, without = (Both(core_of(env_id, dynamics=dynamics)) for dynamics in (None, FREE))
    assert with_it.core.dynamics.joint_friction > 0
    without.core = with_it.core  # the engine has it in either case
    near, far = (np.median(both.off(drawn_actions(both.core)), axis=1).max() for both in (with_it, without))
    assert near < 3e-4
    assert far > 3 * near


@pytest.mark.parametrize("env_id", [FAST, TWO_X])
def test_energy_stays_in_a_free_swing(env_id):
    """Of rods whose ends move, of a point, and what the members store. Its error is that of the time step, h."""
    free = {"joint_friction": 0.0, "joint_damping": 0.0, "actuator_bandwidth": 0.0}
    core = core_of(env_id, dynamics=free)
    found = {}
    for substeps in (10, 20):
        energy, kinetic = _swing(core, substeps)
        assert kinetic.max(axis=0).min() > 5e-4
        found[substeps] = np.abs(energy - energy[0]).max(axis=0) / kinetic.max(axis=0)
    assert np.median(found[20]) < 0.05
    assert 1.7 < np.median(found[10] / found[20]) < 2.3


def _swing(core: Any, substeps: int, steps: int = 25, n: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """Energy and its kinetic part [J] after each step of arms that are let go beside their equilibria."""
    both, dynamics = Both(core, n), SmoothDynamics(core, substeps)
    state, inputs, load = both.state, both.state.inputs, (0.0, 0.0)
    q = tuple(a + 0.05 for a in state.configuration)
    v = tuple(0.0 * a for a in q)

    @compiled
    def move(q, v):
        motion = dynamics.move(both.episode, state._replace(configuration=q, velocity=v), inputs, load)
        return motion.configuration, motion.velocity

    arm, total, kinetic = core.nominal, [], []
    actuation = tuple(np.asarray(a) for a in core.simulation.actuation(arm, tuple(np.asarray(u) for u in inputs)))
    for _ in range(steps):
        q, v = move(q, v)
        at, rate = (tuple(np.asarray(part) for part in parts) for parts in (q, v))
        moving = _kinetic(core, at, rate)
        kinetic.append(moving)
        total.append(moving + arm.potential_energy(at, actuation))
    return np.array(total), np.array(kinetic)


def _kinetic(core: Any, q: tuple, v: tuple, span: float = 1e-6) -> np.ndarray:
    """Of rods and tip, whose velocities are differences of the nodes' positions."""
    arm = core.nominal
    ahead, behind = (arm.nodes(tuple(a + sign * span * b for a, b in zip(q, v, strict=True))) for sign in (1, -1))
    velocity = {
        name: np.stack(
            [np.broadcast_to((a - b) / (2 * span), q[0].shape) for a, b in zip(ahead[name], behind[name], strict=True)]
        )
        for name in ahead
    }
    payload = getattr(core.design, "payload", None)
    energy = 0.5 * (core.dynamics.tip_mass if payload is None else payload) * (velocity["P"] ** 2).sum(axis=0)
    place = arm.nodes(tuple(0.0 for _ in q))
    for bar in arm.members:
        if bar.is_rigid:
            a, b = (velocity[name] for name in bar.nodes)
            length = float(np.hypot(*np.subtract(*(place[name] for name in bar.nodes))))
            mass = bar.mass or core.dynamics.bar_line_density * length
            energy = energy + mass / 6 * (a * a + a * b + b * b).sum(axis=0)
    return energy


@pytest.mark.parametrize("env_id", [FAST, TWO_X])
def test_derivatives_of_a_step(env_id):
    """Forward and backward, in what the state holds and in the action, against differences."""
    both = Both(core_of(env_id), 6)
    dynamics, state = both.dynamics, both.state
    rng = np.random.default_rng(0)
    names = ("configuration", "velocity", "inputs", "physics")
    parts = [getattr(state, name) for name in names]
    sizes = [1.0, 1.0, 0.01, 0.01]  # of a direction's part: inputs in [m], or [N]
    moving = [jnp.asarray(rng.uniform(-1, 1, (len(part), 6))) for part in parts]
    start = [jnp.stack(part) for part in parts]
    start[1] = moving[1]
    action = jnp.asarray(rng.uniform(-0.3, 0.3, (both.core.simulation.action_size, 6)))
    way = [
        size * jnp.asarray(rng.uniform(-1, 1, one.shape))
        for size, one in zip([*sizes, 1.0], [*start, action], strict=True)
    ]

    def result(*given):
        changed = state._replace(**{name: tuple(one) for name, one in zip(names, given[:-1], strict=True)})
        after = dynamics.step(both.episode, changed, tuple(given[-1]))[0].state
        return jnp.stack([*after.configuration, *after.velocity, *after.tip])

    given = (*start, action)
    slope = np.asarray(compiled(lambda at, to: jax.jvp(result, at, to)[1])(given, tuple(way)))
    h = 1e-6
    forward = compiled(result)
    ahead, behind = (forward(*(a + sign * h * b for a, b in zip(given, way, strict=True))) for sign in (1, -1))
    expected = np.asarray((ahead - behind) / (2 * h))
    assert np.abs(expected).max(axis=1).min() > 1e-3
    np.testing.assert_allclose(slope, expected, rtol=1e-5, atol=1e-7 * np.abs(expected).max())
    weight = jnp.asarray(rng.uniform(-1, 1, slope.shape))
    pulled = compiled(lambda at, to: jax.vjp(result, *at)[1](to))(given, weight)
    along = sum(float((a * b).sum()) for a, b in zip(pulled, way, strict=True))
    assert along == pytest.approx(float((weight * slope).sum()), rel=1e-9)


@pytest.mark.parametrize(
    ("env_id", "message"),
    [
        ("TwoXReach", "only quasi-static environments that are driven by inputs"),
        ("PlanarFourBarReachMuJoCo", "prismatic actuators or a platform"),
        ("SpatialPrismTrackMuJoCo", "prismatic actuators or a platform"),
        ("DualTriangleObstacleReach", "environments with obstacles"),
    ],
)
def test_what_has_no_smooth_dynamics_is_refused(env_id, message):
    core = core_of(f"tensegrity/{env_id}-v0")
    for refuses in (check_smooth, SmoothDynamics):
        with pytest.raises(ValueError, match=message):
            refuses(core)
