"""Statics of a platform on three struts and three springs, on components; traceable.

With the struts' force densities rho_i = f_i / l_i, their vectors h_i = p_{i+1} - b_i, the platform's arms
a_i = A U_i, force F and moment T at the centroid r:

    sum rho_i h_i = 3 k r - F                                            (forces)
    sum rho_i a_{i+1} x (r - b_i) + k sum a_i x b_i + T = 0              (moments about the centroid)

The second is minus the derivative of the energy with respect to a rotation in world axes where the struts keep their
lengths: r then follows from the rotation.
"""

from typing import NamedTuple

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.spatial_prism.vectors import (
    Matrix,
    add,
    cross,
    dot,
    inverse_of_columns,
    norm,
    scale,
    subtract,
    times,
)


class Pose(NamedTuple):
    """Where everything is, in world axes [m].

    Attributes:
        position: of the platform's centroid, r.
        arms: a_i, from the centroid to the platform's nodes p_1, p_2, p_3.
        base: b_1, b_2, b_3.
        struts: h_i, from b_i to p_{i+1}.
    """

    position: Components
    arms: tuple[Components, ...]
    base: tuple[Components, ...]
    struts: tuple[Components, ...]


def pose_of(position: Components, arms: tuple[Components, ...], base: tuple[Components, ...]) -> Pose:
    """The pose of a platform at a position with given arms."""
    struts = tuple(subtract(add(position, arms[(i + 1) % 3]), base[i]) for i in range(3))
    return Pose(position, arms, base, struts)


def trilaterate(
    lengths: Components, arms: tuple[Components, ...], base: tuple[Components, ...]
) -> tuple[Components, Components, Component]:
    """Where struts of given lengths put the centroid of a platform of given orientation.

    The centroid lies on spheres around c_i = b_i - a_{i+1}, whose sum is zero: it is the foot in their plane, plus or
    minus the square root of the last result times the plane's unit normal.

    Returns:
        The foot and the unit normal, which points up where the platform has its rest orientation, and the squared
        distance from the plane [m2], negative where the lengths fit no position.
    """
    first, second, third = (subtract(base[i], arms[(i + 1) % 3]) for i in range(3))
    squares = [dot(c, c) for c in (first, second, third)]
    total = sum((length * length - c for length, c in zip(lengths, squares, strict=True)), start=0.0) / 3
    m1, m2 = ((total + c - length * length) / 2 for length, c in zip(lengths[:2], squares[:2], strict=True))
    normal = cross(first, second)
    gram, mixed = dot(normal, normal), dot(first, second)
    alpha, beta = (m1 * squares[1] - m2 * mixed) / gram, (m2 * squares[0] - m1 * mixed) / gram
    foot = add(scale(alpha, first), scale(beta, second))
    return foot, scale(1 / norm(normal), normal), total - dot(foot, foot)


def densities(pose: Pose, k: Component, force: Components) -> tuple[Components, Matrix]:
    """Force densities rho_i of the struts [N/m] that balance springs and force; and the inverse of (h_1 h_2 h_3)."""
    inverse, _ = inverse_of_columns(*pose.struts)
    return times(inverse, subtract(scale(3 * k, pose.position), force)), inverse


def moment(pose: Pose, k: Component, rho: Components, torque: Components) -> Components:
    """Moment about the centroid that is not balanced [N m]."""
    total = torque
    for i in range(3):
        arm = scale(rho[i], pose.arms[(i + 1) % 3])
        total = add(total, cross(arm, subtract(pose.position, pose.base[i])))
        total = add(total, cross(scale(k, pose.arms[i]), pose.base[i]))
    return total


