"""Steps at rest that can be differentiated: against the environment's continuation, and against differences."""

import numpy as np
import pytest
import torch

pytest.importorskip("jax")

import gymnasium as gym

from tensegrity_agents.sb3.smooth_episodes import SmoothEpisodes
from tensegrity_envs.env import unwrapped
from tensegrity_envs.mechanics.eigenvalues import smallest_eigenvalue

N, STEPS = 16, 5
IDS = ("DualTriangleLoadedReach-v0", "TwoXTensionReach-v0")


@pytest.mark.parametrize("env_id", IDS)
def test_steps_are_those_of_the_environment_and_have_its_derivatives(env_id):
    """In float32, hence the tolerances; episodes that fail in either are left out."""
    core = unwrapped(gym.make(f"tensegrity/{env_id}")).core
    smooth = SmoothEpisodes(core, N, 1)
    episodes, states, _ = smooth.begin(3, np.arange(N))
    told = smooth.go_on(episodes)
    _, outcomes = core.begin(np.full(N, 3), np.arange(N))
    rng = np.random.default_rng(0)
    alive = np.ones(N, bool)
    for step in range(1, STEPS + 1):
        action = rng.uniform(-0.3, 0.3, (N, core.simulation.action_size))
        before = states
        states, _, achieved, _, _, failed = smooth.step(told, states, torch.tensor(action, dtype=torch.float32), step)
        outcomes = core.step(episodes, outcomes, np.ascontiguousarray(action.T))
        rows = core.outcomes.rows
        alive &= (failed.numpy() == 0) & (outcomes[rows.state.failure] == 0)
        tip = outcomes[list(rows.achieved)].T
        assert np.abs(achieved.numpy() - tip)[alive].max() < 2e-5
    assert alive.sum() > N // 2
    given = torch.tensor(action, dtype=torch.float32, requires_grad=True)
    smooth.step(told, before, given, STEPS)[2].sum().backward()
    h, k = 0.05, 0
    ends = []
    for share in (1.0, 0.0, -1.0):
        moved = torch.tensor(action, dtype=torch.float32)
        moved[:, k] += share * h
        ends.append(smooth.step(told, before, moved, STEPS)[2].sum(dim=1).numpy())
    ahead, back = (ends[0] - ends[1]) / h, (ends[1] - ends[2]) / h
    even = alive & (np.abs(ahead - back) < 0.1 * np.abs(ahead) + 1e-4)  # an input at its bound has a kink there
    assert even.sum() > N // 2
    assert given.grad[even, k].numpy() == pytest.approx((ahead + back)[even] / 2, rel=0.05, abs=2e-4)


def test_the_smallest_eigenvalue_of_many_joints_is_that_of_numpy():
    """Where no closed form is, in traced functions of JAX, too."""
    import jax

    draw = np.random.default_rng(0).normal(size=(5, 5, 7))
    matrix = draw + draw.transpose(1, 0, 2)

    def smallest(entries):
        return smallest_eigenvalue(tuple(tuple(entries[i, j] for j in range(5)) for i in range(5)))

    wanted = np.linalg.eigvalsh(matrix.transpose(2, 0, 1))[:, 0]
    np.testing.assert_allclose(smallest(matrix), wanted, rtol=1e-12)
    np.testing.assert_allclose(jax.jit(smallest)(matrix), wanted, rtol=1e-5)
    np.testing.assert_allclose(smallest(torch.as_tensor(matrix)), wanted, rtol=1e-12)
