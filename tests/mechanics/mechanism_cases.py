"""The mechanisms that the laws of test_mechanism_laws.py are checked on. A new mechanism is covered by adding rows."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tensegrity_envs.mechanics import (
    FURET2018,
    MURALIDHARAN2022,
    NX,
    ZHAO2021_CAPTION,
    ZHAO2021_TEXT,
    DualTriangle,
    DualTriangleDesign,
    NXDesign,
    TwoX,
    TwoXDesign,
)


@dataclass(frozen=True)
class Case:
    """A mechanism with ranges to draw configurations and inputs (tensions, free lengths) from, components first."""

    name: str
    mechanism: Any
    draw_configuration: Callable[[np.random.Generator, int], np.ndarray]
    draw_inputs: Callable[[np.random.Generator, int], np.ndarray]
    bar_lengths: tuple[float, ...]

    def draw(self, seed: int, count: int) -> tuple[tuple, tuple, tuple]:
        """Configurations, inputs and tip loads [N], each component an array of shape (count,)."""
        rng = np.random.default_rng(seed)
        q, inputs = self.draw_configuration(rng, count), self.draw_inputs(rng, count)
        return tuple(q), tuple(inputs), tuple(rng.normal(0.0, 5.0, (2, count)))


def two_x_case(name: str, design: TwoXDesign) -> Case:
    limit, top = design.joint_limit, design.max_tension
    b, l, a = design.b, design.l, design.a
    return Case(
        name,
        TwoX(design),
        lambda rng, n: rng.uniform(-limit, limit, (2, n)),
        lambda rng, n: rng.uniform(0.0, top, (4, n)),
        (l, l, b, a, math.hypot(a, b), a, b, l, l, b, math.hypot(a, b / 2), math.hypot(a, b / 2)),
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
    limit, size = 0.7 * design.joint_limit, (design.b1 + design.b2) / 2

    def draw_inputs(rng: np.random.Generator, n: int) -> np.ndarray:
        if design.springs == "bilateral":
            return rng.uniform(0.0, 2 * size, (2 * segments, n))
        # Far from the change between taut and slack, where the energy has no third derivative.
        taut = rng.uniform(0.0, 0.02 * size, (2 * segments, n))
        return np.where(rng.uniform(size=(2 * segments, n)) < 0.6, taut, rng.uniform(9 * size, 10 * size, taut.shape))

    sides = [(2 * a, math.hypot(a, b), math.hypot(a, b)) for a, b in ((design.a1, design.b1), (design.a2, design.b2))]
    return Case(
        name,
        DualTriangle(design, segments),
        lambda rng, n: rng.uniform(-limit, limit, (segments, n)),
        draw_inputs,
        (*sides[0], *sides[1]) * segments,
    )


def random_dual_triangle_design(seed: int) -> DualTriangleDesign:
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.02, 0.5)
    a1, b1, a2, b2, free1, free2 = (float(size * value) for value in rng.uniform(0.4, 1.6, 6))
    k1, k2 = (float(value) for value in rng.uniform(100.0, 1000.0, 2))
    return DualTriangleDesign(a1, b1, a2, b2, k1, k2, free1, free2, "cable" if seed % 3 == 2 else "bilateral")


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
]

N_X_MECHANISMS = [
    n_x_case("n-x of two", NXDesign.from_two_x(MURALIDHARAN2022)),
    n_x_case("n-x of three", NXDesign.from_two_x(MURALIDHARAN2022, 3)),
    *(n_x_case(f"n-x random {n}", random_n_x_design(0, n)) for n in (1, 2, 3, 4, 6)),
    *(n_x_case(f"n-x random {n}, cables from the base", random_n_x_design(1, n, "from_base")) for n in (1, 2, 3, 4)),
]

MECHANISMS = TWO_X_MECHANISMS + DUAL_TRIANGLE_MECHANISMS + N_X_MECHANISMS


def node_energy(mechanism: Any, q: Any, inputs: Any, load: Any) -> Any:
    """Energy from nodes and members alone: bars' weights at half height, springs, cables, payload and load at P.

    Inputs are the tensions of the cables, or the free lengths of the springs whose free length is one.
    """
    design = mechanism.design
    gravity = getattr(design, "gravity", 0.0)
    nodes = mechanism.nodes(q)
    x, y = nodes["P"]
    energy = getattr(design, "payload", 0.0) * gravity * y - load[0] * x - load[1] * y
    inputs = iter(inputs)
    for member in mechanism.members:
        ends = [(nodes[first], nodes[second]) for first, second in member.spans]
        length = sum(((x2 - x1) ** 2 + (y2 - y1) ** 2) ** 0.5 for (x1, y1), (x2, y2) in ends)
        (_, y1), (_, y2) = ends[0]
        if member.kind == "bar":
            energy = energy + member.mass * gravity * (y1 + y2) / 2
        elif member.kind == "spring":
            stretch = length - (next(inputs) if member.is_input else member.free_length)
            if member.goes_slack:
                stretch = (stretch + abs(stretch)) / 2
            energy = energy + member.stiffness * stretch**2 / 2
        else:
            energy = energy + next(inputs) * length
    return energy
