"""CSV files: UTF-8, a header, commas, line feeds, and numbers that round-trip; images are separate files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from symaware_cli.views.exporting.conversion import TableFormat
from symaware_cli.views.exporting.table import Cells, ImageCells, Names, Table, Values, images_beside, length

_PIECE = 16384
"""Number of rows that are formatted at a time."""

_SPECIAL = re.compile('[",\r\n]')


class TextSheet:
    """A CSV file."""

    def __init__(self, path: Path, table: Table) -> None:
        """Create the file.

        Args:
            path: The path of the file.
            table: The table to write.

        Raises:
            OSError: The file cannot be created.
        """
        self._file = open(path, "w", encoding="utf-8", newline="")  # noqa: SIM115 (closed by close)
        self._images = images_beside(path)
        self._rows = 0
        self._write([(column.name for column in table.columns)])

    def write(self, values: Sequence[Values]) -> None:
        """Append rows."""
        # A piece at a time, since a number takes ten times the memory as text.
        cells = [self._write_images(each) if isinstance(each, ImageCells) else each for each in values]
        for start in range(0, length(values[0]), _PIECE):
            piece = slice(start, start + _PIECE)
            self._write(zip(*(_cells(each, piece) for each in cells), strict=True))
        self._rows += length(values[0])

    def _write_images(self, images: ImageCells) -> list[str]:
        """Write images to separate files, numbered by row, and return their paths."""
        self._images.mkdir(exist_ok=True)
        names = [f"{row:06}.png" for row, _ in enumerate(images.files, self._rows)]
        for name, content in zip(names, images.files, strict=True):
            (self._images / name).write_bytes(content)
        return [f"{self._images.name}/{name}" for name in names]

    def close(self) -> None:
        """Finish the file."""
        self._file.close()

    def _write(self, rows: Iterable[Iterable[str]]) -> None:
        self._file.writelines(f"{','.join(row)}\n" for row in rows)


class CsvTables(TableFormat):
    """A folder of CSV files: UTF-8, a header, commas; units and facts about the run are in tables of their own."""

    table_suffix: ClassVar = ".csv"

    def sheet(self, path: Path, table: Table, about: Mapping[str, str]) -> TextSheet:
        """Create a CSV file."""
        return TextSheet(path, table)


def _cells(values: Cells, piece: slice) -> Iterable[str]:
    match values:
        case Names():
            names = [*map(_quoted, values.names), ""]  # the last is for code -1
            return [names[code] for code in values.codes[piece].tolist()]
        case list():
            return map(_quoted, values[piece])
        case _:
            # The shortest decimals that round-trip. NaN is an empty cell, as spreadsheets have no NaN.
            cells = map(repr, values[piece].tolist())
            return ["" if cell == "nan" else cell for cell in cells] if np.isnan(values[piece]).any() else cells


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if _SPECIAL.search(text) else text
