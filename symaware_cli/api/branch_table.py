"""The table of several branches of a run: what was changed in each, and what came of it."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path

from symaware_cli.api.branching import BranchResult
from symaware_cli.recording.error import OutputError, reason

#: The file in the folder of the branches.
TABLE = "branches.csv"

Cell = str | int | float | None


def branch_rows(results: Sequence[BranchResult], changes: Sequence[Sequence[str]]) -> list[dict[str, Cell]]:
    """Return a row for each branch, whose keys are the same in all rows.

    Args:
        results: The branches of one run at one instant.
        changes: What differs between them: the changes of each, in the form of ``--set``.
    """
    paths = list(dict.fromkeys(each.partition("=")[0] for some in changes for each in some))
    names = list(dict.fromkeys(each.name for result in results for each in result.summary.specifications))
    rows = []
    for number, (result, some) in enumerate(zip(results, changes, strict=True)):
        values = {path: _unquoted(value) for path, _, value in (each.partition("=") for each in some)}
        summary = result.summary
        outcomes = {each.name: each for each in summary.specifications}
        closest, risk = summary.minimum_separation, summary.highest_risk
        row: dict[str, Cell] = {"branch": number, **{path: values.get(path) for path in paths}}
        row["status"] = summary.status
        for name in names:
            outcome = outcomes.get(name)
            row[name] = outcome.verdict if outcome else None
            row[f"{name} robustness"] = outcome.robustness if outcome else None
        row |= {
            "contacts": summary.contacts,
            "closest": closest.value if closest else None,
            "highest risk": risk.value if risk else None,
            "goals reached": len(summary.goals_reached),
            "time": summary.simulated_time,
            "way": result.way,
            "log": summary.log and Path(summary.log).name,
        }
        rows.append(row)
    return rows


def write_branch_table(rows: Sequence[dict[str, Cell]], folder: Path) -> Path:
    """Write the rows as CSV to the folder of the branches, and return the path; numbers with all their digits.

    Raises:
        OutputError: The file cannot be written.
    """
    path = folder / TABLE
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {reason(error)}") from error
    return path


def branch_lines(rows: Sequence[dict[str, Cell]]) -> list[str]:
    """Format the rows for people: columns in which all cells are empty are left out, and so are the logs' names."""
    shown = [key for key in rows[0] if key != "log" and any(row[key] is not None for row in rows)]
    cells = [[_short(key) for key in shown], *([_text(row[key]) for key in shown] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return ["  ".join(f"{cell:>{width}}" for cell, width in zip(line, widths, strict=True)) for line in cells]


def _unquoted(value: str) -> str:
    """A text without its quotes, anything else as it is written."""
    return str(json.loads(value)) if value.startswith('"') else value


def _short(key: str) -> str:
    """The last part of a path, which is enough to tell columns apart."""
    return key.rpartition(".")[2]


def _text(cell: Cell) -> str:
    return "-" if cell is None else f"{cell:.4g}" if isinstance(cell, float) else str(cell)
