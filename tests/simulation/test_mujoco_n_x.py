"""The MuJoCo model of the n-X: energies and settled equilibria, of every routing."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco", reason='MuJoCo is not installed: pip install "tensegrity-envs[mujoco]"')

from tensegrity_envs.mechanics import MURALIDHARAN2022, NX, NXDesign
from tensegrity_envs.simulation.mujoco import MujocoModel

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
        found = model.settle(tensions, np.array(rest.configuration) + rng.uniform(-0.1, 0.1, 3), load)
        assert found.reason == "at rest"
        assert found.configuration == pytest.approx(rest.configuration, abs=1e-4)
        settled += 1
