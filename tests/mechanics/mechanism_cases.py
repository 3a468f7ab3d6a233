"""The mechanisms that the laws of test_mechanism_laws.py are checked on. A new mechanism is covered by adding rows."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tensegrity_envs.mechanics import (
    FURET2018,
    JAHROMY,
    JI2014,
    MURALIDHARAN2022,
    NX,
    ZHAO2021_CAPTION,
    ZHAO2021_TEXT,
    DualTriangle,
    DualTriangleDesign,
    NXDesign,
    PlanarFourBar,
    PlanarFourBarDesign,
    SpatialPrism,
    SpatialPrismDesign,
    TwoX,
    TwoXDesign,
)
from tensegrity_envs.mechanics.members import energy_of_members


@dataclass(frozen=True)
class Case:
    """A mechanism with ranges to draw configurations and inputs (tensions, free lengths) from, components first.

    Attributes:
        name: of the row.
        mechanism: of one design.
        draw_configuration: (generator, count) -> components of shape (count,).
        draw_inputs: (generator, count) -> components of shape (count,).
        bar_lengths: of bars and struts, then of cables that keep their length, in the order of `members` [m].
        tip_node: the name of the node that is the tip.
        largest_load: of the forces that are drawn, their standard deviation [N].
        inputs_of: (q) -> the inputs, where they follow from the configuration.
        moved: (q, inputs, i, step) -> the configuration a step further along coordinate i while the inputs are kept;
            by default component i of q is a step larger.
        moves_by_inputs: whether `jacobian` is the derivative by the inputs, through equilibria.
        settled: (generator) -> configuration, inputs and load of a stable equilibrium, of such mechanisms.
        first: (q) -> what `inverse_kinematics` takes besides the target; None where it has no list of solutions.
        is_feasible: (q, inputs, load) -> whether the wrench margin should be positive, by another route.
    """

    name: str
    mechanism: Any
    draw_configuration: Callable[[np.random.Generator, int], np.ndarray]
    draw_inputs: Callable[[np.random.Generator, int], np.ndarray]
    bar_lengths: tuple[float, ...]
    tip_node: str = "P"
    largest_load: float = 5.0
    inputs_of: Callable[[Any], Any] | None = None
    moved: Callable[[Any, Any, int, float], Any] | None = None
    moves_by_inputs: bool = False
    settled: Callable[[np.random.Generator], tuple[Any, Any, Any]] | None = None
    first: Callable[[Any], tuple] | None = lambda q: ()
    is_feasible: Callable[[Any, Any, Any], Any] | None = None

    def draw(self, seed: int, count: int) -> tuple[tuple, tuple, tuple]:
        """Configurations, inputs and tip loads [N], each component an array of shape (count,)."""
        rng = np.random.default_rng(seed)
        q, inputs = tuple(self.draw_configuration(rng, count)), tuple(self.draw_inputs(rng, count))
        if self.inputs_of is not None:
            inputs = tuple(self.inputs_of(q))
        dimensions = len(self.mechanism.tip(q, inputs))
        return q, inputs, tuple(rng.normal(0.0, self.largest_load, (dimensions, count)))

    def step(self, q: tuple, inputs: tuple, i: int, step: float) -> tuple:
        """See `moved`."""
        if self.moved is not None:
            return self.moved(q, inputs, i, step)
        return tuple(qj + step * (i == j) for j, qj in enumerate(q))


def within(design: Any) -> Callable[[Any, Any, Any], Any]:
    """Whether all tensions are within their bounds."""
    return lambda q, inputs, load: (
        (np.min(inputs, axis=0) > design.min_tension) & (np.max(inputs, axis=0) < design.max_tension)
    )


def two_x_case(name: str, design: TwoXDesign) -> Case:
    limit, top = design.joint_limit, design.max_tension
    b, l, a = design.b, design.l, design.a
    return Case(
        name,
        TwoX(design),
        lambda rng, n: rng.uniform(-limit, limit, (2, n)),
        lambda rng, n: rng.uniform(0.0, top, (4, n)),
        (l, l, b, a, math.hypot(a, b), a, b, l, l, b, math.hypot(a, b / 2), math.hypot(a, b / 2)),
        is_feasible=within(design),
    )


def random_two_x_design(seed: int) -> TwoXDesign:
    rng = np.random.default_rng(seed)
    b = rng.uniform(0.02, 0.5)
    values = dict(
        b=b,
        l=b * rng.uniform(1.05, 4.0),
        a=rng.choice([0.0, rng.uniform(0.001, 0.02), rng.uniform(0.05, 1.0)]),
        k1=rng.uniform(0.0, 1000.0),
        k2=rng.uniform(0.0, 1000.0),
        min_tension=rng.uniform(0.0, 10.0),
        max_tension=rng.uniform(20.0, 300.0),
        payload=rng.choice([0.0, rng.uniform(0.0, 2.0)]),
        bar_density=rng.uniform(0.0, 8000.0),
        bar_radius=rng.uniform(0.001, 0.01),
        gravity=rng.choice([0.0, 1.62, 9.81]),
        joint_limit=rng.choice([2.6, math.pi, 2 * math.pi]),
    )
    return TwoXDesign(**{name: float(value) for name, value in values.items()})


def n_x_case(name: str, design: NXDesign) -> Case:
    limit, top, n = design.joint_limit, design.max_tension, design.joints
    b, l, a = design.each("b"), design.each("l"), design.each("a")
    arm, lengths = NX(design), []
    for i in range(n):
        lengths += [l[i], l[i], b[i]]
        if i < n - 1:
            side, brace = math.hypot(a[i], (b[i] - b[i + 1]) / 2), math.hypot(a[i], (b[i] + b[i + 1]) / 2)
            lengths += [side, brace, side, b[i + 1]]
        else:
            lengths += [math.hypot(a[i], b[i] / 2)] * 2
    return Case(
        name,
        arm,
        lambda rng, count: rng.uniform(-limit, limit, (n, count)),
        lambda rng, count: rng.uniform(0.0, top, (len(arm.input_names), count)),
        tuple(lengths),
        first=(lambda q: ()) if n <= 2 else None,
        is_feasible=within(design),
    )


def random_n_x_design(seed: int, joints: int, routing: Any = "per_joint") -> NXDesign:
    """Unequal joints; fields that are numbers for all joints, offsets of zero and arms without springs among them."""
    rng = np.random.default_rng([seed, joints])
    b = rng.uniform(0.02, 0.5) * rng.uniform(0.5, 1.5, joints)
    values = dict(
        b=b,
        l=b * rng.uniform(1.05, 4.0, joints),
        a=rng.choice([0.0, 1.0], joints) * rng.uniform(0.01, 1.0, joints) * rng.choice([0.05, 1.0]),
        k_left=rng.choice([0.0, 1.0], p=[0.1, 0.9]) * rng.uniform(0.0, 1000.0, joints),
        k_right=rng.uniform(0.0, 1000.0, joints),
    )
    fields: dict[str, Any] = {name: tuple(map(float, value)) for name, value in values.items()}
    if rng.random() < 0.3:
        fields |= {"b": float(b.min()), "k_left": fields["k_left"][0], "k_right": None}
    return NXDesign(
        joints,
        **fields,
        min_tension=float(rng.uniform(0.0, 10.0)),
        max_tension=float(rng.uniform(20.0, 300.0)),
        payload=float(rng.choice([0.0, rng.uniform(0.0, 2.0)])),
        bar_density=float(rng.uniform(0.0, 8000.0)),
        bar_radius=float(rng.uniform(0.001, 0.01)),
        gravity=float(rng.choice([0.0, 1.62, 9.81])),
        joint_limit=float(rng.choice([2.6, math.pi, 2 * math.pi])),
        routing=routing,
    )


def dual_triangle_case(name: str, design: DualTriangleDesign, segments: int = 3) -> Case:
    # closer to the stops the lengths of springs vary too fast for differences; mpmath looks there
    limit, size = 0.7 * design.joint_limit, np.add(design.b1, design.b2).max() / 2

    def draw_inputs(rng: np.random.Generator, n: int) -> np.ndarray:
        if design.springs == "bilateral":
            return rng.uniform(0.0, 2 * size, (2 * segments, n))
        # Far from the change between taut and slack, where the energy has no third derivative.
        taut = rng.uniform(0.0, 0.02 * size, (2 * segments, n))
        return np.where(rng.uniform(size=(2 * segments, n)) < 0.6, taut, rng.uniform(9 * size, 10 * size, taut.shape))

    triangles = [pair for one in design.of_segments(segments) for pair in ((one.a1, one.b1), (one.a2, one.b2))]
    return Case(
        name,
        DualTriangle(design, segments),
        lambda rng, n: rng.uniform(-limit, limit, (segments, n)),
        draw_inputs,
        tuple(length for a, b in triangles for length in (2 * a, math.hypot(a, b), math.hypot(a, b))),
        first=(lambda q: tuple(q[: segments - 2])) if segments > 1 else None,
        is_feasible=lambda q, inputs, load: np.min(inputs, axis=0) > 0,
    )


def random_dual_triangle_design(seed: int, segments: int | None = None) -> DualTriangleDesign:
    """Of equal segments, or with tuples of so many numbers."""
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.02, 0.5)
    shape = (6,) if segments is None else (6, segments)
    a1, b1, a2, b2, free1, free2 = (_plain(size * value) for value in rng.uniform(0.4, 1.6, shape))
    k1, k2 = (_plain(value) for value in rng.uniform(100.0, 1000.0, (2, *shape[1:])))
    return DualTriangleDesign(a1, b1, a2, b2, k1, k2, free1, free2, "cable" if seed % 3 == 2 else "bilateral")


def _plain(values: Any) -> Any:
    return float(values) if np.ndim(values) == 0 else tuple(values.tolist())


def four_bar_case(name: str, design: PlanarFourBarDesign) -> Case:
    arm, l, k = PlanarFourBar(design), design.length, design.stiffness

    def settled(rng: np.random.Generator) -> tuple[Any, Any, Any]:
        angle, size = rng.uniform(0.35, 1.2), 2 * l * rng.uniform(0.6, 0.9)
        lengths = size * math.cos(angle), size * math.sin(angle)
        load = tuple(rng.normal(0.0, 0.02 * k * l, 2).tolist())
        start = arm.forward_kinematics(lengths, 1).configuration
        return arm.equilibrium(lengths, start, load).configuration, lengths, load

    def thrusts_are_small(q: Any, lengths: Any, load: Any) -> Any:
        """By virtual work: how the energy of nodes and members changes with the lengths while the angles are kept."""
        h, good = 1e-6 * l, True
        for i in (0, 1):
            ends = [tuple(r + sign * h * (i == j) for j, r in enumerate(lengths)) for sign in (1, -1)]
            high, low = (node_energy(arm, q, end, load) for end in ends)
            good = good & (abs(high - low) / (2 * h) < 2 * k * l)
        return good

    return Case(
        name,
        arm,
        lambda rng, n: rng.uniform(-math.pi, math.pi, (2, n)),
        lambda rng, n: rng.uniform(0.05 * l, 1.9 * l, (2, n)),
        (l, l, l, l),
        tip_node="F",
        largest_load=0.05 * k * l,
        moves_by_inputs=True,
        settled=settled,
        is_feasible=thrusts_are_small,
    )


def prism_case(name: str, design: SpatialPrismDesign) -> Case:
    prism, d, D, k = SpatialPrism(design), design.d, design.D, design.k

    def draw_configuration(rng: np.random.Generator, n: int) -> np.ndarray:
        return np.concatenate(
            [rng.uniform(-0.3 * D, 0.3 * D, (2, n)), rng.uniform(0.6 * D, 1.2 * D, (1, n)), rng.normal(0, 0.1, (3, n))]
        )

    def moved(q: Any, lengths: Any, i: int, step: float) -> Any:
        """Turned about a world axis, by matrices of SciPy; the struts keep their lengths."""
        turn = Rotation.from_rotvec(np.moveaxis(np.array(q[3:]), 0, -1))
        w = np.moveaxis((Rotation.from_rotvec(step * np.eye(3)[i]) * turn).as_rotvec(), -1, 0)
        return (*prism.locked_pose(tuple(w), lengths).position, *w)

    def settled(rng: np.random.Generator) -> tuple[Any, Any, Any]:
        load = tuple(rng.normal(0.0, 0.1 * k * D, 3).tolist())
        position = (*rng.uniform(-0.3 * D, 0.3 * D, 2).tolist(), float(rng.uniform(0.6, 1.2) * D))
        found = prism.loaded_inverse_kinematics(position, load)
        assert found.is_stable
        return found.configuration, found.lengths, load

    def pushes_and_pulls(q: Any, lengths: Any, load: Any) -> Any:
        """Struts and cables from the balance of the platform's nine forces, solved as one linear system."""
        return np.array([_prism_forces(prism, tuple(c[i] for c in q), [c[i] for c in load]) for i in range(len(q[0]))])

    return Case(
        name,
        prism,
        draw_configuration,
        lambda rng, n: np.zeros((3, n)),
        (math.sqrt(3) * d,) * 3,
        largest_load=k * D,
        inputs_of=prism.strut_lengths,
        moved=moved,
        moves_by_inputs=True,
        settled=settled,
        is_feasible=pushes_and_pulls,
    )


