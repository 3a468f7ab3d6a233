"""Each client in a virtual environment of its own, with this checkout installed: what works, as a table.

    python tests/clients/run.py                         all clients, one after another
    python tests/clients/run.py --client skrl           one of them
    python tests/clients/run.py --write                 and put the table into docs/compatibility.md

Needs Python's venv and a package index. Each virtual environment (the largest, Ray's, has 2 GB) is in a temporary
folder, which is deleted after the client has run. No part of `make test`. The exit code is 1 where
anything does not work.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "compatibility.md"
BEGIN, END = "<!-- table of tests/clients/run.py: begin -->", "<!-- table of tests/clients/run.py: end -->"
TORCH = "torch==2.13.0"
OF_WRAPPERS = ("array-api-compat==1.16.0", "packaging==26.3", "moviepy==2.2.1", "opencv-python-headless==5.0.0.93")
REQUIREMENTS = {
    "gymnasium": [TORCH, "gymnasium==1.4.0", *OF_WRAPPERS],
    "rllib": [TORCH, "ray[rllib]==2.60.0"],
    "torchrl": [TORCH, "torchrl==0.14.1"],
    "minari": ["minari[hdf5,create]==0.5.4"],
    "tianshou": [TORCH, "tianshou==2.0.1"],
    "skrl": [TORCH, "skrl==2.1.1"],
}
Row = dict[str, Any]


def rows_of(client: str, keep: Path | None = None) -> list[Row]:
    """Install a client, run its script and gather what it tells.

    Args:
        client: a name in REQUIREMENTS.
        keep: folder of a virtual environment to make, or to use if it is there, and to keep; None for a temporary one.
    """
    with tempfile.TemporaryDirectory(prefix=f"client-{client}-") as folder:
        place = keep or Path(folder) / "venv"
        python = place / ("Scripts" if sys.platform == "win32" else "bin") / "python"
        if not python.exists():
            subprocess.run([sys.executable, "-m", "venv", str(place)], check=True)
        install = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        if subprocess.run([*install, *REQUIREMENTS[client], f"{ROOT}[mujoco]"], check=False).returncode:
            return [failure(client, "install", "pip failed")]
        if keep:  # the checkout may have changed since
            subprocess.run([*install, "--force-reinstall", "--no-deps", str(ROOT)], check=True)
        script = ROOT / "tests" / "clients" / f"with_{client}.py"
        run = subprocess.Popen([str(python), str(script)], cwd=folder, stdout=subprocess.PIPE, text=True)
        assert run.stdout is not None
        rows = []
        for line in run.stdout:
            if line.startswith("ROW "):
                rows.append(json.loads(line[4:]))
                print("  ".join(rows[-1].values()), flush=True)
        if run.wait():
            rows.append(failure(client, "run to its end", f"exit {run.returncode}"))
        return rows


def failure(client: str, what: str, seen: str) -> Row:
    """The row of a client that has none of its own."""
    return {"client": client, "id": "-", "what": what, "works": "NO", "seen": seen}


def table(rows: list[Row]) -> str:
    """The rows as Markdown: one line for each client and check, the ids it ran on and what was seen."""
    lines = ["| client | what | ids | works | seen |", "|---|---|---|---|---|"]
    groups: dict[tuple[str, str, str, str], list[str]] = {}
    for row in rows:
        seen = row["seen"].split("\n")[0].replace("|", "\\|")
        group = groups.setdefault((row["client"], row["what"], row["works"], seen), [])
        group.append(row["id"].removeprefix("tensegrity/").removesuffix("-v0"))
    for (client, what, works, seen), ids in groups.items():
        lines.append(f"| {client} | {what} | {', '.join(ids)} | {works} | {seen} |")
    return "\n".join(lines)


def main() -> int:
    """Run the clients, print the table."""
    parser = argparse.ArgumentParser(description="Run the clients, print the table.")
    parser.add_argument("--client", action="append", choices=list(REQUIREMENTS), help="only this one; may be repeated")
    parser.add_argument("--venvs", type=Path, help="keep the virtual environments in this folder, and use them again")
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.relative_to(ROOT)}")
    given = parser.parse_args()
    rows = []
    for client in given.client or REQUIREMENTS:
        rows += rows_of(client, given.venvs and given.venvs.resolve() / client)
    print("\n" + table(rows))
    if given.write:
        text = PAGE.read_text()
        before, rest = text.split(BEGIN)
        PAGE.write_text(f"{before}{BEGIN}\n{table(rows)}\n{END}{rest.split(END)[1]}")
    return int(any(row["works"] == "NO" for row in rows))


if __name__ == "__main__":
    sys.exit(main())
