"""Feasible wrenches as zonotopes and polygons, critical and buckling loads."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from n_x_checks import draw, is_held, random_arm
from scipy.linalg import eigh
from scipy.spatial import ConvexHull

from tensegrity_envs.mechanics import MURALIDHARAN2022, NX, NXDesign
from tensegrity_envs.mechanics.n_x.wrenches import area


def held_arms(joints, count):
    found = 0
    for seed in range(400):
        arm, rng = random_arm(seed, joints, strong=True)
        q, _, _ = draw(arm, rng, 0.7)
        _, stability, wrench = arm.posture(q)
        if stability > 0.01 and wrench > 0.01:
            found += 1
            yield arm, q, rng
        if found == count:
            return


@pytest.mark.parametrize("joints", (1, 2, 3))
def test_the_zonotope_is_the_hull_of_all_extreme_tensions(joints):
    for arm, q, _ in held_arms(joints, 6):
        low, high = arm.design.min_tension, arm.design.max_tension
        corners = np.array(list(product((low, high), repeat=len(arm.input_names))))
        torques = corners @ np.array(arm.torque_matrix(q)).T
        zonotope = arm.torque_zonotope(q)
        normals, offsets = zonotope.halfspaces()
        assert (normals @ torques.T - offsets[:, None]).max() < 1e-9 * np.abs(offsets).max()
        volume = np.ptp(torques) if joints == 1 else ConvexHull(torques, qhull_options="QJ").volume
        assert zonotope.volume == pytest.approx(volume, rel=1e-4)
        inside = zonotope.margin(np.array(arm.passive_gradient(q)))
        assert (inside > 0) == (arm.wrench_margin(q) > 0)


@pytest.mark.parametrize("joints", (2, 3, 4))
def test_tip_forces_are_those_that_a_linear_programme_holds(joints):
    checked = 0
    for arm, q, rng in held_arms(joints, 6):
        polygon = arm.tip_forces(q)
        center, size = polygon.mean(axis=0), np.abs(polygon - polygon.mean(axis=0)).max()
        assert area(polygon) > 0
        for vertex in polygon:  # just inside is feasible, just outside is not
            for factor, expected in ((1 - 1e-5, True), (1 + 1e-5, False)):
                force = tuple((center + factor * (vertex - center)).tolist())
                assert is_held(arm, q, force, arm.design.min_tension) == expected
                checked += 1
        for _ in range(20):
            force = center + rng.uniform(-size, size, 2)
            edges = np.roll(polygon, -1, axis=0) - polygon
            inside = (edges[:, 0] * (force - polygon)[:, 1] - edges[:, 1] * (force - polygon)[:, 0] > 0).all()
            assert is_held(arm, q, tuple(force.tolist()), arm.design.min_tension) == inside
    assert checked > 40


def test_tip_forces_that_are_not_bounded_are_named():
    arm = NX(NXDesign.from_two_x(MURALIDHARAN2022, 3))
    with pytest.raises(ValueError, match="not bounded"):
        arm.tip_forces((0.0, 0.0, 0.0))


@pytest.mark.parametrize("joints", (1, 2, 3, 5))
def test_critical_load_ends_what_it_says(joints):
    reasons = set()
    for arm, q, rng in held_arms(joints, 8):
        if not isinstance(arm.design.routing, str):
            continue
        angle = rng.uniform(-np.pi, np.pi)
        unit = np.array([np.cos(angle), np.sin(angle)])
        found = arm.critical_load(q, tuple(3 * unit))
        reasons.add(found.reason)
        for share in (0.3, 0.999):
            assert arm.is_stable_wrench_feasible(q, tuple((share * found.load * unit).tolist()))
        _, stability, wrench = arm.posture(q, tuple((1.001 * found.load * unit).tolist()))
        assert (stability if found.reason == "stability" else wrench) < 0
    assert reasons <= {"stability", "wrench"}


@pytest.mark.parametrize("joints", (1, 2, 3, 4))
def test_buckling_of_the_upright_arm_is_an_eigenvalue(joints):
    """The Hessian is affine in the force while the arm stays upright."""
    arm = NX(replace(NXDesign.from_two_x(MURALIDHARAN2022, joints), joint_limit=2.6, a=0.05))
    tensions, q = (100.0,) * (2 * joints), (0.0,) * joints
    free = np.array(arm.stiffness_matrix(q, tensions))
    loaded = np.array(arm.stiffness_matrix(q, tensions, (0.0, -1.0))) - free
    expected = 1 / eigh(-loaded, free, eigvals_only=True).max()
    found = arm.buckling_load(tensions, (0.0, -2.0))
    assert found.reason == "stability"
    assert found.load == pytest.approx(expected, rel=1e-3)
    assert found.load <= expected
    assert arm.stability_margin(q, tensions, (0.0, -0.999 * expected)) > 0
    assert arm.buckling_load(tensions, (0.0, -1.0), largest=0.5 * expected).load == np.inf
