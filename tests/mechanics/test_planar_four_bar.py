"""The planar 4-bar mechanism by other routes: energy of nodes and members, minimizers, differences, brute force."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize

from tensegrity_envs.geometry.four_bar_workspace import actuator_workspace, output_workspace
from tensegrity_envs.mechanics import JI2014, PlanarFourBar, PlanarFourBarDesign
from tensegrity_envs.mechanics.planar_four_bar.inverse import choose_stable
from tensegrity_envs.mechanics.planar_four_bar.singularities import SINGULARITIES, singular_configurations

ARM = PlanarFourBar()
OTHER = PlanarFourBar(PlanarFourBarDesign(length=0.3, stiffness=470.0))
K, L = JI2014.stiffness, JI2014.length
both = pytest.mark.parametrize("arm", [ARM, OTHER], ids=["Ji2014", "small"])


def node_energy(arm, q, lengths, load):
    """From node positions alone."""
    nodes = arm.nodes(q, lengths)
    energy = -load[0] * nodes["F"][0] - load[1] * nodes["F"][1]
    for member in arm.members:
        if member.kind == "spring":
            (x1, y1), (x2, y2) = (nodes[name] for name in member.nodes)
            energy = energy + member.stiffness * ((x2 - x1) ** 2 + (y2 - y1) ** 2) / 2
    return energy


def draw(arm, seed, count, load=300.0):
    """Configurations, lengths and loads, components of shape (count,)."""
    rng = np.random.default_rng(seed)
    l, force = arm.length, load / 1000 * arm.stiffness * arm.length
    return (
        tuple(rng.uniform(-math.pi, math.pi, (2, count))),
        tuple(rng.uniform(0.02 * l, 1.98 * l, (2, count))),
        tuple(rng.uniform(-force, force, (2, count))),
    )


def draw_rectangles(arm, seed, count, rim=0.02):
    """Lengths at which there are rectangles, away from R = 0 and R = 1, and sides."""
    rng = np.random.default_rng(seed)
    rho = rng.uniform(0, 2 * arm.length, (2, 4 * count + 50))
    square, rest = arm.flatness(tuple(rho))
    rho = rho[:, (square > rim) & (rest > rim)][:, :count]
    assert rho.shape[1] == count
    return tuple(rho), rng.choice([-1, 1], count)


def wrapped(angle):
    return np.arctan2(np.sin(angle), np.cos(angle))


@both
def test_bars_and_actuators_have_their_lengths(arm):
    q, lengths, _ = draw(arm, 0, 500)
    nodes = arm.nodes(q, lengths)
    kinds = {"bar": 0, "spring": 0, "actuator": 0}
    inputs = iter(lengths)
    for member in arm.members:
        kinds[member.kind] += 1
        (x1, y1), (x2, y2) = (nodes[name] for name in member.nodes)
        length = np.hypot(x2 - x1, y2 - y1)
        if member.kind == "bar":
            np.testing.assert_allclose(length, arm.length, rtol=1e-12)
        elif member.kind == "actuator":
            np.testing.assert_allclose(length, next(inputs), rtol=1e-12, atol=1e-13 * arm.length)
    assert kinds == {"bar": 4, "spring": 3, "actuator": 2}
    assert (nodes["C"][1] >= 0).all()
    assert (nodes["D"][1] >= 0).all()
    np.testing.assert_array_equal(arm.tip(q, lengths), nodes["F"])
    alpha, beta = arm.base_angles(lengths)
    np.testing.assert_allclose(arm.lengths_of(alpha, beta), lengths, rtol=1e-13)


@both
def test_energy_gradient_and_hessian_are_those_of_nodes_and_members(arm):
    q, lengths, load = draw(arm, 1, 300)
    scale = arm.stiffness * arm.length**2
    energy = arm.potential_energy(q, lengths, load)
    assert np.abs(energy - node_energy(arm, q, lengths, load)).max() < 1e-13 * 20 * scale
    gradient, hessian = (np.array(part) for part in arm.statics(q, lengths, load))
    h = 2e-3

    def difference(function, i):
        def at(multiple):
            return np.array(function(tuple(v + multiple * h * (i == j) for j, v in enumerate(q))))

        return (45 * (at(1) - at(-1)) - 9 * (at(2) - at(-2)) + (at(3) - at(-3))) / (60 * h)

    for i in range(2):
        slope = difference(lambda p: node_energy(arm, p, lengths, load), i)
        assert np.abs(gradient[i] - slope).max() < 1e-10 * scale
        row = difference(lambda p: arm.energy_gradient(p, lengths, load), i)
        assert np.abs(hessian[i] - row).max() < 1e-10 * scale


def descend(arm, lengths, load, theta, gamma):
    """Minima of the node energy from many starts at once, by damped Newton steps with differences; arrays."""
    q = np.stack([theta, gamma])
    h, scale = 1e-4, arm.stiffness * arm.length**2

    def energy(a, b):
        return node_energy(arm, (q[0] + a, q[1] + b), lengths, load)

    for _ in range(120):
        e0, pa, ma, pb, mb = energy(0, 0), energy(h, 0), energy(-h, 0), energy(0, h), energy(0, -h)
        pp, mm, pm, mp = energy(h, h), energy(-h, -h), energy(h, -h), energy(-h, h)
        g = np.stack([pa - ma, pb - mb]) / (2 * h)
        cross = (pp + mm - pm - mp) / (4 * h * h)
        hessian = np.stack([np.stack([pa + ma - 2 * e0, h * h * cross]), np.stack([h * h * cross, pb + mb - 2 * e0])])
        values, vectors = np.linalg.eigh(np.moveaxis(hessian / (h * h), -1, 0))
        shift = np.maximum(np.abs(values), 1e-3 * scale)
        step = -np.einsum("nij,nj,nkj,kn->in", vectors, 1 / shift, vectors, g)
        q = q + step * np.minimum(1.0, 0.3 / np.maximum(np.abs(step).max(axis=0), 1e-12))
    return wrapped(q), values[:, 0], np.abs(g).max(axis=0)


def test_closed_forms_are_the_minima_of_the_node_energy_on_500_random_inputs():
    rng = np.random.default_rng(2)
    count, starts = 500, 10
    rho = rng.uniform(0.1, 19.9, (2, count))
    square, rest = ARM.flatness(tuple(rho))
    rho = rho[:, (square > 0.01) & (np.abs(rest) > 0.01)]
    count = rho.shape[1]
    theta, gamma = rng.uniform(-math.pi, math.pi, (2, starts, count))
    lengths = tuple(np.tile(r, starts) for r in rho)
    q, least, slope = descend(ARM, lengths, (0.0, 0.0), theta.ravel(), gamma.ravel())
    q, least, slope = q.reshape(2, starts, count), least.reshape(starts, count), slope.reshape(starts, count)
    for i in range(count):
        here = tuple(rho[:, i])
        stable = [state.configuration for state in ARM.equilibria(here) if state.is_stable]
        assert len(stable) == (2 if here[0] ** 2 + here[1] ** 2 < 400 else 1)
        found = q[:, (least[:, i] > 0) & (slope[:, i] < 1e-3), i].T
        assert len(found) > starts // 2
        gaps = np.abs(wrapped(found[:, None] - np.array(stable)[None])).max(axis=2)
        assert gaps.min(axis=1).max() < 1e-5
        mode = "rectangle" if len(stable) == 2 else "flat"
        closed = [ARM.forward_kinematics(here, side, mode).configuration for side in (1, -1)]
        assert max(np.abs(wrapped(np.subtract(a, stable))).max(axis=1).min() for a in closed) < 1e-9


def test_unloaded_equilibria_are_all_there_are():
    """Newton's method on differences of the node energy from a grid of starts finds no others."""
    rng = np.random.default_rng(3)
    for _ in range(5):
        lengths = tuple(rng.uniform(0.3, 19.7, 2))
        compare_all_critical_points(lengths, (0.0, 0.0))


