"""Laws of observations: what is encoded comes back, and everything that is handed out is documented."""

import gymnasium as gym
import numpy as np
import pytest

import tensegrity_envs
from tensegrity_envs.observation import (
    Between,
    Divided,
    Field,
    ObservationSchema,
    SineAndCosine,
    Softsign,
    SoftsignRate,
)

COUNT = 16
every_id = pytest.mark.parametrize("env_id", tensegrity_envs.ENV_IDS)
OBSERVED = [
    (env_id, {"observe": observe, "observe_velocities": velocities})
    for env_id in (
        "tensegrity/TwoXTensionReach-v0",
        "tensegrity/PlanarFourBarReach-v0",
        "tensegrity/SpatialPrismTrack-v0",
    )
    for observe in ("full", "tip_and_inputs")
    for velocities in (False, True)
]


def run(env_id, steps=5, **options):
    """The shell, and the observation and info of a batch after some steps."""
    if "MuJoCo" in env_id:
        pytest.importorskip("mujoco")
    envs = gym.make_vec(env_id, COUNT, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **options)
    observation, info = envs.reset(seed=4)
    rng = np.random.default_rng(4)
    for _ in range(steps):
        observation, *_, info = envs.step(rng.uniform(-1, 1, envs.action_space.shape))
    return envs.unwrapped, observation, info


def states(shell):
    """States and episodes of the batch, as components of shape (n,)."""
    state = shell.core.outcomes.unpack(shell._outcomes).state
    return shell.core.measured(state), shell.episode  # as the sensors see it


def encoded(schema, state, episode):
    """The observations of states, not rounded to single precision."""
    goal = np.stack(episode.goal_at(state.time), axis=1)
    numbers = [np.broadcast_to(number, COUNT) for number in schema.encode(state, episode)]
    return {"observation": np.stack(numbers, axis=1), "achieved_goal": goal, "desired_goal": goal}


@pytest.mark.parametrize(
    ("env_id", "options"), [(env_id, {}) for env_id in tensegrity_envs.ENV_IDS] + OBSERVED, ids=str
)
def test_decoding_undoes_encoding(env_id, options):
    shell, observation, _ = run(env_id, **options)
    schema, (state, episode) = shell.core.schema, states(shell)
    assert schema.size == observation["observation"].shape[1] == sum(field.width for field in schema.fields.values())
    numbers = encoded(schema, state, episode)["observation"]
    np.testing.assert_allclose(numbers, observation["observation"], atol=1e-7)  # what the compiled step says
    for name, field in schema.fields.items():
        wanted = np.stack([np.broadcast_to(v, COUNT) for v in field.values(state, episode)], axis=1)
        found = field.decode(numbers[:, schema.places[name]]).reshape(COUNT, -1)
        assert found.shape == (COUNT, field.size or 1)
        if isinstance(field.scaling, SineAndCosine):
            wanted = np.angle(np.exp(1j * wanted))
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9, err_msg=name)


@every_id
def test_a_decoded_observation_agrees_with_info(env_id):
    shell, observation, info = run(env_id)
    observed = shell.core.schema.decode(observation)
    assert len(observed) == COUNT
    np.testing.assert_array_equal(observed.target, observation["desired_goal"])
    np.testing.assert_array_equal(getattr(observed, shell.core.goal_name), observation["achieved_goal"])
    for name in ("stability_margin", "wrench_margin", shell.core.input_name):
        if name in observed:
            scale = 1 + np.abs(info[name])
            np.testing.assert_allclose(getattr(observed, name) / scale, info[name] / scale, atol=1e-5)
    if shell.core.input_name:
        np.testing.assert_array_equal(observed.inputs, getattr(observed, shell.core.input_name))
    with pytest.raises(AttributeError, match="'colour' is not observed; there are"):
        _ = observed.colour


def test_other_values_take_the_place_of_a_field_and_of_nothing_else():
    shell, observation, _ = run("tensegrity/TwoXTensionReach-v0")
    schema = shell.core.schema
    tensions = np.full((COUNT, 4), 70.0)
    changed = schema.decode(schema.with_values(observation, "inputs", tensions))
    np.testing.assert_allclose(changed.tensions, tensions)
    np.testing.assert_array_equal(changed.joint_angles, schema.decode(observation).joint_angles)
    with pytest.raises(ValueError, match=r"must be a batch of shape \(n, 12\)"):
        schema.decode({**observation, "observation": observation["observation"][:, :5]})
    with pytest.raises(ValueError, match=r"observation: ndarray, must be the environment's dict"):
        schema.decode(observation["observation"])
    with pytest.raises(ValueError, match=r"one alone; .* \{name: value\[None\]"):
        schema.decode({name: value[0] for name, value in observation.items()})
    for name in ("achieved_goal", "desired_goal"):
        with pytest.raises(ValueError, match=rf"{name} of shape .*: must be a batch of shape \({COUNT}, goal size\)"):
            schema.decode({**observation, name: observation[name][0]})


def test_two_fields_of_one_name_are_refused():
    field = Field("x", lambda state, _: state.tip, 2, Divided(1.0), "m", "twice")
    with pytest.raises(ValueError, match="twice"):
        ObservationSchema([field, field])


@pytest.mark.parametrize(
    "scaling",
    [Divided(3.0), Between(-2.0, 5.0), SineAndCosine(), Softsign(), Softsign(0.3), SoftsignRate(), SoftsignRate(2.0)],
)
def test_scalings_are_within_bounds_and_have_an_inverse(scaling):
    values = np.linspace(-2.0, 3.0, 51)
    numbers = np.stack(scaling.encode(values), axis=1)
    assert numbers.shape == (51, scaling.width)
    assert (np.abs(numbers) <= 1).all()
    np.testing.assert_allclose(scaling.decode(numbers)[:, 0], values, atol=1e-12)
    assert "x" in str(scaling) or "-1" in str(scaling)
