"""Laws that hold for every mechanism, checked by other routes than its closed forms: nodes, differences, autograd."""

import numpy as np
import pytest
from mechanism_cases import MECHANISMS, node_energy

import law_rows
from tensegrity_envs import mechanics

COUNT = 40
every_mechanism = pytest.mark.parametrize("case", law_rows.cases(MECHANISMS), ids=lambda case: case.name)


def rows(wanted):
    """The mechanisms of which something is true."""
    found = [case for case in law_rows.cases(MECHANISMS) if wanted(case)]
    return pytest.mark.parametrize("case", found, ids=lambda case: case.name)


def differences(function, q, step=2e-3, moved=None, count=None):
    """First derivatives of a function of configurations by central differences of sixth order.

    `moved(i, step)` is the configuration a step further along coordinate i of `count`.
    """
    if moved is None:

        def moved(i, step):
            return tuple(qj + step * (i == j) for j, qj in enumerate(q))

    columns = []
    for i in range(len(q) if count is None else count):

        def at(multiple, i=i):
            return np.array(function(moved(i, multiple * step)))

        columns.append(
            (45 * (at(1) - at(-1)) - 9 * (at(2) - at(-2)) + (at(3) - at(-3))) / (60 * step),
        )
    return np.array(columns)


def energy_scale(case, q, tensions, load):
    """What rounding of the energy and its derivatives is relative to, per sample [J]."""
    design = case.mechanism.design
    k = max((m.stiffness for m in case.mechanism.members), default=0.0)
    mass = sum(m.mass for m in case.mechanism.members) + getattr(design, "payload", 0.0)
    reach = case.mechanism.reach
    pull = sum(tensions) / 10 if any(m.kind == "cable" for m in case.mechanism.members) else 0.0
    return (
        k * reach**2 / 50 + (mass * getattr(design, "gravity", 0.0) + pull + np.sqrt(sum(f * f for f in load))) * reach
    )


def distance(nodes, member):
    """Between the ends of a member [m]."""
    first, second = (nodes[name] for name in member.nodes)
    return np.sqrt(sum((b - a) ** 2 for a, b in zip(first, second, strict=True)))


def test_every_exported_mechanism_has_a_row():
    exported = {getattr(mechanics, name) for name in mechanics.__all__}
    needed = ("nodes", "members", "potential_energy", "equilibrium")
    found = {
        kind
        for kind in exported
        if isinstance(kind, type) and not getattr(kind, "_is_protocol", False) and all(hasattr(kind, n) for n in needed)
    }
    assert found >= {mechanics.TwoX, mechanics.NX, mechanics.DualTriangle}
    assert found == set(mechanics.MECHANISMS), "MECHANISMS lists the exported mechanisms"
    without = found - {type(case.mechanism) for case in MECHANISMS}
    assert not without, f"no row of mechanism_cases.py for {without}"


@every_mechanism
def test_it_has_all_that_a_mechanism_has(case):
    asked = [name for name in vars(mechanics.Mechanism) if not name.startswith("_")]
    assert len(asked) == 16
    assert [name for name in asked if not hasattr(case.mechanism, name)] == []


@every_mechanism
def test_bars_keep_their_lengths(case):
    q, inputs, _ = case.draw(0, 500)
    nodes, members = case.mechanism.nodes(q, inputs), case.mechanism.members
    bars = [member for member in members if member.is_rigid] + [member for member in members if member.keeps_length]
    lengths = iter(inputs)
    for member in members:
        given = next(lengths) if member.takes_input else None
        if member.kind == "actuator":
            np.testing.assert_allclose(distance(nodes, member), given, rtol=1e-12)
    assert len(bars) == len(case.bar_lengths)
    for bar, length in zip(bars, case.bar_lengths, strict=True):
        np.testing.assert_allclose(distance(nodes, bar), length, rtol=1e-12, atol=1e-14)


