"""The MuJoCo model of the n-X: energies and settled equilibria, of every routing."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco", reason='MuJoCo is not installed: pip install "tensegrity-envs[mujoco]"')

from tensegrity_envs.mechanics import MURALIDHARAN2022, NX, NXDesign
from tensegrity_envs.simulation.mujoco import MujocoModel
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics

EQUAL = NXDesign.from_two_x(replace(MURALIDHARAN2022, joint_limit=2.6), 3)
UNEQUAL = replace(
    EQUAL,
    b=(0.06, 0.05, 0.04),
    l=(0.11, 0.1, 0.09),
    k_left=(600.0, 400.0, 200.0),
    k_right=(500.0, 400.0, 250.0),
    payload=0.1,
)
MATRIX = ((-1, -1, 0), (1, 1, 0), (0, -1, -1), (0, 1, 1), (-1, 0, 1), (1, 0, -1))
DESIGNS = {
    "equal": EQUAL,
    "unequal": UNEQUAL,
    "from the base": replace(UNEQUAL, routing="from_base"),
    "matrix": replace(UNEQUAL, routing=MATRIX),
}


def chain(joints, routing):
    """Unequal joints with the bars of the published 2-X, stiffer towards the base."""
    share = np.linspace(1.1, 0.9, joints)
    fields = {name: tuple((getattr(MURALIDHARAN2022, name) * share).tolist()) for name in ("b", "l", "a")}
    stiff = tuple((300.0 * np.arange(joints, 0, -1)).tolist())
    first = NXDesign.from_two_x(replace(MURALIDHARAN2022, joint_limit=2.6), joints)
    return replace(first, **fields, k_left=stiff, payload=0.05, max_tension=60.0 * (joints + 1), routing=routing)


@pytest.mark.parametrize("name", DESIGNS)
def test_energies_and_settled_equilibria(name):
    arm = NX(DESIGNS[name])
    model = MujocoModel(arm)
    rng = np.random.default_rng(0)
    settled = 0
    while settled < 3:
        tensions, load = tuple(rng.uniform(30, 155, 6).tolist()), tuple(rng.normal(0, 0.5, 2).tolist())
        q = tuple(rng.uniform(-1, 1, 3).tolist())
        assert model.potential_energy(q, tensions, load) == pytest.approx(arm.potential_energy(q, tensions, load))
        gradient = arm.energy_gradient(q, tensions, load)
        assert model.energy_gradient(q, tensions, load) == pytest.approx(gradient, abs=1e-11)
        rest = arm.equilibrium(tensions, (0.0,) * 3, load)
        inside = max(map(abs, rest.configuration)) < 2.45
        if not (rest.is_stable and inside and arm.stability_margin(rest.configuration, tensions, load) > 0.02):
            continue
        found = model.relax(tensions, np.array(rest.configuration) + rng.uniform(-0.1, 0.1, 3), load)
        assert found.reason == "at rest"
        assert found.configuration == pytest.approx(rest.configuration, abs=1e-4)
        settled += 1


@pytest.mark.full
@pytest.mark.parametrize("routing", ["per_joint", "from_base"])
@pytest.mark.parametrize("joints", range(1, 7))
def test_arms_of_any_number_of_joints_settle_where_they_should(joints, routing):
    """Ten stable postures under their stiffest tensions, released from beside them.

    MuJoCo's loops give way by 3e-6 m at its usual time step, a sixteenth of that at a quarter of it; soft postures of
    long arms, where that is more than 1e-4 rad, are looked at with the latter.
    """
    arm, rng = NX(chain(joints, routing)), np.random.default_rng(joints)
    step = 1e-3 if joints < 5 else 2.5e-4
    model, settled, largest = MujocoModel(arm, Dynamics(timestep=step)), 0, 0.0
    for _ in range(2000):
        q = tuple(rng.uniform(-0.8, 0.8, joints).tolist())
        tensions, stability, wrench = arm.posture(q)
        if wrench < 0.01 or stability < 0.02:
            continue
        found = model.relax(tensions, np.array(q) + rng.uniform(-0.02, 0.02, joints), (0.0, 0.0), max_steps=200_000)
        assert found.reason == "at rest"
        largest = max(largest, np.abs(np.subtract(found.configuration, q)).max())
        settled += 1
        if settled == 10:
            break
    print(f"{joints} joints, {routing}: {settled} postures, largest distance {largest:.2g} rad")
    assert settled == 10
    assert largest < 1e-4
