"""The plain 2-X: cusps and nodes by elimination, regions against inverse kinematics, checks of posture changes."""

import math
from collections import Counter
from dataclasses import replace
from functools import cache

import mpmath
import numpy as np
import pytest
import shapely
from two_x_reference import CertifiedRoots

from tensegrity_envs.geometry import singularity as generic
from tensegrity_envs.geometry.accessibility import (
    FULL_TURN,
    accessibility,
    aspects,
    is_cuspidal,
    posture_change,
    posture_pairs,
    singular_factor,
    summary,
    tip_curve,
    wrapped,
)
from tensegrity_envs.geometry.overlay import feature_collection
from tensegrity_envs.mechanics import FURET2018, MURALIDHARAN2022, TwoX
from tensegrity_envs.mechanics.two_x import furet_quartic


@cache
def found(b, limit=2 * math.pi):
    return accessibility(TwoX(FURET2018(b, limit)))


def quartic(x, y, b):
    """`furet_quartic` in mpmath's arithmetic."""
    xx, yy, bb = x * x, y * y, b * b
    rr = (xx + yy) ** 2
    return [
        (b + 1) ** 2 * (bb * yy + rr + 4 * x * (xx + yy) + 5 * xx + yy + 2 * x),
        4 * y * (b + 1) * (2 * bb * x + bb - 2 * xx - 2 * yy - 4 * x - 1),
        2 * (bb * bb * yy + bb * rr + bb * xx - 10 * bb * yy + rr - 3 * xx + 9 * yy),
        4 * y * (b - 1) * (2 * bb * x - bb + 2 * xx + 2 * yy - 4 * x + 1),
        (b - 1) ** 2 * (bb * yy + rr - 4 * x * (xx + yy) + 5 * xx + yy - 2 * x),
    ]


@pytest.mark.parametrize("b", [0.42, 0.5, 0.6, 2 / 3, 0.8, 0.9, 0.97, 0.995])
def test_cusps_are_triple_roots_of_the_quartic(b):
    """[Furet2018, Eq. 9], the first two equations, solved to 30 digits; all four cusps, by symmetry."""
    tips = np.array([c.tip for c in found(b).cusps])
    assert len(tips) == 4
    with mpmath.workdps(40):
        exact_b = mpmath.mpf(b)

        def triple(x, y):
            a4, a3, a2, a1, a0 = quartic(x, y, exact_b)
            i = a4 * a0 - a3 * a1 / 4 + a2**2 / 12
            j = a4 * a2 * a0 / 6 - a4 * a1**2 / 16 - a3**2 * a0 / 16 + a3 * a2 * a1 / 48 - a2**3 / 216
            return i, j

        # Both vanish to second order in some direction: polished by Muller's robust relative, from close by.
        x, y = max(tips.tolist(), key=sum)
        root = mpmath.findroot(triple, (mpmath.mpf(x), mpmath.mpf(y)), tol=1e-50, verify=False)
    for sign_x in (1, -1):
        for sign_y in (1, -1):
            gaps = np.hypot(tips[:, 0] - sign_x * float(root[0]), tips[:, 1] - sign_y * float(root[1]))
            assert gaps.min() < 1e-9
    for cusp in found(b).cusps:
        m = found(b).mechanism
        assert m.jacobian_determinant(cusp.configuration) == pytest.approx(0, abs=1e-12)
        assert m.tip(cusp.configuration) == pytest.approx(cusp.tip, abs=1e-12)


def test_published_cusps_and_their_number():
    tips = np.array([c.tip for c in found(2 / 3).cusps])
    for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        expected = np.multiply(signs, (0.863652481870, 1.183814476881))
        assert np.hypot(*(tips - expected).T).min() < 1e-9
    assert len(found(0.40).cusps) == 0
    assert len(found(0.40).nodes) == 0
    assert len(found(0.41).cusps) == 4
    assert len(found(0.41).nodes) == 2


@pytest.mark.parametrize("b", [0.41, 0.5, 2 / 3, 0.9, 0.97])
def test_nodes_are_pairs_of_double_roots(b):
    """At a node the quartic is a square."""
    nodes = found(b).nodes
    assert len(nodes) == 2
    for node in nodes:
        a = furet_quartic(*node.tip, b)
        p = a[1] / a[0] / 2
        q = (a[2] / a[0] - p * p) / 2
        np.testing.assert_allclose(a[3:] / a[0], [2 * p * q, q * q], rtol=0, atol=1e-8)
        for configuration in node.configurations:
            assert found(b).mechanism.tip(configuration) == pytest.approx(node.tip, abs=1e-10)
            assert found(b).mechanism.jacobian_determinant(configuration) == pytest.approx(0, abs=1e-11)
    published = {2 / 3: 1.636385610741419, 0.9: 1.4832659665002217, 0.5: 1.7511984743965474}
    if b in published:
        assert max(n.tip[1] for n in nodes) == pytest.approx(published[b], abs=1e-9)


