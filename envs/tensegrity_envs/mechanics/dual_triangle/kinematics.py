"""Kinematics of the arm of dual-triangles: nodes, members, tip, Jacobian, springs and joint limits."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, Namespace, is_batch, namespace_of
from tensegrity_envs.mechanics.design import Index, Member, check_design, take
from tensegrity_envs.mechanics.dual_triangle.design import ZHAO2021_CAPTION, DualTriangleDesign
from tensegrity_envs.mechanics.dual_triangle.redundancy import Links
from tensegrity_envs.mechanics.dual_triangle.segment import DualTriangleSegment
from tensegrity_envs.mechanics.dual_triangle.segment_statics import Springs


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


class DualTriangleKinematics:
    """Geometry of an arm of one design, or of a batch of designs."""

    def __init__(self, design: DualTriangleDesign = ZHAO2021_CAPTION, segments: int = 3) -> None:
        if isinstance(segments, bool) or not isinstance(segments, int | np.integer):
            raise TypeError(f"segments = {segments!r}: must be an integer")
        segments = int(segments)
        if segments < 1:
            raise ValueError(f"segments = {segments!r}: must be 1 or more")
        check_design(design, DualTriangleDesign, "ZHAO2021_CAPTION")
        first, *others = design.of_segments(segments)
        self.design = design
        self.segments = self.degrees_of_freedom = segments
        self.input_names = tuple(f"{side} {i + 1}" for i in range(segments) for side in ("upper", "lower"))
        self._first = DualTriangleSegment(first)
        # Of segments that differ, the others; of equal ones none, since they are all the first one.
        self._others = () if design.segments is None else tuple(map(DualTriangleSegment, others))
        self.stiffness_scale = self._first.stiffness_scale  # [N m/rad]; of segment 1
        self._probe: Component = sum((other._probe for other in self._others), start=self._first._probe)
        heights = list(zip(design.each("b1", segments), design.each("b2", segments), strict=True))
        self.base_height = heights[0][0]  # [m]: x of pivot 1
        gaps = [following[0] + here[1] for here, following in pairwise(heights)]
        self.link_lengths = (*gaps, heights[-1][1])  # from pivot 1 to the tip [m]

    @property
    def chain(self) -> tuple[DualTriangleSegment, ...]:
        """The segments, from the base on; where they are equal, one and the same object."""
        return (self._first, *self._others) if self._others else (self._first,) * self.segments

    @property
    def segment(self) -> DualTriangleSegment:
        """The segment that all segments are.

        Raises:
            ValueError: they differ.
        """
        if self._others:
            raise ValueError("segment: the segments of this arm differ; they are chain[0], chain[1], ...")
        return self._first

    @property
    def control_limit(self) -> float:
        """The angle [rad] to which the unloaded control law reaches in every segment, see `DualTriangleSegment`.

        Raises:
            ValueError: the arm is a batch of designs.
        """
        return min(one.control_limit for one in (self._first, *self._others))

    def take(self, index: Index) -> Self:
        """The arms at `index` of a batch of designs; itself where there is one design only."""
        return take(self, index)

    @property
    def reach(self) -> Component:
        """Distance of the straight arm's tip from the base side A-B [m], 6 b of three symmetric segments."""
        return self.base_height + sum(self.link_lengths)

    def _xp(self, *components: Component) -> Namespace:
        return namespace_of(self._probe, *components)

    def _shape(self, xp: Namespace, q: Sequence[Component]) -> _Shape:
        springs: list[Springs] = []
        links: list[tuple[Component, Component]] = []
        for qi, length, segment in zip(q, self.link_lengths, self.chain, strict=True):
            s, c = xp.sin(qi / 2), xp.cos(qi / 2)
            springs.append(segment.springs_at(xp, s, c))
            sin, cos = 2 * s * c, (c - s) * (c + s)
            if not links:
                direction = cos, sin
            else:
                direction = direction[0] * cos - direction[1] * sin, direction[1] * cos + direction[0] * sin
            links.append((length * direction[0], length * direction[1]))
        return _Shape(tuple(springs), tuple(links))

    def _links(self, xp: Namespace, q: Sequence[Component]) -> list[tuple[Component, Component]]:
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

    def tip(self, q: Sequence[Component], inputs: Sequence[Component] | None = None) -> tuple[Component, Component]:
        """Tip position (x, y) [m], [Zhao2021, Eq. 6] (x = b + 2b C1 + 2b C12 + b C123; the print loses a digit)."""
        x, y = self._arms(self._links(self._xp(*q), q))[0]
        return self.base_height + x, y

    def jacobian(
        self, q: Sequence[Component], inputs: Sequence[Component] | None = None, load: Sequence[Component] | None = None
    ) -> tuple[Components, Components]:
        """d tip / d q [m/rad]: two rows of n entries, [Zhao2021, Eq. 9] (whose first row lost J13 = -b S123)."""
        arms = self._arms(self._links(self._xp(*q), q))
        return tuple(-y for _, y in arms), tuple(x for x, _ in arms)

    def jacobian_determinant(
        self, q: Sequence[Component], inputs: Sequence[Component] | None = None, load: Sequence[Component] | None = None
    ) -> Component:
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

    def nodes(
        self, q: Sequence[Component], inputs: Sequence[Component] | None = None
    ) -> dict[str, tuple[Component, Component]]:
        """Positions (x, y) [m] of the nodes.

        Oi the pivot of segment i; Ai, Bi the corners of its base triangle and Di, Ci those of its moving triangle on
        the +y and -y side of the straight arm; P the tip, midpoint of the last Di, Ci.
        """
        xp = self._xp(*q)
        x, y = 0.0 * q[0], 0.0 * q[0]
        cos, sin = 1.0, 0.0
        nodes: dict[str, tuple[Component, Component]] = {}
        turn = 0.0
        for i, (qi, segment) in enumerate(zip(q, self.chain, strict=True), 1):
            design = segment.design
            x, y = x + design.b1 * cos, y + design.b1 * sin
            nodes[f"O{i}"] = x, y
            for name, side in ((f"A{i}", design.a1), (f"B{i}", -design.a1)):
                nodes[name] = x - design.b1 * cos - side * sin, y - design.b1 * sin + side * cos
            turn = turn + qi
            cos, sin = xp.cos(turn), xp.sin(turn)
            for name, side in ((f"D{i}", design.a2), (f"C{i}", -design.a2)):
                nodes[name] = x + design.b2 * cos - side * sin, y + design.b2 * sin + side * cos
            x, y = x + design.b2 * cos, y + design.b2 * sin
        nodes["P"] = x, y
        return nodes

    @property
    def members(self) -> tuple[Member, ...]:
        """The sides of the triangles as bars, and the springs, whose free lengths are the inputs."""
        members: list[Member] = []
        for i in range(1, self.segments + 1):
            for name, corners in ((f"base {i}", ("A", "B")), (f"moving {i}", ("D", "C"))):
                first, second, pivot = f"{corners[0]}{i}", f"{corners[1]}{i}", f"O{i}"
                members += [
                    Member(f"{name} side", "bar", (first, second)),
                    Member(f"{name} upper edge", "bar", (first, pivot)),
                    Member(f"{name} lower edge", "bar", (second, pivot)),
                ]
        for i, segment in enumerate(self.chain, 1):
            design = segment.design
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
        both = zip(q, self.chain, strict=True)
        return tuple(length for qi, segment in both for length in segment.spring_lengths(qi))

    def spring_forces(self, q: Sequence[Component], free_lengths: Sequence[Component]) -> Components:
        """Tensions of the springs [N], in the order of the free lengths; negative where a bilateral spring pushes."""
        each = zip(q, pairs(free_lengths), self.chain, strict=True)
        return tuple(force for qi, pair, segment in each for force in segment.spring_forces(qi, pair))

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

    @property
    def has_plain_links(self) -> bool:
        """Whether it has three segments, of which links 1 and 2 are equally long: then its curves are closed forms."""
        return self.segments == 3 and bool(np.all(np.equal(*self.link_lengths[:2])))

    def _plain_links(self) -> Links:
        if any(isinstance(length, np.ndarray) for length in (self.base_height, *self.link_lengths)):
            raise ValueError("inverse kinematics takes one set of triangle heights, not a batch of them")
        return Links(float(self.base_height), float(self.link_lengths[0]), float(self.link_lengths[-1]))

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

    def wrist(self, target: Sequence[Component], first: Sequence[Component]) -> Wrist:
        """The target (x, y) [m] as the last two links see it, given the first n - 2 angles [rad]. Traceable."""
        xp = self._xp(*target, *first)
        long, short = self.link_lengths[-2:]
        px, py, turn = 1.0 * self.base_height, 0.0, 0.0
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

    def before_last(self, wrist: Wrist, last: Component) -> Component:
        """The last angle but one [rad], not wrapped, given the last one, plus or minus `wrist.angle`. Traceable."""
        xp = self._xp(*wrist)
        long, short = self.link_lengths[-2:]
        bend = xp.atan2(short * xp.sin(last), long + short * xp.cos(last))
        return xp.atan2(wrist.v, wrist.u) - bend - wrist.turn


def pairs(free_lengths: Sequence[Component]) -> list[tuple[Component, Component]]:
    """The free lengths as pairs, one for each segment."""
    return [(free_lengths[i], free_lengths[i + 1]) for i in range(0, len(free_lengths), 2)]