def test_loaded_equilibria_are_all_there_are():
    rng = np.random.default_rng(4)
    for _ in range(14):
        lengths = tuple(rng.uniform(0.3, 19.7, 2))
        compare_all_critical_points(lengths, tuple(rng.uniform(-400, 400, 2)))


def compare_all_critical_points(lengths, load):
    axis = np.linspace(-math.pi, math.pi, 40, endpoint=False)
    q = np.stack([v.ravel() for v in np.meshgrid(axis, axis)])
    h = 1e-3

    def slope(p):
        def difference(i):
            d = np.array([[h], [0.0]]) if i == 0 else np.array([[0.0], [h]])
            e = [node_energy(ARM, tuple(p + m * d), lengths, load) for m in (1, -1, 2, -2)]
            return (8 * (e[0] - e[1]) - (e[2] - e[3])) / (12 * h)

        return np.stack([difference(0), difference(1)])

    for _ in range(40):
        g = slope(q)
        columns = [
            (slope(q + h * d) - slope(q - h * d)) / (2 * h) for d in (np.array([[1], [0]]), np.array([[0], [1]]))
        ]
        table = np.moveaxis(np.stack(columns, axis=1), -1, 0)
        step = np.linalg.solve(table + 1e-9 * np.eye(2), g.T[..., None])[..., 0].T
        q = q - step * np.minimum(1.0, 0.3 / np.maximum(np.abs(step).max(axis=0), 1e-12))
    good = np.abs(slope(q)).max(axis=0) < 1e-4
    points = []
    for point in wrapped(q[:, good]).T:
        if all(np.abs(wrapped(point - other)).max() > 1e-4 for other in points):
            points.append(point)
    expected = np.array([state.configuration for state in ARM.equilibria(lengths, load)])
    assert len(points) == len(expected)
    gaps = np.abs(wrapped(np.array(points)[:, None] - expected[None])).max(axis=2)
    assert gaps.min(axis=0).max() < 1e-5
    assert gaps.min(axis=1).max() < 1e-5
    assert max(state.residual for state in ARM.equilibria(lengths, load)) < 1e-9 * K * L**2