def test_cuspidality_theorem():
    edge = 1 / math.sqrt(6)
    assert not is_cuspidal(0.40, 1.0)
    assert is_cuspidal(0.41, 1.0)
    assert is_cuspidal(edge * 1.0000001, 1.0)
    assert not is_cuspidal(edge * 0.9999999, 1.0)
    for b in (0.2, 0.35, 0.405, 0.412, 0.5, 0.95):
        assert is_cuspidal(b, 1.0) == bool(found(b).cusps) == (4 in found(b).by_count) == is_cuspidal(2 * b, 2.0)
    for bad in ((1.0, 1.0), (1.2, 1.0), (0.0, 1.0), (-1.0, 1.0), (math.nan, 1.0), (0.5, math.inf)):
        with pytest.raises(ValueError, match="b = "):
            is_cuspidal(*bad)


def test_areas_and_reach():
    for b, area in ((0.5, 0.003827092), (2 / 3, 0.115201), (0.9, 0.804141)):
        parts = found(b).parts(4)
        assert [part.area for part in parts] == pytest.approx([area, area], abs=2e-6)
        assert len(found(b).parts(2)) == 1
        assert set(found(b).by_count) == {2, 4}
    for b, top in ((0.4, 1.8337772590), (2 / 3, 1.6688581692), (0.9, 1.5500138198)):
        x0, y0, x1, y1 = shapely.total_bounds(list(found(b).by_count.values()))
        assert (x0, x1, y0, y1) == pytest.approx((-2, 2, -top, top), abs=1e-6)


def test_types_of_figure_6():
    areas = {types: shape.area for types, shape in found(2 / 3).by_type.items()}
    assert areas["4 UU"] == pytest.approx(0.0032, abs=1e-4)
    assert areas["2 UU + 2 UD"] == pytest.approx(0.0467, abs=5e-4)
    assert areas["3 UU + 1 UD"] == pytest.approx(0.0657, abs=5e-4)
    x0, y0, x1, y1 = found(2 / 3).by_type["4 UU"].bounds
    assert (y0, y1) == pytest.approx((1.600, 1.636), abs=2e-3)
    assert x0 == pytest.approx(-x1, abs=1e-6)
    # Turning the base by pi exchanges up and down of joint 1 and keeps the workspace: areas come in pairs.
    for one, other in (
        ("4 UU", "4 DD"),
        ("2 UU + 2 UD", "2 DU + 2 DD"),
        ("1 UU + 1 UD", "1 DU + 1 DD"),
        ("2 UD", "2 DU"),
    ):
        assert areas[one] == pytest.approx(areas[other], abs=2e-6)


def random_arms():
    rng = np.random.default_rng(11)
    for k in range(20):
        b = float(rng.uniform(0.15, 0.97))
        limit = 2 * math.pi if k % 3 == 0 else float(rng.uniform(0.6, 6.2))
        yield b, limit


@pytest.mark.parametrize(("b", "limit"), list(random_arms()))
def test_regions_against_inverse_kinematics(b, limit):
    """Number and types of solutions at random points, and areas as Monte Carlo estimates."""
    arm = found(b, limit)
    m = arm.mechanism
    rng = np.random.default_rng(int(1e6 * b))
    x, y = rng.uniform(-2.05, 2.05, (2, 1500))
    a1, a2 = m.inverse_kinematics_batch(x, y)
    types = []
    for u, v in zip(a1, a2, strict=True):
        states = Counter(
            "DU"[int(p < math.pi)] + "DU"[int(q < math.pi)]
            for p, q in zip(abs(u), abs(v), strict=True)
            if not math.isnan(p)
        )
        types.append(" + ".join(f"{states[s]} {s}" for s in ("UU", "UD", "DU", "DD") if states[s]))
    chains = (*arm.singular, *arm.flat.values(), *arm.limits)
    curves = shapely.multilinestrings([shapely.linestrings(tip_curve(m, chain)) for chain in chains])
    mapped = np.array([""] * len(x), dtype=object)
    for name, shape in arm.by_type.items():
        mapped[shapely.contains_xy(shape, x, y)] = name
    for k in np.flatnonzero(mapped != np.array(types, dtype=object)):
        assert shapely.distance(curves, shapely.Point(x[k], y[k])) < 1e-4, (x[k], y[k], mapped[k], types[k])
    counts = (~np.isnan(a1)).sum(axis=1)
    for count in (1, 2, 3, 4):
        share = (counts == count).mean()
        known = arm.area(count) / 4.1**2
        assert abs(share - known) < 4.5 * math.sqrt((max(share, known) + 1e-3) / len(x))


