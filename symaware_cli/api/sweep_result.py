"""The rows of a sweep: a table of Arrow, and data frames of it.

Reasons: docs/decisions/0076-frames.md
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pyarrow

    from symaware_cli.log import FrameLibrary


@dataclass(frozen=True, eq=False, repr=False)
class SweepResult:
    """The rows of a sweep, which is used like the table: its methods and columns are those of `table`.

    Attributes:
        table: One row for each run; docs/sweeps.md describes the columns.
        planned: The number of planned runs.
        path: The folder of the sweep; None if it was not kept.
    """

    table: pyarrow.Table
    planned: int
    path: Path | None = None

    def frame(self, to: FrameLibrary = "pandas") -> Any:
        """Return the rows as a data frame.

        Args:
            to: The library: ``pandas``, ``polars`` or ``arrow`` (`table` itself).

        Returns:
            The frame. Units are in ``attrs["units"]`` of pandas and in the metadata ``unit`` of the fields of Arrow;
            Polars keeps none. Missing numbers are NaN in pandas, and null in the others.

        Raises:
            LogError: There is no such library, or it is not installed.
        """
        from symaware_cli.log import frame_of_table

        return frame_of_table(self.table, to)

    def equals(self, other: SweepResult | pyarrow.Table) -> bool:
        """Whether the rows equal those of another sweep or table."""
        return bool(self.table.equals(other.table if isinstance(other, SweepResult) else other))

    def __len__(self) -> int:
        return len(self.table)

    def __getitem__(self, key: Any) -> Any:
        return self.table[key]

    def __getattr__(self, name: str) -> Any:
        # Special methods, which copying and pickling look up before there is a table, are not those of the table.
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.table, name)

    def __arrow_c_stream__(self, requested_schema: Any = None) -> Any:
        return self.table.__arrow_c_stream__(requested_schema)

    def __repr__(self) -> str:
        place = f", {self.path}" if self.path else ""
        return f"<SweepResult {len(self):,} of {self.planned:,} runs, {len(self.table.column_names)} columns{place}>"
