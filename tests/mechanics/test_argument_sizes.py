"""A law over all public methods of all mechanisms: an argument of the wrong size, or of two kinds, is refused."""

import inspect
from typing import Any

import numpy as np
import pytest

from tensegrity_envs import mechanics
from tensegrity_envs.mechanics import (
    MURALIDHARAN2022,
    NX,
    DualTriangle,
    DualTriangleSegment,
    NXDesign,
    PlanarFourBar,
    SpatialPrism,
    TwoX,
)

MECHANISMS = [
    TwoX(),
    NX(NXDesign.from_two_x(MURALIDHARAN2022, 3)),
    DualTriangle(segments=3),
    DualTriangle(segments=4),
    DualTriangleSegment(),
    PlanarFourBar(),
    SpatialPrism(),
]
NOT_A_SEQUENCE_OF_COMPONENTS = {
    "components": "Chain.namespace takes any number of components",
    "joints": "of `Chain.joints`, which checks q",
    "wrist": "of `DualTriangle.wrist`, which checks target and first",
    "springs": "of `DualTriangleSegment.springs`",
    "members": "no number",
}


def sizes(mechanism: Any) -> dict[str, int]:
    """How many numbers an argument takes."""
    if isinstance(mechanism, SpatialPrism):
        return dict(q=6, start=6, w=3, position=3, lengths=3, wrench=3, force=3, direction=3)
    common = dict(load=2, direction=2, target=2)
    if isinstance(mechanism, PlanarFourBar):
        return common | dict(q=2, start=2, lengths=2)
    if isinstance(mechanism, DualTriangleSegment):
        return common | dict(free_lengths=2)
    n = mechanism.degrees_of_freedom
    if isinstance(mechanism, DualTriangle):
        return common | dict(q=n, start=n, delta=n, common=n, free_lengths=2 * n, inputs=2 * n, first=n - 2)
    return common | dict(q=n, start=n, u=n, tensions=2 * n, inputs=2 * n)


def takes_several(parameter: inspect.Parameter) -> bool:
    """Whether a parameter is a sequence, of which the annotation tells."""
    text = str(parameter.annotation)
    return "Sequence" in text or "tuple" in text or parameter.kind is parameter.VAR_POSITIONAL


def arguments() -> list[Any]:
    """Each mechanism, method and parameter that takes a sequence."""
    rows = []
    for mechanism in MECHANISMS:
        for name, method in inspect.getmembers(type(mechanism), inspect.isroutine):
            if name.startswith("_"):
                continue
            for parameter in inspect.signature(method).parameters.values():
                if takes_several(parameter) and parameter.name not in NOT_A_SEQUENCE_OF_COMPONENTS:
                    size = f"{mechanism.segments} " if isinstance(mechanism, DualTriangle) else ""
                    row = f"{type(mechanism).__name__} {size}{name} {parameter.name}"
                    rows.append(pytest.param(mechanism, name, parameter.name, id=row))
    return rows


def call(mechanism: Any, name: str, wrong: str, value: tuple) -> Any:
    """Call a method with numbers of the right size but for one argument."""
    known = sizes(mechanism)
    positional, keywords = [], {}
    for parameter in inspect.signature(getattr(mechanism, name)).parameters.values():
        right: Any = 0.3
        if takes_several(parameter):
            right = (0.3,) * known.get(parameter.name, 1)
        given = value if parameter.name == wrong else right
        if parameter.kind is parameter.VAR_POSITIONAL:
            positional = [*keywords.values(), *given]
            keywords = {}
        elif parameter.name == wrong or parameter.default is parameter.empty:
            keywords[parameter.name] = given
    return getattr(mechanism, name)(*positional, **keywords)


def test_every_exported_mechanism_is_looked_at():
    exported = [getattr(mechanics, name) for name in mechanics.__all__]
    classes = {kind for kind in exported if hasattr(kind, "potential_energy") and kind is not mechanics.Mechanism}
    assert classes == {type(mechanism) for mechanism in MECHANISMS}
    assert len(arguments()) > 250


@pytest.mark.parametrize(("mechanism", "name", "argument"), arguments())
def test_a_wrong_size_is_refused_by_name(mechanism, name, argument):
    right = sizes(mechanism)[argument]
    wrong = [right - 1, right + 1]
    if argument == "wrench":
        wrong = [2, 4, 5, 7]
    if argument == "load" and isinstance(mechanism, DualTriangle):
        wrong = [1, 4]  # three with a torque
    for count in wrong:
        with pytest.raises(ValueError, match=rf"^{argument}: {count} numbers?, must be {right}"):
            call(mechanism, name, argument, (0.3,) * count)


@pytest.mark.parametrize(("mechanism", "name", "argument"), arguments())
def test_arrays_with_tensors_are_refused(mechanism, name, argument):
    torch = pytest.importorskip("torch")
    right = sizes(mechanism)[argument]
    if right < 2 or argument == "common":
        return
    value = (np.array([0.3, 0.2]), *(torch.tensor([0.3, 0.2]),) * (right - 1))
    with pytest.raises(TypeError, match="convert"):
        call(mechanism, name, argument, value)


def test_one_number_for_several_is_refused():
    with pytest.raises(TypeError, match=r"^q = 0\.3: must be 2: alpha_1, alpha_2"):
        TwoX().tip(0.3)


def test_the_message_names_the_numbers():
    with pytest.raises(ValueError, match=r"^q: 7 numbers, must be 6: x, y, z, w1, w2, w3$"):
        SpatialPrism().tip((0.1,) * 7)


def test_floats_with_tensors_and_floats_with_arrays_work():
    torch = pytest.importorskip("torch")
    tensor = torch.tensor([0.3, -0.2], dtype=torch.float64)
    by_tensor = TwoX().energy_gradient((tensor, tensor), (10.0, 20.0, tensor, 30.0), (1.0, tensor))
    array = tensor.numpy()
    by_array = TwoX().energy_gradient((array, array), (10.0, 20.0, array, 30.0), (1.0, array))
    np.testing.assert_allclose(np.array(by_tensor), np.array(by_array), rtol=1e-13)


def test_signatures_and_documentation_stay():
    assert list(inspect.signature(TwoX.tip).parameters)[:2] == ["self", "q"]
    assert TwoX.tip.__doc__.startswith("Tip position")