def _prism_forces(prism: SpatialPrism, q: Any, load: Any) -> bool:
    """Whether struts push and cables pull: thrusts balance springs and load as one body, then each node by itself."""
    nodes = {name: np.array(place, float) for name, place in prism.nodes(q).items()}
    springs, struts, cables = ([m for m in prism.members if m.kind == kind] for kind in ("spring", "actuator", "cable"))
    force = {f"P{i}": np.array(load) / 3 for i in (1, 2, 3)}
    for spring in springs:
        base, end = spring.nodes
        force[end] = force[end] + spring.stiffness * (nodes[base] - nodes[end])
    ways = np.array([nodes[end] - nodes[base] for base, end in (strut.nodes for strut in struts)])
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    thrusts = np.linalg.solve(ways.T, -sum(force.values()))
    for strut, way, thrust in zip(struts, ways, thrusts, strict=True):
        force[strut.nodes[1]] = force[strut.nodes[1]] + thrust * way
    tensions = []
    for cable in cables:  # the third node and the centre hold the other cables: balance along what is normal to them
        first, second = cable.nodes
        (other,) = {"P1", "P2", "P3"} - {first, second}
        along = nodes[second] - nodes[first]
        side = nodes[other] - nodes[first]
        normal = along - side * (along @ side) / (side @ side)
        tensions.append(-(force[first] @ normal) / (along @ normal / np.linalg.norm(along)))
    return bool(min(thrusts) > 0 and min(tensions) > 0)


