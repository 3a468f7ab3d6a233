"""One table of environments: id, description, arm, and the options of the core."""

from typing import Any, NamedTuple

import gymnasium as gym


class Entry(NamedTuple):
    """A row of the table.

    Attributes:
        id: Gymnasium id.
        summary: one line, for listings.
        arm: name of its core in `environments.ARMS`.
        options: keyword arguments of the core, as JSON has them: lists, no tuples, so that specs survive `to_json`.
        max_episode_steps: time limit.
    """

    id: str
    summary: str
    arm: str
    options: dict[str, Any]
    max_episode_steps: int = 100


_NOMINAL = (
    Entry(
        "tensegrity/TwoXReach-v0",
        "2-X manipulator, joint increments, stiffest feasible tensions",
        "TwoXReach",
        {"control": "joint"},
    ),
    Entry(
        "tensegrity/TwoXTensionReach-v0",
        "2-X manipulator, cable tension increments",
        "TwoXReach",
        {"control": "tension"},
    ),
    Entry(
        "tensegrity/TwoXPayloadReach-v0",
        "2-X manipulator, cable tension increments, unknown payload of 0 to 0.4 kg, only tip and tensions observed",
        "TwoXReach",
        {"control": "tension", "payload_range": [0.0, 0.4], "observe": "tip_and_inputs"},
    ),
    Entry(
        "tensegrity/TwoXTensionReachMuJoCo-v0",
        "2-X manipulator with its dynamics, cable tension increments",
        "TwoXReach",
        {"control": "tension", "backend": "mujoco", "observe_velocities": True},
        150,
    ),
    Entry(
        "tensegrity/DualTriangleReachMuJoCo-v0",
        "three dual-triangle segments with their dynamics, control input increments, no load",
        "DualTriangleReach",
        {"backend": "mujoco", "observe_velocities": True},
        150,
    ),
    Entry(
        "tensegrity/DualTriangleLoadedReachMuJoCo-v0",
        "three dual-triangle segments with their dynamics, control input increments, unknown tip force, only tip, tip "
        "velocity and inputs observed",
        "DualTriangleReach",
        {"load_range": [0.0, 1.5], "observe": "tip_and_inputs", "backend": "mujoco", "observe_velocities": True},
        150,
    ),
    Entry(
        "tensegrity/DualTriangleReach-v0",
        "three dual-triangle segments, control input increments, no load",
        "DualTriangleReach",
        {},
    ),
    Entry(
        "tensegrity/DualTriangleLoadedReach-v0",
        "three dual-triangle segments, control input increments, unknown tip force of up to 1.5 times the straight "
        "arm's critical load, only tip and inputs observed",
        "DualTriangleReach",
        {"load_range": [0.0, 1.5], "observe": "tip_and_inputs"},
    ),
    Entry(
        "tensegrity/DualTrianglePush-v0",
        "three dual-triangle segments, increments of six free lengths: hold the tip against a growing unseen push",
        "DualTrianglePush",
        {},
        150,
    ),
    Entry(
        "tensegrity/TwoXPostureChange-v0",
        "plain 2-X (b = 9/10 L), joint increments: from one inverse solution to another of the same aspect, never "
        "meeting a singularity",
        "TwoXPostureChange",
        {},
        200,
    ),
    Entry(
        "tensegrity/PlanarFourBarReach-v0",
        "planar 4-bar tensegrity, actuator length increments, no load",
        "PlanarFourBarReach",
        {},
    ),
    Entry(
        "tensegrity/PlanarFourBarLoadedReach-v0",
        "planar 4-bar tensegrity, actuator length increments, unknown force on F of up to 0.2 K L, only tip and "
        "lengths observed",
        "PlanarFourBarReach",
        {"load_range": [0.0, 0.2], "observe": "tip_and_inputs"},
    ),
    Entry(
        "tensegrity/PlanarFourBarReachMuJoCo-v0",
        "planar 4-bar tensegrity with its dynamics, actuator length increments, no load",
        "PlanarFourBarReach",
        {"backend": "mujoco", "observe_velocities": True},
        150,
    ),
    Entry(
        "tensegrity/SpatialPrismTrackMuJoCo-v0",
        "spatial prism with its dynamics, length increments: follow a closed curve in space for two cycles",
        "SpatialPrismTrack",
        {"backend": "mujoco", "observe_velocities": True},
        400,
    ),
    Entry(
        "tensegrity/SpatialPrismTrack-v0",
        "spatial prism of three struts, length increments: follow a closed curve in space for two cycles",
        "SpatialPrismTrack",
        {},
        400,
    ),
    Entry(
        "tensegrity/SpatialPrismPayloadTrack-v0",
        "spatial prism of three struts, length increments: follow the curve with an unknown payload of 0 to 0.5 kg "
        "from some moment of the first cycle on; orientation and payload not observed",
        "SpatialPrismTrack",
        {"payload_range": [0.0, 0.5], "observe": "tip_and_inputs"},
        400,
    ),
    Entry(
        "tensegrity/ThreeXReach-v0",
        "arm of three X-joints, joint increments, stiffest feasible tensions",
        "NXReach",
        {"control": "joint"},
    ),
    Entry(
        "tensegrity/ThreeXTensionReach-v0",
        "arm of three X-joints, cable tension increments",
        "NXReach",
        {"control": "tension"},
    ),
    Entry(
        "tensegrity/ThreeXPayloadReach-v0",
        "arm of three X-joints, cable tension increments, unknown payload of 0 to 0.4 kg, only tip and tensions "
        "observed",
        "NXReach",
        {"control": "tension", "payload_range": [0.0, 0.4], "observe": "tip_and_inputs"},
    ),
    Entry(
        "tensegrity/ThreeXTensionReachMuJoCo-v0",
        "arm of three X-joints with its dynamics, cable tension increments",
        "NXReach",
        {"control": "tension", "backend": "mujoco", "observe_velocities": True},
        150,
    ),
    Entry(
        "tensegrity/ThreeXObstacleReach-v0",
        "arm of three X-joints among three discs that differ from episode to episode, joint increments",
        "NXObstacleReach",
        {"control": "joint"},
    ),
    Entry(
        "tensegrity/DualTriangleObstacleReach-v0",
        "five dual-triangle segments among three discs that differ from episode to episode, control input increments",
        "DualTriangleObstacleReach",
        {"segments": 5},
    ),
    Entry(
        "tensegrity/TwoXFastReachMuJoCo-v0",
        "2-X manipulator, lightly damped, with friction and lagging cables: how soon the tip stays on target",
        "TwoXFastReach",
        {"control": "tension", "backend": "mujoco", "observe_velocities": True},
        150,
    ),
    Entry(
        "tensegrity/DualTriangleFastReachMuJoCo-v0",
        "three dual-triangle segments, lightly damped, with friction and lagging cables: how soon the tip stays on "
        "target",
        "DualTriangleFastReach",
        {"backend": "mujoco", "observe_velocities": True},
        150,
    ),
    Entry(
        "tensegrity/TwoXStiffnessReach-v0",
        "2-X manipulator, cable tension increments: the tip at a target, with a commanded stiffness",
        "TwoXStiffnessReach",
        {"control": "tension"},
    ),
    Entry(
        "tensegrity/ThreeXStiffnessReach-v0",
        "arm of three X-joints, cable tension increments: the tip at a target, with a commanded stiffness",
        "NXStiffnessReach",
        {"control": "tension"},
    ),
)
# Those of which there is an uncertain twin, at level 2, and what that has besides: the 2-X the hinges and cables of the
# fast task, so that friction and bandwidth are uncertain, too.
_UNCERTAIN: dict[str, dict[str, Any]] = {
    "TwoXTensionReach": {},
    "TwoXPayloadReach": {},
    "TwoXTensionReachMuJoCo": {"dynamics": {"joint_friction": 0.002, "actuator_bandwidth": 8.0}},
    "DualTriangleLoadedReach": {},
    "DualTriangleLoadedReachMuJoCo": {},
    "SpatialPrismPayloadTrack": {},
    "PlanarFourBarLoadedReach": {},
    "PlanarFourBarReachMuJoCo": {},
}


