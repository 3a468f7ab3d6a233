"""The spatial prism against routes that know none of its formulas: nodes and members, minimizers, differences."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from tensegrity_envs.mechanics import JAHROMY, SpatialPrism, SpatialPrismDesign
from tensegrity_envs.mechanics.spatial_prism import trajectory31, trajectory32

PRISM = SpatialPrism()
DESIGNS = [JAHROMY, SpatialPrismDesign(0.3, 0.35, 40.0), SpatialPrismDesign(0.1, 0.8, 900.0)]


def nodes_of(design, q):
    """Positions of base and platform nodes, (6, 3), by scipy's rotations."""
    angles = np.array([0, 2, 4]) * math.pi / 3
    flat = [np.stack([np.cos(a), np.sin(a), 0 * a], axis=1) for a in (angles, angles + math.pi / 6)]
    turned = Rotation.from_rotvec(q[3:]).apply(design.d * flat[1])
    return np.concatenate([design.D * flat[0], q[:3] + turned])


def energy(design, q, force=(0, 0, 0)):
    nodes = nodes_of(design, q)
    return design.k / 2 * ((nodes[3:] - nodes[:3]) ** 2).sum() - np.dot(force, q[:3])


def struts(design, q):
    nodes = nodes_of(design, q)
    return np.linalg.norm(nodes[[4, 5, 3]] - nodes[:3], axis=1)


def positions(rng, count, sheet=None):
    x, y = rng.uniform(-0.4, 0.4, (2, count))
    sheet = rng.choice([-1, 1], count) if sheet is None else sheet
    return x, y, sheet * rng.uniform(0.15, 0.9, count)


def constrained_minimum(design, lengths, start, force):
    """The energy's minimum with struts of given lengths, by SLSQP on all six coordinates."""
    found = minimize(
        lambda q: energy(design, q, force),
        start,
        constraints={"type": "eq", "fun": lambda q: struts(design, q) ** 2 - np.square(lengths)},
        method="SLSQP",
        options={"ftol": 1e-15, "maxiter": 300},
    )
    return found.x


@pytest.mark.parametrize("design", DESIGNS)
def test_structure_and_energy_are_those_of_the_nodes(design):
    prism, rng = SpatialPrism(design), np.random.default_rng(0)
    for _ in range(100):
        q, force = rng.normal(0, 0.6, 6), rng.normal(0, 10, 3)
        named = prism.nodes(tuple(q))
        np.testing.assert_allclose(list(named.values())[:6], nodes_of(design, q), atol=1e-14)
        stored = 0.0
        for member in prism.members:
            length = math.dist(*(named[name] for name in member.nodes))
            stored += member.stiffness * length**2 / 2
            if member.kind == "cable":
                assert length == pytest.approx(math.sqrt(3) * design.d)
            index = int(member.name[-1]) - 1
            if member.kind == "actuator":
                assert length == pytest.approx(struts(design, q)[index])
        assert prism.potential_energy(tuple(q), None, tuple(force)) == pytest.approx(stored - force @ q[:3], rel=1e-12)
        np.testing.assert_allclose(prism.strut_lengths(tuple(q)), struts(design, q), rtol=1e-13)


def reduced_energy(design, lengths, near, w):
    """Energy of n prisms (n, 3) at rotation vectors w, the centroid put by Newton's method where the struts fit."""
    angles = np.array([0, 2, 4]) * math.pi / 3
    base, flat = (np.stack([np.cos(a), np.sin(a), 0 * a], axis=1) for a in (angles, angles + math.pi / 6))
    turned = np.stack([Rotation.from_rotvec(w).apply(design.d * node) for node in flat], axis=1)
    place = near.copy()
    for _ in range(12):
        way = place[:, None] + turned[:, [1, 2, 0]] - design.D * base
        place -= np.linalg.solve(2 * way, ((way**2).sum(axis=2) - lengths**2)[..., None])[..., 0]
    springs = place[:, None] + turned - design.D * base
    return design.k / 2 * (springs**2).sum(axis=(1, 2)), place


