"""The report of a comparison: one HTML file with everything in it, that needs no network and runs no scripts."""

import base64
import json
import math
import os
import platform
import subprocess
from collections import Counter
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined

from tensegrity_agents.evaluation.results import Run
from tensegrity_agents.reporting.table import (
    Row,
    best_agent,
    best_baseline,
    error_text,
    grouped,
    microseconds,
    percent,
    plain,
    steps_text,
    verdict,
)

# What is seen in the figures of a comparison, by their usual names.
CAPTIONS = {
    "success": "Success rate of every controller with its 95% interval, and, magnified, of those above 90%.",
    "error": "Share of the episodes that end within a distance of the target. Where a curve crosses the vertical line "
    "is the share within tolerance; what lies to the right of it was missed by that much.",
    "steps": "Share of the episodes that have been on the target by a step. The higher and the further to the left, "
    "the better; a curve that levels off below 100% never reaches the rest.",
    "scores": "Share of the episodes in which at least that force was held, in multiples of the straight arm's "
    "critical load. Success begins at the vertical line.",
    "tracking": "Distance from the moving goal: median of 300 test episodes, shaded up to the 95th percentile. The "
    "line is the tolerance; what counts is the cycle right of the dashed one.",
    "tip_paths": "The tip's paths in the first test episodes, from the open circles. Blue: where the tip can be "
    "without load.",
    "joint_space": "Joint space of the manipulator. Blue: stable and wrench-feasible, the darker, the larger the "
    "smaller of both margins; grey: unstable, or no feasible tensions hold the arm. On the dashed curve the inverse "
    "solutions meet. Lines are episodes, from the open circle to the filled mark.",
    "workspace": "What the tip can reach in a stable, wrench-feasible way (blue), the targets that were reached "
    "(green), and the paths of the tip in episodes that failed (orange; dotted: what was missing).",
    "learning_curve": "Success and return over the time spent: of complete training episodes, in which actions are "
    "noisy, and of the agent without that noise on a few validation episodes, which is what the table measures.",
}
_PACKAGES = (
    "tensegrity-envs",
    "gymnasium",
    "numpy",
    "scipy",
    "torch",
    "stable-baselines3",
    "sb3-contrib",
    "mujoco",
    "pydantic",
    "matplotlib",
    "pillow",
)
_MEDIA = {".png": "image/png", ".svg": "image/svg+xml", ".gif": "image/gif", ".jpg": "image/jpeg"}


def collect_metadata(command: str, config: Mapping[str, Any], seeds: object) -> dict[str, Any]:
    """What it takes to make a result again, ready for JSON: no host or user name.

    Args:
        command: that regenerates the result.
        config: of the experiment.
        seeds: of training and evaluation.

    Returns:
        command, config, seeds, versions (by package), git ({"revision", "dirty"}, None outside a checkout), python,
        platform, cpu_count and time (UTC).
    """
    return {
        "command": command,
        "config": _jsonable(dict(config)),
        "seeds": _jsonable(seeds),
        "versions": _versions(),
        "git": _git_revision(Path(__file__).resolve()),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cpu_count": os.cpu_count(),
        "time": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }


def _versions() -> dict[str, str]:
    found = {}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def _git_revision(file: Path) -> dict[str, Any] | None:
    """Revision of the checkout that tracks a file, and whether tracked files differ from it."""

    def git(*arguments: str) -> str:
        return subprocess.run(
            ["git", "-C", str(file.parent), *arguments], capture_output=True, text=True, check=True, timeout=20
        ).stdout

    try:
        git(
            "ls-files", "--error-unmatch", file.name
        )  # a package installed below somebody else's repository is not in it
        return {
            "revision": git("rev-parse", "HEAD").strip(),
            "dirty": bool(git("status", "--porcelain", "--untracked-files=no").strip()),
        }
    except (OSError, subprocess.SubprocessError):
        return None


def _jsonable(value: object) -> Any:
    return json.loads(json.dumps(value, default=_plain_value))