def test_loaded_equilibria_against_a_constrained_minimizer_on_node_positions():
    """SLSQP on the positions of E and F with the bars as constraints knows nothing of angles."""
    rng = np.random.default_rng(5)
    for _ in range(12):
        lengths, load = tuple(rng.uniform(2, 17, 2)), rng.uniform(-250, 250, 2)
        c, d = (np.array(p) for p in ARM.supports(lengths))
        stable = [s for s in ARM.equilibria(lengths, tuple(load)) if s.is_stable]
        tips = np.array([s.tip for s in stable])
        reached = set()

        def energy(p, c=c, d=d, load=load):
            e, f = p[:2], p[2:]
            return K / 2 * (((c - e) ** 2).sum() + ((e - f) ** 2).sum() + ((f - d) ** 2).sum()) - load @ f

        bars = [
            {"type": "eq", "fun": lambda p, d=d: ((p[:2] - d) ** 2).sum() / L**2 - 1},
            {"type": "eq", "fun": lambda p, c=c: ((p[2:] - c) ** 2).sum() / L**2 - 1},
        ]
        for _ in range(12):
            t, g = rng.uniform(-math.pi, math.pi, 2)
            start = np.concatenate(
                [d + L * np.array([-np.cos(t), np.sin(t)]), c + L * np.array([np.cos(g), np.sin(g)])]
            )
            found = minimize(energy, start, method="SLSQP", constraints=bars, options={"maxiter": 500, "ftol": 1e-12})
            if not found.success:
                continue
            gap = np.hypot(*(tips - found.x[2:]).T)
            # SLSQP may also stop on a saddle that it happens to meet; from random starts it hardly ever does.
            if gap.min() < 1e-3:
                reached.add(int(gap.argmin()))
                assert found.fun == pytest.approx(stable[int(gap.argmin())].energy, abs=1e-4)
        assert reached == set(range(len(stable)))


