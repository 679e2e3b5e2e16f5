"""A finding: something in the folder of a sweep, or in a certificate of it, that contradicts something else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Finding:
    """Something in the folder of a sweep that is not as it has to be.

    Attributes:
        index: The number of the run; None if it is about all of them.
        column: The column of the table, or what else it is about.
        found: What is there.
        expected: What has to be there.
    """

    index: int | None
    column: str
    found: Any
    expected: Any
