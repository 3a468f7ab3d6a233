"""What is kept of an evaluation for good: a small file for each controller or training seed, one bit an episode."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_agents.evaluation.results import Run
from tensegrity_agents.whole_file import written_whole

_NEVER = 0xFFFF  # of a settling time


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

    env: str
    controller: str
    kind: str
    episodes: int
    successes: dict[str, str]
    config: str
    knows: str = ""
    steps_to_target: float | None = None
    seed: int | None = None
    frames: int | None = None
    cpu_seconds: float | None = None
    wall_seconds: float | None = None
    settling: dict[str, str] = field(default_factory=dict)

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


def read_record(path: Path) -> Record:
    """A record that `Record.write` wrote.

    Raises:
        ValueError: it is something else; the message names the file.
    """
    try:
        record = Record(**json.loads(path.read_text()))
        for level in record.successes:
            record.flags(level)
            record.settling_times(level)
    except (TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"{path}: not a record of this package ({error}); delete it to measure it again") from error
    return record


def read_records(folder: Path) -> dict[str, list[Record]]:
    """All records in folder/<id>/*.json, by Gymnasium id."""
    found: dict[str, list[Record]] = {}
    for path in sorted(folder.glob("*/*.json")):
        record = read_record(path)
        found.setdefault(record.env, []).append(record)
    return found


def packed(flags: np.ndarray) -> str:
    """Booleans of shape (n,) as hexadecimal digits, the last one filled with zeros."""
    return np.packbits(np.asarray(flags, bool)).tobytes().hex()


def unpacked(text: str, count: int) -> np.ndarray:
    """What `packed` was given.

    Raises:
        ValueError: the text does not hold `count` flags.
    """
    data = np.frombuffer(bytes.fromhex(text), np.uint8)
    if len(data) != -(-count // 8):
        raise ValueError(f"{4 * len(text)} bits for {count} episodes")
    return np.unpackbits(data)[:count].astype(bool)


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
