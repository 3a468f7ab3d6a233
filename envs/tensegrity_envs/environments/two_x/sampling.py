"""Episodes that can be solved: start and target in one connected component of the stable wrench-feasible joint space
(SWFJ).
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np

from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.checks import checked_range
from tensegrity_envs.mechanics.equilibrium import continuation
from tensegrity_envs.mechanics.two_x import TwoX
from tensegrity_envs.mechanics.x_arms import XArm, XDesign
from tensegrity_envs.seeding import EpisodeStream, until_found

_MIN_MARGIN = 0.01  # of starts and targets, for both margins [-]
_PAYLOAD_LEVELS = 9
_MOST_SOLUTIONS = 8  # of the inverse kinematics
_TARGET_DRAWS = 1 << 20  # first draw of the targets: beyond every draw of the starts


class Drawn(NamedTuple):
    """A batch of n episodes.

    Attributes:
        mechanism: with the true, hidden parameters of every episode.
        configuration: at the start [rad].
        tensions: at the start [N], or None for the stiffest ones.
        target_configuration: one configuration that solves the episode [rad].
    """

    mechanism: XArm
    configuration: Components
    tensions: Components | None
    target_configuration: Components


@lru_cache(maxsize=8)  # a mebibyte or, of three joints and a hidden payload, eight
def _components(arm: type[Any], design: XDesign, levels: tuple[float, ...], nodes: int) -> np.ndarray:
    """Numbers of the connected components on a grid, for every level of the payload; 0 outside.

    Environments of one design share them.
    """
    from scipy import ndimage  # slow to import, and only needed here

    axis = np.linspace(-design.joint_limit, design.joint_limit, nodes)
    grid = tuple(np.meshgrid(*[axis] * int(arm(design).degrees_of_freedom), indexing="ij"))
    inside = (_is_far_inside(*arm(replace(design, payload=p)).posture(grid)[1:]) for p in levels)
    components = np.stack([ndimage.label(here)[0] for here in inside])
    components.flags.writeable = False
    return components


class Sampler:
    """Draws episodes, each a function of (seed, episode) alone.

    Configurations are uniform over the part of the SWFJ, within the joint limits, where both margins are at least 0.01;
    the target lies in the connected component that the start is in. With a hidden payload the start gives nothing
    away: its tensions are the stiffest ones of a configuration of the *nominal* arm, and such a start counts only if
    the arm stays in equilibrium under every payload that could be drawn, so tensions and payload are independent.
    The start is then where the arm comes to rest under the payload that was drawn.

    Attributes:
        arm: makes the mechanism of a design.

    Raises:
        ValueError: the SWFJ of the design is empty.
    """

    is_traced = False  # see compiler.numbers.Lifting

    arm: ClassVar[type[Any]] = TwoX

    def __init__(self, design: XDesign, payload_range: tuple[float, float] | None = None) -> None:
        self.design = design
        self.payload_range = payload_range
        low, high = checked_range("payload_range", payload_range, "kg", (float(design.payload), float(design.payload)))
        self._levels = np.linspace(low, high, _PAYLOAD_LEVELS if high > low else 1)
        self.joints = int(self.arm(design).degrees_of_freedom)
        self._components = self._labelled()
        if not self._components.reshape(len(self._levels), -1).any(axis=1).all():
            raise ValueError(
                f"the stable wrench-feasible joint space is empty within |alpha| <= {design.joint_limit} rad "
                f"for {design} with a payload of up to {high} kg: raise max_tension, lower payload or bar_density"
            )

    @property
    def nodes(self) -> int:
        """Along each angle of the grid that tells connected components apart."""
        return 161

    def _labelled(self) -> np.ndarray:
        """Numbers of the connected components on the grid, for every level of the payload; 0 outside."""
        arm: Any = self.arm  # hashable, as classes are
        return _components(arm, self.design, tuple(self._levels.tolist()), self.nodes)

    def _joined(self, mechanism: XArm, payload: np.ndarray, start: Components, q: Components) -> np.ndarray:
        """Whether configurations are in the connected components that those of the starts are in."""
        component = self._component(payload, start)
        return np.asarray((component > 0) & (self._component(payload, q) == component))

    def _component(self, payload: np.ndarray, q: Components) -> np.ndarray:
        """Which connected component of its SWFJ a configuration is in, from the nearest grid node; 0 for none."""
        limit = self.design.joint_limit
        first, span = self._levels[0], self._levels[-1] - self._levels[0]
        level = np.ceil((payload - first) / span * (len(self._levels) - 1)) if span > 0 else 0 * payload
        place = (np.rint((angle + limit) / (2 * limit) * (self.nodes - 1)).astype(int) for angle in q)
        return np.asarray(self._components[(level.astype(int), *place)])

    def sample(self, seed: np.ndarray, episode: np.ndarray, design: XDesign | None = None) -> Drawn:
        """Draw the episodes of the given (seed, episode) pairs, both of shape (n,).

        Args:
            seed: of the environments.
            episode: numbers.
            design: of these episodes, but for their payload, if it differs from the nominal one. Connected components
                are still told apart by the nominal one.
        """
        n = len(seed)
        stream = EpisodeStream(seed, episode)
        payload = np.full(n, float(self.design.payload))
        unloaded = self.arm(self.design if design is None else design)
        mechanism = unloaded
        if self.payload_range is not None:
            payload = stream.uniform(*self.payload_range)
            mechanism = self.arm(replace(unloaded.design, payload=payload))
        hidden = self.payload_range is not None

        def try_start(owner: np.ndarray, here: EpisodeStream) -> tuple[np.ndarray, np.ndarray]:
            return self._try_start(unloaded.take(owner), here, payload[owner])

        found = until_found(stream, n, self.joints, try_start, f"no start found for {self.design} in {{}} draws")
        k = self.joints
        start = tuple(found[:k])

        def try_target(owner: np.ndarray, here: EpisodeStream) -> tuple[np.ndarray, np.ndarray]:
            q = self._uniform(here)
            arm, begin = mechanism.take(owner), tuple(angle[owner] for angle in start)
            good = self.inside(arm, q)
            return np.stack(q), good & self._joined(arm, payload[owner], begin, q)

        stream = EpisodeStream(seed, episode, _TARGET_DRAWS)
        target = until_found(stream, n, k, try_target, f"no target found for {self.design} in {{}} draws")
        return Drawn(mechanism, start, tuple(found[k:]) if hidden else None, tuple(target))

    def start_at(self, mechanism: XArm, q: Components, is_hidden: bool) -> tuple[Components, Components | None]:
        """Where an arm begins, and under which tensions, that is put into a posture.

        Args:
            mechanism: a batch of one, with the true payload.
            q: components of shape (1,) [rad].
            is_hidden: whether the payload is; the posture is then that of the arm without it.

        Raises:
            ValueError: the arm cannot be held there.
        """
        if not np.all(mechanism.is_within_limits(q)):
            raise ValueError(f"configuration {_shown(q)}: beyond the joint limits, {self.design.joint_limit:.6g} rad")
        nominal = self.arm(replace(mechanism.design, payload=self.design.payload)) if is_hidden else mechanism
        _, stability, wrench = nominal.posture(q)
        if not (stability > 0).all() or not (wrench >= 0).all():
            raise ValueError(
                f"configuration {_shown(q)}: not stable and wrench-feasible (stability margin {stability[0]:.3g}, "
                f"wrench margin {wrench[0]:.3g})"
            )
        if not is_hidden:
            return q, None
        tensions, one = nominal.stiffest_tensions(q), np.ones(1)
        before, after = (design.payload * one for design in (nominal.design, mechanism.design))
        rest, held = self._add_payload(nominal, q, tensions, before, after)
        if not held.all() or not np.all(mechanism.is_within_limits(rest)):
            raise ValueError(f"configuration {_shown(q)}: not stable under the payload of this episode")
        return rest, tensions

    def in_reach(self, mechanism: XArm, q: Components, solutions: tuple[Components, ...]) -> np.ndarray:
        """Which solutions of a batch of one are in the start's connected component of the SWFJ."""
        payload = mechanism.design.payload * np.ones(1)
        same = [
            np.isfinite(solution[0]).all() and self._joined(mechanism, payload, q, solution)[0]
            for solution in solutions
        ]
        return np.array(same)

    def _uniform(self, stream: EpisodeStream) -> Components:
        limit = self.design.joint_limit
        return tuple(stream.uniform(-limit, limit) for _ in range(self.joints))

    def _try_start(self, nominal: XArm, stream: EpisodeStream, payload: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where arms begin and, if the payload is hidden, under which tensions, and which of them are good."""
        q = self._uniform(stream)
        good = self.inside(nominal, q)
        found = np.stack(q)
        if self.payload_range is not None:
            index = np.flatnonzero(good)
            nominal = nominal.take(index)
            rest = tuple(found[:, index])
            tensions = nominal.stiffest_tensions(rest)
            heaviest = np.full(len(index), float(self.payload_range[1]))
            rest, held = self._add_payload(
                nominal, rest, tensions, 0.0 * heaviest + nominal.design.payload, payload[index]
            )
            at_heaviest, held_heaviest = self._add_payload(nominal, rest, tensions, payload[index], heaviest)
            held &= held_heaviest & nominal.is_within_limits(at_heaviest) & nominal.is_within_limits(rest)
            found = np.concatenate([found, np.zeros((len(tensions), len(good)))])
            found[:, index] = np.stack([*rest, *tensions])
            good[index] &= held
        good &= self._component(payload, tuple(np.where(good, angle, 0.0) for angle in found[: self.joints])) > 0
        return found, good

    def inside(self, mechanism: XArm, q: Components) -> np.ndarray:
        """Whether both margins of configurations within the joint limits are at least 0.01."""
        return _is_far_inside(*evaluate(_margins, self.arm, mechanism.design, q))

    def _add_payload(
        self, nominal: XArm, q: Components, tensions: Components, before: np.ndarray, after: np.ndarray
    ) -> tuple[Components, np.ndarray]:
        """Where arms at rest in q come to rest when their payload changes slowly, and whether they stayed stable on
        the way.
        """
        if not len(before):
            return q, np.zeros(0, bool)
        end, fraction = evaluate(_change_payload, self.arm, nominal.design, q, tensions, before, after)
        return end, np.asarray(fraction >= 1.0)


def _shown(q: Components) -> str:
    return "(" + ", ".join(f"{float(angle[0]):.6g}" for angle in q) + ")"


def _is_far_inside(stability: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    return np.asarray((stability >= _MIN_MARGIN) & (wrench >= _MIN_MARGIN))


def _margins(arm: type[Any], design: XDesign, q: Components) -> tuple[Component, Component]:
    """Stability and wrench margin of the stiffest tensions."""
    _, stability, wrench = arm(design).posture(q)
    return stability, wrench


def _change_payload(
    kind: type[Any], design: XDesign, q: Components, tensions: Components, before: Component, after: Component
) -> tuple[Components, Component]:
    arm = kind(design)

    def path(u: Components, t: Component) -> Any:
        more = before + t * (after - before) - design.payload
        return arm.sine_statics(u, tensions, (0.0, -design.gravity * more))

    u, fraction = continuation(path, arm.to_sines(q))
    return arm.from_sines(u), fraction


def feasible_solutions(
    mechanism: TwoX, x: np.ndarray, y: np.ndarray, known: Components | None = None
) -> tuple[Components, ...]:
    """Configurations that put the tip at (x, y) and are stable and wrench-feasible, for every target of a batch.

    Args:
        mechanism: one design, or a batch of n.
        x: shape (n,) [m].
        y: shape (n,) [m].
        known: one solution of each target, if there is one [rad].

    Returns:
        Eight configurations, the most that a target can have, components of shape (n,); targets with fewer repeat
        theirs. A target that has none gets the known one, or else infinity.
    """
    table = np.stack(mechanism.inverse_kinematics_batch(x, y))
    row, column = np.nonzero(np.isfinite(table[0]))
    stability, wrench = evaluate(_margins, TwoX, mechanism.take(row).design, tuple(table[:, row, column]))
    good = (stability > 0) & (wrench >= 0)  # and within the joint limits, as all inverse solutions
    table[:, row[~good], column[~good]] = np.nan
    missing = np.isnan(table[0])
    table = np.take_along_axis(table, np.argsort(missing, axis=1, kind="stable")[None], axis=2)
    counts = (~missing).sum(axis=1)
    none = counts == 0
    table[:, none, 0] = np.inf if known is None else np.stack(known)[:, none]
    column = np.minimum(np.arange(_MOST_SOLUTIONS), np.maximum(counts, 1)[:, None] - 1)
    table = np.take_along_axis(table, column[None], axis=2)
    return tuple((table[0][:, k], table[1][:, k]) for k in range(_MOST_SOLUTIONS))
