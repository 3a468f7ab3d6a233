"""TorchRL: rollouts are those of the single environments, transition by transition, in each way it makes several.

Not among them: `GymEnv(id, num_envs=n)`, whose last observations are zeros for every Gymnasium environment (see
docs/compatibility.md); the native vector with autoreset_mode="Disabled" does that job.
"""

import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from report import IDS, Client, Inapplicable, must
from torchrl.envs import GymEnv, GymWrapper, SerialEnv
from torchrl.envs.utils import check_env_specs

import tensegrity_envs  # noqa: F401  (registers)

warnings.filterwarnings("ignore")
SEED, STEPS = 3, 330
KEYS = ("observation", "achieved_goal", "desired_goal")


def with_info(env_id: str) -> Any:
    """A single environment whose info becomes part of the tensors."""
    return GymEnv(env_id).auto_register_info_dict()


def specs(env_id: str) -> str:
    """TorchRL's own check."""
    check_env_specs(with_info(env_id))
    return "check_env_specs passes"


def native(env_id: str, mode: str) -> Any:
    """The native vector in TorchRL's wrapper."""
    return GymWrapper(gym.make_vec(env_id, 2, vectorization_mode="vector_entry_point", autoreset_mode=mode))


def rollout(envs: Any) -> Any:
    """Random actions over the ends of episodes, as rows of environments."""
    torch.manual_seed(0)
    envs.set_seed(SEED)
    seen = envs.rollout(STEPS, break_when_any_done=False)
    return seen if seen.ndim == 2 else seen[None]


def equal_to_single(env_id: str, seen: Any) -> str:
    """Replays the actions in Gymnasium's environments: observations, last ones included, rewards and ends are equal."""
    ended = 0
    for i, row in enumerate(seen):
        env = gym.make(env_id)
        env.reset(seed=SEED + i)  # which TorchRL does when it is seeded
        now, _ = env.reset()
        for step in range(STEPS):
            for key in KEYS:
                must(np.array_equal(now[key], row[key][step].numpy()), f"step {step}: another {key}")
            now, reward, terminated, truncated, info = env.step(row["action"][step].numpy())
            following = row["next"][step]
            for key in KEYS:
                must(np.array_equal(now[key], following[key].numpy()), f"step {step}: another next {key}")
            must(np.float32(reward) == following["reward"].item(), f"step {step}: another reward")
            must(terminated == following["terminated"].item(), f"step {step}: terminated differs")
            must(truncated == following["truncated"].item(), f"step {step}: truncated differs")
            if "is_success" in following:
                must(bool(info["is_success"]) == following["is_success"].item(), f"step {step}: is_success differs")
            if terminated or truncated:
                now, _ = env.reset()
                ended += 1
    must(ended >= 2, "too few episodes ended")
    return "equal to Gymnasium's"


def single(env_id: str) -> str:
    """One environment, with its info."""
    seen = rollout(with_info(env_id))
    must("is_success" in seen["next"], "info is missing")
    return equal_to_single(env_id, seen)


def serial(env_id: str) -> str:
    """Two single environments in TorchRL's own vector."""
    envs = SerialEnv(2, lambda: with_info(env_id))
    seen = rollout(envs)
    # TorchRL draws the second environment's seed from the first one's.
    targets = {tuple(row["desired_goal"][0].tolist()) for row in seen}
    must(len(targets) == 2, "both environments have the same episode")
    return equal_to_single(env_id, seen[:1])


def disabled(env_id: str) -> str:
    """The native vector, which TorchRL resets."""
    return equal_to_single(env_id, rollout(native(env_id, "Disabled")))


def same_step(env_id: str) -> str:
    """The native vector in the other mode that TorchRL accepts."""
    try:
        return equal_to_single(env_id, rollout(native(env_id, "SameStep")))
    except RuntimeError as fault:
        mode = {"autoreset_mode": AutoresetMode.SAME_STEP}
        try:
            rollout(GymWrapper(gym.make_vec(env_id, 2, vectorization_mode="sync", vector_kwargs=mode)))
        except RuntimeError as theirs:
            if str(theirs) == str(fault):
                raise Inapplicable(
                    "TorchRL takes no Dict observations in SAME_STEP, of SyncVectorEnv neither"
                ) from fault
        raise


def next_step(env_id: str) -> str:
    """TorchRL refuses the mode that is Gymnasium's default, of all environments."""
    try:
        native(env_id, "NextStep")
    except RuntimeError as fault:
        raise Inapplicable("refused by TorchRL for every environment: it wants DISABLED") from fault
    return "accepted"


def main() -> None:
    """All ids."""
    client = Client("torchrl")
    for env_id in IDS:
        client.check(env_id, "check_env_specs, with info", specs, env_id)
        client.check(env_id, "GymEnv, with info", single, env_id)
        client.check(env_id, "SerialEnv of GymEnv", serial, env_id)
        client.check(env_id, "GymWrapper of the native vector, Disabled", disabled, env_id)
        client.check(env_id, "the same, SameStep", same_step, env_id)
        client.check(env_id, "the same, NextStep", next_step, env_id)


if __name__ == "__main__":
    main()
