"""Who wins where: the table and the figures of all rows that `tensegrity campaign` has kept."""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_agents.ablations import FOLDER
from tensegrity_agents.command_options import Json
from tensegrity_agents.config import ConfigError
from tensegrity_agents.console import checked_folder, clear_errors, for_machines, say, tell_json
from tensegrity_agents.evaluation.records import read_records
from tensegrity_agents.reporting.ablations import ablations_to_markdown
from tensegrity_agents.reporting.claims import CANDIDATES, claims_to_markdown, read_candidates
from tensegrity_agents.reporting.matrix import matrix_rows, matrix_to_markdown
from tensegrity_agents.reporting.matrix_figures import matrix_figure, uncertainty_figure
from tensegrity_agents.reporting.style import save


def main(
    records: Annotated[Path, typer.Option(help="folder of the rows that `tensegrity campaign` kept")] = Path("records"),
    out: Annotated[Path, typer.Option(help="folder of the table and the figures")] = Path("results/matrix"),
    json: Json = False,
) -> None:
    """Write who wins where: matrix.md and who_wins (ids by controllers), uncertainty (success by level).

    Below the matrix are the claims: where agents are to win by success or by time to settle, as candidates.yaml in the
    folder of the rows says. Then come ablations, as far as `tensegrity campaign --ablate` has measured some.

    Example: tensegrity matrix --records records --out results/matrix
    """
    with for_machines(json), clear_errors():
        checked_folder(out, "--out")
        found = read_records(records)
        if not found:
            raise ConfigError(f"--records {records}: no rows in it; `tensegrity campaign` measures some")
        out.mkdir(parents=True, exist_ok=True)
        text = matrix_to_markdown(found)
        if (records / CANDIDATES).is_file():
            text += "\n" + claims_to_markdown(read_candidates(records / CANDIDATES), found)
        if ablated := ablations_to_markdown(records / FOLDER, found):
            text += "\n" + ablated
        (out / "matrix.md").write_text(text)
        say(text)
        if json:
            tell_json(matrix_rows(found))
        say(str(save(matrix_figure(found), out / "who_wins")))
        if any(len(record.successes) > 2 for group in found.values() for record in group):
            say(str(save(uncertainty_figure(found), out / "uncertainty")))