def _plain_value(value: object) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, range | set | frozenset):
        return sorted(value)
    return str(value)


def write_report(
    folder: Path,
    *,
    title: str,
    env_id: str,
    rows: list[Row],
    runs: list[Run],
    metadata: Mapping[str, Any],
    figures: Mapping[str, Path],
    video: Path | None,
    training: Mapping[str, Any] | None,
    command: str,
    captions: Mapping[str, str] | None = None,
) -> Path:
    """Write `folder`/report.html.

    Args:
        folder: made if it does not exist.
        title: of the page.
        env_id: Gymnasium id.
        rows: see `table.summary_rows`.
        runs: that the rows summarize.
        metadata: see `collect_metadata`; keys may be missing.
        figures: pictures (PNG, SVG, GIF) by name, in order; "learning_curve" goes to the training section.
        video: GIF of `video.record`; its strip is shown too if it is there.
        training: None, or "config" (dict), "seconds", "timesteps", "runs" (number of training runs, 1 if missing), and
            further facts, shown as they are.
        command: that makes this report again.
        captions: of figures, by name, besides CAPTIONS.

    Returns:
        The path of the page.
    """
    agent = best_agent(rows)
    best = best_baseline(rows)
    shown = [{**row, "is_best": row is best, "text": _texts(row)} for row in rows]
    captions = {**CAPTIONS, **(captions or {})}
    pictures = [
        {"name": name, "data": _data(path), "caption": captions.get(name, name.replace("_", " "))}
        for name, path in figures.items()
    ]
    strip = video.with_suffix(".png") if video is not None else None
    template = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    ).from_string(files("tensegrity_agents.reporting").joinpath("report.html.j2").read_text("utf-8"))
    page = template.render(
        title=title,
        env_id=env_id,
        episodes=max((row["episodes"] for row in rows), default=0),
        verdict=verdict(rows),
        agent=agent["controller"] if agent else "",
        single_run=any(row["training_runs"] == 1 for row in rows),
        rows=shown,
        holds=_holds(runs),
        error_unit=rows[0]["error_unit"] if rows else "mm",
        any_better=any(row["text"]["better_interval"] for row in shown),
        any_normalized=any(not math.isnan(row["normalized"]) for row in rows),
        any_wilson=any(row["interval"] == "Wilson" for row in rows),
        any_bootstrap=any(row["interval"] == "bootstrap" for row in rows),
        endings=_endings(runs),
        knowledge=[row for row in rows if row["notes"]],
        pictures=[item for item in pictures if item["name"] != "learning_curve" or training is None],
        film=_data(video) if video is not None else None,
        strip=_data(strip) if strip is not None and strip.is_file() else None,
        training=_training(training, rows, [item for item in pictures if item["name"] == "learning_curve"]),
        command=command,
        metadata={"time": metadata.get("time", "")},
        facts=_facts(metadata),
        versions=list(metadata.get("versions", {}).items()),
        config=_pretty(metadata.get("config")),
    )
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "report.html"
    path.write_text(page, "utf-8")
    return path


def _data(path: Path) -> str:
    if path.suffix not in _MEDIA:
        raise ValueError(f"{path}: a picture must be one of {', '.join(_MEDIA)}")
    return f"data:{_MEDIA[path.suffix]};base64,{base64.b64encode(path.read_bytes()).decode()}"


def _texts(row: Row) -> dict[str, str]:
    better = row["agent_better"]
    return {
        "success": percent(row["success"]),
        "low": percent(row["success_low"]),
        "high": percent(row["success_high"]),
        "ever": percent(row["success_ever"]),
        "median": error_text(row, "error_median_mm"),
        "p95": error_text(row, "error_p95_mm"),
        "median_share": percent(row["error_median_share"], "%") if "error_median_share" in row else "",
        "p95_share": percent(row["error_p95_share"], "%") if "error_p95_share" in row else "",
        "steps": steps_text(row["steps_median"]),
        "better": plain(better.point, 3) if better else "",
        "better_interval": f"[{better.low:.3f}, {better.high:.3f}]" if better else "",
        "normalized": plain(row["normalized"], 3),
        "unstable": percent(row["unstable"]),
        "infeasible": percent(row["infeasible"]),
        "ended": percent(row["ended_early"]),
        "stability": plain(row["stability_margin_p5"]),
        "wrench": plain(row["wrench_margin_p5"]),
        "effort": plain(row["effort"]),
        "microseconds": microseconds(row["microseconds"]),
    }


