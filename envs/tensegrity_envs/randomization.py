"""What may differ from episode to episode, without the controllers knowing."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

import numpy as np

from tensegrity_envs.seeding import EpisodeStream, uniform

_FIRST_DRAW = 1 << 22  # beyond every draw of the episodes' starts and targets
_LEVEL_DRAW = _FIRST_DRAW + 64  # beyond all other quantities
_FACTORS = ("stiffness", "mass", "damping", "friction", "bandwidth")
_KEYS = 2.0**53
_LONGEST_DELAY = 200  # steps
_AHEAD = 64  # steps whose noise is computed at once for a single environment, which takes as long as that of one step


@dataclass(frozen=True)
class Randomization:
    """Ranges of what is sampled for every episode, uniformly; None leaves a quantity as it is.

    `info` holds the sampled values as random_<name>; controllers do not see them.

    Attributes:
        stiffness: factor of all spring stiffnesses.
        mass: factor of all masses of bars or platform, and of the mass at the tip.
        damping: factor of the joints' viscous damping.
        friction: factor of the joints' dry friction, where there is any.
        bandwidth: factor of the bandwidth of the actuators, where they lag.
        payload: at the tip [kg].
        actuation_delay: whole steps after which an action is taken; until then the inputs stay as they are.
        tip_noise: standard deviation of the measured tip position, in each direction [m].
        angle_noise: standard deviation of the measured joint angles [rad].
    """

    stiffness: tuple[float, float] | None = None
    mass: tuple[float, float] | None = None
    damping: tuple[float, float] | None = None
    friction: tuple[float, float] | None = None
    bandwidth: tuple[float, float] | None = None
    payload: tuple[float, float] | None = None
    actuation_delay: tuple[int, int] | None = None
    tip_noise: float = 0.0
    angle_noise: float = 0.0

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            ValueError: a range is not (low, high) with low <= high, or a number is out of range; the message names it.
        """
        for name in ("stiffness", "mass", "damping", "friction", "bandwidth", "payload", "actuation_delay"):
            given = getattr(self, name)
            if given is None:
                continue
            above = name in ("stiffness", "mass", "bandwidth")
            try:
                low, high = given
                fine = bool(np.isfinite([low, high]).all()) and (low > 0 if above else low >= 0) and low <= high
                fine &= not (isinstance(low, bool) or isinstance(high, bool))
                fine &= name != "actuation_delay" or (int(low) == low and int(high) == high and high <= _LONGEST_DELAY)
            except (TypeError, ValueError):
                fine = False
            if not fine:
                what = f"whole numbers up to {_LONGEST_DELAY}, " if name == "actuation_delay" else ""
                what += "0 < " if above else "0 <= "
                raise ValueError(f"randomization: {name} = {given!r}: must be (low, high), {what}low <= high")
            object.__setattr__(self, name, tuple(given))
        for name in ("tip_noise", "angle_noise"):
            value = getattr(self, name)
            is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
            if not (is_number and np.isfinite(value) and value >= 0):
                raise ValueError(f"randomization: {name} = {value!r}: must be zero or positive")

    @classmethod
    def given(
        cls, randomization: "Mapping[str, Any] | Randomization | None", applicable: Collection[str], where: str
    ) -> "Randomization":
        """The randomization of names and ranges.

        Args:
            randomization: ranges by name, or None for none.
            applicable: names of the quantities that the environment has.
            where: the environment, for the message.

        Raises:
            ValueError: a name is unknown or does not apply, or a range is wrong.
            TypeError: it is neither.
        """
        if not isinstance(randomization, cls | Mapping | None):
            raise TypeError(f"randomization = {randomization!r}: must be a dict such as {{'stiffness': (0.9, 1.1)}}")
        names = {field.name for field in fields(cls)}
        if isinstance(randomization, Mapping):
            for name in randomization:
                if name not in names:
                    raise ValueError(f"randomization: there is no {name!r}; there are {', '.join(sorted(applicable))}")
            randomization = cls(**randomization)
        result = randomization or cls()
        for name in result.names:
            if name not in applicable:
                raise ValueError(
                    f"randomization: {name!r} does not apply to {where}; there are {', '.join(sorted(applicable))}"
                )
        return result

    @property
    def names(self) -> list[str]:
        """The names of what is randomized."""
        default = Randomization.__dataclass_fields__
        return [name for name in default if getattr(self, name) != default[name].default]

    @property
    def longest_delay(self) -> int:
        """The longest delay of an action, in steps."""
        return int(self.actuation_delay[1]) if self.actuation_delay else 0

    @property
    def is_noisy(self) -> bool:
        """Whether the sensors are noisy."""
        return self.tip_noise > 0 or self.angle_noise > 0

    def sample(self, seed: np.ndarray, episode: np.ndarray) -> dict[str, np.ndarray]:
        """The sampled values of (seed, episode) pairs, both of shape (n,), by name; all but the payload."""
        stream = EpisodeStream(seed, episode, _FIRST_DRAW)
        sampled: dict[str, np.ndarray] = {}
        for name in ("stiffness", "mass", "damping"):
            number = stream.uniform()  # taken in any case, so that one range does not change another one's numbers
            self._put(sampled, name, number)
        number = stream.uniform()
        if self.actuation_delay is not None:
            low, high = self.actuation_delay
            sampled["actuation_delay"] = np.minimum(np.floor(low + (high - low + 1) * number), high)
        number = stream.uniform()
        if self.is_noisy:
            sampled["noise_key"] = np.floor(_KEYS * number)
        for name in ("friction", "bandwidth"):
            self._put(sampled, name, stream.uniform())
        return sampled

    def _put(self, sampled: dict[str, np.ndarray], name: str, number: np.ndarray) -> None:
        """Add a quantity to what was sampled, if it is randomized; `number` is uniform in [0, 1)."""
        if getattr(self, name) is not None:
            low, high = getattr(self, name)
            sampled[name] = low + (high - low) * number

    def noise_shares(self, random: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray] | None:
        """Standard deviations of the episodes' noise of tip and angles, as shares of `tip_noise` and `angle_noise`.

        Args:
            random: what was sampled for the episodes, by name, each of shape (n,).

        Returns:
            Both of shape (n,); None where all are 1.
        """
        return None

    @staticmethod
    def normals(key: np.ndarray, step: np.ndarray, count: int) -> np.ndarray:
        """Standard normal numbers of shape (count, n): functions of (key, step) alone, for each of n environments."""
        if len(key) != 1:
            return _normals(key, step, count)
        block, place = divmod(int(step[0]), _AHEAD)
        return _normals_ahead(int(key[0]), block * _AHEAD, count)[:, place : place + 1]


