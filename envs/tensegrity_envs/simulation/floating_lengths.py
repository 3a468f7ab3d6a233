"""Mechanisms without what holds their actuators' lengths: what moves when prismatic actuators are no constraints.

The dynamic simulations drive prismatic actuators as stiff servos, so that their lengths are coordinates, too. A model
of floating lengths has the nodes and members of its mechanism, at coordinates of its own. No import of a physics engine
here.
"""

from typing import Any

from tensegrity_envs.compiler.namespace import Component, Components, namespace_of
from tensegrity_envs.mechanics.design import Member
from tensegrity_envs.mechanics.planar_four_bar import PlanarFourBar
from tensegrity_envs.mechanics.spatial_prism import SpatialPrism

_QUARTER = 1.5707963267948966  # pi / 2 [rad]


class FloatingFourBar:
    """The four bars of the planar 4-bar mechanism, hinged in A, B, C and D.

    Coordinates are the turns (a, b, t, g) of the bars AD and BC against the ground, of DE against AD and of CF against
    BC, counter-clockwise [rad]; at zero all bars point up. Hinges have no stops.

    Args:
        mechanism: of one design.
    """

    degrees_of_freedom = 4
    turns_freely = True

    def __init__(self, mechanism: PlanarFourBar) -> None:
        self.mechanism = mechanism
        self.design = mechanism.design
        self.extent = 2 * mechanism.length  # of pictures [m]; a bar's end may be farther while it swings

    @property
    def members(self) -> tuple[Member, ...]:
        """Those of the mechanism."""
        return self.mechanism.members

    def coordinates(self, q: Components, lengths: Components) -> Components:
        """The turns [rad] at a configuration (theta, gamma) under actuator lengths [m]."""
        alpha, beta = self.mechanism.base_angles(lengths)
        theta, gamma = q
        return alpha - _QUARTER, _QUARTER - beta, 2 * _QUARTER - theta - alpha, gamma + beta - 2 * _QUARTER

    def at_rest(self) -> tuple[Components, Components]:
        """A stable pose without load, and its lengths: those of 1.2 bars."""
        lengths = (1.2 * self.design.length,) * 2
        stable = next(state for state in self.mechanism.equilibria(lengths) if state.is_stable)
        return self.coordinates(stable.configuration, lengths), lengths

    def base_angles(self, turns: Components) -> tuple[Component, Component]:
        """(alpha, beta) [rad]."""
        return turns[0] + _QUARTER, _QUARTER - turns[1]

    def configuration(self, turns: Components) -> Components:
        """(theta, gamma) within (-pi, pi] [rad]."""
        xp = namespace_of(*turns)
        a, b, t, g = turns
        angles = (_QUARTER - a - t, _QUARTER + b + g)
        return tuple(xp.atan2(xp.sin(angle), xp.cos(angle)) for angle in angles)

    def rates(self, velocity: Components) -> Components:
        """Rates of alpha, beta, theta and gamma [rad/s], from those of the turns."""
        a, b, t, g = velocity
        return a, -b, -a - t, b + g

    def nodes(self, turns: Components) -> dict[str, tuple[Component, Component]]:
        """Positions (x, y) of the nodes A to F, and of the tip P = F [m]."""
        xp, l = namespace_of(*turns), self.design.length
        a, b, t, g = turns

        def beyond(start: tuple[Component, Component], turn: Component) -> tuple[Component, Component]:
            return start[0] - l * xp.sin(turn), start[1] + l * xp.cos(turn)

        zero = 0.0 * a
        ground = (zero, zero), (zero + l, zero)
        d, c = beyond(ground[0], a), beyond(ground[1], b)
        e, f = beyond(d, a + t), beyond(c, b + g)
        return {"A": ground[0], "B": ground[1], "C": c, "D": d, "E": e, "F": f, "P": f}

    def tip(self, turns: Components) -> Components:
        """Position of F [m]."""
        return self.nodes(turns)["P"]


def side_of_diagonals(q: Components) -> Component:
    """On which side of the line CD a rectangle C-D-F-E lies, 1 or -1, from its diagonals CF and DE alone.

    They cross at the angle pi - theta - gamma, whose sine changes its sign where the mechanism snaps; unlike the side
    of the tip, this tells it in motion, too, whatever the lengths are.
    """
    xp = namespace_of(*q)
    return xp.where(xp.sin(q[0] + q[1]) < 0, 1.0, -1.0)


class FloatingPrism:
    """The free platform of the spatial prism, on springs and struts. Coordinates are its configuration.

    The cables are the edges of the platform, which is rigid.

    Args:
        mechanism: of one design.
    """

    def __init__(self, mechanism: SpatialPrism) -> None:
        self.mechanism = mechanism
        self.design = mechanism.design

    @property
    def members(self) -> tuple[Member, ...]:
        """Springs and struts."""
        return tuple(member for member in self.mechanism.members if member.kind != "cable")

    def nodes(self, q: Components) -> dict[str, Components]:
        """See `SpatialPrism.nodes`."""
        return self.mechanism.nodes(q)

    def at_rest(self) -> tuple[Components, Components]:
        """A stable pose without load, and its lengths: level, as high as the base is wide."""
        place = (0.0, 0.0, float(self.design.D))
        return (*place, 0.0, 0.0, 0.0), self.mechanism.unloaded_lengths(place)


def floating_length_model(mechanism: Any) -> Any:
    """What of a mechanism moves while it is simulated: itself where it has no prismatic actuators."""
    if isinstance(mechanism, PlanarFourBar):
        return FloatingFourBar(mechanism)
    if isinstance(mechanism, SpatialPrism):
        return FloatingPrism(mechanism)
    return mechanism
