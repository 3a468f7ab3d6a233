"""Drive an arm by keyboard."""

from typing import Annotated, Any

import gymnasium as gym
import numpy as np
import typer

from tensegrity_agents.command_options import EnvironmentOptions, with_option_groups
from tensegrity_agents.config import known_env
from tensegrity_agents.console import clear_errors, say
from tensegrity_envs import termination_reason

# Pairs of keys for the components of an action: less and more.
KEYS = (("left", "right"), ("down", "up"), ("a", "d"), ("s", "w"), ("f", "h"), ("g", "t"))


def action_of(pressed: Any, size: int, speed: float) -> np.ndarray:
    """The action of the keys that are pressed.

    Args:
        pressed: a function from a key's name to whether it is pressed.
        size: of the action.
        speed: magnitude of a component whose key is pressed.
    """
    values = [speed * (float(pressed(more)) - float(pressed(less))) for less, more in KEYS[:size]]
    return np.array(values, np.float32)


@with_option_groups
def main(
    options: EnvironmentOptions,
    env: Annotated[str, typer.Argument(help="environment, such as TwoXReach-v0")] = "TwoXReach-v0",
    seed: Annotated[int, typer.Option(min=0, help="of the first episode")] = 0,
    speed: Annotated[float, typer.Option(min=0.01, max=1.0, help="action of a pressed key")] = 0.3,
) -> None:
    """Drive an arm by keyboard; the window shows target and margins.

    Example: tensegrity play TwoXTensionReach-v0
    """
    with clear_errors("good bye"):
        env_id = known_env(env)
        given = options.checked(env_id)
        made = gym.make(env_id, render_mode="human", max_episode_steps=-1, **given)
        try:
            drive(made, seed, speed)
        finally:
            made.close()


def drive(env: Any, seed: int, speed: float) -> None:
    """Step with the keys until the window is closed or Escape is pressed; R begins another episode."""
    _, info = env.reset(seed=seed)
    import pygame

    core, size = env.unwrapped.core, env.action_space.shape[0]
    pairs = ", ".join(f"{less}/{more}" for less, more in KEYS[:size])
    say(f"keys: {pairs} for the {size} components of the action, R for another episode, Escape to end")

    def pressed(name: str) -> bool:
        return bool(pygame.key.get_pressed()[pygame.key.key_code(name)])

    while pygame.display.get_init() and not pressed("escape"):
        if pressed("r"):
            _, info = env.reset()
        _, _, terminated, truncated, info = env.step(action_of(pressed, size, speed))
        if not env.unwrapped.window_is_open:
            return
        if terminated or truncated:
            say(f"{termination_reason(info['failure'])}: {core.error_text(float(info[core.error_name]))} off")
            _, info = env.reset()
