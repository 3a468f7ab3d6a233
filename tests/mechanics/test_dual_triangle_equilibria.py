"""Equilibria of arms and segments that violate condition (2), of cables, and of tensors."""

import itertools
import math

import numpy as np
import pytest
from brute_force import missed_by_dual_triangle

from tensegrity_envs.mechanics import MURALIDHARAN2022, DualTriangle, DualTriangleDesign, PlanarFourBar, TwoX
from tensegrity_envs.mechanics.dual_triangle import DualTriangleSegment
from tensegrity_envs.mechanics.dual_triangle.shooting import candidates

SYMMETRIC = DualTriangleDesign.symmetric


def test_the_only_stable_state_of_a_bistable_arm_is_found():
    arm = DualTriangle(SYMMETRIC(0.8, 1, 1, 0.6), 3)
    lengths = arm.free_lengths((0.0, 0.0, 0.3))
    (found,) = arm.equilibria(lengths, (0.7, 0.8))
    np.testing.assert_allclose(found.configuration, (0.8875, -0.2881, 0.7411), atol=1e-4)
    assert found.is_stable
    assert arm.stability_margin(found.configuration, lengths, (0.7, 0.8)) == pytest.approx(0.577, abs=1e-3)


@pytest.mark.parametrize("k", range(60))
def test_none_is_missed_that_brute_force_finds(k):
    *_, missed, _, what = missed_by_dual_triangle(np.random.default_rng([1, k]), 500)
    assert not missed, what


def test_without_a_load_equilibria_are_the_products_of_the_segments():
    """Three of each of six segments: 729, each found."""
    design = SYMMETRIC(0.6, 1.0, 1.0, 1.0)
    segment = DualTriangleSegment(design)
    lengths = segment.free_lengths(0.05)
    each = [e.configuration[0] for e in segment.equilibria(lengths)]
    assert len(each) == 3
    for n in (2, 3, 4):
        found = [e.configuration for e in DualTriangle(design, n).equilibria(lengths * n)]
        np.testing.assert_allclose(sorted(found), sorted(itertools.product(each, repeat=n)), atol=1e-9)


def test_the_cost_is_that_of_the_answers():
    """Six segments under a load that leaves one equilibrium: 3^6 choices of stretches are not tried."""
    arm = DualTriangle(SYMMETRIC(0.8, 1, 1, 0.6), 6)
    lengths, load = arm.free_lengths((0.05,) * 6), (0.7, 0.8)
    assert len(arm.equilibria(lengths, load)) == 1
    assert candidates(arm, lengths, load).shape[1] < 50


@pytest.mark.parametrize("moment", [1e-11, 0.0, -1e-12, 1e-9, 1e-4])
def test_zeros_between_which_the_torque_is_rounding_are_one(moment):
    """At the threshold of monotony the torque is cubic: it stays below rounding over a stretch of angles."""
    found = DualTriangleSegment(SYMMETRIC(0.5, 1, 100, 1.5)).equilibria((1.5, 1.5), moment)
    assert len(found) == 1
    assert found[0].configuration[0] == pytest.approx(np.sign(moment) * (abs(moment) / 18.75) ** (1 / 3), abs=2e-4)