@every_mechanism
def test_tip_is_node_p(case):
    m = case.mechanism
    q, inputs, _ = case.draw(1, COUNT)
    np.testing.assert_allclose(m.tip(q, inputs), m.nodes(q, inputs)[case.tip_node], rtol=0, atol=1e-13 * (1 + m.reach))


@every_mechanism
def test_energy_is_that_of_nodes_and_members(case):
    q, tensions, load = case.draw(2, 300)
    expected = node_energy(case.mechanism, q, tensions, load)
    error = abs(case.mechanism.potential_energy(q, tensions, load) - expected)
    assert (error / energy_scale(case, q, tensions, load)).max() < 1e-13
    no_load = tuple(np.zeros((len(load), 300)))
    np.testing.assert_allclose(
        case.mechanism.potential_energy(q, tensions), node_energy(case.mechanism, q, tensions, no_load), rtol=1e-11
    )


@every_mechanism
def test_derivatives_of_the_energy_by_differences(case):
    m = case.mechanism
    q, tensions, load = case.draw(3, COUNT)
    scale = energy_scale(case, q, tensions, load)
    gradient = np.array(m.energy_gradient(q, tensions, load))
    hessian = np.array(m.stiffness_matrix(q, tensions, load))

    def moved(i, step):
        return case.step(q, tensions, i, step)

    by_energy = differences(lambda p: node_energy(m, p, tensions, load), q, moved=moved, count=len(gradient))
    by_gradient = differences(lambda p: m.energy_gradient(p, tensions, load), q, moved=moved, count=len(gradient))
    if case.moved is not None:  # rotations do not commute: the Hessian is the symmetric part
        by_gradient = (by_gradient + by_gradient.swapaxes(0, 1)) / 2
    assert (abs(gradient - by_energy) / scale).max() < 1e-10
    assert (abs(hessian - by_gradient) / scale).max() < 1e-10
    # ... and relative to the derivatives themselves, which are not small anywhere in these samples
    assert (np.linalg.norm(gradient - by_energy, axis=0) / np.linalg.norm(gradient, axis=0)).max() < 1e-7
    assert (np.linalg.norm(hessian - by_gradient, axis=(0, 1)) / np.linalg.norm(hessian, axis=(0, 1))).max() < 1e-7


@rows(lambda case: case.moved is None)
def test_derivatives_of_the_energy_by_autograd(case):
    torch = pytest.importorskip("torch")
    m = case.mechanism
    q, tensions, load = case.draw(4, 5)
    gradient = np.array(m.energy_gradient(q, tensions, load))
    hessian = np.array(m.stiffness_matrix(q, tensions, load))
    for i in range(5):
        inputs = [torch.tensor(float(f[i]), dtype=torch.float64) for f in tensions]
        force = [torch.tensor(float(f[i]), dtype=torch.float64) for f in load]

        def energy(p, inputs=inputs, force=force):
            return node_energy(m, tuple(p), inputs, force)

        point = torch.tensor([float(qi[i]) for qi in q], dtype=torch.float64)
        by_torch = torch.autograd.functional.jacobian(energy, point).numpy()
        np.testing.assert_allclose(gradient[:, i], by_torch, rtol=1e-9, atol=1e-9 * np.linalg.norm(by_torch))
        by_torch = torch.autograd.functional.hessian(energy, point).numpy()
        np.testing.assert_allclose(hessian[:, :, i], by_torch, rtol=1e-8, atol=1e-9 * np.linalg.norm(by_torch))


@rows(lambda case: not case.moves_by_inputs)
def test_jacobian_and_its_determinant(case):
    m = case.mechanism
    q, inputs, load = case.draw(5, COUNT)
    by_tip = differences(m.tip, q).swapaxes(0, 1)
    jacobian = np.array(m.jacobian(q, inputs, load))
    np.testing.assert_array_equal(jacobian, m.jacobian(q))
    assert abs(jacobian - by_tip).max() < 1e-9 * m.reach
    table = np.moveaxis(by_tip, 2, 0)
    sizes = np.linalg.svd(table, compute_uv=False).prod(axis=1)
    expected = np.linalg.det(table) if len(q) == 2 else sizes
    np.testing.assert_allclose(m.jacobian_determinant(q), expected, rtol=1e-7, atol=1e-9 * m.reach**2)


