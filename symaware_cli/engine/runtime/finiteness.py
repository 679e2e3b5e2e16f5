"""Finiteness: whether the values that a component wrote in a turn are within their bounds.

Reasons: docs/decisions/0062-values-out-of-bounds.md
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from symaware_cli.awareness import SeriesColumn, SignalColumn, ValueRange
from symaware_cli.core import AgentGroup, Tracks
from symaware_cli.engine.runtime.protected_rows import merged
from symaware_cli.world import FARTHEST, said_of

#: What is believed of the motion of others; a velocity may be unknown.
_POSITIONS, _VELOCITIES = ValueRange(FARTHEST), ValueRange(FARTHEST, nan=True)


class FinitenessCheck:
    """Checks the values from the components of one entry: control inputs, parts of awareness, signals and tracks."""

    def __init__(self, group: AgentGroup, path: str, use: str) -> None:
        """Prepare.

        Args:
            group: The group of the components.
            path: The path of the entry.
            use: Its plugin.
        """
        awareness = group.awareness
        self._awareness = awareness
        written = [
            (group.control_column, "control input"),
            *(
                (column, f"signal `{name}`" if name in awareness.signals else name)
                for name, column in awareness.columns.items()
            ),
        ]
        #: The columns with their positions and names; series, which may be deferred, also as such, with their author.
        self._columns: tuple[tuple[int, SignalColumn, str, SeriesColumn | None, tuple[str, str, str]], ...] = tuple(
            (number, column, what, column if isinstance(column, SeriesColumn) else None, (what, path, use))
            for number, (column, what) in enumerate(written)
        )

        #: The positions of the columns that the components wrote.
        self._written: set[int] = set()

    def clear(self, rows: Sequence[int]) -> None:
        """Clear the values that the components wrote for some agents, except believed states and control inputs."""
        kept = self._awareness.state_column
        for number in sorted(self._written - {0}):
            column = self._columns[number][1]
            if column is not kept:
                column.clear(rows)

    def passes(self) -> bool:
        """Whether nothing written since the last check is out of its bounds; then all of it counts as checked.

        If not, `violations` finds what is, and looks at beliefs about others as well.
        """
        for number, column, _, series, author in self._columns:
            if column.fresh:
                self._written.add(number)
                if series is not None:
                    series.author = author
                if not column.passes():
                    return False
        awareness = self._awareness
        if awareness.version is not awareness.sound:
            if awareness.seen is not None or awareness.received is not None:
                return False
            awareness.sound = awareness.version
        return True

    def snapshot(self) -> Sequence[Any]:
        """Return the present values; writing replaces arrays, so none are copied."""
        awareness = self._awareness
        return [*(column.held() for _, column, *_ in self._columns), awareness.seen, awareness.received]

    def violations(self, before: Sequence[Any] | None) -> Iterator[tuple[Sequence[int], str]]:
        """Find values written since the last check that are out of their bounds.

        Args:
            before: The values to restore in the rows found, from `snapshot`; None to leave them as they are.

        Yields:
            Rows, ascending, and the problem of the first of them.
        """
        for number, column, what, series, author in self._columns:
            if not column.fresh:
                continue
            self._written.add(number)
            if series is not None:
                series.author = author
                if before is not None:
                    series.settle()  # later it could not be restored
            rows = column.take_beyond()
            if not rows:
                continue
            problem = f"its {what} {column.problem(rows[0])}"
            if before is not None:
                column.put_back(rows, before[number])
            yield rows, problem
        yield from self._in_tracks(before)

    def _in_tracks(self, before: Sequence[Any] | None) -> Iterator[tuple[Sequence[int], str]]:
        awareness = self._awareness
        if awareness.version is awareness.sound:
            return
        for number, name in ((-2, "seen"), (-1, "received")):
            tracks: Tracks | None = getattr(awareness, name)
            if tracks is None or (_POSITIONS.includes(tracks.positions) and _VELOCITIES.includes(tracks.velocities)):
                continue
            beyond = _POSITIONS.rows_beyond(tracks.positions) or _VELOCITIES.rows_beyond(tracks.velocities)
            rows = sorted({*tracks.observers[beyond].tolist()})
            problem = f"what it knows of the motion of another agent {said_of(tracks.motions[beyond[0]])}"
            if before is not None:
                held = np.zeros(len(tracks.pointers) - 1, bool)
                held[rows] = True
                setattr(awareness, name, merged(tracks, before[number], held))
            yield rows, problem
        awareness.sound = awareness.version
