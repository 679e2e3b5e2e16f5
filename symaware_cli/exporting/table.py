"""The tables that a log is laid out in, and what a file of them can do."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Kind = Literal["number", "integer", "name", "text", "image"]
"""What a column holds: float64, int64, one of few names, text, or a PNG."""


@dataclass(frozen=True, slots=True)
class ExportColumn:
    """A column.

    Attributes:
        name: Unique in its table.
        kind: What it holds.
        unit: SI, such as ``m/s``; ``1`` for numbers without a unit, empty for what is no number or not known.
        description: In a few words.
    """

    name: str
    kind: Kind
    unit: str = ""
    description: str = ""


@dataclass(frozen=True, slots=True)
class Names:
    """The values of a column of names.

    Attributes:
        codes: (m,) indices in `names`; -1 for no name.
        names: All that may occur, in an order that is the same for the whole table.
    """

    codes: NDArray[np.int32]
    names: Sequence[str]


@dataclass(frozen=True, slots=True)
class ImageCells:
    """The values of a column of images.

    Attributes:
        files: (m,) the content of each.
    """

    files: Sequence[bytes]


Cells: TypeAlias = "NDArray[np.float64] | NDArray[np.int64] | Names | list[str]"
"""The values of a column that a line of text can hold."""

Values: TypeAlias = "Cells | ImageCells"
"""The values of a column, by its kind."""


@dataclass(frozen=True, slots=True)
class Table:
    """A table.

    Attributes:
        path: Where it stands, such as ``state/robot``; without the suffix of the format.
        columns: Its columns.
        optional: Whether it is left out where nothing was recorded for it.
    """

    path: str
    columns: tuple[ExportColumn, ...]
    optional: bool = False

    def values(self, rows: Sequence[Sequence[Any]], names: Sequence[str] = ()) -> list[Values]:
        """Turn rows into the values of each column.

        Args:
            rows: A cell for each column; a name is an index in `names`.
            names: What the columns of names stand for.

        Raises:
            ValueError: The rows are not equally long.
        """
        cells = list(zip(*rows, strict=True)) if rows else [()] * len(self.columns)
        return [_values(column.kind, each, names) for column, each in zip(self.columns, cells, strict=True)]


class Sheet(Protocol):
    """A file that a table is written to."""

    def write(self, values: Sequence[Values]) -> None:
        """Append rows.

        Args:
            values: Of each column, equally long.

        Raises:
            OSError: They cannot be written.
        """

    def close(self) -> None:
        """Finish the file.

        Raises:
            OSError: It cannot be written.
        """


@dataclass(frozen=True, slots=True)
class Form:
    """A format of files.

    Attributes:
        suffix: Of the files.
        sheet: Creates a file at a path, for a table, with what there is to say of the log.
        explains: Whether the files say themselves what their units are, and which log they are of.
    """

    suffix: str
    sheet: Callable[[Path, Table, Mapping[str, str]], Sheet]
    explains: bool


def place_columns(description: str, prefix: str = "") -> tuple[ExportColumn, ExportColumn, ExportColumn]:
    """Columns of a place, in which a place in a plane has no height."""
    x, y, z = (f"{prefix}{axis}" for axis in "xyz")
    return (
        ExportColumn(x, "number", "m", description),
        ExportColumn(y, "number", "m", description),
        ExportColumn(z, "number", "m", f"{description}; NaN in a plane"),
    )


def place_cells(place: Sequence[float]) -> tuple[float, ...]:
    """The cells of `place_columns`: three of a place of two or three numbers, or of none."""
    return (*place, np.nan, np.nan, np.nan)[:3]


def length(values: Values) -> int:
    """How many rows the values of a column are."""
    match values:
        case Names():
            return len(values.codes)
        case ImageCells():
            return len(values.files)
        case _:
            return len(values)


def images_beside(path: Path) -> Path:
    """The folder of the images of a file that cannot hold them."""
    return path.with_suffix("")


def _values(kind: Kind, cells: Sequence[Any], names: Sequence[str]) -> Values:
    match kind:
        case "number":
            return np.array(cells, np.float64)
        case "integer":
            return np.array(cells, np.int64)
        case "name":
            return Names(np.array(cells, np.int32), names)
        case "image":
            return ImageCells(cells)
        case _:
            return list(cells)
