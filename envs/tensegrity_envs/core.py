"""An environment as pure functions on components: mechanism x simulation x task, compiled.

`interface` says what it is and what happens in a step, `batch` runs that on matrices, `relabelling` evaluates steps for
other goals. Here are copies and pictures.
"""

import hashlib
import math
from collections.abc import Iterable
from copy import deepcopy
from functools import cached_property
from typing import Any

import numpy as np

from tensegrity_envs.interface import Sampled
from tensegrity_envs.options import share_options
from tensegrity_envs.relabelling import Relabelling
from tensegrity_envs.rendering import Scene, frame_around
from tensegrity_envs.simulation.protocol import FAILURES, Episode, State

__all__ = ["Core", "Sampled"]

_FRAMED = 256  # episodes whose starts and goals are in the frame of a picture


class Core(Relabelling):
    """An environment without its shell: what `Interface` asks for, on batches, with relabelled goals and pictures."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Show the shared options of a subclass in its signature and its help."""
        super().__init_subclass__(**kwargs)
        share_options(cls, cls.shared)

    def _made_on_use(self) -> dict[str, Any]:
        """Kernels, layouts and what else follows from the rest, as far as it has been made."""
        return {
            name: value
            for name, value in vars(self).items()
            if isinstance(getattr(type(self), name, None), cached_property)
        }

    def __getstate__(self) -> dict[str, Any]:
        """What a copy in another process needs: the rest is made anew, kernels from the disk."""
        made = self._made_on_use()
        return {name: value for name, value in vars(self).items() if name not in made}

    def __deepcopy__(self, memo: dict[int, Any]) -> "Core":
        """A copy with its own engine. Kernels and layouts never change and take long to make: both have them."""
        other = object.__new__(type(self))
        memo[id(self)] = other
        vars(other).update(deepcopy(self.__getstate__(), memo) | self._made_on_use())
        return other

    @cached_property
    def fingerprint(self) -> str:
        """A text by which states of this environment are known from those of others."""
        parts = (self.design, self.randomization, self.dynamics, self.task, self.episodes.rows, self.outcomes.rows)
        digest = hashlib.sha256(repr(parts).encode()).hexdigest()[:12]
        return f"{type(self).__name__} {digest}"

    def places(self, sampled: Sampled) -> Iterable[Any]:
        """Positions [m] of the nodes of planar arms at the start of episodes, for the frame of pictures."""
        return list(self.nominal.nodes(sampled.configuration).values())

    @cached_property
    def frame(self) -> tuple[tuple[float, float], float]:
        """Centre [m] and half of the side [m] of the square that pictures show: where the arm and its goals are."""
        sampled = self.sample(np.zeros(_FRAMED, np.int64), np.arange(_FRAMED))
        places = list(self.places(sampled))
        if self.error_unit == "mm":
            places.append(sampled.episode.goal_at(0.0))
        return frame_around(places)

    def error_text(self, error: float) -> str:
        """A distance to the goal for people: thousandths, or whole units for arms as large as a room, to a fiftieth of
        the tolerance or so.
        """
        whole = self.error_unit == "mm" and self.task.tolerance >= 0.02
        factor, unit = (1, self.error_unit.removeprefix("m")) if whole else (1000, self.error_unit)
        decimals = max(0, 1 - math.floor(math.log10(factor * self.task.tolerance)))
        return f"{factor * error:.{decimals}f} {unit}"

    def picture(self, episode: Episode, state: State, trace: list[Any], step: int) -> Scene:
        """What `draw` draws, in a plane."""
        error = float(self.error(np, self.achieved(state), episode.goal_at(state.time)))
        usual: dict[str, Any] = {
            "tip": state.tip,
            "target": episode.goal_at(state.time),
            "tolerance": self.task.tolerance,
            "trace": trace,
            "margins": {"stability": state.stability_margin, "wrench": state.wrench_margin},
            "caption": f"step {step}   {self.error_name.replace('_', ' ')} {self.error_text(error)}",
            "centre": self.frame[0],
            "reach": self.frame[1],
            "failure": FAILURES[state.failure],
        }
        return Scene(**(usual | self.scene(episode, state)))

    def spatial_picture(self, episode: Episode, state: State, trace: list[Any], step: int) -> Scene:
        """The same for MuJoCo's own pictures: of spatial mechanisms, positions have three components."""
        return self.picture(episode, state, trace, step)
