"""Kinematics of the spatial prism: nodes, members, and the unloaded position in closed form."""

import math
from collections.abc import Sequence

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, is_symbol, namespace_of
from tensegrity_envs.mechanics.design import Member, check_design
from tensegrity_envs.mechanics.spatial_prism import statics
from tensegrity_envs.mechanics.spatial_prism.design import JAHROMY, SpatialPrismDesign
from tensegrity_envs.mechanics.spatial_prism.statics import Pose
from tensegrity_envs.mechanics.spatial_prism.vectors import (
    Matrix,
    add,
    norm,
    rotate,
    scale,
    subtract,
)

_ANGLES = (0.0, 2 * math.pi / 3, 4 * math.pi / 3)
_NO_WRENCH = (0.0, 0.0, 0.0)


class PrismKinematics:
    """Geometry of a spatial prism, or of a batch of them."""

    degrees_of_freedom = 3
    input_names = ("strut 1", "strut 2", "strut 3")

    def __init__(self, design: SpatialPrismDesign = JAHROMY) -> None:
        check_design(design, SpatialPrismDesign, "JAHROMY")
        self.design = design
        d, D = design.d, design.D
        self.base = tuple((D * math.cos(a), D * math.sin(a), 0.0 * D) for a in _ANGLES)
        self.platform = [(d * math.cos(a + math.pi / 6), d * math.sin(a + math.pi / 6), 0.0 * d) for a in _ANGLES]
        # From b_i to p_{i+1} where the centroid is at the origin and A = 1, w_i of [Jahromy, Eq. 30]
        self.offsets = tuple(subtract(self.platform[(i + 1) % 3], self.base[i]) for i in range(3))
        self.least_square = d * d + D * D + math.sqrt(3) * d * D  # c0 [m2]: |w_i|^2
        self.rotational_stiffness = 1.5 * math.sqrt(3) * design.k * d * D  # kappa [N m/rad]

    @property
    def reach(self) -> Component:
        """2.4 D [m]: the longest that the environments make a strut, and more than the centroid's distance then."""
        return 2.4 * self.design.D

    @property
    def members(self) -> tuple[Member, ...]:
        """Springs, struts (actuators) and the platform's cables; the base is fixed."""
        springs = [Member(f"spring {i}", "spring", (f"B{i}", f"P{i}"), stiffness=self.design.k) for i in (1, 2, 3)]
        struts = [Member(f"strut {i}", "actuator", (f"B{i}", f"P{i % 3 + 1}")) for i in (1, 2, 3)]
        cables = [Member(f"cable {i}", "cable", (f"P{i}", f"P{i % 3 + 1}"), keeps_length=True) for i in (1, 2, 3)]
        return (*springs, *struts, *cables)

    def nodes(self, q: Sequence[Component], lengths: Sequence[Component] | None = None) -> dict[str, Components]:
        """Positions (x, y, z) [m], `lengths` not looked at: base B1, B2, B3, platform P1, P2, P3 and its centroid P."""
        arms = rotate(tuple(q[3:]), self.platform)
        places = {f"B{i + 1}": self.base[i] for i in range(3)}
        places |= {f"P{i + 1}": add(q[:3], arms[i]) for i in range(3)}
        return places | {"P": tuple(q[:3])}

    def tip(self, q: Sequence[Component], lengths: Sequence[Component] | None = None) -> Components:
        """The centroid of the platform [m]; `lengths` are those of q and not looked at."""
        return tuple(q[:3])

    def pose(self, q: Sequence[Component]) -> Pose:
        """Where everything is at a configuration."""
        return statics.pose_of(tuple(q[:3]), tuple(rotate(tuple(q[3:]), self.platform)), self.base)

    def strut_lengths(self, q: Sequence[Component]) -> Components:
        """Lengths of the struts [m], [Jahromy, Eq. 16]."""
        return tuple(norm(strut) for strut in self.pose(q).struts)

    def spring_lengths(self, q: Sequence[Component]) -> Components:
        """Lengths of the springs [m]."""
        pose = self.pose(q)
        return tuple(norm(subtract(add(pose.position, pose.arms[i]), pose.base[i])) for i in range(3))

    def strut_clearance(self, q: Sequence[Component]) -> np.ndarray:
        """Smallest distance between the axes of two struts [m], for floats and arrays."""
        pose = self.pose(q)
        starts = [np.stack(np.broadcast_arrays(*b, *h)[:3], axis=-1) for b, h in zip(pose.base, pose.struts)]
        ways = [np.stack(np.broadcast_arrays(*h), axis=-1) for h in pose.struts]
        gaps = [_segment_distance(starts[i], ways[i], starts[i - 1], ways[i - 1]) for i in range(3)]
        return np.asarray(np.minimum.reduce(gaps))

    # ---------------------------------------------------------------------------------------- unloaded kinematics

    def unloaded_lengths(self, position: Sequence[Component]) -> Components:
        """Lengths of the struts [m] that hold the centroid there without a load, [Jahromy, Eq. 30].

        Exact: A = 1 is the energy's only minimum over all orientations, whatever the position.

        Raises:
            ValueError: z = 0, where the prism is singular (floats and arrays; symbols are not looked at).
        """
        if not is_symbol(*position) and not np.all(plain(position[2]) != 0):
            raise ValueError(
                "z = 0: there the struts lie in one plane with the base and hold no height; z must be above or below"
            )
        return tuple(norm(add(position, offset)) for offset in self.offsets)

    def forward_kinematics(self, lengths: Sequence[Component], sheet: Component = 1) -> Components:
        """Position [m] of the centroid of the unloaded prism on one of its two sheets, in closed form.

        (x, y) = sum w_i l_i^2 / (3 c0), z = sheet sqrt(mean l^2 - c0 - x^2 - y^2).

        Args:
            lengths: of the struts [m].
            sheet: 1 for z > 0, -1 for z < 0; it never changes while the prism moves.

        Raises:
            ValueError: no position fits the lengths, or a length is not positive and finite, or sheet is not 1 or -1.
        """
        _check_lengths(lengths)
        if not np.all(np.isin(plain(sheet), (-1, 1))):
            raise ValueError(f"sheet = {sheet!r}: must be 1 (z > 0) or -1 (z < 0)")
        foot, square = self.foot_and_square(lengths)
        _check_feasible(square, lengths, self.least_square)
        xp = namespace_of(square)
        return *foot, sheet * xp.sqrt(xp.maximum(square, 0.0 * square))

    def forward_solutions(self, lengths: Sequence[float]) -> list[tuple[float, float, float]]:
        """Every position of the unloaded prism with these lengths: two, one on the singular plane, or none."""
        _check_lengths(lengths)
        (x, y), square = self.foot_and_square(lengths)
        if square < 0:
            return []
        z = math.sqrt(square)
        return [(float(x), float(y), z), (float(x), float(y), -z)] if z > 0 else [(float(x), float(y), 0.0)]

    def foot_and_square(self, lengths: Sequence[Component]) -> tuple[Components, Component]:
        """(x, y) [m] of the unloaded prism, and z^2 [m2], negative where no position fits the lengths. Traceable."""
        first, second, third = (length * length for length in lengths)
        x, y = (
            (self.offsets[0][a] * first + self.offsets[1][a] * second + self.offsets[2][a] * third)
            / (3 * self.least_square)
            for a in (0, 1)
        )
        return (x, y), (first + second + third) / 3 - self.least_square - x * x - y * y

    def strut_jacobian(self, position: Sequence[Component]) -> Matrix:
        """Rows d l_i / d r of the unloaded prism [-]: the struts' directions."""
        struts = [add(position, offset) for offset in self.offsets]
        rows = [scale(1 / norm(strut), strut) for strut in struts]
        return rows[0], rows[1], rows[2]

    def strut_determinant(self, position: Sequence[Component]) -> Component:
        """Determinant of `strut_jacobian` [-]: z (3 sqrt3 / 2) c0 / (l1 l2 l3); zero on the plane z = 0 alone."""
        product: Component = 1.0
        for offset in self.offsets:
            product = product * norm(add(position, offset))
        return 1.5 * math.sqrt(3) * self.least_square * position[2] / product