def test_equilibrium_settles_where_the_energy_leads():
    q, lengths, load = draw(ARM, 6, 60)
    found = ARM.equilibrium(lengths, q, load)
    assert np.all(found.is_stable)
    one = ARM.equilibrium(tuple(r[0] for r in lengths), tuple(a[0] for a in q), tuple(f[0] for f in load))
    np.testing.assert_allclose(one.configuration, [a[0] for a in found.configuration], atol=1e-9)
    for i in range(60):
        stable = ARM.equilibria(tuple(r[i] for r in lengths), tuple(f[i] for f in load))
        here = [a[i] for a in found.configuration]
        assert min(np.abs(wrapped(np.subtract(here, s.configuration))).max() for s in stable if s.is_stable) < 1e-7


# --------------------------------------------------------------------------------------------------- kinematics


@pytest.mark.parametrize("count", [2000, pytest.param(10_000, marks=pytest.mark.full)])
def test_forward_after_inverse_and_inverse_after_forward(count):
    lengths, side = draw_rectangles(ARM, 7, count, rim=1e-3)
    state = ARM.forward_kinematics(lengths, side)
    mismatches = 0
    for i in range(count):
        x, y = (float(v[i]) for v in state.tip)
        here = np.array([v[i] for v in lengths])
        found = [s for s in ARM.inverse_kinematics(x, y) if s.type == "X"]
        assert found
        same = 0
        for s in found:
            assert s.residual < 1e-12 * L
            again = ARM.forward_kinematics(s.lengths, s.side)
            assert np.hypot(again.tip[0] - x, again.tip[1] - y) < 1e-6  # near R = 0 and R = 1 lengths are stretched
            assert np.abs(wrapped(np.subtract(again.configuration, s.configuration))).max() < 1e-6
            # beyond 1e-5 apart they are different solutions (at a fold two of them meet)
            same += bool(np.abs(here - s.lengths).max() < 1e-5 and s.side == side[i])
        mismatches += same == 0
    assert mismatches == 0


def test_inverse_kinematics_against_a_scan_of_alpha():
    """All stable states with F at the target: minima of the node energy in theta and gamma, scanned over alpha."""
    rng = np.random.default_rng(8)
    for _ in range(20):
        x, y = rng.uniform(-10, 17), rng.uniform(-2, 19)
        load = tuple(rng.uniform(-150, 150, 2)) if rng.uniform() < 0.5 else (0.0, 0.0)
        found = np.array(sorted(s.lengths for s in ARM.inverse_kinematics(x, y, load) if s.is_stable))
        expected = []
        distance = math.hypot(x - L, y)
        if distance < 2 * L:
            for sign in (1, -1):
                bow = sign * math.sqrt(L * L / distance**2 - 0.25)
                cx, cy = L + (x - L) / 2 - bow * y, y / 2 + bow * (x - L)
                if cy < 0:
                    continue
                alpha = np.linspace(1e-4, math.pi - 1e-4, 4001)
                gamma = math.atan2(y - cy, x - cx)
                dx, dy = L * np.cos(alpha), L * np.sin(alpha)
                mx, my = (cx + x) / 2 - dx, (cy + y) / 2 - dy
                theta = np.arctan2(my, -mx)
                lengths = (np.full(alpha.shape, math.hypot(cx, cy)), 2 * L * np.sin(alpha / 2))
                q = (theta, np.full(alpha.shape, gamma))
                slope = (
                    node_energy(ARM, (theta, gamma + 1e-5), lengths, load)
                    - node_energy(ARM, (theta, gamma - 1e-5), lengths, load)
                ) / 2e-5
                (h11, h12), (_, h22) = ARM.stiffness_matrix(q, lengths, load)
                for i in np.flatnonzero((slope[1:] > 0) != (slope[:-1] > 0)):
                    if h11[i] > 0 and h11[i] * h22[i] - h12[i] ** 2 > 0:
                        share = slope[i] / (slope[i] - slope[i + 1])
                        expected.append(
                            (lengths[0][0], 2 * L * math.sin((alpha[i] + share * (alpha[i + 1] - alpha[i])) / 2))
                        )
        assert len(expected) == len(found)
        if expected:
            np.testing.assert_allclose(found, sorted(expected), atol=1e-4)


