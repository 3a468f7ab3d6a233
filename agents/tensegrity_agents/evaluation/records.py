"""What is kept of an evaluation for good: a small file for each controller or training seed, one bit an episode."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from tensegrity_agents.evaluation.results import Run, kind_of
from tensegrity_agents.whole_file import written_whole
from tensegrity_envs.uncertainty import LEVELS

LEVEL_NAMES = tuple(map(str, range(len(LEVELS))))
_NEVER = 0xFFFF  # of a settling time

Name = Annotated[str, Field(min_length=1)]
Count = Annotated[int, Field(ge=0)]
Amount = Annotated[float, Field(ge=0, strict=True, allow_inf_nan=False)]


@dataclass(frozen=True)
class Record:
    """One controller, or one training seed, on the test episodes of an environment.

    Attributes:
        env: Gymnasium id.
        controller: name, as in tables.
        kind: "agent", "baseline", "oracle" or "random".
        episodes: how many.
        successes: one bit for each episode, by level of uncertainty; "" is the environment as it is. Hexadecimal, the
            first episode is the highest bit of the first digit.
        config: hash of what it was made with, see `hash_of`.
        knows: what it is told beside observations.
        steps_to_target: median over episodes that got there, else None.
        seed: of the training, else None.
        frames: environment steps of the training.
        cpu_seconds: of the training; None where it is not known.
        wall_seconds: of the training.
        settling: of reaching in dynamics, time after which the tip has stayed on target, by level; see `packed_times`.
    """

    __pydantic_config__ = ConfigDict(strict=True, extra="forbid")  # of `read_record`: files may be edited by hand

    env: Name
    controller: Name
    kind: str
    episodes: Annotated[int, Field(ge=1)]
    successes: dict[str, str]
    config: str
    knows: str = ""
    steps_to_target: Amount | None = None
    seed: Count | None = None
    frames: Count | None = None
    cpu_seconds: Amount | None = None
    wall_seconds: Amount | None = None
    settling: dict[str, str] = field(default_factory=dict)

    def file(self, folder: Path) -> Path:
        """Where it is kept in a folder of records."""
        return file_of(folder, self.env, self.controller, self.seed)

    def with_level(self, level: str, other: "Record", theirs: str) -> "Record":
        """The same with what another record of the same controller has at its level `theirs`, as `level`."""
        successes = self.successes | {level: other.successes[theirs]}
        settling = self.settling | ({level: other.settling[theirs]} if theirs in other.settling else {})
        return replace(self, successes=dict(sorted(successes.items())), settling=dict(sorted(settling.items())))

    def flags(self, level: str = "") -> np.ndarray:
        """Success of every episode, booleans of shape (episodes,).

        Args:
            level: of uncertainty, as in `successes`.
        """
        return unpacked(self.successes[level], self.episodes)

    def settling_times(self, level: str = "") -> np.ndarray | None:
        """Of every episode [s], infinite where the tip does not stay, shape (episodes,); None where there are none.

        Args:
            level: of uncertainty, as in `successes`.
        """
        return unpacked_times(self.settling[level], self.episodes) if level in self.settling else None

    def write(self, path: Path) -> None:
        """Write it, all or nothing."""
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(path) as part:
            part.write_text(json.dumps(asdict(self), indent=1) + "\n")


_FILES = TypeAdapter(Record)


def name_of(controller: str, seed: int | None) -> str:
    """The name of a row for messages and files: the controller's, or that of a training seed."""
    return f"agent-{seed}" if seed is not None else controller.replace(":", "-")


def file_of(folder: Path, env: str, controller: str, seed: int | None) -> Path:
    """Where the record of a row is kept: folder/<id>/<name>.json.

    Args:
        folder: of records.
        env: Gymnasium id; its namespace is left out.
        controller: its name, of which an agent's file takes no notice.
        seed: of the training, None for a controller.
    """
    return folder / env.rpartition("/")[2] / f"{name_of(controller, seed)}.json"


def read_record(path: Path) -> Record:
    """A record that `Record.write` wrote.

    Raises:
        ValueError: it is something else, or a field was changed into what cannot be; the message names the file.
    """
    try:
        record = _FILES.validate_json(path.read_bytes())
        _check(record)
    except ValueError as error:  # pydantic's are some
        what = _first_fault(error) if isinstance(error, ValidationError) else error
        raise ValueError(f"{path}: not a record of this package ({what}); delete it to measure it again") from error
    return record


def _first_fault(error: ValidationError) -> str:
    """What pydantic found first, in one line."""
    fault = error.errors(include_url=False)[0]
    where = "".join(f"{part}: " for part in fault["loc"])
    given = "" if fault["type"] in ("missing", "json_invalid") else f", got {fault['input']!r:.40}"
    return f"{where}{fault['msg']}{given}"


