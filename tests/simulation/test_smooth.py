"""Smooth dynamics against MuJoCo's steps, the balance of energy, and differences."""

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

from tensegrity_envs.simulation.smooth import SmoothDynamics, solve  # noqa: E402

N = 48
FAST, TWO_X, THREE_X, LOADED = (
    f"tensegrity/{name}MuJoCo-v0"
    for name in ("DualTriangleFastReach", "TwoXFastReach", "ThreeXTensionReach", "DualTriangleLoadedReach")
)
FREE = {"joint_friction": 0.0}


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


class Both:
    """The same episodes in an environment and in smooth dynamics."""

    def __init__(self, core: Any, n: int = N, substeps: int | None = None) -> None:
        self.core, self.n = core, n
        self.episodes, self.engine = core.begin(np.full(n, 5), np.arange(n))
        self.episode = kept(core.episodes.rows, self.episodes)
        # In arms at rest the actuators have reached the inputs; the engine's own state is for the engine alone.
        self.state = kept(core.states.rows._replace(physics=core.states.rows.inputs), self.engine)
        self.dynamics = SmoothDynamics(core, substeps)
        self.ended = np.zeros(n, bool)
        leaf = self._is_leaf
        shape = tree_map(lambda _: None, self.state, leaf)
        del shape

        def step(leaves, actions):
            state = self.dynamics.step(self.episode, self._state(leaves), tuple(actions)).state
            return [jnp.broadcast_to(jnp.asarray(one, float), (n,)) for one in tree_leaves(state, self._is_number)]

        self._step = jax.jit(step)
        self.leaves = [jnp.asarray(one, float) for one in tree_leaves(self.state, leaf)]

    @staticmethod
    def _is_leaf(value: object) -> bool:
        return isinstance(value, jax.Array)

    @staticmethod
    def _is_number(value: object) -> bool:
        return isinstance(value, jax.Array | float | int)

    def _state(self, leaves: Any) -> Any:
        given = iter(leaves)
        return tree_map(lambda _: next(given), self.state, self._is_leaf)

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


@pytest.mark.parametrize(("env_id", "largest"), [(TWO_X, 1e-4), (THREE_X, 1e-4)])
def test_loops_are_closed_as_in_the_engine(env_id, largest):
    """There by constraints of some stiffness, here exactly."""
    core = core_of(env_id, dynamics=FREE)
    assert np.median(Both(core).off(drawn_actions(core)), axis=1).max() < largest
