"""Sections of ``symaware report``, for plugins that add one.

A plugin derives from `ReportSection` and yields blocks of plain data; it is registered in the group
``symaware.reports``.
"""

from symaware_cli.evidence import ReportSection, ReportSubject
from symaware_cli.views import Block, CodeLines, DataTable, FactTable, Fold, Inline, Paragraph, Picture, SourceText

__all__ = [
    "Block",
    "CodeLines",
    "DataTable",
    "FactTable",
    "Fold",
    "Inline",
    "Paragraph",
    "Picture",
    "ReportSection",
    "ReportSubject",
    "SourceText",
]
