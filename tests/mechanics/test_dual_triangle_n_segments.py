"""What arms of other than three segments and torques at the tip reveal: identification, equilibria, compliance."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import root

from tensegrity_envs.mechanics import ZHAO2021_CAPTION, DualTriangle, DualTriangleDesign

UNEQUAL = DualTriangleDesign(0.05, 0.04, 0.06, 0.05, 500.0, 450.0, 0.055, 0.05)
TAPERED = DualTriangleDesign(
    a1=(0.055, 0.05, 0.045),
    b1=(0.05, 0.045, 0.04),
    a2=0.05,
    b2=(0.05, 0.04, 0.045),
    k1=(700.0, 500.0, 300.0),
    k2=(650.0, 500.0, 350.0),
    free_length1=(0.06, 0.055, 0.05),
    free_length2=0.05,
)
FIELDS = ("a1", "b1", "a2", "b2", "k1", "k2", "free_length1", "free_length2")
ARMS = [(ZHAO2021_CAPTION, 2), (UNEQUAL, 4), (ZHAO2021_CAPTION, 5), (TAPERED, 3)]


def loaded(arm, rng, torque=False):
    """A posture, a load with or without a torque, and the free lengths that hold the one under the other."""
    q = tuple(rng.uniform(-0.6, 0.6, arm.segments).tolist())
    size = 0.3 * float(arm.straight_critical_loads()[0])
    load = tuple((size * rng.normal(size=2)).tolist()) + ((0.2 * float(rng.normal()),) if torque else ())
    return q, load, tuple(map(float, arm.free_lengths(arm.control(q, load))))


@pytest.mark.parametrize(("design", "segments"), ARMS)
def test_the_load_and_the_posture_follow_from_the_tip(design, segments):
    arm, rng, limit = DualTriangle(design, segments), np.random.default_rng(segments), float(design.joint_limit)
    for _ in range(3):
        q, load, lengths = loaded(arm, rng)
        x, y = arm.tip(q)
        states = arm.identify(x, y, lengths)
        known = np.array([[*s.configuration, *s.load] for s in states])
        assert np.abs(known - np.array([*q, *load])).max(axis=1).min() < 1e-7
        for state in states:
            assert arm.tip(state.configuration) == pytest.approx((x, y), abs=1e-9)
            assert np.abs(arm.energy_gradient(state.configuration, lengths, state.load)).max() < 1e-9
            stiffness = np.array(arm.stiffness_matrix(state.configuration, lengths, state.load))
            assert state.is_stable == (np.linalg.eigvalsh(stiffness)[0] > 0)

        def equations(z, lengths=lengths, x=x, y=y):
            here, force = tuple(z[:segments]), tuple(z[segments:])
            px, py = arm.tip(here)
            return [*arm.energy_gradient(here, lengths, force), px - x, py - y]

        for begin in rng.uniform(-limit, limit, (20, segments)):
            found = root(equations, np.append(begin, [0.0, 0.0]), tol=1e-13)
            if np.abs(found.fun).max() < 1e-10 and np.abs(found.x[:segments]).max() < limit - 1e-6:
                assert np.abs(known[:, :segments] - found.x[:segments]).max(axis=1).min() < 1e-6


@pytest.mark.parametrize(("design", "segments"), [*ARMS, (UNEQUAL, 3), (UNEQUAL, 1)])
def test_a_torque_at_the_tip(design, segments):
    arm, rng = DualTriangle(design, segments), np.random.default_rng(10 + segments)
    for _ in range(3):
        q, load, lengths = loaded(arm, rng, torque=True)
        gradient = np.array(arm.energy_gradient(q, lengths, load))
        assert np.abs(gradient).max() < 1e-12
        # Any posture: gradient and Hessian by differences of the energy, whose torque term is minus torque times turn
        here = rng.uniform(-0.8, 0.8, segments)
        turned = arm.potential_energy(tuple(here), lengths, load) - arm.potential_energy(tuple(here), lengths, load[:2])
        assert turned == pytest.approx(-load[2] * here.sum(), abs=1e-12)
        h, eye = 1e-5, np.eye(segments)
        for i in range(segments):
            energies = [arm.potential_energy(tuple(here + sign * h * eye[i]), lengths, load) for sign in (1, -1)]
            slope = (energies[0] - energies[1]) / (2 * h)
            assert arm.energy_gradient(tuple(here), lengths, load)[i] == pytest.approx(slope, abs=1e-7)
        np.testing.assert_array_equal(
            arm.stiffness_matrix(tuple(here), lengths, load), arm.stiffness_matrix(tuple(here), lengths, load[:2])
        )
        rest = arm.equilibrium(lengths, q, load)
        if arm.stability_margin(q, lengths, load) > 0:
            np.testing.assert_allclose(rest.configuration, q, atol=1e-7)
        listed = arm.equilibria(lengths, load)
        assert min(np.abs(np.subtract(e.configuration, q)).max() for e in listed) < 1e-7
        limit = float(design.joint_limit)
        for begin in rng.uniform(-limit, limit, (20, segments)):
            found = root(lambda z, lengths=lengths, load=load: arm.energy_gradient(tuple(z), lengths, load), begin)
            if np.abs(found.fun).max() < 1e-11 and np.abs(found.x).max() < limit - 1e-6:
                assert min(np.abs(np.subtract(e.configuration, found.x)).max() for e in listed) < 1e-6


@pytest.mark.parametrize(("design", "segments"), [*ARMS, (UNEQUAL, 3)])
def test_compliance_by_differences_of_loaded_equilibria(design, segments):
    arm, rng = DualTriangle(design, segments), np.random.default_rng(20 + segments)
    for torque in (False, True):
        q, load, lengths = loaded(arm, rng, torque)
        assert arm.stability_margin(q, lengths, load) > 0
        columns, force = [], 1e-4
        for axis in range(2):
            tips = []
            for sign in (1, -1):
                more = list(load)
                more[axis] += sign * force
                tips.append(np.array(arm.tip(arm.equilibrium(lengths, q, tuple(more)).configuration)))
            columns.append((tips[0] - tips[1]) / (2 * force))
        expected = np.stack(columns, axis=1)
        np.testing.assert_allclose(arm.tip_compliance(q, lengths, load), expected, atol=1e-5 * np.abs(expected).max())


def test_loads_of_a_wrong_size_are_named():
    arm = DualTriangle(segments=4)
    with pytest.raises(ValueError, match=r"load: 4 numbers, must be 2 or 3"):
        arm.energy_gradient((0.0,) * 4, (0.05,) * 8, (0.0,) * 4)
    with pytest.raises(ValueError, match="finite"):
        arm.equilibrium((0.05,) * 8, (0.0,) * 4, (0.0, 0.0, math.nan))
    with pytest.raises(ValueError, match="two segments or more"):
        DualTriangle(segments=1).identify(0.1, 0.0, (0.05,) * 2)


def test_numbers_of_segments_and_angles_are_named():
    assert DualTriangle(segments=np.int64(4)).input_names == DualTriangle(segments=4).input_names
    with pytest.raises(ValueError, match=r"first: 0 numbers, must be 2: all angles but the last two.*redundancy"):
        DualTriangle(segments=4).inverse_kinematics(0.2, 0.05)
    with pytest.raises(ValueError, match=r"free_lengths = .*: must be single numbers, not arrays"):
        DualTriangle(segments=1).equilibria((np.array([0.05, 0.04]), 0.05))


def equal(design, segments):
    """The same design with a number for each segment."""
    return replace(design, **{name: (getattr(design, name),) * segments for name in FIELDS})


@pytest.mark.parametrize(("design", "segments"), [(ZHAO2021_CAPTION, 3), (UNEQUAL, 4)])
def test_numbers_for_each_segment_that_are_equal_are_one_number(design, segments):
    one, each = DualTriangle(design, segments), DualTriangle(equal(design, segments), segments)
    rng = np.random.default_rng(segments)
    q, load, lengths = loaded(one, rng)
    assert each.reach == one.reach
    assert each.control_limit == one.control_limit
    assert each.tip(q) == one.tip(q)
    assert each.nodes(q) == one.nodes(q)
    assert each.members == one.members
    assert each.control(q, load) == one.control(q, load)
    assert each.potential_energy(q, lengths, load) == one.potential_energy(q, lengths, load)
    assert each.statics(q, lengths, load) == one.statics(q, lengths, load)
    assert each.posture(q, load) == one.posture(q, load)
    assert each.equilibria(lengths, load) == one.equilibria(lengths, load)
    assert each.critical_load(q, (-1.0, 0.3)) == one.critical_load(q, (-1.0, 0.3))
    assert each.straight_critical_loads() == pytest.approx(one.straight_critical_loads(), rel=1e-12)
    x, y = one.tip(q)
    assert each.redundancy(x, y, (0.0,) * segments) == one.redundancy(x, y, (0.0,) * segments)
    assert each.identify(x, y, lengths) == one.identify(x, y, lengths)


@pytest.mark.parametrize("count", [None, 3])
def test_straight_critical_loads_of_unequal_segments(count):
    """At each of them the Hessian of the straight arm is singular; of a batch of designs they are those of each."""
    stiff = 1.0 if count is None else np.array([1.0, 1.3, 0.6])
    arm = DualTriangle(TAPERED.stiffened(stiff))
    loads = np.array(arm.straight_critical_loads())
    assert (np.diff(loads, axis=0) > 0).all()
    straight = (0.0,) * 3
    lengths = arm.free_lengths(arm.control(straight))
    for load in loads:
        rows = arm.stiffness_matrix(straight, lengths, (-load, 0.0))
        table = np.moveaxis(
            np.array([[np.broadcast_to(e, np.shape(load)) for e in row] for row in rows]), (0, 1), (-2, -1)
        )
        values = np.abs(np.linalg.eigvalsh(table))
        assert (values.min(axis=-1) < 1e-12 * values.max(axis=-1)).all()
    assert np.all(np.isclose(arm.critical_load(straight, (-1.0, 0.0)), loads[0], rtol=1e-9))
    for i in range(count or 0):
        np.testing.assert_allclose(arm.take(i).straight_critical_loads(), loads[:, i], rtol=1e-12)


def test_no_equilibrium_of_unequal_segments_is_missed():
    arm, rng = DualTriangle(replace(TAPERED, a1=(0.02, 0.025, 0.03), a2=0.025)), np.random.default_rng(0)
    limit, unstable = float(arm.design.joint_limit), 0
    for _ in range(4):
        lengths = tuple(rng.uniform(0.02, 0.06, 6).tolist())
        load = tuple((0.3 * rng.normal(size=2)).tolist())
        known = arm.equilibria(lengths, load)
        unstable += sum(not one.is_stable for one in known)
        for begin in rng.uniform(-limit, limit, (60, 3)):
            found = root(lambda z, a=lengths, b=load: arm.energy_gradient(tuple(z), a, b), begin, tol=1e-13)
            if np.abs(found.fun).max() < 1e-11 and np.abs(found.x).max() < limit - 1e-6:
                assert min(np.abs(np.subtract(e.configuration, found.x)).max() for e in known) < 1e-6
    assert unstable > 0


def test_numbers_for_each_segment_that_do_not_fit_are_named():
    for fields, message in (
        ({"k1": (1.0, 2.0)}, "fields are for 2 segments, not for 3: give segments=2, or one number or 3 of them"),
        ({"k1": (1.0, 2.0), "k2": (1.0, 2.0, 3.0)}, r"k2 = .*: must be one number or as many as k1 has, 2"),
        ({"k1": ()}, r"k1 = .*: must be one number or more"),
        ({"b1": (0.1, -0.1, 0.1)}, r"b1 = .*: must be positive"),
    ):
        with pytest.raises(ValueError, match=message):
            DualTriangle(replace(ZHAO2021_CAPTION, **fields))
    with pytest.raises(TypeError, match=r"k1 = .*: must be a number"):
        replace(ZHAO2021_CAPTION, k1=(1.0, "2"))
    with pytest.raises(ValueError, match=r"they are chain\[0\]"):
        _ = DualTriangle(TAPERED).segment
