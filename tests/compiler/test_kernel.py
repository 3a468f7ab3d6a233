"""Compiled component code gives what the same code gives on floats and arrays."""

import copy
import pickle
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tensegrity_envs.compiler.kernel import Kernel, evaluate
from tensegrity_envs.compiler.namespace import namespace_of, to_single
from tensegrity_envs.compiler.pytree import Schema, tree_leaves
from tensegrity_envs.mechanics import MURALIDHARAN2022, DualTriangle, TwoX
from tensegrity_envs.mechanics.equilibrium import continuation
from tensegrity_envs.mechanics.polynomials import real_roots


def everything(x, y):
    """Every operation that component code may use."""
    xp = namespace_of(x, y)
    positive = abs(x) + 1.5
    return {
        "arithmetic": (x + y - 2.5 * x / positive, -x * 3 + 1 - y**2 + positive**0.5),
        "functions": (xp.sin(x), xp.cos(y), xp.sqrt(positive), xp.log(positive), xp.atan2(x, y), xp.hypot(x, y)),
        "choice": xp.where((x > y) & ~(x > 1) | (y >= 2), xp.minimum(x, y), xp.maximum(x, 0.25)),
        "conditions": (x <= y, x != y),
        # What is known before a call that others wait for, and used after it
        "later": xp.where(x > y, xp.atan2(xp.sin(xp.atan2(x, positive)), y), 2.0),
        "code": xp.where((xp.atan2(x, y) > 0) & (x < 1), xp.where(x > y, 3, 4), 0) + 0.0,
        "single": (to_single(x), to_single(x) * to_single(y) - to_single(x)),
        "constant": 7.5,
    }


@settings(max_examples=60, deadline=None)
@example(x=-0.0, y=-1.0)
@given(x=st.floats(-1e3, 1e3), y=st.floats(-1e3, 1e3))
def test_compiled_operations_are_those_of_floats(x, y):
    compiled, plain = evaluate(everything, x, y), everything(x, y)

    def is_number(value):
        return isinstance(value, float | bool)

    for one, other in zip(tree_leaves(compiled, is_number), tree_leaves(plain, is_number), strict=True):
        assert type(one) is type(other)
        assert one == pytest.approx(other, rel=1e-14, abs=1e-14)


def test_batches_broadcast_and_keep_their_kinds():
    x = np.linspace(-2, 2, 7)
    found = evaluate(everything, x, 0.5)
    assert found["conditions"][0].dtype == bool
    np.testing.assert_allclose(found["choice"], everything(x, np.full(7, 0.5))["choice"], atol=1e-15)
    with pytest.raises(ValueError, match="shape"):
        evaluate(everything, np.zeros((2, 3)), 0.5)


def test_one_column_gives_what_many_give_to_the_last_bit():
    """Whatever its neighbours: some of them are followed to the end at once, some in sub-steps, some lose stability."""
    rng = np.random.default_rng(0)

    def both(x, y, c):
        return everything(x, y), falling(c)

    given = [
        rng.uniform(-3, 3, 40),
        rng.uniform(-3, 3, 40),
        np.concatenate([rng.uniform(0.01, 9, 36), [-1.0, 0.0, 1e-9, 1e9]]),
    ]
    alone = [evaluate(both, *column) for column in np.stack(given, axis=1).tolist()]
    for count in (2, 7, 8, 9, 16, 17, 31, 40):
        many = list(tree_leaves(evaluate(both, *(values[:count] for values in given)), is_array))
        for i in range(count):
            one = list(tree_leaves(alone[i], lambda value: isinstance(value, float | bool | int)))
            np.testing.assert_array_equal(np.array([value[i] for value in many]), np.array([float(v) for v in one]))


def falling(c):
    """The minimum of x^3 / 3 - c(t) x, which ends where c(t) passes zero."""

    def path(q, t):
        return (q[0] ** 2 - (c - t * (c + 1.0)),), ((2 * q[0],),)

    return continuation(path, (namespace_of(c).sqrt(namespace_of(c).maximum(c, 0.0)),))


