"""Where MuJoCo can draw. Nothing here imports it: it chooses its GL library when it is imported."""

import ctypes
import os
import sys

from tensegrity_envs.rendering.window import DisplayError

GL_HELP = (
    "install a GL library that draws without a display (Debian: apt install libegl1 libopengl0 libgl1-mesa-dri, or "
    "libosmesa6), and if mujoco is imported before tensegrity_envs makes an environment, set MUJOCO_GL=egl (or osmesa)"
)


def has_display() -> bool:
    """Whether windows can be opened."""
    return not sys.platform.startswith("linux") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def choose_gl() -> None:
    """Set MUJOCO_GL, where it is not set and there is no display, to a library that is there."""
    if "MUJOCO_GL" in os.environ or "mujoco" in sys.modules or has_display():
        return
    for name, libraries in (("egl", ("libEGL.so.1", "libOpenGL.so.0")), ("osmesa", ("libOSMesa.so.8",))):
        try:
            for library in libraries:
                ctypes.CDLL(library)
        except OSError:
            continue
        os.environ["MUJOCO_GL"] = name
        return


def require_gl() -> None:
    """Raise unless MuJoCo has a GL library: it would try to open a window.

    Raises:
        RuntimeError: there is none; the message names one.
    """
    if not has_display() and os.environ.get("MUJOCO_GL", "glfw").lower() == "glfw":
        raise RuntimeError(f"MuJoCo cannot draw, there is no display: {GL_HELP}")


def require_display() -> None:
    """Raise unless a window can be opened: without a display MuJoCo's viewer would end the whole process.

    Raises:
        DisplayError: there is no display.
    """
    if not has_display():
        raise DisplayError(
            "no display to open MuJoCo's viewer on: neither DISPLAY nor WAYLAND_DISPLAY is set; use "
            "render_mode='rgb_array' (Gymnasium's check_env: skip_render_check=True), or a virtual display (Debian: "
            "apt install xvfb, then xvfb-run -a python ...)"
        )
