"""The MuJoCo model (MjSpec) of a mechanism, from its linkage, its members and the parameters of its dynamics.

Mechanisms in space have MuJoCo's axes. Planar mechanisms lie in the plane x-z, their y [m] is MuJoCo's z. Hinges turn
about -y, so that positive angles are counter-clockwise as seen by the camera.
"""

from typing import Any

import mujoco
import numpy as np

from tensegrity_envs.mechanics.design import Member
from tensegrity_envs.simulation.mujoco.building_space import add_picture, add_platform, add_view
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.simulation.mujoco.linkage import Linkage, Loop, usual_radius
from tensegrity_envs.simulation.mujoco.platform import Platform

TIP_BODY = "tip"
_AXIS = (0.0, -1.0, 0.0)
_CLOSED = (0.9999, 0.9999, 1e-4, 0.5, 2.0)  # solimp with which loops and joint limits are as good as rigid
_COLOURS = {
    "bar": (0.20, 0.26, 0.36, 1.0),
    "truss": (0.52, 0.57, 0.66, 1.0),
    "base": (0.22, 0.25, 0.30, 1.0),
    "joint": (0.88, 0.90, 0.93, 1.0),
    "spring": (0.07, 0.54, 0.52, 1.0),
    "cable": (0.93, 0.47, 0.20, 1.0),
    "actuator": (0.55, 0.24, 0.60, 1.0),
    "platform": (0.47, 0.63, 0.80, 0.5),
    "tip": (0.10, 0.44, 0.76, 1.0),
}


def _point(z: complex | np.ndarray, depth: float = 0.0) -> list[float]:
    """MuJoCo's position of a point in the plane (a complex number), moved behind it, or of one in space."""
    return [z.real, depth, z.imag] if isinstance(z, complex) else [float(component) for component in z]


def input_members(members: tuple[Member, ...]) -> list[Member]:
    """Cables, springs and actuators whose tensions, free lengths and lengths are the inputs, in their order."""
    return [member for member in members if member.takes_input]


def build(mechanism: Any, linkage: Linkage | Platform, dynamics: Dynamics, textures: bool = True) -> mujoco.MjSpec:
    """The specification of the model: bodies, hinges, loops, tendons, actuators, and what makes a good picture.

    Args:
        mechanism: of one design, or its model with floating lengths.
        linkage: of it.
        dynamics: what it does not tell.
        textures: of wall and sky, 0.8 MB in each model; what is only simulated needs none.

    Raises:
        ValueError: there is a torsional spring, or prismatic actuators are to lag, or are too fast for the time step.
    """
    design = mechanism.design
    members = mechanism.members
    for member in members:
        if member.kind == "torsional spring":
            raise ValueError(
                f"{member.name}: MuJoCo models are built of bars, struts, springs, cables and prismatic actuators; "
                "a torsional spring is not among them"
            )
    spec = mujoco.MjSpec()
    spec.modelname = type(mechanism).__name__
    payload = getattr(design, "payload", None)
    _set_options(spec, dynamics, getattr(design, "gravity", 0.0))
    radius = usual_radius(members, linkage.extent)
    _add_looks(spec, linkage.extent, textures)
    if isinstance(linkage, Platform):
        add_view(spec, linkage.extent, textures)
        bodies = add_platform(spec, linkage, dynamics, radius)
    else:
        _add_surroundings(spec, linkage.extent, textures)
        bodies = _add_bodies(spec, linkage, dynamics, radius)
    tip = bodies[linkage.owner("P")].add_body(name=TIP_BODY, pos=_point(linkage.local("P", linkage.owner("P"))))
    # A weld, so that forces applied to it act at P and a point mass has its weight there.
    tip.explicitinertial = True
    tip.mass = float(payload) if payload is not None else dynamics.tip_mass
    tip.ipos, tip.inertia = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    tip.gravcomp = float(payload is None)
    tip.add_site(name=TIP_BODY, size=[1.5 * radius] * 3, material="tip")
    for loop in linkage.loops:
        assert isinstance(linkage, Linkage)
        _add_loop(spec, linkage, bodies, loop, dynamics.timestep)
    for member in members:
        if not member.is_rigid:
            _add_tendon(spec, linkage, bodies, member, radius)
    for member in input_members(members):
        _add_actuator(spec, mechanism, member, linkage.length, dynamics)
    return spec


