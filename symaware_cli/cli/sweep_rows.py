"""``symaware rows``, ``shares`` and ``compare``: the table of a sweep in the terminal."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from symaware_cli.cli import terminal
from symaware_cli.cli.terminal import print_array, printable, say
from symaware_cli.cli.text_table import aligned
from symaware_cli.help_place import in_help

if TYPE_CHECKING:
    import pyarrow

    from symaware_cli.studies import Cell, IntervalEstimate

#: Columns that are shown only when they are asked for, or as JSON or CSV.
_QUIET = ("replicate", "seed", "digest", "error")


Folder = Annotated[Path, typer.Argument(help="The folder of a sweep.", metavar="DIR")]


@in_help("look", 30)
def rows(
    folder: Folder,
    where: Annotated[str | None, typer.Option(help="A condition on the columns, such as `closest < 0.6`.")] = None,
    sort: Annotated[
        str | None, typer.Option(help="The column to sort by; with a minus before it, in descending order.")
    ] = None,
    columns: Annotated[str | None, typer.Option(help="The columns, separated by commas.")] = None,
    limit: Annotated[int | None, typer.Option(min=0, help="Greatest number of rows.")] = None,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
    as_json: terminal.Json = False,
) -> None:
    """Show the table of a sweep, one row for each run, also while it is running."""
    terminal.refuse([(as_csv and as_json, "--csv and --json are two forms of the table: give one of them")], as_json)
    with terminal.trouble_shown(as_json):
        from symaware_cli.studies import read_rows, require_pyarrow

        require_pyarrow()
        import pyarrow

        wanted = terminal.names(columns)
        table, planned = read_rows(folder, where, sort, None, wanted)
        shown = table if limit is None else table.slice(0, limit)
        if as_json:
            print_array(shown.to_pylist())
        elif as_csv:
            from pyarrow import csv

            sink = pyarrow.BufferOutputStream()
            csv.write_csv(_flat(shown), sink)
            sys.stdout.write(sink.getvalue().to_pybytes().decode())
        else:
            if not wanted:
                empty = [name for name in shown.column_names if shown[name].null_count == shown.num_rows]
                lists = [each.name for each in shown.schema if pyarrow.types.is_list(each.type)]
                shown = shown.drop_columns([name for name in shown.column_names if name in (*_QUIET, *lists, *empty)])
            if shown.num_rows:
                say("\n".join(_aligned(shown.to_pylist())))
            say(f"{table.num_rows:,} of {planned:,} runs" + (f", {limit:,} of them shown" if limit else ""))


@in_help("look", 35)
def shares(folder: Folder, as_json: terminal.Json = False) -> None:
    """Show the share of the runs of a sweep that satisfy each specification, with intervals."""
    with terminal.trouble_shown(as_json):
        from symaware_cli.studies import read_shares

        found = read_shares(folder)
        if as_json:
            print_array(each.to_json() for each in found)
            return
        if not found:
            say("the scenario has no specifications")
            return
        lines = [
            {
                **_of(each.cell),
                "specification": each.specification,
                "satisfied": f"{each.satisfied:,} of {each.interval.count:,}",
                "share": each.interval.value,
                "from": each.interval.lower,
                "to": each.interval.upper,
            }
            for each in found
        ]
        say("\n".join(_with_method(lines, found[0].interval)))


@in_help("compare", 20)
def compare(
    folder: Folder,
    column: Annotated[str, typer.Argument(help="A column of the table, such as `closest`.")],
    as_json: terminal.Json = False,
) -> None:
    """Compare the paired variants of a sweep in one column, run by run."""
    with terminal.trouble_shown(as_json):
        from symaware_cli.studies import read_differences

        found = read_differences(folder, column)
        if as_json:
            print_array(each.to_json() for each in found)
            return
        lines = [
            {
                **_of(each.cell),
                "mean": each.comparison.mean.value,
                "from": each.comparison.mean.lower,
                "to": each.comparison.mean.upper,
                "greater": each.comparison.greater,
                "less": each.comparison.less,
                "sign test": each.comparison.sign_test,
                "variance ratio": each.comparison.variance_ratio,
            }
            for each in found
        ]
        first = found[0].comparison.mean
        say(f"{column}, less that of {found[0].against}, run by run")
        say("\n".join(_with_method(lines, first, f", {first.count:,} pairs")))


def _with_method(lines: Sequence[Mapping[str, Any]], estimate: IntervalEstimate, more: str = "") -> list[str]:
    """Return aligned lines and the method of their intervals; dependent runs have none, nor columns that need them."""
    if estimate.method:
        return [*_aligned(lines), f"intervals: {estimate.method}, confidence {estimate.confidence:g}{more}"]
    assuming = ("from", "to", "sign test", "variance ratio")
    kept = [{name: value for name, value in line.items() if name not in assuming} for line in lines]
    return [*_aligned(kept), f"no intervals: the runs depend on each other by their design{more}"]


def _flat(table: pyarrow.Table) -> pyarrow.Table:
    """Write lists as JSON: CSV has none."""
    import pyarrow

    for number, field in enumerate(table.schema):
        if pyarrow.types.is_list(field.type):
            texts = [None if each is None else json.dumps(each) for each in table[number].to_pylist()]
            table = table.set_column(number, field.name, pyarrow.array(texts, pyarrow.string()))
    return table


def _of(cell: Cell) -> dict[str, Any]:
    return {**({} if cell.variant is None else {"variant": cell.variant}), **cell.parameters}


def _aligned(lines: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return lines under the shortest names that tell columns apart."""
    from symaware_cli.studies import brief_names

    names = list(lines[0])
    heads = brief_names(names, _is_parameter)
    texts = [heads, *([_cell(line[name]) for name in names] for line in lines)]
    return aligned(texts, ">", indent="")


def _is_parameter(name: str) -> bool:
    return not name.startswith(("verdict.", "robustness."))


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return ", ".join(" ".join(map(_cell, each.values())) for each in value) or "-"
    return f"{value:.6g}" if isinstance(value, float) else printable(str(value))