def _holds(runs: list[Run]) -> bool:
    """Whether the task is to hold, which gives a score."""
    return any(np.isfinite(run.columns["score"]).any() for run in runs if "score" in run.columns)


def _endings(runs: list[Run]) -> dict[str, Any]:
    """How the episodes of every controller ended: on target, off target at the time limit, or by which failure."""
    holds = _holds(runs)
    good, bad = ("held", "not held to the end") if holds else ("on target", "off target at the end")
    counts = {}
    for name, group in grouped(runs).items():
        words = [
            reason or (good if success else bad)
            for run in group
            for reason, success in zip(run.reasons, run.columns["success"], strict=True)
        ]
        counts[name] = (group[0].kind, Counter(words), len(words))
    usual = [good, bad]
    seen = set().union(*[counter for _, counter, _ in counts.values()]) if counts else set()
    names = [name for name in usual if name in seen] + sorted(seen - set(usual))
    rows = [
        {"controller": controller, "kind": kind, "shares": [percent(counter[name] / total) for name in names]}
        for controller, (kind, counter, total) in counts.items()
    ]
    return {"names": names, "rows": rows}


def _training(
    training: Mapping[str, Any] | None, rows: list[Row], pictures: list[dict[str, str]]
) -> dict[str, Any] | None:
    if training is None:
        return None
    facts = []
    if "timesteps" in training:
        facts.append(("environment steps", f"{training['timesteps']:,}"))
    if "seconds" in training:
        facts.append(("time", f"{training['seconds']:,.0f} s"))
    if training.get("seconds") and "timesteps" in training:
        facts.append(("speed", f"{training['timesteps'] / training['seconds']:,.0f} steps per second"))
    known = ("config", "timesteps", "seconds", "runs")
    facts += [(key.replace("_", " "), _inline(value)) for key, value in training.items() if key not in known]
    facts += [
        (f"success of each run of {row['controller']} [%]", ", ".join(percent(share) for share in row["success_runs"]))
        for row in rows
        if row["training_runs"] > 1
    ]
    number = training.get("runs", 1)
    label = "One training run: how much another training seed would change is not known."
    return {
        "label": label if number == 1 else f"{number} training runs with different seeds, none left out.",
        "facts": facts,
        "pictures": pictures,
        "config": _pretty(training.get("config")),
    }


def _facts(metadata: Mapping[str, Any]) -> list[tuple[str, str]]:
    facts = []
    if metadata.get("seeds") is not None:
        facts.append(("seeds", _inline(metadata["seeds"])))
    git = metadata.get("git")
    revision = "not run from a checkout"
    if git:
        revision = git["revision"] + (", with uncommitted changes" if git["dirty"] else "")
    facts.append(("git revision", revision))
    if "python" in metadata:
        facts.append(("Python", str(metadata["python"])))
    if "platform" in metadata:
        facts.append(("machine", f"{metadata['platform']}, {metadata.get('cpu_count', 'unknown number of')} CPU cores"))
    if "time" in metadata:
        facts.append(("made", str(metadata["time"])))
    return facts


def _inline(value: object) -> str:
    """A value on one line; a mapping as "key value, key value"."""
    value = _jsonable(value)
    if isinstance(value, dict):
        return ", ".join(f"{key} {_inline(item)}" for key, item in value.items())
    if isinstance(value, list):
        return ", ".join(_inline(item) for item in value)
    return f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) and abs(value) < 1e6 else str(value)


def _pretty(value: object) -> str:
    return json.dumps(_jsonable(value), indent=2, ensure_ascii=False) if value else ""
