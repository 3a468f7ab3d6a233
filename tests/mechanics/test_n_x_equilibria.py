"""Equilibria of the n-X: complete against Newton's method from many starts; the one that is reached from a start."""

import numpy as np
import pytest
from n_x_checks import missed_equilibria, random_arm


@pytest.mark.parametrize("joints", (1, 2, 3))
def test_no_equilibrium_is_missed(joints):
    found = 0
    for seed in range(8):
        by_starts, ours, missed = missed_equilibria(seed, joints, 500)
        assert not missed, (seed, missed)
        assert ours >= by_starts
        found += ours
    assert found >= 8


@pytest.mark.parametrize("joints", (4, 5, 6))
def test_the_stable_equilibrium_is_reached_from_the_start(joints):
    """Under stiff tensions that hold a posture, released from beside it, the arm comes back to it."""
    reached = 0
    for seed in range(12):
        arm, rng = random_arm(seed, joints, strong=True)
        load = tuple(rng.normal(0, 1, 2).tolist())
        q = tuple(rng.uniform(-0.5, 0.5, joints).tolist())
        tensions, stability, wrench = arm.posture(q, load)
        if wrench < 0 or stability < 0.02:
            continue
        reached += 1
        beside = tuple(float(v) for v in np.array(q) + rng.uniform(-0.01, 0.01, joints))
        found = arm.equilibrium(tensions, beside, load)
        assert found.is_stable, found
        assert found.configuration == pytest.approx(q, abs=1e-7)
    assert reached >= 4
