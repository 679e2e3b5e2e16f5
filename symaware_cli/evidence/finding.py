"""Findings: contradictions in the folder of a sweep or in its certificate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Finding:
    """A value in the folder of a sweep, or in its certificate, that contradicts the expected one.

    Attributes:
        index: The number of the run; None if the finding concerns no single run.
        column: The column of the table, or the name of another item.
        found: The value found.
        expected: The expected value.
    """

    index: int | None
    column: str
    found: Any
    expected: Any