def test_three_solutions_within_joint_limits():
    """[Furet2018, Fig. 7] has one and two; a root finder that proves its counts has three in the slivers."""
    arm = found(2 / 3, 2 * math.pi / 3)
    assert len(arm.parts(3)) == 2
    point = shapely.Point(0.7514903, 1.2771863)
    assert arm.by_count[3].contains(point)
    assert len(arm.mechanism.inverse_kinematics(point.x, point.y)) == 3
    roots, undecided = CertifiedRoots(2 / 3, 1.0, 0.0, 2 * math.pi / 3).solve(point.x, point.y)
    assert (len(roots), undecided) == (3, False)
    assert len(arm.parts(1)) == 2
    assert set(arm.by_type) == {"1 UU", "2 UU", "3 UU"}
    assert not arm.flat


def test_an_arm_with_offsets():
    arm = accessibility(TwoX(MURALIDHARAN2022))
    rng = np.random.default_rng(2)
    x, y = rng.uniform(-0.6, 0.6, (2, 800))
    counts = (~np.isnan(arm.mechanism.inverse_kinematics_batch(x, y)[0])).sum(axis=1)
    for count, shape in arm.by_count.items():
        assert (shapely.contains_xy(shape, x, y) == (counts == count)).mean() > 0.998
    with pytest.raises(ValueError, match="joint_limit"):
        accessibility(TwoX(replace(MURALIDHARAN2022, joint_limit=4.0)))
    with pytest.raises(ValueError, match="batch"):
        accessibility(TwoX(replace(FURET2018(0.5), payload=np.array([0.0, 1.0]))))


def test_singular_factor_is_smooth_where_det_j_has_a_line_of_zeros():
    m = TwoX(FURET2018(2 / 3))
    f = singular_factor(m)
    a1 = np.linspace(-6, 6, 50)
    on_line = np.asarray(f((a1, 2 * math.pi - a1)))
    for h in (1e-3, 1e-5, 1e-9):
        assert np.abs(np.asarray(f((a1, 2 * math.pi - a1 + h))) - on_line).max() < 2 * h + 1e-9
    assert np.abs(m.jacobian_determinant((a1, 2 * math.pi - a1))).max() < 1e-15


def test_summary_and_export():
    numbers = summary(found(0.9))
    assert numbers["cusps"] == 4
    assert numbers["regions with 4 solutions"] == 2
    document = feature_collection(found(0.9).to_features())
    shapes = [shapely.geometry.shape(f["geometry"]) for f in document["features"]]
    total = sum(s.area for s, f in zip(shapes, document["features"], strict=True) if "solutions" in f["properties"])
    assert total == pytest.approx(found(0.9).area(2) + found(0.9).area(4), abs=1e-9)
    assert sum(f["properties"].get("point") == "cusp" for f in document["features"]) == 4
    pieces = [p for chain in found(0.9).singular for p in wrapped(chain)]
    assert all(np.abs(p).max() <= 2 * math.pi for p in pieces)
    assert max(np.abs(np.diff(p, axis=0)).max() for p in pieces) < 0.2


# ------------------------------------------------------------------------------------------- aspects, posture changes


@pytest.mark.parametrize("b", [0.3, 0.5, 2 / 3, 0.9])
def test_two_aspects_on_the_torus(b):
    """det J changes sign on two closed curves that run around the torus: one aspect for each sign."""
    sets = aspects(TwoX(FURET2018(b)))
    assert sorted(sets.signs) == [-1, 1]
    assert sum(sets.areas) == pytest.approx(FULL_TURN**2, rel=0.03)
    m = TwoX(FURET2018(b))
    q = np.meshgrid(*sets.axes, indexing="ij")
    signs = np.sign(m.jacobian_determinant(tuple(q)))
    for label, sign in enumerate(sets.signs):
        assert (signs[sets.labels == label] == sign).all()


def test_aspects_of_the_published_arm():
    sets = aspects(TwoX(MURALIDHARAN2022))
    assert sorted(sets.signs)[:1] == [-1]
    assert sets.count >= 2


