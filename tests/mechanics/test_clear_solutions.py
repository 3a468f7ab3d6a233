"""Inverse solutions clear of obstacles, against Shapely on dense samples of all solutions."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from n_x_checks import best_by_slides
from scipy.optimize import brentq, nnls
from test_clearance import by_shapely, random_polygon
from test_dual_triangle_local_optima import UNEQUAL, completed, tapered

from tensegrity_envs.geometry.clear_solutions import clear_solutions
from tensegrity_envs.geometry.clearance import Disc, Wall, bars_of
from tensegrity_envs.geometry.own_bars import own_pairs
from tensegrity_envs.mechanics import (
    MURALIDHARAN2022,
    NX,
    THREE_X,
    ZHAO2021_CAPTION,
    DualTriangle,
    NXDesign,
    PlanarFourBar,
    PlanarFourBarDesign,
    SpatialPrism,
    TwoX,
)

OBJECTIVES = ("clearance", "sum", "max", "squares", "margin")
LARGER = ("clearance", "margin")


def obstacles_near(rng, reach):
    discs = [Disc(tuple(rng.uniform(-0.6, 0.9, 2) * reach), rng.uniform(0.03, 0.1) * reach) for _ in range(3)]
    return [*discs, Wall((0.0, -0.5 * reach), (0.2, 1.0))]


def gaps_by_shapely(arm, q, obstacles, pairs=()):
    """Clearances of configurations (n, k) from discs, walls and, where they do not cross, pairs of own bars."""
    named = bars_of(arm, tuple(q))
    bars = np.array([np.broadcast_arrays(*(v for end in bar for v in end)) for bar in named.values()])
    lines = shapely.linestrings(bars.transpose(0, 2, 1).reshape(*bars.shape[::2], 2, 2))
    line = dict(zip(named, lines, strict=True))
    gaps = [shapely.distance(line[first], line[second])[None] for first, second in pairs]
    for one in obstacles:
        if isinstance(one, Disc):
            gaps.append(shapely.distance(lines, shapely.Point(one.centre)) - one.radius)
        else:
            normal = np.array(one.normal) / np.hypot(*one.normal)
            gaps.append(((shapely.get_coordinates(lines) - one.point) @ normal).reshape(*lines.shape, 2).min(axis=-1))
    return np.concatenate(gaps).min(axis=0)


def value_of(arm, objective, q, gaps, start):
    if objective == "clearance":
        return -gaps
    if objective == "margin":
        return -np.minimum(*arm.posture(tuple(q))[1:])
    move = np.abs(q - np.array(start)[:, None])
    return {"sum": move.sum(0), "max": move.max(0), "squares": (move**2).sum(0)}[objective]


@pytest.mark.parametrize(
    "arm",
    [TwoX(MURALIDHARAN2022), NX(NXDesign.from_two_x(MURALIDHARAN2022)), DualTriangle(UNEQUAL, 2)],
    ids=["two_x", "n_x", "dual_triangle"],
)
def test_of_two_joints_they_are_the_inverse_solutions_that_touch_nothing(arm):
    rng, kept, left_out = np.random.default_rng(0), 0, 0
    limit = 0.9 * min(float(arm.design.joint_limit), 2.6)
    for _ in range(30):
        x, y = arm.tip(tuple(rng.uniform(-limit, limit, 2).tolist()))
        obstacles = [Disc(tuple(rng.uniform(-0.5, 0.9, 2) * arm.reach), 0.1 * arm.reach), random_polygon(rng)]
        least = rng.choice([0.0, 0.02]) * arm.reach
        expected = []
        for one in arm.inverse_kinematics(x, y):
            bars = bars_of(arm, one.configuration).values()
            gap = min(by_shapely(obstacle, bar) for obstacle in obstacles for bar in bars)
            left_out += gap <= least
            if gap > least and getattr(one, "is_within_limits", True):
                expected.append((gap, one.configuration))
        found = clear_solutions(arm, x, y, obstacles, least=least)
        kept += len(found)
        assert [one.clearance for one in found] == sorted((one.clearance for one in found), reverse=True)
        expected.sort(reverse=True)
        np.testing.assert_allclose([one.clearance for one in found], [gap for gap, _ in expected], atol=1e-9)
        assert all(one.objective == one.clearance for one in found)
        configurations = sorted(one.configuration for one in found)  # several are as clear where the base is nearest
        np.testing.assert_allclose(configurations, sorted(q for _, q in expected), atol=1e-7)
    assert kept > 10
    assert left_out > 5


def check(arm, objective, found, q, obstacles, start, least, close):
    """What is found is clear and at the target, and no sample (n, k) is better; one comes close."""
    gaps = gaps_by_shapely(arm, q, obstacles)
    values = np.where(gaps > least, value_of(arm, objective, q, gaps, start), np.inf)
    if not found:
        assert not np.isfinite(values).any()
        return None
    sign = -1.0 if objective in LARGER else 1.0
    column = np.array(found[0].configuration)[:, None]
    gap = gaps_by_shapely(arm, column, obstacles)
    assert gap[0] > least
    assert found[0].clearance == pytest.approx(gap[0], abs=1e-9)
    assert sign * found[0].objective == pytest.approx(value_of(arm, objective, column, gap, start)[0], abs=1e-9)
    assert [sign * one.objective for one in found] == sorted(sign * one.objective for one in found)
    assert sign * found[0].objective <= values.min() + 1e-7
    return values.min() - sign * found[0].objective < close


@pytest.mark.parametrize("objective", OBJECTIVES)
@pytest.mark.parametrize("design", [ZHAO2021_CAPTION, tapered(3)], ids=["equal", "tapered"])
def test_three_segments_against_all_first_angles(design, objective):
    arm, rng, close = DualTriangle(design), np.random.default_rng(1), []
    limit = float(arm.design.joint_limit)
    for _ in range(4):
        x, y = (float(v) for v in arm.tip(tuple(rng.uniform(-0.8 * limit, 0.8 * limit, 3))))
        obstacles, start = obstacles_near(rng, float(arm.reach)), tuple(rng.uniform(-0.5, 0.5, 3).tolist())
        first = np.linspace(-limit, limit, 8001)[None]
        q = np.concatenate([completed(arm, first, x, y, elbow) for elbow in (1.0, -1.0)], axis=1)
        q = q[:, (np.abs(q) <= limit).all(axis=0)]
        least = 0.01 * float(arm.reach)
        found = clear_solutions(arm, x, y, obstacles, objective, start, least)
        close.append(check(arm, objective, found, q, obstacles, start, least, 0.05))
    assert close.count(True) >= 2
    assert False not in close


@pytest.mark.parametrize(("objective", "own_bars"), [("clearance", False), ("squares", False), ("squares", True)])
def test_three_x_joints_against_slides(objective, own_bars):
    arm, rng, found = NX(THREE_X), np.random.default_rng(2), 0
    pairs = own_pairs(arm) if own_bars else ()
    for _ in range(2):
        x, y = (float(v) for v in arm.tip(tuple(rng.uniform(-1.5, 1.5, 3))))
        obstacles, start = obstacles_near(rng, float(arm.reach)), tuple(rng.uniform(-0.5, 0.5, 3).tolist())

        def clear_value(q, obstacles=obstacles, start=start):
            gaps = gaps_by_shapely(arm, q, obstacles, pairs)
            return np.where(gaps > 0, value_of(arm, objective, q, gaps, start), np.inf)

        place = np.array([x]), np.array([y])
        slid = best_by_slides(arm, *place, np.array(start)[:, None], clear_value, rng, 60, rounds=60)[0]
        solutions = clear_solutions(arm, x, y, obstacles, objective, start, own_bars=own_bars)
        if not solutions:
            assert not np.isfinite(slid)
            continue
        found += 1
        best = (-1.0 if objective in LARGER else 1.0) * solutions[0].objective
        assert best <= slid + 1e-6
        assert arm.tip(solutions[0].configuration) == pytest.approx((x, y), abs=1e-9)
        assert gaps_by_shapely(arm, np.array(solutions[0].configuration)[:, None], obstacles, pairs)[0] > 0
    assert found


def stationary_residual(arm, q, start, obstacles, least, limit):
    """Of Karush, Kuhn and Tucker's conditions of the "squares" at q (n,), by Shapely; and how many bars touch.

    The gradient is J^T times any forces, plus what limits and clearances push with.
    """
    bars, step, size, n = bars_of(arm, tuple(q)).values(), 1e-6, float(arm.reach), len(q)
    pushes = [-np.sign(q[i]) * np.eye(n)[i] for i in range(n) if abs(q[i]) > limit - 1e-6]
    walls = 0
    for k in range(len(bars)):
        for obstacle in obstacles:

            def gap(place, k=k, obstacle=obstacle):
                return by_shapely(obstacle, list(bars_of(arm, tuple(place)).values())[k])

            if gap(q) - least < 1e-6 * size:
                slope = [(gap(q + step * e) - gap(q - step * e)) / (2 * step) for e in np.eye(n)]
                pushes.append(np.array(slope) / size)
                walls += 1
    rows = np.array(arm.jacobian(tuple(q))) / size
    table = np.vstack([rows, -rows, *pushes]).T
    return nnls(table, 2 * (q - start))[1], walls


@pytest.mark.parametrize(
    ("arm", "spread"),
    [
        (DualTriangle(ZHAO2021_CAPTION, 4), 1.2),
        (DualTriangle(UNEQUAL, 5), 1.0),
        (NX(replace(NXDesign.from_two_x(MURALIDHARAN2022, 4), joint_limit=2.6)), 1.2),
    ],
    ids=["four segments", "five segments", "four x"],
)
def test_of_four_joints_and_more_each_is_a_local_optimum(arm, spread):
    rng, reach, n, blocked, found = np.random.default_rng(11), float(arm.reach), arm.degrees_of_freedom, 0, 0
    limit = float(arm.design.joint_limit)
    for _ in range(2):
        q = rng.uniform(-spread, spread, n)
        x, y = (float(v) for v in arm.tip(tuple(q)))
        middle = np.mean([np.array(end, float) for bar in bars_of(arm, tuple(0.8 * q)).values() for end in bar], axis=0)
        obstacles, start, least = [Disc(tuple(middle), 0.03 * reach)], 0.8 * q, 0.005 * reach
        solutions = clear_solutions(arm, x, y, obstacles, "squares", tuple(start), least)
        configurations = np.array([one.configuration for one in solutions])
        for i, one in enumerate(configurations):
            residual, walls = stationary_residual(arm, one, start, obstacles, least, limit)
            assert residual < 1e-5
            assert all(np.abs(one - other).max() > 1e-4 for other in configurations[:i])
            assert gaps_by_shapely(arm, one[:, None], obstacles)[0] > least
            assert solutions[i].objective == pytest.approx(((one - start) ** 2).sum(), abs=1e-12)
            rows = np.array(arm.jacobian(tuple(one)))
            mix = rng.normal(size=(300, n)) * rng.choice([0, 1], (300, n))
            new = one + 5e-4 * (mix - mix @ np.linalg.pinv(rows) @ rows)
            for _ in range(3):
                off = np.array(arm.tip(tuple(new.T))).T - (x, y)
                new = new - off @ np.linalg.pinv(rows).T
            fine = (np.abs(new) <= limit).all(axis=1) & (gaps_by_shapely(arm, new.T, obstacles) > least)
            fine &= np.abs(off).max(axis=1) < 1e-9 * reach
            assert (((new[fine] - start) ** 2).sum(axis=1) > solutions[i].objective - 1e-8).all()
            blocked, found = blocked + walls, found + 1
    assert found >= 2
    assert blocked


def four_bar_energy(pivots, angles, design, load):
    """Energy of springs and load by hand [J], of arrays of E's angle seen from D and of F's seen from C."""
    (c, d), (of_e, of_f) = pivots, angles
    e = d + design.length * np.array([np.cos(of_e), np.sin(of_e)])
    f = c + design.length * np.array([np.cos(of_f), np.sin(of_f)])
    springs = sum(((p - q) ** 2).sum(axis=0) for p, q in ((c, e), (e, f), (d, f)))
    return design.stiffness / 2 * springs - load[0] * f[0] - load[1] * f[1]


def sign_changes(f, count):
    """Roots of a function of an angle in [0, pi] that takes arrays."""
    angle = np.linspace(0, np.pi, count)
    value = f(angle)
    places = np.flatnonzero(value[1:] * value[:-1] < 0)
    return [brentq(lambda t: float(f(np.array([t]))[0]), angle[i], angle[i + 1], xtol=1e-14) for i in places]


def four_bar_by_energy(arm, x, y, load):
    """Nodes C, D, E, F of all stable equilibria with F at the target, by a scan of both base angles and of energies."""
    length, step, found = arm.length, 1e-5, []

    def base(angle, sign):
        return np.array([length * (1 - sign) / 2 + sign * length * np.cos(angle), length * np.sin(angle)])

    def from_target(beta):
        return np.hypot(*(base(beta, -1.0) - np.array([[x], [y]]))) - length

    for beta in sign_changes(from_target, 20_001):
        c = base(np.array([beta]), -1.0)
        of_f = np.arctan2(y - c[1], x - c[0])

        def lowest(alpha, c=c, of_f=of_f):
            """E's angle of least energy, which is a constant and a wave of it."""
            across, up, back = (
                four_bar_energy((c, base(alpha, 1.0)), (np.array([t]), of_f), arm.design, load)
                for t in (0, np.pi / 2, np.pi)
            )
            return np.arctan2(-(up - (across + back) / 2), -(across - back) / 2)

        def turning(alpha, c=c, of_f=of_f, lowest=lowest):
            of_e, pivots = lowest(alpha), (c, base(alpha, 1.0))
            more, less = (four_bar_energy(pivots, (of_e, of_f + s), arm.design, load) for s in (step, -step))
            return more - less

        for alpha in sign_changes(turning, 20_001):
            angles, d = (lowest(np.array([alpha])), of_f), base(np.array([alpha]), 1.0)

            def moved(i, j, c=c, d=d, angles=angles):
                shifted = (angles[0] + 100 * step * i, angles[1] + 100 * step * j)
                return four_bar_energy((c, d), shifted, arm.design, load)[0]

            mixed = (moved(1, 1) - moved(1, -1) - moved(-1, 1) + moved(-1, -1)) / 4
            diagonal = [moved(i, j) + moved(-i, -j) - 2 * moved(0, 0) for i, j in ((1, 0), (0, 1))]
            if np.linalg.eigvalsh([[diagonal[0], mixed], [mixed, diagonal[1]]])[0] > 0:
                e = d[:, 0] + length * np.array([np.cos(angles[0][0]), np.sin(angles[0][0])])
                found.append((c[:, 0], d[:, 0], e, np.array([x, y])))
    return found


