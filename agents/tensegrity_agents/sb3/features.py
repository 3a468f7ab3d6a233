"""What the policy network sees: the observation and the tip error on several scales."""

from typing import Any

import gymnasium as gym
import torch
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor


class GoalErrorExtractor(BaseFeaturesExtractor):
    """Concatenates the observation, the goal, and tanh(error / scale) for several scales.

    A target is hit within millimetres in a workspace of a metre; a network that sees only positions has to learn to
    subtract them to that precision first.

    Args:
        observation_space: Dict of observation, achieved_goal, desired_goal.
        scales: of the error [m].
        goal_scale: divides the goal [m].
        angles: goals are angles on the torus: the network sees their sines and cosines, and errors the shorter way
            round.
    """

    def __init__(
        self,
        observation_space: gym.spaces.Dict,
        scales: tuple[float, ...] = (0.5, 0.1, 0.02),
        goal_scale: float = 0.5,
        angles: bool = False,
    ) -> None:
        self.scales, self.goal_scale, self.angles = tuple(scales), goal_scale, angles
        sizes = {key: space.shape[0] for key, space in observation_space.spaces.items() if space.shape is not None}
        seen = sizes["desired_goal"] * (1 + angles + len(self.scales))
        super().__init__(observation_space, sizes["observation"] + seen)

    def forward(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        """Features of shape (n, features_dim)."""
        goal = observations["desired_goal"]
        error = goal - observations["achieved_goal"]
        shown = [goal / self.goal_scale]
        if self.angles:
            shown = [torch.sin(goal), torch.cos(goal)]
            error = torch.atan2(torch.sin(error), torch.cos(error))
        parts: list[Any] = [observations["observation"], *shown]
        parts += [torch.tanh(error / scale) for scale in self.scales]
        return torch.cat(parts, dim=1)