@rows(lambda case: case.moves_by_inputs)
def test_jacobian_by_inputs_follows_equilibria(case):
    m, rng = case.mechanism, np.random.default_rng(9)
    for _ in range(4):
        q, inputs, load = case.settled(rng)
        h, columns = 1e-4 * m.reach, []
        for i in range(len(inputs)):
            tips = []
            for sign in (1, -1):
                ends = tuple(u + sign * h * (i == j) for j, u in enumerate(inputs))
                there = m.equilibrium(ends, q, load)
                assert there.is_stable, there.reason
                tips.append(np.array(m.tip(there.configuration, ends)))
            columns.append((tips[0] - tips[1]) / (2 * h))
        expected = np.array(columns).T
        size = abs(expected).max()
        np.testing.assert_allclose(m.jacobian(q, inputs, load), expected, rtol=0, atol=2e-5 * size)
        determinant = m.jacobian_determinant(q, inputs, load)
        assert determinant == pytest.approx(np.linalg.det(expected), abs=1e-4 * size ** len(inputs))


@rows(lambda case: case.settled is not None or len(case.draw(0, 1)[0]) <= 2)
def test_equilibria_are_balanced_and_told_stable_where_they_are(case):
    m, rng = case.mechanism, np.random.default_rng(10)
    if case.settled is not None:
        start, inputs, load = case.settled(rng)
    else:
        start, inputs, load = (tuple(float(v[0]) for v in part) for part in case.draw(10, 1))
    found = m.equilibria(inputs, load)
    scale = float(np.max(energy_scale(case, start, inputs, load)))
    for state in found:
        there = state.configuration
        assert np.linalg.norm(m.energy_gradient(there, inputs, load)) < 1e-9 * scale
        assert state.residual < 1e-9 * scale
        assert state.is_stable == (m.stability_margin(there, inputs, load) > 0)
    reached = m.equilibrium(inputs, start, load)
    if case.settled is not None:
        assert reached.is_stable
    if reached.is_stable:  # it is one of them, the same pose told with other turns or not
        nodes = np.array(list(m.nodes(reached.configuration, inputs).values()))
        gaps = [abs(np.array(list(m.nodes(s.configuration, inputs).values())) - nodes).max() for s in found]
        assert min(gaps) < 1e-5 * m.reach


@rows(lambda case: case.first is not None)
def test_inverse_kinematics_reach_the_target(case):
    m = case.mechanism
    for i in range(6):
        if case.settled is not None:
            q, inputs, load = case.settled(np.random.default_rng(i))
            extra = (load,)
        else:
            q, inputs, load = (tuple(float(v[i]) for v in part) for part in case.draw(11, 6))
            extra = case.first(q)
        target = tuple(float(part) for part in m.tip(q, inputs))
        found = m.inverse_kinematics(*target, *extra)
        assert isinstance(found, list)
        assert found
        gaps = []
        for solution in found:
            there = solution.configuration
            own = getattr(solution, "lengths", inputs)
            np.testing.assert_allclose(m.tip(there, own), target, rtol=0, atol=1e-7 * m.reach)
            if case.settled is not None:
                assert np.linalg.norm(m.energy_gradient(there, own, load)) < 1e-7 * max(
                    energy_scale(case, q, own, load), 1
                )
            nodes, others = (np.array(list(m.nodes(*pose).values())) for pose in ((there, own), (q, inputs)))
            gaps.append(abs(nodes - others).max())
        assert min(gaps) < 1e-5 * m.reach


