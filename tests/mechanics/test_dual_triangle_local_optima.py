"""Local optima of arms of any number of segments, against searches over the first angles from many starts."""

import math

import numpy as np
import pytest
from programmes import along_kinks, optima_by_programmes

from tensegrity_envs.mechanics import ZHAO2021_CAPTION, ZHAO2021_TEXT, DualTriangle, DualTriangleDesign
from tensegrity_envs.mechanics.optima.faces import choices, equal_signs, held_angles

OBJECTIVES = ("sum", "max", "squares", "margin")
UNEQUAL = DualTriangleDesign(0.05, 0.04, 0.06, 0.05, 500.0, 450.0, 0.055, 0.05)


def tapered(segments):
    """Segments that become smaller and softer towards the tip."""
    share = np.linspace(1.0, 0.7, segments)
    fields = {name: tuple((0.05 * share).tolist()) for name in ("a1", "b1", "a2", "b2", "free_length1", "free_length2")}
    return DualTriangleDesign(**fields, k1=tuple((500 * share).tolist()), k2=450.0)


def wrapped(angle):
    return (angle + math.pi) % (2 * math.pi) - math.pi


def completed(arm, first, x, y, elbow):
    """The configurations with these first angles (n - 2, k), by intersecting circles about the last pivot but one."""
    lengths = arm.link_lengths
    turn, px, py = np.zeros(first.shape[1]), np.full(first.shape[1], float(arm.base_height)), np.zeros(first.shape[1])
    for angle, length in zip(first, lengths[:-2], strict=True):
        turn = turn + angle
        px, py = px + length * np.cos(turn), py + length * np.sin(turn)
    dx, dy, (long, short) = x - px, y - py, lengths[-2:]
    rho = np.hypot(dx, dy)
    along = (rho**2 + long**2 - short**2) / (2 * rho)
    with np.errstate(invalid="ignore"):
        height = np.sqrt(long**2 - along**2)
    cx, cy = px + (dx * along + elbow * dy * height) / rho, py + (dy * along - elbow * dx * height) / rho
    second, third = np.arctan2(cy - py, cx - px), np.arctan2(y - cy, x - cx)
    return np.stack([*first, wrapped(second - turn), wrapped(third - second)])


def value_of(arm, objective, q, start):
    """What is to be small; infinite beyond the joint limits and where there is no configuration."""
    with np.errstate(invalid="ignore"):
        inside = (np.abs(q) <= float(arm.design.joint_limit) + 1e-12).all(axis=0)
    safe = np.where(inside, q, 0.0)
    if objective == "margin":
        lengths = arm.free_lengths(arm.control(tuple(safe)))
        rows = [[np.broadcast_to(e, q[0].shape) for e in row] for row in arm.stiffness_matrix(tuple(safe), lengths)]
        table = np.moveaxis(np.array(rows, float), -1, 0)
        stability = np.linalg.eigvalsh(table)[:, 0] / arm.stiffness_scale
        value = -np.minimum(stability, 2 * np.min(lengths, axis=0) / (arm.chain[0].design.b1 + arm.chain[0].design.b2))
    else:
        move = np.abs(safe - np.asarray(start)[:, None])
        value = {"sum": move.sum(0), "max": move.max(0), "squares": (move**2).sum(0)}[objective]
    return np.where(inside, value, np.inf)


def lowest(arm, objective, x, y, start, starts, rounds, rng):
    """The best value of random walks of the first angles, both elbows, whose steps shrink where they do not improve.

    Of the starts and along the walks some angles are at limits.
    """
    free, limit = arm.segments - 2, float(arm.design.joint_limit)
    first = np.clip(rng.uniform(-limit, limit, (free, starts)) * rng.choice([0.5, 1.0, 2.0], starts), -limit, limit)
    first = np.tile(first, 2)
    elbow = np.repeat([1.0, -1.0], starts)
    value = value_of(arm, objective, completed(arm, first, x, y, elbow), start)
    step = np.full(2 * starts, 0.5)
    for _ in range(rounds if free else 0):
        new = np.clip(first + step * rng.normal(size=first.shape), -limit, limit)
        tried = value_of(arm, objective, completed(arm, new, x, y, elbow), start)
        better = tried < value
        first, value = np.where(better, new, first), np.where(better, tried, value)
        step = np.clip(np.where(better, 1.5 * step, 0.9 * step), 1e-9, 0.5)
        step = np.where(np.isfinite(value), step, 0.5)
    return value.min()


