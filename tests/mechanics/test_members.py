"""Kinds of members, on an arm of two links with torsional springs at its joints, which no mechanism of ours has."""

import math

import numpy as np
import pytest

from tensegrity_envs.mechanics import MECHANISMS
from tensegrity_envs.mechanics.design import KINDS, Member
from tensegrity_envs.mechanics.members import angle_of, energy_of_members

K1, K2, PULL = 3.0, 2.0, 1.5


class TwoLinks:
    """A strut, a bar, torsional springs at their joints, and a cable from the ground to the tip."""

    members = (
        Member("strut", "strut", ("O", "E"), mass=0.4, radius=0.01),
        Member("bar", "bar", ("E", "P"), mass=0.2, radius=0.01),
        Member("lower", "torsional spring", ("X", "E"), stiffness=K1, pivot="O", free_angle=0.3),
        Member("upper", "torsional spring", ("O", "P"), stiffness=K2, pivot="E", free_angle=math.pi - 0.5),
        Member("cable", "cable", ("X", "P")),
    )

    def nodes(self, q):
        e = 0.5 * np.cos(q[0]), 0.5 * np.sin(q[0])
        p = e[0] + 0.3 * np.cos(q[0] + q[1]), e[1] + 0.3 * np.sin(q[0] + q[1])
        return {"O": (0.0, 0.0), "X": (1.0, 0.0), "E": e, "P": p}


def test_energy_of_every_kind_in_closed_form():
    arm, rng = TwoLinks(), np.random.default_rng(0)
    for q in rng.uniform(0.1, 1.2, (20, 2)):
        nodes = arm.nodes(q)
        # The first link stands behind the elbow: from it to the second one it is pi + q2, told in (-pi, pi].
        elbow = math.remainder(math.pi + q[1], 2 * math.pi)
        expected = K1 / 2 * (q[0] - 0.3) ** 2 + K2 / 2 * (elbow - math.pi + 0.5) ** 2
        expected += 9.81 * (0.4 * nodes["E"][1] / 2 + 0.2 * (nodes["E"][1] + nodes["P"][1]) / 2)
        expected += PULL * math.dist(nodes["X"], nodes["P"])
        assert energy_of_members(arm.members, nodes, (PULL,), 9.81) == pytest.approx(expected, rel=1e-13)
        assert angle_of(arm.members[2], nodes) == pytest.approx(q[0], abs=1e-14)


def test_bad_members_are_named():
    nodes = TwoLinks().nodes((0.2, 0.3))
    with pytest.raises(ValueError, match="one of 'bar', 'strut'"):
        Member("a", "rope", ("O", "P"))
    with pytest.raises(ValueError, match="pivot"):
        Member("a", "torsional spring", ("O", "P"))
    with pytest.raises(ValueError, match="pivot"):
        Member("a", "bar", ("O", "P"), pivot="E")
    with pytest.raises(ValueError, match="1 numbers expected"):
        energy_of_members(TwoLinks.members, nodes, (), 9.81)
    with pytest.raises(ValueError, match="no angle"):
        angle_of(TwoLinks.members[0], nodes)
    with pytest.raises(ValueError, match="3 coordinates"):
        angle_of(TwoLinks.members[2], {name: (*place, 0.0) for name, place in nodes.items()})


@pytest.mark.parametrize("kind", MECHANISMS, ids=lambda kind: kind.__name__)
def test_members_take_as_many_inputs_as_there_are(kind):
    from mechanism_cases import MECHANISMS as CASES

    mechanism = next((case.mechanism for case in CASES if type(case.mechanism) is kind), None) or kind()
    assert sum(member.takes_input for member in mechanism.members) == len(mechanism.input_names)
    assert {member.kind for member in mechanism.members} <= set(KINDS)


def test_mujoco_says_what_it_cannot_build():
    pytest.importorskip("mujoco")
    from tensegrity_envs.simulation.mujoco.building import build

    arm = TwoLinks()
    arm.design = None
    with pytest.raises(ValueError, match="lower: MuJoCo models are built of bars"):
        build(arm, None, None)