def _set_options(spec: mujoco.MjSpec, dynamics: Dynamics, gravity: float) -> None:
    option = spec.option
    option.timestep = dynamics.timestep
    option.gravity = [0.0, 0.0, -float(gravity)]
    option.integrator = {
        "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
        "RK4": mujoco.mjtIntegrator.mjINT_RK4,
        "discrete": mujoco.mjtIntegrator.mjINT_DISCRETE,
    }[dynamics.integrator]
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE  # 4.0.0's Newton solver has a bug with sparse ones
    off = mujoco.mjtDisableBit
    # What diverges must not be reset in silence: see MujocoModel.
    option.disableflags = int(off.mjDSBL_CONTACT | off.mjDSBL_AUTORESET | off.mjDSBL_ISLAND)


def _add_looks(spec: mujoco.MjSpec, length: float, textures: bool) -> None:
    """Materials, and how pictures are made."""
    spec.stat.extent = length
    spec.stat.center = [0.0, 0.0, 0.0]
    spec.visual.headlight.ambient = [0.3, 0.3, 0.3]
    spec.visual.headlight.diffuse = [0.3, 0.3, 0.3]
    spec.visual.headlight.specular = [0.1, 0.1, 0.1]
    spec.visual.quality.shadowsize = 4096
    spec.visual.quality.offsamples = 8
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1280, 960
    spec.visual.map.shadowclip = 3.0  # the shadows of the whole picture
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 50.0
    for name, rgba in _COLOURS.items():
        spec.add_material(name=name, rgba=rgba, specular=0.5, shininess=0.6)
    wall = spec.add_material(name="wall", texrepeat=[8, 8], specular=0.05, shininess=0.1)
    if not textures:
        return
    spec.add_texture(
        name="wall",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.80, 0.83, 0.87],
        rgb2=[0.74, 0.78, 0.83],
        width=512,
        height=512,
    )
    wall.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "wall"


def _add_surroundings(spec: mujoco.MjSpec, length: float, textures: bool) -> None:
    """Sky, light, and a camera in front of the plane of the mechanism, which is upright: the ground is far below."""
    world = spec.worldbody
    if textures:
        spec.add_texture(
            name="sky",
            type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
            rgb1=[0.90, 0.93, 0.96],
            rgb2=[0.70, 0.75, 0.81],
            width=256,
            height=256,
        )
    world.add_light(
        pos=[-0.8 * length, -2.2 * length, 1.8 * length],
        dir=[0.35, 1.0, -0.75],
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        castshadow=False,
        diffuse=[0.42, 0.42, 0.42],
        specular=[0.3, 0.3, 0.3],
    )
    camera = world.add_camera(name="front", pos=[0.0, -2.75 * length, 0.0], fovy=45.0)
    camera.alt.type = mujoco.mjtOrientation.mjORIENTATION_XYAXES
    camera.alt.xyaxes = [1, 0, 0, 0, 0, 1]


def _add_bodies(spec: mujoco.MjSpec, linkage: Linkage, dynamics: Dynamics, radius: float) -> list[Any]:
    bodies: list[Any] = [spec.worldbody]
    for i, part in enumerate(linkage.bodies):
        body = spec.worldbody
        material = "base"
        if i:
            name = " ".join(part.nodes)
            body = bodies[part.parent].add_body(name=name, pos=_point(linkage.local(part.hinge, part.parent)))
            bodies.append(body)
            material = "bar" if len(part.bars) == 1 else "truss"
            body.gravcomp = float(not any(bar.mass for bar in part.bars))
            joint = body.add_joint(
                name=linkage.joints[i - 1],
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=_AXIS,
                limited=mujoco.mjtLimited.mjLIMITED_FALSE,
                frictionloss=dynamics.joint_friction,
            )
            if linkage.ranges is not None:
                joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
                joint.range = np.degrees(linkage.ranges[i - 1])
                joint.solref_limit = [2 * dynamics.timestep, 1.0]
                joint.solimp_limit = _CLOSED
            joint.damping = [dynamics.joint_damping, 0.0, 0.0]
            add_picture(
                body,
                mujoco.mjtGeom.mjGEOM_CYLINDER,
                "joint",
                zaxis=[0.0, 1.0, 0.0],
                size=[1.35 * radius, 1.5 * radius, 0.0],
            )
        for bar in part.bars:
            ends = [linkage.local(node, i) for node in bar.nodes]
            length = abs(ends[1] - ends[0])
            thickness = bar.radius or radius
            geom = body.add_geom(
                name=bar.name,
                type=mujoco.mjtGeom.mjGEOM_CYLINDER,
                fromto=[*_point(ends[0]), *_point(ends[1])],
                size=[thickness, 0.0, 0.0],
                material=material,
                contype=0,
                conaffinity=0,
            )
            geom.mass = dynamics.bar_mass(bar, length) if i else 0.0
            for end in ends:
                add_picture(body, mujoco.mjtGeom.mjGEOM_SPHERE, material, pos=_point(end), size=[thickness, 0.0, 0.0])
        if not i:
            for node in part.nodes:
                add_picture(
                    body,
                    mujoco.mjtGeom.mjGEOM_BOX,
                    "base",
                    pos=_point(linkage.reference[node], 2.5 * radius),
                    size=[2 * radius] * 3,
                )
    return bodies


