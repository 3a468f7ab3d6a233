"""Vectors of three components, rotations of space, and 3 x 3 systems, on components."""

from collections.abc import Sequence

from tensegrity_envs.compiler.namespace import Component, Components, namespace_of

Matrix = tuple[Components, Components, Components]  # rows
_TINY = 1e-300  # keeps the angle of no rotation from dividing by zero
_SMALL = 0.01  # [rad^2] below, a series replaces a difference


def dot(a: Sequence[Component], b: Sequence[Component]) -> Component:
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Sequence[Component], b: Sequence[Component]) -> Components:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def add(*vectors: Sequence[Component]) -> Components:
    """Sum."""
    total = tuple(vectors[0])
    for vector in vectors[1:]:
        total = tuple(a + b for a, b in zip(total, vector, strict=True))
    return total


def subtract(a: Sequence[Component], b: Sequence[Component]) -> Components:
    """Difference."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scale(factor: Component, a: Sequence[Component]) -> Components:
    """Multiple."""
    return factor * a[0], factor * a[1], factor * a[2]


def norm(a: Sequence[Component]) -> Component:
    """Length."""
    return namespace_of(*a).sqrt(dot(a, a))


def inverse_of_columns(a: Components, b: Components, c: Components) -> tuple[Matrix, Component]:
    """Rows of the inverse of the matrix with these columns, and its determinant; not finite where that is zero."""
    first, second, third = cross(b, c), cross(c, a), cross(a, b)
    determinant = dot(a, first)
    return (scale(1 / determinant, first), scale(1 / determinant, second), scale(1 / determinant, third)), determinant


def times(matrix: Matrix, vector: Sequence[Component]) -> Components:
    """Matrix times vector."""
    return dot(matrix[0], vector), dot(matrix[1], vector), dot(matrix[2], vector)


def _angle(w: Sequence[Component]) -> tuple[Component, Component]:
    square = dot(w, w)
    return square, namespace_of(*w).sqrt(square + _TINY)


def rotate(w: Sequence[Component], vectors: Sequence[Components]) -> list[Components]:
    """Vectors turned by the rotation vector w [rad] (axis times angle; Rodrigues' formula)."""
    xp = namespace_of(*w)
    _, angle = _angle(w)
    half = xp.sin(angle / 2) / angle
    sine, versine = xp.sin(angle) / angle, 2 * half * half
    turned = []
    for vector in vectors:
        once = cross(w, vector)
        turned.append(add(vector, scale(sine, once), scale(versine, cross(w, once))))
    return turned


def spin(w: Sequence[Component]) -> Matrix:
    """The matrix that takes a change of the rotation vector w to the rotation in world axes that it makes.

    It is 1 + (1 - cos a) / a^2 [w] + (a - sin a) / a^3 [w]^2 with a = |w|.
    """
    xp = namespace_of(*w)
    square, angle = _angle(w)
    half = xp.sin(angle / 2) / angle
    versine = 2 * half * half
    series = 1 / 6 - square * (1 / 120 - square * (1 / 5040 - square / 362880))
    large = xp.where(square < _SMALL, 1.0, square)
    third = xp.where(square < _SMALL, series, (1 - xp.sin(angle) / angle) / large)
    x, y, z = w
    return (
        (1 - third * (y * y + z * z), third * x * y - versine * z, third * x * z + versine * y),
        (third * x * y + versine * z, 1 - third * (x * x + z * z), third * y * z - versine * x),
        (third * x * z - versine * y, third * y * z + versine * x, 1 - third * (x * x + y * y)),
    )
