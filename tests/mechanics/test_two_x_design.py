"""Designs of the 2-X: what is refused names field and value; extreme but valid ones work."""

import dataclasses
import math
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tensegrity_envs.mechanics import FURET2018, MURALIDHARAN2022, TwoX, TwoXDesign

FIELDS = [field.name for field in dataclasses.fields(TwoXDesign)]
POSITIVE = ["b", "l", "bar_radius", "max_tension", "joint_limit"]
any_field = st.sampled_from(FIELDS)
not_numbers = st.one_of(
    st.text(),
    st.booleans(),
    st.none(),
    st.binary(),
    st.complex_numbers(),
    st.lists(st.floats(0.1, 1.0), max_size=3),
    st.just(np.array(["0.1"])),
    st.just(np.array([True])),
    st.just(np.array([0.1 + 1j])),
    st.just({"b": 0.05}),
)


relaxed = settings(deadline=None, max_examples=60)
stiffnesses = st.one_of(st.just(0.0), st.floats(1e-3, 1e5))


def refused(kind, field, value, **others):
    with pytest.raises(kind) as caught:
        replace(MURALIDHARAN2022, **{field: value}, **others)
    assert f"TwoXDesign.{field} = {value!r}" in str(caught.value)
    assert "must be" in str(caught.value)


@relaxed
@given(any_field, st.sampled_from([math.nan, math.inf, -math.inf]))
def test_numbers_that_are_not_finite(field, value):
    refused(ValueError, field, value)
    if field != "joint_limit":
        refused(ValueError, field, np.array([0.05, value]))


@relaxed
@given(any_field, st.floats(-1e6, -1e-12))
def test_negative_numbers(field, value):
    refused(ValueError, field, value)


@relaxed
@given(any_field, not_numbers)
def test_values_that_are_not_numbers(field, value):
    refused(TypeError, field, value)


@pytest.mark.parametrize("field", ["b", "bar_radius", "joint_limit"])
def test_zero_where_it_makes_no_sense(field):
    refused(ValueError, field, 0.0)


@relaxed
@given(st.floats(1e-3, 1.0), st.floats(0.0, 1.0))
def test_crossed_bars_no_longer_than_the_base(b, share):
    refused(ValueError, "l", share * b, b=b) if share * b > 0 else None


@relaxed
@given(st.floats(0.0, 1e3), st.floats(0.0, 1.0))
def test_tension_bounds_in_the_wrong_order(low, share):
    refused(ValueError, "max_tension", low * share, min_tension=low)


@relaxed
@given(st.floats(2 * math.pi + 1e-9, 1e6))
def test_joint_limits_beyond_the_torus(value):
    refused(ValueError, "joint_limit", value)


def test_joint_limits_are_shared_by_a_batch():
    with pytest.raises(TypeError, match=r"joint_limit.*one number"):
        replace(MURALIDHARAN2022, joint_limit=np.array([1.0, 2.0]))


def test_one_bad_design_of_a_batch():
    for field, values in (("payload", [0.1, -0.1]), ("l", [0.1, 0.05]), ("max_tension", [155.0, 5.0])):
        with pytest.raises(ValueError, match=re.escape(f"TwoXDesign.{field} = array(")):
            replace(MURALIDHARAN2022, **{field: np.array(values)})


def test_arrays_of_different_lengths():
    with pytest.raises(ValueError, match=r"TwoXDesign.payload = .*shape \(3,\), as k1 is"):
        replace(MURALIDHARAN2022, k1=np.ones(3), payload=np.zeros(2))


def test_designs_cannot_be_changed():
    with pytest.raises(dataclasses.FrozenInstanceError):
        MURALIDHARAN2022.b = 0.1
    assert replace(MURALIDHARAN2022, payload=0.2).payload == 0.2
    assert TwoXDesign(0.05, 0.10, 0.20, 600.0, 300.0, 5.0, 155.0) == MURALIDHARAN2022


def test_the_design_of_furet():
    design = FURET2018(2 / 3)
    assert (design.b, design.l, design.a, design.gravity) == (2 / 3, 1.0, 0.0, 9.8)
    assert design.joint_limit == 2 * math.pi
    assert all(member.mass == 0 for member in TwoX(design).members)
    with pytest.raises(ValueError, match=r"TwoXDesign.l = 1.0: must be greater than b = 1.5"):
        FURET2018(1.5)


def usable(design):
    """Everything can be asked of it and every answer is a finite number, without a warning."""
    m = TwoX(design)
    q, tensions = (0.3, -0.2), (20.0, 30.0, 25.0, 15.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tip = m.tip(q)
        numbers = [*tip, m.jacobian_determinant(q), m.potential_energy(q, tensions), *m.energy_gradient(q, tensions)]
        numbers += [*m.stiffest_tensions(q), m.stability_margin(q), m.wrench_margin(q), *m.cable_lengths(q)]
        numbers += [m.stability_margin(q, tensions), m.wrench_margin(q, tensions)]
        assert all(math.isfinite(number) for number in numbers)
        solutions = m.inverse_kinematics(*tip)
        assert any(s.configuration == pytest.approx(q, abs=1e-6) for s in solutions)
        assert math.isfinite(m.equilibrium(tensions, q).residual)


@pytest.mark.parametrize(
    "changes",
    [
        {"k1": 0.0},
        {"k2": 0.0},
        {"k1": 0.0, "k2": 0.0},
        {"gravity": 0.0},
        {"bar_density": 0.0},
        {"a": 0.0},
        {"min_tension": 0.0},
        {"payload": 50.0},
        {"gravity": 0.0, "k1": 0.0, "k2": 0.0, "bar_density": 0.0},
        {"b": 1e-4},
        {"l": 0.05 * (1 + 1e-6)},
        {"a": 10.0},
        {"max_tension": 1e6},
        {"joint_limit": 2 * math.pi},
        {"joint_limit": 0.4},
        {"k1": 600, "k2": 300, "min_tension": 5, "max_tension": 155, "payload": 0},
        {"b": np.float64(0.05), "l": np.float32(0.1)},
    ],
    ids=repr,
)
def test_extreme_designs_that_are_valid(changes):
    usable(replace(MURALIDHARAN2022, **changes))


@relaxed
@given(
    st.floats(1e-3, 10.0),
    st.floats(1.001, 20.0),
    st.floats(0.0, 20.0),
    stiffnesses,
    stiffnesses,
    st.floats(0.0, 100.0),
    st.floats(0.01, 1e4),
    st.floats(0.0, 100.0),
)
def test_valid_designs(b, ratio, offset, k1, k2, low, span, payload):
    l = ratio * b
    usable(TwoXDesign(b=b, l=l, a=offset * l, k1=k1, k2=k2, min_tension=low, max_tension=low + span, payload=payload))