@dataclass(frozen=True)
class DrawnLevel(Randomization):
    """One of several randomizations, of which each episode draws one; info tells it as random_level.

    The ranges are those that hold all of them, for who is told ranges. An episode has the numbers that it has where
    its own randomization is the only one.

    Attributes:
        levels: their numbers.
        parts: the randomizations.
    """

    levels: tuple[int, ...] = ()
    parts: tuple[Randomization, ...] = ()

    @classmethod
    def of(cls, levels: tuple[int, ...], parts: Sequence[Randomization]) -> "DrawnLevel":
        """That of these levels."""
        whole: dict[str, Any] = {}
        for name in (*_FACTORS, "payload", "actuation_delay"):
            usual = (1.0, 1.0) if name in _FACTORS else (0, 0)
            ranges = [getattr(part, name) for part in parts]
            if any(given is not None for given in ranges):
                low, high = zip(*(given or usual for given in ranges), strict=True)
                whole[name] = (min(low), max(high))
        for name in ("tip_noise", "angle_noise"):
            whole[name] = max(getattr(part, name) for part in parts)
        return cls(**whole, levels=levels, parts=tuple(parts))

    def _drawn(self, seed: np.ndarray, episode: np.ndarray) -> np.ndarray:
        """Which of the parts it is, shape (n,)."""
        number = EpisodeStream(seed, episode, _LEVEL_DRAW).uniform()
        drawn: np.ndarray = np.minimum((len(self.parts) * number).astype(int), len(self.parts) - 1)
        return drawn

    def sample(self, seed: np.ndarray, episode: np.ndarray) -> dict[str, np.ndarray]:
        """See `Randomization.sample`; the number of the level is "level"."""
        drawn, sampled = self._drawn(seed, episode), super().sample(seed, episode)
        each = [part.sample(seed, episode) for part in self.parts]
        for name, value in sampled.items():
            if name != "noise_key":  # it is the same for all
                usual = np.full(len(value), 1.0 if name in _FACTORS else 0.0)
                sampled[name] = np.choose(drawn, [one.get(name, usual) for one in each])
        return sampled | {"level": np.array(self.levels, float)[drawn]}

    def noise_shares(self, random: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """See `Randomization.noise_shares`."""
        drawn = (np.asarray(random["level"])[:, None] == np.array(self.levels)).argmax(axis=1)
        tip, angles = (
            np.array([getattr(part, name) for part in self.parts]) / (getattr(self, name) or 1.0)
            for name in ("tip_noise", "angle_noise")
        )
        return tip[drawn], angles[drawn]


def _normals(key: np.ndarray, step: np.ndarray, count: int) -> np.ndarray:
    from scipy.special import ndtri  # slow to import, and only needed here

    place = step.astype(np.int64) * count + np.arange(count)[:, None]
    numbers = uniform(key.astype(np.int64)[None], np.zeros((1, 1), np.int64), place)
    return np.asarray(ndtri(numbers + 2.0**-54))


@lru_cache(maxsize=256)
def _normals_ahead(key: int, first: int, count: int) -> np.ndarray:
    """Those of one environment and the steps from `first` on, shape (count, _AHEAD)."""
    numbers = _normals(np.array([key]), np.arange(first, first + _AHEAD), count)
    numbers.flags.writeable = False  # everybody's
    return numbers
