"""The table of a sweep as a file, written atomically; reading it imports nothing that runs simulations."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from symaware_cli.studies.sweep_error import SweepError
from symaware_cli.studies.sweep_files import TABLE

if TYPE_CHECKING:
    import pyarrow

#: The metadata key of a table for the number of planned runs.
PLANNED = b"symaware.planned"


def write(path: Path, content: Iterator[pyarrow.RecordBatch], columns: pyarrow.Schema) -> None:
    """Write a Parquet file atomically."""
    import pyarrow
    from pyarrow import parquet

    draft = path.with_name(f".{path.name}")
    with parquet.ParquetWriter(draft, columns, compression="zstd") as writer:
        for batch in content:
            writer.write_table(pyarrow.Table.from_batches([batch]))
    os.replace(draft, path)


def read(folder: Path) -> tuple[pyarrow.Table, int] | None:
    """Return the table in a sweep folder and the number of planned runs; None without a table.

    There is no table while the sweep is running or after runs were added to it.

    Raises:
        SweepError: The file is damaged.
    """
    from pyarrow import parquet

    try:
        # `read_table` would import the support for folders of files first.
        with parquet.ParquetFile(folder / TABLE) as file:
            table = file.read()
        return table, int(table.schema.metadata[PLANNED])
    except FileNotFoundError:
        return None
    except (LookupError, OSError, TypeError, ValueError) as error:
        first = next(iter(str(error).splitlines()), "")
        raise SweepError(f"{folder / TABLE} is damaged, `symaware resume {folder}` writes it again: {first}") from error
