"""The energy that members store, from the positions of their nodes alone: generic over all kinds of members."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from tensegrity_envs.compiler.namespace import Component, namespace_of
from tensegrity_envs.mechanics.design import Member


def energy_of_members(
    members: Iterable[Member], nodes: Mapping[str, Any], inputs: Sequence[Component], gravity: Component = 0.0
) -> Component:
    """Energy of springs, of tensions (tension times length) and of the members' weights [J].

    Bars, struts, prismatic actuators and edges of rigid bodies keep their lengths while the inputs are kept: they store
    none but that of their weight.

    Args:
        members: in the mechanism's order, in which they take the inputs.
        nodes: positions by name [m], (x, y) or (x, y, z); the last coordinate points up.
        inputs: as the mechanism takes them.
        gravity: [m/s2].

    Raises:
        ValueError: there are too few or too many inputs, or a torsional spring's nodes are not in a plane.
    """
    members = tuple(members)
    wanted = sum(member.takes_input for member in members)
    if len(inputs) != wanted:
        raise ValueError(f"inputs: {wanted} numbers expected, one for each member that takes one, got {len(inputs)}")
    left = iter(inputs)
    energy: Component = 0.0
    for member in members:
        given = next(left) if member.takes_input else None
        if member.is_rigid:
            energy = energy + member.mass * gravity * _height(member, nodes)
        elif member.kind == "spring":
            stretch = _length(member, nodes) - (member.free_length if given is None else given)
            if member.goes_slack:
                stretch = (stretch + abs(stretch)) / 2
            energy = energy + member.stiffness * stretch**2 / 2
        elif member.kind == "torsional spring":
            turn = angle_of(member, nodes) - member.free_angle
            energy = energy + member.stiffness * turn**2 / 2
        elif member.kind == "cable" and given is not None:
            energy = energy + given * _length(member, nodes)
    return energy


def angle_of(member: Member, nodes: Mapping[str, Any]) -> Component:
    """The angle of a torsional spring [rad], in (-pi, pi]: from its first node to its second one, about the pivot,
    counter-clockwise.

    Raises:
        ValueError: the nodes are not in a plane, or the member is not a torsional spring.
    """
    if member.pivot is None:
        raise ValueError(f"{member.name}: a {member.kind} has no angle; a torsional spring has a pivot")
    at, first, second = (nodes[name] for name in (member.pivot, *member.nodes))
    if len(at) != 2:
        raise ValueError(f"{member.name}: a torsional spring turns in a plane; its nodes have {len(at)} coordinates")
    (ux, uy), (vx, vy) = ((end[0] - at[0], end[1] - at[1]) for end in (first, second))
    across, along = ux * vy - uy * vx, ux * vx + uy * vy
    return namespace_of(across, along).atan2(across, along)


def _length(member: Member, nodes: Mapping[str, Any]) -> Component:
    spans = ((nodes[first], nodes[second]) for first, second in member.spans)
    return sum(sum((b - a) ** 2 for a, b in zip(*ends, strict=True)) ** 0.5 for ends in spans)


def _height(member: Member, nodes: Mapping[str, Any]) -> Component:
    first, second = member.nodes
    return (nodes[first][-1] + nodes[second][-1]) / 2
