"""The options that all environments share: in every signature, in every help, in every message."""

import dataclasses
import inspect
import pydoc

import pytest

from tensegrity_envs.environments import ARMS, NXReach, TwoXReach, core_of
from tensegrity_envs.options import OPTION_NAMES, QUASI_STATIC, Options, described

every_core = pytest.mark.parametrize("core", ARMS.values(), ids=lambda core: core.__name__)


@every_core
def test_signature_and_help_show_every_option(core):
    names = list(inspect.signature(core).parameters)
    assert set(core.shared) <= set(names)
    assert core.shared in (OPTION_NAMES, QUASI_STATIC)
    text = pydoc.render_doc(core, renderer=pydoc.plaintext)
    described_here = described(core, "Args")
    assert set(described_here) == set(names)
    for name in names:
        assert f"{name}: " in text
        assert described_here[name]


@every_core
def test_a_misspelt_option_is_told_with_what_there_is(core):
    for make in (core, lambda **options: core_of(core.__name__, options)):
        with pytest.raises(TypeError, match=r"did you mean 'tolerance'\?\); there are .*reward_weights"):
            make(tolerence=0.1)


@pytest.mark.parametrize(
    ("core", "name", "others"),
    [
        (TwoXReach, "obstacles", "arm='TwoXObstacleReach'"),
        (NXReach, "obstacles", "arm='NXObstacleReach'"),
        (ARMS["DualTriangleReach"], "obstacles", "arm='DualTriangleObstacleReach'"),
        (NXReach, "direction", "arm='NXStiffnessReach'"),
    ],
)
def test_who_has_an_option_is_told(core, name, others):
    with pytest.raises(TypeError, match=rf"unexpected keyword argument '{name}' \(it is an option of {others}\)"):
        core_of(core, {name: 1})


def test_every_shared_option_is_described_once():
    assert tuple(described(Options)) == OPTION_NAMES == tuple(field.name for field in dataclasses.fields(Options))


def test_options_that_contradict_each_other_are_refused():
    with pytest.raises(ValueError, match="dynamics: needs backend = 'mujoco'"):
        TwoXReach(dynamics={"joint_damping": 1.0})
    with pytest.raises(ValueError, match="backend = 'pybullet': must be 'quasi_static' or 'mujoco'"):
        TwoXReach(backend="pybullet")


def test_a_subclass_may_hand_options_on_or_not():
    class Handing(TwoXReach):
        """With an option of its own."""

        def __init__(self, colour="blue", **further):
            super().__init__(**further)
            self.colour = colour

    class Closed(TwoXReach):
        """Without options."""

        def __init__(self):
            super().__init__(tolerance=0.01)

    core = core_of(Handing, {"colour": "red", "control": "tension", "tolerance": 0.02})
    assert (core.colour, core.control, core.task.tolerance) == ("red", "tension", 0.02)
    assert core_of(Closed, {}).task.tolerance == 0.01
    with pytest.raises(TypeError, match="unexpected keyword argument 'tolerance'"):
        core_of(Closed, {"tolerance": 0.1})


def test_a_mixin_before_the_parent_does_not_hide_its_options():
    class Mixin:
        """Without a constructor."""

    class Mixed(Mixin, TwoXReach):
        """With an option of its own."""

        def __init__(self, colour="blue", **further):
            super().__init__(**further)

    assert {"colour", "control", "tolerance"} <= set(inspect.signature(Mixed).parameters)
    assert core_of(Mixed, {"control": "tension"}).control == "tension"


def test_an_inherited_constructor_is_told_with_what_it_hands_on():
    """That of a mixin before the parent, which takes more than the mixin says, described as the parent has it."""

    class Mixin(TwoXReach):
        """What some arms share.

        Args:
            colour: of the bars.
        """

        def __init__(self, colour="blue", **further):
            super().__init__(**further)
            self.colour = colour

    class Mixed(Mixin, NXReach):
        """Without a constructor of its own."""

    class Plain(NXReach):
        """Without anything."""

    for core, first in ((Mixed, ["colour"]), (Plain, [])):
        assert list(inspect.signature(core).parameters) == [*first, *inspect.signature(NXReach).parameters]
        told, known = described(core, "Args"), described(NXReach, "Args")
        assert told == {**{name: "of the bars." for name in first}, **known}
    assert core_of(Mixed, {"colour": "red", "tolerance": 0.02}).colour == "red"