TWO_X_MECHANISMS = [
    two_x_case("two-x published", MURALIDHARAN2022),
    two_x_case("two-x with payload", replace(MURALIDHARAN2022, payload=0.35)),
    two_x_case("two-x without offsets", replace(MURALIDHARAN2022, a=0.0, payload=0.1)),
    two_x_case("two-x on the full torus", replace(MURALIDHARAN2022, joint_limit=2 * math.pi)),
    two_x_case("two-x of Furet", FURET2018(2 / 3)),
    *(two_x_case(f"two-x random {seed}", random_two_x_design(seed)) for seed in range(6)),
]

DUAL_TRIANGLE_MECHANISMS = [
    dual_triangle_case("dual-triangle caption", ZHAO2021_CAPTION),
    dual_triangle_case("dual-triangle text", ZHAO2021_TEXT),
    dual_triangle_case("dual-triangle cables", replace(ZHAO2021_TEXT, springs="cable")),
    dual_triangle_case("dual-triangle bistable", DualTriangleDesign.symmetric(0.025, 0.05, 500.0, 0.05)),
    *(
        dual_triangle_case(f"dual-triangle random {seed}", random_dual_triangle_design(seed), (3, 1, 3, 2, 4, 3)[seed])
        for seed in range(6)
    ),
    *(
        dual_triangle_case(f"dual-triangle unequal {n}", random_dual_triangle_design(seed, n), n)
        for seed, n in enumerate((2, 3, 4))
    ),
]

