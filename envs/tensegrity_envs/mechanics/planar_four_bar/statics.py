"""Statics of the planar 4-bar mechanism: potential energy, stiffness, and the forces in its members."""

from collections.abc import Sequence

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.planar_four_bar.kinematics import FourBarKinematics, Point

NO_LOAD = (0.0, 0.0)
LARGEST_THRUST = 2.0  # times K L; unloaded rectangles never need more


class FourBarStatics(FourBarKinematics):
    """Forces and stiffness of a mechanism of one design, or of a batch of designs."""

    def potential_energy(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> Component:
        """Energy of the springs, less the load times the position of F [J], [Ji2014, Eq. 6].

        U / (K L^2 / 2) = 13 + 6 (cos(alpha + beta) - cos alpha - cos beta) + 4 a (cos gamma + cos theta)
        + 2 cos(theta + gamma) + 4 s (sin theta - sin gamma), a = 1 - cos alpha - cos beta, s = sin alpha - sin beta.
        The print lacks the factor 4 of the last term.
        """
        xp = self._xp(*q, *lengths, *load)
        sin_a, cos_a, sin_b, cos_b = self.half_angles(lengths)
        a, s = 2 * (sin_a * sin_a + sin_b * sin_b) - 1, 2 * (sin_a * cos_a - sin_b * cos_b)
        square = a * a + s * s
        theta, gamma = q
        # 4 + 3 R^2 is what the part without theta and gamma comes to.
        terms = 4 * a * (xp.cos(gamma) + xp.cos(theta)) + 4 * s * (xp.sin(theta) - xp.sin(gamma))
        springs = self.stiffness * self.length**2 / 2 * (4 + 3 * square + terms + 2 * xp.cos(theta + gamma))
        x, y = self.tip(q, lengths)
        return springs - load[0] * x - load[1] * y

    def statics(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> tuple[Components, tuple[Components, ...]]:
        """Gradient [N m] and Hessian [N m/rad] of the potential energy in (theta, gamma), actuators locked.

        [Ji2014, Eqs. 12, 13], whose brackets are misplaced; the load adds its moment and its geometric stiffness.
        """
        xp = self._xp(*q, *lengths, *load)
        sin_a, cos_a, sin_b, cos_b = self.half_angles(lengths)
        a, s = 2 * (sin_a * sin_a + sin_b * sin_b) - 1, 2 * (sin_a * cos_a - sin_b * cos_b)
        theta, gamma = q
        sin_t, cos_t, sin_g, cos_g = xp.sin(theta), xp.cos(theta), xp.sin(gamma), xp.cos(gamma)
        sin_sum, cos_sum = sin_t * cos_g + cos_t * sin_g, cos_t * cos_g - sin_t * sin_g
        scale = self.stiffness * self.length**2
        fx, fy = (self.length * force for force in load)
        gradient = (
            scale * (2 * (s * cos_t - a * sin_t) - sin_sum),
            scale * (-2 * (s * cos_g + a * sin_g) - sin_sum) + fx * sin_g - fy * cos_g,
        )
        coupling = -scale * cos_sum
        hessian = (
            (scale * (-2 * (s * sin_t + a * cos_t) - cos_sum), coupling),
            (coupling, scale * (2 * (s * sin_g - a * cos_g) - cos_sum) + fx * cos_g + fy * sin_g),
        )
        return gradient, hessian

    def energy_gradient(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> Components:
        """Gradient of the potential energy in (theta, gamma) [N m]; zero in equilibrium."""
        return self.statics(q, lengths, load)[0]

    def stiffness_matrix(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> tuple[Components, ...]:
        """Hessian of the potential energy in (theta, gamma) [N m/rad]: stable where it is positive definite.

        In an unloaded rectangle its eigenvalues are 2 K (L^2 - CD^2) along (1, 1) and 2 K CD^2 along (1, -1).
        """
        return self.statics(q, lengths, load)[1]

    def stability_margin(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> Component:
        """Smallest eigenvalue of the Hessian divided by K L^2; of an unloaded rectangle 2 min(R^2, 1 - R^2)."""
        (h11, h12), (_, h22) = self.stiffness_matrix(q, lengths, load)
        xp = self._xp(h11)
        smallest = (h11 + h22) / 2 - xp.hypot((h11 - h22) / 2, h12)
        return smallest / (self.stiffness * self.length**2)

    def thrusts(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> tuple[Component, Component]:
        """Forces of the actuators AC and BD [N], positive in compression: p_i = dU/drho_i - f . dF/drho_i at fixed
        theta and gamma; in an unloaded rectangle p1 = K rho2 cos(beta + alpha/2) / cos(beta/2) and
        p2 = K rho1 cos(alpha + beta/2) / cos(alpha/2), at most 2 K L. At rho_i = 2 L, where the triangle of the
        actuator is flat, it is infinite (1e100 here).
        """
        xp = self._xp(*q, *lengths, *load)
        (cx, cy), (dx, dy), (ex, ey), (fx, fy) = self._ends(xp, q, lengths)
        k = self.stiffness
        (c_x, c_y), (d_x, d_y) = self._support_rates(lengths)
        pull_c = k * (cx + 2 * (fx - ex) - dx) - load[0], k * (cy + 2 * (fy - ey) - dy) - load[1]
        pull_d = k * (2 * (ex - fx) + dx - cx), k * (2 * (ey - fy) + dy - cy)
        return pull_c[0] * c_x + pull_c[1] * c_y, pull_d[0] * d_x + pull_d[1] * d_y

    def wrench_margin(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> Component:
        """Distance of the larger of the two thrusts from its bound, 2 K L, as a share of it [-]; negative beyond."""
        p1, p2 = self.thrusts(q, lengths, load)
        xp = self._xp(p1, p2)
        return 1 - xp.maximum(abs(p1), abs(p2)) / (LARGEST_THRUST * self.largest_force)

    def member_forces(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> dict[str, Component]:
        """Axial force of every member by name [N], positive in tension, in an equilibrium."""
        n = self.nodes(q, lengths)
        k, l = self.stiffness, self.length
        p1, p2 = self.thrusts(q, lengths, load)
        xp = self._xp(p1)

        def from_to(first: str, second: str) -> Point:
            return n[second][0] - n[first][0], n[second][1] - n[first][1]

        def dot(u: Point, v: Point) -> Component:
            return u[0] * v[0] + u[1] * v[1]

        forces: dict[str, Component] = {}
        # The forces on a bar's end, along the bar, balance it; towards the inside of the bar is negative.
        ec, ef, ed = from_to("E", "C"), from_to("E", "F"), from_to("E", "D")
        forces["bar DE"] = -k * (dot(ec, ed) + dot(ef, ed)) / l
        fe, fd, fc = from_to("F", "E"), from_to("F", "D"), from_to("F", "C")
        forces["bar CF"] = -(k * (dot(fe, fc) + dot(fd, fc)) + dot((load[0], load[1]), fc)) / l
        da, db, df, de = from_to("D", "A"), from_to("D", "B"), from_to("D", "F"), from_to("D", "E")
        ca, cb, ce, cf = from_to("C", "A"), from_to("C", "B"), from_to("C", "E"), from_to("C", "F")
        forces["bar AD"] = -(k * dot(df, da) + forces["bar DE"] * dot(de, da) / l - p2 * dot(db, da) / lengths[1]) / l
        forces["bar BC"] = -(k * dot(ce, cb) + forces["bar CF"] * dot(cf, cb) / l - p1 * dot(ca, cb) / lengths[0]) / l
        for member in self.members:
            if member.kind == "spring":
                forces[member.name] = k * xp.hypot(*from_to(*member.nodes))
        return forces | {"actuator AC": -p1, "actuator BD": -p2}

    def tip_compliance(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> tuple[Components, Components]:
        """dF / d load with the actuators locked [m/N], of rank one: F can only turn about C.

        Along that circle it is `tangential_compliance`; in an unloaded rectangle 1 / (4 K R^2 (1 - R^2)).
        """
        size = self.tangential_compliance(q, lengths, load)
        xp = self._xp(*q)
        tx, ty = -xp.sin(q[1]), xp.cos(q[1])
        return (size * tx * tx, size * tx * ty), (size * tx * ty, size * ty * ty)

    def tangential_compliance(
        self, q: Sequence[Component], lengths: Sequence[Component], load: Sequence[Component] = NO_LOAD
    ) -> Component:
        """Displacement of F per force along its circle about C, actuators locked [m/N]."""
        (h11, h12), (_, h22) = self.stiffness_matrix(q, lengths, load)
        return self.length**2 * h11 / (h11 * h22 - h12 * h12)

    def energy_barrier(self, lengths: Sequence[Component]) -> Component:
        """Energy from an unloaded rectangle to the lowest saddle on the way to its mirror image [J]:
        2 K L^2 min(R^2, (1 - R)^2), at most K L^2 / 2; zero where the mechanism is flat.
        """
        square, rest = self.flatness(lengths)
        xp = self._xp(square)
        size = xp.sqrt(square)
        fold = xp.maximum(rest, 0.0) / (1 + size)  # 1 - R
        return 2 * self.stiffness * self.length**2 * xp.minimum(square, fold * fold)
