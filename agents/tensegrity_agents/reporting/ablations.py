"""The table of ablations: success of each variant, in dynamics its time to settle, beside those of the whole method."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import gymnasium as gym
import numpy as np

from tensegrity_agents.evaluation.records import Record, read_records
from tensegrity_agents.reporting.claims import duration_of
from tensegrity_agents.reporting.matrix import AGENT, cells_of
from tensegrity_agents.reporting.table import percent

WHOLE = "whole"  # the method with nothing taken out; as a folder, where it is trained for other than its own steps


def ablations_to_markdown(folder: Path, whole: Mapping[str, Sequence[Record]]) -> str:
    """The table of all variants that were measured; empty where there are none.

    Args:
        folder: of the variants: folder/<variant>/<id>/*.json.
        whole: rows of the whole method, by Gymnasium id; those of folder/whole go before.
    """
    homes = sorted(path for path in folder.iterdir() if path.is_dir()) if folder.is_dir() else []
    found = {home.name: read_records(home) for home in homes}
    ids = sorted({env_id for group in found.values() for env_id in group})
    if not ids:
        return ""
    lines = [
        "| environment | method | steps | success, mean over seeds [%] | seeds | worst seed [%] | settles after [s] |",
        "|---|---|---:|---:|---:|---:|---:|",
    ]
    for env_id in ids:
        rows: dict[str, Sequence[Record]] = {WHOLE: whole.get(env_id, [])}
        rows |= {name: group[env_id] for name, group in found.items() if env_id in group}
        for name, group in rows.items():
            cell = cells_of(group).get(AGENT) if group else None
            if cell is not None:
                short, method = env_id.rpartition("/")[2], name.replace("_", " ")
                steps = max(row.frames or 0 for row in group) / 1e6
                scores = f"{cell.text} | {len(cell.flags)} | {percent(cell.worst)} | {_settling(group)}"
                lines.append(f"| `{short}` | {method} | {steps:.1f} million | {scores} |")
    return "\n".join(lines) + "\n"


def _settling(agents: Sequence[Record]) -> str:
    """Mean time to settle over agents and episodes, as long as an episode where the tip does not stay; a dash where it
    was not measured, or where nobody has registered the environment, which says how long its episodes are.
    """
    times = [own for record in agents if (own := record.settling_times()) is not None]
    if len(times) < len(agents) or agents[0].env not in gym.registry:
        return "\N{EN DASH}"
    return f"{np.minimum(times, duration_of(agents[0].env)).mean():.3f}"