N_X_MECHANISMS = [
    n_x_case("n-x of two", NXDesign.from_two_x(MURALIDHARAN2022)),
    n_x_case("n-x of three", NXDesign.from_two_x(MURALIDHARAN2022, 3)),
    *(n_x_case(f"n-x random {n}", random_n_x_design(0, n)) for n in (1, 2, 3, 4, 6)),
    *(n_x_case(f"n-x random {n}, cables from the base", random_n_x_design(1, n, "from_base")) for n in (1, 2, 3, 4)),
]

FOUR_BAR_MECHANISMS = [
    four_bar_case("four-bar published", JI2014),
    four_bar_case("four-bar small", PlanarFourBarDesign(0.3, 2000.0)),
]

PRISM_MECHANISMS = [
    prism_case("prism published", JAHROMY),
    prism_case("prism slender", SpatialPrismDesign(0.3, 0.4, 700.0)),
]

MECHANISMS = TWO_X_MECHANISMS + DUAL_TRIANGLE_MECHANISMS + N_X_MECHANISMS + FOUR_BAR_MECHANISMS + PRISM_MECHANISMS


def node_energy(mechanism: Any, q: Any, inputs: Any, load: Any) -> Any:
    """Energy from nodes and members alone: bars' weights at half height, springs, cables, payload and load at the tip.

    Inputs are the tensions of the cables, the free lengths of the springs whose free length is one, or lengths.
    """
    gravity = getattr(mechanism.design, "gravity", 0.0)
    nodes = mechanism.nodes(q, inputs)
    tip = nodes["P" if "P" in nodes else "F"]
    energy = energy_of_members(mechanism.members, nodes, inputs, gravity)
    energy = energy + getattr(mechanism.design, "payload", 0.0) * gravity * tip[-1]
    for force, place in zip(load, tip, strict=True):
        energy = energy - force * place
    return energy
