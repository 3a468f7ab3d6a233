"""The analytic controllers that reach with a commanded stiffness, and the information set of each.

A command is a configuration q and a share s of the way from the softest to the stiffest tensions that hold it:

    tensions(q, s) = (1 - s) softest(q) + s stiffest(q),

all of which hold q in equilibrium. `tensions_for` gives the share at which the tip is as stiff as asked, exactly.
Configurations and shares are kept in one array, (n, joints + 1).
"""

from abc import abstractmethod
from typing import Any

import numpy as np

from tensegrity_agents.controllers import two_x
from tensegrity_agents.controllers.connecting import connect
from tensegrity_agents.controllers.n_x.reach import NXArm
from tensegrity_agents.controllers.two_x.measurements import solutions
from tensegrity_agents.controllers.two_x.planning import margin, straight_clearance
from tensegrity_agents.controllers.two_x.reach import Memory, ReachController
from tensegrity_agents.controllers.two_x.tracking import tension_action
from tensegrity_envs.compiler.namespace import Components
from tensegrity_envs.environments.stiffness import StiffnessGoals
from tensegrity_envs.mechanics.n_x.postures import PROJECTED, postures_at
from tensegrity_envs.observation import DecodedObservation

_LEAST = 0.005  # [-] margin along a planned path
_NEAREST = 48  # postures of each target whose straight path is looked at
_STEP = 0.05  # of the share, for a difference


def tensions_between(model: Any, command: Components) -> Components:
    """Tensions [N] of the commands (q_1, ..., q_n, share)."""
    *q, share = command
    ends = zip(model.softest_tensions(q), model.stiffest_tensions(q), strict=True)
    return tuple(soft + share * (stiff - soft) for soft, stiff in ends)


def share_of(model: Any, q: np.ndarray, tensions: np.ndarray) -> np.ndarray:
    """The share (n,) that tensions (cables, n) stand for at q (joints, n); 1 where softest and stiffest are one."""
    soft, stiff = (np.stack(ends) for ends in (model.softest_tensions(tuple(q)), model.stiffest_tensions(tuple(q))))
    way = stiff - soft
    length = (way * way).sum(axis=0)
    share = ((tensions - soft) * way).sum(axis=0) / np.where(length > 0, length, 1.0)
    return np.clip(np.where(length > 0, share, 1.0), 0.0, 1.0)


