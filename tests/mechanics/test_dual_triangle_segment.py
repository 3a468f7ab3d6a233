"""One segment: torque against 50 digits, equilibria against exhaustive scans, bistability, limits, control law."""

import math
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from tensegrity_envs.mechanics import ZHAO2021_CAPTION, ZHAO2021_TEXT, DualTriangle, DualTriangleDesign
from tensegrity_envs.mechanics import DualTriangleSegment as Segment

symmetric = DualTriangleDesign.symmetric


def random_segment(rng, springs="bilateral"):
    a1, b1, a2, b2 = rng.uniform(0.3, 1.7, 4)
    if rng.uniform() < 0.4:
        a2, b2 = a1, b1
    k1, k2 = (1.0, 1.0) if rng.uniform() < 0.5 else rng.uniform(0.3, 3.0, 2)
    return Segment(DualTriangleDesign(*(float(v) for v in (a1, b1, a2, b2, k1, k2, 1.0, 1.0)), springs))


def node_torque(segment, q, free_lengths):
    """Torque from the nodes' positions: forces along the springs, crossed with the lever of the moving corner."""
    nodes = DualTriangle(segment.design, 1).nodes((q,))
    pivot = np.array(np.broadcast_arrays(nodes["O1"][0] + 0 * q, nodes["O1"][1] + 0 * q))
    total = 0.0
    for (fixed, moving), k, free in zip(
        (("A1", "D1"), ("B1", "C1")), (segment.design.k1, segment.design.k2), free_lengths, strict=True
    ):
        start, end = (np.array([nodes[name][0] + 0 * q, nodes[name][1] + 0 * q]) for name in (fixed, moving))
        span = start - end
        length = np.hypot(*span)
        stretch = length - free
        if segment.design.springs == "cable":
            stretch = np.maximum(stretch, 0.0)
        force = k * stretch * span / length
        lever = end - pivot
        total = total + lever[0] * force[1] - lever[1] * force[0]
    return total


@pytest.mark.parametrize("springs", ["bilateral", "cable"])
def test_torque_is_that_of_the_nodes(springs):
    rng = np.random.default_rng(0)
    for _ in range(60):
        s = random_segment(rng, springs)
        q = rng.uniform(-0.95, 0.95, 50) * s.design.joint_limit
        lengths = tuple(rng.uniform(0, 2.5, 2))
        np.testing.assert_allclose(s.torque(q, lengths), node_torque(s, q, lengths), rtol=0, atol=1e-12)


@pytest.mark.parametrize("skew", [0.0, 1e-12, 1e-6, 1e-3, 0.1])
def test_torque_and_stiffness_to_50_digits_near_the_stops(skew):
    """Where the ends of a spring meet, Eq. 1 as printed is 0/0; all digits are kept here, down to 1e-9 rad."""
    a, b, free = 1.0, 1.1, 0.7
    design = DualTriangleDesign(a, b, a + skew, b, 1.0, 1.0, free, free)
    s = Segment(design)
    with mpmath.workdps(50):
        corners = [mpmath.mpf(value) for value in (design.a1, design.b1, design.a2, design.b2)]

        def energy(q):
            a1, b1, a2, b2 = corners
            cos, sin = mpmath.cos(q), mpmath.sin(q)
            upper = mpmath.sqrt((b2 * cos - a2 * sin + b1) ** 2 + (b2 * sin + a2 * cos - a1) ** 2)
            lower = mpmath.sqrt((b2 * cos + a2 * sin + b1) ** 2 + (b2 * sin - a2 * cos + a1) ** 2)
            return ((upper - mpmath.mpf(free)) ** 2 + (lower - mpmath.mpf(free)) ** 2) / 2

        for distance in (1e-9, 1e-6, 1e-3, 0.3, 1.0):
            q = design.joint_limit - distance
            # a spring whose ends nearly meet turns through its whole range within skew / c: differentiate finely
            with mpmath.workdps(90):
                step = mpmath.mpf(10) ** -30
                up, here, down = energy(q + step), energy(mpmath.mpf(q)), energy(q - step)
                slope, stiffness = (up - down) / (2 * step), (up - 2 * here + down) / step**2
            # what rounding q itself makes of it
            tolerance = 1e-13 + 4e-16 * abs(float(stiffness))
            assert abs(s.torque(q, (free, free)) + float(slope)) < tolerance
            assert abs(s.stiffness(q, (free, free)) - float(stiffness)) < 1e-6 * abs(float(stiffness)) + 1e-12
            if skew == 0.0:
                assert abs(s.stiffness(q, (free, free)) - float(stiffness)) < 1e-13