def _add_loop(spec: mujoco.MjSpec, linkage: Linkage, bodies: list[Any], loop: Loop, timestep: float) -> None:
    names = []
    for body, node in ((loop.first, loop.first_node), (loop.second, loop.second_node)):
        names.append(f"loop {node} of {bodies[body].name}")
        bodies[body].add_site(name=names[-1], pos=_point(linkage.local(node, body)), group=4)
    equality = spec.add_equality(
        name=f"loop {loop.first_node}",
        type=mujoco.mjtEq.mjEQ_CONNECT,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        name1=names[0],
        name2=names[1],
    )
    equality.solref = [2 * timestep, 1.0]
    equality.solimp = _CLOSED


def _add_tendon(
    spec: mujoco.MjSpec, linkage: Linkage | Platform, bodies: list[Any], member: Member, radius: float
) -> None:
    # Both ends at one depth, so that the length is that in the plane: springs behind, cables in front.
    depth = (-1.2 if member.kind == "cable" else 1.2) * radius
    tendon = spec.add_tendon(name=member.name, material=member.kind)
    tendon.width = {"cable": 0.3, "actuator": 0.8}.get(member.kind, 0.45) * radius
    for number, span in enumerate(member.spans):
        if number:
            tendon.wrap_pulley(1.0)  # what lies between the spans is of constant length
        for node in span:
            name = f"{member.name} at {node}"
            body = linkage.owner(node)
            place = _point(linkage.local(node, body), depth)
            bodies[body].add_site(name=name, pos=place, size=[0.5 * radius] * 3, group=4)
            tendon.wrap_site(name)
    if member.kind == "spring" and not member.is_input:
        tendon.stiffness = [member.stiffness, 0.0, 0.0]
        tendon.springlength = [0.0 if member.goes_slack else member.free_length, member.free_length]


def _add_actuator(spec: mujoco.MjSpec, mechanism: Any, member: Member, length: float, dynamics: Dynamics) -> None:
    actuator = spec.add_actuator(name=member.name, trntype=mujoco.mjtTrn.mjTRN_TENDON, target=member.name)
    if member.kind == "actuator":
        _make_servo(actuator, length, dynamics)
        return
    actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
    gain, bias = actuator.gainprm, actuator.biasprm
    if member.kind == "cable":
        actuator.gear = [-1.0, 0, 0, 0, 0, 0]
        actuator.ctrlrange = [mechanism.design.min_tension, mechanism.design.max_tension]
        gain[0] = 1.0
    else:  # force on the tendon: stiffness (free length - length)
        actuator.ctrlrange = [0.0, 2 * length]
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        gain[0], bias[1] = member.stiffness, -member.stiffness
        if member.goes_slack:
            actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
            actuator.forcerange = [-2 * length * member.stiffness, 0.0]
    actuator.gainprm, actuator.biasprm = gain, bias
    if dynamics.time_constant:
        actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
        dyn = actuator.dynprm
        dyn[0] = dynamics.time_constant
        actuator.dynprm = dyn


def _make_servo(actuator: Any, length: float, dynamics: Dynamics) -> None:
    """A prismatic actuator: control is a speed, its integral the length that a stiff damped spring keeps."""
    if dynamics.time_constant:
        raise ValueError("Dynamics.actuator_bandwidth: prismatic actuators move evenly, they do not lag; give 0")
    if dynamics.integrator == "implicitfast" and dynamics.servo_time < 0.5 * dynamics.timestep:
        raise ValueError(
            f"Dynamics.servo_time = {dynamics.servo_time!r}: must be half a time step or more, or the servos diverge"
        )
    actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE
    actuator.dyntype = mujoco.mjtDyn.mjDYN_INTEGRATOR
    actuator.actlimited = mujoco.mjtLimited.mjLIMITED_TRUE
    actuator.actrange = [0.0, 2 * length]
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    gain, bias = actuator.gainprm, actuator.biasprm
    stiffness = dynamics.servo_stiffness
    gain[0], bias[1], bias[2] = stiffness, -stiffness, -stiffness * dynamics.servo_time
    actuator.gainprm, actuator.biasprm = gain, bias
