"""Equilibria of the 2-X: all of them against multistart searches on the nodes' energy, paths against tiny steps."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from mechanism_cases import node_energy
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, least_squares
from two_x_reference import creep

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.mechanics import MURALIDHARAN2022, TwoX
from tensegrity_envs.mechanics.equilibrium import continuation, find_all, solve_symmetric

NO_LOAD = (0.0, 0.0)


def with_payload(payload):
    return TwoX(replace(MURALIDHARAN2022, payload=payload))


def node_gradient(m, q, tensions, load=NO_LOAD, step=2e-3):
    """Gradient of the energy of nodes and members by central differences of sixth order."""
    weights = np.array([-1, 9, -45, 0, 45, -9, 1]) / (60 * step)
    line = np.arange(-3, 4) * step
    first = node_energy(m, (q[0] + line, q[1] + 0 * line), tensions, load)
    second = node_energy(m, (q[0] + 0 * line, q[1] + line), tensions, load)
    return np.array([weights @ first, weights @ second])


TENSION_SETS = [
    (0.0, (5.0, 5.0, 5.0, 5.0), NO_LOAD),
    (0.0, (60.0, 20.0, 15.0, 40.0), NO_LOAD),
    (0.0, (155.0, 5.0, 20.0, 155.0), NO_LOAD),
    (0.2, (5.0, 5.0, 5.0, 5.0), NO_LOAD),
    (0.2, (20.0, 22.0, 10.0, 10.0), NO_LOAD),
    (0.5, (155.0, 155.0, 155.0, 155.0), NO_LOAD),
    (0.4, (90.0, 100.0, 70.0, 60.0), (2.0, 1.0)),
    (0.1, (30.0, 10.0, 80.0, 90.0), (-1.0, -3.0)),
]


@pytest.mark.parametrize(("payload", "tensions", "load"), TENSION_SETS)
def test_all_equilibria_by_multistart(payload, tensions, load):
    """What a multistart finds is listed, what is listed is an equilibrium, and its stability is that of the energy."""
    m = with_payload(payload)
    listed = m.equilibria(tensions, load)
    points = np.array([e.configuration for e in listed]).reshape(-1, 2)
    assert sorted(map(tuple, points)) == list(map(tuple, points))
    starts = np.linspace(-2.7, 2.7, 4)
    for start in np.stack(np.meshgrid(starts, starts), axis=-1).reshape(-1, 2):
        search = least_squares(
            lambda q: node_gradient(m, q, tensions, load),
            start,
            bounds=(-3.14, 3.14),
            xtol=1e-13,
            ftol=1e-13,
            gtol=1e-13,
            max_nfev=30,
        )
        if np.linalg.norm(search.fun) < 1e-8 and abs(search.x).max() < 3.135:
            assert abs(points - search.x).max(axis=1).min() < 1e-5, search.x
    rng = np.random.default_rng(0)
    for equilibrium in listed:
        q = np.array(equilibrium.configuration)
        assert abs(q).max() < math.pi
        assert equilibrium.residual < 1e-9
        if abs(q).max() < 3.0:
            assert np.linalg.norm(node_gradient(m, q, tensions, load)) < 1e-8
        around = q[:, None] + 1e-3 * rng.normal(size=(2, 200))
        rise = node_energy(m, tuple(around), tensions, load) - node_energy(m, tuple(q), tensions, load)
        assert equilibrium.is_stable == bool((rise > 0).all())
        assert equilibrium.reason.startswith("stable" if equilibrium.is_stable else "unstable")


def test_equilibria_do_not_depend_on_the_first_cells():
    rng = np.random.default_rng(1)
    for trial in range(18):
        m = with_payload(float(rng.choice([0.0, 0.2, 0.5])))
        tensions = tuple(rng.uniform(5, 155, 4)) if trial % 3 else tuple(np.repeat(rng.uniform(5, 155, 2), 2))
        limit = (math.pi, 2.6, 2 * math.pi)[trial % 3]
        box = (-limit, -limit), (limit, limit)
        coarse, fine = (find_all(partial(m.statics, tensions=tensions), *box, cells=cells) for cells in (48, 110))
        assert len(coarse) == len(fine)
        for one, other in zip(coarse, fine, strict=True):
            assert one.configuration == pytest.approx(other.configuration, abs=1e-8)


def test_without_gravity_there_is_one_equilibrium_at_most_and_it_is_stable():
    """Springs and cables alone make a strictly convex energy in sin(alpha/2)."""
    m = TwoX(replace(MURALIDHARAN2022, gravity=0.0))
    rng = np.random.default_rng(2)
    for _ in range(30):
        found = m.equilibria(tuple(rng.uniform(0, 155, 4)))
        assert len(found) <= 1
        assert all(e.is_stable for e in found)


def test_upright_loses_its_stability_in_a_pitchfork():
    """Below the critical payload one stable state, above it two mirror images beside the unstable upright."""
    for force, critical in ((5.0, 0.11651302350885884), (155.0, 0.46506810691873246)):
        tensions = (force,) * 4

        def smallest(payload, tensions=tensions):
            return float(np.linalg.eigvalsh(np.array(with_payload(payload).stiffness_matrix((0.0, 0.0), tensions)))[0])

        assert brentq(smallest, 0.0, 0.6, xtol=1e-14) == pytest.approx(critical, abs=1e-12)
        below = [e for e in with_payload(critical - 0.004).equilibria(tensions) if e.is_stable]
        above = [e for e in with_payload(critical + 0.004).equilibria(tensions) if e.is_stable]
        assert [e.configuration for e in below] == [pytest.approx((0.0, 0.0), abs=1e-9)]
        assert len(above) == 2
        assert above[0].configuration == pytest.approx([-angle for angle in above[1].configuration], abs=1e-8)


# ---------------------------------------------------------------------------------------------------- continuation


def tension_changes(count, seed):
    """Stable states with payloads of 0 to 0.5 kg, some bistable, some critical; changes of up to 15 N per cable."""
    rng = np.random.default_rng(seed)
    groups = (
        (0.0, 5, 155),
        (0.1, 5, 60),
        (0.2, 5, 40),
        (0.3, 5, 155),
        (0.5, 80, 155),
        (0.12, 5, 10),
        (0.466, 140, 155),
    )
    states, tensions, payloads = [], [], []
    while len(states) < count:
        payload, low, high = groups[len(states) % len(groups)]
        f = rng.uniform(low, high, 4)
        if rng.random() < 0.2:
            f[1], f[3] = f[0] + 1e-3, f[2]  # nearly symmetric
        stable = [e for e in with_payload(payload).equilibria(tuple(f)) if e.is_stable]
        stable = [e for e in stable if max(map(abs, e.configuration)) < 2.6]
        if stable:
            states.append(stable[rng.integers(len(stable))].configuration)
            tensions.append(f)
            payloads.append(payload)
    old = np.array(tensions).T
    new = np.clip(old + rng.uniform(-15, 15, old.shape), 5, 155)
    return np.array(states).T, old, new, np.array(payloads)


def along(design, q, old, new):
    """Where the arm comes to when its tensions change from `old` to `new`, in u = sin(alpha/2), and the fraction."""
    m = TwoX(design)

    def path(u, t):
        return m.sine_statics(u, tuple(o + t * (n - o) for o, n in zip(old, new, strict=True)))

    u, fraction = continuation(path, m.to_sines(q))
    return m.from_sines(u), fraction


def test_following_never_jumps():
    """The same end point as a continuation in tiny steps, or stability lost in both, at the same tensions.

    Left out of the comparison of the two verdicts (but never of the end points): paths on which the reference meets a
    smallest eigenvalue below 2e-3 N m/rad (typical are 0.1 to 3) and gets through; there `continuation` may report a
    loss. So are paths that end beyond 2.7 rad: the environments stop at 2.6, and u = sin(alpha/2) at pi.
    """
    q, old, new, payloads = tension_changes(175, seed=3)
    m = TwoX(replace(MURALIDHARAN2022, payload=payloads))
    expected, covered, lowest = creep(m, q, old, new)
    end, fraction = evaluate(along, m.design, tuple(q), tuple(old), tuple(new))
    found = np.array(end)
    both = (fraction == 1) & (covered == 1)
    lost = covered < 1
    assert abs(found - expected).max(axis=0)[both].max() < 1e-8
    assert (fraction[lost] < 1).all()
    clear = (lowest > 2e-3) & (abs(expected).max(axis=0) < 2.7)
    assert (fraction[clear & ~lost] == 1).all()
    # The cases are hard enough to mean something, and few are left out.
    assert both.sum() > 100
    assert lost.sum() > 10
    assert (lost | clear).mean() > 0.97
    # Where stability ended: the same fraction of the path, and there a stable equilibrium
    ended = lost & (abs(expected).max(axis=0) < 2.7)
    assert abs(fraction - covered)[ended].max() < 2e-3
    tensions = tuple(old + fraction * (new - old))
    gradient, ((h11, h12), (_, h22)) = m.statics(tuple(found), tensions)
    assert np.hypot(*gradient).max() < 1e-7
    assert ((h11 > 0) & (h11 * h22 > h12 * h12))[ended | both].all()


def test_following_one_is_following_it_in_a_batch():
    q, old, new, payloads = tension_changes(42, seed=4)
    design = replace(MURALIDHARAN2022, payload=payloads)
    end, fraction = evaluate(along, design, tuple(q), tuple(old), tuple(new))
    for i in range(42):
        rows = (tuple(map(float, values[:, i])) for values in (q, old, new))
        single, covered = evaluate(along, replace(design, payload=float(payloads[i])), *rows)
        assert all(type(value) is float for value in (*single, covered))
        assert covered == fraction[i]
        assert single == tuple(qi[i] for qi in end)


@pytest.mark.parametrize(
    ("old", "new", "side"),
    [
        ((6.46428212, 6.46428212, 5.23156233, 5.23156233), (9.76672875, 10.6219935, 7.79033936, 5.0), -1),
        ((6.52742996, 6.52742996, 5.63253828, 5.63253828), (5.0, 19.48072694, 18.46402515, 5.0), 1),
    ],
)
def test_a_path_across_a_fold_to_a_convex_energy_is_reported_as_a_loss(old, new, side):
    """The end's energy has one minimum, to which Newton's method converges at once; yet the branch ended on the way."""
    m = with_payload(0.12)
    start = next(e.configuration for e in m.equilibria(old) if e.is_stable and side * e.configuration[0] > 0)
    assert [e.is_stable for e in m.equilibria(new)].count(True) == 1
    _, fraction = evaluate(along, m.design, start, old, new)
    single = TwoX(replace(MURALIDHARAN2022, payload=np.array([0.12])))
    _, covered, _ = creep(single, np.array([start]).T, np.array([old]).T, np.array([new]).T)
    assert covered[0] < 0.1
    assert fraction == pytest.approx(covered[0], abs=2e-3)


# --------------------------------------------------------------------------------------------------------- settling


@pytest.mark.parametrize("payload", [0.0, 0.3])
def test_settling_ends_where_the_energy_leads(payload):
    """Random starts and tensions: a stable equilibrium below the start, or the energy leads out of the joint limits."""
    m = with_payload(payload)
    rng = np.random.default_rng(5)
    tensions, starts = rng.uniform(5, 155, (4, 20)), rng.uniform(-2.6, 2.6, (2, 20))
    batch = m.equilibrium(tuple(tensions), tuple(starts))
    for i in range(20):
        f, start = tuple(map(float, tensions[:, i])), tuple(map(float, starts[:, i]))
        single = m.equilibrium(f, start)
        assert single.is_stable == batch.is_stable[i]
        assert single.reason == batch.reason[i]
        assert single.configuration == pytest.approx([c[i] for c in batch.configuration], abs=1e-7)
        stable = [e.configuration for e in m.equilibria(f) if e.is_stable]
        if single.is_stable:
            assert single.residual < 1e-9
            assert min(math.dist(single.configuration, other) for other in stable) < 1e-7
            assert m.potential_energy(single.configuration, f) <= m.potential_energy(start, f)
            assert single.reason.startswith("stable")
        else:
            assert "joint limits" in single.reason
            flow = solve_ivp(
                lambda _, q, f=f: -np.array(m.energy_gradient(tuple(q), f)), (0, 60), start, method="LSODA", rtol=1e-6
            )
            assert not stable or abs(flow.y).max() > math.pi


def test_settling_by_continuation_is_the_end_of_the_path_in_tiny_steps():
    """The reason says "followed" exactly where a path of small steps stays stable, and then both end at one place."""
    m = with_payload(0.2)
    rng = np.random.default_rng(6)
    tensions, starts = rng.uniform(40, 155, (4, 40)), rng.uniform(-1.2, 1.2, (2, 40))
    result = m.equilibrium(tuple(tensions), tuple(starts))
    followed = np.array([reason.startswith("stable; followed") for reason in result.reason])
    assert followed.sum() > 10
    assert (~followed).sum() > 3
    q, held = starts.copy(), np.array(m.energy_gradient(tuple(starts), tuple(tensions)))
    kept = np.ones(40, bool)
    for remaining in np.linspace(1, 0, 2001)[1:]:
        for _ in range(3):
            (g1, g2), ((h11, h12), (_, h22)) = m.statics(tuple(q), tuple(tensions))
            force = np.stack([g1, g2]) - remaining * held
            determinant = h11 * h22 - h12 * h12
            kept &= (h11 > 0) & (determinant > 0)
            step = np.stack([h22 * force[0] - h12 * force[1], h11 * force[1] - h12 * force[0]])
            q = np.where(kept, q - step / np.where(kept, determinant, 1.0), q)
    np.testing.assert_array_equal(kept, followed)
    assert abs(np.array(result.configuration) - q)[:, kept].max() < 1e-7


def test_settling_shares_floats_in_a_batch():
    m = TwoX()
    batch = m.equilibrium((np.array([20.0, 30.0, 40.0]), 20.0, 20.0, 20.0), (0.0, 0.1))
    for i, force in enumerate((20.0, 30.0, 40.0)):
        single = m.equilibrium((force, 20.0, 20.0, 20.0), (0.0, 0.1))
        assert single.configuration == pytest.approx([c[i] for c in batch.configuration], abs=1e-9)
    payloads = TwoX(replace(MURALIDHARAN2022, payload=np.array([0.0, 0.2, 0.4])))
    batch = payloads.equilibrium((30.0, 25.0, 20.0, 28.0), (0.1, 0.0))
    for i, payload in enumerate((0.0, 0.2, 0.4)):
        single = with_payload(payload).equilibrium((30.0, 25.0, 20.0, 28.0), (0.1, 0.0))
        assert (single.is_stable, single.reason) == (batch.is_stable[i], batch.reason[i])
        assert single.configuration == pytest.approx([c[i] for c in batch.configuration], abs=1e-7)


def test_settling_in_an_unstable_equilibrium_says_so():
    m = with_payload(0.2)
    result = m.equilibrium((5.0,) * 4, (0.0, 0.0))
    assert result.configuration == (0.0, 0.0)
    assert not result.is_stable
    assert "unstable" in result.reason
    beside = m.equilibrium((5.0,) * 4, (1e-3, 0.0))
    assert beside.is_stable
    assert "lost its stability" in beside.reason
    assert beside.configuration == pytest.approx((1.715117, 0.614882), abs=1e-5)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_settling_from_what_is_not_a_number(bad):
    m = TwoX()
    with pytest.raises(ValueError, match="tensions"):
        m.equilibrium((20.0, bad, 20.0, 20.0), (0.0, 0.0))
    with pytest.raises(ValueError, match="start"):
        m.equilibrium((20.0,) * 4, (0.0, bad))
    with pytest.raises(ValueError, match="load"):
        m.equilibrium((20.0,) * 4, (0.0, 0.0), (bad, 0.0))
    with pytest.raises(ValueError, match="must be 4"):
        m.equilibrium((20.0,) * 3, (0.0, 0.0))
    with pytest.raises(ValueError, match="must be 2"):
        m.equilibrium((20.0,) * 4, (0.0,))
    with pytest.raises(ValueError, match="tensions"):
        m.equilibria((20.0, 20.0, 20.0, bad))


def test_solving_symmetric_systems():
    """L D L^T in any dimension: solution, smallest pivot, determinant."""
    rng = np.random.default_rng(7)
    for n in (1, 2, 3, 5):
        for _ in range(20):
            factor = rng.normal(size=(n, n))
            matrix, right = factor @ factor.T + 0.1 * np.eye(n), rng.normal(size=n)
            rows = tuple(tuple(float(v) for v in row) for row in matrix)
            x, pivot, determinant = solve_symmetric(rows, tuple(map(float, right)))
            np.testing.assert_allclose(x, np.linalg.solve(matrix, right), rtol=1e-8)
            assert pivot > 0
            assert determinant == pytest.approx(np.linalg.det(matrix), rel=1e-9)
            shifted = matrix - 1.5 * np.linalg.eigvalsh(matrix)[0] * np.eye(n)
            rows = tuple(tuple(float(v) for v in row) for row in shifted)
            assert solve_symmetric(rows, tuple(map(float, right)))[1] <= 0
