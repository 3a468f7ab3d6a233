"""What the nominal planar 4-bar mechanism tells an agent about an episode under an unknown force."""

from typing import Any, NamedTuple, cast

import numpy as np

from tensegrity_agents.controllers.base import renewed
from tensegrity_agents.controllers.planar_four_bar.hints import Hints
from tensegrity_agents.controllers.planar_four_bar.planning import ends
from tensegrity_agents.controllers.planar_four_bar.reading import (
    NOTICEABLE,
    Reading,
    configuration,
    force_across,
    identified,
    read,
    side,
    with_posture,
)
from tensegrity_envs.mechanics.detour import shortest_way
from tensegrity_envs.simulation.actuator_lengths import LoadedLengthControl, wrench_margin

_PLACES = 8  # inverse solutions that are kept
_THERE = 0.02  # so close an end counts as reached, in largest steps
_KNOWN = 1e-3  # information about the less known component of the force with which it is half known


class Memory(NamedTuple):
    """What has been seen of n episodes.

    Attributes:
        information: see `reading.with_posture`, (n, 2, 2).
        evidence: see `reading.with_posture`, (n, 2) [N].
        load: for which the ends were found, (n, 2) [N]; NaN for none.
        ends: actuator lengths that hold the target, (n, 8, 2) [m]; infinite where there are fewer.
    """

    information: np.ndarray
    evidence: np.ndarray
    load: np.ndarray
    ends: np.ndarray


class LoadedHints(Hints):
    """The same under a force, which two postures reveal; so these remember what an episode has shown."""

    size = 15

    def __call__(self, observation: Any, memory: Memory | None, begins: np.ndarray) -> tuple[np.ndarray, Memory]:
        """What is told.

        Args:
            observation: Dict of arrays of shape (n, ...).
            memory: of the observations before; None at first.
            begins: which of them begin an episode, shape (n,).

        Returns:
            Shape (n, 15): as `Hints`, but for the solutions and the stability margin under the force that the postures
            of the episode have revealed; that force, divided by K L (2); how well it is known, from 0 to 1 (1). And the
            memory.
        """
        reading = read(observation, self.core)
        here, push = side(self.nominal, reading), force_across(self.nominal, reading)
        n = len(here)
        nothing = Memory(
            np.zeros((n, 2, 2)), np.zeros((n, 2)), np.full((n, 2), np.nan), np.full((n, _PLACES, 2), np.inf)
        )
        before = renewed(begins, nothing, memory)
        information, evidence = with_posture(before.information, before.evidence, *push)
        load = identified(self.nominal, information, evidence)
        force = float(self.nominal.largest_force)
        again = np.flatnonzero(~(np.hypot(*(load - before.load).T) < NOTICEABLE * force))  # NaN: never found
        places, found_for = before.ends.copy(), before.load.copy()
        places[again] = self._ends(reading.take(again), here[again], load[again])
        found_for[again] = load[again]
        # An end that has been reached away from the target is one of another branch.
        away = np.hypot(*(reading.target - reading.tip).T) > self.core.task.tolerance
        reached = np.abs(places - reading.lengths[:, None]).max(axis=2) < _THERE * self.rate
        places[away[:, None] & reached] = np.inf
        least = np.linalg.eigvalsh(information)[:, 0]
        columns = [
            self._columns(reading, here, self._nearest(reading, here, places), push, load),
            load / force,
            (least / (least + _KNOWN))[:, None],
        ]
        return np.concatenate(columns, axis=1), Memory(information, evidence, found_for, places)

    def _ends(self, reading: Reading, here: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Actuator lengths (n, 8, 2) [m] that hold the target; on the side of the tip, where there are any."""
        nominal, simulation = self.nominal, cast(LoadedLengthControl, self.core.simulation)
        low, high = simulation.bounds(nominal)
        owner, lengths = ends(nominal, reading.target, load, (float(low), float(high)))
        there = Reading(reading.target[owner], reading.target[owner], lengths)
        state = tuple(configuration(nominal, there).T), tuple(lengths.T), tuple(load[owner].T)
        good = (np.asarray(nominal.stability_margin(*state)) >= self.margin) & (wrench_margin(nominal, *state) >= 0)
        same = side(nominal, there) == here[owner]
        has_same = np.zeros(len(here), bool)
        has_same[owner[good & same]] = True
        kept = np.flatnonzero(good & (same | ~has_same[owner]))
        kept = kept[np.argsort(owner[kept], kind="stable")]
        rank = np.arange(len(kept)) - np.searchsorted(owner[kept], owner[kept])
        found = np.full((len(here), _PLACES, 2), np.inf)
        fits = rank < _PLACES
        found[owner[kept[fits]], rank[fits]] = lengths[kept[fits]]
        return found

    def _nearest(self, reading: Reading, here: np.ndarray, places: np.ndarray) -> np.ndarray:
        """The nearest of the places (n, 8, 2), or where there is none what holds near the target without a load."""
        exists = np.isfinite(places[:, :, 0])
        somewhere = np.where(exists[:, :, None], places, 0.0)
        start = tuple(reading.lengths.T[:, :, None])
        way, _ = shortest_way(start, tuple(np.moveaxis(somewhere, 2, 0)), self.obstacle)
        end: np.ndarray = somewhere[np.arange(len(here)), np.where(exists, way, np.inf).argmin(axis=1)]
        none = np.flatnonzero(~exists.any(axis=1))
        if len(none):
            end[none] = self._end(reading.take(none), here[none])
        return end
