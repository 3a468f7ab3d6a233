"""Statics of the 2-X manipulator: potential energy, stiffness, the stiffest tensions and the margins."""

from collections.abc import Sequence

from tensegrity_envs.compiler.namespace import Component, Components, Namespace
from tensegrity_envs.mechanics.two_x.kinematics import TwoXKinematics, directions
from tensegrity_envs.mechanics.x_joints.joint import Joint

_NO_LOAD = (0.0, 0.0)
_FLATTEST = 1 - 1e-9  # |sin(alpha/2)| at which a joint counts as flat


class TwoXStatics(TwoXKinematics):
    """Forces and stiffness of a design, or of a batch of designs."""

    def potential_energy(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> Component:
        """Potential energy [J] of gravity (zero at the base), springs, cables and load, [Muralidharan2022, Eq. 4]."""
        xp = self._xp(*q, *tensions, *load)
        a1, a2 = q
        j1, j2 = self._joint(xp, a1), self._joint(xp, a2)
        fx, fy = load
        a, ll = self.design.a, self.design.l * self.design.l
        k1, k2, bb = self.design.k1, self.design.k2, self._bb
        l1, r1, l2, r2 = self.cable_lengths(q)
        gravity_and_load = (
            j1.r * (fx * j1.s + (self._w1 - fy) * j1.c)
            + a * (fx * xp.sin(a1) + (self._h1 - fy) * xp.cos(a1))
            + j2.r * (fx * xp.sin(a1 + a2 / 2) + (self._w2 - fy) * xp.cos(a1 + a2 / 2))
            + a * (fx * xp.sin(a1 + a2) + (self._h2 - fy) * xp.cos(a1 + a2))
        )
        springs = k1 * (ll - bb * xp.cos(a1)) + k2 * (ll - bb * xp.cos(a2))
        return gravity_and_load + springs + tensions[0] * l1 + tensions[1] * r1 + tensions[2] * l2 + tensions[3] * r2

    def _passive(self, xp: Namespace, j1: Joint, j2: Joint, load: Sequence[Component]) -> tuple[Component, ...]:
        """Gradient [N m] and Hessian [N m/rad] of the energy without cables: (g1, g2, h11, h12, h22)."""
        _, _, s1, c1, r1, dr1, ddr1 = j1
        _, _, s2, c2, r2, dr2, ddr2 = j2
        a = self.design.a
        sin_a1, cos_a1, s12, c12, end_s, end_c = directions(j1, j2)
        sin_a2, cos_a2 = 2 * s2 * c2, c2 * c2 - s2 * s2
        # Each of the four vectors of the chain contributes p = fx sin(phi) + w cos(phi) times its length; d = dp/dphi.
        if load is _NO_LOAD:
            h1, h2 = a * self._h1, a * self._h2
            p1, d1 = self._w1 * c1, -self._w1 * s1
            p2, d2 = h1 * cos_a1, -h1 * sin_a1
            p3, d3 = self._w2 * c12, -self._w2 * s12
            p4, d4 = h2 * end_c, -h2 * end_s
        else:
            fx, fy = load
            w1, h1, w2, h2 = self._w1 - fy, a * (self._h1 - fy), self._w2 - fy, a * (self._h2 - fy)
            fa = a * fx
            p1, d1 = fx * s1 + w1 * c1, fx * c1 - w1 * s1
            p2, d2 = fa * sin_a1 + h1 * cos_a1, fa * cos_a1 - h1 * sin_a1
            p3, d3 = fx * s12 + w2 * c12, fx * c12 - w2 * s12
            p4, d4 = fa * end_s + h2 * end_c, fa * end_c - h2 * end_s
        r2p3, r2d3 = r2 * p3, r2 * d3
        return (
            dr1 * p1 + r1 * d1 / 2 + d2 + r2d3 + d4 + self._spring1 * sin_a1,
            dr2 * p3 + r2d3 / 2 + d4 + self._spring2 * sin_a2,
            (ddr1 - r1 / 4) * p1 + dr1 * d1 - p2 - r2p3 - p4 + self._spring1 * cos_a1,
            dr2 * d3 - r2p3 / 2 - p4,
            ddr2 * p3 + dr2 * d3 - r2p3 / 4 - p4 + self._spring2 * cos_a2,
        )

    def _active(
        self, xp: Namespace, j1: Joint, j2: Joint, tensions: Sequence[Component], load: Sequence[Component]
    ) -> tuple[Component, ...]:
        """Gradient and Hessian of the whole energy: (g1, g2, h11, h12, h22)."""
        g1, g2, h11, h12, h22 = self._passive(xp, j1, j2, load)
        half = self.design.b / 2
        left1, right1, left2, right2 = tensions
        sum1, pull1, sum2, pull2 = left1 + right1, (right1 - left1) * half, left2 + right2, (right2 - left2) * half
        return (
            g1 + sum1 * j1.dr + pull1 * j1.c,
            g2 + sum2 * j2.dr + pull2 * j2.c,
            h11 + sum1 * j1.ddr - pull1 * j1.s / 2,
            h12,
            h22 + sum2 * j2.ddr - pull2 * j2.s / 2,
        )

    def statics(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, tuple[Components, ...]]:
        """Gradient and Hessian of the potential energy in one evaluation: (g1, g2), ((h11, h12), (h12, h22))."""
        xp = self._xp(*q, *tensions, *load)
        a1, a2 = q
        g1, g2, h11, h12, h22 = self._active(xp, self._joint(xp, a1), self._joint(xp, a2), tensions, load)
        return (g1, g2), ((h11, h12), (h12, h22))

    def to_sines(self, q: Sequence[Component]) -> Components:
        """u_i = sin(alpha_i / 2), the coordinates of `sine_statics`; for joints up."""
        xp = self._xp(*q)
        return tuple(xp.sin(alpha / 2) for alpha in q)

    def from_sines(self, u: Sequence[Component]) -> Components:
        """alpha_i = 2 asin(u_i) [rad]."""
        xp = self._xp(*u)
        inside = [xp.maximum(xp.minimum(ui, _FLATTEST), -_FLATTEST) for ui in u]
        return tuple(2 * xp.atan2(ui, xp.sqrt(1 - ui * ui)) for ui in inside)

    def sine_statics(
        self, u: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, tuple[Components, ...]]:
        """Gradient and Hessian of the potential energy in u_i = sin(alpha_i / 2) [J], for joints up.

        In these coordinates the energy of springs and cables is convex, and the flat poses, where the cables lose
        their moment arms in alpha, are ordinary boundary points (|u| = 1). Newton's method converges from much
        further away than in alpha, and no trigonometry is left.
        """
        xp = self._xp(*u, *tensions, *load)
        joints, turns, tangents = [], [], []
        for unlimited in u:
            ui = xp.maximum(xp.minimum(unlimited, _FLATTEST), -_FLATTEST)
            c = xp.sqrt(1 - ui * ui)
            joints.append(self._joint_at(xp, ui, c))
            turns.append(2 / c)  # d alpha / d u
            tangents.append(ui / (2 * c))
        g1, g2, h11, h12, h22 = self._active(xp, joints[0], joints[1], tensions, load)
        t1, t2 = turns
        mixed = h12 * t1 * t2
        return (
            (g1 * t1, g2 * t2),
            (((h11 + g1 * tangents[0]) * t1 * t1, mixed), (mixed, (h22 + g2 * tangents[1]) * t2 * t2)),
        )

    def energy_gradient(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> Components:
        """dU/dalpha [N m], both zero in equilibrium.

        [Muralidharan2022, Eqs. 5-6] hold twice these (G - Gamma), with sin(alpha_1 + alpha_2/2) in G_1, where Eq. 6
        misprints it.
        """
        return self.statics(q, tensions, load)[0]

    def stiffness_matrix(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, ...]:
        """Hessian of the potential energy [N m/rad], ((h11, h12), (h12, h22)); positive definite where stable.

        [Muralidharan2022, Eqs. 8-11] print four times this matrix.
        """
        return self.statics(q, tensions, load)[1]

    def _stiffest(
        self, xp: Namespace, j1: Joint, j2: Joint, load: Sequence[Component]
    ) -> tuple[Components, Component, Component]:
        """Stiffest tensions, stability margin and wrench margin."""
        g1, g2, h11, h12, h22 = self._passive(xp, j1, j2, load)
        b, top = self.design.b, self.design.max_tension
        tensions: list[Component] = []
        others: list[Component] = []
        diagonal: list[Component] = []
        for joint, g, h in ((j1, g1, h11), (j2, g2, h22)):
            # Equilibrium of a joint: F_left * left - F_right * right = moment, where moment = 2 r g / (b cos(alpha/2)).
            moment = 2 * joint.r * g / (b * joint.c)
            left, right = joint.sides(xp)
            # Whichever cable is not at the maximum follows from equilibrium.
            other_right = (top * left - moment) / right
            other_left = (top * right + moment) / left
            is_left_max = other_right <= top
            f_left = xp.where(is_left_max, top, other_left)
            f_right = xp.where(is_left_max, other_right, top)
            tensions += [f_left, f_right]
            others.append(xp.where(is_left_max, other_right, other_left))
            diagonal.append(h + (f_left + f_right) * joint.ddr - (f_right - f_left) * b * joint.s / 4)
        return (
            tuple(tensions),
            smallest_eigenvalue(diagonal[0], h12, diagonal[1], xp) / self.stiffness_scale,
            (xp.minimum(others[0], others[1]) - self.design.min_tension) / top,
        )

    def stiffest_tensions(self, q: Sequence[Component], load: Sequence[Component] = _NO_LOAD) -> Components:
        """The tensions (left 1, right 1, left 2, right 2) [N] of greatest stiffness that hold q in equilibrium.

        For each joint the larger tension is max_tension [Muralidharan2022, section 2]; the other one follows from
        equilibrium and is not clipped: below min_tension it says that q is not wrench-feasible. Close to the flat
        poses, where a cable has no moment arm, it grows without bound.
        """
        return self.posture(q, load)[0]

    def softest_tensions(self, q: Sequence[Component], load: Sequence[Component] = _NO_LOAD) -> Components:
        """The tensions (left 1, right 1, left 2, right 2) [N] of least stiffness that hold q in equilibrium.

        For each joint the smaller tension is min_tension; the other one follows from equilibrium. Of a q that is not
        wrench-feasible they mean nothing.
        """
        left1, right1, left2, right2 = self.stiffest_tensions(q, load)
        sides = self.cable_lengths(q)
        xp = self._xp(left1, *sides)
        low = self.design.min_tension
        tensions: list[Component] = []
        for f_left, f_right, left, right in ((left1, right1, *sides[:2]), (left2, right2, *sides[2:])):
            # F_left left - F_right right is the moment of the joint: it stays.
            less = xp.minimum((f_left - low) / right, (f_right - low) / left)
            tensions += [f_left - less * right, f_right - less * left]
        return tuple(tensions)

    def posture(
        self, q: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, Component, Component]:
        """Stiffest tensions, stability margin and wrench margin of q in one evaluation."""
        xp = self._xp(*q, *load)
        return self._stiffest(xp, self._joint(xp, q[0]), self._joint(xp, q[1]), load)

    def posture_and_tip(self, q: Sequence[Component]) -> tuple[Components, Component, Component, Components]:
        """`posture` and `tip` of q in one evaluation."""
        xp = self._xp(*q)
        j1, j2 = self._joint(xp, q[0]), self._joint(xp, q[1])
        return (*self._stiffest(xp, j1, j2, _NO_LOAD), self._tip(j1, j2))

    def wrench_margin(
        self, q: Sequence[Component], tensions: Sequence[Component] | None = None, load: Sequence[Component] = _NO_LOAD
    ) -> Component:
        """Distance of the tensions to their bounds, divided by max_tension [-]; positive inside.

        Without `tensions`: of the stiffest ones, to the lower bound (they are at the upper one), so that it is >= 0
        exactly where q is wrench-feasible. With `tensions`: of those, to the nearer of both bounds.
        """
        if tensions is None:
            return self.posture(q, load)[2]
        xp = self._xp(*q, *tensions)
        low, high = self.design.min_tension, self.design.max_tension
        slack = [xp.minimum(f - low, high - f) for f in tensions]
        return xp.minimum(xp.minimum(slack[0], slack[1]), xp.minimum(slack[2], slack[3])) / high

    def stability_margin(
        self, q: Sequence[Component], tensions: Sequence[Component] | None = None, load: Sequence[Component] = _NO_LOAD
    ) -> Component:
        """Smallest eigenvalue of the stiffness matrix divided by k1 b^2 (by max_tension b without springs) [-].

        Without `tensions`: at the stiffest ones, which is the best that can be had in this configuration.
        """
        if tensions is None:
            return self.posture(q, load)[1]
        (h11, h12), (_, h22) = self.stiffness_matrix(q, tensions, load)
        return smallest_eigenvalue(h11, h12, h22, self._xp(h11)) / self.stiffness_scale

    def is_stable_wrench_feasible(self, q: Sequence[Component], load: Sequence[Component] = _NO_LOAD) -> Component:
        """Whether q is in the stable wrench-feasible joint space (SWFJ), joint limits included."""
        _, stability, wrench = self.posture(q, load)
        return (stability > 0) & (wrench >= 0) & self.is_within_limits(q)


def smallest_eigenvalue(h11: Component, h12: Component, h22: Component, xp: Namespace) -> Component:
    """Smallest eigenvalue of a symmetric 2 x 2 matrix."""
    half = (h11 - h22) / 2
    return (h11 + h22) / 2 - xp.sqrt(half * half + h12 * h12)
