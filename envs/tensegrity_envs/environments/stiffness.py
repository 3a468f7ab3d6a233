"""Reaching with a commanded stiffness: the tip at a target, and as stiff there as asked.

The stiffness of the tip is that of `mechanics.stiffness`: force by displacement at constant tensions, along a given
direction or, without one, in the direction in which the tip gives way most. Cables that pull against each other make a
posture stiffer without moving it, so tip and stiffness can be chosen apart, within the range that the tensions' bounds
leave in that posture (`stiffness_range`).
"""

import math
from collections.abc import Collection, Sequence
from typing import Any, ClassVar

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, Namespace, namespace_of, to_single
from tensegrity_envs.core import Sampled
from tensegrity_envs.environments.n_x import NXReach
from tensegrity_envs.environments.two_x import TwoXReach
from tensegrity_envs.environments.two_x.sampling import Drawn
from tensegrity_envs.mechanics.stiffness import scaled_direction
from tensegrity_envs.mechanics.x_arms import XArm
from tensegrity_envs.observation import Divided, Field
from tensegrity_envs.options import QUASI_STATIC, Options
from tensegrity_envs.seeding import EpisodeStream
from tensegrity_envs.simulation.protocol import Episode, State

_SPAN = 12.0  # of the logarithm of the stiffness, which is clipped there
_LEAST_SHARE = 0.3  # of the greatest stiffness of a posture: softer ones are hardly stable
_INSET = 0.02  # of the range of stiffness, at both ends
_STIFFNESS_DRAW = 1 << 21  # beyond every draw of starts and targets


