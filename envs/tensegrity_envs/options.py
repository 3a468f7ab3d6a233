"""The options that all environments share: one object, shown in the signature and the help of each of them.

A constructor names its own options and takes the others as `**shared`:

    def __init__(self, payload_range: tuple[float, float] | None = None, **shared: Any) -> None:
        options = Options.of(type(self), shared)
"""

import dataclasses
import inspect
import re
import textwrap
from collections.abc import Collection, Iterable, Mapping, Sequence
from difflib import get_close_matches
from typing import Any, Literal

import numpy as np

from tensegrity_envs.randomization import DrawnLevel, Randomization
from tensegrity_envs.simulation.mujoco.dynamics import Dynamics
from tensegrity_envs.tasks import Weights
from tensegrity_envs.uncertainty import checked_levels, ranges_of

_WIDTH = 112


@dataclasses.dataclass(frozen=True, kw_only=True)
class Options:
    """Options that all environments share.

    Attributes:
        design: the mechanism that controllers are told about; by default a published one. A mapping of some fields or
            the name of a published design will do, see `mechanics.designs.resolve_design`.
        observe: "full", or "tip_and_inputs" (no joint angles, no margins).
        observe_velocities: whether velocities are observed; those of a quasi-static mechanism are zero.
        reward_type: "dense" or "sparse".
        reward_weights: weights of the dense reward, by name; those left out keep their default.
        tolerance: success within this distance [m]; the default grows with the mechanism.
        backend: "quasi_static", or "mujoco" for dynamics.
        dynamics: parameters of the dynamics, some of them by name; see `simulation.mujoco.Dynamics`.
        randomization: what differs from episode to episode, by name; see `randomization.Randomization`.
        level: of uncertainty, from 0 (none) to 3, see `uncertainty`; of several, such as [0, 2], or of all ("drawn"),
            each episode draws one. What `randomization` names is as that says.
    """

    design: Any = None
    observe: Literal["full", "tip_and_inputs"] = "full"
    observe_velocities: bool = False
    reward_type: Literal["dense", "sparse"] = "dense"
    reward_weights: Mapping[str, float] | Weights | None = None
    tolerance: float | None = None
    backend: Literal["quasi_static", "mujoco"] = "quasi_static"
    dynamics: Dynamics | Mapping[str, Any] | None = None
    randomization: Randomization | Mapping[str, Any] | None = None
    level: int | Sequence[int] | Literal["drawn"] | None = None

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            ValueError: `observe`, `backend` or `level` is none of those there are; there are dynamics without their
                backend.
        """
        checked_levels(self.level)
        for name, known in (("observe", ("full", "tip_and_inputs")), ("backend", ("quasi_static", "mujoco"))):
            if getattr(self, name) not in known:
                raise ValueError(f"{name} = {getattr(self, name)!r}: must be {' or '.join(map(repr, known))}")
        if self.dynamics is not None and not self.is_dynamic:
            raise ValueError("dynamics: needs backend = 'mujoco'")

    def randomized(self, applicable: Collection[str], where: str, noise_scale: float = 1.0) -> Randomization:
        """What differs from episode to episode.

        Args:
            applicable: names of what may.
            where: the environment, for messages.
            noise_scale: what the tip noise of the levels is multiplied by.

        Raises:
            ValueError: a name is unknown or does not apply, or a range is wrong.
            TypeError: `randomization` is of the wrong type.
        """
        given = Randomization.given(self.randomization, applicable, where)
        seen = set(applicable) if self.observe == "full" else set(applicable) - {"angle_noise"}
        levels = checked_levels(self.level)
        parts = []
        for level in levels:
            ranges = ranges_of(level, seen, where, noise_scale)
            own = {name: ranges[name] for name in ranges if name not in given.names}
            parts.append(dataclasses.replace(given, **own))
        return parts[0] if len(levels) == 1 else DrawnLevel.of(levels, parts)

    @classmethod
    def of(cls, core: Any, given: Mapping[str, Any]) -> "Options":
        """The options that were given to the constructor of a core.

        Raises:
            TypeError: the core has no such option; the message says what there is.
            ValueError: an option is out of range.
        """
        if not set(given) <= set(core.shared):
            # A subclass that takes none of them may still hand them to this constructor.
            check_names(core, given, [*inspect.signature(core).parameters, *core.shared])
        usual = core.option_defaults.get("dynamics")
        if usual is not None and not isinstance(given.get("dynamics"), Dynamics):
            given = {**given, "dynamics": {**usual, **(given.get("dynamics") or {})}}
        return cls(**{**core.option_defaults, **given})

    @property
    def is_dynamic(self) -> bool:
        """Whether the environment has dynamics."""
        return self.backend == "mujoco"

    @property
    def varied_dynamics(self) -> set[str]:
        """Names of what of the dynamics may be randomized by a factor: friction and bandwidth, where there are any."""
        if not self.is_dynamic:
            return set()
        names = {"friction": "joint_friction", "bandwidth": "actuator_bandwidth"}
        given = self.dynamics.__dict__ if isinstance(self.dynamics, Dynamics) else dict(self.dynamics or {})
        return {"damping"} | {name for name, field in names.items() if given.get(field)}

    def scoring(self, weights: Weights, tolerance: float, scale: float | np.floating = 1.0) -> dict[str, Any]:
        """The arguments that all tasks share.

        Args:
            weights: the default weights.
            tolerance: the default tolerance at the published size [m].
            scale: the size of this design, divided by that of the published one.
        """
        return {
            "tolerance": tolerance * float(scale) if self.tolerance is None else self.tolerance,
            "reward_type": self.reward_type,
            "weights": weights.updated(self.reward_weights),
        }


OPTION_NAMES = tuple(field.name for field in dataclasses.fields(Options))
# Those of an environment that has no dynamics.
QUASI_STATIC = tuple(name for name in OPTION_NAMES if name not in ("backend", "dynamics", "observe_velocities"))


def described(cls: type, section: str = "Attributes") -> dict[str, str]:
    """What the docstring of a class says of its attributes (or arguments), by name, each in one line."""
    doc = inspect.getdoc(cls) or ""
    found = re.search(rf"^{section}:\n((?:(?:    .*)?\n?)*)", doc, re.MULTILINE)
    entries = re.split(r"^    (?=\w+:)", found[1] if found else "", flags=re.MULTILINE)[1:]
    pairs = (entry.split(":", 1) for entry in entries)
    return {name: " ".join(text.split()) for name, text in pairs}


def share_options(core: type, names: Iterable[str]) -> None:
    """Write the shared options into a core's signature and docstring, for `inspect`, `help` and error messages.

    A constructor that takes further keyword arguments hands them to the next one in the order of the class's bases,
    mixins included; what the last of them takes further are the shared options.

    Args:
        core: a class, with a constructor of its own or an inherited one.
        names: the options that it shares.
    """
    core._written = described(core, "Args")  # type: ignore[attr-defined]  # before anything is added
    chain = _constructors(core)
    parameters: dict[str, inspect.Parameter] = {}
    texts: dict[str, str] = {}
    for k, (base, own, _) in enumerate(chain):
        for one in own:
            if k == 0:
                parameters[one.name] = one
            elif one.name in names or one.name not in OPTION_NAMES:
                parameters.setdefault(one.name, one.replace(kind=inspect.Parameter.KEYWORD_ONLY))
        texts = vars(base).get("_written", described(base, "Args")) | texts
    if not chain:
        return
    last, _, takes_further = chain[-1]
    if takes_further:
        defaults = getattr(last, "option_defaults", {})
        for field in dataclasses.fields(Options):
            default = defaults.get(field.name, field.default)
            shared = inspect.Parameter(
                field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=field.type
            )
            if field.name in names:
                parameters.setdefault(field.name, shared)
        texts = described(Options) | texts
    _document(core, {name: texts[name] for name in parameters if name in texts})
    core.__signature__ = inspect.Signature(list(parameters.values()))  # type: ignore[attr-defined]


def _constructors(core: type) -> list[tuple[type, list[inspect.Parameter], bool]]:
    """The constructors of a class, the first one first, as long as each hands further keyword arguments on.

    Returns:
        For each, whose it is, its parameters by name, and whether it takes further ones.
    """
    found: list[tuple[type, list[inspect.Parameter], bool]] = []
    for base in core.__mro__[:-1]:
        if "__init__" in vars(base):
            everything = list(inspect.signature(vars(base)["__init__"]).parameters.values())[1:]
            own = [one for one in everything if one.kind is not inspect.Parameter.VAR_KEYWORD]
            found.append((base, own, len(own) < len(everything)))
            if not found[-1][2]:
                break
    return found


def _document(core: type, texts: Mapping[str, str]) -> None:
    """Add arguments to the docstring, by name, but for those that it describes itself."""
    doc = vars(core).get("__doc__")
    if not doc or not texts:
        return
    before, raises, rest = inspect.cleandoc(doc).partition("\n\nRaises:\n")
    head, args, own = before.partition("\nArgs:\n")
    known = described(core, "Args")
    entries = [
        textwrap.fill(f"{name}: {text}", _WIDTH, initial_indent="    ", subsequent_indent="        ")
        for name, text in texts.items()
        if name not in known
    ]
    core.__doc__ = head + (args or "\n\nArgs:\n") + "\n".join([*([own] if own else []), *entries]) + raises + rest


def _made_of(core: type) -> list[type]:
    """The classes for the same mechanism that are made of a core, directly or not, and of which no others are made."""
    children: list[type] = core.__subclasses__()
    found = [one for child in children for one in (_made_of(child) if child.__subclasses__() else [child])]
    return [one for one in found if getattr(one, "published", None) is getattr(core, "published", None)]


def check_names(core: type, names: Iterable[str], known: Iterable[str] | None = None) -> None:
    """Refuse options that a core does not have.

    Args:
        core: a class.
        names: the names of options that were given.
        known: the names that there are; by default those in its signature.

    Raises:
        TypeError: it has no such option; the message says what there is.
    """
    known = list(dict.fromkeys(inspect.signature(core).parameters if known is None else known))
    for name in names:
        if name not in known:
            close = get_close_matches(name, known, 1)
            others = [kind.__name__ for kind in _made_of(core) if name in inspect.signature(kind).parameters]
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            hint += f" (it is an option of arm={' or arm='.join(map(repr, others))})" if others else ""
            # Python's own words for it: clients such as TorchRL try arguments, and look for these in the message.
            raise TypeError(
                f"{core.__name__} got an unexpected keyword argument {name!r}{hint}; there are {', '.join(known)}"
            )
