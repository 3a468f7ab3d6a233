"""The entry "observation" of an environment: named fields, encoded, decoded and documented from one place.

An environment declares its fields once (`Core.observed`). The compiled step encodes them, controllers decode them into
SI units, and the tables of docs/environments.md list them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_envs.compiler.namespace import Component, Components, namespace_of
from tensegrity_envs.simulation.protocol import Episode, State

_RATE_SCALE = 0.2  # [s], of velocities
_SMALLEST = 1e-12  # of 1 - |v|: the inverse of v / (1 + |v|) stays finite


class Scaling(Protocol):
    """How a number in SI units becomes one or several within [-1, 1], and back."""

    @property
    def width(self) -> int:
        """How many numbers one component becomes."""
        ...

    def encode(self, value: Component) -> list[Component]:
        """The `width` numbers of a component; component code."""
        ...

    def decode(self, numbers: np.ndarray) -> np.ndarray:
        """The components, shape (n, size), of numbers of shape (n, width * size)."""
        ...


@dataclass(frozen=True)
class Divided:
    """x / scale.

    Attributes:
        scale: an upper bound of |x|, in the field's unit.
    """

    scale: float
    width = 1

    def encode(self, value: Component) -> list[Component]:
        """See `Scaling.encode`."""
        return [value / self.scale]

    def decode(self, numbers: np.ndarray) -> np.ndarray:
        """See `Scaling.decode`."""
        return self.scale * numbers

    def __str__(self) -> str:
        """A text for tables."""
        return f"x / {float(self.scale):.5g}"


@dataclass(frozen=True)
class Between:
    """A scale from -1 at the lowest to 1 at the highest value.

    Attributes:
        low: lowest value, in the field's unit.
        high: highest value.
    """

    low: Component
    high: Component
    width = 1

    def encode(self, value: Component) -> list[Component]:
        """See `Scaling.encode`."""
        return [(2 * value - (self.high + self.low)) / (self.high - self.low)]

    def decode(self, numbers: np.ndarray) -> np.ndarray:
        """See `Scaling.decode`."""
        return np.asarray((numbers * (self.high - self.low) + self.high + self.low) / 2)

    def __str__(self) -> str:
        """A text for tables."""
        return f"-1 at {float(self.low):.5g}, 1 at {float(self.high):.5g}"


@dataclass(frozen=True)
class SineAndCosine:
    """The sine and the cosine of an angle [rad], one after the other; decoded into (-pi, pi]."""

    width = 2

    def encode(self, value: Component) -> list[Component]:
        """See `Scaling.encode`."""
        xp = namespace_of(value)
        return [xp.sin(value), xp.cos(value)]

    def decode(self, numbers: np.ndarray) -> np.ndarray:
        """See `Scaling.decode`."""
        return np.asarray(np.arctan2(numbers[:, 0::2], numbers[:, 1::2]))

    def __str__(self) -> str:
        """A text for tables."""
        return "sin x, cos x"


@dataclass(frozen=True)
class Softsign:
    """v / (1 + |v|) with v = x / scale: any number fits, and those around zero are resolved best.

    Attributes:
        scale: the value that becomes 1/2, in the field's unit; 1 by default.
    """

    scale: float | None = None
    width = 1

    def encode(self, value: Component) -> list[Component]:
        """See `Scaling.encode`."""
        v = value if self.scale is None else value / self.scale
        return [v / (1 + abs(v))]

    def decode(self, numbers: np.ndarray) -> np.ndarray:
        """See `Scaling.decode`."""
        scaled = numbers if self.scale is None else self.scale * numbers
        return np.asarray(scaled / np.maximum(1 - np.abs(numbers), _SMALLEST))

    def __str__(self) -> str:
        """A text for tables."""
        return "x / (1 + |x|)" if self.scale is None else f"v / (1 + |v|), v = x / {float(self.scale):.5g}"


@dataclass(frozen=True)
class SoftsignRate:
    """v / (1 + |v|) with v = 0.2 s times the rate; of a velocity [m/s], divided by a length.

    Attributes:
        length: what velocities are divided by [m]; None for rates of angles [rad/s].
    """

    length: float | None = None
    width = 1

    def encode(self, value: Component) -> list[Component]:
        """See `Scaling.encode`."""
        rate = value if self.length is None else value / self.length
        return [_RATE_SCALE * rate / (1 + abs(_RATE_SCALE * rate))]

    def decode(self, numbers: np.ndarray) -> np.ndarray:
        """See `Scaling.decode`."""
        rates = numbers / np.maximum(1 - np.abs(numbers), _SMALLEST) / _RATE_SCALE
        return np.asarray(rates if self.length is None else rates * self.length)

    def __str__(self) -> str:
        """A text for tables."""
        length = "" if self.length is None else f" / {float(self.length):.5g}"
        return f"v / (1 + |v|), v = {_RATE_SCALE:g} x{length}"


@dataclass(frozen=True)
class Field:
    """One quantity in the entry "observation".

    Attributes:
        name: under which controllers find it.
        values: the quantity in SI units: a function of state and episode, component code.
        size: the number of its components; None for a single number, which is decoded to shape (n,).
        scaling: how each component becomes numbers within [-1, 1].
        unit: the unit of the components, such as "m".
        meaning: what it is, for tables.
    """

    name: str
    values: Callable[[State, Episode], Components]
    size: int | None
    scaling: Scaling
    unit: str
    meaning: str

    @property
    def width(self) -> int:
        """How many numbers of the observation it takes."""
        return self.scaling.width * (1 if self.size is None else self.size)

    def encode(self, values: Components) -> list[Component]:
        """Its numbers, for values in SI units; component code."""
        return [number for value in values for number in self.scaling.encode(value)]

    def decode(self, numbers: np.ndarray) -> np.ndarray:
        """Its values in SI units, shape (n, size) or (n,), from its numbers of shape (n, width)."""
        decoded = self.scaling.decode(numbers)
        return decoded[:, 0] if self.size is None else decoded


class DecodedObservation:
    """A batch of n observations in SI units.

    It has an attribute for every field of the environment, of shape (n, size) or (n,); the achieved goal by its name
    (in most environments `tip`) and the desired goal as `target`, in the precision of those entries; and `inputs`,
    whatever the inputs are called. `name in observation` tells whether something is observed.
    """

    def __init__(self, values: Mapping[str, np.ndarray]) -> None:
        vars(self).update(values)

    def __getattr__(self, name: str) -> np.ndarray:
        """Python asks this for what is not there.

        Raises:
            AttributeError: always; the message says what is observed.
        """
        hint = "; velocities are with observe_velocities = True" if name in ("joint_rates", "tip_velocity") else ""
        raise AttributeError(f"{name!r} is not observed; there are {', '.join(vars(self))}{hint}")

    def __repr__(self) -> str:
        shapes = ", ".join(f"{name}: {np.shape(value)}" for name, value in vars(self).items())
        return f"{type(self).__name__}({shapes})"

    def __contains__(self, name: str) -> bool:
        """Whether there is such a quantity."""
        return name in vars(self)

    def __len__(self) -> int:
        """The size of the batch."""
        return len(self.target)

    def take(self, index: np.ndarray) -> "DecodedObservation":
        """The observations of some of the environments."""
        return DecodedObservation({name: value[index] for name, value in vars(self).items()})

    def replace(self, **values: np.ndarray) -> "DecodedObservation":
        """The observations with other values of some quantities."""
        return DecodedObservation(vars(self) | values)


class ObservationSchema:
    """The fields of an environment's observation, in their order.

    Args:
        fields: one after the other.
        goal: name of the achieved goal in decoded observations; it takes the place of a field of that name, which is
            the same quantity, scaled.
        inputs: name of the field that holds the inputs; empty where there is none.

    Attributes:
        fields: the fields by name.
        places: which numbers of the observation each of them takes, by name.
        size: the number of numbers in an observation.
    """

    def __init__(self, fields: Sequence[Field], goal: str = "tip", inputs: str = "") -> None:
        self.fields = {field.name: field for field in fields}
        if len(self.fields) != len(fields):
            raise ValueError(f"fields of an observation: {[field.name for field in fields]} has a name twice")
        ends = [0]
        for field in fields:
            ends.append(ends[-1] + field.width)
        self.places = {field.name: slice(*ends) for field, ends in zip(fields, pairwise(ends), strict=True)}
        self.size, self._goal, self._inputs = ends[-1], goal, inputs

    def __repr__(self) -> str:
        sizes = ", ".join(f"{name}: {field.width}" for name, field in self.fields.items())
        return f"{type(self).__name__}({sizes})"

    def encode(self, state: State, episode: Episode) -> list[Component]:
        """The numbers of the entry "observation", each within [-1, 1]; component code."""
        return [number for field in self.fields.values() for number in field.encode(field.values(state, episode))]

    def decode(self, observation: Mapping[str, ArrayLike]) -> DecodedObservation:
        """Observations in SI units.

        Args:
            observation: a batch of observations: "observation" of shape (n, size), "achieved_goal" and "desired_goal"
                of shape (n, goal size).

        Raises:
            ValueError: it is no dict, or an entry has another shape; of a single observation the message says how it
                becomes a batch.
        """
        if not isinstance(observation, Mapping):
            raise ValueError(
                f"observation: {type(observation).__name__}, must be the environment's dict of observation, "
                "achieved_goal and desired_goal, in batches"
            )
        vector = np.asarray(observation["observation"], float)
        if vector.ndim == 1 and vector.size == self.size:
            raise ValueError(
                f"observation of shape {vector.shape}: one alone; must be a batch of shape (n, {self.size}): "
                "give {name: value[None] for name, value in observation.items()}"
            )
        if vector.ndim != 2 or vector.shape[1] != self.size:
            raise ValueError(f"observation of shape {vector.shape}: must be a batch of shape (n, {self.size})")
        for name in ("achieved_goal", "desired_goal"):
            shape = np.shape(observation[name])
            if len(shape) != 2 or shape[0] != len(vector):
                raise ValueError(f"{name} of shape {shape}: must be a batch of shape ({len(vector)}, goal size)")
        values = {name: field.decode(vector[:, self.places[name]]) for name, field in self.fields.items()}
        values[self._goal] = np.asarray(observation["achieved_goal"], float)
        values["target"] = np.asarray(observation["desired_goal"], float)
        if self._inputs:
            values["inputs"] = values[self._inputs]
        return DecodedObservation(values)

    def with_values(self, observation: Mapping[str, ArrayLike], name: str, values: np.ndarray) -> dict[str, np.ndarray]:
        """The same observations, encoded, but for one field.

        Args:
            observation: as for `decode`.
            name: the field's name, or "inputs".
            values: its values in SI units, shape (n, size).
        """
        name = self._inputs if name == "inputs" else name
        vector = np.array(observation["observation"], float)
        vector[:, self.places[name]] = np.stack(self.fields[name].encode(tuple(values.T)), axis=1)
        return {**{key: np.asarray(value) for key, value in observation.items()}, "observation": vector}


class WithJacobian(Protocol):
    """A mechanism whose joint rates and tip velocity are connected by a Jacobian."""

    def jacobian(self, q: Components) -> Sequence[Sequence[Component]]:
        """The rows d tip / d q."""
        ...


def tip_field(reach: float, size: int = 2) -> Field:
    """The position of the tip, which is at most the reach [m] away from the base."""
    return Field("tip", lambda state, _: state.tip, size, Divided(reach), "m", "position of the tip")


def inputs_field(name: str, size: int, bounds: tuple[Component, Component], unit: str, meaning: str) -> Field:
    """The inputs, within their bounds."""
    return Field(name, lambda state, _: state.inputs, size, Between(*bounds), unit, meaning)


def joint_angles_field(size: int, meaning: str = "joint angles") -> Field:
    """The configuration, where it is joint angles."""
    return Field("joint_angles", lambda state, _: state.configuration, size, SineAndCosine(), "rad", meaning)


def margin_fields() -> list[Field]:
    """Stability margin and wrench margin, both positive where all is well."""
    values = {
        "stability_margin": lambda state, _: (state.stability_margin,),
        "wrench_margin": lambda state, _: (state.wrench_margin,),
    }
    return [Field(name, of, None, Softsign(), "-", name.replace("_", " ")) for name, of in values.items()]


def rates_of(state: State, count: int) -> Components:
    """The rates of a mechanism's coordinates; those of a quasi-static one are zero."""
    return state.velocity or (0.0 * state.tip[0],) * count


