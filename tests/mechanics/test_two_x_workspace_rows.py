"""The rows of tests/data/two_x.json that concern areas, boundaries, cusps and degrees; others: *_published_numbers."""

import json
import math
from dataclasses import replace
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import sympy
from test_two_x_published_numbers import WORKSPACE_ROWS
from two_x_polynomials import DEGREES, bar_masses, conditions, fourier

from tensegrity_envs.geometry.accessibility import accessibility
from tensegrity_envs.geometry.overlay import union
from tensegrity_envs.geometry.workspace import (
    stable_wrench_feasible_joint_space,
    stable_wrench_feasible_workspace,
)
from tensegrity_envs.mechanics import FURET2018, MURALIDHARAN2022, TwoX
from tensegrity_envs.mechanics.two_x import furet_quartic

ROWS = {row["id"]: row for row in json.loads((Path(__file__).parents[1] / "data" / "two_x.json").read_text())["rows"]}
CHECKS = {}


def checks(*prefixes):
    def register(function):
        CHECKS.update(dict.fromkeys(prefixes, function))
        return function

    return register


@pytest.mark.parametrize("row_id", sorted(WORKSPACE_ROWS))
def test_row(row_id):
    row = ROWS[row_id]
    CHECKS[max((p for p in CHECKS if row_id.startswith(p)), key=len)](row["inputs"], row["expected"], row["tolerance"])


def furet(inputs):
    return TwoX(FURET2018(inputs["b"], joint_limit=2 * inputs.get("theta_max", math.pi)))


def paper(inputs):
    changes = {
        "paper": {},
        "paper with mp=0.2": {"payload": 0.2},
        "paper with mp=0.5": {"payload": 0.5},
        "paper with Fmax=50": {"max_tension": 50.0},
        "paper with k1=100,k2=50": {"k1": 100.0, "k2": 50.0},
    }[inputs["design"]]
    return TwoX(replace(MURALIDHARAN2022, **changes))


@cache
def workspace_of(design):
    return stable_wrench_feasible_workspace(TwoX(design))


def assert_same_points(found, expected, tolerance):
    found, expected = np.array(found), np.array(expected)
    assert found.shape == expected.shape
    gaps = np.abs(found[:, None] - expected[None]).max(axis=2)
    assert gaps.min(axis=0).max() <= tolerance
    assert gaps.min(axis=1).max() <= tolerance


@checks("F_cusp_")
def cusps(inputs, expected, tolerance):
    found = accessibility(furet(inputs)).cusps
    assert len(found) == expected["n_cusps"]
    assert_same_points([c.tip for c in found], expected["cusps_xy"], tolerance)
    (upper_right,) = [c for c in found if min(c.tip) > 0]
    theta = np.array(upper_right.configuration) / 2
    assert np.abs(np.abs(theta) - np.abs(expected["theta_upper_right"])).max() <= tolerance


@checks("F_node_")
def nodes(inputs, expected, tolerance):
    found = accessibility(furet(inputs)).nodes
    assert_same_points([n.tip for n in found], expected["nodes_xy"], tolerance)
    (upper,) = [n for n in found if n.tip[1] > 0]
    assert_same_points(np.array(upper.configurations) / 2, expected["theta_pair_upper"], tolerance)
    # The lower arc of the four-solution region crosses x = 0 in a pose with det J = 0.
    top = max(accessibility(furet(inputs)).parts(4), key=lambda part: part.centroid.y)
    assert top.bounds[1] < expected["lower_arc_at_x0"] < top.bounds[3]
    y = expected["lower_arc_at_x0"]
    assert len(furet(inputs).inverse_kinematics(0.0, y + 1e-6)) == 4
    assert len(furet(inputs).inverse_kinematics(0.0, y - 1e-6)) == 2


@checks("F_area4_")
def areas_of_four_solutions(inputs, expected, tolerance):
    parts = accessibility(furet(inputs)).parts(4)
    assert len(parts) == expected["number_of_4_solution_regions"]
    for part in parts:
        assert part.area == pytest.approx(expected["area_of_each_4_solution_region"], abs=tolerance)


