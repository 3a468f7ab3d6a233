"""The stable wrench-feasible set by other routes: grids, inverse kinematics, dense scans, the paper's polynomials."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely
from scipy import ndimage
from two_x_polynomials import (
    bar_masses,
    candidates,
    intervals,
    polynomial,
    printed_in_t1,
    printed_in_t2,
)

from tensegrity_envs.geometry.regions import LIMIT
from tensegrity_envs.geometry.workspace import (
    CLIP,
    SINGULARITY,
    STABILITY,
    boundary_cloud,
    stable_wrench_feasible_joint_space,
    stable_wrench_feasible_size,
    stable_wrench_feasible_workspace,
    summary,
)
from tensegrity_envs.mechanics import FURET2018, MURALIDHARAN2022, TwoX, TwoXDesign


def random_design(seed):
    rng = np.random.default_rng([7, seed])
    b = rng.uniform(0.03, 0.08)
    stiffness = 10 ** rng.uniform(1, 3.2)
    return TwoXDesign(
        b=b,
        l=b * rng.uniform(1.15, 3.0),
        a=rng.choice([0.0, rng.uniform(0.02, 0.3)], p=[0.15, 0.85]),
        k1=stiffness,
        k2=stiffness * rng.uniform(0.2, 1.2),
        min_tension=rng.uniform(0, 8),
        max_tension=rng.uniform(40, 250),
        payload=rng.choice([0.0, rng.uniform(0.0, 0.7)], p=[0.3, 0.7]),
        gravity=rng.choice([9.8, 0.0, 1.6], p=[0.8, 0.1, 0.1]),
    )


DESIGNS = [random_design(seed) for seed in range(20)]


@cache
def traced_of(design):
    return stable_wrench_feasible_joint_space(TwoX(design)).trace()


@cache
def workspace_of(design):
    return stable_wrench_feasible_workspace(TwoX(design))


def test_the_random_designs_are_varied():
    components = [len(traced_of(design).components) for design in DESIGNS]
    assert max(components) > 1
    assert sum(design.payload > 0 for design in DESIGNS) >= 8
    assert len({round(traced_of(design).fraction, 3) for design in DESIGNS}) > 15


def test_published_designs():
    """The numbers of the published arm and of its changes."""
    traced, found = traced_of(MURALIDHARAN2022), workspace_of(MURALIDHARAN2022)
    assert traced.fraction == pytest.approx(0.64212, abs=1e-5)
    assert found.area() == pytest.approx(0.75501, abs=1e-5)
    assert found.overlap == pytest.approx(0.29957, abs=1e-5)
    assert len(traced.components) == 1
    assert found.area_error < 1e-5
    lengths = traced.lengths()
    assert lengths[STABILITY] == pytest.approx(13.45, abs=0.01)
    assert sum(lengths[name] for name in TwoX.input_names) == pytest.approx(6.49, abs=0.01)
    assert lengths[LIMIT] == pytest.approx(0.13, abs=0.01)
    heavy = replace(MURALIDHARAN2022, payload=0.5)
    assert traced_of(heavy).fraction == pytest.approx(0.27299, abs=1e-5)
    assert len(traced_of(heavy).components) == 2
    assert workspace_of(heavy).overlap == 0
    assert workspace_of(heavy).area() == pytest.approx(0.502218, abs=3e-6)
    loaded = replace(MURALIDHARAN2022, payload=0.2)
    assert (traced_of(loaded).fraction, workspace_of(loaded).area(), workspace_of(loaded).overlap) == pytest.approx(
        (0.470095, 0.655730, 0.095614), abs=3e-6
    )
    slack = replace(MURALIDHARAN2022, max_tension=50.0)
    assert (traced_of(slack).fraction, workspace_of(slack).area(), workspace_of(slack).overlap) == pytest.approx(
        (0.1116363, 0.097171, 0.027192), abs=3e-6
    )


def test_an_empty_set_is_a_result():
    design = replace(MURALIDHARAN2022, k1=50.0, k2=25.0, max_tension=20.0)
    traced, found = traced_of(design), workspace_of(design)
    assert traced.is_empty
    assert (traced.area, found.area(), found.overlap, found.faces, found.holes) == (0, 0, 0, (), [])
    numbers = summary(traced, found)
    assert numbers["SWFJ empty"] is True
    assert boundary_cloud(TwoX(design)).points.shape == (0, 2)
    assert stable_wrench_feasible_joint_space(TwoX(design)).slices(0, [0.0, 1.0]) == [[], []]
    assert found.count([0.0, 0.3], [0.0, 0.3]).tolist() == [0, 0]
    assert found.along((0, -1), (0, 1)) == []
    assert found.to_features() == []


def test_the_image_does_not_depend_on_the_grid():
    coarse = stable_wrench_feasible_workspace(TwoX(), resolution=100, tolerance=1e-5)
    fine = stable_wrench_feasible_workspace(TwoX(), resolution=300, tolerance=3e-7)
    for one in (coarse, workspace_of(MURALIDHARAN2022)):
        assert abs(one.area() - fine.area()) < one.area_error + fine.area_error
        assert abs(one.overlap - fine.overlap) < one.area_error + fine.area_error


@pytest.mark.parametrize("design", [MURALIDHARAN2022, *DESIGNS[:8]], ids=lambda d: f"b={d.b:.3f}")
def test_the_fast_estimate(design):
    size, exact = stable_wrench_feasible_size(TwoX(design)), workspace_of(design)
    known = (traced_of(design).fraction, exact.area(), exact.overlap)
    assert tuple(size) == pytest.approx(known, abs=1e-3)


@pytest.mark.parametrize("seed", range(20))
def test_joint_space_against_a_grid(seed):
    """Area against a jittered grid, components against labelled pixels."""
    m, traced = TwoX(DESIGNS[seed]), traced_of(DESIGNS[seed])
    n = 600
    h = 2 * CLIP / n
    rng = np.random.default_rng(seed)
    corner = -CLIP + h * np.arange(n)
    q = (corner[:, None] + h * rng.random((n, n)), corner[None, :] + h * rng.random((n, n)))
    inside = m.is_stable_wrench_feasible(q)
    length = sum(traced.lengths().values())
    sigma = h**1.5 * math.sqrt(length / 3 + 1e-9)  # cells on the boundary, each a coin
    assert abs(inside.sum() * h * h - traced.area) < 4.5 * sigma + traced.area_error + h * h
    for component in traced.components:
        assert component.area > 0
    # Pixels touch at corners where the set does not, or miss a narrow bridge: compare where both counts agree.
    centre = (corner + h / 2)[:, None], (corner + h / 2)[None, :]
    pixels = m.is_stable_wrench_feasible(centre)
    labels = [ndimage.label(pixels, structure)[0] for structure in (np.ones((3, 3)), None)]
    counts = [sum(np.bincount(label.ravel())[1:] > 12) for label in labels]
    if counts[0] == counts[1]:
        assert sum(component.area > 20 * h * h for component in traced.components) == counts[0]


@pytest.mark.parametrize("seed", range(20))
def test_boundary_is_where_it_says(seed):
    """Residuals, active conditions and their meaning; corners of polygons where two conditions meet."""
    m, traced = TwoX(DESIGNS[seed]), traced_of(DESIGNS[seed])
    region = traced.region
    low, high = m.design.min_tension, m.design.max_tension
    for ring in traced.rings:
        q1, q2 = ring.points.T
        free = (np.abs(q1) < CLIP) & (np.abs(q2) < CLIP)
        assert np.abs(region.margin(q1, q2)[free]).max(initial=0) < 1e-10
        tensions, stability, _ = m.posture((q1, q2))
        for k, name in enumerate(region.names):
            mine = free & (ring.conditions == k) & (np.roll(ring.conditions, 1) == k)
            if name == STABILITY:
                assert np.abs(stability[mine]).max(initial=0) < 1e-10
            else:
                other = tensions[(k - 1) ^ 1][mine]
                np.testing.assert_allclose(tensions[k - 1][mine], low, rtol=0, atol=1e-8)
                np.testing.assert_allclose(other, high, rtol=0, atol=1e-8)
        shape = shapely.Polygon(ring.points)
        assert shape.is_valid or shape.buffer(0).area == pytest.approx(shape.area, rel=1e-6)
    assert traced.lengths()["unresolved"] < 0.02 * max(sum(traced.lengths().values()), 1)


@pytest.mark.parametrize("seed", range(20))
def test_workspace_against_inverse_kinematics(seed):
    """The number of configurations at random points, from winding numbers and from inverse kinematics."""
    m, found = TwoX(DESIGNS[seed]), workspace_of(DESIGNS[seed])
    rng = np.random.default_rng([3, seed])
    reach = float(m.reach)
    x, y = rng.uniform(-reach, reach, (2, 1500))
    a1, a2 = m.inverse_kinematics_batch(x, y)
    within = (np.abs(a1) <= CLIP) & (np.abs(a2) <= CLIP)
    filled = np.where(within, a1, 0.0), np.where(within, a2, 0.0)
    expected = (within & m.is_stable_wrench_feasible(filled)).sum(axis=1)
    counted = found.count(x, y)
    curves = shapely.multilinestrings([shapely.linestrings(ring) for s in found.sheets for ring in s.rings] or [])
    for k in np.flatnonzero(counted != expected):
        assert shapely.distance(curves, shapely.Point(x[k], y[k])) < 2e-5 * reach, (x[k], y[k])
    share, known = (expected > 0).mean(), found.area() / (2 * reach) ** 2
    assert abs(known - share) < 4.5 * math.sqrt((max(known, share) + 1e-4) / len(x))
    for k, sheet in enumerate(found.sheets):
        total = sum(face.counts[k] * face.polygon.area for face in found.faces)
        assert total == pytest.approx(sheet.area, abs=2 * found.area_error + 1e-12)


def brute(region, fixed, value, samples=20001):
    """Runs of positive margin among many samples: (first, last) of each."""
    s = np.linspace(-CLIP, CLIP, samples)
    inside = region.margin(*((value, s) if fixed == 0 else (s, value))) > 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    return [(s[i], s[j - 1]) for i, j in zip(edges[::2], edges[1::2], strict=True)], s[1] - s[0]


def test_no_interval_is_missed_on_500_random_slices():
    several = 0
    for seed in range(25):
        region = stable_wrench_feasible_joint_space(TwoX(random_design(seed)))
        rng = np.random.default_rng([5, seed])
        for fixed in (0, 1):
            values = rng.uniform(-CLIP, CLIP, 10)
            for value, found in zip(values, region.slices(fixed, values), strict=True):
                expected, step = brute(region, fixed, value)
                several += len(expected) > 1
                coarse = [interval for interval in found if interval.high - interval.low > 2 * step]
                assert len(coarse) <= len(expected) <= len(found), (seed, fixed, value)
                for low, high in expected:
                    assert any(i.low <= low and high <= i.high for i in found), (seed, fixed, value)
                for interval in found:
                    middle = (interval.low + interval.high) / 2
                    assert region.margin(*((value, middle) if fixed == 0 else (middle, value))) > 0
                    for end, name in zip(interval[:2], interval[2:], strict=True):
                        margins = region.margins(*((value, end) if fixed == 0 else (end, value)))
                        if name == LIMIT:
                            assert abs(end) == CLIP
                        else:
                            assert abs(margins[region.names.index(name)]) < 1e-10
                            assert margins.min() > -1e-10
    assert several >= 10


@pytest.mark.parametrize("sheet", [1, -1])
def test_slices_of_a_sheet_end_at_the_singularity(sheet):
    m = TwoX()
    region = stable_wrench_feasible_joint_space(m, sheet=sheet)
    ((low, high, first, second),) = region.slices(0, 0.5)[0]
    ((whole_low, whole_high, _, _),) = stable_wrench_feasible_joint_space(m).slices(0, 0.5)[0]
    at_fold = high if second == SINGULARITY else low
    assert {first, second} == {SINGULARITY, "right 2" if sheet > 0 else STABILITY} or SINGULARITY in (first, second)
    assert (whole_low, whole_high)[sheet > 0] in (pytest.approx(low, abs=1e-12), pytest.approx(high, abs=1e-12))
    assert m.jacobian_determinant((0.5, at_fold)) == pytest.approx(0, abs=1e-12)


def test_the_cloud_is_the_papers():
    m = TwoX()
    cloud = boundary_cloud(m)
    edge = np.array([name != SINGULARITY for name in cloud.conditions])
    assert edge.sum() == 2 * (52 + 44)
    region = stable_wrench_feasible_joint_space(m)
    free = (np.abs(cloud.points[edge]) < CLIP).all(axis=1)
    assert np.abs(region.margin(*cloud.points[edge][free].T)).max() < 1e-10
    assert np.abs(m.jacobian_determinant(tuple(cloud.points[~edge].T))).max() < 1e-12
    np.testing.assert_allclose(np.stack(m.tip(tuple(cloud.points.T)), axis=1), cloud.tips, rtol=0, atol=0)


@pytest.mark.parametrize("design", [MURALIDHARAN2022, *DESIGNS[:6]], ids=lambda d: f"b={d.b:.3f}")
def test_the_papers_polynomials(design):
    """Degrees 12 and 8 as printed; and the paper's method, with all eight polynomials, gives the same intervals."""
    m = TwoX(design)
    masses, region = bar_masses(m), stable_wrench_feasible_joint_space(m)
    rng = np.random.default_rng(1)
    for value in rng.uniform(-2.6, 2.6, 4):
        for scanned, printed in ((0, printed_in_t1), (1, printed_in_t2)):
            ours, theirs = polynomial(design, masses, 0, scanned, value), printed(design, masses, value)
            top = np.abs(theirs).argmax()
            np.testing.assert_allclose(ours / ours[top], theirs / theirs[top], rtol=0, atol=1e-9)
            for interval in region.slices(1 - scanned, value)[0]:
                for end, name in zip(interval[:2], interval[2:], strict=True):
                    if name == "left 1":  # f1: the left cable at its lower bound, the right one at the upper
                        powers = math.sin(end / 4) ** np.arange(len(theirs))[::-1]
                        powers = powers * math.cos(end / 4) ** np.arange(len(theirs))
                        assert abs(theirs @ powers) < 1e-9 * (np.abs(theirs) @ np.abs(powers))
    for scanned in (0, 1):
        for value in rng.uniform(-3, 3, 3):
            angles = candidates([polynomial(design, masses, k, scanned, value) for k in range(8)])
            expected = intervals(m, scanned, value, angles)
            found = region.slices(1 - scanned, value)[0]
            assert len(found) == len(expected)
            for interval, known in zip(found, expected, strict=True):
                assert interval[:2] == pytest.approx(known, abs=1e-6)