def plain(value: Component) -> np.ndarray:
    """Numbers to look at, of a tensor too."""
    return np.asarray(value.detach() if hasattr(value, "detach") else value, float)


def _check_lengths(lengths: Sequence[Component]) -> None:
    for i, length in enumerate(lengths, 1):
        if not np.all(np.isfinite(plain(length)) & (plain(length) > 0)):
            raise ValueError(f"length {i} of the struts = {length!r}: must be positive and finite [m]")


def _check_feasible(square: Component, lengths: Sequence[Component], least: Component) -> None:
    values = plain(square)
    if (values >= 0).all():
        return
    worst = np.broadcast_arrays(values, *(plain(length) for length in lengths))
    given = tuple(float(v.ravel()[np.argmin(values)]) for v in worst[1:])
    raise ValueError(
        f"lengths {given} of the struts fit no position: z^2 would be {float(values.min()):.3g} m^2. "
        f"The mean of their squares must be at least c0 + x^2 + y^2, c0 = {float(np.max(plain(least))):.6g} m^2: "
        "lengthen the struts, or make them more equal"
    )


def _segment_distance(p: np.ndarray, u: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Distance between segments p + s u and q + t v, s and t in [0, 1], arrays (..., 3): inside, or at some end."""
    gap = p - q

    def inner(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.asarray((a * b).sum(axis=-1))

    uu, vv, uv, ug, vg = inner(u, u), inner(v, v), inner(u, v), inner(u, gap), inner(v, gap)
    area = uu * vv - uv * uv
    safe = np.where(area > 1e-14 * uu * vv, area, 1.0)
    s = np.where(area > 1e-14 * uu * vv, (uv * vg - vv * ug) / safe, 0.0)
    pairs = [(s, np.clip((vg + s * uv) / vv, 0, 1))]
    pairs += [(end + 0 * s, np.clip((vg + end * uv) / vv, 0, 1)) for end in (0.0, 1.0)]
    pairs += [(np.clip((end * uv - ug) / uu, 0, 1), end + 0 * s) for end in (0.0, 1.0)]
    pairs = [(np.clip(a, 0, 1), b) for a, b in pairs]
    distances = [np.sqrt(inner(d, d)) for a, b in pairs for d in [gap + a[..., None] * u - b[..., None] * v]]
    return np.asarray(np.minimum.reduce(distances))
