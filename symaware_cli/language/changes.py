"""Changes of a scenario: values by their paths, or texts as `--set` takes them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from os import PathLike
from typing import Any

from symaware_cli.language.assignment import Assignment

FilePath = str | PathLike[str]

Changes = Mapping[str, Any] | Iterable[str] | Iterable[Assignment]
"""Values by their paths, such as ``{"agents.robot.count": 8}``, or texts such as ``agents.robot.count=8``."""


def assignments(changes: Changes | None, option: str = "--set") -> tuple[Assignment, ...]:
    """Return changes as assignments, located at an option in messages.

    Raises:
        TypeError: A value has a type that scenarios do not support.
    """
    if changes is None:
        return ()
    if isinstance(changes, Mapping):
        return tuple(Assignment.of(path, value, option) for path, value in changes.items())
    texts = (changes,) if isinstance(changes, str) else changes
    return tuple(Assignment.parse(each, option) if isinstance(each, str) else each for each in texts)
