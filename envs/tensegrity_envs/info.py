"""What the entries of `info` mean: from one place, for people and for the tables of docs/environments.md."""

from typing import NamedTuple

from tensegrity_envs.core import Core
from tensegrity_envs.options import described
from tensegrity_envs.randomization import Randomization


class Meaning(NamedTuple):
    """What an entry of `info` means.

    Attributes:
        unit: the unit of its numbers; "-" where they have none.
        text: one line.
    """

    unit: str
    text: str


def meanings_of(core: Core) -> dict[str, Meaning]:
    """What every entry of an environment's `info` means, in the order in which they come."""
    unit = "m" if core.error_unit == "mm" else "rad"
    known = {
        "is_success": Meaning("-", "whether the task is done, as things are"),
        core.error_name: Meaning(unit, "distance from the goal"),
        "is_stable": Meaning("-", "whether the stability margin is positive"),
        "is_wrench_feasible": Meaning("-", "whether the wrench margin is not negative"),
        "effort": Meaning("-", "mean of the squared inputs, each divided by its scale"),
        "true_goal": Meaning(unit, "the achieved goal without the noise of the sensors"),
        "stability_margin": Meaning("-", "positive where the equilibrium is stable"),
        "wrench_margin": Meaning("-", "positive where inputs and limits leave room"),
        "failure": Meaning("-", "0, or why the episode ends; `termination_reason` puts it into words"),
        "configuration": Meaning("rad", "the mechanism's configuration"),
        "step": Meaning("-", "steps since the episode began"),
    }
    if core.input_name:
        field = core.schema.fields[core.input_name]
        known[core.input_name] = Meaning(field.unit, field.meaning)
    for name, text in described(Randomization).items():
        known[f"random_{name}"] = Meaning("-", f"drawn for the episode: {text}")
    known["random_noise_key"] = Meaning("-", "drawn for the episode: from which the noise of the sensors follows")
    known["random_level"] = Meaning("-", "drawn for the episode: the level of uncertainty, where there are several")
    names = [*(entry.name for entry in core.info_entries), "step"]
    for name in names:
        if name.startswith("reward_"):
            known[name] = Meaning("-", f"weighted term of the reward: {name.removeprefix('reward_')}")
    known |= {name: Meaning(*meaning) for name, meaning in (core.info_meanings | core.task.info_meanings).items()}
    return {name: known[name] for name in names}
