"""All equilibria of the planar 4-bar mechanism under given actuator lengths, with a force on F or without.

The springs CE and EF act on E as one spring of stiffness 2 K to the midpoint M of bar CF. So in equilibrium bar DE
points at M (fold = 1) or away from it (fold = -1), and one angle is left. With e = (cos gamma, sin gamma), psi the
angle from the direction C -> D to e, R = |CD| / L, d = |DM| / L (d^2 = 1/4 + R^2 - R cos psi) and f in units of K L:

    energy / (K L^2) = const - 2 R cos psi - 2 fold d - f . e,
    slope = R sin psi (2 - fold / d) - f . de/dgamma.

Since the Hessian's entry of theta is 2 fold d, a state is stable exactly where fold = 1 and the slope rises.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics.planar_four_bar.statics import FourBarStatics
from tensegrity_envs.mechanics.roots import circle_roots

_SAMPLES = 720
_DISTINCT = 1e-7  # [rad]
RECTANGLE, INWARDS, OUTWARDS, PARALLEL, LOADED = "X", "IN", "OUT", "PAR", "loaded"


class FourBarEquilibrium(NamedTuple):
    """An equilibrium.

    Attributes:
        configuration: (theta, gamma) [rad], in (-pi, pi].
        tip: position (x, y) of F [m].
        type: "X" (rectangle with the bars CF, DE as its diagonals), "IN" and "OUT" (all on the line CD, both bars
            folded inwards or outwards), "PAR" (on that line, bars parallel); "loaded" under a force.
        side: of the line CD on which F is: 1, -1, or 0.
        energy: potential energy [J].
        is_stable: whether the stiffness matrix is positive definite.
        residual: norm of the energy gradient [N m].
    """

    configuration: tuple[float, float]
    tip: tuple[float, float]
    type: str
    side: int
    energy: float
    is_stable: bool
    residual: float


def equilibria(mechanism: FourBarStatics, lengths: Sequence[float], load: Sequence[float]) -> list[FourBarEquilibrium]:
    """All equilibria, sorted by energy: in closed form without a load, by a scan of gamma under one.

    Args:
        mechanism: of one design.
        lengths: (rho1, rho2) [m].
        load: force on F (fx, fy) [N].

    Raises:
        ValueError: lengths out of [0, 2 L], a load that is not finite, a batch of designs, or C and D coincide
            without a load.
    """
    if mechanism.design.is_batch:
        raise ValueError("equilibria takes one design, not a batch of them")
    mechanism.check_lengths(lengths)
    if len(load) != 2 or not np.isfinite(np.asarray(load, float)).all():
        raise ValueError(f"load = {load!r}: must be two finite numbers (fx, fy) [N]")
    lengths, load = tuple(map(float, lengths)), tuple(map(float, load))
    ratio = math.sqrt(mechanism.flatness(lengths)[0])
    if ratio < 1e-12 and not any(load):
        raise ValueError(
            f"lengths = {lengths!r}: C and D coincide (singular configuration vi): the equilibria form a continuum"
        )
    found = _loaded(mechanism, lengths, load, ratio) if any(load) else _unloaded(mechanism, lengths)
    return sorted(found, key=lambda state: (state.energy, state.configuration))


def describe(
    mechanism: FourBarStatics, q: tuple[float, float], lengths: tuple[float, ...], load: tuple[float, ...], kind: str
) -> FourBarEquilibrium:
    """The equilibrium at a configuration that is known to be one."""
    theta, gamma = (math.atan2(math.sin(angle), math.cos(angle)) for angle in q)
    gradient, hessian = mechanism.statics((theta, gamma), lengths, load)
    scale = mechanism.stiffness * mechanism.length**2
    stable = bool(np.linalg.eigvalsh(np.array(hessian))[0] > 1e-12 * scale)
    flat = kind in (INWARDS, OUTWARDS, PARALLEL)
    side = 0 if flat else mechanism.side_of((theta, gamma), lengths)
    x, y = mechanism.tip((theta, gamma), lengths)
    energy = mechanism.potential_energy((theta, gamma), lengths, load)
    return FourBarEquilibrium(
        (theta, gamma), (float(x), float(y)), kind, int(side), float(energy), stable, float(np.hypot(*gradient))
    )


def _unloaded(mechanism: FourBarStatics, lengths: tuple[float, ...]) -> list[FourBarEquilibrium]:
    """Six for 0 < R < 1 and four beyond, instead of the quartic of [Ji2014, Eq. 15], which loses those with
    theta + gamma = pi.
    """
    (cx, cy), (dx, dy) = mechanism.supports(lengths)
    along = math.atan2(cy - dy, cx - dx)  # of u, from D to C
    opposite = along + math.pi
    # gamma is the direction of F seen from C; theta that of E seen from D, mirrored
    states = [
        ((math.pi - along, opposite), INWARDS),
        ((math.pi - opposite, along), OUTWARDS),
        ((math.pi - along, along), PARALLEL),
        ((math.pi - opposite, opposite), PARALLEL),
    ]
    if mechanism.flatness(lengths)[1] > 0:
        states += [(mechanism.rectangle(lengths, side)[0], RECTANGLE) for side in (1, -1)]
    return [describe(mechanism, q, lengths, (0.0, 0.0), kind) for q, kind in states]


def _loaded(
    mechanism: FourBarStatics, lengths: tuple[float, ...], load: tuple[float, ...], ratio: float
) -> list[FourBarEquilibrium]:
    (cx, cy), (dx, dy) = mechanism.supports(lengths)
    toward = math.atan2(dy - cy, dx - cx)  # from C to D
    force = tuple(f / (mechanism.stiffness * mechanism.length) for f in load)

    def distance(gamma: np.ndarray) -> np.ndarray:
        return np.asarray(np.sqrt(np.maximum(0.25 + ratio * ratio - ratio * np.cos(gamma - toward), 0.0)))

    def slope(line: np.ndarray, gamma: np.ndarray) -> np.ndarray:
        """Times d, which keeps it bounded; the first line has fold = 1, the second -1."""
        fold, d = np.where(line == 0, 1.0, -1.0), distance(gamma)
        turning = force[1] * np.cos(gamma) - force[0] * np.sin(gamma)
        return np.asarray(ratio * np.sin(gamma - toward) * (2 * d - fold) - d * turning)

    found: list[FourBarEquilibrium] = []
    for k, gamma in zip(*(part.tolist() for part in circle_roots(slope, 2, _SAMPLES, _DISTINCT)), strict=True):
        if distance(np.array([gamma]))[0] < 1e-9:
            continue
        theta = pointing(mechanism, lengths, gamma, 1.0 if k == 0 else -1.0)
        found.append(describe(mechanism, (theta, gamma), lengths, load, LOADED))
    return found


def pointing(mechanism: FourBarStatics, lengths: Sequence[Component], gamma: Component, fold: float = 1.0) -> Component:
    """theta [rad] at which bar DE points at the midpoint of bar CF, or (fold = -1) away from it."""
    (cx, cy), (dx, dy) = mechanism.supports(lengths)
    xp = mechanism._xp(gamma, cx)
    mx = cx + mechanism.length / 2 * xp.cos(gamma) - dx
    my = cy + mechanism.length / 2 * xp.sin(gamma) - dy
    return xp.atan2(fold * my, -fold * mx)