@pytest.mark.parametrize("seed", range(30))
def test_control_of_cables_is_mirror_symmetric(seed):
    """Also beyond beta12, where both cables turn the same way, and without a moment."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.3, 0.8), rng.uniform(0.8, 1.5)
    free = rng.uniform(0, 2.5)
    segment = DualTriangleSegment(SYMMETRIC(a, b, 1.0, free, "cable"))
    limit = float(segment.design.joint_limit)
    for q, moment in itertools.product(rng.uniform(-limit, limit, 20), (0.0, *rng.uniform(-1, 1, 3))):
        delta = segment.control(q, moment)
        assert segment.control(-q, -moment) == pytest.approx(-delta, abs=1e-12)
        # No other input leaves less of the moment over
        left = abs(segment.torque(q, segment.free_lengths(delta)) + moment)
        tried = np.linspace(-4, 4, 4001)
        best = np.abs(segment.torque(q, segment.free_lengths(tried)) + moment).min()
        assert left <= best + 1e-12, (q, moment)


def test_slack_cables_carry_no_load():
    arm = DualTriangle(SYMMETRIC(0.5, 1.0, 1.0, 2.5, "cable"), 2)
    q = (0.1, -0.1)
    assert arm.stability_margin(q) == pytest.approx(0, abs=1e-12)
    for direction in ((1, 0), (0, 1), (-1, 0.5)):
        assert arm.critical_load(q, direction) == 0
    batch = arm.critical_load((np.full(3, 0.1), np.full(3, -0.1)), (1.0, 0.0))
    np.testing.assert_array_equal(batch, 0)


def test_numbers_that_are_too_many_or_too_few_are_refused():
    arm = DualTriangle(segments=3)
    q = (0.1, 0.2, 0.3)
    for call in (
        lambda: arm.load_torques(q, (1.0, 0.0, 5.0, 2.0)),
        lambda: arm.load_torques(q[:2], (1.0, 0.0)),
        lambda: arm.control(q, (1.0,)),
        lambda: arm.control(q[:2]),
        lambda: arm.control(q, None, (0.0, 0.0)),
        lambda: arm.free_lengths((0.1, 0.2)),
        lambda: arm.free_lengths((0.1, 0.2, 0.3), (0.0,)),
    ):
        with pytest.raises(ValueError, match=r"numbers?, must be"):
            call()


def _cases():
    dual = DualTriangle(SYMMETRIC(1.0, 1.0, 1.0, 1.0), 3)
    yield "dual-triangle", dual, dual.free_lengths((0.1, 0.0, -0.1)), (0.1, 0.0, 0.1), (0.02, 0.03)
    yield "2-X", TwoX(MURALIDHARAN2022), (60.0, 40.0, 30.0, 50.0), (0.3, -0.2), (1.0, -2.0)
    yield "4-bar", PlanarFourBar(), (9.0, 10.0), (1.5, 1.5), (5.0, 10.0)


@pytest.mark.parametrize(
    ("mechanism", "inputs", "start", "load"), [c[1:] for c in _cases()], ids=[c[0] for c in _cases()]
)
def test_equilibria_of_tensors_have_gradients(mechanism, inputs, start, load):
    """Tensors in, tensors out, with the derivatives that finite differences of floats give."""
    torch = pytest.importorskip("torch")
    given = [torch.tensor(value, dtype=torch.float64, requires_grad=True) for value in (*inputs, *load)]
    count = len(inputs)
    found = mechanism.equilibrium(given[:count], start, given[count:])
    plain = mechanism.equilibrium(inputs, start, load)
    assert bool(found.is_stable) == plain.is_stable is True
    for k, angle in enumerate(found.configuration):
        assert angle.item() == pytest.approx(plain.configuration[k], abs=1e-9)
        slopes = torch.autograd.grad(angle, given, retain_graph=True)
        for i, slope in enumerate(slopes):
            step = 1e-4 * max(1.0, abs((*inputs, *load)[i]))
            ends = []
            for sign in (1, -1):
                moved = [*inputs, *load]
                moved[i] += sign * step
                ends.append(mechanism.equilibrium(moved[:count], start, moved[count:]).configuration[k])
            assert slope.item() == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-5, abs=1e-8)


def test_tensors_in_batches():
    torch = pytest.importorskip("torch")
    arm = DualTriangle(SYMMETRIC(1.0, 1.0, 1.0, 1.0), 3)
    fx = torch.linspace(-0.05, 0.05, 5, dtype=torch.float64, requires_grad=True)
    found = arm.equilibrium(arm.free_lengths((0.1, 0.0, -0.1)), (0.1, 0.0, 0.1), (fx, 0.0))
    assert found.configuration[0].shape == (5,)
    assert found.is_stable.tolist() == [True] * 5
    found.configuration[0].sum().backward()
    assert torch.isfinite(fx.grad).all()


@pytest.mark.parametrize(
    ("springs", "free", "load"),
    [  # every pair of two of them in the fast tier
        ("bilateral", 0.0, (0.0, 0.0)),
        ("cable", 0.01, (0.0, 0.0)),
        ("bilateral", 0.01, (0.5, 0.3)),
        ("cable", 0.0, (0.5, 0.3)),
        pytest.param("bilateral", 0.01, (0.0, 0.0), marks=pytest.mark.full),
        pytest.param("cable", 0.0, (0.0, 0.0), marks=pytest.mark.full),
        pytest.param("bilateral", 0.0, (0.5, 0.3), marks=pytest.mark.full),
        pytest.param("cable", 0.01, (0.5, 0.3), marks=pytest.mark.full),
    ],
)
def test_springs_that_all_but_hold_nothing_give_an_answer(springs, free, load):
    """Equal heights and widths, no free length: the torque is zero at every angle."""
    arm = DualTriangle(SYMMETRIC(1, 1, 1, free, springs), 2)
    found = arm.equilibria((0.0,) * 4, load)
    assert all(np.linalg.norm(arm.energy_gradient(e.configuration, (0.0,) * 4, load)) < 1e-9 for e in found)
    if any(load):  # the arm points along the force
        assert [e.is_stable for e in found] == [True]
        np.testing.assert_allclose(found[0].configuration, (math.atan2(0.3, 0.5), 0.0), atol=1e-6)
    else:
        assert found
        assert not any(e.is_stable for e in found)
