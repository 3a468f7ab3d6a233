"""The policies that come with the package, one for each id that has any."""

from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tensegrity_agents.sb3.policy_file import TrainedPolicy

FOLDER = Path(str(files("tensegrity_agents"))) / "policies"


@cache
def pretrained_ids() -> tuple[str, ...]:
    """The ids of the environments that have a shipped policy."""
    return tuple(f"tensegrity/{path.parent.name}" for path in sorted(FOLDER.glob("*/policy.json")))


def load_pretrained(env_id: str) -> "TrainedPolicy":
    """The shipped policy of an environment: the median of those that were trained for docs/results.md.

    Args:
        env_id: such as "TwoXReach-v0", with or without "tensegrity/".

    Returns:
        A policy with Stable-Baselines3's `predict`, for batches of the environment's observations.

    Raises:
        ValueError: there is none for this id; the message says for which there are.
    """
    from tensegrity_agents.sb3.policy_file import load_policy

    name = f"tensegrity/{env_id.rpartition('/')[2]}"
    if name not in pretrained_ids():
        there = ", ".join(pretrained_ids()) or "no environment yet"
        raise ValueError(f"no policy is shipped for {env_id}; there are policies for {there}")
    return load_policy(FOLDER / name.rpartition("/")[2], name)
