"""Tests run on a bare machine: windows go to SDL's dummy driver."""

import os

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
