"""Watch a controller or a policy, in a window or on film."""

from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import typer
from PIL import Image

from tensegrity_agents import env_options
from tensegrity_agents.command_options import EnvironmentChoice, EnvironmentOptions, with_option_groups
from tensegrity_agents.config import ConfigError
from tensegrity_agents.console import checked_file, clear_errors, need_window, progress_bar, say
from tensegrity_agents.controllers import baselines_of, make_controller
from tensegrity_agents.controllers.base import Controller
from tensegrity_agents.evaluation.player import Player
from tensegrity_agents.pretrained import AGENT, load_pretrained, pretrained_ids
from tensegrity_agents.reporting.film import SUFFIXES, write_film
from tensegrity_envs import termination_reason
from tensegrity_envs.env import unwrapped
from tensegrity_envs.rendering import draw

_REST = 0.8  # how long a film shows the end of an episode [s]


def chosen_player(env_id: str, controller: str | None, policy: Path | None, options: dict[str, Any]) -> tuple[str, Any]:
    """Name and controller: what was asked for, else the shipped policy, else the oracle or the strongest baseline.

    Raises:
        ConfigError: both a controller and a policy were asked for.
    """
    if controller and policy:
        raise ConfigError("--controller and --policy: give one of them")
    if policy:
        from tensegrity_agents.sb3.policy_file import load_policy

        return policy.name, load_policy(policy, env_id, env_options.canonical(env_id, options))
    if controller in (None, AGENT) and env_id in pretrained_ids():
        try:
            return "shipped policy", load_pretrained(env_id, env_options.canonical(env_id, options))
        except ValueError as error:
            if controller == AGENT:
                raise
            say(f"the shipped policy does not fit: {error}")
    if controller is None:
        return strongest(env_id, options)
    return controller, make_controller(controller, env_id, options)


def strongest(env_id: str, options: dict[str, Any]) -> tuple[str, Any]:
    """The oracle of an environment, or else the strongest baseline that takes these options."""
    known = baselines_of(env_id, options)
    by_strength = ["random", *(name for name in known if name not in ("random", "oracle"))]
    if "oracle" in known:
        by_strength.append("oracle")
    while True:
        name = by_strength.pop()
        try:
            return name, make_controller(name, env_id, options)
        except ValueError as error:
            if not by_strength:
                raise
            say(f"{name} does not fit: {error}")


@with_option_groups
def main(
    chosen: EnvironmentChoice,
    options: EnvironmentOptions,
    controller: Annotated[
        str | None,
        typer.Option(
            help="baseline (see tensegrity list ID), or your own class as my_module:MyController",
            show_default="the shipped policy, or else the oracle or the strongest baseline",
        ),
    ] = None,
    policy: Annotated[Path | None, typer.Option(help="folder of a trained policy")] = None,
    record: Annotated[Path | None, typer.Option(help="write a film (.gif or .mp4) instead of opening a window")] = None,
    episodes: Annotated[int, typer.Option(min=1, help="how many episodes")] = 3,
    seed: Annotated[int, typer.Option(min=0, help="of the first episode")] = 0,
) -> None:
    """Watch a controller or a policy, in a window or, with --record, on film.

    ENVIRONMENT is TwoXReach-v0 if it is left out. Dynamic environments have MuJoCo's viewer as their window; films show
    a drawing, which needs no graphics library.

    Example: tensegrity watch TwoXReach-v0 --record film.gif
    """
    with clear_errors():
        env_id = chosen.named("TwoXReach-v0")
        if record is not None:
            if record.suffix not in SUFFIXES:
                raise ConfigError(f"--record {record}: the file's name must end in {' or '.join(SUFFIXES)}")
            checked_file(record, "--record")
        given = options.checked(env_id)
        if record is None:
            need_window_of(env_id, given)
        name, player = chosen_player(env_id, controller, policy, given)
        say(f"{env_id}: {name}, {episodes} episode(s)")
        frames = show(env_id, player, given, episodes, seed, record is None)
        if record is not None:
            with progress_bar() as progress:
                write_film(frames, record, progress=lambda done, total: progress("film", done, total, ""))
            say(f"film: {record}")


def need_window_of(env_id: str, options: dict[str, Any]) -> None:
    """See that a window can be opened, before anything is loaded or compiled.

    Raises:
        DisplayError: there is no display; the message names --record.
    """
    env: Any = gym.make(env_id, **options)
    try:
        need_window(env.unwrapped.need_display, "--record film.gif writes a film instead")
    finally:
        env.close()


def show(
    env_id: str, controller: Controller, options: dict[str, Any], episodes: int, seed: int, window: bool, fps: int = 20
) -> list[Image.Image]:
    """Let a controller run episodes, in a window or into a list of pictures, which is empty with a window."""
    env = gym.make(env_id, render_mode="human" if window else "rgb_array", **options)
    base = unwrapped(env)
    player, frames = Player(env, controller), []

    def keep() -> None:
        if not window:
            frames.append(Image.fromarray(draw(base.scene(), base.render_size)))

    for episode in range(episodes):
        player.begin(seed + episode)
        keep()
        while not player.ended:
            player.step()
            keep()
        info = player.info
        how = "on target" if info["is_success"] else termination_reason(info["failure"]) or "target missed"
        say(f"  seed {seed + episode}: {how}, {base.core.error_text(float(info[base.core.error_name]))} off")
        frames += frames[-1:] * round(_REST * fps)
    env.close()
    return frames