def test_jacobians_by_differences():
    lengths, side = draw_rectangles(ARM, 9, 300, rim=0.05)
    jacobian = np.array(ARM.rectangle_jacobian(lengths, side))
    h = 1e-3
    for i in range(2):

        def at(multiple, i=i):
            moved = tuple(r + multiple * h * (i == j) for j, r in enumerate(lengths))
            return np.array(ARM.forward_kinematics(moved, side).tip)

        column = (45 * (at(1) - at(-1)) - 9 * (at(2) - at(-2)) + (at(3) - at(-3))) / (60 * h)
        np.testing.assert_allclose(jacobian[:, i], column, rtol=1e-7, atol=1e-7)
    q = ARM.forward_kinematics(lengths, side).configuration
    np.testing.assert_allclose(ARM.jacobian(q, lengths), jacobian, rtol=1e-9, atol=1e-11)
    det = np.linalg.det(np.moveaxis(jacobian, -1, 0))
    np.testing.assert_allclose(ARM.rectangle_determinant(lengths, side), det, rtol=1e-9, atol=1e-12)
    # [Ji2014, Eq. 40] with the corrected Phi
    _, phi2, phi3 = ARM.phi(q, lengths)
    beta = ARM.base_angles(lengths)[1]
    roots = np.sqrt((4 * L**2 - lengths[0] ** 2) * (4 * L**2 - lengths[1] ** 2))
    np.testing.assert_allclose(4 * L**2 * np.sin(beta + q[1]) / roots * phi3 / phi2, det, rtol=1e-8, atol=1e-10)
    square, rest = ARM.flatness(lengths)
    np.testing.assert_allclose(phi2, -4 * square * rest, rtol=1e-9)


def test_loaded_jacobian_thrusts_and_compliance_by_differences():
    rng = np.random.default_rng(10)
    checked = 0
    while checked < 40:
        lengths, load = tuple(rng.uniform(3, 15, 2)), tuple(rng.uniform(-150, 150, 2))
        for state in ARM.equilibria(lengths, load):
            if not state.is_stable or ARM.stability_margin(state.configuration, lengths, load) < 0.1:
                continue

            def at(rho, force, state=state):
                found = ARM.equilibrium(rho, state.configuration, force)
                return np.array(ARM.tip(found.configuration, rho)), ARM.potential_energy(
                    found.configuration, rho, force
                )

            h, jacobian = 1e-4, np.array(ARM.jacobian(state.configuration, lengths, load))
            thrusts = ARM.thrusts(state.configuration, lengths, load)
            compliance = np.array(ARM.tip_compliance(state.configuration, lengths, load))
            for i in range(2):
                step = h * np.eye(2)[i]
                (p, u), (m, v) = at(tuple(lengths + step), load), at(tuple(lengths - step), load)
                np.testing.assert_allclose(jacobian[:, i], (p - m) / (2 * h), atol=2e-5 * (1 + abs(jacobian).max()))
                assert thrusts[i] == pytest.approx((u - v) / (2 * h), abs=1e-3)  # the energy's envelope
                (p, _), (m, _) = at(lengths, tuple(load + 100 * step)), at(lengths, tuple(load - 100 * step))
                np.testing.assert_allclose(compliance[:, i], (p - m) / (200 * h), atol=1e-6)
            assert abs(np.linalg.det(compliance)) < 1e-12
            checked += 1


@both
def test_member_forces_balance_every_moving_node(arm):
    rng = np.random.default_rng(11)
    scale = arm.stiffness * arm.length
    for _ in range(40):
        lengths = tuple(rng.uniform(0.1, 1.9, 2) * arm.length)
        load = tuple(rng.uniform(-0.2, 0.2, 2) * scale)
        for state in arm.equilibria(lengths, load):
            nodes = {name: np.array(p) for name, p in arm.nodes(state.configuration, lengths).items()}
            forces = arm.member_forces(state.configuration, lengths, load)
            total = {name: np.zeros(2) for name in nodes} | {"F": np.array(load)}
            for member in arm.members:
                first, second = member.nodes
                along = nodes[second] - nodes[first]
                pull = forces[member.name] * along / np.hypot(*along)
                total[first], total[second] = total[first] + pull, total[second] - pull
            largest = max(abs(force) for force in forces.values())
            for name in "CDEF":
                assert np.abs(total[name]).max() < 1e-9 * (scale + largest)


