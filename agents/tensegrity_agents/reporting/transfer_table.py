"""The transfer table: success of every controller where it was made for, and where it was not."""

from rich import box
from rich.console import Console
from rich.table import Table

from tensegrity_agents.env_options import short_name
from tensegrity_agents.evaluation.transfer import Transferred
from tensegrity_agents.reporting.table import error_text, success_text, summary_rows

_HEADER = ("controller", "made for", "at rest: success [%], 95%", "error", "in motion: success [%], 95%", "error")


def _lines(results: list[Transferred], pair: tuple[str, str]) -> list[list[str]]:
    lines = []
    for candidate, runs in results:
        cells = [candidate.name, "rest" if candidate.home == pair[0] else "motion"]
        for where in pair:
            row = summary_rows(runs[where])[0]
            cells += [success_text(row), f"{error_text(row, 'error_median_mm')} {row['error_unit']}"]
        if candidate.name == "agent":
            count = len(candidate.controllers)
            cells[0] = f"agent ({count} training run{'s' if count > 1 else ''})"
        lines.append(cells)
    return lines


def print_transfer(results: list[Transferred], pair: tuple[str, str], console: Console) -> None:
    """Print the table; errors are the median distance from the target at the end."""
    table = Table(box=box.SIMPLE_HEAD, title=f"{short_name(pair[0])} (at rest) and {short_name(pair[1])} (in motion)")
    for i, name in enumerate(_HEADER):
        table.add_column(name, justify="left" if i < 2 else "right")
    for cells in _lines(results, pair):
        table.add_row(*cells, style="bold cyan" if cells[0].startswith("agent") else "")
    console.print(table)


def transfer_to_markdown(results: list[Transferred], pair: tuple[str, str]) -> str:
    """The same as Markdown, agents in bold."""
    lines = ["| " + " | ".join(_HEADER) + " |", "|---|---|" + "---:|" * (len(_HEADER) - 2)]
    for cells in _lines(results, pair):
        name = cells[0].replace("_", "\\_")
        lines.append("| " + " | ".join([f"**{name}**" if name.startswith("agent") else name, *cells[1:]]) + " |")
    return "\n".join(lines) + "\n"