def _uncertain(entry: Entry) -> Entry:
    """The same environment, where each episode has an arm of its own, noise and delay."""
    name = _short(entry)
    base, dynamic, _ = name.partition("MuJoCo")
    more = _UNCERTAIN[name]
    unknown = "unknown stiffness, mass and damping" if dynamic else "unknown stiffness"
    if more:
        unknown = "friction and lagging cables; " + unknown.replace(" and damping", ", damping, friction and lag")
    return entry._replace(
        id=f"tensegrity/{base}Uncertain{dynamic}-v0",
        summary=f"{entry.summary}; {unknown}, noise and delay (level 2 of 3)",
        options=entry.options | more | {"level": 2},
    )


def _short(entry: Entry) -> str:
    return entry.id.removeprefix("tensegrity/").removesuffix("-v0")


ENTRIES = (*_NOMINAL, *(_uncertain(entry) for entry in _NOMINAL if _short(entry) in _UNCERTAIN))
_SHELLS = {
    "quasi_static": "tensegrity_envs.env:ManipulatorEnv",
    "mujoco": "tensegrity_envs.mujoco_env:MujocoManipulatorEnv",
}
ENV_IDS = tuple(entry.id for entry in ENTRIES)


def full_id(name: str) -> str:
    """The id of an environment of this package, with or without its namespace; other names stay what they are."""
    full = f"tensegrity/{name}"
    return full if full in ENV_IDS else name


def register_all() -> None:
    """Register every environment with Gymnasium, once."""
    for entry in ENTRIES:
        if entry.id not in gym.registry:
            gym.register(
                entry.id,
                entry_point=_SHELLS[entry.options.get("backend", "quasi_static")],
                vector_entry_point="tensegrity_envs.vector_env:ManipulatorVectorEnv",
                max_episode_steps=entry.max_episode_steps,
                # Gymnasium 1.4's checker lets no step pass after a first reset that was refused; the tests run
                # `check_env` instead, and the environments say themselves what they were given.
                disable_env_checker=True,
                kwargs={"arm": entry.arm, **entry.options},
            )
