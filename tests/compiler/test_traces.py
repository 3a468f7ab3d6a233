"""Functions that differ in numbers alone are traced once, and memory does not grow with how many there were."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from test_designs import other

import tensegrity_envs
from resident_memory import needs_counters, resident
from tensegrity_envs.compiler import kernel, numbers, traces
from tensegrity_envs.compiler.kernel import Kernel
from tensegrity_envs.compiler.pytree import Schema
from tensegrity_envs.compiler.recent import Recent


@pytest.fixture
def made(monkeypatch):
    """The kernels that are made, each with how many functions were traced for it."""
    monkeypatch.setattr(traces, "_KNOWN", Recent(256))
    monkeypatch.setattr(kernel, "_OF_FUNCTION", Recent(128))
    kernels, count = [], [0]
    init, trace = Kernel.__init__, traces.Traced.__init__

    def noting(self, *given):
        before = count[0]
        init(self, *given)
        kernels.append((self, count[0] - before))

    def counting(self, *given):
        count[0] += 1
        trace(self, *given)

    monkeypatch.setattr(Kernel, "__init__", noting)
    monkeypatch.setattr(traces.Traced, "__init__", counting)
    return kernels


def use(env_id, **options):
    env = gym.make(env_id, disable_env_checker=True, **options)
    observation, info = env.reset(seed=0)
    env.step(np.zeros(env.action_space.shape))
    env.unwrapped.compute_reward(observation["achieved_goal"], observation["desired_goal"], info)
    return env.unwrapped.design


@pytest.mark.parametrize("env_id", [i for i in tensegrity_envs.ENV_IDS if "Posture" not in i])
def test_another_design_is_traced_no_more_and_has_the_data_of_a_new_trace(env_id, made):
    design = use(env_id)
    assert all(count for _, count in made)
    kernel._OF_FUNCTION.clear()
    del made[:]
    step = 2e-3 * (1 + tensegrity_envs.ENV_IDS.index(env_id) / 50)
    weights = {"distance": 0.123} if "Hold" not in env_id else {}
    options = {"design": other(design, step), "tolerance": 0.00456, "reward_weights": weights}
    use(env_id, **options)
    shared = list(made)
    assert len(shared) >= 2
    assert not any(count for _, count in shared)
    traces._KNOWN.clear()
    kernel._OF_FUNCTION.clear()
    del made[:]
    use(env_id, **options)
    assert len(made) == len(shared)
    for (one, _), (anew, count) in zip(shared, made, strict=True):
        assert count == 1
        assert one._run is anew._run
        assert one.constants == anew.constants
        assert one.result.size == anew.result.size


@dataclasses.dataclass
class Spring:
    stiffness: float
    length: float


def made_of(spring):
    def force(x):
        pull = spring.stiffness * (x[0] - spring.length)
        return (pull if spring.length < 1 else pull / spring.length,)

    return Kernel(force, Schema((np.zeros(1),)))


def test_a_function_that_compares_numbers_is_traced_for_either_way(made, monkeypatch):
    monkeypatch.setattr(numbers, "_PACKAGE", "")  # as if these functions were the package's own
    for stiffness, length, count in ((2.0, 0.5, 1), (3.0, 0.7, 0), (3.0, 2.0, 1), (4.0, 3.0, 0), (4.0, 0.4, 0)):
        found = made_of(Spring(stiffness, length))(np.array([[5.0]]))[0, 0]
        assert found == stiffness * (5.0 - length) / (1 if length < 1 else length)
        assert made[-1][1] == count


def test_what_cannot_be_noted_is_traced_anew(made, monkeypatch):
    spring = Spring(2.0, 0.5)
    for stiffness in (2.0, 2.0, 3.0):  # another package's code may read anything
        made_of(Spring(stiffness, 0.5))
        assert made[-1][1] == 1
    monkeypatch.setattr(numbers, "_PACKAGE", "")

    def coarse():
        return Kernel(lambda x: (x[0] * int(spring.stiffness),), Schema((np.zeros(1),)))

    for stiffness, count in ((2.5, 1), (2.5, 0), (3.5, 1)):
        spring.stiffness = stiffness
        assert coarse()(np.array([[2.0]]))[0, 0] == 2 * int(stiffness)
        assert made[-1][1] == count


def test_little_is_kept():
    kept = Recent(3)
    for k in range(5):
        kept.put(k, str(k))
        kept.get(1)
    assert [kept.get(k) for k in range(5)] == [None, "1", None, "3", "4"]


@needs_counters
def test_memory_stays_flat_over_designs():
    design = use("tensegrity/TwoXTensionReach-v0")
    for k in range(200):
        if k == 20:
            before, kept = resident(), (len(traces._KNOWN), len(kernel._LOADED))
        use("tensegrity/TwoXTensionReach-v0", design=other(design, 1e-4 * (1 + k / 1000)))
    assert (len(traces._KNOWN), len(kernel._LOADED)) == kept
    assert resident() - before < 10  # MB
