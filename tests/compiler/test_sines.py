"""Sine and cosine of compiled code against arbitrary precision."""

import math

import mpmath
import numpy as np
import pytest

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import namespace_of


def sines(x):
    xp = namespace_of(x)
    return xp.sin(x), xp.cos(x)


def angles():
    rng = np.random.default_rng(0)
    quarters = rng.integers(-(10**5), 10**5, 500) * (math.pi / 2)  # where one of the two all but vanishes
    return np.concatenate(
        [
            rng.uniform(-4, 4, 3000),
            rng.uniform(-1e6, 1e6, 3000),
            quarters,
            np.nextafter(quarters, 0),
            np.arange(-8, 9) * (math.pi / 4),
            [0.0, 1e-300, -1e-9, 0.3],
        ]
    )


def test_they_are_within_a_unit_in_the_last_place():
    x = angles()
    with mpmath.workprec(200):
        for found, exact in zip(evaluate(sines, x), (mpmath.sin, mpmath.cos), strict=True):
            truth = [exact(mpmath.mpf(value)) for value in x]
            error = np.array([float(abs(mpmath.mpf(f) - t)) for f, t in zip(found, truth, strict=True)])
            assert (error <= np.spacing(np.abs(found))).all()


def test_one_angle_gives_what_many_give():
    x = angles()[:200]
    for count in (1, 3, 16, 17, 200):
        for one, other in zip(
            evaluate(sines, x[:count]), zip(*(evaluate(sines, float(v)) for v in x[:count])), strict=True
        ):
            assert one.tolist() == list(other)


@pytest.mark.parametrize("x", [math.inf, -math.inf, math.nan])
def test_those_of_no_angle_are_not_a_number(x):
    assert all(math.isnan(value) for value in evaluate(sines, x))