def certify(arm, objectives, targets, starts, rounds, seed):
    """Compare the best local optimum with the best of a search. Returns how often the search came close to it."""
    rng, limit, close, count = np.random.default_rng(seed), float(arm.design.joint_limit), 0, 0
    for _ in range(targets):
        q = rng.uniform(-limit, limit, arm.segments) * rng.choice([0.3, 0.6, 0.95])
        x, y = (float(place) for place in arm.tip(tuple(q)))
        start = tuple(rng.uniform(-0.6, 0.6, arm.segments).tolist())
        for objective in objectives:
            sign = -1.0 if objective == "margin" else 1.0
            found = arm.local_optima(x, y, objective, start)
            assert found
            values = [sign * one.objective for one in found]
            assert values == sorted(values)
            for one in found:
                column = np.array(one.configuration)[:, None]
                assert arm.tip(one.configuration) == pytest.approx((x, y), abs=1e-12)
                assert value_of(arm, objective, column, start)[0] == pytest.approx(sign * one.objective, abs=1e-9)
            searched = lowest(arm, objective, x, y, start, starts, rounds, rng)
            assert values[0] <= searched + 1e-6, (arm.segments, objective, x, y)
            close += searched < values[0] + 0.02
            count += 1
    return close / count


@pytest.mark.parametrize(
    ("segments", "design", "targets"),
    [
        (2, UNEQUAL, 6),
        (3, ZHAO2021_TEXT, 3),
        (3, tapered(3), 3),
        (4, UNEQUAL, 3),
        (4, tapered(4), 1),
        (5, ZHAO2021_TEXT, 2),
    ],
)
def test_no_better_optimum_from_20_starts(segments, design, targets):
    arm = DualTriangle(design, segments)
    assert certify(arm, OBJECTIVES[:3], targets, 20, 200, segments) > 0.7
    certify(arm, ("margin",), 1, 20, 100, segments)


BLOCKS, IN_A_BLOCK = 5, 50


@pytest.mark.full
@pytest.mark.parametrize("block", range(BLOCKS))
@pytest.mark.parametrize("segments", [4, 5])
@pytest.mark.parametrize("objective", OBJECTIVES)
def test_no_better_optimum_from_200_starts(segments, objective, block):
    """250 targets of each number of segments; the search itself must be one that comes close to most."""
    arm, seed = DualTriangle(ZHAO2021_TEXT, segments), segments if block == 0 else 100 * segments + block
    assert certify(arm, (objective,), IN_A_BLOCK, 200, 300, seed) > 0.7


STEPS, SHORT_STEPS = (2e-3, 5e-4, 1e-4), (2e-5,)  # [rad]: some optima are shallower than a step is long


def is_best_nearby(arm, objective, q, start, rng, count=300, steps=STEPS):
    """Whether none nearby has a better value, of those that differ a little in the first angles, or stay on kinks."""
    limit, (x, y), value = float(arm.design.joint_limit), arm.tip(tuple(q)), value_of(arm, objective, q[:, None], start)
    for step in steps:
        way = step * rng.normal(size=(len(q) - 2, count)) * rng.choice([0, 1], (len(q) - 2, count))
        first = np.clip(q[:-2, None] + way, -limit, limit)
        for elbow in (1.0, -1.0):
            with np.errstate(invalid="ignore"):
                new = completed(arm, first, x, y, elbow)
            new = new[:, np.abs(new - q[:, None]).max(axis=0) < 3 * step]
            if new.shape[1] and value_of(arm, objective, new, start).min() < value[0] - 1e-8:
                return False
    beside = along_kinks(arm, objective, q, np.array(start), rng, steps)
    return not beside.shape[1] or value_of(arm, objective, beside, start).min() > value[0] - 1e-8


def compare_lists(arm, objective, targets, starts, seed):
    """All in the list are best nearby. Returns how many optima programmes find, those that the list misses, the number
    in the list, and how many of these are not best within a few of the longer steps.
    """
    rng, limit = np.random.default_rng(seed), float(arm.design.joint_limit)
    count, missed, total, shallow = 0, [], 0, 0
    for _ in range(targets):
        q = rng.uniform(-limit, limit, arm.segments) * rng.choice([0.3, 0.6, 0.95])
        x, y = (float(place) for place in arm.tip(tuple(q)))
        start = tuple(rng.uniform(-0.6, 0.6, arm.segments).tolist())
        listed = np.array([one.configuration for one in arm.local_optima(x, y, objective, start)])
        for one in listed:
            assert is_best_nearby(arm, objective, one, start, rng, steps=SHORT_STEPS), (objective, x, y, one)
            shallow += not is_best_nearby(arm, objective, one, start, rng)
        total += len(listed)
        best = value_of(arm, objective, listed[:1].T, start)[0]
        for one in optima_by_programmes(arm, objective, x, y, np.array(start), starts, rng):
            assert value_of(arm, objective, one[:, None], start)[0] > best - 1e-6, (objective, x, y)
            if is_best_nearby(arm, objective, one, start, rng, 2000):
                count += 1
                if np.abs(listed - one).max(axis=1).min() > 1e-3:
                    missed.append((objective, x, y, one))
    return count, missed, total, shallow


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_all_optima_that_programmes_find_are_in_the_list(objective):
    count, missed, _, shallow = compare_lists(DualTriangle(ZHAO2021_CAPTION, 4), objective, 3, 60, 7)
    assert count >= 3
    assert missed == []
    assert shallow == 0


