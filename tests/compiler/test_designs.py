"""Numbers are data: another design, other weights or tolerances compile nothing."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest

import tensegrity_envs
from tensegrity_envs.compiler import store
from tensegrity_envs.compiler.kernel import Kernel, evaluate
from tensegrity_envs.compiler.numbers import Lifting, Number
from tensegrity_envs.compiler.pytree import Schema


@pytest.fixture
def asked_for(monkeypatch):
    """The keys of the code that is asked for, as in a process that has loaded none; a key is compiled once at most."""
    from tensegrity_envs.compiler import kernel

    monkeypatch.setattr(kernel, "_LOADED", {})
    keys, fetch = [], store.fetch

    def noting(key, *rest):
        keys.append(key)
        return fetch(key, *rest)

    monkeypatch.setattr(store, "fetch", noting)
    return keys


def other(design, step):
    """A design all of whose numbers differ, also where they were equal.

    But the two triangles of a segment stay alike: where their diagonals differ, a spring's length needs a root, which
    is other code.
    """
    changed = {}
    for k, field in enumerate(dataclasses.fields(design), 1):
        if field.name in ("a2", "b2") and hasattr(design, "a1"):
            changed[field.name] = changed[field.name[0] + "1"]
            continue
        value = getattr(design, field.name)
        if isinstance(value, float) and np.isfinite(value):
            changed[field.name] = value * (1 + step * k)
    return dataclasses.replace(design, **changed)


@pytest.mark.parametrize("env_id", [i for i in tensegrity_envs.ENV_IDS if "Posture" not in i])
def test_a_second_design_compiles_nothing(env_id, asked_for):
    def use(**options):
        env = gym.make(env_id, disable_env_checker=True, **options)
        observation, info = env.reset(seed=0)
        # The same actions for both: code that only some motions need (a failure's, a slack cable's) is no design's.
        env.action_space.seed(0)
        for _ in range(8):
            if any(env.step(env.action_space.sample())[2:4]):
                env.reset()
        env.unwrapped.compute_reward(observation["achieved_goal"], observation["desired_goal"], info)
        return env.unwrapped

    # Neither design is one that another test of this process has used: what is kept per design asks for no code.
    design = gym.make(env_id, disable_env_checker=True).unwrapped.design
    step = 1e-3 * (1 + tensegrity_envs.ENV_IDS.index(env_id) / 50)
    use(design=other(design, step))
    assert asked_for
    del asked_for[:]
    weights = {"distance": 0.123} if "Hold" not in env_id else {}
    use(design=other(design, 1.005 * step), tolerance=0.00456, reward_weights=weights)
    assert not asked_for


@dataclasses.dataclass
class Pair:
    a: float
    b: float


def scaled(pair, x):
    return pair.a * x + pair.b * x * 3.0 - (pair.a / pair.b) ** 2


def test_equal_numbers_and_other_numbers_share_their_code(asked_for):
    for pair in (Pair(2.0, 2.0), Pair(2.0, 3.0), Pair(3.0, 3.0), Pair(0.5, -0.0 + 1e300)):
        assert evaluate(scaled, pair, 0.7) == pytest.approx(scaled(pair, 0.7), rel=1e-15)
    assert len(asked_for) == 1


def test_numbers_know_where_they_come_from():
    lifting = Lifting()
    pair = lifting.lift(Pair(2.0, 3.0), "pair")
    product = -abs(pair.a) * pair.b + 1
    assert product == -5.0
    assert isinstance(product, Number)
    assert pair.a.source == "Pair.a"
    again = lifting.lift(Pair(2.0, 4.0), "another")
    assert again.a.source == "Pair.a"
    assert again.b.source != pair.b.source


def test_matrices_that_compiled_code_cannot_read_are_copied_or_refused():
    kernel = Kernel(lambda v: (v[0] + 2 * v[1], v[1]), Schema((np.zeros(1), np.zeros(1))))
    matrix = np.arange(12.0).reshape(2, 6)
    expected = kernel(matrix)
    for odd in (np.asfortranarray(matrix), matrix[:, ::-1][:, ::-1], matrix.astype(int), matrix.astype(np.float32)):
        np.testing.assert_array_equal(kernel(odd), expected)
    np.testing.assert_array_equal(kernel(matrix[:, ::2]), expected[:, ::2])
    matrix.flags.writeable = False
    np.testing.assert_array_equal(kernel(matrix), expected)
    assert kernel(np.zeros((2, 0))).shape == (2, 0)
    for wrong in (np.zeros((1, 3)), np.zeros((2, 2, 2))):
        with pytest.raises(ValueError, match="shape"):
            kernel(wrong)