def motion(pose: Pose, inverse: Matrix) -> Matrix:
    """Rows of G [m/rad]: the centroid moves by G w while the platform turns by w about world axes, struts locked.

    h_i . (dr + w x a_{i+1}) = 0 for every strut, so H^T G = -N^T with the columns a_{i+1} x h_i in N.
    """
    levers = [cross(pose.arms[(i + 1) % 3], pose.struts[i]) for i in range(3)]
    # rows of the inverse of H = (h_1 h_2 h_3) are the columns of the inverse of its transpose
    rows = [
        tuple(-sum((inverse[i][a] * levers[i][j] for i in range(3)), start=0.0) for j in range(3)) for a in range(3)
    ]
    return rows[0], rows[1], rows[2]


def moment_slope(pose: Pose, k: Component, rho: Components, inverse: Matrix, locked: bool) -> Matrix:
    """Rows of the derivative of `moment` with respect to rotations about the world axes [N m/rad].

    With s = sum rho_i a_{i+1} and E = sum rho_i a_{i+1} (r - b_i)^T + k sum a_i b_i^T it is E - tr E - G^T [s] where
    the centroid keeps its position; locked struts add [s] G - (3 k - sum rho_i) G^T G.

    Args:
        pose: where everything is.
        k: stiffness [N/m].
        rho: force densities [N/m].
        inverse: of (h_1 h_2 h_3).
        locked: whether the struts keep their lengths.
    """
    g = motion(pose, inverse)
    ahead = [scale(rho[i], pose.arms[(i + 1) % 3]) for i in range(3)]
    after = [scale(k, arm) for arm in pose.arms]
    reach = [subtract(pose.position, b) for b in pose.base]
    s = add(*ahead)
    pull = 3 * k - (rho[0] + rho[1] + rho[2])
    columns = [tuple(row[j] for row in g) for j in range(3)]
    e = [
        [
            sum((ahead[i][a] * reach[i][b] + after[i][a] * pose.base[i][b] for i in range(3)), start=0.0)
            for b in range(3)
        ]
        for a in range(3)
    ]
    trace = e[0][0] + e[1][1] + e[2][2]
    # row j of -G^T [s] is s x (column j of G), and column j of [s] G the same
    around = [cross(s, column) for column in columns]
    rows = []
    for a in range(3):
        row = []
        for b in range(3):
            value = e[a][b] + around[a][b]
            if a == b:
                value = value - trace
            if locked:
                value = value + around[b][a] - pull * dot(columns[a], columns[b])
            row.append(value)
        rows.append(tuple(row))
    return rows[0], rows[1], rows[2]


def moment_by_position(pose: Pose, k: Component, rho: Components, inverse: Matrix) -> tuple[Components, ...]:
    """Derivatives of `moment` with respect to x, y and z of the centroid [N], the orientation kept: three columns.

    The force densities change by (3 k - sum rho_i) times the column of the inverse of (h_1 h_2 h_3).
    """
    pull = 3 * k - (rho[0] + rho[1] + rho[2])
    ahead = add(*(scale(rho[i], pose.arms[(i + 1) % 3]) for i in range(3)))
    columns = []
    for j, axis in enumerate(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))):
        total = cross(ahead, axis)
        for i in range(3):
            lever = cross(pose.arms[(i + 1) % 3], subtract(pose.position, pose.base[i]))
            total = add(total, scale(pull * inverse[i][j], lever))
        columns.append(total)
    return tuple(columns)


def cable_tensions(pose: Pose, k: Component, rho: Components, force: Components, d: Component) -> Components:
    """Tensions [N] of the platform's edges p_1 p_2, p_2 p_3, p_3 p_1, a third of the force acting at every node.

    Edge i is the only one at node i that is not at right angles to the arm a_{i+1}: the balance of the node's other
    forces along that arm gives its tension.
    """
    tensions = []
    for i in range(3):
        spring = subtract(add(pose.position, pose.arms[i]), pose.base[i])
        load = add(scale(rho[i - 1], pose.struts[i - 1]), scale(-k, spring), scale(1 / 3, force))
        tensions.append(-2 / (3**0.5 * d) * dot(load, pose.arms[(i + 1) % 3]))
    return tuple(tensions)
