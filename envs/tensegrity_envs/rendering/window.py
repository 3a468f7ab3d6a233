"""A window that shows scenes."""

import os
import sys

from tensegrity_envs.rendering.picture import paint
from tensegrity_envs.rendering.scene import Scene


class DisplayError(RuntimeError):
    """There is no display to open a window on."""


_ADVICE = (
    'set DISPLAY to a running display server, or use render_mode="rgb_array", which needs none '
    "(Gymnasium's check_env: skip_render_check=True)"
)


def need_display() -> None:
    """See that there seems to be a display, without opening a window.

    Raises:
        DisplayError: there is none.
    """
    drivers = ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")
    if sys.platform.startswith("linux") and not any(os.environ.get(name) for name in drivers):
        raise DisplayError(f"no display to open a window on: {_ADVICE}")


class Viewer:
    """A window that shows scenes."""

    def __init__(self, size: tuple[int, int] = (600, 600), title: str = "tensegrity") -> None:
        """Open the window.

        Raises:
            DisplayError: there is no display.
        """
        need_display()
        import pygame

        try:
            pygame.display.init()
            # SDL falls back to invisible windows where it cannot reach the display server; some tests ask for them.
            if pygame.display.get_driver() in {"offscreen", "dummy"} and not os.environ.get("SDL_VIDEODRIVER"):
                pygame.display.quit()
                raise DisplayError(f"the display server does not answer: {_ADVICE}")
            self._window: pygame.Window | None = pygame.Window(title, size)
        except pygame.error as error:
            raise DisplayError(f"cannot open a window ({error}): {_ADVICE}") from error
        self._size, self._clock = size, pygame.time.Clock()

    @property
    def is_open(self) -> bool:
        """Whether the window is there; the user may have closed it."""
        return self._window is not None

    def show(self, scene: Scene, fps: float = 30.0) -> bool:
        """Show a scene, waiting as long as it takes not to exceed `fps` pictures per second.

        Returns:
            Whether the window is open. Once the user has closed it, or other code pygame, scenes are ignored.
        """
        import pygame

        if self._window is None:
            return False
        picture = paint(scene, self._size)
        try:
            for event in pygame.event.get(pygame.WINDOWCLOSE):
                if event.window == self._window:
                    self.close()
                    return False
                pygame.event.post(event)  # another viewer's
            self._window.get_surface().blit(picture, (0, 0))
            self._window.flip()
        except pygame.error:  # "Invalid window", "video system not initialized": no longer ours to show
            self._window = None
            return False
        self._clock.tick(fps)
        return True

    def close(self) -> None:
        """Close the window; once is enough, twice does no harm."""
        if self._window is not None:
            self._window.destroy()
            self._window = None