def test_unloaded_thrusts_are_within_two_k_l():
    """The bound that the environment's wrench margin uses, and the closed form of the page."""
    lengths, side = draw_rectangles(ARM, 12, 20_000, rim=1e-6)
    q = ARM.forward_kinematics(lengths, side).configuration
    p1, p2 = ARM.thrusts(q, lengths)
    assert max(np.abs(p1).max(), np.abs(p2).max()) < 2 * K * L
    alpha, beta = ARM.base_angles(lengths)
    np.testing.assert_allclose(p1, K * lengths[1] * np.cos(beta + alpha / 2) / np.cos(beta / 2), atol=1e-6)
    np.testing.assert_allclose(p2, K * lengths[0] * np.cos(alpha + beta / 2) / np.cos(alpha / 2), atol=1e-6)


def test_energy_barrier_is_the_lowest_saddle():
    lengths, _ = draw_rectangles(ARM, 13, 60)
    for i in range(60):
        here = tuple(float(r[i]) for r in lengths)
        found = ARM.equilibria(here)
        saddle = min(s.energy for s in found if s.type in ("IN", "PAR"))
        assert ARM.energy_barrier(here) == pytest.approx(saddle - found[0].energy, rel=1e-9, abs=1e-8)
    assert ARM.energy_barrier((18.0, 19.0)) == 0


def test_critical_load_is_where_the_stable_state_ends():
    """By small load steps from rest: below it the state is followed continuously, above it is lost."""
    rng = np.random.default_rng(14)
    lengths, side = draw_rectangles(ARM, 15, 12, rim=0.1)
    for i in range(12):
        here = tuple(float(r[i]) for r in lengths)
        angle = rng.uniform(-math.pi, math.pi)
        n = np.array([math.cos(angle), math.sin(angle)])
        force = ARM.critical_load(here, int(side[i]), tuple(n))
        q = np.array(ARM.forward_kinematics(here, int(side[i])).configuration)
        last = 0.0
        for share in (*np.linspace(0.02, 0.98, 49), 0.998):
            last = share * min(force, 5000.0)
            for _ in range(8):
                gradient, hessian = ARM.statics(tuple(q), here, tuple(last * n))
                q = q - np.linalg.solve(np.array(hessian), np.array(gradient))
            assert ARM.stability_margin(tuple(q), here, tuple(last * n)) > 0
        if force < 5000:
            above = [s for s in ARM.equilibria(here, tuple(1.01 * force * n)) if s.is_stable]
            gaps = [np.abs(wrapped(q - np.array(s.configuration))).max() for s in above]
            assert min(gaps, default=1.0) > 0.1
    assert ARM.critical_load((14.0, 12.0), 1, (1.0, 0.0)) == pytest.approx(733.8, abs=0.1)
    q = ARM.forward_kinematics((14.0, 12.0), 1).configuration
    assert ARM.critical_load((14.0, 12.0), 1, (math.cos(q[1]), math.sin(q[1]))) == math.inf


# --------------------------------------------------------------------------------- singularities and workspaces


def test_singular_configurations_are_recognized():
    def names(lengths, side=1, tolerance=1e-6):
        return [s.name for s in singular_configurations(ARM, lengths, side, tolerance)]

    assert names((0.0, 9.0)) == ["i", "vii: Phi2 = 0"]
    assert names((9.0, 0.0)) == ["ii", "vii: Phi2 = 0"]
    assert names((20.0, 14.0)) == ["iii"]
    assert names((14.0, 20.0)) == ["iv"]
    assert names((20.0, 20.0)) == ["iii", "iv", "v"]
    assert {"vi", "vii: Phi2 = 0"} <= set(names((10.0, 10.0)))
    assert {"pitchfork", "vii: Phi2 = 0"} <= set(names((12.0, 16.0)))
    special = 2 * L / math.sqrt(3)
    assert names((special, special)) == ["vii: B, C, F aligned", "vii: A, D, M aligned"]
    assert names((14.0, 12.0)) == []
    assert len(SINGULARITIES) == 10
    with pytest.raises(ValueError, match="rho1"):
        names((21.0, 5.0))


