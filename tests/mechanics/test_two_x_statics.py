"""Statics of the 2-X: stiffest tensions against search, batches of designs, accuracy next to the flat poses."""

import math
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from mechanism_cases import TWO_X_MECHANISMS, node_energy, random_two_x_design
from scipy.optimize import linprog

from tensegrity_envs.mechanics import MURALIDHARAN2022, TwoX
from tensegrity_envs.mechanics.design import take

DESIGNS = [
    MURALIDHARAN2022,
    replace(MURALIDHARAN2022, payload=0.3),
    replace(MURALIDHARAN2022, a=0.0, max_tension=60.0),
    replace(MURALIDHARAN2022, k1=0.0, k2=0.0),
    *(replace(random_two_x_design(seed), joint_limit=3.0) for seed in range(4)),
]
every_design = pytest.mark.parametrize("design", DESIGNS, ids=range(len(DESIGNS)))


def energy_parts(m, q, load):
    """Gradient and Hessian of the node energy without cables, and those of each cable's length, by differences."""

    def derivatives(function):
        step = 1e-2
        offsets = np.arange(-3, 4) * step
        first = np.array([-1, 9, -45, 0, 45, -9, 1]) / (60 * step)
        second = np.array([2, -27, 270, -490, 270, -27, 2]) / (180 * step**2)
        d1, d2 = np.meshgrid(offsets, offsets, indexing="ij")
        values = np.asarray(function((q[0] + d1, q[1] + d2)))
        mixed = first @ values @ first
        gradient = np.array([first @ values[:, 3], first @ values[3]])
        return gradient, np.array([[second @ values[:, 3], mixed], [mixed, second @ values[3]]])

    passive = derivatives(lambda p: node_energy(m, p, (0.0,) * 4, load))
    cables = []
    for i in range(4):
        unit = tuple(float(i == j) for j in range(4))
        pulled = derivatives(lambda p, unit=unit: node_energy(m, p, unit, load) - node_energy(m, p, (0.0,) * 4, load))
        cables.append(pulled)
    return passive, cables


@every_design
def test_no_feasible_tensions_that_hold_a_configuration_are_stiffer(design):
    """The feasible tensions are the equilibrium line of each joint clipped to the box; both lines are sampled whole.

    Gradient and Hessian come from the nodes by differences, so that nothing of the closed form is repeated; whether
    there are feasible tensions at all is asked of a linear programme.
    """
    m = TwoX(design)
    rng = np.random.default_rng(11)
    low, high = design.min_tension, design.max_tension
    feasible_seen = 0
    for trial in range(40):
        q = tuple(float(angle) for angle in rng.uniform(-2.9, 2.9, 2) * rng.choice([0.1, 0.4, 1.0]))
        load = (0.0, 0.0) if trial % 2 else tuple(rng.normal(0.0, 2.0, 2))
        (force, stiffness), cables = energy_parts(m, q, load)
        pull = np.stack([gradient for gradient, _ in cables], axis=1)
        scale = abs(force).max() + high * abs(pull).max()
        tensions = np.array(m.stiffest_tensions(q, load))
        assert abs(force + pull @ tensions).max() < 1e-9 * scale * max(1.0, abs(tensions).max() / high)
        assert max(tensions[:2]) == pytest.approx(high, rel=1e-12)
        assert max(tensions[2:]) == pytest.approx(high, rel=1e-12)

        wrench = m.wrench_margin(q, load=load)
        assert wrench == pytest.approx((tensions.min() - low) / high, abs=1e-9)
        programme = linprog(np.zeros(4), A_eq=pull / scale, b_eq=-force / scale, bounds=[(low, high)] * 4)
        if abs(wrench) > 1e-6:
            assert (programme.status == 0) == (wrench > 0)
        if wrench <= 1e-6:
            assert not m.is_stable_wrench_feasible(q, load) or wrench > 0
            continue
        feasible_seen += 1
        lines = []
        for joint in (0, 1):  # f_left from clipping to the box, f_right from equilibrium
            left, right = pull[joint, 2 * joint], pull[joint, 2 * joint + 1]
            ends = [low, high, *((-force[joint] - right * f) / left for f in (low, high))]
            inside = [f for f in ends if low - 1e-6 <= f <= high + 1e-6]
            inside = [f for f in inside if low - 1e-6 <= (-force[joint] - left * f) / right <= high + 1e-6]
            f_left = np.linspace(min(inside), max(inside), 40)
            lines.append(np.stack([f_left, (-force[joint] - left * f_left) / right]))
        first, second = np.meshgrid(np.arange(40), np.arange(40), indexing="ij")
        candidates = np.concatenate([lines[0][:, first.ravel()], lines[1][:, second.ravel()]])
        matrices = stiffness + np.einsum("in,ijk->njk", candidates, np.stack([h for _, h in cables]))
        best = np.linalg.eigvalsh(matrices)[:, 0].max()
        stiffest = m.stability_margin(q, load=load) * m.stiffness_scale
        assert stiffest == pytest.approx(best, abs=1e-6 * scale)
        assert m.is_stable_wrench_feasible(q, load) == (best > 0)
    assert feasible_seen > 6