def _check(record: Record) -> None:
    """See that the fields of a record, which have the right types, go together.

    Raises:
        ValueError: they do not; the message names the field.
    """
    if "" not in record.successes:
        raise ValueError("successes: there are none of the environment as it is, ''")
    if unknown := [level for level in record.successes if level not in ("", *LEVEL_NAMES)]:
        raise ValueError(f"successes: there is no level {unknown[0]!r}; there are {', '.join(LEVEL_NAMES)}")
    if alone := [level for level in record.settling if level not in record.successes]:
        raise ValueError(f"settling: there are no successes at level {alone[0]!r}")
    kind = kind_of(record.controller) if record.seed is None else "agent"
    if record.kind != kind:
        told = "without a seed" if record.seed is None else f"with seed {record.seed}"
        raise ValueError(f"kind: {record.controller!r} {told} is of kind {kind!r}, got {record.kind!r}")
    for level in record.successes:
        record.flags(level)
        record.settling_times(level)


def read_records(folder: Path) -> dict[str, list[Record]]:
    """All records in folder/<id>/*.json, by Gymnasium id.

    Raises:
        ValueError: a file is no record, or holds the row of another file; the message names it, and the other one.
    """
    found: dict[str, list[Record]] = {}
    for path in sorted(folder.glob("*/*.json")):
        record = read_record(path)
        _check_place(path, record.file(folder))
        found.setdefault(record.env, []).append(record)
    return found


def _check_place(path: Path, own: Path) -> None:
    """See that a row stands in its own file, so that none counts twice.

    Raises:
        ValueError: it stands elsewhere; the message names both files.
    """
    if path != own:
        # The other file need not hold the same: somebody may have exchanged the names of two.
        there = "which is there, too; keep the right one under that name and delete the other"
        mend = there if own.is_file() else "which is not there; move it, or delete it"
        raise ValueError(f"{path}: holds the row of {own}, {mend}")


def packed(flags: np.ndarray) -> str:
    """Booleans of shape (n,) as hexadecimal digits, the last one filled with zeros."""
    return np.packbits(np.asarray(flags, bool)).tobytes().hex()


def unpacked(text: str, count: int) -> np.ndarray:
    """What `packed` was given.

    Raises:
        ValueError: the text does not hold `count` flags and zeros after the last one.
    """
    data = np.frombuffer(bytes.fromhex(text), np.uint8)
    if len(data) != -(-count // 8):
        raise ValueError(f"{4 * len(text)} bits for {count} episodes")
    bits = np.unpackbits(data).astype(bool)
    if bits[count:].any():
        raise ValueError(f"more than {count} flags for {count} episodes")
    return bits[:count]


def packed_times(seconds: np.ndarray) -> str:
    """Times of shape (n,) [s], up to a minute, as four hexadecimal digits each: milliseconds; "ffff" is infinity."""
    finite = np.isfinite(seconds)
    return np.where(finite, np.rint(1000 * np.where(finite, seconds, 0.0)), _NEVER).astype(">u2").tobytes().hex()


def unpacked_times(text: str, count: int) -> np.ndarray:
    """What `packed_times` was given.

    Raises:
        ValueError: the text does not hold `count` times.
    """
    data = np.frombuffer(bytes.fromhex(text), ">u2")
    if len(data) != count:
        raise ValueError(f"{len(data)} settling times for {count} episodes")
    return np.where(data == _NEVER, np.inf, data / 1000.0)


def hash_of(settings: Mapping[str, Any]) -> str:
    """Twelve hexadecimal digits that differ as soon as a setting does."""
    return hashlib.sha256(json.dumps(settings, sort_keys=True, default=str).encode()).hexdigest()[:12]


def recorded(runs: Mapping[str, Run], env: str, config: str, **more: Any) -> Record:
    """The record of a controller.

    Args:
        runs: by level of uncertainty; "" is the environment as it is, and must be there.
        env: Gymnasium id.
        config: hash, see `hash_of`.
        **more: further fields of the record.
    """
    run = runs[""]
    steps = run.columns["steps_to_target"]
    reached = steps[~np.isnan(steps)]
    return Record(
        env,
        run.controller,
        run.kind,
        len(run.seeds),
        {level: packed(one.columns["success"] > 0) for level, one in runs.items()},
        config,
        run.notes,
        float(np.median(reached)) if len(reached) else None,
        settling={
            level: packed_times(times)
            for level, one in runs.items()
            if not np.isnan(times := one.columns["settling_time_s"]).all()
        },
        **more,
    )