def test_determinant_vanishes_where_vii_says_and_grows_at_the_pitchfork():
    lengths, side = draw_rectangles(ARM, 16, 5000)
    det = ARM.rectangle_determinant(lengths, side)
    measures = {s.name: s.measure(ARM, lengths, side) for s in SINGULARITIES}
    product = measures["vii: B, C, F aligned"] * measures["vii: A, D, M aligned"]
    shared = np.sign(det * product * side)  # zeros and, but for the mirror image, signs
    assert (shared == shared[0]).all()

    def near(d):
        return abs(ARM.rectangle_determinant((0.6 * (20 - d), 0.8 * (20 - d)), 1))

    assert near(1e-6) / near(4e-6) == pytest.approx(2.0, rel=1e-2)


@pytest.mark.parametrize(("mode", "area"), [("rectangle", 100 * math.pi), ("flat", 400 - 100 * math.pi)])
def test_actuator_workspace_is_a_quarter_disc_and_the_rest_of_the_square(mode, area):
    assert actuator_workspace(ARM, mode).trace().area == pytest.approx(area, abs=1e-6)


@pytest.mark.parametrize("mode", ["rectangle", "paper", "flat"])
def test_output_workspace_counts_stable_inverse_solutions(mode):
    found = output_workspace(ARM, mode)
    rng = np.random.default_rng(17)
    x, y = rng.uniform(-10.5, 18, 400), rng.uniform(-3, 19.5, 400)
    counts = found.count(x, y)
    wrong = 0
    for i in range(400):
        solutions = [s for s in ARM.inverse_kinematics(x[i], y[i]) if s.is_stable]
        if mode == "flat":
            wrong += counts[i] != sum(s.type == "IN" for s in solutions)
        else:
            wrong += counts[i] != sum(s.type == "X" and (mode != "paper" or s.is_within_paper_range) for s in solutions)
    assert wrong == 0
    assert {"rectangle": 412.5, "paper": 199.3, "flat": 98.7}[mode] == pytest.approx(found.area(), abs=0.1)


def test_paper_range_is_met_where_r_squared_is_less_than_a():
    lengths, _ = draw_rectangles(ARM, 19, 4000)
    inside = actuator_workspace(ARM, "paper").contains(*lengths)
    any_side = np.zeros(4000, bool)
    for side in (1, -1):
        q = np.array(ARM.forward_kinematics(lengths, np.full(4000, side)).configuration)
        any_side |= ((q > 0) & (q < math.pi)).all(axis=0)
    np.testing.assert_array_equal(inside, any_side)


def test_area_of_the_paper_range_against_a_sum_over_cells():
    n = 4000
    middle = (np.arange(n) + 0.5) * 2 * L / n
    cells = np.zeros(2)
    for rho2 in middle:
        square = ARM.flatness((middle, np.full(n, rho2)))[0]
        a = (middle**2 + rho2**2) / (2 * L**2) - 1
        cells += [(sign * a > square).sum() for sign in (1, -1)]
    areas = [actuator_workspace(ARM, "paper", lobe).trace(1024).area for lobe in (1, -1)]
    np.testing.assert_allclose(areas, cells * (2 * L / n) ** 2, atol=0.01)


# --------------------------------------------------------------------------------------------------- arguments


