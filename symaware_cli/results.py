"""Formats of files with results (``--results FORMAT:FILE``), for plugins that add one.

A plugin derives from `ResultFormat` and returns the content of a file from test cases; it is registered in the group
``symaware.results``.
"""

from symaware_cli.evidence import CaseStatus, ResultCase, ResultFormat

__all__ = ["CaseStatus", "ResultCase", "ResultFormat"]
