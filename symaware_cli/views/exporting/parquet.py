"""Parquet files, with units and descriptions as metadata of the columns, and facts about the log as file metadata."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from symaware_cli.views.exporting.conversion import TableFormat
from symaware_cli.views.exporting.table import ExportColumn, ImageCells, Names, Table, Values

if TYPE_CHECKING:
    import pyarrow


class ParquetSheet:
    """A Parquet file, in which each call of `write` creates a row group."""

    def __init__(self, path: Path, table: Table, about: Mapping[str, str]) -> None:
        """Create the file.

        Args:
            path: The path of the file.
            table: The table to write.
            about: Facts about the log.

        Raises:
            OSError: The file cannot be created.
        """
        import pyarrow
        from pyarrow import parquet

        self._schema = pyarrow.schema(
            [_field(column) for column in table.columns], {f"symaware.{key}": value for key, value in about.items()}
        )
        # Opened here, since the OSError of pyarrow does not give the reason.
        self._file = open(path, "wb")  # noqa: SIM115 (closed by close)
        # Dictionary encoding pays off for repeating values: names, and the times that all agents share.
        unique = ("number", "image")
        repeating = [column.name for column in table.columns if column.kind not in unique or column.name == "time"]
        self._writer = parquet.ParquetWriter(
            self._file, self._schema, compression="zstd", use_dictionary=repeating or False
        )

    def write(self, values: Sequence[Values]) -> None:
        """Append rows."""
        import pyarrow

        arrays = [_array(each, field.type) for each, field in zip(values, self._schema, strict=True)]
        self._writer.write_table(pyarrow.Table.from_arrays(arrays, schema=self._schema))

    def close(self) -> None:
        """Finish the file."""
        try:
            self._writer.close()
        finally:
            self._file.close()


class ParquetTables(TableFormat):
    """A folder of Parquet files: typed, compressed, with units and facts about the run as metadata."""

    table_suffix: ClassVar = ".parquet"
    explains: ClassVar = True
    requires: ClassVar = {"pyarrow": "pip install 'symaware-cli[export]'"}

    def sheet(self, path: Path, table: Table, about: Mapping[str, str]) -> ParquetSheet:
        """Create a Parquet file."""
        return ParquetSheet(path, table, about)


def _field(column: ExportColumn) -> pyarrow.Field:
    import pyarrow

    types = {
        "number": pyarrow.float64(),
        "integer": pyarrow.int64(),
        "name": pyarrow.dictionary(pyarrow.int32(), pyarrow.string()),
        "text": pyarrow.string(),
        "image": pyarrow.binary(),
    }
    notes = {"unit": column.unit, "description": column.description}
    return pyarrow.field(column.name, types[column.kind], metadata={key: note for key, note in notes.items() if note})


def _array(values: Values, kind: pyarrow.DataType) -> pyarrow.Array:
    import pyarrow

    if isinstance(values, Names):
        codes = pyarrow.array(values.codes, mask=values.codes < 0)
        return pyarrow.DictionaryArray.from_arrays(codes, pyarrow.array(values.names, pyarrow.string()))
    return pyarrow.array(values.files if isinstance(values, ImageCells) else values, kind)
