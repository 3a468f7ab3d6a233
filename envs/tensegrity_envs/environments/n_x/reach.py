"""The n-X manipulator as a reaching environment."""

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from tensegrity_envs.compiler.namespace import Components
from tensegrity_envs.core import Core
from tensegrity_envs.environments.n_x.sampling import NXSampler
from tensegrity_envs.environments.two_x.reach import TwoXReach
from tensegrity_envs.environments.two_x.sampling import Sampler
from tensegrity_envs.mechanics.n_x import NX, THREE_X, NXDesign
from tensegrity_envs.mechanics.n_x.postures import postures_at


class NXReach(TwoXReach):
    """The reaching environments of arms of two X-joints or more.

    Other arguments, and what they mean, are those of `TwoXReach`; a target has a continuum of solutions, and the dense
    reward no term "potential".

    Args:
        control: "joint" (increments of at most 0.1 rad) or "tension" (of at most 15 N).
        payload_range: if given, every episode has an unknown payload from it [kg], uniformly; it may be given in
            `randomization` instead.
        design: the design that controllers know, by default THREE_X; cables by a matrix have no compiled form. Joint
            limits beyond 2.6 rad are narrowed to that.
        tolerance: success within this distance [m]; by default 5 mm at the size of THREE_X, growing with the reach.

    Raises:
        ValueError: an argument is out of range; the message names it.
        TypeError: `design` is not a design.
        ImportError: backend = "mujoco", and MuJoCo is not installed.
    """

    published: ClassVar[NXDesign] = THREE_X
    arm_name = "n-X arm"
    sampler_type: ClassVar[type[Sampler]] = NXSampler
    shows_joint_space = False
    tip_region = Core.tip_region

    def __init__(self, control: Any = "joint", payload_range: tuple[float, float] | None = None, **shared: Any) -> None:
        super().__init__(control, payload_range, **shared)

    def mechanism(self, design: NXDesign) -> NX:
        """See `Core.mechanism`.

        Raises:
            ValueError: an arm of one joint, or cables by a matrix.
        """
        if design.joints < 2:
            raise ValueError(f"design.joints = {design.joints!r}: must be 2 or more: the tip of one joint has a curve")
        if not isinstance(design.routing, str):
            raise ValueError(
                f"design.routing = {design.routing!r}: must be 'per_joint' or 'from_base' in an environment"
            )
        return NX(design)

    def solutions(self, mechanism: NX, goal: Components, known: Components | None = None) -> tuple[Components, ...]:
        """None: the reward has no potential."""
        return ()

    def postures(self, mechanism: NX, x: np.ndarray, y: np.ndarray) -> tuple[Components, ...]:
        """See `TwoXReach.postures`; some of the continuum."""
        _, found = postures_at(mechanism, x, y)
        _, stability, wrench = mechanism.take(np.zeros(found.shape[1], int)).posture(tuple(found))
        good = found.T[(stability > 0) & (wrench >= 0)]
        if not len(good):
            good = np.full((1, mechanism.degrees_of_freedom), np.inf)
        return tuple(tuple(q[:, None]) for q in good)

    def stiffened(self, design: NXDesign, factor: np.ndarray) -> NXDesign:
        """The design with springs so many times as stiff."""
        left, right = (tuple(k * factor for k in design.each(side)) for side in ("k_left", "k_right"))
        return replace(design, k_left=left, k_right=None if design.k_right is None else right)
