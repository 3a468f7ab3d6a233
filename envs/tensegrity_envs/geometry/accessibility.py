"""The plain 2-X (no offsets): its workspace by number and type of inverse solutions, cuspidality, posture changes.

[Furet2018] in full, for any b and L: boundary (Fig. 3), the inverse solutions (Fig. 4), regions by number of solutions
and by the up/down states of the two joints (Fig. 6), joint limits (Fig. 7, whose three-solution slivers the paper
misses), cusps and nodes, the cuspidality theorem. The functions also take an arm with offsets, whose singular curves
have no such closed theory; for it `joint_limit` must be at most pi.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import shapely
from numpy.typing import ArrayLike

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.geometry import aspects as generic
from tensegrity_envs.geometry import singularity
from tensegrity_envs.geometry.aspects import Aspects, PosturePath
from tensegrity_envs.geometry.overlay import chord_area, cut, feature, union
from tensegrity_envs.geometry.singularity import Cusp, Node, zero_curves
from tensegrity_envs.mechanics.two_x import TwoX

PI = math.pi
FULL_TURN = 4 * PI  # of alpha: theta = alpha / 2 runs once around
_CUT = np.array([-2 * PI + 0.3217, -2 * PI + 0.4793])  # of the torus
_CHORDS = 64  # of a smooth curve before it is refined


def is_cuspidal(b: float, l: float) -> bool:
    """Whether the plain 2-X has cusps, and so changes its posture without a singularity: b < l < b sqrt(6).

    The theorem of [Furet2018, section 4], for joints without limits. At l = b sqrt(6) two cusps and the node
    meet in one point (swallowtail) above the upright pose.

    Raises:
        ValueError: b or l is not a positive finite number, or l <= b, which cannot be assembled.
    """
    if not (math.isfinite(b) and math.isfinite(l) and b > 0):
        raise ValueError(f"b = {b!r}, l = {l!r}: must be positive, finite lengths")
    if l <= b:
        raise ValueError(f"l = {l!r}: must be greater than b = {b!r} (else the X-joints cannot be assembled)")
    return l < b * math.sqrt(6)


def singular_factor(mechanism: TwoX) -> Callable[[Components], Component]:
    """A function whose simple zeros are the singular curves.

    det J itself with offsets. Without, det J has a factor that vanishes on the lines alpha_1 + alpha_2 = +-2 pi, where
    the tip stays at the base whatever the joints do (a self-motion: their image is one point). Divided by
    cos((alpha_1 + alpha_2) / 4) what is left has the one curve whose image bounds the workspace.
    """
    if mechanism.design.a:
        return mechanism.jacobian_determinant

    def quotient(q1: Component, q2: Component) -> Component:
        return mechanism.jacobian_determinant((q1, q2)) / np.cos((q1 + q2) / 4)

    def factor(q: Sequence[Component]) -> Component:
        q1, q2 = np.broadcast_arrays(np.asarray(q[0], float), np.asarray(q[1], float))
        close = np.abs(np.cos((q1 + q2) / 4)) < 1e-4
        value = np.asarray(quotient(q1, np.where(close, q2 + 1.0, q2)))
        if close.any():  # 0 / 0 on the line: a smooth function's value from its neighbours on both sides, error 1e-11
            q1, q2, h = q1[close], q2[close], 2e-3
            near, far = (quotient(q1, q2 + s) + quotient(q1, q2 - s) for s in (h, 2 * h))
            value[close] = (4 * near - far) / 6
        return value

    return factor


def is_full_torus(mechanism: TwoX) -> bool:
    """Whether the joints can turn full circle."""
    return bool(mechanism.design.joint_limit >= 2 * math.pi * (1 - 1e-12))


K = TypeVar("K", int, str)


@dataclass(frozen=True)
class Accessible:
    """A region of the workspace in which the number and the types of the inverse solutions are constant.

    Attributes:
        polygon: of the tip [m].
        states: of each solution, sorted: "U" (up) or "D" (down) for joint 1 and joint 2, such as ("UD", "UU").
    """

    polygon: shapely.Polygon
    states: tuple[str, ...]

    @property
    def count(self) -> int:
        """Number of inverse solutions."""
        return len(self.states)

    @property
    def types(self) -> str:
        """Such as "2 UU + 1 UD"; "" where nothing reaches."""
        numbers = Counter(self.states)
        return " + ".join(f"{numbers[state]} {state}" for state in ("UU", "UD", "DU", "DD") if numbers[state])


@dataclass(frozen=True)
class Accessibility:
    """The workspace of a 2-X cut along its singular, flat-joint and joint-limit curves.

    Attributes:
        mechanism: of which it is.
        regions: with constant number and types of inverse solutions; unreachable holes have none.
        singular: singular curves in joint space, chains of shape (n, 2) [rad]. On the full torus their angles are in
            one period, which begins somewhat above -2 pi; see `wrapped`.
        flat: curves with a flat joint |alpha_i| = pi in joint space, by name, such as "alpha_1 = pi".
        limits: edges of the joint space at the joint limits, empty on the full torus.
        cusps, nodes: of the singular curves' images.
        area_error: estimate for any of the areas, from the chords of all curves [m2].
    """

    mechanism: TwoX
    regions: tuple[Accessible, ...]
    singular: tuple[np.ndarray, ...]
    flat: dict[str, np.ndarray]
    limits: tuple[np.ndarray, ...]
    cusps: tuple[Cusp, ...]
    nodes: tuple[Node, ...]
    area_error: float

    @cached_property
    def by_count(self) -> dict[int, shapely.Geometry]:
        """Shapely geometry of the points with each number of solutions."""
        return self._merged(lambda region: region.count)

    @cached_property
    def by_type(self) -> dict[str, shapely.Geometry]:
        """Shapely geometry of the points with each combination of solution types, by `Accessible.types`."""
        return self._merged(lambda region: region.types)

    def _merged(self, key: Callable[[Accessible], K]) -> dict[K, shapely.Geometry]:
        reached = [region for region in self.regions if region.count]
        keys = sorted({key(region) for region in reached})
        return {k: union([region.polygon for region in reached if key(region) == k]) for k in keys}

    def area(self, count: int) -> float:
        """Area of the points with exactly `count` inverse solutions [m2]."""
        return float(self.by_count[count].area) if count in self.by_count else 0.0

    def parts(self, count: int) -> list[shapely.Polygon]:
        """The connected regions with `count` inverse solutions, largest first."""
        found = shapely.get_parts(self.by_count.get(count, shapely.Polygon()))
        return sorted((part for part in found if not part.is_empty), key=lambda part: -part.area)

    def to_features(self) -> list[dict[str, Any]]:
        """GeoJSON features: regions by types of solutions, singular and flat curves, cusps and nodes [m]."""
        found = [
            feature(
                shape, {"solutions": types, "count": sum(int(t[0]) for t in types.split(" + ")), "area": shape.area}
            )
            for types, shape in self.by_type.items()
        ]
        curves = [("singular", chain) for chain in self.singular] + list(self.flat.items())
        curves += [("joint limit", chain) for chain in self.limits]
        for name, chain in curves:
            found.append(feature(shapely.LineString(tip_curve(self.mechanism, chain)), {"curve": name}))
        found += [
            feature(shapely.Point(cusp.tip), {"point": "cusp", "configuration": cusp.configuration})
            for cusp in self.cusps
        ]
        found += [
            feature(shapely.Point(node.tip), {"point": "node", "configurations": node.configurations})
            for node in self.nodes
        ]
        return found


def wrapped(chain: np.ndarray) -> list[np.ndarray]:
    """A chain on the full torus in pieces with all angles in (-2 pi, 2 pi], for drawing."""
    inside = FULL_TURN / 2 - (FULL_TURN / 2 - chain) % FULL_TURN
    jumps = np.flatnonzero((np.abs(np.diff(inside, axis=0)) > FULL_TURN / 2).any(axis=1))
    return [piece for piece in np.split(inside, jumps + 1) if len(piece) > 1]


def summary(found: Accessibility) -> dict[str, float | int | bool | str]:
    """The numbers of a workspace: areas and parts by number and type of solutions, cusps and nodes."""
    design = found.mechanism.design
    numbers: dict[str, float | int | bool | str] = {}
    if not design.a and is_full_torus(found.mechanism):
        numbers["cuspidal (b < l < b sqrt 6)"] = is_cuspidal(float(design.b), float(design.l))
    for count, shape in found.by_count.items():
        numbers[f"area with {count} solution{'s' if count > 1 else ''} [m2]"] = shape.area
        numbers[f"regions with {count} solution{'s' if count > 1 else ''}"] = len(found.parts(count))
    numbers["area error [m2]"] = found.area_error
    for types, shape in found.by_type.items():
        numbers[f"area with {types} [m2]"] = shape.area
    if found.by_count:
        x0, y0, x1, y1 = union([region.polygon for region in found.regions if region.count]).bounds
        numbers |= {"smallest x [m]": x0, "largest x [m]": x1, "smallest y [m]": y0, "largest y [m]": y1}
    critical: list[tuple[str, Sequence[Cusp | Node]]] = [("cusp", found.cusps), ("node", found.nodes)]
    for what, points in critical:
        numbers[f"{what}s"] = len(points)
        for k, point in enumerate(points):
            numbers[f"{what} {k + 1} [m]"] = f"({point.tip[0]:.12f}, {point.tip[1]:.12f})"
    return numbers


def tip_curve(mechanism: TwoX, configurations: np.ndarray) -> np.ndarray:
    """Tip positions of a chain of configurations, shape (n, 2)."""
    return np.stack(mechanism.tip((configurations[:, 0], configurations[:, 1])), axis=1)


def straight_line(
    mechanism: TwoX,
    start: Sequence[float],
    end: Sequence[float],
    through: ArrayLike = (),
    tolerance: float = 1e-6,
) -> np.ndarray:
    """Configurations on a straight line of the joint space, close enough for the chords of their tips.

    Args:
        mechanism: whose tips they are.
        start, end: configurations [rad].
        through: configurations on the line that must be among them, bit by bit, shape (n, 2).
        tolerance: of the tip's curve to its chords, relative to the reach.
    """
    p, q = np.array(start, float), np.array(end, float)
    t = np.linspace(0.0, 1.0, _CHORDS + 1)
    while True:
        middle = (t[1:] + t[:-1]) / 2
        ends, tips = tip_curve(mechanism, p + t[:, None] * (q - p)), tip_curve(mechanism, p + middle[:, None] * (q - p))
        far = np.hypot(*(tips - (ends[1:] + ends[:-1]) / 2).T) > tolerance * mechanism.reach
        if not far.any() or len(t) > 100_000:
            break
        t = np.sort(np.concatenate([t, middle[far]]))
    fixed = np.asarray(through, float).reshape(-1, 2)
    points = np.concatenate([p + t[:, None] * (q - p), fixed])
    place = np.concatenate([t, (fixed - p) @ (q - p) / ((q - p) @ (q - p))])
    return np.asarray(points[np.argsort(place, kind="stable")])


def _meet(
    factor: Callable[[Components], Component], chains: list[np.ndarray], fixed: int, angle: float
) -> tuple[list[np.ndarray], np.ndarray]:
    """Singular curves with a point wherever they meet the line alpha_(fixed + 1) = angle, and these points.

    In the workspace every curve that crosses a fold of the joint space touches the fold's image. Chords of touching
    curves may miss one another; a common point does not.
    """
    found, changed = [], []
    for chain in chains:
        side = chain[:, fixed] - angle
        on_it = np.flatnonzero(side == 0)
        found += [chain[i] for i in on_it]
        at = np.flatnonzero(side[1:] * side[:-1] < 0)
        share = side[at] / (side[at] - side[at + 1])
        s = chain[at, 1 - fixed] + share * (chain[at + 1, 1 - fixed] - chain[at, 1 - fixed])

        def value(s: np.ndarray, angle: float = angle) -> np.ndarray:
            return np.asarray(factor((np.full(len(s), angle), s) if fixed == 0 else (s, np.full(len(s), angle))))

        for _ in range(6 if len(at) else 0):
            slope = (value(s + 1e-6) - value(s - 1e-6)) / 2e-6
            s = s - np.clip(value(s) / np.where(slope == 0, np.inf, slope), -1e-3, 1e-3)
        points = np.empty((len(at), 2))
        points[:, fixed], points[:, 1 - fixed] = angle, s
        found += list(points)
        changed.append(np.insert(chain, at + 1, points, axis=0))
    return changed, np.array(found).reshape(-1, 2)


def accessibility(mechanism: TwoX, resolution: int = 256, tolerance: float = 1e-6) -> Accessibility:
    """The workspace by number and type of inverse solutions, within the design's joint limits.

    Args:
        mechanism: of one design; with offsets its joint limit must be at most pi.
        resolution, tolerance: of the singular curves, see `Region.trace`.

    Raises:
        ValueError: the mechanism is a batch of designs, or has offsets and may turn down.
    """
    design = mechanism.design
    if any(isinstance(value, np.ndarray) for value in vars(design).values()):
        raise ValueError("a workspace belongs to one design, not to a batch of them")
    limit = float(design.joint_limit)
    if design.a and limit > math.pi:
        raise ValueError(f"joint_limit = {limit!r}: must be at most pi for an arm with offsets")
    factor = singular_factor(mechanism)
    torus = is_full_torus(mechanism)
    # The torus is cut open where nothing is special, so that curves cross the cut at simple points.
    low, high = (np.full(2, -limit), np.full(2, limit)) if not torus else (_CUT, _CUT + FULL_TURN)
    chains = zero_curves(factor, (tuple(low), tuple(high)), mechanism.tip, resolution, tolerance)
    lines: list[tuple[str, int, float]] = []
    if limit > math.pi:
        lines += [(f"alpha_{i + 1} = {name}", i, angle) for i in (0, 1) for name, angle in (("pi", PI), ("-pi", -PI))]
    if not torus:
        lines += [("limit", i, angle) for i in (0, 1) for angle in (-limit, limit)]
    meeting = []
    for _, i, angle in lines:
        chains, points = _meet(factor, chains, i, angle)
        meeting.append(points)
    flat: dict[str, np.ndarray] = {}
    limits: list[np.ndarray] = []
    for (name, i, angle), points in zip(lines, meeting, strict=True):
        ends = [(angle, s) if i == 0 else (s, angle) for s in (float(low[1 - i]), float(high[1 - i]))]
        others = [other for _, k, other in lines if k != i]
        if not design.a:  # without offsets it also meets the self-motion, at the base
            others += [2 * PI - angle, -2 * PI - angle]
        others = [s for s in others if low[1 - i] <= s <= high[1 - i]]
        crossed = np.array([(angle, s) if i == 0 else (s, angle) for s in others]).reshape(-1, 2)
        line = straight_line(mechanism, ends[0], ends[1], np.concatenate([points, crossed]), tolerance)
        if name == "limit":
            limits.append(line)
        else:
            flat[name] = line
    singular = chains
    images = [tip_curve(mechanism, chain) for chain in (*singular, *flat.values(), *limits)]
    polygons = cut(images)
    base = shapely.Point(0, 0).buffer(1e-3 * mechanism.reach)  # reached by a self-motion, unlike the points around it
    spots = [p.difference(base) if p.contains(shapely.Point(0, 0)) else p for p in polygons]
    inside = np.array([[*spot.representative_point().coords[0]] for spot in spots]).reshape(-1, 2)
    regions: list[Accessible] = []
    if len(inside):
        a1, a2 = mechanism.inverse_kinematics_batch(*inside.T)
        for k, polygon in enumerate(polygons):
            reached = ~np.isnan(a1[k])
            ups = zip(np.abs(a1[k][reached]) < math.pi, np.abs(a2[k][reached]) < math.pi, strict=True)
            regions.append(Accessible(polygon, tuple(sorted("DU"[int(u)] + "DU"[int(v)] for u, v in ups))))
    found_cusps = singularity.cusps(mechanism, singular, factor)
    found_nodes = singularity.nodes(mechanism, singular, factor)
    if torus:
        found_cusps = [Cusp(c.tip, _wrap(c.configuration)) for c in found_cusps]
        found_nodes = [Node(n.tip, (_wrap(n.configurations[0]), _wrap(n.configurations[1]))) for n in found_nodes]
    return Accessibility(
        mechanism,
        tuple(regions),
        tuple(singular),
        flat,
        tuple(limits),
        tuple(found_cusps),
        tuple(found_nodes),
        sum(chord_area(curve)[1] for curve in images),
    )


def _wrap(q: tuple[float, float]) -> tuple[float, float]:
    a1, a2 = (FULL_TURN / 2 - (FULL_TURN / 2 - angle) % FULL_TURN for angle in q)
    return a1, a2


def aspects(mechanism: TwoX, resolution: int = 400) -> Aspects:
    """The aspects of a 2-X within its joint limits, see `aspects.aspects`."""
    limit = float(mechanism.design.joint_limit)
    return generic.aspects(mechanism, limit, FULL_TURN if is_full_torus(mechanism) else None, resolution)


def posture_change(
    mechanism: TwoX, start: tuple[float, float], goal: tuple[float, float], longest_step: float = 0.05
) -> PosturePath:
    """A path between two configurations (alpha_1, alpha_2) [rad] of one aspect that never meets det J = 0.

    On the full torus the path is continuous, so that its end may differ from the goal by multiples of 4 pi.

    Raises:
        ValueError: see `aspects.posture_change`.
    """
    limit = float(mechanism.design.joint_limit)
    period = FULL_TURN if is_full_torus(mechanism) else None
    return generic.posture_change(mechanism, start, goal, limit, period, longest_step)


def posture_pairs(mechanism: TwoX, x: float, y: float) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Pairs of inverse solutions of one tip position with det J of the same sign.

    Where the mechanism has just two aspects, as the plain 2-X on the full torus, these are in one aspect.
    """
    found = mechanism.inverse_kinematics(x, y)
    return [
        (p.configuration, q.configuration)
        for i, p in enumerate(found)
        for q in found[i + 1 :]
        if p.singularity * q.singularity > 0
    ]
