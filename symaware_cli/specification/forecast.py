"""Forecasts: the verdicts of a specification on predicted continuations of a run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.specification.automaton import AutomatonMonitor
from symaware_cli.specification.columns import Lookup
from symaware_cli.specification.monitor import Continuation, Monitor
from symaware_cli.specification.specification_monitor import SpecificationMonitor

Indices = NDArray[np.intp]


class Forecast:
    """Continues the monitor of a specification with predicted values: several continuations for each row.

    The continuations of a row are adjacent: values have the shape (m * count,).
    """

    def __init__(self, monitor: SpecificationMonitor, rows: Indices, count: int) -> None:
        """Begin with the present state of a monitor, which stays as it is.

        Args:
            monitor: The monitor, with `SpecificationMonitor.is_continued`.
            rows: The rows of the specification; each may occur several times. Shape (m,).
            count: The number of continuations of each.
        """
        self._specification = monitor.specification
        self._count = count
        self._rows = rows
        verdicts = monitor.verdicts[rows]
        self._parts: list[tuple[Indices, Continuation | Monitor | AutomatonMonitor]] = []
        self._is_over = monitor.is_over
        open_rows = verdicts >= 0  # a violation is final
        for cohort in monitor.cohorts:
            place = np.full(monitor.specification.scope.rows, -1, np.intp)
            undecided = cohort.monitor.verdict == 0
            place[cohort.rows[undecided]] = np.flatnonzero(undecided)
            chosen = np.flatnonzero((place[rows] >= 0) & open_rows)
            if len(chosen):
                verdicts[chosen] = 1  # whatever is decided elsewhere is satisfied
                own = np.repeat(place[rows[chosen]], count)
                former = cohort.monitor
                continued = Continuation(former, own) if isinstance(former, Monitor) else former.select(own)
                self._parts.append((self._places(chosen), continued))
        self._awaited = np.flatnonzero(monitor.awaited[rows] & open_rows)
        self._verdicts = np.repeat(verdicts, count)

    def look(self, time: int, look_up: Lookup, agents: Sequence[Sequence[str]]) -> None:
        """Evaluate the predicates at the next instant.

        Args:
            time: The instant, in nanoseconds.
            look_up: Returns the predicted values of a name; each of shape (m * count, ...).
            agents: The ids of the agents that each row is about, for errors.

        Raises:
            SpecificationError: A predicate has no value.
        """
        specification = self._specification
        if self._is_over or time < specification.start:
            return
        if specification.end is not None and time > specification.end:
            self._is_over = True
            for _, part in self._parts:
                part.finish()
            return
        if len(self._awaited):
            begun = specification.monitor(len(self._awaited) * self._count, arrays=True)
            self._parts.append((self._places(self._awaited), begun))
            self._verdicts[self._parts[-1][0]] = 1
            self._awaited = np.empty(0, np.intp)
        if not self._parts:
            return
        every = len(self._verdicts)
        values = specification.values(look_up, every, None, lambda row: agents[row // self._count])
        for places, part in self._parts:
            part.update(values if len(places) == every else [each[places] for each in values])

    @property
    def verdicts(self) -> NDArray[np.int8]:
        """The verdict of each continuation: 1 satisfied, -1 violated, 0 undecided; shape (m, count)."""
        verdicts = self._verdicts.copy()
        for places, part in self._parts:
            verdicts[places] = np.minimum(verdicts[places], part.verdict)
        return verdicts.reshape(-1, self._count)

    def _places(self, rows: Indices) -> Indices:
        """Return the continuations of some rows."""
        return (rows[:, None] * self._count + np.arange(self._count)).ravel()
