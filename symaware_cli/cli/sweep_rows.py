"""The table of a sweep in the terminal."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from symaware_cli.cli.terminal import print_array, printable

if TYPE_CHECKING:
    import pyarrow

#: Columns that are shown only when they are asked for, or as JSON or CSV.
_QUIET = ("replicate", "seed", "digest", "error")


def show_rows(
    folder: Path,
    where: str | None,
    sort: str | None,
    limit: int | None,
    columns: list[str],
    *,
    as_json: bool,
    as_csv: bool,
) -> None:
    """Print rows of the table of a sweep.

    Raises:
        SweepError: There is no sweep, or the condition is not valid.
        UnknownNameError: There is no such column.
    """
    from symaware_cli.api.sweeps import read_rows

    table, planned = read_rows(folder, where, sort, None, columns)
    shown = table if limit is None else table.slice(0, limit)
    if as_json:
        print_array(shown.to_pylist())
    elif as_csv:
        import pyarrow
        from pyarrow import csv

        sink = pyarrow.BufferOutputStream()
        csv.write_csv(shown, sink)
        sys.stdout.write(sink.getvalue().to_pybytes().decode())
    else:
        if not columns:
            empty = [name for name in shown.column_names if shown[name].null_count == shown.num_rows]
            shown = shown.drop_columns([name for name in shown.column_names if name in (*_QUIET, *empty)])
        if shown.num_rows:
            typer.echo("\n".join(_aligned(shown)))
        typer.echo(f"{table.num_rows:,} of {planned:,} runs" + (f", {limit:,} of them shown" if limit else ""))


def _aligned(table: pyarrow.Table) -> list[str]:
    """Return a line for each row, under the shortest names that tell columns apart."""
    names = table.column_names
    short = [name.rpartition(".")[2] if _is_parameter(name) else name for name in names]
    heads = [brief if short.count(brief) == 1 else name for name, brief in zip(names, short, strict=True)]
    cells = [[_cell(value) for value in table[name].to_pylist()] for name in names]
    widths = [max(len(head), *map(len, each)) for head, each in zip(heads, cells, strict=True)]
    lines = [heads, *map(list, zip(*cells, strict=True))]
    return ["  ".join(f"{text:>{width}}" for text, width in zip(line, widths, strict=True)) for line in lines]


def _is_parameter(name: str) -> bool:
    return not name.startswith(("verdict.", "robustness."))


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"{value:.6g}" if isinstance(value, float) else printable(str(value))