@every_mechanism
def test_signs_of_margins(case):
    m = case.mechanism
    q, inputs, load = case.draw(12, 200)
    hessian = np.moveaxis(
        np.array(np.broadcast_arrays(*(e for r in m.stiffness_matrix(q, inputs, load) for e in r))), 0, -1
    )
    n = round(hessian.shape[-1] ** 0.5)
    smallest = np.linalg.eigvalsh(hessian.reshape(-1, n, n))[:, 0]
    clear = abs(smallest) > 1e-9 * abs(hessian).max(axis=-1)
    np.testing.assert_array_equal((m.stability_margin(q, inputs, load) > 0)[clear], (smallest > 0)[clear])
    if case.is_feasible is not None:
        expected = case.is_feasible(q, inputs, load)
        assert case.settled is None or 0 < np.count_nonzero(expected) < len(expected)  # both signs are seen
        np.testing.assert_array_equal(np.asarray(m.wrench_margin(q, inputs, load)) > 0, expected)


@rows(lambda case: case.moved is None)
def test_stiffness_is_symmetric_and_one_evaluation_gives_what_two_give(case):
    q, tensions, load = case.draw(6, COUNT)
    gradient, hessian = case.mechanism.statics(q, tensions, load)
    np.testing.assert_array_equal(hessian, np.swapaxes(np.array(hessian), 0, 1))
    np.testing.assert_array_equal(gradient, case.mechanism.energy_gradient(q, tensions, load))
    np.testing.assert_array_equal(hessian, case.mechanism.stiffness_matrix(q, tensions, load))


def quantities(m, q, tensions, load):
    """Every quantity of a mechanism as a flat list of components."""
    values = [*m.tip(q, tensions), *(entry for row in m.jacobian(q, tensions, load) for entry in row)]
    values += [m.jacobian_determinant(q, tensions, load)]
    values += [coordinate + 0.0 * q[0] for node in m.nodes(q, tensions).values() for coordinate in node]
    values += [m.potential_energy(q, tensions, load), *m.energy_gradient(q, tensions, load)]
    values += [entry for row in m.stiffness_matrix(q, tensions, load) for entry in row]
    values += [m.stability_margin(q, tensions, load), m.wrench_margin(q, tensions, load)]
    if not isinstance(m, mechanics.PlanarFourBar):
        values += [m.stability_margin(q, None, load), m.wrench_margin(q, None, load)]
    if hasattr(m, "stiffest_tensions"):
        values += m.stiffest_tensions(q, load)
    if hasattr(m, "control"):
        values += [*m.control(q), *m.control(q, load), *m.spring_forces(q, tensions), m.limit_margin(q)]
        values += [m.chain[0].sensitivity(q[0], load[0]), m.free_length_margin(tensions)]
    return values


@every_mechanism
def test_floats_arrays_and_tensors_agree(case):
    torch = pytest.importorskip("torch")
    m = case.mechanism
    q, tensions, load = case.draw(7, 5)
    arrays = quantities(m, q, tensions, load)
    tensors = quantities(m, *(tuple(torch.tensor(v) for v in values) for values in (q, tensions, load)))
    assert all(value.dtype == torch.float64 for value in tensors)
    for i in range(5):
        floats = quantities(m, *(tuple(float(v[i]) for v in values) for values in (q, tensions, load)))
        assert all(type(value) is float for value in floats)
        for number, array, tensor in zip(floats, arrays, tensors, strict=True):
            tolerance = 1e-11 * (1 + abs(number))
            assert abs(number - array[i]) < tolerance
            assert abs(number - float(tensor[i])) < tolerance


@rows(lambda case: case.inputs_of is None)
def test_shapes_broadcast(case):
    m = case.mechanism
    q, tensions, load = case.draw(8, 3)
    column = tuple(component[:, None] for component in q)
    row = tuple(component[None, :2] for component in tensions)
    for values in (m.energy_gradient(column, row), *m.stiffness_matrix(column, row)):
        for entry in values:
            assert np.broadcast_to(entry, (3, 2)).shape == (3, 2)
    energy = m.potential_energy(column, row)
    assert energy.shape == (3, 2)
    one = m.potential_energy(tuple(component[2] for component in q), tuple(component[1] for component in tensions))
    assert energy[2, 1] == pytest.approx(one, rel=1e-13)
    assert np.shape(m.potential_energy(column, row, (load[0][0], 0.0))) == (3, 2)