@pytest.mark.parametrize(
    ("arm", "inputs"),
    [
        (TwoX(replace(MURALIDHARAN2022, payload=np.linspace(0, 0.4, 50))), 4),
        (DualTriangle(), 6),
    ],
    ids=["two-x", "dual-triangle"],
)
def test_compiled_statics_are_those_of_arrays(arm, inputs):
    rng = np.random.default_rng(0)
    q = tuple(rng.uniform(-1.4, 1.4, (arm.degrees_of_freedom, 50)))
    forces = tuple(rng.uniform(0.01, 0.09, (inputs, 50)))
    expected = arm.statics(q, forces)
    found = evaluate(_statics, arm.design, q, forces)
    for one, other in zip(tree_leaves(found, is_array), tree_leaves(expected, is_array), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


def is_array(value):
    return isinstance(value, np.ndarray)


def _statics(design, q, forces):
    return (TwoX if len(q) == 2 else DualTriangle)(design).statics(q, forces)


def test_branching_on_a_value_and_following_outside_of_a_trace_are_explained():
    with pytest.raises(TypeError, match=r"xp\.where"):
        evaluate(lambda x: 1.0 if x > 0 else 2.0, 0.5)
    with pytest.raises(TypeError, match="evaluate"):
        continuation(lambda q, t: ((q[0],), ((1.0,),)), (0.5,))


def test_a_path_of_known_solution_is_followed():
    """The minimum of cosh(x) - a(t) x, x = asinh(a); and one that ends."""

    def growing(a):
        def path(q, t):
            x = q[0]
            xp = namespace_of(x)
            # sinh and cosh by their series: component code has no exponential
            sinh = x + x**2 * x / 6 + x**2 * x**2 * x / 120 + x**2 * x**2 * x**2 * x / 5040
            cosh = 1 + x**2 / 2 + x**2 * x**2 / 24 + x**2 * x**2 * x**2 / 720
            return (sinh - t * a + 0 * xp.sin(x),), ((cosh,),)

        return continuation(path, (0.0 * a,))

    (x,), fraction = evaluate(growing, np.array([0.5, 1.0, 1.5]))
    np.testing.assert_allclose(x, np.arcsinh([0.5, 1.0, 1.5]), atol=2e-4)
    assert (fraction == 1).all()

    (x,), fraction = evaluate(falling, np.array([0.25, 1.0, 4.0]))
    np.testing.assert_allclose(fraction, np.array([0.25, 1.0, 4.0]) / np.array([1.25, 2.0, 5.0]), atol=2e-3)
    assert (x > 0).all()


@settings(max_examples=50, deadline=None)
@given(roots=st.lists(st.floats(-5, 5), min_size=8, max_size=8), seed=st.integers(0, 99))
def test_real_roots_are_found(roots, seed):
    """Four real roots at least 0.1 apart and four complex ones away from the axis."""
    real = np.unique(np.round(np.array(roots[:4]), 1))
    pairs = np.array(roots[4:6]) + 1j * (0.5 + np.abs(roots[6:8]))
    wanted = np.concatenate([real, pairs, pairs.conj()])
    polynomial = np.real(np.poly(wanted))[::-1] * (1 + seed)
    owner, found = real_roots(polynomial[None])
    assert (owner == 0).all()
    near = np.abs(found[:, None] - real).min(axis=0)
    assert near.max(initial=0.0) < 1e-5
    verified = [
        x for x in found if abs(np.polyval(polynomial[::-1], x)) < 1e-6 * np.polyval(np.abs(polynomial[::-1]), abs(x))
    ]
    assert all(np.abs(x - real).min() < 1e-2 for x in verified)


def test_a_layout_packs_and_unpacks():
    tree = {"a": (np.arange(3.0), np.array([True, False, True])), "b": [np.array([1, 2, 3])], "c": "kept"}
    schema = Schema(tree)
    matrix = schema.pack(tree, 3)
    assert matrix.shape == (3, 3)
    back = schema.unpack(matrix)
    assert back["c"] == "kept"
    assert back["a"][1].dtype == bool
    np.testing.assert_array_equal(back["b"][0], tree["b"][0])
    one = schema.unpack(matrix[:, 1])
    assert one == {"a": (1.0, False), "b": [2], "c": "kept"}
    with pytest.raises(ValueError, match="expected"):
        schema.pack({"a": (np.arange(3.0),)}, 3)


def test_kernels_survive_copies_and_pickles(tmp_path):
    """Machine code does not: another process finds it on disk or makes it anew."""
    kernel = Kernel(lambda x: (x[0] * 2.5, namespace_of(x[0]).sin(x[1])), Schema((np.zeros(1), np.zeros(1))))
    x = np.arange(6.0).reshape(2, 3)
    assert copy.deepcopy(kernel) is kernel
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(kernel))(x), kernel(x))
    file = tmp_path / "kernel.pickle"
    file.write_bytes(pickle.dumps(kernel))
    code = f"import pickle, numpy as np; print(pickle.load(open({str(file)!r}, 'rb'))(np.arange(6.0).reshape(2, 3))[0])"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[0.  2.5 5. ]"
