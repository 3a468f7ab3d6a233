"""The mast, for the laws of mechanisms: `pytest tests/mechanics/test_mechanism_laws.py --cases mast_cases`."""

import math

from mechanism_cases import Case

from mast import Mast, MastDesign


def case(name: str, design: MastDesign) -> Case:
    """A row: how to draw angles and tensions, and the lengths of the bars in the order of `Mast.members`."""
    side = math.hypot(design.l, design.w)
    return Case(
        name,
        Mast(design),
        lambda rng, n: rng.uniform(-design.joint_limit, design.joint_limit, (2, n)),
        lambda rng, n: rng.uniform(design.min_tension, design.max_tension, (2, n)),
        (side, side, 2 * design.w) * 2,
    )


CASES = [
    case("mast", MastDesign()),
    case("mast, slender and heavy", MastDesign(l=0.3, w=0.04, k=2000.0, payload=0.5, joint_limit=0.7)),
    case("mast without weight", MastDesign(payload=0.0)),
]