class StiffnessGoals(TwoXReach):
    """What the environments with a commanded stiffness share: goals (x, y, log(stiffness / reference)).

    Attributes:
        direction: see `TipStiffness.stiffness`; scaled by a power of two, so that its greatest number is from 1 to 2.
        stiffness_tolerance: relative.
        log_tolerance: log(1 + stiffness_tolerance).
        reference: stiffness scale of the design divided by the square of its reach [N/m].

    Args:
        direction: (x, y) along which the stiffness counts; the direction in which the tip gives way most by default.
        stiffness_tolerance: relative.
    """

    shared = QUASI_STATIC
    goal_name = "goal"
    error_name = "goal_error"
    info_meanings: ClassVar[dict[str, tuple[str, str]]] = {
        **TwoXReach.info_meanings,
        "goal_error": ("m", "the larger of tip error and stiffness error, the latter scaled to the tip's tolerance"),
        "tip_error": ("m", "distance of the tip from the target"),
        "stiffness": ("N/m", "stiffness of the tip"),
    }

    def __init__(
        self, direction: Sequence[float] | None = None, stiffness_tolerance: float = 0.05, **options: Any
    ) -> None:
        is_number = isinstance(stiffness_tolerance, int | float | np.number) and not isinstance(
            stiffness_tolerance, bool
        )
        if not (is_number and 0 < stiffness_tolerance < math.inf):
            raise ValueError(
                f"stiffness_tolerance = {stiffness_tolerance!r}: must be a positive number, a share of the commanded "
                "stiffness, such as 0.05"
            )
        control = options.setdefault("control", "tension")
        if control != "tension":
            raise ValueError(f"control = {control!r}: must be 'tension': the cables make the tip as stiff as asked")
        if options.get("payload_range") is not None:
            raise ValueError("payload_range: not with a commanded stiffness, which is that of the nominal arm")
        self.direction = None if direction is None else scaled_direction(direction)
        self.stiffness_tolerance = float(stiffness_tolerance)
        self.log_tolerance = math.log1p(stiffness_tolerance)
        super().__init__(**options)

    def take_options(self, options: Options, applicable: Collection[str], where: str) -> None:
        """See `Core.take_options`; nothing of the arm itself is randomized, since its stiffness is a goal."""
        super().take_options(options, set(applicable) - {"stiffness", "mass", "payload"}, f"{where} of given stiffness")

    def set_spaces(self, goal_size: int = 3, goal_bound: float | Sequence[float] | None = None) -> None:
        """See `Core.set_spaces`."""
        self.reference = float(self.nominal.stiffness_scale) / self.reach**2
        super().set_spaces(3, (self.reach, self.reach, _SPAN))

    @property
    def goal_text(self) -> str:
        """See `Core.goal_text`."""
        return (
            f"the position of the tip [m] and log(stiffness of the tip / {self.reference:.5g} N/m); tolerance "
            f"{self.task.tolerance:.5g} m and {100 * self.stiffness_tolerance:.3g}% of the stiffness"
        )

    def tip_stiffness(self, state: State) -> Component:
        """The stiffness of the tip [N/m]; 0 where it is not stable. Traceable."""
        return self.nominal.stiffness(state.configuration, state.inputs, direction=self.direction)

    def log_stiffness(self, xp: Namespace, stiffness: Component) -> Component:
        """Log(stiffness / reference), within its bounds."""
        lowest, highest = (self.reference * math.exp(end) for end in (-_SPAN, _SPAN))
        return xp.log(xp.minimum(xp.maximum(stiffness, lowest), highest) / self.reference)

    def achieved(self, state: State) -> Components:
        """The tip [m] and log(stiffness / reference)."""
        xp = namespace_of(*state.tip)
        return *state.tip, self.log_stiffness(xp, self.tip_stiffness(state))

    def with_achieved(self, state: State, achieved: Components) -> State:
        """See `Core.with_achieved`; the stiffness follows from configuration and tensions."""
        return state._replace(tip=achieved[:2])

    def error(self, xp: Namespace, achieved: Components, goal: Components) -> Component:
        """The larger of tip error [m] and stiffness error; the latter is the tolerance [m] at its own tolerance."""
        distance = xp.hypot(achieved[0] - goal[0], achieved[1] - goal[1])
        off = abs(achieved[2] - goal[2]) / self.log_tolerance
        return xp.maximum(distance, self.task.tolerance * off)

    def observed(self) -> list[Field]:
        """See `Core.observed`."""
        seen = Field(
            "log_stiffness",
            lambda state, _: (self.achieved(state)[2],),
            None,
            Divided(_SPAN),
            "-",
            f"log(stiffness of the tip / {self.reference:.5g} N/m)",
        )
        return [*super().observed(), seen]

    def hidden_info(self, episode: Episode, state: State) -> dict[str, Component | Components]:
        """Payload [kg], tip error [m] and stiffness [N/m]."""
        xp, goal = namespace_of(*state.tip), episode.goal_at(state.time)
        tip_error = xp.hypot(state.tip[0] - goal[0], state.tip[1] - goal[1])
        more = {"tip_error": tip_error, "stiffness": self.tip_stiffness(state)}
        return super().hidden_info(episode, state) | more

    def commandable(self, mechanism: XArm, q: Components) -> tuple[np.ndarray, np.ndarray]:
        """The least and the greatest stiffness [N/m] that is asked for in a posture: a part of `stiffness_range`."""
        least, greatest = (np.asarray(end) for end in mechanism.stiffness_range(q, direction=self.direction))
        low = np.maximum(least, _LEAST_SHARE * greatest)
        inset = _INSET * (greatest - low)
        return low + inset, greatest - inset

    def drawn_goal(self, drawn: Drawn, seed: np.ndarray, episode: np.ndarray) -> Components:
        """See `TwoXReach.drawn_goal`; the logarithm of the stiffness is uniform in what the target's posture can have.

        From `commandable`; so an episode can be solved: by tensions on the way from the stiffest to the softest ones
        of that posture, along which it stays in stable equilibrium.
        """
        low, high = self.commandable(drawn.mechanism, drawn.target_configuration)
        share = EpisodeStream(seed, episode, _STIFFNESS_DRAW).uniform()
        wanted = self.log_stiffness(np, low * (high / low) ** share)
        return *super().drawn_goal(drawn, seed, episode), to_single(wanted)

    def solutions(self, mechanism: XArm, goal: Components, known: Components | None = None) -> tuple[Components, ...]:
        """See `TwoXReach.solutions`; those that cannot be as stiff as asked are moved to infinity."""
        found = super().solutions(mechanism, goal, known)
        if not found:
            return found
        table: np.ndarray = np.array(found)  # (solutions, joints, n)
        fits = self.is_range_of(mechanism, tuple(np.moveaxis(table, 1, 0)), goal[2])
        if known is not None:  # of rounding
            fits |= (np.abs(table - np.stack(known)) < 1e-9).all(axis=1)
        return tuple(tuple(np.where(good, q, np.inf)) for good, q in zip(fits, table, strict=True))

    def is_range_of(self, mechanism: XArm, q: Components, wanted: Component) -> np.ndarray:
        """Where feasible tensions make postures, components of shape (..., n), as stiff as asked (n,)."""
        here = np.isfinite(q[0])
        with np.errstate(all="ignore"):
            ends = mechanism.stiffness_range(tuple(np.where(here, a, 0.0) for a in q), direction=self.direction)
        stiffness = self.reference * np.exp(wanted)
        slop = 1e-6  # goals are float32 numbers
        return np.asarray(here & (ends[0] * (1 - slop) <= stiffness) & (stiffness <= ends[1] * (1 + slop)))

    def placed(self, sampled: Sampled, target: Components | None, configuration: Components | None) -> Sampled:
        """See `TwoXReach.placed`; some posture must be as stiff as asked.

        Raises:
            ValueError: none is; the message names the range.
        """
        begun = super().placed(sampled, target, configuration)
        mechanism, goal = self.mechanism(begun.episode.design), begun.episode.goal
        found = self.postures(mechanism, *goal[:2])
        q = tuple(np.stack(found, axis=1)[:, self.sampler.in_reach(mechanism, begun.configuration, found), 0])
        many = mechanism.take(np.zeros(len(q[0]), int))
        if not self.is_range_of(many, q, goal[2]).any():
            ends = many.stiffness_range(q, direction=self.direction)
            raise ValueError(
                f"target: a stiffness of {float(self.reference * np.exp(goal[2][0])):.5g} N/m; the postures with the "
                f"tip there have {np.min(ends[0]):.5g} to {np.max(ends[1]):.5g} N/m"
            )
        return begun

    def scene(self, episode: Episode, state: State) -> dict[str, Any]:
        """See `Core.scene`; with the stiffness and the wanted one."""
        goal = episode.goal_at(state.time)
        here, wanted = float(self.tip_stiffness(state)), self.reference * math.exp(float(goal[2]))
        error = math.dist(map(float, state.tip), map(float, goal[:2]))
        return super().scene(episode, state) | {
            "target": goal[:2],
            "caption": f"step {int(state.time)}   tip error {self.error_text(error)}   "
            f"stiffness {here:.3g} N/m, commanded {wanted:.3g}",
        }


class TwoXStiffnessReach(StiffnessGoals):
    """The 2-X in cable control reaches a target with a commanded stiffness of its tip.

    Success: the tip within tolerance and the stiffness within its own. Nothing of the arm is hidden or randomized.
    Other arguments are those of `TwoXReach`.

    Raises:
        ValueError: an argument is out of range; the message names it.
        TypeError: `design` is not a design.
    """


class NXStiffnessReach(StiffnessGoals, NXReach):
    """An arm of X-joints in cable control reaches a target with a commanded stiffness of its tip.

    Success: the tip within tolerance and the stiffness within its own. Nothing of the arm is hidden or randomized.
    Other arguments are those of `NXReach`.

    Raises:
        ValueError: an argument is out of range; the message names it.
        TypeError: `design` is not a design.
    """