@pytest.mark.parametrize("design", DESIGNS)
def test_closed_forms_against_energy_minimization_on_random_inputs(design):
    """Newton's method on differences of the energy, from platforms turned by up to half a radian; 3 x 200 inputs."""
    rng = np.random.default_rng(1)
    r = np.stack(positions(rng, 200), axis=1)
    prism = SpatialPrism(design)
    lengths = np.stack(prism.unloaded_lengths(tuple(r.T)), axis=1)
    w, h, eye = rng.uniform(-0.3, 0.3, r.shape), 1e-4, np.eye(3)

    def value(shift):
        return reduced_energy(design, lengths, r, w + h * shift)[0]

    for _ in range(8):
        gradient = np.stack([(value(e) - value(-e)) / (2 * h) for e in eye], axis=1)
        hessian = np.empty((len(r), 3, 3))
        for i in range(3):
            for j in range(3):
                corners = [a * b * value(a * eye[i] + b * eye[j]) for a in (1, -1) for b in (1, -1)]
                hessian[:, i, j] = sum(corners) / (4 * h * h)
        assert (np.linalg.eigvalsh(hessian) > 0).all()
        w = w - np.linalg.solve(hessian, gradient[..., None])[..., 0]
    lowest, place = reduced_energy(design, lengths, r, w)
    assert np.abs(w).max() < 1e-6
    np.testing.assert_allclose(place, r, atol=1e-6)
    rest = prism.potential_energy((*r.T, *np.zeros((3, len(r)))))
    np.testing.assert_allclose(rest, lowest, rtol=1e-10)
    others = reduced_energy(design, lengths, r, rng.uniform(-0.6, 0.6, r.shape))[0]
    assert (others >= rest).all()


def test_round_trips_on_both_sheets():
    rng = np.random.default_rng(2)
    r = positions(rng, 10_000)
    lengths = PRISM.unloaded_lengths(r)
    back = PRISM.forward_kinematics(lengths, np.sign(r[2]).astype(int))
    np.testing.assert_allclose(back, r, atol=1e-13)
    np.testing.assert_allclose(PRISM.unloaded_lengths(back), lengths, atol=1e-14)
    for i in range(0, 10_000, 100):
        both = PRISM.forward_solutions([l[i] for l in lengths])
        assert len(both) == 2
        np.testing.assert_allclose(both[0 if r[2][i] > 0 else 1], [c[i] for c in r], atol=1e-13)
        np.testing.assert_allclose(both[0][2], -both[1][2])


def test_loaded_round_trips():
    rng = np.random.default_rng(3)
    n = 10_000
    r = positions(rng, n)
    wrench = np.concatenate([rng.normal(0, 10, (3, n)), rng.normal(0, 0.5, (3, n))])
    there = PRISM.loaded_inverse_kinematics(r, wrench)
    assert there.is_stable.mean() > 0.97
    back = PRISM.loaded_equilibrium(there.lengths, wrench, np.sign(r[2]))
    both = there.is_stable & back.is_stable
    assert both.sum() > 0.97 * n
    gap = np.abs(np.stack(back.configuration) - np.stack(there.configuration)).max(axis=0)
    assert gap[both].max() < 1e-8
    assert (np.sign(back.configuration[2]) == np.sign(r[2]))[both].all()


def test_loaded_equilibria_against_a_constrained_minimizer():
    rng = np.random.default_rng(4)
    compared = 0
    for _ in range(30):
        r, force = [float(v[0]) for v in positions(rng, 1)], rng.normal(0, 15, 3)
        lengths = PRISM.unloaded_lengths(r)
        found = PRISM.loaded_equilibrium(lengths, tuple(force), int(np.sign(r[2])))
        if not found.is_stable:
            continue
        assert found.residual < 1e-9
        np.testing.assert_allclose(struts(JAHROMY, np.array(found.configuration)), lengths, atol=1e-12)
        best = constrained_minimum(JAHROMY, lengths, np.array([*r, 0, 0, 0]), force)
        assert energy(JAHROMY, np.array(found.configuration), force) <= energy(JAHROMY, best, force) + 1e-7
        np.testing.assert_allclose(nodes_of(JAHROMY, np.array(found.configuration)), nodes_of(JAHROMY, best), atol=5e-5)
        compared += 1
    assert compared > 25


