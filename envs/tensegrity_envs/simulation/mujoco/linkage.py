"""Which bars of a planar mechanism make one rigid body, and how the bodies hang together, found from its nodes.

Nothing about a mechanism is written down a second time: its nodes at many configurations tell which of them move as one
body, which stay at rest, and where bodies share a point (a hinge). A tree of hinges from the ground reaches every body;
hinges outside the tree close loops. Positions are complex numbers x + i y [m] here.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from itertools import product as pairs_of
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_envs.compiler.kernel import Kernel
from tensegrity_envs.compiler.namespace import Component, Components, namespace_of
from tensegrity_envs.compiler.pytree import Schema, is_array, tree_leaves
from tensegrity_envs.mechanics.design import Member
from tensegrity_envs.mechanics.polynomials import product

FLIP_LIMIT = 2.6  # |q| [rad] up to which the crossed assembly of a loop is kept by joint limits
_SAME = 1e-9  # relative: positions that differ by less are one
_SAMPLES = 40


@dataclass(frozen=True)
class Body:
    """A rigid body.

    Attributes:
        nodes: the names of its nodes.
        bars: the bars that it is made of.
        frame: the two nodes, far apart, that tell its orientation.
        parent: the body, by index, that carries it; -1 of the ground.
        hinge: the node in which it turns on its parent; of the ground any.
    """

    nodes: tuple[str, ...]
    bars: tuple[Member, ...]
    frame: tuple[str, str]
    parent: int = -1
    hinge: str = ""


@dataclass(frozen=True)
class Loop:
    """A hinge outside the tree: the node (by its name on either side) in which two bodies meet."""

    first: int
    first_node: str
    second: int
    second_node: str


def usual_radius(members: Iterable[Member], extent: float) -> float:
    """Of bars without one of their own [m]: that of the thickest, or a share of the mechanism's extent [m]."""
    return max((member.radius for member in members if member.is_rigid), default=0.0) or 0.008 * extent


