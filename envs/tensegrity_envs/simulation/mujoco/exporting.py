"""The MJCF file of a model: one that rests when it is loaded, and that other simulators take."""

import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

_BESIDE = 1e-3  # [rad]: an arm that could stay in an unstable equilibrium falls from here


def write_mjcf(model: Any, path: Path, q: ArrayLike | None, inputs: ArrayLike | None) -> Path:
    """See `MujocoModel.to_mjcf`."""
    spec = model.spec
    # What diverges begins anew, as usual; mujoco-warp knows no files in which it does not.
    spec.option.disableflags = int(spec.option.disableflags) & ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    if model.is_ramped:
        _write_ramped(model, spec, q, inputs)
    else:
        _place(spec, model, _resting(model))
        if q is not None:
            ctrl = model.input_bounds[0] if inputs is None else model._check_inputs(inputs)
            state = model.state(np.asarray(q, float).reshape(-1), None, ctrl)
            spec.add_key(name="start", qpos=model.joint_angles(state), ctrl=ctrl, act=ctrl if model.model.na else [])
    spec.compile()
    path.write_text(spec.to_xml())
    return path


def _resting(model: Any) -> np.ndarray:
    """Joint angles under the lowest inputs: straight, unless it falls from there."""
    straight = np.zeros(model.linkage.size)
    beside = np.full(model.linkage.size, _BESIDE) * np.where(np.arange(model.linkage.size) % 2, -0.7, 1.0)
    found = model.relax(model.input_bounds[0], beside)
    if found.reason != "at rest" or abs(found.configuration).max() < 2 * _BESIDE:
        return np.asarray(model.linkage.joint_angles(straight))
    return np.asarray(model.linkage.joint_angles(found.configuration))


def _write_ramped(model: Any, spec: mujoco.MjSpec, q: ArrayLike | None, inputs: ArrayLike | None) -> None:
    """Lengths count from those of the pose: without a key frame, MuJoCo begins with activations of zero."""
    if q is None:
        q, lengths = model.floating_model.at_rest()
    else:
        lengths = inputs
    q = np.asarray(q, float).reshape(-1)
    state = model.state(q)
    if lengths is None:
        data = model._scratch
        model._load(data, state)
        mujoco.mj_fwdPosition(model.model, data)
        lengths = data.ten_length[model.model.actuator_trnid[:, 0]].copy()
    lengths = model._check_inputs(np.asarray(lengths, float))
    for actuator, length in zip(spec.actuators, lengths, strict=True):
        bias = actuator.biasprm
        bias[0] = -bias[1] * length
        actuator.biasprm = bias
        actuator.actrange = np.asarray(actuator.actrange) - length
    angles = model.joint_angles(state)
    _place(spec, model, angles)
    qpos = angles.copy()
    if model.linkage.space == 3:
        qpos[3:] = 1.0, 0.0, 0.0, 0.0  # a ball joint counts from the pose
    zero = np.zeros(model.input_size)
    spec.add_key(name="start", qpos=qpos, ctrl=zero, act=zero)


def _place(spec: mujoco.MjSpec, model: Any, angles: np.ndarray) -> None:
    """Let the file begin with these joint angles."""
    if not abs(angles).max() > 0:
        return
    if model.linkage.space == 3:
        body = spec.body("platform")
        body.pos, body.quat = angles[:3], angles[3:]
        for joint, place in zip(body.joints, angles[:3], strict=False):
            joint.ref = place
        return
    for name, angle in zip(model.linkage.joints, angles.tolist(), strict=True):
        joint = spec.joint(name)
        joint.ref = math.degrees(angle)
        joint.parent.quat = [math.cos(angle / 2), 0.0, -math.sin(angle / 2), 0.0]  # about -y
