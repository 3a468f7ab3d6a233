"""Actuator and output workspace of the planar 4-bar mechanism without a load, as exact regions.

Modes: "rectangle" (all stable rectangles), "paper" (those with 0 < theta, gamma < pi, [Ji2014, Eq. 2]) and "flat".

The tip is a smooth function of (beta, gamma), F = C(beta) + L e(gamma), also where C and D coincide and where the
rectangle becomes flat, as a function of the actuator lengths it is not. Over that plane lie two sheets of rectangles:
D on either side of the line from A to the midpoint M of bar CF.
"""

from __future__ import annotations

import math

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.geometry.boundary import Map
from tensegrity_envs.geometry.overlay import Image, image
from tensegrity_envs.geometry.regions import Region
from tensegrity_envs.mechanics.planar_four_bar import PlanarFourBar

MODES = ("rectangle", "paper", "flat")


def _check(mechanism: PlanarFourBar, mode: str) -> None:
    if mode not in MODES:
        raise ValueError(f"mode = {mode!r}: must be one of {', '.join(map(repr, MODES))}")
    if mechanism.design.is_batch:
        raise ValueError("a workspace belongs to one design, not to a batch of them")


def actuator_workspace(mechanism: PlanarFourBar, mode: str = "rectangle", lobe: int = 0) -> Region:
    """Actuator lengths (rho1, rho2) [m] under which there is a stable unloaded state of a mode.

    Args:
        mechanism: of one design.
        mode: see the module. The paper's angle range is met exactly where R^2 < |a|, a = 1 - cos alpha - cos beta, on
            the side given by the sign of a.
        lobe: 1 or -1 restricts mode "paper" to a > 0 or a < 0; the two touch where C and D coincide.

    Raises:
        ValueError: an unknown mode, a lobe that is not -1, 0 or 1, or a batch of designs.
    """
    _check(mechanism, mode)
    if lobe not in (-1, 0, 1):
        raise ValueError(f"lobe = {lobe!r}: must be 1 or -1, the sign of a, or 0 for both")
    l = float(mechanism.length)

    def pitchfork(q1: Component, q2: Component) -> Components:
        margin = 1 - (q1 * q1 + q2 * q2) / (4 * l * l)
        return ((-margin,) if mode == "flat" else (margin,)) if mode != "paper" else (margin,)

    def paper(q1: Component, q2: Component) -> Components:
        a = (q1 * q1 + q2 * q2) / (2 * l * l) - 1
        return ((lobe * a if lobe else np.abs(a)) - mechanism.flatness((q1, q2))[0],)

    conditions, names = (paper, ("angle range",)) if mode == "paper" else (pitchfork, ("pitchfork",))
    return Region(conditions, names, (0.0, 0.0), (2 * l, 2 * l), f"actuator workspace, {mode}")


def output_workspace(
    mechanism: PlanarFourBar,
    mode: str = "rectangle",
    resolution: int = 256,
    tolerance: float = 1e-5,
) -> Image:
    """Positions of F [m] that stable unloaded states of a mode reach, and with how many of them.

    Args:
        mechanism: of one design.
        mode: see the module.
        resolution, tolerance: see `Region.trace`; finer grids would only resolve the cusps of the sheets.

    Raises:
        ValueError: an unknown mode, or a batch of designs.
    """
    _check(mechanism, mode)
    if mode == "flat":
        regions, mapping = _flat_sheets(mechanism)
    else:
        regions, mapping = _rectangle_sheets(mechanism, mode == "paper")
    sheets = {n: r.trace(resolution, tolerance, mapping, finest=resolution) for n, r in regions.items()}
    return image(sheets, mapping)


def _rectangle_sheets(mechanism: PlanarFourBar, paper: bool) -> tuple[dict[str, Region], Map]:
    l = float(mechanism.length)

    def tip(q: tuple[Component, Component]) -> tuple[Component, Component]:
        beta, gamma = q
        return l * (1 - np.cos(beta) + np.cos(gamma)), l * (np.sin(beta) + np.sin(gamma))

    def sheet(elbow: int, sign: int) -> Region:
        def conditions(beta: Component, gamma: Component) -> Components:
            cx, cy = 1 - np.cos(beta), np.sin(beta)
            mx, my = cx + np.cos(gamma) / 2, cy + np.sin(gamma) / 2
            square = mx * mx + my * my
            size = np.sqrt(square)
            along = (square + 0.75) / (2 * square)
            # Where there is no D, on the line AM: continuous, and the margins below are negative anyway.
            bow = elbow * np.sqrt(np.maximum(1 / square - along * along, 0.0))
            dx, dy = along * mx - bow * my, along * my + bow * mx
            reach = np.hypot(dx, dy)
            dx, dy = dx / reach, dy / reach
            # alpha + beta < pi: C and D, seen from B and A, do not lean away from each other.
            upright = dy * (1 - cx) + dx * cy  # sin(alpha + beta)
            margins = [size - 0.5, 1.5 - size, dy, upright]
            if paper:
                margins += [np.sin(gamma), my - dy]  # sin theta = y of E - D = 2 (y of M - D)
            return (*margins, sign * np.sin(beta + gamma))

        names = ["|AM| = L/2", "|AM| = 3L/2", "rho2 = 0", "pitchfork"]
        names += ["gamma in range", "theta in range"] if paper else []
        box = ((0.0, -math.pi), (math.pi, math.pi))
        return Region(conditions, (*names, "B, C, F aligned"), *box, "output workspace, elbow and fold of a sheet")

    regions = {
        f"{way}, sin(beta + gamma) {'>' if sign > 0 else '<'} 0": sheet(elbow, sign)
        for way, elbow in (("D left of AM", 1), ("D right of AM", -1))
        for sign in (1, -1)
    }
    return regions, tip


def _flat_sheets(mechanism: PlanarFourBar) -> tuple[dict[str, Region], Map]:
    l = float(mechanism.length)

    def tip(q: tuple[Component, Component]) -> tuple[Component, Component]:
        alpha, beta = q
        cx, cy, dx, dy = 1 - np.cos(beta), np.sin(beta), np.cos(alpha), np.sin(alpha)
        size = np.hypot(dx - cx, dy - cy)
        return l * (cx + (dx - cx) / size), l * (cy + (dy - cy) / size)

    def fold(alpha: Component, beta: Component) -> Component:
        """Determinant of d tip / d(alpha, beta), by L^2."""
        cx, cy, dx, dy = 1 - np.cos(beta), np.sin(beta), np.cos(alpha), np.sin(alpha)
        ux, uy = dx - cx, dy - cy
        size = np.hypot(ux, uy)
        ux, uy = ux / size, uy / size
        # D moves along (-dy, dx), C along (cy, 1 - cx); only what is across u turns it.
        turn = (ux * dx + uy * dy) / size
        across = (ux * (1 - cx) - uy * cy) / size
        first = -turn * uy, turn * ux
        second = cy + across * uy, 1 - cx - across * ux
        return first[0] * second[1] - first[1] * second[0]

    def sheet(sign: int) -> Region:
        return Region(
            lambda alpha, beta: (-np.cos((alpha + beta) / 2), sign * fold(alpha, beta)),
            ("pitchfork", "fold"),
            (0.0, 0.0),
            (math.pi, math.pi),
            "output workspace, flat",
        )

    return {f"det J {'>' if sign > 0 else '<'} 0": sheet(sign) for sign in (1, -1)}, tip