class Linkage:
    """The rigid bodies of a planar mechanism, a tree of hinges, and the loops.

    Joint angles [rad] are those of the children against their parents, counter-clockwise, zero at the configuration
    q = 0; one for every body but the ground.

    Args:
        mechanism: with `degrees_of_freedom`, `nodes(q)`, `members` and `design.joint_limit`, or, where hinges have no
            stops, `turns_freely`.

    Raises:
        ValueError: it is a batch of designs, is not planar, or its configuration is not linear in the joint angles.

    Attributes:
        bodies: the ground, then each body after its parent, depth first.
        loops: hinges outside the tree.
        space: dimensions of positions and forces.
        joints: names of the hinges, in the order of the bodies.
        ranges: lowest and highest joint angle within the joint limits [rad], shape (bodies - 1, 2); None without stops.
        reading: q = reading @ joint angles, shape (degrees of freedom, bodies - 1).
        limit: |q| is at most this [rad]; infinite without stops.
        reference: nodes at q = 0 [m].
        length: no node is farther from the base [m].
        extent: what is this close to the base is in the picture [m].
    """

    space = 2

    def __init__(self, mechanism: Any) -> None:
        self.mechanism = mechanism
        if any(np.ndim(value) for value in tree_leaves(mechanism.design, is_array)):
            raise ValueError(f"{type(mechanism).__name__}: takes one design, not a batch of them")
        self.size = int(mechanism.degrees_of_freedom)
        turns_freely = getattr(mechanism, "turns_freely", False)
        span = FLIP_LIMIT if turns_freely else min(float(np.min(mechanism.design.joint_limit)), FLIP_LIMIT)
        self.limit = np.inf if turns_freely else span
        inside = np.random.default_rng(0).uniform(-span, span, (_SAMPLES, self.size))
        corners = np.array(list(pairs_of((-span, 0.0, span), repeat=self.size)))
        samples = np.concatenate([inside, corners])
        nodes = self._nodes_at(samples)
        self.reference = self.nodes_of(mechanism)
        self.length = max(abs(z).max() for z in nodes.values())
        self.extent = float(getattr(mechanism, "extent", self.length))
        bodies = self._bodies(nodes)
        self.bodies, self.loops = self._tree(bodies, nodes)
        self.joints = tuple(f"hinge {' '.join(body.nodes)}" for body in self.bodies[1:])
        angles = self.joint_angles(samples)
        self.ranges = None if turns_freely else np.stack([angles.min(axis=0), angles.max(axis=0)], axis=1)
        self.reading = np.linalg.lstsq(angles, samples, rcond=1e-9)[0].T
        if abs(angles @ self.reading.T - samples).max() > 1e-9:
            raise ValueError(f"{type(mechanism).__name__}: its configuration is not linear in the angles of its hinges")
        self.invariants = self._invariants(nodes)
        # As pairs of numbers, which compiled code takes as data
        self._chain = [(body.parent, _pair(self.local(body.hinge, body.parent))) for body in self.bodies[1:]]
        places = {name: (self.owner(name), _pair(self.local(name, self.owner(name)))) for name in self.reference}
        self._sides = [
            ([(places[a], places[b]) for a, b in (first, second)], float(value))
            for first, second, value in self.invariants
        ]

    # ------------------------------------------------------------------------------------------------ what it finds

    @staticmethod
    def nodes_of(mechanism: Any) -> dict[str, complex]:
        """Nodes at q = 0 [m]."""
        start = (0.0,) * int(mechanism.degrees_of_freedom)
        return {name: complex(x, y) for name, (x, y) in mechanism.nodes(start).items()}

    def fits(self, mechanism: Any) -> bool:
        """Whether another mechanism has the same bars."""
        nodes = self.nodes_of(mechanism)
        return all(abs(self.reference[name] - z) <= 1e-12 * self.length for name, z in nodes.items())

    def _nodes_at(self, q: np.ndarray) -> dict[str, Any]:
        nodes = self.mechanism.nodes(tuple(q.tolist()) if q.ndim == 1 else tuple(np.moveaxis(q, -1, 0)))
        if any(len(position) != 2 for position in nodes.values()):
            raise ValueError(f"{type(self.mechanism).__name__}: only planar mechanisms are modelled")
        shape = q.shape[:-1]
        return {name: np.broadcast_to(x + 1j * np.asarray(y), shape) for name, (x, y) in nodes.items()}

    def _constant(self, values: np.ndarray, scale: float) -> bool:
        return bool(abs(values - values[0]).max() < _SAME * scale)

    def _bodies(self, nodes: dict[str, Any]) -> list[Body]:
        """The ground first, then in the order of the bars."""
        ground = tuple(name for name, z in nodes.items() if self._constant(z, self.length))
        found: dict[tuple[str, ...], list[Member]] = {ground: []}
        for member in self.mechanism.members:
            first, second = (nodes[name] for name in member.nodes)
            if not member.is_rigid or abs(second - first).max() < _SAME * self.length:
                continue
            if all(name in ground for name in member.nodes):
                found[ground].append(member)
                continue
            attached = tuple(
                name for name, z in nodes.items() if self._constant((z - first) / (second - first), self.length)
            )
            found.setdefault(attached, []).append(member)
        bodies = []
        for names, bars in found.items():
            pairs = [(abs(self.reference[a] - self.reference[b]), a, b) for a in names for b in names]
            _, a, b = max(pairs) if pairs else (0.0, "", "")
            bodies.append(Body(names, tuple(bars), (a, b)))
        return bodies

    def _tree(self, bodies: list[Body], nodes: dict[str, Any]) -> tuple[tuple[Body, ...], tuple[Loop, ...]]:
        # A hinge is where bodies share a point; the largest of them carries the others. Nodes may coincide for good.
        edges: list[tuple[int, str, int, str]] = []
        names = list(nodes)
        seen: set[str] = set()
        for name in names:
            if name in seen:
                continue
            here = [other for other in names if abs(nodes[other] - nodes[name]).max() < _SAME * self.length]
            seen.update(here)
            meeting = [i for i, body in enumerate(bodies) if any(other in body.nodes for other in here)]
            if not meeting:
                continue
            hub = 0 if 0 in meeting else max(meeting, key=lambda i: len(bodies[i].bars))
            node_of = {i: next(other for other in here if other in bodies[i].nodes) for i in meeting}
            edges += [(hub, node_of[hub], i, node_of[i]) for i in meeting if i != hub]
        parents: dict[int, tuple[int, str]] = {0: (-1, "")}
        queue, used = [0], set()
        while queue:
            at = queue.pop(0)
            for number, (a, a_node, b, b_node) in enumerate(edges):
                other = {a: b, b: a}.get(at)
                if other is not None and other not in parents:
                    parents[other] = (at, b_node if other == b else a_node)
                    used.add(number)
                    queue.append(other)
        if len(parents) < len(bodies):
            lost = [bodies[i].nodes for i in range(len(bodies)) if i not in parents]
            raise ValueError(f"{type(self.mechanism).__name__}: bodies {lost} do not hang on the ground")
        order: list[int] = []

        def visit(i: int) -> None:
            order.append(i)
            for child in (c for c in parents if parents[c][0] == i):
                visit(child)

        visit(0)
        number_of = {old: new for new, old in enumerate(order)}
        tree = tuple(
            Body(bodies[i].nodes, bodies[i].bars, bodies[i].frame, number_of.get(parents[i][0], -1), parents[i][1])
            for i in order
        )
        loops = tuple(
            Loop(number_of[a], a_node, number_of[b], b_node)
            for number, (a, a_node, b, b_node) in enumerate(edges)
            if number not in used
        )
        return tree, loops

    def _invariants(self, nodes: dict[str, Any]) -> tuple[tuple[tuple[str, str], tuple[str, str], float], ...]:
        """Pairs of cables' spans whose product is constant: the lateral sides of an X-joint, l^2 - b^2 [m2]."""
        cables = (member for member in self.mechanism.members if member.kind == "cable")
        spans = dict.fromkeys(span for member in cables for span in member.spans)  # each once, in order
        found = []
        for first, second in combinations(spans, 2):
            lengths = abs(nodes[first[1]] - nodes[first[0]]) * abs(nodes[second[1]] - nodes[second[0]])
            if self._constant(lengths, self.length**2):
                found.append((first, second, float(lengths[0])))
        return tuple(found)

    # --------------------------------------------------------------------------------------------------- kinematics

    def joint_angles(self, q: ArrayLike) -> np.ndarray:
        """Joint angles [rad] of the exactly closed mechanism, (..., bodies - 1), at q of shape (..., n)."""
        q = np.asarray(q, float)
        nodes = self._nodes_at(q)
        turns = [np.ones(q.shape[:-1], complex)]
        angles = []
        for body in self.bodies[1:]:
            a, b = body.frame
            turns.append((nodes[b] - nodes[a]) / (self.reference[b] - self.reference[a]))
            angles.append(np.angle(turns[-1] / turns[body.parent]))
        return np.stack(angles, axis=-1)

    def _read(self, angles: np.ndarray) -> np.ndarray:
        """reading @ angles, for shapes (..., bodies - 1), to the same last digit whatever the shape."""
        rows = np.reshape(angles, (-1, np.shape(angles)[-1]))
        return product(rows, self.reading.T).reshape(*np.shape(angles)[:-1], self.size)

    def configuration(self, angles: np.ndarray) -> np.ndarray:
        """q [rad], (..., n), at joint angles of shape (..., bodies - 1)."""
        return self._read(angles)

    def velocity(self, angles: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """The rate of q [rad/s], (..., n), at joint rates of shape (..., bodies - 1)."""
        return self._read(rates)

    def configuration_by_rates(self, angles: np.ndarray) -> np.ndarray:
        """d q / d joint angles, shape (n, bodies - 1)."""
        return np.asarray(self.reading)

    def rates_by_configuration(self, angles: np.ndarray) -> np.ndarray:
        """d joint angles / d q that keeps the loops closed, shape (bodies - 1, n)."""
        rows = self.loop_jacobian(angles)
        right = np.concatenate([np.zeros((len(rows), self.size)), np.eye(self.size)])
        return np.linalg.solve(np.concatenate([rows, self.reading]), right)

    def rates_of(self, angles: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Joint rates [rad/s] that keep the loops closed, from the rate of q, shape (bodies - 1,)."""
        return np.asarray(self.rates_by_configuration(angles) @ velocity)

    def _frames(self, angles: np.ndarray) -> list[tuple[Any, Any]]:
        """Position and orientation of every body; a body's origin is its hinge."""
        turn = np.exp(1j * angles)
        frames: list[tuple[Any, Any]] = [(np.zeros(angles.shape[:-1], complex), np.ones(angles.shape[:-1], complex))]
        for i, body in enumerate(self.bodies[1:]):
            origin, orientation = frames[body.parent]
            frames.append((origin + orientation * self.local(body.hinge, body.parent), orientation * turn[..., i]))
        return frames

    def local(self, node: str, body: int) -> complex:
        """Position of a node in the axes of a body, which are the world's at q = 0."""
        return self.reference[node] - (self.reference[self.bodies[body].hinge] if body else 0.0)

    def owner(self, node: str) -> int:
        """The first body that has the node."""
        for i, body in enumerate(self.bodies):
            if node in body.nodes:
                return i
        raise ValueError(f"node {node!r} belongs to no body")

    def positions(self, angles: np.ndarray) -> dict[str, np.ndarray]:
        """Positions of the nodes [m] at any joint angles, loops closed or not, of shape (..., bodies - 1)."""
        frames = self._frames(np.asarray(angles, float))
        found = {}
        for name in self.reference:
            i = self.owner(name)
            found[name] = frames[i][0] + frames[i][1] * self.local(name, i)
        return found

    def loop_error(self, angles: np.ndarray) -> np.ndarray:
        """Largest distance between the two sides of a loop's hinge [m], shape (...,); 0 without loops."""
        angles = np.asarray(angles, float)
        frames = self._frames(angles)
        error = np.zeros(angles.shape[:-1])
        for loop in self.loops:
            (p, u), (r, v) = frames[loop.first], frames[loop.second]
            first = p + u * self.local(loop.first_node, loop.first)
            error = np.maximum(error, abs(first - r - v * self.local(loop.second_node, loop.second)))
        return error

    def loop_jacobian(self, angles: np.ndarray) -> np.ndarray:
        """Derivatives of the gaps (x, y) of all loops in the joint angles [m/rad], shape (2 loops, bodies - 1)."""
        frames = self._frames(np.asarray(angles, float))
        rows = np.zeros((2 * len(self.loops), len(self.bodies) - 1))
        for number, loop in enumerate(self.loops):
            for body, node, sign in ((loop.first, loop.first_node, 1.0), (loop.second, loop.second_node, -1.0)):
                end = frames[body][0] + frames[body][1] * self.local(node, body)
                at = body
                while at:  # every hinge on the way to the ground turns it
                    swing = 1j * (end - frames[at][0]) * sign
                    rows[2 * number : 2 * number + 2, at - 1] += swing.real, swing.imag
                    at = self.bodies[at].parent
        return rows

    def assembly_error(self, angles: np.ndarray) -> np.ndarray:
        """Largest |left right / (l^2 - b^2) - 1| of the X-joints [-]: far from 0 where one flipped; 0 without them."""
        angles = np.asarray(angles, float)
        if not self._sides:
            return np.zeros(angles.shape[:-1])
        columns = np.ascontiguousarray(angles.reshape(-1, angles.shape[-1]).T)
        return np.asarray(self._assembly(columns)[0].reshape(angles.shape[:-1]))

    @cached_property
    def _assembly(self) -> Kernel:
        """Compiled: what arrays and numbers compute differs in the last digit."""
        chain, sides = self._chain, self._sides
        return Kernel(lambda angles: (_largest_error(chain, sides, angles),), Schema(tuple(np.zeros(1) for _ in chain)))


def _place(frame: tuple[Component, ...], point: tuple[Component, Component]) -> tuple[Component, Component]:
    """Where a point of a body is, whose position, cosine and sine are given."""
    x, y, c, s = frame
    px, py = point
    return x + (c * px - s * py), y + (s * px + c * py)


def _pair(point: complex) -> tuple[float, float]:
    """x and y of a complex number."""
    return float(point.real), float(point.imag)


def _largest_error(chain: list[Any], loops: list[Any], angles: Components) -> Component:
    """See `Linkage.assembly_error`, on components."""
    xp = namespace_of(angles[0])
    frames: list[tuple[Component, ...]] = [(0.0, 0.0, 1.0, 0.0)]  # position, cosine and sine of the orientation
    for (parent, hinge), angle in zip(chain, angles, strict=True):
        _, _, c, s = frames[parent]
        cosine, sine = xp.cos(angle), xp.sin(angle)
        frames.append((*_place(frames[parent], hinge), c * cosine - s * sine, s * cosine + c * sine))
    error: Component = 0.0
    for sides, value in loops:
        ratio = 1.0 / value
        for (i, first), (j, second) in sides:
            (x1, y1), (x2, y2) = _place(frames[i], first), _place(frames[j], second)
            ratio = ratio * xp.hypot(x1 - x2, y1 - y2)
        error = xp.maximum(error, abs(ratio - 1.0))
    return error
