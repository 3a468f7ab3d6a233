"""The table of ablations: success of each variant beside that of the whole method."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from tensegrity_agents.evaluation.records import Record, read_records
from tensegrity_agents.reporting.matrix import AGENT, cells_of
from tensegrity_agents.reporting.table import percent


def ablations_to_markdown(folder: Path, whole: Mapping[str, Sequence[Record]]) -> str:
    """The table of all variants that were measured; empty where there are none.

    Args:
        folder: of the variants: folder/<variant>/<id>/*.json.
        whole: rows of the whole method, by Gymnasium id.
    """
    homes = sorted(path for path in folder.iterdir() if path.is_dir()) if folder.is_dir() else []
    found = {home.name: read_records(home) for home in homes}
    ids = sorted({env_id for group in found.values() for env_id in group})
    if not ids:
        return ""
    lines = [
        "| environment | method | success, mean over seeds [%] | seeds | worst seed [%] |",
        "|---|---|---:|---:|---:|",
    ]
    for env_id in ids:
        rows = {"whole": whole.get(env_id, [])} | {name: group.get(env_id, []) for name, group in found.items()}
        for name, group in rows.items():
            cell = cells_of(group).get(AGENT) if group else None
            if cell is not None:
                short, method = env_id.rpartition("/")[2], name.replace("_", " ")
                lines.append(f"| `{short}` | {method} | {cell.text} | {len(cell.flags)} | {percent(cell.worst)} |")
    return "\n".join(lines) + "\n"
