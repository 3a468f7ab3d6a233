"""Pictures of the dynamic simulations by MuJoCo itself: offscreen, or in its viewer."""

import math
import threading
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from tensegrity_envs.rendering import Scene, tension_colour
from tensegrity_envs.simulation.mujoco.displays import GL_HELP, require_display, require_gl
from tensegrity_envs.simulation.mujoco.model import MujocoModel

_CURVE = (0.85, 0.24, 0.05, 0.6)
_TARGET, _TRACE, _LOAD = (0.85, 0.24, 0.05, 0.35), (0.10, 0.44, 0.76, 0.5), (0.84, 0.16, 0.16, 1.0)
_TRACE_LENGTH = 60  # positions


class Pictures:
    """Draws the state of a simulation: cables and springs coloured by tension, target, load and the tip's trace.

    Args:
        model: of the mechanism.
    """

    def __init__(self, model: MujocoModel) -> None:
        self.__setstate__(model)

    def __setstate__(self, model: MujocoModel) -> None:
        """Begin anew."""
        self._owner = model
        self._model = model.spec.compile()
        self._data = mujoco.MjData(self._model)
        self._renderers: dict[tuple[tuple[int, int], bool], Any] = {}
        self._viewer: Any = None
        self._threads: set[threading.Thread] = set()

    def __getstate__(self) -> MujocoModel:
        """The mechanism alone: windows and GL contexts belong to their process, and open anew when they are needed."""
        return self._owner

    def rgb(self, physics: np.ndarray, scene: Scene, size: tuple[int, int]) -> np.ndarray:
        """The picture of this width and height, shape (height, width, 3), uint8.

        Raises:
            RuntimeError: there is no GL library; the message names one.
        """
        self._pose(physics, scene)
        renderer = self._renderer(size, depth=False)
        renderer.update_scene(self._data, camera="front")
        self._decorate(renderer.scene, scene)
        return np.asarray(renderer.render())

    def depth(self, physics: np.ndarray, scene: Scene, size: tuple[int, int]) -> np.ndarray:
        """Distances from the camera [m], shape (height, width), float32.

        Raises:
            RuntimeError: there is no GL library; the message names one.
        """
        self._pose(physics, scene)
        renderer = self._renderer(size, depth=True)
        renderer.update_scene(self._data, camera="front")
        return np.asarray(renderer.render())

    def show(self, physics: np.ndarray, scene: Scene) -> None:
        """Bring MuJoCo's viewer up to date; opens it.

        Raises:
            RuntimeError: there is no display.
        """
        if self._viewer is None:
            require_display()
            import mujoco.viewer

            before = set(threading.enumerate())
            self._viewer = mujoco.viewer.launch_passive(
                self._model, self._data, show_left_ui=False, show_right_ui=False
            )
            self._threads = set(threading.enumerate()) - before
            with self._viewer.lock():
                self._viewer.cam.type = mujoco.mjtCamera.mjCAMERA_FIXED
                self._viewer.cam.fixedcamid = self._model.camera("front").id
        if not self._viewer.is_running():
            return
        with self._viewer.lock():
            self._pose(physics, scene)
            self._viewer.user_scn.ngeom = 0
            self._decorate(self._viewer.user_scn, scene)
        self._viewer.sync()

    def close(self) -> None:
        """Free the GL contexts, close the window."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()
        if self._viewer is not None:
            self._viewer.close()
            for thread in self._threads:  # one that still draws when Python ends would crash it
                thread.join(timeout=10)
            self._viewer = None

    def _renderer(self, size: tuple[int, int], depth: bool) -> Any:
        key = (size, depth)
        if key not in self._renderers:
            require_gl()
            vision = self._model.vis.global_
            width, height = size
            vision.offwidth, vision.offheight = max(vision.offwidth, width), max(vision.offheight, height)
            try:
                renderer = mujoco.Renderer(self._model, height, width)
            except Exception as error:  # of the GL library, which differ by kind
                raise RuntimeError(f"MuJoCo cannot draw ({error}): {GL_HELP}") from error
            if depth:
                renderer.enable_depth_rendering()
            self._renderers[key] = renderer
        return self._renderers[key]

    def _pose(self, physics: np.ndarray, scene: Scene) -> None:
        model, data = self._model, self._data
        if len(scene.tip) == 2:  # the frame of the drawings; the camera of the model's file shows all that is possible
            camera = model.camera("front")
            away = scene.reach / math.tan(math.radians(camera.fovy[0]) / 2)
            camera.pos[:] = scene.centre[0], -away, scene.centre[1]
        data.qpos[:] = self._owner.joint_angles(physics)
        mujoco.mj_forward(model, data)
        for member in scene.members:
            tension = scene.tensions.get(member.name)
            tendon = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, member.name)
            if tension is not None and tendon >= 0:  # edges of a platform are none
                red, green, blue = tension_colour(tension, scene.tension_bounds)
                model.tendon_rgba[tendon] = red / 255, green / 255, blue / 255, 1.0

    def _decorate(self, drawn: mujoco.MjvScene, scene: Scene) -> None:
        """Add target, its way, trace and load to a scene of MuJoCo's."""
        for point in scene.curve:
            _add_sphere(drawn, point, 0.004 * scene.reach, _CURVE)
        if scene.target is not None:
            _add_sphere(drawn, scene.target, max(scene.tolerance, 0.02 * scene.reach), _TARGET)
        for point in scene.trace[-_TRACE_LENGTH:]:
            _add_sphere(drawn, point, 0.006 * scene.reach, _TRACE)
        force = np.linalg.norm(scene.load)
        if force > 1e-3 * scene.load_scale:
            way = np.array(scene.load) / scene.load_scale * scene.reach / 4
            if drawn.ngeom < drawn.maxgeom:
                geom = drawn.geoms[drawn.ngeom]
                mujoco.mjv_initGeom(
                    geom,
                    mujoco.mjtGeom.mjGEOM_ARROW,
                    np.zeros(3),
                    np.zeros(3),
                    np.zeros(9),
                    np.array(_LOAD, np.float32),
                )
                start = np.array(scene.tip)
                mujoco.mjv_connector(
                    geom, mujoco.mjtGeom.mjGEOM_ARROW, 0.02 * scene.reach, _in_space(start), _in_space(start + way)
                )
                drawn.ngeom += 1


def _in_space(point: Sequence[float] | np.ndarray) -> np.ndarray:
    """A point of the mechanism's plane, or of space."""
    x, *rest = (float(component) for component in point)
    return np.array([x, *rest] if len(rest) == 2 else [x, 0.0, *rest])


def _add_sphere(
    drawn: mujoco.MjvScene, point: Sequence[float] | np.ndarray, radius: float, rgba: tuple[float, ...]
) -> None:
    if drawn.ngeom >= drawn.maxgeom:
        return
    mujoco.mjv_initGeom(
        drawn.geoms[drawn.ngeom],
        mujoco.mjtGeom.mjGEOM_SPHERE,
        np.full(3, radius),
        _in_space(point),
        np.eye(3).ravel(),
        np.array(rgba, np.float32),
    )
    drawn.ngeom += 1