def test_forces_and_tensions_balance_every_node_and_the_platform():
    """Newton and Euler from node positions: nothing is left at any node, nor of a wrench with a moment."""
    rng = np.random.default_rng(5)
    for _ in range(50):
        r = [float(v[0]) for v in positions(rng, 1)]
        force, torque = rng.normal(0, 8, 3), rng.normal(0, 0.3, 3)
        for wrench in ((*force,), (*force, *torque)):
            found = PRISM.loaded_inverse_kinematics(r, wrench)
            nodes = nodes_of(JAHROMY, np.array(found.configuration))
            base, top = nodes[:3], nodes[3:]
            at = np.array([100.0 * (b - p) for b, p in zip(base, top)])
            for i in range(3):
                axis = top[(i + 1) % 3] - base[i]
                at[(i + 1) % 3] += found.forces[i] * axis / np.linalg.norm(axis)
            np.testing.assert_allclose(at.sum(axis=0), -force, atol=1e-10)
            left = np.cross(top - np.array(r), at).sum(axis=0)
            np.testing.assert_allclose(left, -torque if len(wrench) > 3 else 0 * torque, atol=1e-9)
            if len(wrench) > 3:
                assert np.isnan(found.tensions).all()
                continue
            at += force / 3
            for i in range(3):
                edge = (top[(i + 1) % 3] - top[i]) / np.linalg.norm(top[(i + 1) % 3] - top[i])
                at[i] += found.tensions[i] * edge
                at[(i + 1) % 3] -= found.tensions[i] * edge
            np.testing.assert_allclose(at, 0, atol=1e-9)
            assert PRISM.cable_tensions(found.configuration, wrench) == pytest.approx(found.tensions)
            assert PRISM.actuator_forces(found.configuration, wrench) == pytest.approx(found.forces)


def test_jacobian_and_its_determinant_by_differences():
    r = positions(np.random.default_rng(6), 40)
    h = 1e-6
    table = np.empty((40, 3, 3))
    for j in range(3):
        up, down = ([c + s * h * (i == j) for i, c in enumerate(r)] for s in (1, -1))
        difference = np.subtract(PRISM.unloaded_lengths(up), PRISM.unloaded_lengths(down)) / (2 * h)
        table[:, :, j] = difference.T
    np.testing.assert_allclose(np.moveaxis(np.array(PRISM.strut_jacobian(r)), -1, 0), table, atol=1e-8)
    np.testing.assert_allclose(PRISM.strut_determinant(r), np.linalg.det(table), atol=1e-7)


def test_compliance_is_the_derivative_of_loaded_equilibria():
    rng = np.random.default_rng(7)
    for _ in range(20):
        r, force = [float(v[0]) for v in positions(rng, 1)], rng.normal(0, 6, 3)
        lengths, sheet = PRISM.unloaded_lengths(r), int(np.sign(r[2]))
        here = PRISM.loaded_equilibrium(lengths, tuple(force), sheet)
        columns = []
        for axis in np.eye(3):
            ends = [PRISM.loaded_equilibrium(lengths, tuple(force + s * 1e-3 * axis), sheet) for s in (1, -1)]
            columns.append(np.subtract(ends[0].configuration[:3], ends[1].configuration[:3]) / 2e-3)
        found = PRISM.tip_compliance(here.configuration, tuple(force))
        np.testing.assert_allclose(found, np.array(columns).T, rtol=1e-5, atol=1e-10)
        np.testing.assert_allclose(found, found.T, rtol=1e-6, atol=1e-12)


