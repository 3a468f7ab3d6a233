"""The singular configurations of the planar 4-bar mechanism [Ji2014, section 4.2], and one that the paper leaves out.

Each is told by a dimensionless measure that is zero there and smooth or at least continuous around it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics.planar_four_bar.mechanism import PlanarFourBar

Lengths = Sequence[Component]
Measure = Callable[["PlanarFourBar", Lengths, Component], Component]


class Singularity(NamedTuple):
    """A singular configuration.

    Attributes:
        name: "i" to "vii" as in [Ji2014]; vii is three different sets, "vii: B, C, F aligned" and so on; "pitchfork" is
            not in the paper.
        condition: in words.
        measure: (mechanism, lengths, side) -> how far away it is [-]; zero there. Those that concern det J belong to
            the unloaded rectangle, and are not a number where there is none.
        mode: "rectangle", "flat", or "boundary" of the two: in which stable states it is met.
        behaviour: what happens there.
    """

    name: str
    condition: str
    measure: Measure
    mode: str
    behaviour: str

    def holds(self, mechanism: PlanarFourBar, lengths: Lengths, side: Component = 1, tolerance: float = 1e-6) -> bool:
        """Whether |measure| <= tolerance."""
        with np.errstate(all="ignore"):
            value = self.measure(mechanism, tuple(np.asarray(rho, float) for rho in lengths), side)
        return bool(np.all(np.abs(value) <= tolerance))


def _aligned(mechanism: PlanarFourBar, lengths: Lengths, side: Component) -> Component:
    """sin(beta + gamma)."""
    (cx, cy), _ = mechanism.supports(lengths)
    _, (x, y) = mechanism.rectangle(lengths, side)
    return ((cy - 0.0) * (x - cx) - (cx - mechanism.length) * (y - cy)) / mechanism.length**2


def _thales(mechanism: PlanarFourBar, lengths: Lengths, side: Component) -> Component:
    """Cross product of D and M, by L^2: zero where A, D and the midpoint M of CF are aligned."""
    (cx, cy), (dx, dy) = mechanism.supports(lengths)
    _, (x, y) = mechanism.rectangle(lengths, side)
    return (dx * (cy + y) - dy * (cx + x)) / (2 * mechanism.length**2)


def _half(k: int) -> Measure:
    return lambda m, lengths, side: lengths[k] / (2 * m.length)


def _full(k: int) -> Measure:
    return lambda m, lengths, side: 1 - lengths[k] / (2 * m.length)


def _both_full(m: PlanarFourBar, lengths: Lengths, side: Component) -> Component:
    return (1 - lengths[0] / (2 * m.length)) + (1 - lengths[1] / (2 * m.length))


def _coincident(m: PlanarFourBar, lengths: Lengths, side: Component) -> Component:
    return m._xp(*lengths).sqrt(m.flatness(lengths)[0])


def _phi2(m: PlanarFourBar, lengths: Lengths, side: Component) -> Component:
    square, rest = m.flatness(lengths)
    return 4 * square * rest


def _arc(m: PlanarFourBar, lengths: Lengths, side: Component) -> Component:
    return 1 - (lengths[0] ** 2 + lengths[1] ** 2) / (4 * m.length**2)


SINGULARITIES = (
    Singularity(
        "i",
        "rho1 = 0: C on A, F on D, E on A",
        _half(0),
        "boundary",
        "the stiffness along (1, 1) is zero and the energy quartic there: infinitesimal, not finite, movements of both "
        "E and F. F is on the circle of radius L about A. det J stays finite, dF/drho1 grows like rho1^(-1/2).",
    ),
    Singularity(
        "ii",
        "rho2 = 0: D on B, F on B, E on C",
        _half(1),
        "boundary",
        "as i: both E and F move infinitesimally (the paper: only E). F is at the single point B.",
    ),
    Singularity(
        "iii",
        "rho1 = 2 L: C on the base line",
        _full(0),
        "flat",
        "no rectangle there. The movement of C is infinitesimal; the thrust of AC grows like (2 L - rho1)^(-1/2).",
    ),
    Singularity(
        "iv",
        "rho2 = 2 L: D on the base line",
        _full(1),
        "flat",
        "no rectangle there. The movement of D is infinitesimal; the thrust of BD grows like (2 L - rho2)^(-1/2).",
    ),
    Singularity(
        "v",
        "rho1 = rho2 = 2 L: all nodes on the base line, F on B and E on A (the paper has them swapped)",
        _both_full,
        "flat",
        "folded flat for transport; R = 3. Actuator forces are indeterminate there; along rho1 = rho2 they tend to "
        "10 K L - 2 fx.",
    ),
    Singularity(
        "vi",
        "rho1 = rho2 = L: C on D, E on F",
        _coincident,
        "boundary",
        "the bars CF and DE turn together freely, without a change of energy: F anywhere on the circle about C.",
    ),
    Singularity(
        "vii: B, C, F aligned",
        "sin(beta + gamma) = 0: F on curve viii of the output workspace (gamma = pi - beta), or on B (gamma = -beta)",
        _aligned,
        "rectangle",
        "det J = 0: F cannot move along the line through B, C and F.",
    ),
    Singularity(
        "vii: A, D, M aligned",
        "Phi3 = 0, M the midpoint of CF",
        _thales,
        "rectangle",
        "det J = 0: rho2 does not move F. It bounds the output workspace at |AM| = 3 L / 2 and L / 2.",
    ),
    Singularity(
        "vii: Phi2 = 0",
        "R = 0 or R = 1",
        _phi2,
        "boundary",
        "that is i, ii, vi and the pitchfork: the state loses its stiffness.",
    ),
    Singularity(
        "pitchfork",
        "rho1^2 + rho2^2 = 4 L^2, that is alpha + beta = pi",
        _arc,
        "boundary",
        "the two rectangles merge into the flat state, which is stable beyond. det J grows like the distance to the "
        "power -1/2. Not named in the paper.",
    ),
)


def singular_configurations(
    mechanism: PlanarFourBar, lengths: Sequence[float], side: int = 1, tolerance: float = 1e-6
) -> list[Singularity]:
    """Those of `SINGULARITIES` that a state is at.

    Args:
        mechanism: of one design.
        lengths: (rho1, rho2) [m].
        side: of the rectangle, 1 or -1.
        tolerance: of the measures [-].

    Raises:
        ValueError: lengths out of [0, 2 L].
    """
    mechanism.check_lengths(lengths)
    rectangle = mechanism.flatness(tuple(map(float, lengths)))[1] > 0
    return [
        singularity
        for singularity in SINGULARITIES
        if (rectangle or singularity.mode != "rectangle") and singularity.holds(mechanism, lengths, side, tolerance)
    ]
