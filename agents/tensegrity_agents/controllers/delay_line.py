"""The actions that are still on the way, and after how many steps they are taken.

A controller knows the range of the delay. The measured inputs are those that act, without noise: from one step to the
next they change by the action that was taken, so what changed tells which of the latest actions that was. Delays that
do not fit are left out; the mean of the others is what is believed, and where none fits all are possible again.
"""

from typing import NamedTuple

import numpy as np

from tensegrity_envs.core import Core

_SAME = 1e-4  # of the inputs' range: single precision


class Line(NamedTuple):
    """What is on the way in n environments.

    Attributes:
        actions: the latest, the newest first, shape (n, longest delay + 1, inputs).
        possible: delays that fit, shape (n, longest delay + 1).
        inputs: measured before the newest action, shape (n, inputs).
    """

    actions: np.ndarray
    possible: np.ndarray
    inputs: np.ndarray

    @property
    def delay(self) -> np.ndarray:
        """Believed delay [steps], shape (n,)."""
        steps = np.arange(self.possible.shape[1])
        mean = (self.possible * steps).sum(axis=1) / self.possible.sum(axis=1)
        return np.asarray(np.ceil(mean - 0.5).astype(int))


def delays_of(core: Core) -> tuple[int, int]:
    """The least and the greatest delay that an environment may have [steps], which controllers know."""
    low, high = core.randomization.actuation_delay or (0, 0)
    return int(low), int(high)


def first_line(inputs: np.ndarray, delays: tuple[int, int]) -> Line:
    """Nothing is on the way, and the delay is within this range [steps]."""
    n, m = inputs.shape
    possible = np.zeros((n, delays[1] + 1), bool)
    possible[:, delays[0] :] = True
    return Line(np.zeros((n, delays[1] + 1, m)), possible, inputs)


def seen(line: Line, inputs: np.ndarray, rate: float, low: float, high: float) -> Line:
    """After a measurement of the inputs (n, inputs), a step after the newest action."""
    expected = np.clip(line.inputs[:, None] + rate * line.actions, low, high)
    fits = line.possible & (np.abs(expected - inputs[:, None]).max(axis=2) < _SAME * (high - low))
    possible = np.where(fits.any(axis=1)[:, None], fits, line.possible)
    return line._replace(possible=possible)


def sent(line: Line, inputs: np.ndarray, action: np.ndarray) -> Line:
    """With a new action (n, inputs), given when these inputs were measured."""
    actions = np.concatenate([action[:, None], line.actions[:, :-1]], axis=1)
    return line._replace(actions=actions, inputs=inputs)


def sent_instead(line: Line, action: np.ndarray) -> Line:
    """With another action (n, inputs) in the place of the newest one."""
    return line._replace(actions=np.concatenate([action[:, None], line.actions[:, 1:]], axis=1))
