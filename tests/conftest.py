"""Tests run on a bare machine: windows go to SDL's dummy driver, MuJoCo draws without a display where it can."""

import os

from tensegrity_envs.simulation.mujoco.displays import choose_gl

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
choose_gl()
