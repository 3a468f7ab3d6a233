"""Workspaces of dual-triangle arms by their boundary, against random postures."""

import numpy as np
import pytest
import shapely

from tensegrity_envs.geometry.dual_triangle_fields import maximum, region_of, room, stiffness
from tensegrity_envs.mechanics.dual_triangle import ZHAO2021_CAPTION, ZHAO2021_TEXT, DualTriangle


def random_tips(arm, measure, count=200_000):
    limit = float(arm.design.joint_limit)
    q = tuple(np.random.default_rng(0).uniform(-limit, limit, (3, count)))
    return np.stack(arm.tip(q))[:, measure(q) > 0]


@pytest.mark.parametrize("design", [ZHAO2021_CAPTION, ZHAO2021_TEXT])
@pytest.mark.parametrize("push", [0.0, 1.0])
def test_postures_that_are_held_are_inside_and_fill_it(design, push):
    arm = DualTriangle(design)
    b = float(design.b1)
    load = (-push * float(arm.straight_critical_loads()[0]), 0.0)
    measure = stiffness(arm, load) if push else room(arm)
    field = maximum(arm, measure, 251)
    region = region_of(field, b)
    # Measured with 301 cells: at most 0.006 b outside without a load, 0.021 b with one; one of 251 cells is 0.041 b.
    assert shapely.contains_xy(region.buffer(0.03 * b), *random_tips(arm, measure)).all()
    inside = field.value > 0
    held = tuple(field.best[:, inside])
    assert (measure(held) > 0).all()
    x, y = np.meshgrid(field.x * b, field.y * b)
    np.testing.assert_allclose(np.stack(arm.tip(held)), np.stack([x[inside], y[inside]]), atol=1e-12)


def test_halves_are_mirror_images_and_postures_get_there():
    arm = DualTriangle(ZHAO2021_CAPTION)
    half, whole = (maximum(arm, room(arm), 61, mirrored=mirrored) for mirrored in (True, False))
    np.testing.assert_allclose(half.value, whole.value, atol=0.02)  # of maxima on sampled curves
    x, y = np.meshgrid(half.x * ZHAO2021_CAPTION.b1, half.y * ZHAO2021_CAPTION.b1)
    inside = half.value > 0
    tip = np.stack(arm.tip(tuple(half.best[:, inside])))
    np.testing.assert_allclose(tip, np.stack([x[inside], y[inside]]), atol=1e-12)


def test_the_boundary_does_not_depend_on_the_grid():
    arm = DualTriangle(ZHAO2021_TEXT)
    areas = [region_of(maximum(arm, room(arm), cells), float(arm.design.b1)).area for cells in (151, 201, 301)]
    np.testing.assert_allclose(areas, areas[-1], rtol=2e-3)
