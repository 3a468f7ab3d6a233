"""Component code as JavaScript gives in a browser what it gives on Python's floats."""

import json
import math

import numpy as np
import pytest

from tensegrity_envs.compiler.javascript import function
from tensegrity_envs.compiler.namespace import namespace_of, to_single
from tensegrity_envs.compiler.pytree import tree_leaves
from tensegrity_envs.mechanics import MURALIDHARAN2022, TwoX
from tensegrity_envs.mechanics.equilibrium import continuation

VARIES = np.zeros(1)
PAGE = "<!DOCTYPE html><html><head><script>{}</script></head><body></body></html>"


def everything(x, y):
    """Every operation that component code may use."""
    xp = namespace_of(x, y)
    positive = abs(x) + 1.5
    return {
        "arithmetic": (x + y - 2.5 * x / positive, -x * 3 + 1 - y**2 + positive**0.5, 2.0 - -3.0 * x, positive**1.5),
        "functions": (xp.sin(x), xp.cos(y), xp.sqrt(positive), xp.log(positive), xp.atan2(x, y), xp.hypot(x, y)),
        "choice": xp.where((x > y) & ~(x > 1) | (y >= 2), xp.minimum(x, y), xp.maximum(x, 0.25)),
        "conditions": (x <= y, x != y, xp.isfinite(x / 2)),
        "single": to_single(x) * to_single(y),
        "constants": (7.5, -0.25, 3),
    }


def is_number(value):
    return isinstance(value, float | bool | int)


def in_order(tree):
    return [float(value) for value in tree_leaves(tree, is_number)]


def test_operations_are_those_of_floats(in_browser):
    rng = np.random.default_rng(0)
    points = [[-0.0, -1.0], [0.0, 0.0], *np.round(rng.normal(0, 3, (200, 2)), 3).tolist()]
    page = PAGE.format(function("everything", everything, x=VARIES, y=VARIES))
    found = in_browser(page, f"return {json.dumps(points)}.map(p => everything(...p));")
    for (x, y), one in zip(points, found, strict=True):
        np.testing.assert_allclose(in_order(one), in_order(everything(x, y)), rtol=1e-14, atol=1e-14)
        assert [type(v) for v in one["conditions"]] == [bool] * 3


def test_designs_and_named_tuples_are_objects_with_their_fields(in_browser):
    design = {"b": 0.05, "l": VARIES}

    def tip(design, q):
        changed = object.__new__(type(MURALIDHARAN2022))
        vars(changed).update(vars(MURALIDHARAN2022) | design)
        return {"joint": TwoX(changed)._joint(namespace_of(*q), q[0]), "tip": TwoX(changed).tip(q)}

    code = function("tip", tip, design=design, q=(VARIES, VARIES))
    assert code.startswith("function tip(design, q) {")
    assert "payload" not in code
    found = in_browser(PAGE.format(code), "return tip({l: 0.11}, [0.3, -0.8]);")
    expected = tip({"b": 0.05, "l": 0.11}, (0.3, -0.8))
    assert found["tip"] == pytest.approx(expected["tip"], rel=1e-14)
    assert found["joint"] == pytest.approx(expected["joint"]._asdict(), rel=1e-14)


def test_only_what_results_need_is_written():
    code = function("f", lambda x: (math.pi * x, namespace_of(x).sin(x))[0], x=VARIES)
    assert "sin" not in code
    assert "3.141592653589793 * x" in code


def test_what_cannot_be_written_is_refused():
    with pytest.raises(ValueError, match="name in JavaScript"):
        function("a b", abs, x=VARIES)
    with pytest.raises(ValueError, match="path of equilibria"):
        function("f", lambda x: continuation(lambda q, t: ((q[0] - t * x,), ((1.0,),)), (x,)), x=VARIES)
    with pytest.raises(TypeError, match=r"xp\.where"):
        function("f", lambda x: 1.0 if x > 0 else 2.0, x=VARIES)
