"""One table of environments: id, description, and the options of the shells."""

from typing import Any, NamedTuple

import gymnasium as gym


class Entry(NamedTuple):
    """A row of the table.

    Attributes:
        id: Gymnasium id.
        summary: one line, for listings.
        options: keyword arguments of the environment.
        max_episode_steps: time limit.
    """

    id: str
    summary: str
    options: dict[str, Any]
    max_episode_steps: int = 100


ENTRIES = (
    Entry(
        "tensegrity/TwoXReach-v0", "2-X manipulator, joint increments, stiffest feasible tensions", {"control": "joint"}
    ),
    Entry("tensegrity/TwoXTensionReach-v0", "2-X manipulator, cable tension increments", {"control": "tension"}),
    Entry(
        "tensegrity/TwoXPayloadReach-v0",
        "2-X manipulator, cable tension increments, unknown payload of 0 to 0.4 kg, only tip and tensions observed",
        {"control": "tension", "payload_range": (0.0, 0.4), "observe": "tip_and_tensions"},
    ),
)
ENV_IDS = tuple(entry.id for entry in ENTRIES)


def register_all() -> None:
    """Register every environment with Gymnasium, once."""
    for entry in ENTRIES:
        if entry.id not in gym.registry:
            gym.register(
                entry.id,
                entry_point="tensegrity_envs.env:TwoXReachEnv",
                vector_entry_point="tensegrity_envs.vector_env:TwoXReachVectorEnv",
                max_episode_steps=entry.max_episode_steps,
                kwargs=entry.options,
            )
