"""The serial arm of dual-triangles: n equal segments in series, six free lengths (of three segments) as inputs.

Source: [Zhao2021] Zhao, Pashkevich, Klimchik, Chablat, "Kinematic control of compliant serial manipulators composed of
dual-triangles", ICCCR 2021. Where a printed equation is wrong the docstring says so; docs/dual_triangle.md lists every
correction. Two matter most: the loaded control law has the wrong sign, and stability is not ensured under load.

Conventions: q_i [rad] is the angle of segment i's moving triangle relative to its base triangle, counter-clockwise;
q > 0 moves the tip towards +y, and the straight arm lies along +x. Pivot 1 is at (b1, 0), the next ones at distances
b1 + b2, the tip P at b2 beyond the last. Spring 1 of a segment is the one on the +y side, which shortens for q > 0.
`load` is a dead force at the tip (fx, fy) [N] in world axes; compression of the straight arm is fx < 0. There is no
gravity.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, as_components, is_batch, namespace_of
from tensegrity_envs.mechanics import equilibrium as _equilibrium
from tensegrity_envs.mechanics.checks import check_count, check_finite, check_single
from tensegrity_envs.mechanics.design import Member
from tensegrity_envs.mechanics.dual_triangle.branches import Branch, follow_load, heading_in_load
from tensegrity_envs.mechanics.dual_triangle.design import ZHAO2021_CAPTION, DualTriangleDesign
from tensegrity_envs.mechanics.dual_triangle.eigenvalues import smallest_eigenvalue
from tensegrity_envs.mechanics.dual_triangle.loads import (
    LoadedState,
    correct,
    critical_load,
    estimate_load,
    identify,
    straight_critical_loads,
)
from tensegrity_envs.mechanics.dual_triangle.redundancy import Links, Objective, Redundancy, resolve
from tensegrity_envs.mechanics.dual_triangle.segment import DualTriangleSegment, Springs
from tensegrity_envs.mechanics.dual_triangle.shooting import candidates, grid_of_starts, polish

_NO_LOAD = (0.0, 0.0)


class InverseSolution(NamedTuple):
    """One solution of the inverse kinematics.

    Attributes:
        configuration: the angles [rad], those of the last two segments in (-pi, pi].
        elbow: sign of the last angle: 1, -1, or 0 where the last two links are in line.
        is_within_limits: whether every angle is within the joint limits.
        singularity: see `DualTriangle.singularity` [m2].
        residual: distance of its forward kinematics from the target [m].
    """

    configuration: tuple[float, ...]
    elbow: int
    is_within_limits: bool
    singularity: float
    residual: float


class Wrist(NamedTuple):
    """A target as the last two links see it.

    Attributes:
        u: from the last pivot but one to the target, along x [m].
        v: along y [m].
        turn: sum of the first n - 2 angles [rad].
        stretch: negative where the target is too far for the two links [m2].
        folding: negative where it is too close [m2].
        angle: absolute value of the last angle [rad].
    """

    u: Component
    v: Component
    turn: Component
    stretch: Component
    folding: Component
    angle: Component


class _Shape(NamedTuple):
    """What a configuration fixes: the springs of every segment, and its link as seen from its pivot."""

    springs: tuple[Springs, ...]
    links: tuple[tuple[Component, Component], ...]  # from pivot to pivot, the last one to the tip [m]


class DualTriangle:
    """An arm of n segments of one design, or of a batch of designs.

    A configuration is q = (q_1, ..., q_n) [rad]; free lengths are (spring 1 and spring 2 of segment 1, of segment 2,
    ...), 2 n of them [m]; control inputs are (delta_1, ..., delta_n) [m]. Components are floats, NumPy arrays or Torch
    tensors of any (broadcastable) shape.
    """

    def __init__(self, design: DualTriangleDesign = ZHAO2021_CAPTION, segments: int = 3) -> None:
        if isinstance(segments, bool) or not isinstance(segments, int):
            raise TypeError(f"segments = {segments!r}: must be an integer")
        if segments < 1:
            raise ValueError(f"segments = {segments!r}: must be 1 or more")
        self.design = design
        self.segments = self.degrees_of_freedom = segments
        self.input_names = tuple(f"{side} {i + 1}" for i in range(segments) for side in ("upper", "lower"))
        self.segment = DualTriangleSegment(design)
        self.stiffness_scale = self.segment.stiffness_scale  # [N m/rad]
        self._probe = self.segment._probe
        self.link_lengths = (design.b1 + design.b2,) * (segments - 1) + (design.b2,)  # from pivot 1 to the tip [m]

    def take(self, index: Any) -> "DualTriangle":
        """The arms at `index` of a batch of designs; itself where there is one design only."""
        if not isinstance(self._probe, np.ndarray):
            return self
        part = object.__new__(DualTriangle)
        part.__dict__.update(
            {name: value[index] if isinstance(value, np.ndarray) else value for name, value in vars(self).items()}
        )
        part.segment = self.segment.take(index)
        part.design = part.segment.design
        part.link_lengths = tuple(l[index] if isinstance(l, np.ndarray) else l for l in self.link_lengths)
        return part

    # ------------------------------------------------------------------------------------------------ geometry

    @property
    def reach(self) -> Any:
        """Distance of the straight arm's tip from the base side A-B [m], 6 b of three symmetric segments."""
        return self.design.b1 + sum(self.link_lengths)

    def _xp(self, *components: Component) -> Any:
        return namespace_of(self._probe, *components)

    def _shape(self, xp: Any, q: Sequence[Component]) -> _Shape:
        springs: list[Springs] = []
        links: list[tuple[Component, Component]] = []
        for qi, length in zip(q, self.link_lengths, strict=True):
            s, c = xp.sin(qi / 2), xp.cos(qi / 2)
            springs.append(self.segment.springs_at(xp, s, c))
            sin, cos = 2 * s * c, (c - s) * (c + s)
            if not links:
                direction = cos, sin
            else:
                direction = direction[0] * cos - direction[1] * sin, direction[1] * cos + direction[0] * sin
            links.append((length * direction[0], length * direction[1]))
        return _Shape(tuple(springs), tuple(links))

    def _links(self, xp: Any, q: Sequence[Component]) -> list[tuple[Component, Component]]:
        links, turn = [], None
        for qi, length in zip(q, self.link_lengths, strict=True):
            turn = qi if turn is None else turn + qi
            links.append((length * xp.cos(turn), length * xp.sin(turn)))
        return links

    @staticmethod
    def _arms(links: Sequence[tuple[Component, Component]]) -> list[tuple[Component, Component]]:
        """From every pivot to the tip [m]."""
        arms = [links[-1]]
        for x, y in reversed(links[:-1]):
            arms.append((x + arms[-1][0], y + arms[-1][1]))
        return arms[::-1]

    def tip(self, q: Sequence[Component]) -> tuple[Component, Component]:
        """Tip position (x, y) [m], [Zhao2021, Eq. 6] (x = b + 2b C1 + 2b C12 + b C123; the print loses a digit)."""
        x, y = self._arms(self._links(self._xp(*q), q))[0]
        return self.design.b1 + x, y

    def jacobian(self, q: Sequence[Component]) -> tuple[Components, Components]:
        """d tip / d q [m/rad]: two rows of n entries, [Zhao2021, Eq. 9] (whose first row lost J13 = -b S123)."""
        arms = self._arms(self._links(self._xp(*q), q))
        return tuple(-y for _, y in arms), tuple(x for x, _ in arms)

    def singularity(self, q: Sequence[Component]) -> Component:
        """How far the arm is from a singular configuration [m2/rad2]: 0 there.

        det J of two segments; of more, sqrt(det J J^T), the product of the singular values (a singular arm has all
        links in line: sin q_i = 0 for i > 1). Of one segment: the length of its link [m].
        """
        xp = self._xp(*q)
        row_x, row_y = self.jacobian(q)
        if self.segments == 1:
            return xp.hypot(row_x[0], row_y[0])
        minors = self._minors(row_x, row_y)
        if len(minors) == 1:
            return minors[0]
        total = minors[0] * minors[0]
        for minor in minors[1:]:
            total = total + minor * minor
        return xp.sqrt(total)

    @staticmethod
    def _minors(row_x: Components, row_y: Components) -> list[Component]:
        n = len(row_x)
        return [row_x[i] * row_y[j] - row_x[j] * row_y[i] for i in range(n) for j in range(i + 1, n)]

    def nodes(self, q: Sequence[Component]) -> dict[str, tuple[Component, Component]]:
        """Positions (x, y) [m] of the nodes.

        Oi the pivot of segment i; Ai, Bi the corners of its base triangle and Di, Ci those of its moving triangle on
        the +y and -y side of the straight arm; P the tip, midpoint of the last Di, Ci.
        """
        xp = self._xp(*q)
        design = self.design
        x, y = 0.0 * q[0] + design.b1, 0.0 * q[0]
        cos, sin = 1.0, 0.0
        nodes: dict[str, tuple[Component, Component]] = {}
        turn = 0.0
        for i, qi in enumerate(q, 1):
            nodes[f"O{i}"] = x, y
            for name, side in ((f"A{i}", design.a1), (f"B{i}", -design.a1)):
                nodes[name] = x - design.b1 * cos - side * sin, y - design.b1 * sin + side * cos
            turn = turn + qi
            cos, sin = xp.cos(turn), xp.sin(turn)
            for name, side in ((f"D{i}", design.a2), (f"C{i}", -design.a2)):
                nodes[name] = x + design.b2 * cos - side * sin, y + design.b2 * sin + side * cos
            end = x + design.b2 * cos, y + design.b2 * sin
            x, y = end[0] + design.b1 * cos, end[1] + design.b1 * sin
        nodes["P"] = end
        return nodes

    @property
    def members(self) -> tuple[Member, ...]:
        """The sides of the triangles as bars, and the springs, whose free lengths are the inputs."""
        design = self.design
        members: list[Member] = []
        for i in range(1, self.segments + 1):
            for name, corners in ((f"base {i}", ("A", "B")), (f"moving {i}", ("D", "C"))):
                first, second, pivot = f"{corners[0]}{i}", f"{corners[1]}{i}", f"O{i}"
                members += [
                    Member(f"{name} side", "bar", (first, second)),
                    Member(f"{name} upper edge", "bar", (first, pivot)),
                    Member(f"{name} lower edge", "bar", (second, pivot)),
                ]
        for i in range(1, self.segments + 1):
            for side, ends, k, free in (
                ("upper", ("A", "D"), design.k1, design.free_length1),
                ("lower", ("B", "C"), design.k2, design.free_length2),
            ):
                members.append(
                    Member(
                        f"spring {side} {i}",
                        "spring",
                        (f"{ends[0]}{i}", f"{ends[1]}{i}"),
                        stiffness=k,
                        free_length=free,
                        is_input=True,
                        goes_slack=design.springs == "cable",
                    )
                )
        return tuple(members)

    def spring_lengths(self, q: Sequence[Component]) -> Components:
        """Lengths of the springs [m], in the order of the free lengths."""
        return tuple(length for qi in q for length in self.segment.spring_lengths(qi))

    def spring_forces(self, q: Sequence[Component], free_lengths: Sequence[Component]) -> Components:
        """Tensions of the springs [N], in the order of the free lengths; negative where a bilateral spring pushes."""
        pairs = zip(q, _pairs(free_lengths), strict=True)
        return tuple(force for qi, pair in pairs for force in self.segment.spring_forces(qi, pair))

    def is_within_limits(self, q: Sequence[Component]) -> Component:
        """Whether every angle is within the joint limits."""
        return self.limit_margin(q) >= 0

    def limit_margin(self, q: Sequence[Component]) -> Component:
        """Distance of the angle that is nearest to its limit from it [rad]; negative outside."""
        xp = self._xp(*q)
        largest = abs(q[0])
        for qi in q[1:]:
            largest = xp.maximum(largest, abs(qi))
        return self.design.joint_limit - largest

    # ------------------------------------------------------------------------------------------------- statics

    def potential_energy(
        self, q: Sequence[Component], free_lengths: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> Component:
        """Energy of the springs, less the load times the tip's position [J]."""
        xp = self._xp(*q, *free_lengths, *load)
        shape = self._shape(xp, q)
        x, y = self._arms(shape.links)[0]
        energy = -load[0] * (self.design.b1 + x) - load[1] * y
        for springs, pair in zip(shape.springs, _pairs(free_lengths), strict=True):
            energy = energy + self.segment.energy_of(xp, springs, pair)
        return energy

    def statics(
        self, q: Sequence[Component], free_lengths: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, tuple[Components, ...]]:
        """Gradient [N m] and Hessian [N m/rad] of the potential energy in one evaluation.

        g_i = -M_i(q_i) - (J^T F)_i, H_ij = K_i (i = j) + F . (tip - pivot max(i, j)): the second term is the load's
        geometric stiffness, which [Zhao2021] leaves out.
        """
        xp = self._xp(*q, *free_lengths, *load)
        shape = self._shape(xp, q)
        fx, fy = load
        gradient, stiffness, along = [], [], []
        arms = self._arms(shape.links)
        for springs, pair, (x, y) in zip(shape.springs, _pairs(free_lengths), arms, strict=True):
            slope, k = self.segment.slope_and_stiffness(xp, springs, pair)
            gradient.append(slope + fx * y - fy * x)
            stiffness.append(k)
            along.append(fx * x + fy * y)
        n = self.segments
        hessian = tuple(
            tuple(along[max(i, j)] + stiffness[i] if i == j else along[max(i, j)] for j in range(n)) for i in range(n)
        )
        return tuple(gradient), hessian

    def energy_gradient(
        self, q: Sequence[Component], free_lengths: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> Components:
        """Gradient of the potential energy in q [N m], n components; zero in equilibrium."""
        return self.statics(q, free_lengths, load)[0]

    def stiffness_matrix(
        self, q: Sequence[Component], free_lengths: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, ...]:
        """Hessian of the potential energy [N m/rad], n rows; an equilibrium is stable where it is positive definite."""
        return self.statics(q, free_lengths, load)[1]

    def stability_margin(
        self,
        q: Sequence[Component],
        free_lengths: Sequence[Component] | None = None,
        load: Sequence[Component] = _NO_LOAD,
    ) -> Component:
        """Smallest eigenvalue of the Hessian divided by `stiffness_scale` = (k1 + k2) b1 b2 / 2, k b^2 if symmetric.

        Without free lengths: at those of the control law for this configuration and load.
        """
        lengths = self.free_lengths(self.control(q, load)) if free_lengths is None else free_lengths
        return smallest_eigenvalue(self.stiffness_matrix(q, lengths, load)) / self.stiffness_scale

    # ------------------------------------------------------------------------------------------------- control

    def load_torques(self, q: Sequence[Component], load: Sequence[Component]) -> Components:
        """(J^T F)_i [N m]: the external moment on every segment.

        Raises:
            ValueError: there are not n angles and two components of the load.
        """
        check_count("q", q, self.segments)
        check_count("load", load, 2)
        arms = self._arms(self._links(self._xp(*q, *load), q))
        return tuple(load[1] * x - load[0] * y for x, y in arms)

    def free_lengths(self, delta: Sequence[Component], common: Sequence[Component] | float = 0.0) -> Components:
        """The 2 n free lengths [m] under n control inputs: L0 + common -+ delta for the springs 1 and 2 of a segment.

        Args:
            delta: n control inputs [m]; delta_i > 0 turns segment i towards q_i > 0.
            common: added to both free lengths of a segment [m], one number or n of them: co-contraction where negative.

        Raises:
            ValueError: there are not n control inputs, or neither one number nor n of them in common.
        """
        check_count("delta", delta, self.segments)
        added = self._each(common)
        pairs = zip(delta, added, strict=True)
        return tuple(length for d, c in pairs for length in self.segment.free_lengths(d, c))

    def _each(self, common: Sequence[Component] | float) -> Sequence[Component]:
        """What is added to the free lengths of every segment."""
        if isinstance(common, int | float):
            return [common] * self.segments
        check_count("common", common, self.segments)
        return common

    def control(
        self,
        q: Sequence[Component],
        load: Sequence[Component] | None = None,
        common: Sequence[Component] | float = 0.0,
    ) -> Components:
        """The n control inputs [m] that make q an equilibrium, under a load or without, [Zhao2021, Eqs. 4, 5].

        Eq. 5 prints the external moment with the wrong sign, see `DualTriangleSegment.control`. That q is an
        equilibrium does not make it stable: check `stability_margin`, and `free_length_margin` for free lengths that
        would be negative.

        Raises:
            ValueError: there are not n angles, two components of the load, and one number or n of them in common.
        """
        check_count("q", q, self.segments)
        added = self._each(common)
        moments: Sequence[Component] = [0.0] * self.segments if load is None else self.load_torques(q, load)
        return tuple(
            self.segment.control(qi, moment, extra) for qi, moment, extra in zip(q, moments, added, strict=True)
        )

    def free_length_margin(self, free_lengths: Sequence[Component]) -> Component:
        """The smallest of the free lengths [m]: negative where the inputs cannot be realized."""
        xp = self._xp(*free_lengths)
        smallest = free_lengths[0]
        for length in free_lengths[1:]:
            smallest = xp.minimum(smallest, length)
        return smallest

    # ---------------------------------------------------------------------------------------------- equilibria

    def equilibrium(
        self, free_lengths: Sequence[Component], start: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> _equilibrium.Equilibrium:
        """The equilibrium that the arm reaches from rest at `start`, see `equilibrium.settle`.

        Args:
            free_lengths: 2 n of them [m], each a float or an array of shape (m,).
            start: n angles [rad].
            load: (fx, fy) [N].

        Returns:
            Configuration [rad], residual [N m], is_stable, and the reason in words.

        Raises:
            ValueError: a number is NaN or infinite, or there are not 2 n free lengths and n angles.
        """
        check_finite("free_lengths", free_lengths, 2 * self.segments)
        check_finite("start", start, self.segments)
        check_finite("load", load, 2)

        parameters = (self.design, self.segments, as_components(free_lengths), as_components(load))
        return _equilibrium.settle(_statics, start, parameters, self.design.joint_limit)

    def equilibria(
        self, free_lengths: Sequence[float], load: Sequence[float] = _NO_LOAD
    ) -> list[_equilibrium.Equilibrium]:
        """All equilibria strictly inside the joint limits, stable and unstable, sorted by configuration.

        By intervals from the tip to the base, which exclude all that holds none (`shooting.py`), and Newton's method;
        without a load, by the segments' own. Of equilibria without any stiffness, which form a continuum, one is given,
        as unstable. Where very many boxes can neither be excluded nor told apart (springs that all but hold nothing),
        Newton's method starts from some of them, which need not lead to all.

        Args:
            free_lengths: 2 n of them [m].
            load: (fx, fy) [N].

        Raises:
            ValueError: a number is not finite, there are not 2 n free lengths, or the arm is a batch of designs.
        """
        check_single(self._probe, "equilibria")
        check_finite("free_lengths", free_lengths, 2 * self.segments)
        check_finite("load", load, 2)
        points = candidates(self, free_lengths, load)
        if self.design.springs == "cable" and any(load):
            points = np.concatenate([points, grid_of_starts(self)], axis=1)
        found: list[_equilibrium.Equilibrium] = []
        neutral = False
        for point in polish(self, free_lengths, load, points).T:
            q = tuple(float(value) for value in point)
            gradient, hessian = self.statics(q, free_lengths, load)
            values = np.linalg.eigvalsh(np.array(hessian)) / self.stiffness_scale
            flat = bool(np.abs(values).min() < 1e-9)
            if flat and neutral and self.design.springs == "cable":
                continue
            neutral |= flat
            stable = bool(values[0] >= 1e-9)
            reason = "stable" if stable else "unstable: the stiffness matrix is not positive definite"
            found.append(_equilibrium.Equilibrium(q, float(np.linalg.norm(gradient)), stable, reason))
        return found

    # ---------------------------------------------------------------------------------------- inverse kinematics

    def inverse_kinematics(self, x: float, y: float, *first: float) -> list[InverseSolution]:
        """All configurations with the given first n - 2 angles whose tip is at (x, y) [m], [Zhao2021, Eq. 7].

        The two-link inverse in closed form, for three segments given q1: with (u, v) the target seen from pivot n - 1,
        cos q_n = (u^2 + v^2 - l^2 - b2^2) / (2 l b2), l = b1 + b2. The print has atan for atan2 and lost its
        parentheses; its "5 b^2" is right. Solutions beyond the joint limits are given too, and marked.

        Returns:
            Two solutions, elbow +1 first, one where both are the same, none where the target is out of reach.

        Raises:
            ValueError: a number is not finite, there are not n - 2 angles, the arm has one segment only, or it is a
                batch of designs.
        """
        check_single(self._probe, "inverse_kinematics")
        check_finite("target", (x, y), 2)
        if self.segments < 2:
            raise ValueError("inverse_kinematics: the tip of one segment has no two coordinates to choose")
        check_finite("the first angles", first, self.segments - 2)
        wrist = self.wrist((x, y), first)
        slop = 1e-13 * float(self.link_lengths[-2] + self.link_lengths[-1]) ** 2
        if wrist.stretch < -slop or wrist.folding < -slop:
            return []
        solutions = []
        for elbow in (1, -1) if slop < wrist.stretch and slop < wrist.folding else (0,):
            last = -wrist.angle if elbow < 0 else wrist.angle
            q = (*(float(angle) for angle in first), wrap(self.before_last(wrist, last)), last)
            end = self.tip(q)
            residual = math.hypot(end[0] - x, end[1] - y)
            solutions.append(InverseSolution(q, elbow, bool(self.is_within_limits(q)), self.singularity(q), residual))
        return solutions

    def wrist(self, target: Sequence[Component], first: Sequence[Component]) -> "Wrist":
        """The target (x, y) [m] as the last two links see it, given the first n - 2 angles [rad]. Traceable."""
        xp = self._xp(*target, *first)
        long, short = self.link_lengths[-2:]
        px, py, turn = 1.0 * self.design.b1, 0.0, 0.0
        for angle, length in zip(first, self.link_lengths, strict=False):
            turn = turn + angle
            px, py = px + length * xp.cos(turn), py + length * xp.sin(turn)
        u, v = target[0] - px, target[1] - py
        distance = xp.hypot(u, v)
        # 1 -+ cos q_n by products: no digits are lost where the elbow is stretched or folded
        stretch = (long + short - distance) * (long + short + distance)
        folding = (distance - long + short) * (distance + long - short)
        angle = 2 * xp.atan2(xp.sqrt(xp.maximum(stretch, 0.0)), xp.sqrt(xp.maximum(folding, 0.0)))
        return Wrist(u, v, turn, stretch, folding, angle)

    def before_last(self, wrist: "Wrist", last: Component) -> Component:
        """The last angle but one [rad], not wrapped, given the last one, plus or minus `wrist.angle`. Traceable."""
        xp = self._xp(*wrist)
        long, short = self.link_lengths[-2:]
        bend = xp.atan2(short * xp.sin(last), long + short * xp.cos(last))
        return xp.atan2(wrist.v, wrist.u) - bend - wrist.turn

    def redundancy(
        self,
        x: Component,
        y: Component,
        start: Sequence[Component],
        objective: Objective = "squares",
        joint_limit: Component | None = None,
    ) -> Redundancy:
        """The configuration with the tip at (x, y) that is nearest to a start, by one of three measures.

        "sum" of the joints' displacements [Zhao2021, objective a], the largest of them, "max" (b), or the sum of their
        "squares" (c), minimized over the whole self-motion curve within the joint limits (which the paper's objectives
        ignore), see `redundancy.py`. The optimum jumps along a path of targets, most often for "sum".

        Args:
            x: target [m], a float or an array of shape (m,).
            y: target [m].
            start: (q1, q2, q3) [rad], floats or arrays of shape (m,).
            objective: "sum", "max" or "squares".
            joint_limit: |q_i| is at most this [rad]; None for the design's, infinity for none (displacements are then
                measured the shorter way round).

        Returns:
            Configuration, value of the objective, and for a target that cannot be reached the nearest point that can.

        Raises:
            ValueError: a number is not finite, the objective is not one of the three, the arm has not three segments,
                or its triangles' heights are those of a batch of designs.
        """
        if self.segments != 3:
            raise ValueError(f"redundancy: for three segments, not for {self.segments}")
        check_finite("target", (x, y), 2)
        check_finite("start", start, 3)
        single = not is_batch(x, y, *start, self._probe)
        limit = np.asarray(self.design.joint_limit if joint_limit is None else joint_limit, float)
        if not np.all(limit > 0):
            raise ValueError(f"joint_limit = {joint_limit!r}: must be positive")
        shape = np.broadcast_shapes((1,), np.shape(x), np.shape(y), limit.shape, *(np.shape(s) for s in start))
        px, py, bound = (np.broadcast_to(np.asarray(value, float), shape) for value in (x, y, limit))
        origin = np.stack([np.broadcast_to(np.asarray(value, float), shape) for value in start])
        found = resolve(self._plain_links(), px, py, origin, objective, bound)
        if not single:
            return found
        q, value, reachable, nearest, distance = found
        return Redundancy(
            tuple(float(qi[0]) for qi in q),
            float(value[0]),
            bool(reachable[0]),
            (float(nearest[0][0]), float(nearest[1][0])),
            float(distance[0]),
        )

    def _plain_links(self) -> Links:
        if isinstance(self.design.b1, np.ndarray) or isinstance(self.design.b2, np.ndarray):
            raise ValueError("inverse kinematics takes one set of triangle heights, not a batch of them")
        return Links(float(self.design.b1), float(self.design.b1 + self.design.b2), float(self.design.b2))

    def moore_penrose_step(
        self, q: Sequence[Component], x: Component, y: Component, damping: float = 0.0
    ) -> Components:
        """J^+ (target - tip): the smallest step of the angles [rad] that leads to (x, y) to first order.

        [Zhao2021, Eq. 16] is this pseudo-inverse where J has rank two; at the straight arm, where it is undefined, this
        one steps along what is left of J. One step from near there is of no use: the linear model holds for 0.05 b.

        Args:
            q: n angles [rad], floats or arrays of shape (m,).
            x: target [m].
            y: target [m].
            damping: [m], of damped least squares: J^T (J J^T + damping^2)^-1.
        """
        tip = self.tip(q)
        rows = np.moveaxis(np.array(np.broadcast_arrays(*(e for row in self.jacobian(q) for e in row)), float), 0, -1)
        u, sizes, vt = np.linalg.svd(rows.reshape(*rows.shape[:-1], 2, self.segments), full_matrices=False)
        floor = 1e-12 * np.asarray(self.reach)[..., None]
        factors = np.where(sizes > floor, sizes / (np.maximum(sizes, floor) ** 2 + damping**2), 0.0)
        error = np.stack(np.broadcast_arrays(x - tip[0], y - tip[1]), axis=-1)
        step = np.einsum("...ki,...k,...jk,...j->...i", vt, factors, u, error)
        if is_batch(self._probe, x, y, *q):
            return tuple(np.moveaxis(step, -1, 0))
        return tuple(float(value) for value in step)

    # ----------------------------------------------------------------------------------------- loads and buckling

    def as_bilateral(self) -> "DualTriangle":
        """The same arm with springs that push, too."""
        return DualTriangle(replace(self.design, springs="bilateral"), self.segments)

    def compliance(
        self,
        q: Sequence[Component],
        free_lengths: Sequence[Component] | None = None,
        load: Sequence[Component] = _NO_LOAD,
    ) -> tuple[Components, Components]:
        """J H^-1 J^T [m/N], 2 x 2: how far the tip of the loaded arm yields to a small additional force.

        NaN where the stiffness matrix H is not positive definite. Without free lengths: at those of the control law.
        """
        lengths = self.free_lengths(self.control(q, load)) if free_lengths is None else free_lengths
        hessian = self.stiffness_matrix(q, lengths, load)
        row_x, row_y = self.jacobian(q)
        by_x, pivot, _ = _equilibrium.solve_symmetric(hessian, row_x)
        by_y, _, _ = _equilibrium.solve_symmetric(hessian, row_y)
        xp = namespace_of(pivot)

        def entry(row: Components, answer: Components) -> Component:
            total = row[0] * answer[0]
            for a, b in zip(row[1:], answer[1:], strict=True):
                total = total + a * b
            return xp.where(pivot > 0, total, math.nan)

        cxy = entry(row_x, by_y)
        return (entry(row_x, by_x), cxy), (cxy, entry(row_y, by_y))

    def cartesian_stiffness(
        self,
        q: Sequence[Component],
        free_lengths: Sequence[Component] | None = None,
        load: Sequence[Component] = _NO_LOAD,
    ) -> tuple[Components, Components]:
        """The inverse of `compliance` [N/m], 2 x 2; infinite where the arm is singular, NaN where it is unstable."""
        (cxx, cxy), (_, cyy) = self.compliance(q, free_lengths, load)
        xp = namespace_of(cxx)
        det = cxx * cyy - cxy * cxy
        regular = abs(det) > 1e-14 * (cxx + cyy) * (cxx + cyy)
        none = math.inf + 0.0 * det  # NaN where det is
        det = xp.where(regular, det, 1.0)
        kxx, kxy, kyy = (xp.where(regular, c / det, none) for c in (cyy, -cxy, cxx))
        return (kxx, kxy), (kxy, kyy)

    def straight_critical_loads(self, common: Component = 0.0) -> tuple[Component, ...]:
        """The n axial compressions [N] at which the straight arm loses stability, in one mode after the other.

        P_m = (2 K0 / b) sin^2((2 m - 1) pi / (4 n)) with K0 = k [L0 b - 2 (b^2 - a^2)] of a symmetric segment: in
        closed form for triangles of equal height. P_1 > 0 is condition (2) of [Zhao2021]: under load that guarantees no
        more than a buckling load that is not zero.

        Args:
            common: added to all free lengths [m]; longer ones are stiffer.
        """
        return straight_critical_loads(self, common)

    def critical_load(
        self,
        q: Sequence[Component],
        direction: Sequence[Component],
        common: Sequence[Component] | float = 0.0,
    ) -> Component:
        """The tip force [N] in a direction at which a configuration, held by the control law, loses its stability.

        The control law keeps q an equilibrium under every load, and the Hessian is affine in the force: a generalized
        eigenvalue problem. Stable at a force means stable at every smaller one. (For cables the Hessian is affine
        between the forces at which one becomes slack.) 0 where q is unstable without load, infinity where no force in
        this direction makes it so.

        Args:
            q: n angles [rad], floats or arrays of shape (m,).
            direction: (x, y), of any length.
            common: added to the free lengths [m], one number or n of them.

        Raises:
            ValueError: a number is not finite, or the direction is zero.
        """
        check_finite("q", q, self.segments)
        check_finite("direction", direction, 2)
        xp = self._xp(*q, *direction)
        length = xp.hypot(direction[0], direction[1])
        if not np.all(length > 0):
            raise ValueError(f"direction = {direction!r}: must not be zero")
        unit = direction[0] / length, direction[1] / length
        single = not is_batch(self._probe, *q, *unit)
        if self.design.springs == "bilateral" or single:
            found = critical_load(self, q, unit, common)
            return float(found) if single else found
        shape = np.broadcast_shapes(*(np.shape(value) for value in (*q, *unit)), np.shape(self._probe))
        wide = [np.broadcast_to(np.asarray(value, float), shape).ravel() for value in (*q, *unit)]
        n = self.segments
        answers = [
            critical_load(self.take(i), tuple(float(v) for v in row[:n]), (float(row[n]), float(row[n + 1])), common)
            for i, row in enumerate(zip(*wide, strict=True))
        ]
        return np.array(answers).reshape(shape)

    def load_branch(
        self,
        free_lengths: Sequence[float],
        direction: Sequence[float],
        start: Sequence[float],
        load: float = 0.0,
        max_load: float = math.inf,
        min_load: float = 0.0,
        step: float = 0.02,
        max_points: int = 2000,
    ) -> Branch:
        """Follow an equilibrium under a growing tip force, past folds, where the branch turns back in the load.

        Args:
            free_lengths: 2 n of them [m], kept.
            direction: (x, y) of the force, of any length.
            start: an equilibrium under `load` [rad].
            load: size of the force at the start [N].
            max_load: the branch ends there [N].
            min_load: and there [N].
            step: largest step in (angles [rad], load / (k b)).
            max_points: at most so many points.

        Raises:
            ValueError: a number is not finite, the direction is zero, the start is no equilibrium, or the arm is a
                batch of designs.
        """
        unit = self._unit("load_branch", free_lengths, direction)
        check_finite("start", start, self.segments)
        found = polish(self, free_lengths, (load * unit[0], load * unit[1]), np.array(start, float)[:, None])
        if not found.shape[1] or np.abs(found[:, 0] - np.array(start)).max() > 1e-3:
            raise ValueError(f"start = {start!r}: not an equilibrium under the load {load!r} N")
        z0 = np.append(found[:, 0], load)
        heading = heading_in_load(self, free_lengths, unit, z0)
        return follow_load(self, free_lengths, unit, z0, heading, max_load, min_load, step, max_points)

    def buckled_branch(
        self,
        mode: int = 1,
        side: int = 1,
        common: float = 0.0,
        max_load: float = math.inf,
        step: float = 0.02,
        max_points: int = 2000,
    ) -> Branch:
        """The buckled shapes that branch off the straight arm at its critical load number `mode`.

        Args:
            mode: 1 to n; the branches of the higher ones are unstable.
            side: 1 or -1, sign of q1.
            common: added to all free lengths [m].
            max_load: the branch ends there [N], or where an angle reaches its limit.
            step: largest step in (angles [rad], load / (k b)).
            max_points: at most so many points.

        Returns:
            The branch, its first point the straight arm at the critical load.

        Raises:
            ValueError: there is no such mode or side, or the arm is a batch of designs.
        """
        if mode not in range(1, self.segments + 1):
            raise ValueError(f"mode = {mode!r}: must be in 1 ... {self.segments}")
        if side not in (1, -1):
            raise ValueError(f"side = {side!r}: must be 1 or -1")
        straight = (0.0,) * self.segments
        lengths = self.free_lengths(self.control(straight, None, common), common)
        unit = self._unit("buckled_branch", lengths, (-1.0, 0.0))
        critical = float(self.straight_critical_loads(common)[mode - 1])
        values, vectors = np.linalg.eigh(np.array(self.stiffness_matrix(straight, lengths, (-critical, 0.0)), float))
        shape = vectors[:, np.abs(values).argmin()]
        heading = np.append(shape * (side * np.sign(shape[0])), 0.0)
        z0 = np.append(np.zeros(self.segments), critical)
        return follow_load(self, lengths, unit, z0, heading, max_load, -math.inf, step, max_points)

    def _unit(self, what: str, free_lengths: Sequence[float], direction: Sequence[float]) -> tuple[float, float]:
        check_single(self._probe, what)
        check_finite("free_lengths", free_lengths, 2 * self.segments)
        check_finite("direction", direction, 2)
        length = math.hypot(*direction)
        if length == 0:
            raise ValueError(f"direction = {direction!r}: must not be zero")
        return direction[0] / length, direction[1] / length

    # ------------------------------------------------------------------------------- what measurements reveal

    def estimate_load(self, q: Sequence[Component], free_lengths: Sequence[Component]) -> tuple[Component, Component]:
        """The tip force (fx, fy) [N] under which measured angles are in equilibrium: least squares of J^T F = -M.

        n equations, two unknowns: exact where the angles are. At a singular configuration, the straight arm, the force
        along the links cannot be seen in the torques; the force of smallest norm is given.
        """
        found = estimate_load(self, q, free_lengths)
        if is_batch(self._probe, *q, *free_lengths):
            return found[..., 0], found[..., 1]
        return float(found[0]), float(found[1])

    def identify(self, x: float, y: float, free_lengths: Sequence[float]) -> list[LoadedState]:
        """Every configuration within the limits, with its load, that explains a measured tip under known inputs.

        Five equations (tip, equilibrium) for five unknowns (three angles, two force components): the solutions are the
        stationary points of the springs' energy along the self-motion curve of the tip. Sorted by configuration. Only
        the stable ones can be the state of an arm at rest; there may be several, and none for a tip out of reach.

        Args:
            x: measured tip [m].
            y: measured tip [m].
            free_lengths: six of them [m].

        Raises:
            ValueError: a number is not finite, the arm has not three segments, or it is a batch of designs.
        """
        check_single(self._probe, "identify")
        if self.segments != 3:
            raise ValueError(f"identify: for three segments, not for {self.segments}")
        check_finite("tip", (x, y), 2)
        check_finite("free_lengths", free_lengths, 6)
        return identify(self, float(x), float(y), free_lengths)

    def identify_from(
        self,
        x: Component,
        y: Component,
        free_lengths: Sequence[Component],
        start: Sequence[Component],
        load: Sequence[Component] = _NO_LOAD,
        iterations: int = 20,
    ) -> LoadedState:
        """The solution of `identify` next to a state that was known a step before, by Newton's method, in batches.

        Args:
            x: measured tip [m], a float or an array of shape (m,).
            y: measured tip [m].
            free_lengths: 2 n of them [m].
            start: n angles [rad].
            load: (fx, fy) [N] known before.
            iterations: at most so many steps.

        Returns:
            Configuration, load, stability and residual; NaN where Newton's method did not converge.

        Raises:
            ValueError: a number is not finite, or there are not 2 n free lengths and n angles.
        """
        check_finite("tip", (x, y), 2)
        check_finite("free_lengths", free_lengths, 2 * self.segments)
        check_finite("start", start, self.segments)
        check_finite("load", load, 2)
        single = not is_batch(self._probe, x, y, *free_lengths, *start, *load)
        values = [np.atleast_1d(np.asarray(v, float)) for v in (x, y, *start, *load)]
        shape = np.broadcast_shapes(
            *(v.shape for v in values), *(np.shape(u) for u in free_lengths), np.shape(self._probe)
        )
        wide = [np.broadcast_to(v, shape) for v in values]
        n = self.segments
        q, force, last = correct(
            self, wide[0], wide[1], free_lengths, np.stack(wide[2 : n + 2]), np.stack(wide[n + 2 :]), iterations
        )
        good = last < 1e-8
        q, force = np.where(good, q, np.nan), np.where(good, force, np.nan)
        gradient = self.energy_gradient(tuple(q), free_lengths, tuple(force))
        residual = np.sqrt(sum(np.asarray(g) ** 2 for g in gradient))
        stable = self.stability_margin(tuple(q), free_lengths, tuple(force)) > 0
        if not single:
            return LoadedState(tuple(q), (force[0], force[1]), stable, residual)
        angles = tuple(float(value) for value in q[:, 0])
        return LoadedState(angles, (float(force[0, 0]), float(force[1, 0])), bool(stable[0]), float(residual[0]))


def _statics(q: Components, parameters: Any) -> tuple[Components, tuple[Components, ...]]:
    design, segments, free_lengths, load = parameters
    return DualTriangle(design, segments).statics(q, free_lengths, load)


def wrap(angle: Component) -> Component:
    """The same direction in (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)


def _pairs(free_lengths: Sequence[Component]) -> list[tuple[Component, Component]]:
    return [(free_lengths[i], free_lengths[i + 1]) for i in range(0, len(free_lengths), 2)]