@checks("F_limits_areas")
def joint_limits(inputs, expected, tolerance):
    found = accessibility(furet(inputs))
    for count, name in ((1, "area_1_solution"), (2, "area_2_solutions"), (3, "area_3_solutions")):
        assert found.area(count) == pytest.approx(expected[name], abs=tolerance)
    assert set(found.by_count) == {1, 2, 3}
    x0, y0, x1, y1 = union([r.polygon for r in found.regions if r.count]).bounds
    assert (x0, x1, y1) == pytest.approx((expected["xmin"], expected["xmax"], expected["ymax"]), abs=tolerance)
    # The lowest point is a corner, theta = +-(pi/3, pi/3), exactly -sqrt(2)/3; the row's value is that of a raster.
    assert y0 == pytest.approx(-math.sqrt(2) / 3, abs=4e-9)  # coordinates are rounded
    assert furet(inputs).tip((2 * math.pi / 3,) * 2)[1] == pytest.approx(-math.sqrt(2) / 3, abs=1e-14)
    assert y0 == pytest.approx(expected["ymin"], abs=2e-4)


@checks("F_discriminant")
def discriminant(inputs, expected, tolerance):
    """The quartic's discriminant for one b: its total degree, and the square of the curve that is no boundary."""
    x, y, t = sympy.symbols("x y t")
    b = sympy.Rational(2, 3)
    quartic = [sympy.expand(sympy.nsimplify(c, rational=True)) for c in furet_quartic(x, y, b)]
    found = sympy.Poly(sympy.discriminant(sympy.Poly(quartic, t), t), x, y)
    assert found.total_degree() == expected["total_degree"]
    curve = sympy.Poly((x**2 + y**2) ** 2 - x**2 - (1 - b**2) * y**2, x, y)
    boundary, rest = sympy.div(found, curve**2)
    assert rest.is_zero
    assert boundary.total_degree() == expected["true_boundary_degree"]
    assert not sympy.div(boundary, curve)[1].is_zero
    # The remaining factor is zero on the traced boundary.
    arm = accessibility(TwoX(FURET2018(2 / 3)))
    q = np.concatenate(arm.singular)[::50]
    value = sympy.lambdify((x, y), boundary.as_expr())
    points = np.array(arm.mechanism.tip((q[:, 0], q[:, 1])))
    scale = np.abs(value(*np.random.default_rng(0).uniform(-2, 2, (2, 1000)))).max()
    assert np.abs(value(*points)).max() < 1e-9 * scale


@checks("M_swfj_area", "M_k100_area", "M_mp02_area", "M_mp05_area", "M_F50_area")
def joint_space(inputs, expected, tolerance):
    m = paper(inputs)
    region = stable_wrench_feasible_joint_space(m)
    traced = region.trace()
    assert traced.fraction == pytest.approx(expected["fraction"], abs=tolerance["fraction"])
    assert len(traced.components) == expected["components"]
    if "area_rad2" in expected:
        assert traced.area == pytest.approx(expected["area_rad2"], abs=tolerance["area_rad2"])
    if "alpha1_extent" in expected:
        # A sharp corner, where stability and the right cable of joint 1 end together; the row's value, from lines some
        # 1e-3 rad apart, does not reach it: at 2.8082 there still are stable, wrench-feasible configurations.
        low, high = traced.bounds()
        assert high[0] == pytest.approx(-low[0], abs=1e-12)
        assert high[0] == pytest.approx(expected["alpha1_extent"], abs=1e-3)
        assert m.is_stable_wrench_feasible((2.8082, 1.1662))
        corner = (2.808256527, 1.166276203)
        assert high[0] == pytest.approx(corner[0], abs=1e-8)
        assert m.posture(corner)[1:] == pytest.approx((0, 0), abs=1e-7)
        assert high[1] == pytest.approx(0.99 * math.pi, abs=1e-15)
    if "WFJ_fraction" in expected:
        axis = np.linspace(-0.99 * math.pi, 0.99 * math.pi, 1001)
        share = (m.posture((axis[:, None], axis[None, :]))[2] >= 0).mean()
        assert share == pytest.approx(expected["WFJ_fraction"], abs=tolerance["WFJ_fraction"])
    if "swfw_area_union" in expected:
        names = {"area_union": "swfw_area_union", "area_each_sheet": "swfw_each_sheet", "area_overlap": "swfw_overlap"}
        sub = {new: expected[old] for new, old in names.items()}
        workspace(inputs, sub, {new: tolerance[old] for new, old in names.items()})


