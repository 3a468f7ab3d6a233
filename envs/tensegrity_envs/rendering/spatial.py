"""Pictures of spatial mechanisms: an orthographic projection onto a planar `Scene`."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from tensegrity_envs.rendering.scene import Scene

_AZIMUTH, _ELEVATION = math.radians(-62.0), math.radians(24.0)  # from where one looks
_BASE, _SHADOW, _PLATFORM = (226, 231, 238), (205, 212, 222), (120, 160, 205)

Place = Sequence[float]
_S, _C = math.sin(_AZIMUTH), math.cos(_AZIMUTH)
_UP, _FLAT = math.sin(_ELEVATION), math.cos(_ELEVATION)


def flatten(place: Place) -> tuple[float, float]:
    """The components of a vector in space to the right and up in the picture [m]."""
    x, y, z = (float(component) for component in place)
    return -_S * x + _C * y, _FLAT * z - _UP * (_C * x + _S * y)


def depth(place: Place) -> float:
    """Towards the one who looks [m]."""
    x, y, z = (float(component) for component in place)
    return _FLAT * (_C * x + _S * y) + _UP * z


def project(scene: Scene, faces: tuple[Sequence[str], Sequence[str]], centre: Place) -> Scene:
    """The scene with everything of it in the plane of the picture.

    Args:
        scene: a `Scene` whose positions and load have three components.
        faces: nodes of the base and of the platform; the platform's shadow falls on the ground at z = 0.
        centre: what is in the middle of the picture [m].
    """
    middle = flatten(centre)

    def at(place: Place) -> tuple[float, float]:
        right, up = flatten(place)
        return right - middle[0], up - middle[1]

    nodes: Mapping[str, Any] = scene.nodes  # of three components, until here
    base, platform = ([nodes[name] for name in names] for names in faces)
    shadow = [(x, y, 0.0) for x, y, _ in platform]
    order = sorted(scene.members, key=lambda member: sum(depth(nodes[name]) for name in member.nodes))
    return replace(
        scene,
        nodes={name: at(place) for name, place in nodes.items()},
        members=order,
        tip=at(scene.tip),
        target=None if scene.target is None else at(scene.target),
        trace=[at(place) for place in scene.trace],
        load=flatten(scene.load),
        curve=[at(place) for place in scene.curve],
        faces=[
            ([at(place) for place in corners], colour, share)
            for corners, colour, share in (
                (base, _BASE, 1.0),
                (shadow, _SHADOW, 1.0),
                (platform, _PLATFORM, 0.35),
            )
        ],
    )
