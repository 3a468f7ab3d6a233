"""Model-based features of the nominal planar 4-bar mechanism under an unknown force."""

from typing import NamedTuple, cast

import numpy as np

from tensegrity_agents.controllers.base import Observation, with_rows
from tensegrity_agents.controllers.planar_four_bar.features import Features
from tensegrity_agents.controllers.planar_four_bar.measurements import (
    NOTICEABLE,
    configuration,
    force_across,
    identified,
    side,
    with_posture,
)
from tensegrity_agents.controllers.planar_four_bar.planning import ends, trips
from tensegrity_envs.geometry.obstacle_path import shortest_path
from tensegrity_envs.observation import DecodedObservation
from tensegrity_envs.simulation.actuator_lengths import LoadedLengthControl

_PLACES = 8  # inverse solutions that are kept
_KNOWN = 1e-3  # information about the less known component of the force with which it is half known


class Memory(NamedTuple):
    """What has been seen of n episodes.

    Attributes:
        information: see `measurements.with_posture`, (n, 2, 2).
        evidence: see `measurements.with_posture`, (n, 2) [N].
        load: for which the ends were found, (n, 2) [N]; NaN for none.
        ends: actuator lengths that hold the target, (n, 8, 2) [m]; infinite where there are fewer.
        far: what to add to the path to an end to which it does not lead in the nominal model, (n, 8) [m].
    """

    information: np.ndarray
    evidence: np.ndarray
    load: np.ndarray
    ends: np.ndarray
    far: np.ndarray


class LoadedFeatures(Features):
    """The same under a force, which two postures reveal; so these remember what an episode has shown."""

    size = 15

    def __call__(
        self, observation: Observation, memory: Memory | None, begins: np.ndarray
    ) -> tuple[np.ndarray, Memory]:
        """The features.

        Args:
            observation: Dict of arrays of shape (n, ...).
            memory: of the observations before; None at first.
            begins: which of them begin an episode, shape (n,).

        Returns:
            Shape (n, 15): as those of `Features`, but for the solutions and the stability margin under the force that
            the postures of the episode have revealed; that force, divided by K L (2); how well it is known, from 0 to
            1 (1). And the memory.
        """
        observed = self.core.schema.decode(observation)
        here, push = side(self.nominal, observed), force_across(self.nominal, observed)
        new = np.flatnonzero(begins)
        n = len(new)
        nothing = Memory(
            np.zeros((n, 2, 2)),
            np.zeros((n, 2)),
            np.full((n, 2), np.nan),
            np.full((n, _PLACES, 2), np.inf),
            np.zeros((n, _PLACES)),
        )
        before = with_rows(memory, new, nothing)
        information, evidence = with_posture(before.information, before.evidence, *push)
        load = identified(self.nominal, information, evidence)
        force = float(self.nominal.largest_force)
        again = np.flatnonzero(~(np.hypot(*(load - before.load).T) < NOTICEABLE * force))  # NaN: never found
        places, far, found_for = before.ends.copy(), before.far.copy(), before.load.copy()
        places[again], far[again] = self._ends(observed.take(again), load[again])
        found_for[again] = load[again]
        least = np.linalg.eigvalsh(information)[:, 0]
        columns = [
            self._columns(observed, here, self._nearest(observed, here, places, far), push, load),
            load / force,
            (least / (least + _KNOWN))[:, None],
        ]
        return np.concatenate(columns, axis=1), Memory(information, evidence, found_for, places, far)

    def _ends(self, observed: DecodedObservation, load: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Actuator lengths (n, 8, 2) [m] that hold the target, and what to add to the path there (n, 8) [m]."""
        nominal, simulation = self.nominal, cast(LoadedLengthControl, self.core.simulation)
        low, high = simulation.bounds(nominal)
        owner, lengths = ends(nominal, observed.target, load, (float(low), float(high)))
        there = observed.take(owner)
        there = there.replace(tip=there.target, actuator_lengths=lengths)
        state = tuple(configuration(nominal, there).T), tuple(lengths.T), tuple(load[owner].T)
        good = (np.asarray(nominal.stability_margin(*state)) >= self.margin) & (nominal.wrench_margin(*state) >= 0)
        owner, lengths = owner[good], lengths[good]
        start = observed.take(owner)
        _, corner = shortest_path(tuple(start.actuator_lengths.T), tuple(lengths.T), self.obstacle)
        points = np.stack([start.actuator_lengths, np.stack(corner, axis=1), lengths, lengths], axis=1)
        tip, margin = trips(nominal, configuration(nominal, start), points, load[owner])
        leads = (np.hypot(*(tip - start.target).T) < self.core.task.tolerance) & (margin > 0)
        order = np.lexsort((~leads, owner))
        owner, lengths, leads = owner[order], lengths[order], leads[order]
        rank = np.arange(len(owner)) - np.searchsorted(owner, owner)
        kept = rank < _PLACES
        found, far = np.full((len(load), _PLACES, 2), np.inf), np.zeros((len(load), _PLACES))
        found[owner[kept], rank[kept]] = lengths[kept]
        far[owner[kept], rank[kept]] = np.where(leads[kept], 0.0, 10 * float(nominal.length))  # more than all paths
        return found, far

    def _nearest(
        self, observed: DecodedObservation, here: np.ndarray, places: np.ndarray, far: np.ndarray
    ) -> np.ndarray:
        """The nearest of the places (n, 8, 2), or where there is none what holds near the target without a load."""
        exists = np.isfinite(places[:, :, 0])
        somewhere = np.where(exists[:, :, None], places, 0.0)
        start = tuple(observed.actuator_lengths.T[:, :, None])
        length, _ = shortest_path(start, tuple(np.moveaxis(somewhere, 2, 0)), self.obstacle)
        end: np.ndarray = somewhere[np.arange(len(here)), np.where(exists, length + far, np.inf).argmin(axis=1)]
        none = np.flatnonzero(~exists.any(axis=1))
        if len(none):
            end[none] = self._end(observed.take(none), here[none])
        return end
