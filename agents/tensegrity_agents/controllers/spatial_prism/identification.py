"""Which orientation and payload explain where a prism is under struts of known lengths, for batches of measurements."""

import numpy as np

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.spatial_prism import SpatialPrism, SpatialPrismDesign, statics
from tensegrity_envs.mechanics.spatial_prism.vectors import (
    cross,
    dot,
    inverse_of_columns,
    rotate,
    scale,
    spin,
    subtract,
    times,
)

_ITERATIONS = 4  # of Newton's method, from rest; a payload of 0.5 kg turns the platform by about a degree


def _explain(design: SpatialPrismDesign, position: Components, lengths: Components) -> tuple[Component, Components]:
    """Weight [N] and rotation vector [rad]. Traceable.

    The lengths fix the orientation: |r + a_{i+1} - b_i| = l_i, three equations. The weight then enters the balance of
    moments linearly: three equations for one unknown, by least squares.
    """
    prism = SpatialPrism(design)
    k, zero = prism.design.k, (0.0, 0.0, 0.0)
    w: Components = zero
    for _ in range(_ITERATIONS):
        pose = statics.pose_of(position, tuple(rotate(w, prism.platform)), prism.base)
        excess = [(dot(h, h) - length * length) / 2 for h, length in zip(pose.struts, lengths, strict=True)]
        levers = [cross(pose.arms[(i + 1) % 3], pose.struts[i]) for i in range(3)]
        turn = list(zip(*spin(w), strict=True))
        rows = [tuple(dot(lever, column) for column in turn) for lever in levers]
        inverse, _ = inverse_of_columns(*zip(*rows, strict=True))
        w = subtract(w, times(inverse, excess))
    pose = statics.pose_of(position, tuple(rotate(w, prism.platform)), prism.base)
    rho, inverse = statics.densities(pose, k, zero)
    left = statics.moment(pose, k, rho, zero)
    pull, _ = statics.densities(pose, 0.0 * k, (0.0, 0.0, -1.0))
    gain = zero
    for i in range(3):
        arm = scale(pull[i], pose.arms[(i + 1) % 3])
        gain = subtract(gain, cross(arm, subtract(pose.base[i], position)))
    return -dot(gain, left) / dot(gain, gain), w


def identify(prism: SpatialPrism, tip: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Weights (n,) [N] that explain measured tips (n, 3) [m] under lengths (n, 3) [m]."""
    columns = [tuple(np.ascontiguousarray(v.T)) for v in (tip, lengths)]
    weight, _ = evaluate(_explain, prism.design, *columns)
    return np.asarray(weight)


def _resting(design: SpatialPrismDesign, lengths: Components, weight: Component) -> Components:
    """Position of the centroid [m] under a weight [N], struts locked, by Newton's method from rest. Traceable."""
    prism = SpatialPrism(design)
    w: Components = (0.0, 0.0, 0.0)
    for _ in range(_ITERATIONS):
        gradient, rows = prism.statics(w, lengths, (0.0, 0.0, -weight))
        inverse, _ = inverse_of_columns(*rows)  # the Hessian is symmetric
        w = subtract(w, times(inverse, gradient))
    return prism.locked_pose(w, lengths).position


def resting(prism: SpatialPrism, lengths: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Positions (n, 3) [m] of centroids under weights (n,) [N], the struts' lengths (n, 3) [m] being locked."""
    columns = tuple(np.ascontiguousarray(lengths.T))
    return np.stack(evaluate(_resting, prism.design, columns, weight), axis=1)
