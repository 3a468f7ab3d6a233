"""Policies for other programs."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Union

from tensegrity_agents.pretrained import load_pretrained

if TYPE_CHECKING:
    from tensegrity_agents.sb3.policy_file import TrainedPolicy


def export(policy: Union["TrainedPolicy", str, os.PathLike[str]], path: str | os.PathLike[str]) -> float:
    """Write a policy as ONNX and check the file against it, on 1,000 observations; see `sb3.onnx_policy`.

    Args:
        policy: a policy, the folder of one, or an id such as "TwoXReach-v0" that has a shipped one.
        path: of the file; must end in .onnx.

    Returns:
        The largest difference of an action, at most 1e-6.

    Raises:
        ValueError: another suffix, no such policy.
        ImportError: the extra "onnx" is not installed.
        RuntimeError: the file would not do what the policy does; it is not written.
    """
    from tensegrity_agents.sb3.onnx_policy import export as write
    from tensegrity_agents.sb3.policy_file import TrainedPolicy, load_policy

    path = Path(path)
    if path.suffix != ".onnx":
        raise ValueError(f"{path}: the name of the file must end in .onnx")
    if not isinstance(policy, TrainedPolicy):
        policy = load_policy(policy) if Path(policy).exists() else load_pretrained(str(policy))
    return write(policy, path)
