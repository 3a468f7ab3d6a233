"""Laws that hold for every mechanism, checked by other routes than its closed forms: nodes, differences, autograd."""

import numpy as np
import pytest
from mechanism_cases import MECHANISMS, node_energy

import law_rows

COUNT = 40
every_mechanism = pytest.mark.parametrize("case", law_rows.cases(MECHANISMS), ids=lambda case: case.name)


def differences(function, q, step=2e-3):
    """First derivatives of a function of configurations by central differences of sixth order."""
    columns = []
    for i in range(len(q)):

        def at(multiple, i=i):
            return np.array(function(tuple(qj + multiple * step * (i == j) for j, qj in enumerate(q))))

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
    return k * reach**2 / 50 + (mass * getattr(design, "gravity", 0.0) + pull + np.hypot(*load)) * reach


@every_mechanism
def test_bars_keep_their_lengths(case):
    q, _, _ = case.draw(0, 500)
    nodes = case.mechanism.nodes(q)
    bars = [member for member in case.mechanism.members if member.kind == "bar"]
    assert len(bars) == len(case.bar_lengths)
    for bar, length in zip(bars, case.bar_lengths, strict=True):
        (x1, y1), (x2, y2) = (nodes[name] for name in bar.nodes)
        np.testing.assert_allclose(np.hypot(x2 - x1, y2 - y1), length, rtol=1e-12, atol=1e-14)


@every_mechanism
def test_tip_is_node_p(case):
    q, _, _ = case.draw(1, COUNT)
    np.testing.assert_allclose(case.mechanism.tip(q), case.mechanism.nodes(q)["P"], rtol=0, atol=1e-13)


@every_mechanism
def test_energy_is_that_of_nodes_and_members(case):
    q, tensions, load = case.draw(2, 300)
    expected = node_energy(case.mechanism, q, tensions, load)
    error = abs(case.mechanism.potential_energy(q, tensions, load) - expected)
    assert (error / energy_scale(case, q, tensions, load)).max() < 1e-13
    no_load = (np.zeros(300), np.zeros(300))
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
    by_energy = differences(lambda p: node_energy(m, p, tensions, load), q)
    by_gradient = differences(lambda p: m.energy_gradient(p, tensions, load), q)
    assert (abs(gradient - by_energy) / scale).max() < 1e-10
    assert (abs(hessian - by_gradient) / scale).max() < 1e-10
    # ... and relative to the derivatives themselves, which are not small anywhere in these samples
    assert (np.linalg.norm(gradient - by_energy, axis=0) / np.linalg.norm(gradient, axis=0)).max() < 1e-7
    assert (np.linalg.norm(hessian - by_gradient, axis=(0, 1)) / np.linalg.norm(hessian, axis=(0, 1))).max() < 1e-7


@every_mechanism
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


@every_mechanism
def test_jacobian_and_its_determinant(case):
    m = case.mechanism
    q, _, _ = case.draw(5, COUNT)
    by_tip = differences(m.tip, q).swapaxes(0, 1)
    jacobian = np.array(m.jacobian(q))
    assert abs(jacobian - by_tip).max() < 1e-9 * m.reach
    table = np.moveaxis(by_tip, 2, 0)
    sizes = np.linalg.svd(table, compute_uv=False).prod(axis=1)
    expected = np.linalg.det(table) if len(q) == 2 else sizes
    np.testing.assert_allclose(m.jacobian_determinant(q), expected, rtol=1e-7, atol=1e-9 * m.reach**2)


@every_mechanism
def test_stiffness_is_symmetric_and_one_evaluation_gives_what_two_give(case):
    q, tensions, load = case.draw(6, COUNT)
    gradient, hessian = case.mechanism.statics(q, tensions, load)
    np.testing.assert_array_equal(hessian, np.swapaxes(np.array(hessian), 0, 1))
    np.testing.assert_array_equal(gradient, case.mechanism.energy_gradient(q, tensions, load))
    np.testing.assert_array_equal(hessian, case.mechanism.stiffness_matrix(q, tensions, load))


def quantities(m, q, tensions, load):
    """Every quantity of a mechanism as a flat list of components."""
    values = [*m.tip(q), *(entry for row in m.jacobian(q) for entry in row), m.jacobian_determinant(q)]
    values += [coordinate for node in m.nodes(q).values() for coordinate in node]
    values += [m.potential_energy(q, tensions, load), *m.energy_gradient(q, tensions, load)]
    values += [entry for row in m.stiffness_matrix(q, tensions, load) for entry in row]
    values += [m.stability_margin(q, tensions, load), m.stability_margin(q, load=load)]
    if hasattr(m, "wrench_margin"):
        values += [m.wrench_margin(q, tensions, load), m.wrench_margin(q, load=load)]
    if hasattr(m, "stiffest_tensions"):
        values += m.stiffest_tensions(q, load)
    if hasattr(m, "control"):
        values += [*m.control(q), *m.control(q, load), *m.spring_forces(q, tensions), m.limit_margin(q)]
        values += [m.segment.sensitivity(q[0], load[0]), m.free_length_margin(tensions)]
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


@every_mechanism
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
