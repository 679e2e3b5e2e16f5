"""Messages between agents: lines of a log, and for a moment an arrow from the sender to the receiver."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.recording import journal
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.excerpt import Excerpt

Array = NDArray[np.float64]

#: Longer lines of the log are cut.
_LONGEST = 300


class Messages(Drawing):
    """Messages as they are sent, delivered and dropped; the view shows each arrow for a moment."""

    def begin(self) -> None:
        """Put up how arrows look."""
        import rerun as rr

        look = rr.Arrows3D.from_fields(radii=rr.Radius.ui_points([1.0]), colors=[(250, 220, 120)])
        self.stage.static("world/messages", look)

    def draw(self, excerpt: Excerpt) -> None:
        """Write and draw the messages."""
        entries = [
            entry
            for topic in ("/messages", "/messages/columns")
            for time, message in excerpt.entries.get(topic, ())
            for entry in journal.communications(time, message, self.cast.roster)
        ]
        entries.sort(key=lambda entry: entry.time)
        self.stage.texts(
            "log/messages",
            [entry.time for entry in entries],
            [_line(entry) for entry in entries],
            ["WARN" if entry.stage == "DROPPED" else "DEBUG" for entry in entries],
        )
        delivered = [entry for entry in entries if entry.stage == "DELIVERED"]
        times = np.array([entry.time for entry in delivered], np.int64)
        origins = self._ends([entry.sender for entry in delivered], times, excerpt)
        vectors = self._ends([entry.receiver for entry in delivered], times, excerpt) - origins
        known = np.isfinite(vectors).all(axis=1)
        moments, counts = np.unique(times[known], return_counts=True)
        self.stage.arrows("world/messages", moments, origins[known], vectors[known], counts)

    def _ends(self, agents: Sequence[str], times: NDArray[np.int64], excerpt: Excerpt) -> Array:
        """Where each of some agents is, each at its time; (m, 3) [m]."""
        places, names = np.empty((len(agents), 3)), np.array(agents)
        for name in dict.fromkeys(agents):
            mine = names == name
            places[mine] = self.places(name, times[mine], excerpt)
        return places


def _line(entry: journal.Communication) -> str:
    late = f" after {(entry.time - entry.sent_time) / 1e9:g} s" if entry.time > entry.sent_time else ""
    why = f" ({entry.reason})" if entry.reason else ""
    says = f"  {json.dumps(entry.payload)}" if entry.payload is not None else ""
    time = f"{entry.time / 1e9:8.2f} s"
    line = f"{time}  {entry.stage.lower()}{late}{why}  {entry.sender} -> {entry.receiver}  {entry.kind}{says}"
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 1]}…"
