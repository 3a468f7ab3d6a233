"""The policies that come with the package, one for each id that has any."""

from collections.abc import Mapping
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tensegrity_envs

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
        ValueError: there is none for this id, and the message says for which there are; or it does not fit the
            environment with these options.
    """
    from tensegrity_agents.sb3.policy_file import load_policy

    short = env_id.rpartition("/")[2]
    name = f"tensegrity/{short}"
    if name not in pretrained_ids():
        there = [one.removeprefix("tensegrity/") for one in pretrained_ids()]
        close = get_close_matches(short, there, 1)
        known = name in tensegrity_envs.ENV_IDS
        raise ValueError(
            f"no policy is shipped for {env_id}"
            + ("" if known else ", which is no environment of this package")
            + (f" (did you mean {close[0]}?)" if close and not known else "")
            + f"; there are policies for {', '.join(there) or 'no environment yet'}"
            + (f", and `tensegrity train {short}` trains one where it has a config" if known else "")
        )
    return load_policy(FOLDER / short, name, options)