def test_components_may_be_floats_arrays_or_tensors():
    torch = pytest.importorskip("torch")
    q, lengths, load = draw(ARM, 20, 6)
    rectangles, side = draw_rectangles(ARM, 21, 6)

    def quantities(arm, q, lengths, load, rectangles, side):
        nodes = arm.nodes(q, lengths).values()
        gradient, hessian = arm.statics(q, lengths, load)
        values = [arm.potential_energy(q, lengths, load), *gradient, *hessian[0], *hessian[1]]
        values += [
            arm.stability_margin(q, lengths, load),
            *arm.thrusts(q, lengths, load),
            *(v for n in nodes for v in n),
        ]
        values += [*arm.member_forces(q, lengths, load).values(), arm.energy_barrier(lengths)]
        state = arm.rectangle(rectangles, side)
        values += [*state[0], *state[1], *arm.phi(q, lengths), *arm.flat(lengths)[0]]
        values += [v for row in arm.jacobian(q, lengths, load) for v in row]
        return values + [v for row in arm.tip_compliance(q, lengths, load) for v in row]

    arrays = quantities(ARM, q, lengths, load, rectangles, side)
    tensors = quantities(
        ARM, *(tuple(map(torch.tensor, part)) for part in (q, lengths, load, rectangles)), torch.tensor(side)
    )
    batch = PlanarFourBar(PlanarFourBarDesign(np.full(6, L), np.full(6, K)))
    batched = quantities(batch, q, lengths, load, rectangles, side)
    for i in range(6):
        floats = quantities(
            ARM, *(tuple(float(v[i]) for v in part) for part in (q, lengths, load, rectangles)), int(side[i])
        )
        for number, array, tensor, other in zip(floats, arrays, tensors, batched, strict=True):
            assert type(number) is float
            for value in (array[i], float(tensor[i]), other[i]):
                assert value == pytest.approx(number, rel=1e-10, abs=1e-10)


def test_bad_input_is_named():
    for lengths in ((20.5, 3.0), (-0.1, 3.0), (math.nan, 3.0)):
        with pytest.raises(ValueError, match="rho1"):
            ARM.forward_kinematics(lengths, 1)
        with pytest.raises(ValueError, match="rho1"):
            ARM.equilibria(lengths)
    with pytest.raises(ValueError, match="must be 2"):
        ARM.forward_kinematics((1.0, 2.0, 3.0), 1)
    with pytest.raises(ValueError, match="collinear"):
        ARM.forward_kinematics((18.0, 19.0), 1)
    with pytest.raises(ValueError, match="collinear"):
        ARM.forward_kinematics((0.0, 9.0), 1)
    with pytest.raises(ValueError, match="flat states are stable only"):
        ARM.forward_kinematics((8.0, 9.0), 1, "flat")
    with pytest.raises(ValueError, match="mode"):
        ARM.forward_kinematics((8.0, 9.0), 1, "x")
    with pytest.raises(ValueError, match="side"):
        ARM.forward_kinematics((8.0, 9.0), 0)
    for action in (lambda: ARM.forward_kinematics((10.0, 10.0), 1), lambda: ARM.equilibria((10.0, 10.0))):
        with pytest.raises(ValueError, match="C and D coincide"):
            action()
    with pytest.raises(ValueError, match="no rectangle"):
        ARM.rectangle_jacobian((18.0, 19.0), 1)
    with pytest.raises(ValueError, match="nor on any other"):
        choose_stable(ARM, 100.0, 0.0, 1)
    with pytest.raises(ValueError, match="there are stable ones on side 1"):
        choose_stable(ARM, *ARM.forward_kinematics((11.4, 11.4), 1).tip, 3)
    with pytest.raises(ValueError, match="finite"):
        ARM.inverse_kinematics(math.nan, 0.0)
    with pytest.raises(ValueError, match="direction"):
        ARM.critical_load((14.0, 12.0), 1, (0.0, 0.0))
    with pytest.raises(ValueError, match="load"):
        ARM.equilibria((14.0, 12.0), (math.inf, 0.0))
    with pytest.raises(ValueError, match="length"):
        PlanarFourBarDesign(length=-1.0, stiffness=100.0)
    with pytest.raises(TypeError, match="stiffness"):
        PlanarFourBarDesign(length=1.0, stiffness="stiff")
    with pytest.raises(TypeError, match="design"):
        PlanarFourBar({"length": 1.0})
    with pytest.raises(ValueError, match="mode"):
        output_workspace(ARM, "x")
    with pytest.raises(ValueError, match="lobe"):
        actuator_workspace(ARM, "paper", 2)
    assert ARM.inverse_kinematics(100.0, 0.0) == []