@pytest.mark.parametrize("is_loaded", [False, True])
def test_of_the_four_bar_they_are_the_stable_equilibria_that_touch_nothing(is_loaded):
    """Against a scan of energies, with nodes by hand and distances by Shapely, its own bars among them."""
    arm, rng, kept, left_out = PlanarFourBar(), np.random.default_rng(4), 0, 0
    base, length = np.array([[0.0, 0.0], [arm.length, 0.0]]), arm.length
    pairs = ("AD", "BC"), ("AD", "CF"), ("BC", "DE")  # see docs/obstacles.md
    while kept < 30 or left_out < 10:
        lengths = tuple(rng.uniform(0.2, 1.3, 2) * length)
        if not 0.1 < arm.flatness(lengths)[0] < 0.9:
            continue
        x, y = (float(v) for v in arm.forward_kinematics(lengths, rng.choice([1, -1])).tip)
        load = tuple(rng.normal(0, 0.05 * arm.largest_force, 2)) if is_loaded else (0.0, 0.0)
        obstacles = [Disc(tuple(rng.uniform(-0.5, 1.5, 2) * length), rng.uniform(0.1, 0.4) * length)]
        least, own_bars = rng.choice([0.0, 0.02]) * length, bool(rng.integers(2))
        expected = []
        for c, d, e, f in four_bar_by_energy(arm, x, y, load):
            bars = {"AD": (base[0], d), "BC": (base[1], c), "DE": (d, e), "CF": (c, f)}
            lines = {name: shapely.LineString(bar) for name, bar in bars.items()}
            gaps = [by_shapely(obstacles[0], bar) for bar in bars.values()]
            gaps += [lines[i].distance(lines[j]) for i, j in pairs if own_bars]
            left_out += min(gaps) <= least
            if min(gaps) > least:
                expected.append((np.hypot(*c), np.hypot(*(d - base[1])), min(gaps)))
        found = clear_solutions(arm, x, y, obstacles, least=least, load=load, own_bars=own_bars)
        kept += len(found)
        gaps = [one.clearance for one in found]
        assert gaps == sorted(gaps, reverse=True)
        assert gaps == [one.objective for one in found]
        ours = sorted((*one.lengths, one.clearance) for one in found)
        assert len(ours) == len(expected)
        np.testing.assert_allclose(ours, sorted(expected), atol=1e-6 * length)
        assert all(arm.tip(one.configuration, one.lengths) == pytest.approx((x, y), abs=1e-9) for one in found)
        for objective, start in (("sum", None), ("max", (2.0, 3.0)), ("squares", (2.0, 3.0)), ("margin", None)):
            again = clear_solutions(arm, x, y, obstacles, objective, start, least, load, own_bars)
            assert sorted(one.lengths for one in again) == sorted(one.lengths for one in found)
            values = [one.objective for one in again]
            assert values == sorted(values, reverse=objective == "margin")
            for one in again:
                move = np.abs(np.subtract(one.lengths, start or (length, length)))
                margins = [
                    margin(one.configuration, one.lengths, load) for margin in (arm.stability_margin, arm.wrench_margin)
                ]
                wanted = {"sum": move.sum(), "max": move.max(), "squares": move @ move, "margin": min(margins)}[
                    objective
                ]
                assert one.objective == pytest.approx(wanted)