def joint_rates_field(size: int, meaning: str = "rates of the joint angles") -> Field:
    """The rates of the coordinates of a dynamic simulation."""
    return Field("joint_rates", lambda state, _: rates_of(state, size), size, SoftsignRate(), "rad/s", meaning)


def tip_velocity_field(mechanism: WithJacobian, reach: float, joints: int) -> Field:
    """The velocity of the tip, from joint rates and Jacobian."""

    def velocity(state: State, episode: Episode) -> Components:
        rates = rates_of(state, joints)
        rows = mechanism.jacobian(state.configuration)
        return tuple(sum(d * rate for d, rate in zip(row, rates, strict=True)) for row in rows)

    return Field("tip_velocity", velocity, 2, SoftsignRate(reach), "m/s", "velocity of the tip")


def arm_fields(
    mechanism: WithJacobian, reach: float, inputs: Field, joints: int, is_full: bool, velocities: bool
) -> list[Field]:
    """What the planar arms with joint angles observe.

    Args:
        mechanism: nominal.
        reach: upper bound of the tip's distance from the base [m].
        inputs: see `inputs_field`.
        joints: the number of joint angles.
        is_full: whether joint angles and margins are observed.
        velocities: whether velocities are: of the joints, or, without full observability, of the tip.
    """
    fields = [tip_field(reach), inputs]
    if is_full:
        fields += [joint_angles_field(joints), *margin_fields()]
    if velocities:
        fields.append(joint_rates_field(joints) if is_full else tip_velocity_field(mechanism, reach, joints))
    return fields
