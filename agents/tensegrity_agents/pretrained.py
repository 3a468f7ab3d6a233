"""The policies that come with the package, one for each id that has any."""

from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tensegrity_envs
from tensegrity_agents.config import did_you_mean

if TYPE_CHECKING:
    from tensegrity_agents.sb3.policy_file import TrainedPolicy

AGENT = "agent"  # what the shipped policy is called among controllers
FOLDER = Path(str(files("tensegrity_agents"))) / "policies"


@cache
def pretrained_ids() -> tuple[str, ...]:
    """The ids of the environments that have a shipped policy."""
    return tuple(f"tensegrity/{path.parent.name}" for path in sorted(FOLDER.glob("*/policy.json")))


def load_pretrained(env_id: str, options: Mapping[str, Any] | None = None) -> "TrainedPolicy":
    """The shipped policy of an environment: the median of those that were trained for docs/results.md.

    Args:
        env_id: such as "TwoXReach-v0", with or without "tensegrity/".
        options: of the environment that it is wanted for, such as `{"design": ...}`.

    Returns:
        A policy with Stable-Baselines3's `predict`, for batches of the environment's observations.

    Raises:
        TypeError: the id is no text, or the options are no mapping.
        ValueError: there is none for this id, and the message says for which there are; or it does not fit the
            environment with these options.
    """
    from tensegrity_agents.sb3.policy_file import load_policy

    if not isinstance(env_id, str):
        raise TypeError(f"load_pretrained: env_id = {env_id!r}: must be an id, such as 'TwoXReach-v0'")
    if options is not None and not isinstance(options, Mapping):
        raise TypeError(f"load_pretrained: options = {options!r}: must be a dict, such as {{'level': 3}}")
    short = env_id.removeprefix("tensegrity/")
    name = f"tensegrity/{short}"
    if name not in pretrained_ids():
        if name not in tensegrity_envs.ENV_IDS:
            hint = did_you_mean(short, pretrained_ids())
            raise ValueError(f"no policy is shipped for {env_id}, which is no environment of this package{hint}")
        there = ", ".join(one.removeprefix("tensegrity/") for one in pretrained_ids())
        raise ValueError(
            f"no policy is shipped for {env_id}; there are policies for {there}, and `tensegrity train {short}` trains "
            "one where it has a config"
        )
    return load_policy(FOLDER / short, name, options)
