"""The planar 2-X manipulator: two anti-parallelogram (X) joints in series, springs, four cables, optional offsets.

Sources: [Furet2018] Furet and Wenger, "Workspace and cuspidality analysis of a 2-X planar manipulator", 2018;
[Muralidharan2022] Muralidharan, "Stable wrench-feasible workspace of a 2-X tensegrity manipulator", 2022, hal-03670867.
Where a printed equation is wrong the docstring says so; docs/two_x.md lists every correction.

Conventions: alpha_i [rad] is the orientation of joint i's top bar relative to its base bar, counter-clockwise, so that
alpha > 0 moves the tip towards -x. The crossed assembly is symmetric: the line between the midpoints of base and top
bar is turned by theta_i = alpha_i / 2. On the full torus alpha runs over (-2 pi, 2 pi]; |alpha| < pi is the joint
"up", beyond it "down". Tensions are ordered left 1, right 1, left 2, right 2. The cables of joint 2 are strut-routed,
so they do no work on alpha_1.
"""

import math
from collections.abc import Sequence

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, as_components, is_batch
from tensegrity_envs.mechanics import equilibrium as _equilibrium
from tensegrity_envs.mechanics.checks import check_finite, sized
from tensegrity_envs.mechanics.stiffness import TipStiffness
from tensegrity_envs.mechanics.two_x import inverse as _inverse
from tensegrity_envs.mechanics.two_x.design import TwoXDesign
from tensegrity_envs.mechanics.two_x.inverse import InverseSolution
from tensegrity_envs.mechanics.two_x.statics import TwoXStatics
from tensegrity_envs.mechanics.x_joints.pairs import solve

_NO_LOAD = (0.0, 0.0)


@sized(
    q=(2, "alpha_1, alpha_2"),
    start=(2, "alpha_1, alpha_2"),
    u=(2, "u_1, u_2"),
    tensions=(4, ", ".join(TwoXStatics.input_names)),
    inputs=(4, ", ".join(TwoXStatics.input_names)),
    load=(2, "fx, fy"),
    direction=(2, "x, y"),
)
class TwoX(TwoXStatics, TipStiffness):
    """The 2-X manipulator of one design, or of a batch of designs.

    A configuration is q = (alpha_1, alpha_2) [rad], tensions are (left 1, right 1, left 2, right 2) [N], `load` is a
    dead force at the tip (fx, fy) [N] in world axes, besides gravity. Components are floats, NumPy arrays or Torch
    tensors of any (broadcastable) shape.
    """

    def equilibrium(
        self, tensions: Sequence[Component], start: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> _equilibrium.Equilibrium:
        """The equilibrium that the arm reaches from `start` under these tensions, see `equilibrium.relax`.

        Args:
            tensions: (left 1, right 1, left 2, right 2) [N], each a float or an array of shape (n,).
            start: (alpha_1, alpha_2) [rad].
            load: (fx, fy) [N].

        Returns:
            Configuration [rad], residual [N m], is_stable, and the reason in words.

        Raises:
            ValueError: a number is NaN or infinite, or there are not four tensions and two angles.
        """
        check_finite("tensions", tensions, 4)
        check_finite("start", start, 2)
        check_finite("load", load, 2)

        inputs, forces = as_components(tensions), as_components(load)
        return _equilibrium.relax(_statics, start, (self.design, inputs, forces), self.design.joint_limit)

    def equilibria(self, tensions: Sequence[float], load: Sequence[float] = _NO_LOAD) -> list[_equilibrium.Equilibrium]:
        """All equilibria within the joint limits (flat poses excluded), stable and unstable, sorted by configuration.

        Raises:
            ValueError: a number is NaN or infinite, there are not four tensions, or the equilibria form a continuum (an
                arm without springs, weight and tensions).
        """
        check_finite("tensions", tensions, 4)
        check_finite("load", load, 2)
        limit = self.design.joint_limit
        return _equilibrium.find_all(lambda q: self.statics(q, tensions, load), (-limit, -limit), (limit, limit))

    def inverse_kinematics(self, x: float, y: float) -> list[InverseSolution]:
        """All configurations within the joint limits whose tip is at (x, y) [m], sorted by alpha_1.

        The real roots of one polynomial, of degree eight with offsets and, without, the quartic of [Furet2018, Eqs.
        3-8]. They are candidates only (on one curve a double root is no configuration at all): each is polished and
        verified by forward kinematics. Two solutions closer than 1e-6 rad to one another, next to a singularity, are
        given as one, and so are those (1e-5 rad at most) between which the tip is no further from the target. Of nearly
        equal bars (1 - (b/l)^2 < 2e-3) the solutions lie in valleys, along which the tip moves less than rounding:
        where it stays within 4e-15 of the reach from the target all the way between two solutions, one is given.

        Returns:
            The solutions, an empty list where the target is out of reach.

        Raises:
            ValueError: x or y is not a finite number, the mechanism is a batch of designs, or (without offsets) the
                target is the base itself, which every configuration with alpha_1 + alpha_2 = +-2 pi reaches.
        """
        if is_batch(self._probe):
            raise ValueError("inverse_kinematics takes one design, not a batch of them; see inverse_kinematics_batch")
        _, found, residual = solve(self, np.array([float(x)]), np.array([float(y)]))
        solutions = []
        for a1, a2, distance in zip(found[0].tolist(), found[1].tolist(), residual.tolist(), strict=True):
            q = (a1, a2)
            _, stability, wrench = self.posture(q)
            state = "".join("U" if abs(alpha) < math.pi else "D" for alpha in q)
            solutions.append(InverseSolution(q, state, self.jacobian_determinant(q), stability, wrench, distance))
        return solutions

    def inverse_kinematics_batch(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """All inverse solutions of many targets, as `inverse_kinematics` finds them.

        Args:
            x: shape (n,) [m].
            y: shape (n,) [m].

        Returns:
            alpha_1 and alpha_2, each of shape (n, m) [rad], m the largest number of solutions (at least 1), padded
            with NaN.

        Raises:
            ValueError: as `inverse_kinematics`, and where the designs of a batch differ in b, l or a.
        """
        owner, found, _ = solve(self, np.asarray(x, float), np.asarray(y, float))
        counts = np.bincount(owner, minlength=len(x))
        column = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        tables = np.full((2, len(x), max(int(counts.max(initial=0)), 1)), np.nan)
        for table, alpha in zip(tables, found, strict=True):
            table[owner, column] = alpha
        return tables[0], tables[1]

    def through_anomaly(
        self, x: Component, y: Component, psi: Component
    ) -> tuple[tuple[Component, Component], Component, Component]:
        """What `inverse_kinematics` looks for roots of; see `inverse.through_anomaly`. Traceable."""
        return _inverse.through_anomaly(self, x, y, psi)


def _statics(
    q: Components, parameters: tuple[TwoXDesign, Components, Components]
) -> tuple[Components, tuple[Components, ...]]:
    design, tensions, load = parameters
    return TwoX(design).statics(q, tensions, load)
