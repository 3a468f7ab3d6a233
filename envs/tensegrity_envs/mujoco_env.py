"""The single environment of a dynamic simulation: as any other, with MuJoCo's pictures."""

from typing import TYPE_CHECKING, Any

import gymnasium as gym

from tensegrity_envs.core import Core
from tensegrity_envs.env import ManipulatorEnv
from tensegrity_envs.simulation.mujoco.displays import require_display

if TYPE_CHECKING:
    from tensegrity_envs.simulation.mujoco.pictures import Pictures


class MujocoManipulatorEnv(ManipulatorEnv):
    """See `ManipulatorEnv`; pictures are MuJoCo's own, with cables and springs coloured by tension.

    Args:
        arm: the name of the environment's core in `environments.ARMS`, or a `Core` class of your own.
        render_mode: None, "rgb_array", "depth_array" (distances from the camera [m], float32) or "human" (MuJoCo's
            viewer).
        render_size: side of the picture, or (width, height) [pixels].
        **options: of the core; among them backend="mujoco".

    Raises:
        ImportError: MuJoCo is not installed.
    """

    metadata = {"render_modes": ["rgb_array", "depth_array", "human"], "render_fps": 50}  # noqa: RUF012

    def __init__(
        self,
        arm: str | type[Core],
        render_mode: str | None = None,
        render_size: int | tuple[int, int] = 600,
        **options: Any,
    ) -> None:
        super().__init__(arm, render_mode, render_size, **options)
        if self.core.engine is None:
            raise ValueError("backend = 'quasi_static': MujocoManipulatorEnv needs 'mujoco'")
        self._pictures: Pictures | None = None

    def need_display(self) -> None:
        """See `ManipulatorEnv.need_display`; the window is MuJoCo's."""
        require_display()

    def render(self) -> Any:
        """The picture (rgb_array: shape (height, width, 3), uint8; depth_array: shape (height, width), float32),
        or the viewer brought up to date (human).

        Raises:
            RuntimeError: there is no GL library or no display; the message names what to install.
        """
        if self.render_mode is None:
            gym.logger.warn("render() without a render_mode: pass render_mode='rgb_array' or another to gym.make")
            return None
        if self._pictures is None:
            from tensegrity_envs.simulation.mujoco.pictures import Pictures

            assert self.core.engine is not None
            self._pictures = Pictures(self.core.engine.model)
        rows = self.core.outcomes.rows.state
        physics, scene = self._outcome[list(rows.physics), 0], self.core.spatial_picture(*self._shown())
        if self.render_mode == "human":
            return self._pictures.show(physics, scene)
        draw = self._pictures.rgb if self.render_mode == "rgb_array" else self._pictures.depth
        return draw(physics, scene, self.render_size)

    def close(self) -> None:
        """Close the window and free the GL contexts."""
        if self._pictures is not None:
            self._pictures.close()
            self._pictures = None
        super().close()
