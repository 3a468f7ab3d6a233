"""When the rectangle snaps to its mirror image under a force on F."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tensegrity_envs.mechanics.planar_four_bar.statics import FourBarStatics
from tensegrity_envs.mechanics.roots import bracketed_roots

_SAMPLES = 4001
_ALIGNED = 1e-12


def critical_load(mechanism: FourBarStatics, lengths: Sequence[float], side: int, direction: Sequence[float]) -> float:
    """The dead force on F in a direction at which the rectangle loses its stability [N].

    With E balanced (see `equilibria.py`), the force that holds F at gamma is g(gamma) / (t . n), g the slope of the
    springs' energy, n the direction of the force and t across bar CF. From the unloaded state the force rises until it
    has a maximum there: the load at which the state ends; or without bound as bar CF turns into the direction.

    Args:
        mechanism: of one design.
        lengths: (rho1, rho2) [m].
        side: 1 or -1.
        direction: of the force, of any length.

    Returns:
        The force; infinite where a pull along the bar is approached without a snap.

    Raises:
        ValueError: there is no rectangle under these lengths, or the direction is zero.
    """
    size = math.hypot(*direction)
    if not (math.isfinite(size) and size > 0):
        raise ValueError(f"direction = {direction!r}: must be two finite numbers, not both zero")
    _, start = mechanism.forward_kinematics(lengths, side).configuration
    (cx, cy), (dx, dy) = mechanism.supports(lengths)
    toward = math.atan2(dy - cy, dx - cx)
    ratio = math.sqrt(mechanism.flatness(lengths)[0])
    heading = math.atan2(direction[1], direction[0])

    def moment(gamma: np.ndarray) -> np.ndarray:
        """Slope of the springs' energy by K L^2."""
        psi = gamma - toward
        d = np.sqrt(np.maximum(0.25 + ratio * ratio - ratio * np.cos(psi), 0.0))
        return np.asarray(ratio * np.sin(psi) * (2 - 1 / d))

    def rise(gamma: np.ndarray) -> np.ndarray:
        """Its derivative."""
        psi = gamma - toward
        square = 0.25 + ratio * ratio - ratio * np.cos(psi)
        d = np.sqrt(np.maximum(square, 0.0))
        sine = ratio * np.sin(psi)
        return np.asarray(ratio * np.cos(psi) * (2 - 1 / d) + sine * sine / (2 * d * square))

    def growth(gamma: np.ndarray) -> np.ndarray:
        """The sign of the reduced stiffness where the force holds F at gamma: rise t.n - moment dt/dgamma.n."""
        angle = heading - gamma
        return np.asarray(rise(gamma) * np.sin(angle) + moment(gamma) * np.cos(angle))

    turn = math.remainder(heading - start, 2 * math.pi)  # until bar CF points along the force
    scale = float(mechanism.stiffness * mechanism.length)
    if abs(turn) < _ALIGNED:
        return math.inf
    if math.pi - abs(turn) < _ALIGNED:  # pushed along the bar: F stays, until the geometric stiffness has used it up
        return float(rise(np.array([start]))[0]) * scale
    gamma = start + turn * np.linspace(0.0, 1.0, _SAMPLES)[:-1]
    with np.errstate(all="ignore"):
        falling = np.flatnonzero(growth(gamma) * math.copysign(1.0, turn) <= 0)
    if not len(falling):
        return math.inf
    k = int(falling[0])
    peak = bracketed_roots(growth, gamma[k - 1 : k], gamma[k : k + 1])
    return float((moment(peak) / np.sin(heading - peak))[0]) * scale