@pytest.mark.parametrize("objective", ["clearance", "max"])
def test_five_segments_against_random_postures(objective):
    arm, rng, close = DualTriangle(ZHAO2021_CAPTION, 5), np.random.default_rng(3), []
    limit, start = float(arm.design.joint_limit), (0.1, -0.1, 0.0, 0.2, 0.0)
    for _ in range(3):
        x, y = (float(v) for v in arm.tip(tuple(rng.uniform(-0.5, 0.5, 5))))
        obstacles = obstacles_near(rng, float(arm.reach))
        first = rng.uniform(-limit, limit, (3, 10_000))
        q = np.concatenate([completed(arm, first, x, y, elbow) for elbow in (1.0, -1.0)], axis=1)
        q = q[:, (np.abs(q) <= limit).all(axis=0)]
        found = clear_solutions(arm, x, y, obstacles, objective, start)
        close.append(check(arm, objective, found, q, obstacles, start, 0.0, 1.0))
    assert True in close
    assert False not in close


@pytest.mark.parametrize(
    "arm", [TwoX(MURALIDHARAN2022), NX(THREE_X), DualTriangle(ZHAO2021_CAPTION)], ids=lambda arm: type(arm).__name__
)
def test_each_tells_whether_it_can_be_held_under_the_load(arm):
    """Its margins are those of its configuration; both kinds occur, and under a load they are others."""
    rng, load, held = np.random.default_rng(11), (-10.0, -10.0), []
    spread = 0.95 * min(float(arm.design.joint_limit), 2.4)
    far = [Disc((9.0 * float(arm.reach), 0.0), 0.1)]
    for _ in range(4):
        x, y = (float(place) for place in arm.tip(tuple(rng.uniform(-1, 1, arm.degrees_of_freedom) * spread)))
        for given in ((0.0, 0.0), load):
            for one in clear_solutions(arm, x, y, far, "squares", load=given):
                _, stability, wrench = arm.posture(one.configuration, given)
                assert (one.stability_margin, one.wrench_margin) == pytest.approx((stability, wrench), abs=1e-9)
                assert one.is_stable_wrench_feasible == (stability > 0 and wrench >= 0)
                held.append((one.is_stable_wrench_feasible, one.stability_margin))
    assert len({can for can, _ in held}) == 2
    assert len({round(margin, 9) for _, margin in held}) > len(held) // 2