@checks("M_swfw_area")
def workspace(inputs, expected, tolerance):
    found = workspace_of(paper(inputs).design)
    assert found.area() == pytest.approx(expected["area_union"], abs=tolerance["area_union"])
    assert found.overlap == pytest.approx(expected["area_overlap"], abs=tolerance["area_overlap"])
    for sheet in found.sheets:
        assert sheet.area == pytest.approx(expected["area_each_sheet"], abs=tolerance["area_each_sheet"])
    if "hole_area" in expected:
        assert found.holes[0].area == pytest.approx(expected["hole_area"], abs=tolerance["hole_area"])
        assert found.most[:2] == (expected["max_preimages_per_sheet"],) * 2
        for name, value in zip(("xmin", "ymin", "xmax", "ymax"), found.reachable.bounds, strict=True):
            assert value == pytest.approx(expected[name], abs=tolerance[name])


@checks("M_swfw_on_x0")
def on_the_axis(inputs, expected, tolerance):
    spans = workspace_of(paper(inputs).design).along((0.0, -1.0), (0.0, 1.0))
    assert [n for _, _, n in spans] == [expected["preimages_inside"]] * len(expected["reachable_y"])
    for (low, high, _), known in zip(spans, expected["reachable_y"], strict=True):
        assert (low[1], high[1]) == pytest.approx(known, abs=tolerance)


@checks("M_degrees")
def degrees(inputs, expected, tolerance):
    """By elimination of the one square root in exact arithmetic, and by sampling for the published arm."""
    assert (DEGREES[0][0], DEGREES[1][0]) == (expected["f1_in_t1"], expected["f1_in_t2"])
    assert DEGREES[0][2] == 2 * expected["f3_in_tan_alpha1_half"]
    assert DEGREES[1][2] == expected["f3_in_t2"]
    assert DEGREES[0][4] == expected["stability_minimal_degree_t1"]
    assert DEGREES[1][4] == expected["stability_minimal_degree_t2"]
    m = TwoX()
    for scanned in (0, 1):
        for k in range(8):
            terms = np.abs(fourier(m.design, bar_masses(m), k, scanned, 0.7))
            order = DEGREES[scanned][k] // 2
            assert terms[order + 1 : 33].max() < 1e-14 * terms.max()
            assert terms[order] > 1e-9 * terms.max()
    for k, scanned in ((0, 0), (0, 1), (2, 1), (4, 0), (4, 1)):
        numerator = exact(k, scanned)
        ((factor, power),) = [f for f in sympy.factor_list(numerator)[1] if sympy.degree(f[0]) > 2]
        assert (sympy.degree(factor), power) == (DEGREES[scanned][k], 1)


def exact(k, scanned):
    """Condition k times its conjugate, over the rationals, as the numerator of a fraction in t."""
    t, r = sympy.symbols("t r")
    numbers = [sympy.Rational(n, 7) for n in (11, 5, 9, 4, 3)]
    constants = type("C", (), dict(zip(("c1x", "c1x_", "c2x", "c3x", "c3x_"), numbers, strict=True)))
    design = type("D", (), {"b": sympy.Integer(1), "max_tension": sympy.Integer(13), "min_tension": sympy.Integer(2)})
    # cos = 3/5, and a rational square root: l^2 = (8/5)^2 + (3/5)^2
    other = (sympy.Rational(3, 5), sympy.Rational(4, 5), sympy.Rational(8, 5))
    ll = sympy.Rational(73, 25)
    assert Fraction(73, 25) == Fraction(8, 5) ** 2 + Fraction(3, 5) ** 2
    c, s = (1 - t**2) / (1 + t**2), 2 * t / (1 + t**2)
    mine = (c, s, r)
    value = conditions(design, k, (mine, other) if scanned == 0 else (other, mine), constants)
    top, _ = sympy.fraction(sympy.together(value))
    even = sympy.expand(sympy.cancel((ll - c**2) * (1 + t**2) ** 2))  # r^2 (1 + t^2)^2
    poly = sympy.Poly(top, r)
    parts = [sympy.Integer(0), sympy.Integer(0)]
    square = even / (1 + t**2) ** 2
    for (power,), coefficient in poly.terms():
        parts[power % 2] += coefficient * square ** (power // 2)
    product = sympy.together(parts[0] ** 2 - square * parts[1] ** 2)
    found, _ = sympy.fraction(sympy.cancel(product))
    common = sympy.Poly(sympy.fraction(sympy.cancel(even))[0], t)
    result = sympy.Poly(found, t)
    for divisor in (common, sympy.Poly(1 + t**2, t)):
        while True:
            quotient, rest = sympy.div(result, divisor)
            if not rest.is_zero:
                break
            result = quotient
    return result
