"""One X-joint: the distance of its bars' midpoints, its lateral sides, and their derivatives in alpha."""

from typing import NamedTuple

from tensegrity_envs.compiler.namespace import Component, Namespace


class Joint(NamedTuple):
    """A joint in some position.

    With s, c = sin, cos(alpha/2): r = sqrt(l^2 - b^2 c^2) is the distance of the midpoints of base and top bar, r - b s
    the left side and r + b s the right one; dr, ddr are derivatives of r in alpha [m/rad, m/rad2].
    """

    b: Component
    excess: Component  # l^2 - b^2, the product of both sides [m2]
    s: Component
    c: Component
    r: Component
    dr: Component
    ddr: Component

    def sides(self, xp: Namespace) -> tuple[Component, Component]:
        """Left and right side [m]. The shorter one is taken from the longer one: accurate close to the flat poses."""
        longer = self.r + self.b * abs(self.s)
        shorter = self.excess / longer
        return xp.where(self.s > 0, shorter, longer), xp.where(self.s > 0, longer, shorter)

    @property
    def arms(self) -> tuple[Component, Component]:
        """Derivatives of left and right side in alpha [m/rad]: negative and positive while the joint is up."""
        half = self.b * self.c / 2
        return self.dr - half, self.dr + half

    @property
    def curvatures(self) -> tuple[Component, Component]:
        """Second derivatives of left and right side in alpha [m/rad2]."""
        quarter = self.b * self.s / 4
        return self.ddr + quarter, self.ddr - quarter


def joint_at(xp: Namespace, b: Component, excess: Component, s: Component, c: Component) -> Joint:
    """The joint whose half angle has this sine and cosine; excess is l^2 - b^2."""
    bb = b * b
    r = xp.sqrt(excess + bb * s * s)  # = sqrt(l^2 - b^2 c^2) without its cancellation for l close to b
    dr = bb * s * c / (2 * r)
    return Joint(b, excess, s, c, r, dr, (bb * (c * c - s * s) / 4 - dr * dr) / r)


class Bars(NamedTuple):
    """The bars of a joint and the offset beyond it [m].

    Attributes:
        b: length of base and top bar.
        l: length of the crossed bars, l > b.
        a: length of the offset.
    """

    b: Component
    l: Component
    a: Component

    @property
    def excess(self) -> Component:
        """l^2 - b^2 [m2]."""
        return (self.l - self.b) * (self.l + self.b)

    @property
    def flatness(self) -> Component:
        """1 - (b / l)^2."""
        return self.excess / (self.l * self.l)
