"""Selects the rows of a group that are recorded at present."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from symaware_cli.core import AgentGroup


class RecordedRows:
    """The rows of the agents that run in this process and are present."""

    __slots__ = ("_group", "_now", "_own", "_present")

    def __init__(self, group: AgentGroup, own: Sequence[int] | None = None) -> None:
        """Initialise the selection.

        Args:
            group: The group.
            own: The rows of agents that run in this process, ascending; None for all.
        """
        self._group = group
        self._own = None if own is None or len(own) == len(group) else list(own)
        self._now = self._own
        self._present: Any = None

    @property
    def now(self) -> list[int] | None:
        """The rows recorded now, ascending; None for all."""
        present = self._group.present
        if present is not self._present:
            self._present = present
            rows = range(len(self._group)) if self._own is None else self._own
            chosen = [row for row in rows if present is None or present[row]]
            self._now = None if len(chosen) == len(self._group) else chosen
        return self._now
