"""Controllers side by side on one episode, as an animated GIF and as a strip of four moments."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
from PIL import Image, ImageDraw, ImageFont

from tensegrity_agents.controllers.base import Controller
from tensegrity_agents.evaluation.player import Player
from tensegrity_agents.reporting.film import write_film
from tensegrity_envs.rendering import draw

_PANEL = 300  # width and height of one controller's picture [pixels]
_HEADER = 26  # height of the names above [pixels]
_COLUMNS = 4  # panels in a row; more controllers go below
_GAP = 2
_MOST_BYTES = 3_000_000
_LINE = (216, 222, 230)
_PAPER, _INK, _FAINT, _GOOD, _BAD = (252, 253, 254), (30, 36, 44), (112, 121, 134), (0, 120, 86), (196, 60, 12)


def record(
    env_id: str,
    controllers: Mapping[str, Any],
    seed: int,
    path: Path,
    env_options: dict[str, Any] | None = None,
    max_steps: int = 100,
    fps: int = 20,
) -> Path:
    """Let every controller run the same episode, and write the pictures side by side.

    The film ends when all of them are on the target or have failed at once, or after `max_steps`. The GIF is kept below
    3 MB, by leaving out pictures if need be. A strip is written beside it as `path.with_suffix(".png")`: a row for
    every controller, and four moments, which are the start, two until the last controller arrives, and the end.

    Args:
        env_id: Gymnasium id.
        controllers: by name, see `tensegrity_agents.controllers.base.Controller`.
        seed: of the episode.
        path: of the GIF.
        env_options: further arguments of the environment.
        max_steps: the most steps to show.
        fps: pictures per second.

    Returns:
        The path of the GIF.

    Raises:
        ValueError: there are no controllers, or `path` does not end in .gif.
    """
    if not controllers or path.suffix != ".gif":
        raise ValueError(f"{len(controllers)} controllers to {path}: there must be one at least, and the file a .gif")
    players = [_Filmed(env_id, name, controller, seed, env_options or {}) for name, controller in controllers.items()]
    try:
        for _ in range(max_steps):
            for player in players:
                player.step()
            if all(player.is_settled for player in players):
                break
    finally:
        for player in players:
            player.close()
    films = [player.film for player in players]
    columns = math.ceil(len(films) / math.ceil(len(films) / _COLUMNS))
    frames = [_grid([film[k] for film in films], columns) for k in range(len(films[0]))]
    write_film(frames, path, fps, most_bytes=_MOST_BYTES)
    moments = _moments(players)
    strip = _grid([film[k] for film in films for k in moments], len(moments))
    strip.save(path.with_suffix(".png"), optimize=True)
    return path


class _Filmed:
    """One controller in an environment of its own, and the pictures of it."""

    def __init__(self, env_id: str, name: str, controller: Controller, seed: int, options: dict[str, Any]) -> None:
        self.name = name
        self._player = Player(gym.make(env_id, render_mode="rgb_array", render_size=_PANEL, **options), controller)
        self._player.begin(seed)
        # Holding goes on after success, until it ends.
        self._goes_on = self._player.env.unwrapped.core.task.has_score
        self._success, self._miss = ("held", "not held") if self._goes_on else ("on target", "not reached")
        self.film: list[Image.Image] = []  # the panel at every step
        self.settled_since = 0
        self._render()

    @property
    def on_target(self) -> bool:
        return bool(self._player.info["is_success"])

    @property
    def is_settled(self) -> bool:
        return self._player.ended or (self.on_target and not self._goes_on)

    def step(self) -> None:
        """One step; once the episode has ended, the last picture stays."""
        if self._player.ended:
            self.film.append(self.film[-1])
            return
        self._player.step()
        self._render()
        if not self.is_settled:
            self.settled_since = len(self.film)

    def _render(self) -> None:
        # A drawing of dynamic environments, too: without a GPU MuJoCo's own pictures take a third of a second each.
        picture = Image.fromarray(draw(self._player.env.unwrapped.scene(), (_PANEL, _PANEL)))
        status, colour = "", _FAINT
        if self._player.ended or self.on_target:
            missed = "failed" if self._player.failed else self._miss
            status, colour = (self._success, _GOOD) if self.on_target else (missed, _BAD)
        self.film.append(_panel(self.name, status, colour, picture))

    def close(self) -> None:
        self._player.env.close()


def _panel(name: str, status: str, colour: tuple[int, int, int], picture: Image.Image) -> Image.Image:
    """A picture under a name (shortened if it must be) and a status."""
    panel = Image.new("RGB", (_PANEL, _HEADER + _PANEL), _PAPER)
    panel.paste(picture, (0, _HEADER))
    pen = ImageDraw.Draw(panel)
    small, large = ImageFont.load_default(12), ImageFont.load_default(14)
    room = _PANEL - 24 - pen.textlength(status, small)
    while len(name) > 1 and pen.textlength(name, large) > room:
        name = name.removesuffix("…")[:-1] + "…"
    pen.text((8, _HEADER / 2), name, _INK, large, anchor="lm")
    pen.text((_PANEL - 8, _HEADER / 2), status, colour, small, anchor="rm")
    return panel


def _grid(panels: list[Image.Image], columns: int) -> Image.Image:
    """Panels row by row, with lines between them."""
    rows = math.ceil(len(panels) / columns)
    step_x, step_y = _PANEL + _GAP, _HEADER + _PANEL + _GAP
    grid = Image.new("RGB", (columns * step_x - _GAP, rows * step_y - _GAP), _LINE)
    blank = Image.new("RGB", (_PANEL, _HEADER + _PANEL), _PAPER)
    for i, panel in enumerate([*panels, *[blank] * (rows * columns - len(panels))]):
        grid.paste(panel, (i % columns * step_x, i // columns * step_y))
    return grid


def _moments(players: list[_Filmed]) -> list[int]:
    """Four steps worth seeing: the start, two until the last controller arrives, and the end."""
    last = len(players[0].film) - 1
    arrivals = [player.settled_since for player in players if player.on_target]
    arrival = max(arrivals, default=last)
    return [0, round(arrival / 3), round(2 * arrival / 3), last]