def test_reduced_hessian_is_that_of_the_energy_over_rotations():
    """Rotations about a loaded equilibrium, the centroid put where the struts keep their lengths by Newton's method."""
    rng = np.random.default_rng(8)
    for _ in range(8):
        r, force = [float(v[0]) for v in positions(rng, 1)], rng.normal(0, 6, 3)
        lengths = PRISM.unloaded_lengths(r)
        here = np.array(PRISM.loaded_equilibrium(lengths, tuple(force), int(np.sign(r[2]))).configuration)

        def reduced(turn, here=here, lengths=lengths, force=force):
            w = (Rotation.from_rotvec(turn) * Rotation.from_rotvec(here[3:])).as_rotvec()
            place = here[:3].copy()
            for _ in range(8):
                nodes = nodes_of(JAHROMY, np.array([*place, *w]))
                way = nodes[[4, 5, 3]] - nodes[:3]
                place = place - np.linalg.solve(2 * way, (way**2).sum(axis=1) - np.square(lengths))
            return energy(JAHROMY, np.array([*place, *w]), force)

        h, eye = 1e-3, np.eye(3)
        hessian = np.empty((3, 3))
        for i in range(3):
            for j in range(3):
                corners = [(a, b, reduced(h * (a * eye[i] + b * eye[j]))) for a in (1, -1) for b in (1, -1)]
                hessian[i, j] = sum(a * b * v for a, b, v in corners) / (4 * h * h)
        np.testing.assert_allclose(PRISM.stiffness_matrix(tuple(here), None, tuple(force)), hessian, atol=2e-4)
        smallest = np.linalg.eigvalsh(hessian)[0] / PRISM.rotational_stiffness
        assert PRISM.stability_margin(tuple(here), None, tuple(force)) == pytest.approx(smallest, abs=1e-5)


def test_rest_is_as_stiff_everywhere():
    r = positions(np.random.default_rng(9), 200)
    stiffness = np.moveaxis(np.array(PRISM.stiffness_matrix((*r, *np.zeros((3, 200))))), -1, 0)
    kappa = 1.5 * math.sqrt(3) * 100 * 0.2 * 0.5
    np.testing.assert_allclose(stiffness, np.broadcast_to(kappa * np.diag([1, 1, 2]), stiffness.shape), atol=1e-10)


def test_published_trajectories():
    t = np.linspace(0, 1, 20_001)
    r = trajectory31(t)
    forces = np.stack(PRISM.actuator_forces((*r, *np.zeros((3, len(t))))))
    np.testing.assert_allclose(forces.min(axis=1), (65.08, 68.09, 55.41), atol=0.005)
    np.testing.assert_allclose(forces.max(axis=1), (98.54, 94.84, 105.79), atol=0.005)
    assert PRISM.strut_clearance((*r, *np.zeros((3, len(t))))).min() == pytest.approx(67.6e-3, abs=1e-4)
    r = trajectory32(t)
    forces = np.stack(PRISM.actuator_forces((*r, *np.zeros((3, len(t))))))
    np.testing.assert_allclose(forces.min(axis=1), (97.119, 91.466, 92.553), atol=0.0006)
    np.testing.assert_allclose(forces.max(axis=1), (99.157, 104.394, 103.432), atol=0.0006)
    assert PRISM.strut_clearance((*r, *np.zeros((3, len(t))))).min() == pytest.approx(108.2e-3, abs=1e-4)


def test_strut_clearance_against_dense_samples():
    rng = np.random.default_rng(10)
    s = np.linspace(0, 1, 400)
    for _ in range(30):
        q = np.array([*(float(v[0]) for v in positions(rng, 1)), *rng.normal(0, 0.5, 3)])
        nodes = nodes_of(JAHROMY, q)
        lines = [nodes[i] + s[:, None] * (nodes[3 + (i + 1) % 3] - nodes[i]) for i in range(3)]
        pairs = ((0, 1), (1, 2), (2, 0))
        sampled = min(np.linalg.norm(lines[a][:, None] - lines[b], axis=-1).min() for a, b in pairs)
        assert PRISM.strut_clearance(tuple(q)) == pytest.approx(sampled, abs=2e-3)
        assert PRISM.strut_clearance(tuple(q)) <= sampled + 1e-12


def test_struts_keep_clear_of_each_other_within_the_stroke():
    lengths = np.random.default_rng(12).uniform(0.5, 1.2, (3, 200_000))
    (x, y), square = PRISM.foot_and_square(tuple(lengths))
    high = square >= 0.1**2
    q = (x[high], y[high], np.sqrt(square[high]), *np.zeros((3, int(high.sum()))))
    assert PRISM.strut_clearance(q).min() > 0.018


