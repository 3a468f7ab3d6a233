"""Watch a controller or a policy, in a window or on film."""

from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import numpy as np
import typer

from tensegrity_agents import env_options
from tensegrity_agents.command_options import EnvironmentOptions, with_option_groups
from tensegrity_agents.config import ConfigError, known_env
from tensegrity_agents.console import checked_file, clear_errors, list_of_baselines, say
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.evaluation.rollout import announce
from tensegrity_agents.pretrained import load_pretrained, pretrained_ids
from tensegrity_envs import termination_reason
from tensegrity_envs.rendering import DisplayError

_FILMS = (".gif", ".mp4")


def chosen(env_id: str, controller: str | None, policy: Path | None, options: dict[str, Any]) -> tuple[str, Any]:
    """Name and controller: what was asked for, else the shipped policy, else the strongest baseline.

    Raises:
        ConfigError: both a controller and a policy were asked for.
    """
    if controller and policy:
        raise ConfigError("--controller and --policy: give one of them")
    if controller:
        return controller, make_controller(controller, env_id, options)
    if policy:
        from tensegrity_agents.sb3.policy_file import load_policy

        return policy.name, load_policy(policy, env_id, env_options.canonical(env_id, options))
    if env_id in pretrained_ids():
        return "shipped policy", load_pretrained(env_id)
    return "oracle", make_controller("oracle", env_id, options)


@with_option_groups
def main(
    options: EnvironmentOptions,
    env: Annotated[str, typer.Argument(help="environment, such as TwoXReach-v0")] = "TwoXReach-v0",
    controller: Annotated[
        str | None,
        typer.Option(
            help=f"baseline, or your own class as my_module:MyController. Baselines are: {list_of_baselines()}",
            show_default="the shipped policy, or else the oracle",
        ),
    ] = None,
    policy: Annotated[Path | None, typer.Option(help="folder of a trained policy")] = None,
    record: Annotated[Path | None, typer.Option(help="write a film (.gif or .mp4) instead of opening a window")] = None,
    episodes: Annotated[int, typer.Option(min=1, help="how many episodes")] = 3,
    seed: Annotated[int, typer.Option(min=0, help="of the first episode")] = 0,
) -> None:
    """Watch a controller or a policy, in a window or, with --record, on film.

    Example: tensegrity watch TwoXReach-v0 --record film.gif
    """
    with clear_errors():
        env_id = known_env(env)
        if record is not None:
            if record.suffix not in _FILMS:
                raise ConfigError(f"--record {record}: the file's name must end in {' or '.join(_FILMS)}")
            checked_file(record, "--record")
        given = options.checked(env_id)
        name, player = chosen(env_id, controller, policy, given)
        say(f"{env_id}: {name}, {episodes} episode(s)")
        try:
            frames = show(env_id, player, given, episodes, seed, record is None)
        except DisplayError as error:
            raise DisplayError(f"{error}; --record film.gif writes a film instead") from error
        if record is not None:
            write_film(frames, record)
            say(f"film: {record}")


def show(env_id: str, player: Any, options: dict[str, Any], episodes: int, seed: int, window: bool) -> list[np.ndarray]:
    """Let a controller run episodes, in a window or into a list of pictures, which is empty with a window."""
    env = gym.make(env_id, render_mode="human" if window else "rgb_array", **options)
    base: Any = env.unwrapped
    frames: list[np.ndarray] = []
    fps = float(base.metadata["render_fps"])
    for episode in range(episodes):
        observation, info = env.reset(seed=seed + episode)
        announce(player, base.design, base.episodes)
        state, start, ended = None, np.ones(1, bool), False
        while not ended:
            batch = {key: value[None] for key, value in observation.items()}
            action, state = player.predict(batch, state=state, episode_start=start, deterministic=True)
            observation, _, terminated, truncated, info = env.step(np.asarray(action)[0])
            start, ended = np.zeros(1, bool), bool(terminated or truncated)
            if not window:
                frames.append(np.asarray(env.render()))
        how = "on target" if info["is_success"] else termination_reason(info["failure"]) or "target missed"
        say(f"  seed {seed + episode}: {how}, {base.core.error_text(float(info[base.core.error_name]))} off")
        if frames:
            frames += [frames[-1]] * round(0.8 * fps)
    env.close()
    return frames


def write_film(frames: list[np.ndarray], path: Path, fps: int = 20) -> None:
    """Write pictures (height, width, 3) as GIF or MP4.

    Raises:
        ConfigError: MP4 is wanted, and imageio-ffmpeg is not installed.
    """
    if path.suffix == ".gif":
        from PIL import Image

        films = [Image.fromarray(frame).quantize(96) for frame in frames]
        films[0].save(path, save_all=True, append_images=films[1:], duration=round(1000 / fps), loop=0)
        return
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise ConfigError(
            f"--record {path}: MP4 needs  pip install 'tensegrity-envs[film]'; a name that ends in .gif needs nothing"
        ) from error
    height, width, _ = frames[0].shape
    film = imageio_ffmpeg.write_frames(str(path), (width, height), fps=fps, macro_block_size=2)
    film.send(None)
    for frame in frames:
        film.send(np.ascontiguousarray(frame))
    film.close()
