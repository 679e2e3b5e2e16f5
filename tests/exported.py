"""Functions for tests of exports: the formats of this package, and their output."""

import os
from collections.abc import Callable

from symaware_cli.log.reader import Log
from symaware_cli.views.exporting.conversion import Written
from symaware_cli.views.exporting.export_format import ExportFormat
from symaware_cli.views.exporting.log_selection import Selection
from symaware_cli.views.exporting.parquet import ParquetTables
from symaware_cli.views.exporting.text import CsvTables
from symaware_cli.views.foxglove import FoxgloveFile

CSV, PARQUET = CsvTables(), ParquetTables()


def export_tables(
    log: Log,
    folder: str | os.PathLike[str],
    form: ExportFormat,
    selection: Selection | None = None,
    on_progress: Callable[[int], None] | None = None,
) -> list[Written]:
    """Export a log as tables."""
    return [Written(**each) for each in form.export(log, folder, selection, on_progress).facts["tables"]]


def export_foxglove(log: Log, path: str | os.PathLike[str]) -> dict[str, int]:
    """Export a log for Foxglove, and return the number of messages on each topic."""
    return dict(FoxgloveFile().export(log, path).facts["topics"])