@every_design
def test_margins_of_given_tensions(design):
    m = TwoX(design)
    rng = np.random.default_rng(12)
    low, high = design.min_tension, design.max_tension
    for _ in range(50):
        q = tuple(rng.uniform(-2.9, 2.9, 2))
        tensions = rng.uniform(low - 0.1 * high, 1.1 * high, 4)
        slack = m.wrench_margin(q, tuple(tensions)) * high
        assert (slack >= 0) == bool(np.all((tensions >= low) & (tensions <= high)))
        assert slack == pytest.approx(
            min(abs(tensions - low).min(), abs(high - tensions).min()) if slack >= 0 else slack
        )
        smallest = np.linalg.eigvalsh(np.array(m.stiffness_matrix(q, tuple(tensions))))[0]
        assert m.stability_margin(q, tuple(tensions)) * m.stiffness_scale == pytest.approx(smallest, abs=1e-12 * high)


def test_stiffness_scale_is_that_of_the_springs_or_of_the_cables_alone():
    assert TwoX().stiffness_scale == pytest.approx(600 * 0.05**2)
    assert TwoX(replace(MURALIDHARAN2022, k1=0.0)).stiffness_scale == pytest.approx(155 * 0.05)
    batch = TwoX(replace(MURALIDHARAN2022, k1=np.array([0.0, 600.0])))
    np.testing.assert_allclose(batch.stiffness_scale, [155 * 0.05, 600 * 0.05**2])
    assert np.isfinite(batch.stability_margin((0.3, 0.2))).all()


def test_limits_of_the_joints_belong_to_the_feasible_set():
    m = TwoX(replace(MURALIDHARAN2022, joint_limit=1.0))
    assert m.is_stable_wrench_feasible((1.0, -1.0))
    assert not m.is_stable_wrench_feasible((1.0 + 1e-9, 0.0))
    assert m.stability_margin((1.1, 0.0)) > 0


# ------------------------------------------------------------------------------------------------ batches of designs


BATCHED = ("b", "l", "a", "k1", "k2", "min_tension", "max_tension", "payload", "bar_density", "bar_radius", "gravity")


def test_a_batch_of_designs_gives_what_each_design_gives():
    """Every field an array, then the payload alone; configurations as arrays and as floats; energy from the nodes."""
    designs = [replace(random_two_x_design(seed), joint_limit=math.pi) for seed in range(8)]
    arrays = {field: np.array([getattr(design, field) for design in designs]) for field in BATCHED}
    everything = replace(designs[0], **arrays)
    payloads = replace(designs[0], payload=arrays["payload"])
    rng = np.random.default_rng(13)
    q, tensions = rng.uniform(-2.5, 2.5, (2, 8)), rng.uniform(0, 100, (4, 8))
    load = (1.0, -2.0)
    for batch in (everything, payloads):
        m = TwoX(batch)
        for same_q in (False, True):
            p = (0.4, -1.1) if same_q else tuple(q)
            energy = m.potential_energy(p, tuple(tensions), load)
            np.testing.assert_allclose(energy, node_energy(m, p, tuple(tensions), load), rtol=1e-12)
            gradient, hessian = m.statics(p, tuple(tensions), load)
            posture = m.posture(p, load)
            tip, determinant = m.tip(p), m.jacobian_determinant(p)
            for i in range(8):
                one = TwoX(take(batch, i))
                assert not isinstance(one.design.payload, np.ndarray)
                at, f = ((0.4, -1.1) if same_q else tuple(q[:, i])), tuple(tensions[:, i])

                def check(array, number, i=i):
                    value = array[i] if isinstance(array, np.ndarray) else array
                    np.testing.assert_allclose(value, number, rtol=1e-11, atol=1e-12)

                check(energy, one.potential_energy(at, f, load))
                (g1, g2), ((h11, h12), (_, h22)) = one.statics(at, f, load)
                check(gradient[0], g1)
                check(gradient[1], g2)
                for array, number in ((hessian[0][0], h11), (hessian[0][1], h12), (hessian[1][1], h22)):
                    check(array, number)
                single = one.posture(at, load)
                for array, number in zip((*posture[0], *posture[1:]), (*single[0], *single[1:]), strict=True):
                    check(array, number)
                check(determinant, one.jacobian_determinant(at))
                for array, number in zip(tip, one.tip(at), strict=True):
                    check(array, number)


