"""skrl: its wrapper of native vectors hands on what Gymnasium's environments give; PPO trains on them."""

import tempfile
from typing import Any

import gymnasium as gym
import torch
from report import IDS, Client, must
from skrl.agents.torch.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
from skrl.trainers.torch import SequentialTrainer
from skrl.utils import set_seed
from torch import nn

import tensegrity_envs  # noqa: F401  (registers)

NUM_ENVS, STEPS, ROLLOUT = 4, 330, 64


class Policy(GaussianMixin, Model):
    """A small Gaussian policy."""

    def __init__(self, observation_space: Any, action_space: Any, device: Any) -> None:
        Model.__init__(self, observation_space=observation_space, action_space=action_space, device=device)
        GaussianMixin.__init__(self)
        self.net = nn.Sequential(nn.Linear(self.num_observations, 64), nn.ELU(), nn.Linear(64, self.num_actions))
        self.log_std = nn.Parameter(torch.zeros(self.num_actions))

    def compute(self, inputs: Any, role: str = "") -> Any:
        """Mean and deviation."""
        return self.net(inputs["observations"]), {"log_std": self.log_std}


class Value(DeterministicMixin, Model):
    """A small value function."""

    def __init__(self, observation_space: Any, action_space: Any, device: Any) -> None:
        Model.__init__(self, observation_space=observation_space, action_space=action_space, device=device)
        DeterministicMixin.__init__(self)
        self.net = nn.Sequential(nn.Linear(self.num_observations, 64), nn.ELU(), nn.Linear(64, 1))

    def compute(self, inputs: Any, role: str = "") -> Any:
        """The value."""
        return self.net(inputs["observations"]), {}


def wrapped(env_id: str, mode: str) -> Any:
    """A vector in skrl's wrapper, with skrl's seed."""
    set_seed(5)
    return wrap_env(gym.make_vec(env_id, NUM_ENVS, vectorization_mode=mode), verbose=False)


def rollout(envs: Any) -> list[Any]:
    """What skrl sees under the same actions."""
    generator = torch.Generator().manual_seed(0)
    seen = [envs.reset()[0]]
    for _ in range(STEPS):
        actions = (
            2
            * torch.rand(
                (NUM_ENVS, envs.num_actions if hasattr(envs, "num_actions") else envs.action_space.shape[0]),
                generator=generator,
            )
            - 1
        )
        seen += list(envs.step(actions)[:4])
    return seen


def equal(env_id: str) -> str:
    """skrl sees the same in the native vector and in Gymnasium's."""
    native, single = rollout(wrapped(env_id, "vector_entry_point")), rollout(wrapped(env_id, "sync"))
    must(all(torch.equal(a, b) for a, b in zip(native, single, strict=True)), "the vectors differ")
    ended = sum(int((terminated | truncated).sum()) for terminated, truncated in zip(native[3::4], native[4::4]))
    must(ended >= 2 * NUM_ENVS, f"only {ended} episodes ended")
    return "equal to SyncVectorEnv"


def trains(env_id: str) -> str:
    """Two updates of PPO."""
    envs = wrapped(env_id, "vector_entry_point")
    spaces = {"observation_space": envs.observation_space, "action_space": envs.action_space, "device": envs.device}
    with tempfile.TemporaryDirectory() as folder:
        settings = PPO_CFG(rollouts=ROLLOUT, learning_epochs=1, mini_batches=2)
        settings.experiment.directory = folder
        settings.experiment.write_interval = settings.experiment.checkpoint_interval = 0
        models = {"policy": Policy(**spaces), "value": Value(**spaces)}
        before = models["policy"].net[0].weight.detach().clone()
        agent = PPO(models=models, memory=RandomMemory(memory_size=ROLLOUT, num_envs=NUM_ENVS), cfg=settings, **spaces)
        options = {"timesteps": 2 * ROLLOUT, "headless": True, "disable_progressbar": True}
        SequentialTrainer(env=envs, agents=agent, cfg=options).train()
    after = models["policy"].net[0].weight
    must(bool(torch.isfinite(after).all()) and not torch.equal(before, after), "nothing learnt")
    return "two updates"


def main() -> None:
    """All ids."""
    client = Client("skrl")
    for env_id in IDS:
        client.check(env_id, "wrap_env of the native vector", equal, env_id)
        client.check(env_id, "PPO on the native vector", trains, env_id)


if __name__ == "__main__":
    main()
