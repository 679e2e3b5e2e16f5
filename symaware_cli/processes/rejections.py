"""Counts of the frames that a host rejected."""

from __future__ import annotations

import time
from collections.abc import Mapping

from symaware_cli.processes.frame import Notice
from symaware_cli.processes.transport import Rejection

#: Wall time between two notices [s].
_INTERVAL = 1.0


class Rejections:
    """Counts rejected frames, and reports the counts at most once a second."""

    def __init__(self, rejected: Mapping[Rejection, int]) -> None:
        """Initialise.

        Args:
            rejected: The counts of the port by reason; they keep growing.
        """
        self._rejected = rejected
        self._malformed, self._example = 0, ""
        self._told: dict[str, int] = {}
        self._due = 0.0

    def count(self, example: str) -> None:
        """Count a malformed frame; a sentence describes it."""
        self._malformed += 1
        self._example = example

    def news(self, at_last: bool = False) -> Notice | None:
        """Return a notice of rejections that were not recorded yet; None if there are none, or it is too early."""
        counts = {str(why): count for why, count in self._rejected.items() if count}
        if self._malformed:
            counts["malformed"] = self._malformed
        if counts == self._told:
            return None
        now = time.monotonic()
        if now < self._due and not at_last:
            return None
        self._due = now + _INTERVAL
        new = {why: count - self._told.get(why, 0) for why, count in sorted(counts.items())}
        self._told = counts
        said = ", ".join(f"{count} {why}" for why, count in new.items() if count)
        text = f"frames were not taken: {said}" + (f"; {self._example}" if self._example else "")
        self._example = ""
        return Notice("rejected", "run", "WARNING", text, {"total": dict(sorted(counts.items()))})