def test_taking_designs_from_a_batch():
    m = TwoX(replace(MURALIDHARAN2022, payload=np.array([0.0, 0.1, 0.2, 0.3])))
    np.testing.assert_array_equal(m.take(np.array([3, 1, 1])).design.payload, [0.3, 0.1, 0.1])
    assert m.take(slice(1, 3)).stability_margin((0.1, 0.1)).shape == (2,)
    single = TwoX()
    assert single.take(np.array([0, 0])) is single


# ------------------------------------------------------------------------------------ the coordinates of continuation


@pytest.mark.parametrize("case", TWO_X_MECHANISMS[:5])
def test_statics_in_sines_by_the_chain_rule(case):
    """u = sin(alpha/2): gradient and Hessian against differences of the energy as a function of u."""
    m = case.mechanism
    rng = np.random.default_rng(14)
    u = rng.uniform(-0.9, 0.9, (2, 30))
    tensions = tuple(rng.uniform(0, 100, (4, 30)))
    load = (3.0, -1.0)
    np.testing.assert_allclose(m.to_sines(m.from_sines(tuple(u))), u, rtol=0, atol=1e-15)

    def energy(point):
        return node_energy(m, tuple(2 * np.arcsin(ui) for ui in point), tensions, load)

    step = 1e-3
    gradient, hessian = (np.array(part) for part in m.sine_statics(tuple(u), tensions, load))
    for i in range(2):
        shift = np.zeros((2, 1))
        shift[i] = step
        difference = (8 * (energy(u + shift) - energy(u - shift)) - energy(u + 2 * shift) + energy(u - 2 * shift)) / (
            12 * step
        )
        np.testing.assert_allclose(gradient[i], difference, rtol=1e-6, atol=1e-6 * abs(gradient).max())
        ahead, behind = (np.array(m.sine_statics(tuple(u + s * shift), tensions, load)[0]) for s in (1, -1))
        np.testing.assert_allclose(hessian[i], (ahead - behind) / (2 * step), rtol=1e-3, atol=1e-4 * abs(hessian).max())


# ------------------------------------------------------------------------------------------ next to the flat poses


class Exact:
    """The statics of one design at 50 digits, from nodes: numbers at the given double, exactly."""

    def __init__(self, design):
        self.design = design

    def nodes(self, alpha1, alpha2):
        d = self.design
        b, l, a = (mpmath.mpf(v) for v in (d.b, d.l, d.a))
        x, y, turn = mpmath.mpf(0), mpmath.mpf(0), mpmath.mpf(0)
        nodes = {}
        for i, alpha in ((1, alpha1), (2, alpha2)):
            # A, B on the base bar; C from the direction phi of bar A-C at which the top bar has turned by alpha
            def turned(phi, b=b, l=l, alpha=alpha):
                return mpmath.atan2(b - l * mpmath.cos(phi), l * mpmath.sin(phi)) - alpha / 2

            r = mpmath.sqrt(l**2 - b**2 * mpmath.cos(alpha / 2) ** 2)
            phi = mpmath.findroot(turned, alpha / 2 + mpmath.atan2(r, b * mpmath.cos(alpha / 2)))
            unit = mpmath.expj(turn)
            base = mpmath.mpc(x, y)
            left, right = base - unit * b / 2, base + unit * b / 2
            c = left + unit * l * mpmath.expj(phi)
            dd = c - unit * b * mpmath.expj(alpha)
            nodes |= {f"A{i}": left, f"B{i}": right, f"C{i}": c, f"D{i}": dd}
            turn = turn + alpha
            end = (c + dd) / 2 + a * mpmath.mpc(0, 1) * mpmath.expj(turn)
            x, y = end.real, end.imag
        nodes["P"] = mpmath.mpc(x, y)
        return nodes

    def energy(self, m, alpha1, alpha2, tensions):
        nodes = self.nodes(alpha1, alpha2)
        g = mpmath.mpf(self.design.gravity)
        total = mpmath.mpf(self.design.payload) * g * nodes["P"].imag
        forces = iter(tensions)
        for member in m.members:
            p, q = (nodes[name] for name in member.nodes)
            if member.kind == "bar":
                total += mpmath.mpf(member.mass) * g * (p.imag + q.imag) / 2
            elif member.kind == "spring":
                total += mpmath.mpf(member.stiffness) * abs(q - p) ** 2 / 2
            else:
                total += next(forces) * abs(q - p)
        return total

    def gradient(self, m, q, tensions):
        return [mpmath.diff(lambda *p: self.energy(m, *p, tensions), q, n) for n in ((1, 0), (0, 1))]


