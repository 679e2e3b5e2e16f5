"""Quantities: the names and units of numbers."""

from __future__ import annotations

from typing import NamedTuple


class Quantity(NamedTuple):
    """One element of a state or control input."""

    name: str
    unit: str
