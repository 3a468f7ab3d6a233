"""MuJoCo's model of a mechanism with other parameters, without compiling it anew."""

from collections.abc import Sequence
from copy import copy
from typing import Any

import mujoco
import numpy as np

from tensegrity_envs.mechanics.design import Member
from tensegrity_envs.simulation.floating_lengths import floating_length_model
from tensegrity_envs.simulation.mujoco.building import input_members
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.simulation.mujoco.simulator import Simulator


def variant_of(simulator: Simulator, mechanism: Any, dynamics: Dynamics) -> mujoco.MjModel:
    """See `MujocoModel.variant`."""
    own = simulator.dynamics
    for field in ("timestep", "frame_skip", "integrator"):
        if getattr(dynamics, field) != getattr(own, field):
            raise ValueError(f"Dynamics.{field} differs from that of the model: build another MujocoModel")
    if (dynamics.time_constant > 0) != (own.time_constant > 0):
        raise ValueError("only one of Dynamics.actuator_bandwidth and that of the model is 0: build another")
    floating_model = floating_length_model(mechanism)
    if not simulator.linkage.fits(floating_model):
        raise ValueError("the bar lengths differ from those of the model: build another MujocoModel")
    members = floating_model.members
    model = copy(simulator.model)
    for member in members:
        if member.kind == "spring" and not member.is_input:
            tendon = model.tendon(member.name).id
            model.tendon_stiffness[tendon] = member.stiffness
            model.tendon_lengthspring[tendon] = 0.0 if member.goes_slack else member.free_length, member.free_length
    for i, member in enumerate(input_members(members)):
        if member.kind == "cable":
            model.actuator_ctrlrange[i] = mechanism.design.min_tension, mechanism.design.max_tension
        elif member.kind == "actuator":
            stiffness = dynamics.servo_stiffness
            model.actuator_gainprm[i, 0] = stiffness
            model.actuator_biasprm[i, 1:3] = -stiffness, -stiffness * dynamics.servo_time
        else:
            model.actuator_gainprm[i, 0], model.actuator_biasprm[i, 1] = member.stiffness, -member.stiffness
            model.actuator_forcerange[i, 0] *= member.stiffness / simulator._inputs[i].stiffness
        if dynamics.time_constant:
            model.actuator_dynprm[i, 0] = dynamics.time_constant
    _scale_masses(simulator, model, members, dynamics)
    payload = getattr(mechanism.design, "payload", None)
    model.body_mass[simulator._tip] = dynamics.tip_mass if payload is None else payload
    model.opt.gravity[2] = -getattr(mechanism.design, "gravity", 0.0)
    # MuJoCo's damping may have coefficients of higher order behind the linear one
    turning = model.jnt_type[model.dof_jntid] != int(mujoco.mjtJoint.mjJNT_SLIDE)
    model.dof_damping.reshape(model.nv, -1)[:, 0] = np.where(turning, dynamics.joint_damping, 0.0)
    model.dof_frictionloss[:] = np.where(turning, dynamics.joint_friction, 0.0)
    mujoco.mj_setConst(model, simulator._scratch)
    return model


def _scale_masses(simulator: Simulator, model: mujoco.MjModel, members: Sequence[Member], dynamics: Dynamics) -> None:
    own = [bar.mass for bar in simulator.mechanism.members if bar.is_rigid]
    new = [bar.mass for bar in members if bar.is_rigid]
    if not own:  # a platform
        factor = dynamics.platform_mass / simulator.dynamics.platform_mass
        model.body_mass[:] *= factor
        model.body_inertia[:] *= factor
        return
    factor = max(new) / max(own) if max(own) else dynamics.bar_line_density / simulator.dynamics.bar_line_density
    if not factor or max(abs(b - factor * a) for a, b in zip(own, new, strict=True)) > 1e-12 * max(own):
        raise ValueError("the bar masses do not all change by one factor: build another MujocoModel")
    if max(own) and dynamics.bar_line_density != simulator.dynamics.bar_line_density and min(own) == 0:
        raise ValueError("some bars have a mass of their own, others have not: build another MujocoModel")
    model.body_mass[:] *= factor
    model.body_inertia[:] *= factor
