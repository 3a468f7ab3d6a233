"""Exported MJCF files, loaded plainly, without a key frame: in MuJoCo, and in MJX and mujoco-warp where installed."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from tensegrity_envs.mechanics import (
    JAHROMY,
    JI2014,
    MURALIDHARAN2022,
    ZHAO2021_CAPTION,
    ZHAO2021_TEXT,
    DualTriangle,
    PlanarFourBar,
    SpatialPrism,
    TwoX,
)
from tensegrity_envs.simulation.mujoco import Dynamics, MujocoModel

MODELS = {
    "2-X": (TwoX(replace(MURALIDHARAN2022, joint_limit=2.6)), {}),
    "2-X with payload": (TwoX(replace(MURALIDHARAN2022, joint_limit=2.6, payload=0.3)), {}),
    "dual-triangle": (DualTriangle(ZHAO2021_CAPTION), {}),
    "dual-triangle, cables": (DualTriangle(replace(ZHAO2021_TEXT, springs="cable")), {}),
    "planar 4-bar": (PlanarFourBar(JI2014), {"joint_damping": 20.0}),
    "planar 4-bar of 0.3 m": (PlanarFourBar(replace(JI2014, length=0.3)), {}),
    "spatial prism": (SpatialPrism(JAHROMY), {}),
}
every_model = pytest.mark.parametrize("name", MODELS)
STEPS = 100


def exported(name, tmp_path):
    mechanism, fields = MODELS[name]
    path = MujocoModel(mechanism, Dynamics(**fields)).to_mjcf(tmp_path / "model.xml")
    assert "autoreset" not in path.read_text()  # mujoco-warp refuses it
    return mujoco.MjModel.from_xml_path(str(path))


@every_model
def test_a_plain_load_holds_still(name, tmp_path):
    model = exported(name, tmp_path)
    data = mujoco.MjData(model)
    for _ in range(1000):
        mujoco.mj_step(model, data)
        assert abs(data.qpos - model.qpos0).max() < 1e-3  # rad and m; six digits are in the file
    assert not any(warning.number for warning in data.warning)
    assert data.time == pytest.approx(1000 * model.opt.timestep)  # it did not begin anew


@pytest.mark.parametrize("name", ["planar 4-bar", "planar 4-bar of 0.3 m", "spatial prism"])
def test_sliders_of_prismatic_actuators_are_their_speeds(name, tmp_path):
    model = exported(name, tmp_path)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    before = data.ten_length[model.actuator_trnid[:, 0]].copy()
    speed = 0.05 * before.mean()
    data.ctrl[:] = speed
    mujoco.mj_step(model, data, nstep=1000)
    seconds = 1000 * model.opt.timestep
    np.testing.assert_allclose(data.ten_length[model.actuator_trnid[:, 0]] - before, speed * seconds, rtol=5e-3)


@pytest.mark.parametrize("name", ["2-X", "dual-triangle", "planar 4-bar", "spatial prism"])
def test_mjx_holds_it_still(name, tmp_path):
    jax = pytest.importorskip("jax", reason="JAX is not installed")
    mjx = pytest.importorskip("mujoco.mjx", reason="mujoco-mjx is not installed")
    jax.config.update("jax_enable_x64", True)
    model = exported(name, tmp_path)
    compiled, data, step = mjx.put_model(model), mjx.make_data(model), jax.jit(mjx.step)
    for _ in range(STEPS):
        data = step(compiled, data)
    assert abs(np.asarray(data.qpos) - model.qpos0).max() < 1e-3


@pytest.mark.parametrize("name", ["2-X", "dual-triangle", "planar 4-bar", "spatial prism"])
def test_mujoco_warp_holds_it_still(name, tmp_path):
    warp = pytest.importorskip("mujoco_warp", reason="mujoco-warp is not installed")
    model = exported(name, tmp_path)
    compiled, data = warp.put_model(model), warp.make_data(model)
    for _ in range(STEPS):
        warp.step(compiled, data)
    assert abs(data.qpos.numpy()[0] - model.qpos0).max() < 1e-3