def scan(segment, free_lengths, moment, points=20_001):
    """All sign changes of the nodes' torque on a fine grid, with the grid refined where the torque has an extremum."""
    limit = segment.design.joint_limit
    q = 3e-5 - limit * np.cos(np.linspace(0.0, math.pi, points))[1:-1]  # no sample is a zero by symmetry
    q = q[np.abs(q) < limit]
    value = node_torque(segment, q, free_lengths) + moment
    dips = np.flatnonzero((np.abs(value[1:-1]) < np.abs(value[:-2])) & (np.abs(value[1:-1]) < np.abs(value[2:]))) + 1
    fine = [np.linspace(q[i - 1], q[i + 1], 2001) for i in dips]
    q = np.unique(np.concatenate([q, *fine]))
    value = node_torque(segment, q, free_lengths) + moment
    roots = []
    for i in np.flatnonzero(value[1:] * value[:-1] < 0):
        roots.append(brentq(lambda p: node_torque(segment, p, free_lengths) + moment, q[i], q[i + 1], xtol=1e-14))
    return roots


def test_equilibria_of_500_random_segments_by_exhaustive_scan():
    rng = np.random.default_rng(1)
    counts = set()
    for trial in range(500):
        s = random_segment(rng)
        lengths = tuple(rng.uniform(0.0, 2.5, 2).tolist()) if trial % 2 else (float(rng.uniform(0.3, 1.5)),) * 2
        moment = float(rng.choice([0.0, rng.normal(0.0, 0.6)]))
        found = s.equilibria(lengths, moment)
        angles = [e.configuration[0] for e in found]
        expected = scan(s, lengths, moment)
        assert len(angles) == len(expected), (trial, angles, expected)
        np.testing.assert_allclose(angles, expected, rtol=0, atol=1e-9)
        counts.add(len(angles))
        for e in found:
            q = e.configuration[0]
            assert e.residual < 1e-12
            slope = node_torque(s, q + 1e-5, lengths) - node_torque(s, q - 1e-5, lengths)
            assert e.is_stable == (slope < 0)
    assert counts >= {0, 1, 2, 3, 5}


def test_equilibria_of_cables_by_scan():
    rng = np.random.default_rng(2)
    for _ in range(60):
        s = random_segment(rng, "cable")
        lengths = tuple(rng.uniform(0.0, 2.5, 2).tolist())
        moment = float(rng.normal(0.0, 0.5))
        angles = [e.configuration[0] for e in s.equilibria(lengths, moment)]
        np.testing.assert_allclose(angles, scan(s, lengths, moment), rtol=0, atol=1e-9)
    slack = Segment(replace(ZHAO2021_CAPTION, springs="cable"))
    (neutral,) = slack.equilibria((0.15, 0.15))
    assert neutral.configuration == pytest.approx((0.0,), abs=1e-9)
    assert not neutral.is_stable


def test_double_roots_at_a_fold():
    s = Segment(symmetric(0.5, 1.0, 1.0, 1.0))
    below, at, above = (s.equilibria(s.free_lengths(f * s.fold.delta)) for f in (1 - 1e-9, 1.0, 1 + 1e-9))
    assert [len(below), len(above)] == [3, 1]
    assert at[-1].is_stable
    for e in at[:-1]:  # one, none or two, to rounding
        assert e.configuration[0] == pytest.approx(-s.fold.angle, abs=1e-6)
        assert s.stiffness(*e.configuration, s.free_lengths(s.fold.delta)) == pytest.approx(0.0, abs=1e-6)