class WithStiffness(ReachController):
    """What these controllers share: what is commanded, and which postures can be as stiff as asked."""

    core: StiffnessGoals
    more = 0  # candidates, where none of the usual ones fits

    @abstractmethod
    def candidates(self, target: np.ndarray, count: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Postures of targets (n, 2): the indices (k,) of their targets, and the configurations (joints, k) [rad].

        Args:
            target: [m].
            count: how many to look for where there is a continuum.
        """

    def decode(self, observation: Any) -> DecodedObservation:
        """See `AnalyticController.decode`: the target is the tip's, `wanted` the logarithm of the stiffness."""
        observed = super().decode(observation)
        goal = observed.target
        return observed.replace(target=goal[:, :2], wanted=goal[:, 2], tip=observed.goal[:, :2])

    def _believed(self, observed: DecodedObservation, index: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        q, commanded, payload = super()._believed(observed, index)
        share = share_of(self.nominal, commanded.T, observed.tensions.T)
        return q, np.column_stack([commanded, share]), payload

    def share_for(self, q: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """The share (n,) at which configurations (n, joints) are as stiff as asked, or as nearly as they can be."""
        here = tuple(q.T)
        least, greatest = self.nominal.stiffness_range(here, direction=self.core.direction)
        stiffness = np.clip(self.core.reference * np.exp(wanted), np.maximum(least, 1e-9 * greatest), greatest)
        share, held = np.ones(len(q)), np.flatnonzero(greatest > 0)
        if len(held):
            part = tuple(angle[held] for angle in here)
            tensions = self.nominal.tensions_for(part, stiffness[held], direction=self.core.direction)
            share[held] = share_of(self.nominal, np.stack(part), np.stack(tensions))
        return share

    def fitting(self, observed: DecodedObservation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Candidates and which of them can be as stiff as asked; all of a target's, where none can."""
        owner, q = self.candidates(observed.target)
        fits = self.core.is_range_of(self.nominal, tuple(q), observed.wanted[owner])
        none = np.setdiff1d(np.arange(len(observed.wanted)), owner[fits])
        if self.more and len(none):
            place, further = self.candidates(observed.target[none], self.more)
            owner, q = np.concatenate([owner, none[place]]), np.hstack([q, further])
            fits = self.core.is_range_of(self.nominal, tuple(q), observed.wanted[owner])
        some = np.isin(owner, owner[fits])
        return owner, q, fits | ~some

    def chosen(self, start: np.ndarray, observed: DecodedObservation) -> tuple[np.ndarray, np.ndarray]:
        """Of the postures that fit, the nearest one (n, joints) with a straight path from `start`, and if there is one.

        Where there is none, the one whose straight path keeps the largest margin.
        """
        owner, q, fits = self.fitting(observed)
        owner, q = owner[fits], q[:, fits]
        length = np.abs(q - start.T[:, owner]).max(axis=0)
        order = np.lexsort((length, owner))
        owner, q, length = owner[order], q[:, order], length[order]
        near = np.arange(len(owner)) - np.searchsorted(owner, owner) < _NEAREST
        owner, q, length = owner[near], q[:, near], length[near]
        goal, straight = start.copy(), np.zeros(len(start), bool)
        if not len(owner):
            return goal, straight
        clearance = straight_clearance(self.nominal, start.T[:, owner], q)
        order = np.lexsort((-np.where(clearance > 0, 100.0 - length, clearance), owner))
        found, first = np.unique(owner[order], return_index=True)
        goal[found], straight[found] = q[:, order[first]].T, clearance[order[first]] > 0
        return goal, straight

    def _paths(self, model: Any, start: np.ndarray, observed: DecodedObservation) -> list[np.ndarray]:
        """To the posture at the stiffest tensions, then along the line of equal moments to those of the stiffness."""
        goal, _ = self.chosen(start[:, :-1], observed)
        return self.stiffened([point[None] for point in goal], observed.wanted)

    def stiffened(self, paths: list[np.ndarray], wanted: np.ndarray) -> list[np.ndarray]:
        """Waypoints (k + 1, joints + 1) along joint paths (k, joints), as stiff as asked (n,) at their ends."""
        ends = np.stack([path[-1] for path in paths]) if paths else np.zeros((0, self.nominal.degrees_of_freedom))
        last = np.column_stack([ends, self.share_for(ends, wanted)])
        return [
            np.concatenate([np.column_stack([path, np.ones(len(path))]), end[None]])
            for path, end in zip(paths, last, strict=True)
        ]

    def follow(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        """See `ReachController.follow`."""
        goal, memory = self.next_waypoint(memory.commanded, memory)
        return self.pulled(observed, memory, goal)

    def pulled(self, observed: DecodedObservation, memory: Memory, goal: np.ndarray) -> tuple[np.ndarray, Memory]:
        """Actions towards a command (n, joints + 1), and what to remember."""
        action, commanded = tension_action(
            self.nominal, memory.commanded, goal, observed.tensions, lambda c: tensions_between(self.nominal, c)
        )
        return action, memory._replace(commanded=commanded)


class TwoXPostures(WithStiffness):
    """Of two joints: all inverse solutions."""

    def candidates(self, target: np.ndarray, count: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """See `WithStiffness.candidates`."""
        table, missing = solutions(self.nominal, target)
        owner, column = np.nonzero(~missing)
        return owner, table[:, owner, column]


class NXPostures(NXArm):
    """Of more joints: a spread of the continuum of inverse solutions."""

    more = 1000

    def candidates(self, target: np.ndarray, count: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """See `WithStiffness.candidates`."""
        return postures_at(self.nominal, target[:, 0], target[:, 1], count or PROJECTED)


class ClosedForm(TwoXPostures, two_x.ClosedFormIK):
    """Of the inverse solutions that can be as stiff as asked the nearest one with a feasible straight joint path; there
    the tensions that `tensions_for` gives.
    """

    knows = "the nominal design; plans once, no feedback"


class PseudoInverse(TwoXPostures, two_x.PseudoInverse):
    """Resolved rate with feedback of tip and stiffness: near the target the share is moved by what the error of the
    logarithm asks for, to first order; elsewhere the tensions are the stiffest.
    """

    knows = "the nominal design; feedback of tip error and stiffness error"
    near = 0.05  # [m]

    def _paths(self, model: Any, start: np.ndarray, observed: DecodedObservation) -> list[np.ndarray]:
        return [point[None] for point in start]  # it follows none

    def follow(self, observed: DecodedObservation, memory: Memory) -> tuple[np.ndarray, Memory]:
        """See `ReachController.follow`: joint steps that the tip error asks for, and a step of the share."""
        error = observed.target - observed.tip
        is_near = np.hypot(*error.T) < self.near
        integral = np.where(is_near[:, None], memory.integral + error, 0.0)
        wanted = self.gain * error + self.integral_gain * integral
        limit = float(self.nominal.design.joint_limit)
        q, share = memory.commanded[:, :-1], memory.commanded[:, -1]
        goal = np.clip(q + self.resolved_rate(memory.configuration, wanted, self.damping), -limit, limit)
        step = self.gain * (observed.wanted - observed.log_stiffness) / self._slope(q, share)
        share = np.where(is_near, np.clip(share + np.clip(step, -0.1, 0.1), 0.0, 1.0), 1.0)
        return self.pulled(observed, memory._replace(integral=integral), np.column_stack([goal, share]))

    def _slope(self, q: np.ndarray, share: np.ndarray) -> np.ndarray:
        """How fast the logarithm of the stiffness grows with the share (n,), at least 0.1."""
        ends = []
        for at in (np.maximum(share - _STEP, 0.0), np.minimum(share + _STEP, 1.0)):
            tensions = tensions_between(self.nominal, (*q.T, at))
            stiffness = self.nominal.stiffness(tuple(q.T), tensions, direction=self.core.direction)
            ends.append((at, self.core.log_stiffness(np, stiffness)))
        (low, before), (high, after) = ends
        return np.asarray(np.maximum((after - before) / (high - low), 0.1))


class Oracle(TwoXPostures, two_x.Oracle):
    """As the closed form; where no straight joint path is feasible, a sampling planner finds one around."""

    knows = "the nominal design, which is the true one; plans paths inside the stable wrench-feasible set"

    def _paths(self, model: Any, start: np.ndarray, observed: DecodedObservation) -> list[np.ndarray]:
        goal, straight = self.chosen(start[:, :-1], observed)
        paths = [point[None] for point in goal]
        for i in np.flatnonzero(~straight):
            _, q, fits = self.fitting(observed.take(np.array([i])))
            q = q[:, fits]
            ends = q[:, np.flatnonzero(margin(self.nominal, q) > _LEAST)] if q.shape[1] else q
            around = connect(self._is_free, start[i, :-1], ends.T, float(self.nominal.design.joint_limit))
            if around:
                paths[i] = np.array(around)
        return self.stiffened(paths, observed.wanted)

    def _is_free(self, q: np.ndarray) -> np.ndarray:
        return np.asarray(margin(self.nominal, q) > _LEAST)


class NXClosedForm(NXPostures, ClosedForm):
    """The closed form of arms of more joints."""


class NXPseudoInverse(NXPostures, PseudoInverse):
    """Resolved rate of arms of more joints, with a null space that leads towards upright."""


class NXOracle(NXPostures, Oracle):
    """The oracle of arms of more joints."""