@pytest.mark.full
@pytest.mark.parametrize("block", range(BLOCKS))
@pytest.mark.parametrize("segments", [4, 5])
@pytest.mark.parametrize("objective", OBJECTIVES)
def test_the_list_misses_few_of_the_optima_from_200_starts(segments, objective, block):
    arm = DualTriangle(ZHAO2021_TEXT, segments)
    count, missed, total, shallow = compare_lists(arm, objective, IN_A_BLOCK, 200, 200 * segments + block)
    print(f"{segments} segments, {objective}, block {block}: of {count} optima {len(missed)} are missed", missed)
    print(f"of {total} in the list {shallow} are shallow")
    assert len(missed) <= 0.02 * count
    assert shallow <= 0.02 * total


def test_optima_with_joints_at_their_limits_are_found():
    arm = DualTriangle(ZHAO2021_CAPTION, 4)
    found = np.array([one.configuration for one in arm.local_optima(0.3, 0.1, "squares")])
    expected = np.array([0.927295, -math.pi / 2, math.pi / 2, -0.927295])
    ((index,), limit) = np.nonzero(np.abs(found - expected).max(axis=1) < 1e-5), float(arm.design.joint_limit)
    one = arm.local_optima(0.3, 0.1, "squares")[index[0]]
    assert one.objective == pytest.approx(6.654555, abs=1e-6)
    assert one.configuration[1:3] == (-limit, limit)
    assert len(found) == 4


def test_corners_of_the_sum_are_exact():
    arm, start = DualTriangle(ZHAO2021_CAPTION, 4), (0.1, -0.2, 0.3, 0.05)
    for one in arm.local_optima(0.25, 0.12, "sum", start):
        resting = np.abs(np.subtract(one.configuration, start))
        limits = float(arm.design.joint_limit) - np.abs(one.configuration)
        assert all(move < 1e-14 or move > 1e-5 or limit == 0 for move, limit in zip(resting, limits))


def test_three_segments_have_the_optima_of_the_curve():
    """Another solver of ours, by the parametrized curve, which is certified on its own."""
    arm, rng = DualTriangle(ZHAO2021_TEXT), np.random.default_rng(5)
    for _ in range(4):
        x, y = arm.tip(tuple(rng.uniform(-0.9, 0.9, 3).tolist()))
        start = tuple(rng.uniform(-0.5, 0.5, 3).tolist())
        for objective in OBJECTIVES[:3]:
            best = arm.redundancy(x, y, start, objective)
            found = arm.local_optima(x, y, objective, start)
            assert found[0].objective == pytest.approx(best.objective, abs=1e-7)


def test_the_margin_under_a_torque_at_the_tip():
    """It is what the control law against that load gives, and no other configuration of a fine curve has more."""
    arm, load, limit = DualTriangle(ZHAO2021_TEXT), (0.3, -0.5, 0.02), float(ZHAO2021_TEXT.joint_limit)
    x, y = (float(place) for place in arm.tip((0.4, 0.3, -0.2)))
    found = arm.local_optima(x, y, "margin", load=load)

    def margin(q):
        lengths = arm.free_lengths(arm.control(q, load))
        return np.minimum(arm.stability_margin(q, lengths, load), arm.wrench_margin(q, lengths))

    for one in found:
        assert margin(one.configuration) == pytest.approx(one.objective, abs=1e-9)
    first = np.linspace(-limit, limit, 20_001)
    curve = np.hstack([completed(arm, first[None], x, y, elbow) for elbow in (1.0, -1.0)])
    curve = curve[:, np.isfinite(curve).all(axis=0) & (np.abs(curve) <= limit).all(axis=0)]
    assert margin(tuple(curve)).max() == pytest.approx(found[0].objective, abs=1e-4)
    assert margin(tuple(curve)).max() <= found[0].objective + 1e-9
    assert abs(found[0].objective - arm.local_optima(x, y, "margin", load=load[:2])[0].objective) > 1e-3


def test_two_segments_have_both_solutions():
    rng = np.random.default_rng(6)
    for k in range(20):
        arm = DualTriangle((UNEQUAL, tapered(2))[k % 2], 2)
        x, y = arm.tip(tuple(rng.uniform(-1.0, 1.0, 2).tolist()))
        expected = [s.configuration for s in arm.inverse_kinematics(x, y) if s.is_within_limits]
        found = sorted(one.configuration for one in arm.local_optima(x, y, "sum"))
        np.testing.assert_allclose(found, sorted(expected), atol=1e-9)


