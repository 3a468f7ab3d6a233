"""What only training is told: hidden numbers for the value function, and for an estimate that the policy learns.

With `privileged:` in a config, observations of the training environments have one more entry: the load, what was drawn
for the episode, and the true state. The policy does not see it. The value function does [Pinto2018], so that a return
that a hidden load explains is no noise to it. And the last hidden layer of the policy has a second head, which
estimates these numbers from what the policy sees; its squared error is added to the loss, so that the layer holds what
there is to know about the load. Neither is kept with the policy: what is saved is the actor of a plain
`MultiInputActorCriticPolicy`, which acts upon observations alone.

[Pinto2018] Pinto, Andrychowicz, Welinder, Zaremba, Abbeel, "Asymmetric actor critic for image-based robot learning",
RSS 2018.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import MultiInputActorCriticPolicy
from stable_baselines3.common.torch_layers import MlpExtractor
from stable_baselines3.common.vec_env import VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from tensegrity_agents.sb3.features import GoalErrorExtractor
from tensegrity_agents.sb3.levels import LevelsVecEnv, Shells
from tensegrity_agents.sb3.vec_env import VectorEnvAdapter
from tensegrity_envs.compiler.pytree import Row
from tensegrity_envs.core import Core

PRIVILEGED = "privileged"
_SEEDS = ("noise_key",)  # numbers of an episode that mean nothing


class Told:
    """Which numbers are told: load, what was drawn, and the true state, in the same order at every level.

    At a level at which a number is not drawn it is that of the nominal arm.

    Args:
        cores: of the environments, one for each level.
    """

    def __init__(self, cores: Sequence[Core]) -> None:
        each = [_hidden(core) for core in cores]
        drawn = [name for own in each for name, row in own.items() if isinstance(row, Row)]
        self.names = list(dict.fromkeys(drawn))
        self._episodes = [[own.get(name, _nominal(name)) for name in self.names] for own in each]
        self._states = [_state_rows(core) for core in cores]
        self.size = len(self.names) + len(self._states[0])

    def __call__(self, level: int, episodes: np.ndarray, outcomes: np.ndarray) -> np.ndarray:
        """The numbers, (environments, size), from matrices with a column for each environment.

        Args:
            level: number of the core.
            episodes: parameters of the running episodes.
            outcomes: of the latest step.
        """
        own = self._episodes[level]
        drawn = [episodes[row] if isinstance(row, Row) else np.full(episodes.shape[1], row) for row in own]
        return np.stack([*drawn, *outcomes[self._states[level]]], axis=1).astype(np.float32)


def _state_rows(core: Core) -> list[int]:
    """The rows of the true state: configuration, velocity, inputs, tip and margins."""
    state = core.outcomes.rows.state
    told = itertools.chain(state.configuration, state.velocity, state.inputs, state.tip)
    return [*told, state.stability_margin, state.wrench_margin]


def _hidden(core: Core) -> dict[str, int | float]:
    """The row of each parameter of an episode, or the number itself where it is the same in all episodes."""
    rows = core.episodes.rows
    tree = {"design": rows.design, "load": rows.load, "rate": rows.load_rate, "onset": rows.onset, **rows.random}
    leaves = {name: value for name, value in _leaves(tree) if name not in _SEEDS}
    return {name: value if isinstance(value, Row) else float(value) for name, value in leaves.items()}


def _nominal(name: str) -> float:
    """Of what is not drawn: no delay, and factors of one."""
    return 0.0 if "delay" in name else 1.0


def _leaves(tree: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """The numbers and rows in a tree, with names."""
    if is_dataclass(tree):
        tree = {field.name: getattr(tree, field.name) for field in fields(tree)}
    if isinstance(tree, list | tuple):
        tree = dict(enumerate(tree))
    if isinstance(tree, dict):
        for key, part in tree.items():
            yield from _leaves(part, f"{name}.{key}".lstrip("."))
    elif isinstance(tree, int | float) and not isinstance(tree, bool):
        yield name, tree


class PrivilegedVecEnv(VecEnvWrapper):
    """Adds the entry "privileged" to the observations of native environments.

    The last observation of an episode is told the numbers of the step before, when the arm was where it then stayed or
    nearly so: the next episode has begun when it is seen.
    """

    def __init__(self, venv: VectorEnvAdapter | LevelsVecEnv) -> None:
        shell: Any = venv.shell
        self.parts = shell.parts if isinstance(shell, Shells) else [shell]
        self.told = Told([part.core for part in self.parts])
        space: Any = venv.observation_space
        own = spaces.Box(-np.inf, np.inf, (self.told.size,), np.float32)
        super().__init__(venv, spaces.Dict({**space.spaces, PRIVILEGED: own}))
        self._latest = np.zeros((venv.num_envs, self.told.size), np.float32)

    @property
    def shell(self) -> Any:
        """The native vector environment within, or those of several levels."""
        return self.venv.shell  # type: ignore[attr-defined]

    def look(self) -> np.ndarray:
        """The numbers of the running episodes, (environments, size)."""
        self._latest = np.concatenate([self.told(k, *part.matrices) for k, part in enumerate(self.parts)])
        return self._latest

    def reset(self) -> VecEnvObs:
        """Begin new episodes everywhere."""
        observation: Any = self.venv.reset()
        return {**observation, PRIVILEGED: self.look()}

    def step_wait(self) -> VecEnvStepReturn:
        """Take the step."""
        before = self._latest
        observation: Any
        observation, reward, done, infos = self.venv.step_wait()
        for i in np.flatnonzero(done):
            infos[i]["terminal_observation"] = {**infos[i]["terminal_observation"], PRIVILEGED: before[i]}
        return {**observation, PRIVILEGED: self.look()}, reward, done, infos


class PrivilegedExtractor(GoalErrorExtractor):
    """The features of `GoalErrorExtractor`, and behind them, where there is one, the entry "privileged"."""

    def __init__(self, observation_space: spaces.Dict, **kwargs: Any) -> None:
        super().__init__(observation_space, **kwargs)
        self.actor_size = self.features_dim
        self._features_dim = self.actor_size + int(np.prod(observation_space[PRIVILEGED].shape or ()))

    def forward(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        """Features of shape (n, features_dim); without that entry, (n, actor_size)."""
        seen = super().forward(observations)
        return torch.cat([seen, observations[PRIVILEGED]], dim=1) if PRIVILEGED in observations else seen


class _Asymmetric(MlpExtractor):
    """Hidden layers of the policy, which take the first `actor_size` features, and of the value function."""

    def __init__(self, actor_size: int, features_dim: int, *args: Any, **kwargs: Any) -> None:
        super().__init__(features_dim, *args, **kwargs)
        self.actor_size = actor_size
        self.policy_net = MlpExtractor(actor_size, *args, **kwargs).policy_net

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        """The last hidden layer of the policy."""
        latent: torch.Tensor = self.policy_net(features[:, : self.actor_size])
        return latent


class PrivilegedPolicy(MultiInputActorCriticPolicy):
    """A policy for training; see the module.

    Args:
        identify: weight of the squared error of the estimate, each number of unit variance; it enters the loss as
            "entropy", so that the algorithm needs `ent_coef=1`.
    """

    def __init__(self, *args: Any, identify: float, **kwargs: Any) -> None:
        self.identify = identify
        super().__init__(*args, **kwargs)

    def _build_mlp_extractor(self) -> None:
        extractor: Any = self.features_extractor
        self.mlp_extractor = _Asymmetric(
            extractor.actor_size,
            self.features_dim,
            net_arch=self.net_arch,
            activation_fn=self.activation_fn,
            device=self.device,
        )
        size = self.features_dim - extractor.actor_size
        self.estimate_net = torch.nn.Linear(self.mlp_extractor.latent_dim_pi, size)

    def evaluate_actions(
        self, obs: Any, actions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]:
        """Values, log likelihoods, and minus the weighted squared error of the estimate."""
        features: Any = self.extract_features(obs)
        latent_pi, latent_vf = self.mlp_extractor(features)
        error = self.estimate_net(latent_pi) - features[:, self.mlp_extractor.actor_size :]
        log_prob = self._get_action_dist_from_latent(latent_pi).log_prob(actions)
        return self.value_net(latent_vf), log_prob, -self.identify * error.square().mean(dim=1)


def actor_of(policy: PrivilegedPolicy, plain: MultiInputActorCriticPolicy) -> MultiInputActorCriticPolicy:
    """The plain policy with this one's actor; its value function, which would need to be told, is zero.

    Args:
        policy: the trained one.
        plain: of the same architecture, for observations without the entry "privileged".
    """
    with torch.no_grad():
        for name, own in plain.named_parameters():
            value = name.startswith(("value_net", "mlp_extractor.value_net"))
            own.copy_(torch.zeros_like(own) if value else policy.get_parameter(name))
    return plain
