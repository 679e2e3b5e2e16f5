"""Formats of ``symaware export``, for plugins that add one.

A plugin derives from `TableFormat`, which writes the tables of a log in batches of columns, or from `ExportFormat`,
which writes anything else; it is registered in the group ``symaware.exports``.
"""

from symaware_cli.views import (
    ExportColumn,
    Exported,
    ExportFormat,
    ImageCells,
    Names,
    Progress,
    Selection,
    Sheet,
    Table,
    TableFormat,
    Values,
)

__all__ = [
    "ExportColumn",
    "ExportFormat",
    "Exported",
    "ImageCells",
    "Names",
    "Progress",
    "Selection",
    "Sheet",
    "Table",
    "TableFormat",
    "Values",
]
