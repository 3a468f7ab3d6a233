"""The mechanisms that the laws of test_mechanism_laws.py are checked on. A new mechanism is covered by adding rows."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tensegrity_envs.mechanics import FURET2018, MURALIDHARAN2022, TwoX, TwoXDesign


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


MECHANISMS = [
    two_x_case("two-x published", MURALIDHARAN2022),
    two_x_case("two-x with payload", replace(MURALIDHARAN2022, payload=0.35)),
    two_x_case("two-x without offsets", replace(MURALIDHARAN2022, a=0.0, payload=0.1)),
    two_x_case("two-x on the full torus", replace(MURALIDHARAN2022, joint_limit=2 * math.pi)),
    two_x_case("two-x of Furet", FURET2018(2 / 3)),
    *(two_x_case(f"two-x random {seed}", random_two_x_design(seed)) for seed in range(6)),
]


def node_energy(mechanism: Any, q: Any, tensions: Any, load: Any) -> Any:
    """Energy from nodes and members alone: bars' weights at half height, springs, cables, payload and load at P."""
    design = mechanism.design
    nodes = mechanism.nodes(q)
    x, y = nodes["P"]
    energy = design.payload * design.gravity * y - load[0] * x - load[1] * y
    inputs = iter(tensions)
    for member in mechanism.members:
        (x1, y1), (x2, y2) = (nodes[name] for name in member.nodes)
        length = ((x2 - x1) ** 2 + (y2 - y1) ** 2) ** 0.5
        if member.kind == "bar":
            energy = energy + member.mass * design.gravity * (y1 + y2) / 2
        elif member.kind == "spring":
            energy = energy + member.stiffness * (length - member.free_length) ** 2 / 2
        else:
            energy = energy + next(inputs) * length
    return energy
