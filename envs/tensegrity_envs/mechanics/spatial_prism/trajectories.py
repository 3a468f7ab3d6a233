"""The two trajectories of [Jahromy, section 4]; one cycle in t from 0 to 1."""

import math
from collections.abc import Callable

from tensegrity_envs.compiler.namespace import Component, Components, namespace_of


def trajectory31(t: Component) -> Components:
    """Position of the platform's centroid [m] at time t [cycles], [Jahromy, Eq. 31]."""
    xp = namespace_of(t)
    s, c = xp.sin(2 * math.pi * t), xp.cos(2 * math.pi * t)
    return 0.1 * s + 0.2 * c, 0.1 * c + 0.2 * s, 0.4 + 0.0 * s


def trajectory32(t: Component) -> Components:
    """Position of the platform's centroid [m] at time t [cycles], [Jahromy, Eq. 32]."""
    c = namespace_of(t).cos(2 * math.pi * t)
    return 0.0 * c, 0.1 * c, 0.7 + 0.0 * c


TRAJECTORIES: dict[str, Callable[[Component], Components]] = {"eq31": trajectory31, "eq32": trajectory32}