@pytest.mark.parametrize("payload", [0.0, 0.4])
@pytest.mark.parametrize("k", range(2, 9))
def test_accuracy_next_to_the_flat_poses(payload, k):
    """alpha = pi - 10^-k, as the double it is: the cables' moment arms fall to 10^-k, and their forces rise as 10^k."""
    m = TwoX(replace(MURALIDHARAN2022, payload=payload))
    exact = Exact(m.design)
    with mpmath.workdps(50):
        for q in ((math.pi - 10.0**-k, 0.7), (-0.4, 10.0**-k - math.pi), (10.0**-k - math.pi, math.pi - 10.0**-k)):
            point = tuple(mpmath.mpf(angle) for angle in q)
            nodes = exact.nodes(*point)
            sides = [abs(nodes[s] - nodes[e]) for s, e in (("A1", "D1"), ("B1", "C1"), ("A2", "D2"), ("B2", "C2"))]
            for length, side in zip(m.cable_lengths(q), sides, strict=True):
                assert abs(length / side - 1) < 1e-15 * 4
            tensions = (20.0, 140.0, 90.0, 35.0)
            gradient = exact.gradient(m, point, [mpmath.mpf(f) for f in tensions])
            size = max(abs(g) for g in gradient)
            for value, expected in zip(m.energy_gradient(q, tensions), gradient, strict=True):
                assert abs(value - expected) < 1e-13 * size
            # Equilibrium of each joint: F_left dl_left + F_right dl_right = -passive gradient, the larger force 155 N
            passive = exact.gradient(m, point, [mpmath.mpf(0)] * 4)
            stiffest = m.stiffest_tensions(q)
            for joint in (0, 1):
                unit = [[mpmath.mpf(float(i == 2 * joint + side)) for i in range(4)] for side in (0, 1)]
                arms = [exact.gradient(m, point, u)[joint] - passive[joint] for u in unit]
                top = mpmath.mpf(155)
                pairs = (
                    (top, (-passive[joint] - arms[0] * top) / arms[1]),
                    ((-passive[joint] - arms[1] * top) / arms[0], top),
                )
                left, right = next(pair for pair in pairs if max(pair) <= top * (1 + mpmath.mpf(10) ** -30))
                for value, expected in zip(stiffest[2 * joint : 2 * joint + 2], (left, right), strict=True):
                    assert abs(value - expected) < 1e-11 * max(abs(expected), 1)


def test_the_approach_to_a_flat_pose_is_smooth():
    """Forces times moment arm tend to the moment that they must balance, without jumps or noise, to 10^-9 rad."""
    m = TwoX()
    distance = 10.0 ** -np.linspace(1.0, 9.0, 400)
    for sign in (1, -1):
        alpha = sign * (math.pi - distance)
        tensions = np.array(m.stiffest_tensions((alpha, np.full(400, 0.3))))
        arm = np.cos(alpha / 2)
        other = tensions[0] if abs(tensions[0, -1]) > abs(tensions[1, -1]) else tensions[1]
        moment = other * arm
        assert np.isfinite(tensions).all()
        near = distance < 1e-3
        fit = np.polynomial.Polynomial.fit(distance[near], moment[near], 3)
        assert abs(fit(distance[near]) - moment[near]).max() < 1e-11 * abs(moment[-1])
        assert abs(moment[-1] - moment[-40]) < 1e-6 * abs(moment[-1])
        lengths = np.array(m.cable_lengths((alpha, alpha)))
        assert (np.diff(lengths, axis=1) * np.diff(lengths, axis=1)[:, :1] >= 0).all()
        margins = m.wrench_margin((alpha, np.full(400, 0.3)))
        assert np.isfinite(margins).all()