def test_condition_2_is_monotony_for_equal_free_lengths_only():
    rng = np.random.default_rng(3)
    for _ in range(150):
        a, free = (float(v) for v in rng.uniform(0.2, 1.6, 2))
        s = Segment(symmetric(a, 1.0, 1.0, free))
        q = np.linspace(-1, 1, 4001) * s.design.joint_limit
        assert s.is_monotone() == (free > s.monotone_threshold)
        if abs(free - s.monotone_threshold) > 1e-3:
            assert s.is_monotone() == bool((np.diff(node_torque(s, q[1:-1], (free, free))) < 0).all())
        if a >= 1:  # then for any free lengths
            assert s.is_monotone(tuple(rng.uniform(0, 3, 2).tolist()))
    s = Segment(symmetric(0.5, 1.0, 1.0, 1.51))
    assert s.is_monotone()
    assert not s.is_monotone(s.free_lengths(1.5))
    # asymmetric: stable at zero, yet not monotone (the paper's general statement is false)
    s = Segment(DualTriangleDesign(1.0, 1.0, 0.7, 0.9, 1.0, 1.0, 1.0, 1.0))
    assert s.stiffness(0.0, (1.0, 1.0)) == pytest.approx(0.527, abs=1e-3)
    assert not s.is_monotone()
    assert [e.configuration[0] for e in s.equilibria((1.0, 1.0))] == pytest.approx([-1.6478, 0, 1.6478], abs=1e-4)


