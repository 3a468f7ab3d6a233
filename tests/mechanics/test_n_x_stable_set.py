"""The stable wrench-feasible set of more than two joints: slices, and its volume against a grid."""

from dataclasses import replace

import numpy as np
import pytest

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.geometry.workspace import (
    stable_wrench_feasible_joint_space,
    stable_wrench_feasible_slice,
    stable_wrench_feasible_volume,
)
from tensegrity_envs.mechanics import MURALIDHARAN2022, NX, NXDesign, TwoX

THREE = replace(NXDesign.from_two_x(MURALIDHARAN2022, 3), joint_limit=2.6)
UNEQUAL = replace(THREE, b=(0.06, 0.05, 0.04), l=(0.11, 0.1, 0.09), k_left=(600.0, 400.0, 200.0))
DESIGNS = {"equal": THREE, "unequal": UNEQUAL, "from the base": replace(UNEQUAL, routing="from_base")}


def fraction_by_grid(arm, limit, count):
    """Share of the midpoints of count^3 cells that are stable and wrench-feasible."""
    axis = (np.arange(count) + 0.5) / count * 2 * limit - limit
    second, third = (part.ravel() for part in np.meshgrid(axis, axis))
    inside = 0
    for first in axis:
        _, stability, wrench = evaluate(arm.posture, (np.full(len(second), first), second, third))
        inside += int(((stability > 0) & (wrench >= 0)).sum())
    return inside / count**3


@pytest.mark.parametrize("name", DESIGNS)
def test_volume_against_a_grid(name):
    arm = NX(DESIGNS[name])
    found = stable_wrench_feasible_volume(arm, 3, lines=256)
    assert found.fraction == pytest.approx(fraction_by_grid(arm, 2.6, 60), rel=0.02)
    assert found.volume == pytest.approx(found.fraction * 5.2**3)
    assert found.error < 0.01 * found.fraction


@pytest.mark.full
@pytest.mark.parametrize("name", DESIGNS)
def test_volume_within_a_per_cent_of_a_grid_of_200(name):
    arm = NX(DESIGNS[name])
    assert stable_wrench_feasible_volume(arm, 3).fraction == pytest.approx(fraction_by_grid(arm, 2.6, 200), rel=0.01)


def test_volume_of_two_joints_is_the_area_of_the_region():
    arm = TwoX(MURALIDHARAN2022)
    area = stable_wrench_feasible_joint_space(arm, 2.6).trace(128, 1e-4).fraction
    found = stable_wrench_feasible_volume(arm, 2, 2.6)
    assert found.fraction == pytest.approx(area, abs=max(5 * found.error, 1e-4))


def test_slices_are_the_points_that_the_margins_tell():
    arm = NX(replace(UNEQUAL, routing="from_base"))
    region = stable_wrench_feasible_slice(arm, (0, 2), (0.0, 0.7, 0.0))
    rng = np.random.default_rng(0)
    q1, q3 = rng.uniform(-2.6, 2.6, (2, 2000))
    expected = arm.is_stable_wrench_feasible((q1, np.full(2000, 0.7), q3))
    assert 0.05 < expected.mean() < 0.95
    np.testing.assert_array_equal(region.contains(q1, q3), expected)
    assert region.trace(64, 1e-3).fraction == pytest.approx(expected.mean(), abs=0.04)
    with pytest.raises(ValueError, match="must be two different joints"):
        stable_wrench_feasible_slice(arm, (0, 3), (0.0, 0.7, 0.0))
