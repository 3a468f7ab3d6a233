"""Drive an arm by keyboard and mouse."""

from collections.abc import Callable
from typing import Annotated, NamedTuple, Protocol

import gymnasium as gym
import numpy as np
import typer

from tensegrity_agents.command_options import EnvironmentChoice, EnvironmentOptions, with_option_groups
from tensegrity_agents.console import clear_errors, need_window, say
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.env_options import short_name
from tensegrity_agents.evaluation.player import Player
from tensegrity_envs import termination_reason
from tensegrity_envs.env import unwrapped
from tensegrity_envs.rendering import Scene, View, Viewer, need_display

# Pairs of keys for the components of an action: less and more.
KEYS = (("left", "right"), ("down", "up"), ("a", "d"), ("s", "w"), ("f", "h"), ("g", "t"))
_FOLLOWER = "pseudo_inverse"  # the baseline that moves the tip after the mouse
_FPS = 20


class Pointer(NamedTuple):
    """The mouse.

    Attributes:
        place: in the window (to the right, down) [pixels].
        left: whether its left button is pressed.
        right: likewise.
    """

    place: tuple[float, float]
    left: bool
    right: bool


class Hands(Protocol):
    """What the person at the keyboard does."""

    def pressed(self, key: str) -> bool:
        """Whether a key is pressed, by its name."""
        ...

    def pointer(self) -> Pointer:
        """The mouse."""
        ...


class PygameHands:
    """Keyboard and mouse, as pygame's window has them."""

    def pressed(self, key: str) -> bool:
        """See `Hands`."""
        import pygame

        return bool(pygame.key.get_pressed()[pygame.key.key_code(key)])

    def pointer(self) -> Pointer:
        """See `Hands`."""
        import pygame

        left, _, right = pygame.mouse.get_pressed(3)
        return Pointer(pygame.mouse.get_pos(), left, right)


def action_of(pressed: Callable[[str], bool], size: int, speed: float) -> np.ndarray:
    """The action of the keys that are pressed.

    Args:
        pressed: a function from a key's name to whether it is pressed.
        size: of the action.
        speed: magnitude of a component whose key is pressed.
    """
    values = [speed * (float(pressed(more)) - float(pressed(less))) for less, more in KEYS[:size]]
    return np.array(values, np.float32)


def place_of(scene: Scene, size: tuple[int, int], pixel: tuple[float, float]) -> np.ndarray:
    """What is in the window at a pixel, shape (2,) [m]."""
    view = View(size, scene.reach, 1, (float(scene.centre[0]), float(scene.centre[1])))
    return np.array(view.point(pixel))


@with_option_groups
def main(
    chosen: EnvironmentChoice,
    options: EnvironmentOptions,
    seed: Annotated[int, typer.Option(min=0, help="of the first episode")] = 0,
    speed: Annotated[float, typer.Option(min=0.01, max=1.0, help="action of a pressed key")] = 0.3,
) -> None:
    """Drive an arm: the keys move its inputs, the left mouse button draws its tip, the right one moves its target.

    The window shows target, tensions and margins. In space, and where angles are the goal, there are the keys alone.
    ENVIRONMENT is TwoXReach-v0 if it is left out.

    Example: tensegrity play TwoXTensionReach-v0
    """
    with clear_errors("good bye"):
        env_id = chosen.named("TwoXReach-v0")
        need_window(
            need_display,
            f"tensegrity watch {short_name(env_id)} --record film.gif films a controller, and tensegrity playground "
            "writes a page to drive a mechanism in a browser",
        )
        given = options.checked(env_id)
        env = gym.make(env_id, render_mode="rgb_array", max_episode_steps=-1, **given)
        viewer = Viewer(unwrapped(env).render_size, f"tensegrity play {env_id}")
        try:
            drive(Player(env, make_controller(_FOLLOWER, env_id, given)), viewer, PygameHands(), seed, speed)
        finally:
            viewer.close()
            env.close()


def drive(player: Player, viewer: Viewer, hands: Hands, seed: int, speed: float) -> None:
    """Step with keys and mouse until the window is closed or Escape is pressed; R begins another episode."""
    env, size = player.env.unwrapped, player.env.action_space.shape[0]
    core = env.core
    with_mouse = core.goal_name == "tip" and core.observation_space["desired_goal"].shape == (2,)
    player.begin(seed)
    pairs = ", ".join(f"{less}/{more}" for less, more in KEYS[:size])
    mouse = "left mouse button: the tip follows, right: the target does; " if with_mouse else ""
    say(f"{pairs}: the {size} components of the action; {mouse}R: another episode; Escape: the end")
    while viewer.show(env.scene(), _FPS) and not hands.pressed("escape"):
        if hands.pressed("r"):
            player.begin()
            continue
        action, pointer = action_of(hands.pressed, size, speed), hands.pointer()
        if with_mouse and (pointer.left or pointer.right):
            place = place_of(env.scene(), env.render_size, pointer.place)
            if pointer.right:
                move_target(player, place)
            else:
                action = player.action(desired_goal=place.astype(np.float32))
        player.step(action)
        if player.ended:
            error = core.error_text(float(player.info[core.error_name]))
            say(f"{termination_reason(player.info['failure'])}: {error} off")
            player.begin()


def move_target(player: Player, place: np.ndarray) -> bool:
    """Put the target there, if the arm can go there; whether it can.

    The episode begins anew with the arm as it stands.
    """
    try:
        player.begin(options={"target": place, "configuration": player.info["configuration"]})
    except ValueError:  # says what cannot be reached
        return False
    return True
