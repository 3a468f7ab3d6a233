"""What of a MuJoCo model in space differs from one in a plane: the body of a free platform, ground, light, camera."""

import math
from typing import Any

import mujoco
import numpy as np

from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.simulation.mujoco.platform import Platform

_AZIMUTH, _ELEVATION = math.radians(-62.0), math.radians(24.0)  # from where one looks, as in `rendering_spatial`


def add_picture(body: Any, shape: Any, material: str, zaxis: list[float] | None = None, **fields: Any) -> None:
    """A geometry without mass that touches nothing."""
    geom = body.add_geom(type=shape, material=material, contype=0, conaffinity=0, mass=0.0, **fields)
    if zaxis is not None:
        geom.alt.type = mujoco.mjtOrientation.mjORIENTATION_ZAXIS
        geom.alt.zaxis = zaxis


def add_platform(spec: mujoco.MjSpec, platform: Platform, dynamics: Dynamics, radius: float) -> list[Any]:
    """Ground and platform.

    The platform is a uniform triangle of circumradius d: inertia m d^2 / 8 about its edges' directions, m d^2 / 4 about
    its normal. Three slides and a ball move it; only the ball is damped.
    """
    world = spec.worldbody
    for node in platform.base:
        place = platform.reference[node].tolist()
        add_picture(world, mujoco.mjtGeom.mjGEOM_SPHERE, "base", pos=place, size=[2.5 * radius, 0.0, 0.0])
    body = world.add_body(name="platform")
    mass = dynamics.platform_mass
    square = float(np.square(platform.reference[platform.corners[0]]).sum())
    body.explicitinertial = True
    body.mass, body.ipos = mass, [0.0, 0.0, 0.0]
    body.inertia = [mass * square / 8, mass * square / 8, mass * square / 4]
    body.gravcomp = 1.0
    for name, axis in zip(platform.joints, np.eye(3).tolist(), strict=False):
        body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    ball = body.add_joint(
        name=platform.joints[-1], type=mujoco.mjtJoint.mjJNT_BALL, frictionloss=dynamics.joint_friction
    )
    ball.damping = [dynamics.joint_damping, 0.0, 0.0]
    corners = [platform.reference[node] for node in platform.corners]
    for i, place in enumerate(corners):
        ends = [*place.tolist(), *corners[i - 1].tolist()]
        add_picture(body, mujoco.mjtGeom.mjGEOM_CAPSULE, "truss", fromto=ends, size=[0.8 * radius, 0.0, 0.0])
        add_picture(body, mujoco.mjtGeom.mjGEOM_SPHERE, "bar", pos=place.tolist(), size=[1.6 * radius, 0.0, 0.0])
    thick = [0.2 * radius * np.array([0.0, 0.0, side]) for side in (-1, 1)]
    spec.add_mesh(name="triangle", uservert=np.array([p + t for t in thick for p in corners]).ravel())
    add_picture(body, mujoco.mjtGeom.mjGEOM_MESH, "platform", meshname="triangle")
    return [world, body]


def add_view(spec: mujoco.MjSpec, length: float, textures: bool) -> None:
    """Ground, sky, light, and a camera that looks down at an angle."""
    world = spec.worldbody
    if textures:
        spec.add_texture(
            name="sky",
            type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
            rgb1=[0.80, 0.84, 0.89],
            rgb2=[0.80, 0.84, 0.89],
            width=64,
            height=64,
        )
    add_picture(
        world, mujoco.mjtGeom.mjGEOM_PLANE, "wall", pos=[0.0, 0.0, -0.03 * length], size=[8 * length, 8 * length, 0.1]
    )
    world.add_light(
        pos=[0.5 * length, -length, 3.0 * length],
        dir=[-0.25, 0.4, -1.0],
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        castshadow=True,
        diffuse=[0.45, 0.45, 0.45],
        specular=[0.3, 0.3, 0.3],
    )
    c, s, flat, up = math.cos(_AZIMUTH), math.sin(_AZIMUTH), math.cos(_ELEVATION), math.sin(_ELEVATION)
    away = np.array([flat * c, flat * s, up])
    camera = world.add_camera(
        name="front", pos=(np.array([0.0, 0.0, 0.5 * length]) + 2.5 * length * away).tolist(), fovy=45.0
    )
    camera.alt.type = mujoco.mjtOrientation.mjORIENTATION_XYAXES
    camera.alt.xyaxes = [-s, c, 0.0, -up * c, -up * s, flat]
