"""Contacts: which bodies begin to touch, and cease to."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Contact:
    """Two bodies that touch, or cease to.

    Attributes:
        first: The id or name of one body; the lesser of the two by name.
        second: The other.
        point: Where they touch [m].
        depth: How far they overlap [m].
        impulse: How hard they hit each other in the step in which it begins, along the line of contact [N s]; 0 in
            worlds without forces, and where it ends.
        begins: They touch from now on; False when they part.
    """

    first: str
    second: str
    point: tuple[float, ...]
    depth: float
    begins: bool = True
    impulse: float = 0.0