@pytest.mark.parametrize(("segments", "design"), [(2, UNEQUAL), (3, tapered(3)), (4, UNEQUAL), (5, UNEQUAL)])
def test_redundancy_is_the_best_optimum_and_out_of_reach_the_nearest_point(segments, design):
    arm, rng = DualTriangle(design, segments), np.random.default_rng(segments)
    limit, reach = float(arm.design.joint_limit), float(arm.reach)
    x, y = rng.uniform(0.2 * reach, reach, 5), rng.uniform(-0.6 * reach, 0.6 * reach, 5)
    start = tuple(rng.uniform(-0.5, 0.5, (segments, 5)))
    batch = arm.redundancy(x, y, start, "squares")
    many = rng.uniform(-limit, limit, (segments, 200_000))
    tips = arm.tip(tuple(many))
    for i in range(5):
        one = arm.redundancy(float(x[i]), float(y[i]), tuple(float(s[i]) for s in start), "squares")
        assert one.is_reachable == batch.is_reachable[i]
        assert one.objective == pytest.approx(batch.objective[i], abs=1e-6)
        sampled = np.hypot(tips[0] - x[i], tips[1] - y[i]).min()
        if one.is_reachable:
            found = arm.local_optima(float(x[i]), float(y[i]), "squares", tuple(float(s[i]) for s in start))
            assert found[0].objective == pytest.approx(one.objective, abs=1e-6)
            assert one.distance == 0
        else:
            assert 0 < one.distance <= sampled + 1e-9
            assert arm.tip(one.configuration) == pytest.approx(one.nearest, abs=1e-9)
            assert max(map(abs, one.configuration)) <= limit


def test_redundancy_tells_whether_its_configuration_can_be_held():
    """The torque of the control law's free lengths vanishes; they are not negative, and the energy has a minimum."""
    arm, held = DualTriangle(ZHAO2021_TEXT), []
    start = np.random.default_rng(8).uniform(-1.0, 1.0, (3, 20)) * float(arm.design.joint_limit)
    x, y = arm.tip(tuple(start))
    batch = arm.redundancy(x, y, tuple(start), "sum")
    for i in range(20):
        one = arm.redundancy(float(x[i]), float(y[i]), tuple(start[:, i].tolist()), "sum")
        lengths = arm.free_lengths(arm.control(one.configuration))
        table = np.array(arm.stiffness_matrix(one.configuration, lengths))
        assert np.abs(arm.energy_gradient(one.configuration, lengths)).max() < 1e-9
        expected = bool(np.linalg.eigvalsh(table)[0] > 0 and min(lengths) >= 0)
        assert one.is_stable_wrench_feasible is expected
        assert batch.is_stable_wrench_feasible[i] == expected
        assert (one.stability_margin, one.wrench_margin) == pytest.approx(
            (batch.stability_margin[i], batch.wrench_margin[i]), abs=1e-12
        )
        held.append(expected)
    assert len(set(held)) == 2
    assert math.isfinite(DualTriangle(segments=4).redundancy(9.0, 0.0, (0.0,) * 4).wrench_margin)


def test_calls_that_make_no_sense():
    with pytest.raises(ValueError, match="two segments or more"):
        DualTriangle(segments=1).local_optima(0.1, 0.0)
    with pytest.raises(ValueError, match="two segments or more"):
        DualTriangle(segments=1).redundancy(0.1, 0.0, (0.0,))
    with pytest.raises(ValueError, match="objective = 'most'"):
        DualTriangle(segments=4).redundancy(0.2, 0.0, (0.0,) * 4, "most")
    with pytest.raises(ValueError, match="positive and finite"):
        DualTriangle(segments=4).redundancy(0.2, 0.0, (0.0,) * 4, joint_limit=math.inf)
    for segments in (3, 4):
        with pytest.raises(ValueError, match="arrays of one axis"):
            DualTriangle(segments=segments).redundancy(np.full((2, 2), 0.1), 0.1, (0.0,) * segments)
    assert DualTriangle(segments=4).local_optima(9.0, 0.0) == []


def test_of_many_segments_corners_are_drawn_instead_of_listed():
    """Of twelve joints at two limits or at rest there are 59,049 choices for each of 66 pairs."""
    values = held_angles("sum", np.full(12, 0.1), 1.5)
    assert values[0] == (-1.5, 1.5, 0.1)
    drawn = choices(values, 15)
    assert drawn.shape == (12, 15)
    assert np.isin(drawn, values[0]).all()
    assert sorted(map(tuple, choices([(1.0, 2.0), (3.0,)], 15).T.tolist())) == [(1.0, 3.0), (2.0, 3.0)]
    assert equal_signs(30, 3).shape == (30, 33)
