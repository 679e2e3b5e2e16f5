"""Export tables: columns and their values, and the files that they are written to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Kind = Literal["number", "integer", "name", "text", "image"]
"""The type of a column: float64, int64, one of a few names, text, or PNG."""


@dataclass(frozen=True, slots=True)
class ExportColumn:
    """A column of an export table.

    Attributes:
        name: Unique in its table.
        kind: Its type.
        unit: SI, such as ``m/s``; ``1`` for dimensionless numbers, empty if not a number or unknown.
        description: A short description.
    """

    name: str
    kind: Kind
    unit: str = ""
    description: str = ""


@dataclass(frozen=True, slots=True)
class Names:
    """The values of a column of names.

    Attributes:
        codes: (m,) indices in `names`; -1 for none.
        names: All names that may occur; the same for the whole table.
    """

    codes: NDArray[np.int32]
    names: Sequence[str]


@dataclass(frozen=True, slots=True)
class ImageCells:
    """The values of a column of images.

    Attributes:
        files: (m,) the content of each image.
    """

    files: Sequence[bytes]


Cells: TypeAlias = "NDArray[np.float64] | NDArray[np.int64] | Names | list[str]"
"""The values of a column that can be written as text."""

Values: TypeAlias = "Cells | ImageCells"
"""The values of a column, by its kind."""


@dataclass(frozen=True, slots=True)
class Table:
    """An export table.

    Attributes:
        path: Its path, such as ``state/robot``; without the suffix of the format.
        columns: Its columns.
        optional: Whether it is omitted if nothing was recorded for it.
    """

    path: str
    columns: tuple[ExportColumn, ...]
    optional: bool = False

    def values(self, rows: Sequence[Sequence[Any]], names: Sequence[str] = ()) -> list[Values]:
        """Convert rows to the values of each column.

        Args:
            rows: A cell for each column; a name is an index in `names`.
            names: The names that columns of names refer to.

        Raises:
            ValueError: The rows have different lengths.
        """
        cells = list(zip(*rows, strict=True)) if rows else [()] * len(self.columns)
        return [_values(column.kind, each, names) for column, each in zip(self.columns, cells, strict=True)]


class Sheet(Protocol):
    """A file that a table is written to."""

    def write(self, values: Sequence[Values]) -> None:
        """Append rows.

        Args:
            values: The values of each column, equally long.

        Raises:
            OSError: They cannot be written.
        """

    def close(self) -> None:
        """Finish the file.

        Raises:
            OSError: It cannot be written.
        """


def place_columns(description: str, prefix: str = "") -> tuple[ExportColumn, ExportColumn, ExportColumn]:
    """Return the columns of a position; in a plane, the z column is NaN."""
    x, y, z = (f"{prefix}{axis}" for axis in "xyz")
    return (
        ExportColumn(x, "number", "m", description),
        ExportColumn(y, "number", "m", description),
        ExportColumn(z, "number", "m", f"{description}; NaN in a plane"),
    )


def place_cells(place: Sequence[float]) -> tuple[float, ...]:
    """Return the three cells of `place_columns` for a position of two or three numbers, or of none."""
    return (*place, np.nan, np.nan, np.nan)[:3]


def length(values: Values) -> int:
    """Return the number of values of a column."""
    match values:
        case Names():
            return len(values.codes)
        case ImageCells():
            return len(values.files)
        case _:
            return len(values)


def images_beside(path: Path) -> Path:
    """Return the folder for the images of a file that cannot contain them."""
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
