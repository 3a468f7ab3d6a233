"""No passage of 15 lines stands twice among the environments, their tasks, and the controllers."""

from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[1]
ROOMS = (
    ROOT / "envs" / "tensegrity_envs" / "environments",
    ROOT / "envs" / "tensegrity_envs" / "tasks",
    ROOT / "agents" / "tensegrity_agents" / "controllers",
)
LENGTH = 15


def passages(text):
    """Runs of LENGTH lines of code without imports, blanks and what only closes a bracket, with their line numbers."""
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), 1)]
    kept = [(n, line) for n, line in lines if line.strip("()[]{},") and not line.startswith(("import ", "from ", "#"))]
    for k in range(len(kept) - LENGTH + 1):
        yield kept[k][0], tuple(line for _, line in kept[k : k + LENGTH])


def test_a_passage_that_stands_twice_is_found():
    text = "\n".join(f"x{i} = {i}" for i in range(20))
    assert len({lines for _, lines in passages(f"{text}\n\n{text}")}) < len(list(passages(f"{text}\n\n{text}")))


def test_no_passage_stands_twice():
    places = defaultdict(list)
    for room in ROOMS:
        for path in sorted(room.rglob("*.py")):
            for number, lines in passages(path.read_text()):
                places[lines].append(f"{path.relative_to(ROOT)}:{number}")
    repeated = [where for where in places.values() if len(where) > 1]
    assert not repeated, repeated[:5]