def test_a_load_moves_the_boundary_like_a_payload():
    weight = 0.3
    loaded = stable_wrench_feasible_joint_space(TwoX(), load=(0.0, -9.8 * weight)).trace(120)
    assert loaded.area == pytest.approx(
        stable_wrench_feasible_joint_space(TwoX(replace(MURALIDHARAN2022, payload=weight))).trace(120).area, abs=1e-9
    )
    pushed = stable_wrench_feasible_workspace(TwoX(), load=(3.0, 0.0), resolution=100, tolerance=1e-5)
    left, _, right, _ = pushed.reachable.bounds
    assert abs(left + right) > 1e-3  # no longer symmetric


def test_degenerate_designs():
    paper = MURALIDHARAN2022
    for changes, match in (
        ({"l": 0.05}, "l = "),
        ({"l": 0.04}, "l = "),
        ({"min_tension": 155.0}, "max_tension"),
        ({"min_tension": 200.0}, "max_tension"),
        ({"payload": math.nan}, "payload"),
    ):
        with pytest.raises(ValueError, match=match):
            replace(paper, **changes)
    no_springs = replace(paper, k1=0.0, k2=0.0)
    assert not traced_of(no_springs).is_empty  # the cables' stiffness is enough
    weightless = traced_of(replace(paper, gravity=0.0))  # stable everywhere, since the energy is convex
    assert weightless.lengths()[STABILITY] == 0
    assert 0 < weightless.fraction < 1
    weightless = traced_of(replace(paper, gravity=0.0, k1=0.0, k2=0.0))  # and no moment to hold
    assert weightless.fraction == pytest.approx(1.0, abs=1e-12)
    assert weightless.lengths()[LIMIT] == pytest.approx(8 * CLIP)
    short = replace(paper, a=0.0)
    axis = np.linspace(-CLIP, CLIP, 801)
    share = TwoX(short).is_stable_wrench_feasible((axis[:, None], axis[None, :])).mean()
    assert traced_of(short).fraction == pytest.approx(share, abs=2e-3)
    for sheet in workspace_of(short).sheets:
        assert sheet.area > 0
    kinematic = workspace_of(FURET2018(0.5))
    assert kinematic.sheets[0].source.fraction + kinematic.sheets[1].source.fraction == pytest.approx(1, abs=1e-6)


def test_bad_arguments():
    for limit in (0.0, math.pi, -1.0, math.nan):
        with pytest.raises(ValueError, match="limit"):
            stable_wrench_feasible_joint_space(TwoX(), limit)
    with pytest.raises(ValueError, match="sheet"):
        stable_wrench_feasible_joint_space(TwoX(), sheet=2)
    with pytest.raises(ValueError, match="batch"):
        stable_wrench_feasible_joint_space(TwoX(replace(MURALIDHARAN2022, payload=np.array([0.0, 0.1]))))
    narrow = stable_wrench_feasible_joint_space(TwoX(), 0.5).trace(32)
    assert narrow.fraction == pytest.approx(1.0)
    assert stable_wrench_feasible_joint_space(TwoX(replace(MURALIDHARAN2022, joint_limit=1.0))).upper == (1.0, 1.0)
    assert workspace_of(MURALIDHARAN2022).count(5.0, 5.0) == 0