def test_closed_forms_of_symmetric_segments():
    """[Zhao2021, Eqs. 4, 5] with the sign corrected, and the stiffness at the commanded angle."""
    rng = np.random.default_rng(4)
    for _ in range(100):
        a, b, k, free = (float(v) for v in rng.uniform(0.3, 2.0, 4))
        s = Segment(symmetric(a, b, k, free))
        q, moment = float(rng.uniform(-0.95, 0.95)) * s.design.joint_limit, float(rng.normal())
        cos = math.cos(q / 2)
        delta = (free * b * math.sin(q / 2) - (b * b - a * a) * math.sin(q) - moment / (2 * k)) / (a * cos)
        assert s.control(q, moment) == pytest.approx(delta, rel=1e-10, abs=1e-12)
        lengths = s.free_lengths(delta)
        assert node_torque(s, q, lengths) == pytest.approx(-moment, abs=1e-11)
        stiffness = 2 * k * (free * b / (2 * cos) - (b * b - a * a) * cos**2) - moment / 2 * math.tan(q / 2)
        assert s.stiffness(q, lengths) == pytest.approx(stiffness, rel=1e-9, abs=1e-9)
        step = 1e-5 * s.design.joint_limit
        by_difference = (s.control(q + step, moment) - s.control(q - step, moment)) / (2 * step)
        assert s.sensitivity(q, moment) == pytest.approx(by_difference, rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("springs", ["bilateral", "cable"])
def test_control_law_of_any_segment_holds_its_angle(springs):
    rng = np.random.default_rng(5)
    for _ in range(40):
        s = random_segment(rng, springs)
        reach = min(s.design.joint_limit, s.design.beta12) if springs == "cable" else s.design.joint_limit
        q, moment = rng.uniform(-0.95, 0.95, 30) * reach, rng.normal(0, 2.0, 30)
        moment[::5] = 0.0
        common = float(rng.uniform(-0.8, 0.8))
        lengths = s.free_lengths(s.control(q, moment, common), common)
        np.testing.assert_allclose(node_torque(s, q, lengths), -moment, rtol=0, atol=1e-11)


def test_wells_and_fold_by_scan():
    for a, free in ((0.5, 1.0), (0.5, 0.7), (0.8, 0.6)):
        s = Segment(symmetric(a, 1.0, 1.0, free))
        angles = [e.configuration[0] for e in s.equilibria((free, free)) if e.is_stable]
        assert angles == pytest.approx(s.wells, abs=1e-10)
        assert s.sensitivity(s.fold.angle) == pytest.approx(0.0, abs=1e-12)
        assert s.control(s.fold.angle) == pytest.approx(-s.fold.delta, abs=1e-12)
    assert Segment(ZHAO2021_TEXT).wells is None
    assert Segment(ZHAO2021_TEXT).fold is None
    with pytest.raises(ValueError, match="symmetric"):
        _ = Segment(DualTriangleDesign(1.0, 1.0, 0.7, 0.9, 1.0, 1.0, 1.0, 1.0)).fold


def test_limits():
    assert ZHAO2021_CAPTION.joint_limit == pytest.approx(math.pi / 2, abs=1e-15)
    assert Segment(ZHAO2021_TEXT).control_limit == pytest.approx(1.2771870562503, abs=1e-11)
    assert Segment(ZHAO2021_CAPTION).delta_range == (-0.05, 0.05)
    assert ZHAO2021_CAPTION.a1 / ZHAO2021_CAPTION.b1 == pytest.approx(1.0)
    assert ZHAO2021_TEXT.a1 / ZHAO2021_TEXT.b1 == pytest.approx(1.1)
    assert ZHAO2021_TEXT.free_length1 / ZHAO2021_TEXT.b1 == pytest.approx(0.7)
    assert (ZHAO2021_TEXT.b1, ZHAO2021_TEXT.k1) == (0.05, 500.0)


# --------------------------------------------------------------------------------------------------- bad input

FIELDS = ("a1", "b1", "a2", "b2", "k1", "k2", "free_length1", "free_length2")


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(FIELDS), st.sampled_from([math.nan, math.inf, -math.inf, -1.0, -1e-300, "x", None, True, 1j]))
def test_bad_fields_are_named(field, value):
    with pytest.raises((TypeError, ValueError), match=field):
        replace(ZHAO2021_CAPTION, **{field: value})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"a1": 0.0}, "a1 = 0.0"),
        ({"k2": 0.0}, "k2 = 0.0"),
        ({"springs": "rubber"}, "springs = 'rubber'"),
        ({"max_joint_angle": 2.0}, "max_joint_angle = 2.0"),
        ({"max_joint_angle": 0.0}, "max_joint_angle = 0.0"),
        ({"a1": np.array([0.05, 0.0])}, "a1 = "),
        ({"a1": np.full(2, 0.05), "b1": np.full(3, 0.05)}, "shape"),
    ],
)
def test_impossible_designs(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(ZHAO2021_CAPTION, **changes)


def test_free_lengths_of_zero_are_a_design():
    s = Segment(symmetric(1.1, 1.0, 1.0, 0.0))
    assert s.control_limit == 0.0
    assert s.equilibria((0.0, 0.0))[0].is_stable


@settings(max_examples=40, deadline=None)
@given(st.sampled_from([math.nan, math.inf, -math.inf]), st.integers(0, 2))
def test_numbers_that_are_not_finite(value, place):
    numbers = [0.05, 0.05, 0.0]
    numbers[place] = value
    with pytest.raises(ValueError, match="finite"):
        Segment().equilibria(tuple(numbers[:2]), numbers[2])


def test_batches_of_designs():
    rng = np.random.default_rng(6)
    values = {field: rng.uniform(0.5, 1.5, 7) for field in FIELDS}
    batch = Segment(DualTriangleDesign(**values))
    q, moment = rng.uniform(-1, 1, 7), rng.normal(size=7)
    lengths = batch.free_lengths(batch.control(q, moment))
    for i in range(7):
        one = Segment(DualTriangleDesign(**{field: float(value[i]) for field, value in values.items()}))
        part = batch.take(i)
        for s in (one, part):
            assert s.control(float(q[i]), float(moment[i])) == pytest.approx(batch.control(q, moment)[i], rel=1e-12)
            pair = tuple(float(length[i]) for length in lengths)
            assert s.stiffness(float(q[i]), pair) == pytest.approx(batch.stiffness(q, lengths)[i], rel=1e-11)
        assert part.design.joint_limit == pytest.approx(one.design.joint_limit)
    with pytest.raises(ValueError, match="batch"):
        batch.equilibria((1.0, 1.0))
