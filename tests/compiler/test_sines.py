"""Sine, cosine and arc tangent of compiled code against arbitrary precision."""

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


def arc_tangent(y, x):
    return namespace_of(x).atan2(y, x)


def test_the_arc_tangent_is_within_two_units_in_the_last_place():
    rng = np.random.default_rng(1)
    y, x = rng.normal(size=(2, 6000)) * 10.0 ** rng.integers(-12, 12, (2, 6000))
    with mpmath.workprec(200):
        truth = [mpmath.atan2(mpmath.mpf(b), mpmath.mpf(a)) for a, b in zip(x, y, strict=True)]
        found = evaluate(arc_tangent, y, x)
        error = np.array([float(abs(mpmath.mpf(f) - t)) for f, t in zip(found, truth, strict=True)])
    assert (error <= 2 * np.spacing(np.abs(found))).all()


def test_zeros_and_quarter_turns_are_those_of_c():
    values = [0.0, -0.0, 1.0, -1.0, 2.0, -2.0]
    for y in values:
        for x in values:
            found, expected = evaluate(arc_tangent, y, x), math.atan2(y, x)
            assert found == pytest.approx(expected, rel=3e-16)
            assert math.copysign(1, found) == math.copysign(1, expected)
    found = evaluate(sines, np.array([0.0, -0.0]))[0]
    assert np.signbit(found).tolist() == [False, True]