def check(m, path, start, goal, torus=True):
    """det J keeps its sign on a dense sample of the polygon, and the ends are right."""
    q = path.configurations
    assert np.abs(q[0] - start).max() < 1e-12
    gap = np.abs(q[-1] - goal)
    assert (np.minimum(gap % FULL_TURN, -gap % FULL_TURN) if torus else gap).max() < 1e-9
    assert np.abs(np.diff(q, axis=0)).max() <= 0.05 + 1e-12
    t = np.linspace(0, 1, 21)[:, None, None]
    dense = (q[:-1] + t * np.diff(q, axis=0)).reshape(-1, 2)
    values = m.jacobian_determinant((dense[:, 0], dense[:, 1]))
    assert (np.sign(values) == np.sign(m.jacobian_determinant(start))).all()
    ends = min(abs(m.jacobian_determinant(start)), abs(m.jacobian_determinant(goal)))
    assert path.clearance > min(0.3 * ends, 1e-3)
    np.testing.assert_allclose(path.tips, np.stack(m.tip((q[:, 0], q[:, 1])), axis=1), rtol=0, atol=1e-12)


@pytest.mark.parametrize("b", [0.45, 0.5, 2 / 3, 0.9, 0.99])
def test_posture_changes_run_around_a_cusp(b):
    arm = found(b)
    m = arm.mechanism
    rng = np.random.default_rng(4)
    straight_fails = done = 0
    while done < 4:
        part = arm.parts(4)[done % 2]
        x0, y0, x1, y1 = part.bounds
        x, y = rng.uniform(x0, x1), rng.uniform(y0, y1)
        if not part.contains(shapely.Point(x, y)) or part.exterior.distance(shapely.Point(x, y)) < 0.03 * (y1 - y0):
            continue
        pairs = posture_pairs(m, x, y)
        assert len(pairs) == 2
        for start, goal in pairs:
            path = posture_change(m, start, goal)
            check(m, path, start, goal)
            turns = path.encircled([cusp.tip for cusp in arm.cusps])
            assert any(turns), turns
            line = np.linspace(start, goal, 500)
            straight_fails += (
                np.sign(m.jacobian_determinant((line[:, 0], line[:, 1]))) != np.sign(m.jacobian_determinant(start))
            ).any()
        done += 1
    assert straight_fails > 0


def test_posture_change_where_it_is_impossible():
    m = TwoX(FURET2018(0.4))
    assert posture_pairs(m, 0.3, 1.2) == []
    first, second = (s.configuration for s in m.inverse_kinematics(0.3, 1.2))
    with pytest.raises(ValueError, match="different aspects"):
        posture_change(m, first, second)
    with pytest.raises(ValueError, match="singular"):
        posture_change(m, (0.0, 0.0), first)
    with pytest.raises(ValueError, match="finite"):
        posture_change(m, (math.nan, 0.0), first)
    limited = TwoX(FURET2018(0.9, 2.0))
    with pytest.raises(ValueError, match="limit"):
        posture_change(limited, (2.5, 0.0), (0.3, 0.4))


def test_posture_change_within_joint_limits():
    """In the three-solution slivers two solutions share a sign; the limits cut some pairs apart."""
    arm = found(2 / 3, 2 * math.pi / 3)
    m = arm.mechanism
    part = arm.parts(3)[0]
    point = part.representative_point()
    for start, goal in posture_pairs(m, point.x, point.y):
        path = posture_change(m, start, goal)
        check(m, path, start, goal, torus=False)
        assert np.abs(path.configurations).max() <= 2 * math.pi / 3 + 1e-12


def test_generic_curves_on_another_map():
    """(u, v) -> (u, v^3 - u v): det J = 3 v^2 - u, a cusp at the origin, no node."""

    class Whitney:
        reach = 1.0

        def tip(self, q):
            return q[0], q[1] ** 3 - q[0] * q[1]

        def jacobian(self, q):
            return (1 + 0 * q[0], 0 * q[0]), (-q[1], 3 * q[1] ** 2 - q[0])

        def jacobian_determinant(self, q):
            return 3 * q[1] ** 2 - q[0]

    m = Whitney()
    curves = generic.zero_curves(m.jacobian_determinant, ((-1.0, -1.1), (1.2, 1.0)), m.tip)
    (cusp,) = generic.cusps(m, curves)
    assert (*cusp.tip, *cusp.configuration) == pytest.approx((0, 0, 0, 0), abs=1e-9)
    assert generic.nodes(m, curves) == []
    for curve in curves:
        assert np.abs(m.jacobian_determinant((curve[:, 0], curve[:, 1]))).max() < 1e-10
