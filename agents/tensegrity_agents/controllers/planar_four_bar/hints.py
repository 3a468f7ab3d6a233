"""What the nominal, unloaded planar 4-bar mechanism tells an agent about an observation."""

from typing import Any

import numpy as np

from tensegrity_agents.controllers.planar_four_bar.reading import configuration, force_across, read, resolved_rate, side
from tensegrity_envs.core import Core
from tensegrity_envs.mechanics.detour import shortest_way
from tensegrity_envs.mechanics.planar_four_bar.inverse import rectangles
from tensegrity_envs.simulation.actuator_lengths import around_meeting, is_open

SIZE = 12
_DAMPING = 0.1  # of the pseudo-inverse


def hints(observation: Any, core: Core) -> np.ndarray:
    """Where the target is for the nominal mechanism, and how much it is pushed.

    Which of up to four inverse solutions is the nearest is a function with many folds, hard to learn from positions.

    Args:
        observation: Dict of arrays of shape (n, ...).
        core: of the environment.

    Returns:
        Shape (n, 12): the gap from the actuator lengths to the nearest inverse solution on the side of the tip without
        a load, or to the corner of the way there that keeps off where C and D meet (2), as a share of 2 L, and as tanh
        of one and of ten times gap / largest step (4), all zero where there is none; the same tanh of ten times the
        step that the Jacobian tells (2); the direction across bar CF (2); the force on F along it, divided by K L (1);
        the stability margin m, were that all of the force, as m / (1 + |m|) (1).
    """
    nominal = core.nominal
    sampler: Any = core.sampler  # type: ignore[attr-defined]
    reading, rate = read(observation, core), core.simulation.rate
    here = side(nominal, reading)
    found, sides, exists = rectangles(nominal, *reading.target.T)
    fits = exists & (sides == here) & is_open(nominal, tuple(found), sampler.safe_margin)
    way, corner = shortest_way(tuple(reading.lengths.T), tuple(found), around_meeting(nominal))
    nearest = np.where(fits, way, np.inf).argmin(axis=0)
    rows = np.arange(len(nearest))
    gap = np.where(fits[nearest, rows], np.stack(corner)[:, nearest, rows] - reading.lengths.T, 0.0).T
    step = resolved_rate(nominal, reading.lengths, here, reading.target - reading.tip, _DAMPING)
    across, force = force_across(nominal, reading)
    q = configuration(nominal, reading)
    margin = nominal.stability_margin(tuple(q.T), tuple(reading.lengths.T), tuple((across * force[:, None]).T))
    margin = np.asarray(margin / (1 + np.abs(margin)))
    share = np.clip(force / float(nominal.largest_force), -3.0, 3.0)
    parts = [gap / (2 * float(nominal.length)), np.tanh(gap / rate), np.tanh(10 * gap / rate)]
    parts.append(np.tanh(10 * step / rate))
    return np.concatenate([*parts, across, share[:, None], margin[:, None]], axis=1)