def test_an_obstacle_on_the_base_leaves_nothing_and_wrong_calls_are_explained():
    arm, disc = DualTriangle(), Disc((0.0, 0.0), 0.01)
    assert clear_solutions(arm, 0.2, 0.05, [disc]) == []
    assert clear_solutions(arm, 9.0, 0.0, [Disc((0.0, 2.0), 0.01)]) == []
    with pytest.raises(ValueError, match="one or more"):
        clear_solutions(arm, 9.0, 0.0, [])
    with pytest.raises(ValueError, match="objective = 'most'"):
        clear_solutions(arm, 0.2, 0.05, [disc], "most")
    with pytest.raises(ValueError, match="target"):
        clear_solutions(arm, np.nan, 0.05, [disc])
    with pytest.raises(ValueError, match="two joints or more"):
        clear_solutions(DualTriangle(segments=1), 0.2, 0.05, [disc])
    with pytest.raises(TypeError, match="SpatialPrism: must be one of TwoX, NX, DualTriangle, PlanarFourBar"):
        clear_solutions(SpatialPrism(), 0.2, 0.05, [disc])
    assert clear_solutions(PlanarFourBar(), 99.0, 0.0, [disc]) == []
    with pytest.raises(ValueError, match="one or more"):
        clear_solutions(PlanarFourBar(), 99.0, 0.0, [])
    for given, message in (
        ({"x": np.array([0.1, 0.2])}, "single numbers, not arrays"),
        ({"x": "far"}, r"target = \('far', 0.05\): must be finite numbers"),
        ({"obstacles": [Disc((np.array([0.0, 0.1]), 0.5), 0.1)]}, "one disc, not many"),
        ({"mechanism": PlanarFourBar(), "start": (-5.0, 9.0)}, "rho1 = -5.0: must be within"),
    ):
        with pytest.raises(ValueError, match=message):
            clear_solutions(**({"mechanism": arm, "x": 0.2, "y": 0.05, "obstacles": [disc]} | given))
    with pytest.raises(TypeError, match="must be a list or tuple of Disc"):
        clear_solutions(arm, 0.2, 0.05, disc)
    batch = PlanarFourBar(PlanarFourBarDesign(10.0, np.array([100.0, 90.0])))
    with pytest.raises(ValueError, match="clear_solutions takes one design"):
        clear_solutions(batch, 0.2, 0.05, [disc])