def test_unloading_limits():
    lengths = PRISM.unloaded_lengths((0.0, 0.0, 0.4))
    down = PRISM.unloading_limit(lengths, (0.0, 0.0, -1.0))
    assert down == (400.0, 0)
    buckling = PRISM.unloading_limit(PRISM.unloaded_lengths((0.2, 0.1, 0.4)), (0.0, 0.0, -1.0))
    assert buckling.force == pytest.approx(270, abs=1)
    assert buckling.event == 3
    angle = np.arange(12) * np.pi / 6
    side = PRISM.unloading_limit(lengths, (np.cos(angle), np.sin(angle), 0 * angle), 200.0)
    other = PRISM.unloading_limit(lengths, (np.cos(angle), np.sin(angle), 0 * angle), 3000.0)
    np.testing.assert_allclose(other.force, side.force, rtol=1e-8)
    assert side.force.min() == pytest.approx(89, abs=0.5)
    assert side.force.max() == pytest.approx(117, abs=0.5)
    for i in range(0, 12, 5):
        way = np.array([np.cos(angle[i]), np.sin(angle[i]), 0.0])
        before, after = (PRISM.loaded_equilibrium(lengths, tuple(s * side.force[i] * way)) for s in (0.999, 1.001))
        assert min(*before.forces, *before.tensions) > 0 > min(*after.forces, *after.tensions)


def test_errors_say_what_would_work():
    with pytest.raises(ValueError, match="z = 0"):
        PRISM.unloaded_lengths((0.1, 0.1, 0.0))
    with pytest.raises(ValueError, match="z = 0"):
        PRISM.loaded_inverse_kinematics((0.1, 0.1, 0.0), (0.0, 0.0, -1.0))
    with pytest.raises(ValueError, match=r"\(0.7, 0.7, 0.6\).*lengthen"):
        PRISM.forward_kinematics((0.7, 0.7, 0.6))
    with pytest.raises(ValueError, match="fit no position"):
        PRISM.loaded_equilibrium((0.7, 0.7, 0.6), (0.0, 0.0, 1.0))
    with pytest.raises(ValueError, match="length 2"):
        PRISM.forward_kinematics((0.7, -0.7, 0.6))
    with pytest.raises(ValueError, match="sheet"):
        PRISM.forward_kinematics((0.8, 0.8, 0.8), 0)
    with pytest.raises(ValueError, match="one plane"):
        PRISM.actuator_forces((0.1, 0.1, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="moment"):
        PRISM.cable_tensions((0.0, 0.0, 0.4, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0, 0.0, 1.0))
    with pytest.raises(ValueError, match="wrench: 2 numbers, must be 3 or 6"):
        PRISM.loaded_equilibrium((0.8, 0.8, 0.8), (0.0, 1.0))
    with pytest.raises(ValueError, match=r"SpatialPrismDesign.k = -1"):
        SpatialPrismDesign(0.2, 0.5, -1.0)
    with pytest.raises(TypeError, match=r"SpatialPrismDesign.d = '0.2'"):
        SpatialPrismDesign("0.2", 0.5, 100.0)


def test_floats_arrays_and_tensors_agree():
    torch = pytest.importorskip("torch")
    rng = np.random.default_rng(11)
    q = (*positions(rng, 5, 1), *rng.normal(0, 0.3, (3, 5)))
    load = tuple(rng.normal(0, 5, (3, 5)))

    def quantities(q, load):
        values = [*PRISM.unloaded_lengths(q[:3]), *PRISM.strut_lengths(q), *PRISM.spring_lengths(q)]
        values += [*PRISM.forward_kinematics(PRISM.unloaded_lengths(q[:3])), PRISM.strut_determinant(q[:3])]
        values += [*PRISM.actuator_forces(q, load), *PRISM.cable_tensions(q, load), *PRISM.moment_residual(q, load)]
        values += [
            PRISM.potential_energy(q, None, load),
            PRISM.stability_margin(q, None, load),
            PRISM.wrench_margin(q, None, load),
        ]
        return values + [entry for row in PRISM.stiffness_matrix(q, None, load) for entry in row]

    arrays = quantities(q, load)
    tensors = quantities(*(tuple(torch.tensor(v) for v in part) for part in (q, load)))
    for i in range(5):
        floats = quantities(*(tuple(float(v[i]) for v in part) for part in (q, load)))
        for number, array, tensor in zip(floats, arrays, tensors, strict=True):
            assert abs(number - array[i]) < 1e-11 * (1 + abs(number))
            assert abs(number - float(tensor[i])) < 1e-11 * (1 + abs(number))
