"""Cohorts: rows of a specification that are evaluated from the same instant on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symaware_cli.specification.automaton import AutomatonMonitor
from symaware_cli.specification.formula import plain
from symaware_cli.specification.monitor import Monitor


class Cohort:
    """Rows whose evaluation began at the same instant.

    Attributes:
        rows: Their indices, ascending; shape (k,).
        monitor: Their monitor.
        start: Their first instant, in nanoseconds.
        told: Their verdicts as last reported; shape (k,).
    """

    def __init__(
        self, rows: NDArray[np.intp], monitor: Monitor | AutomatonMonitor, start: int, told: NDArray[np.int8]
    ) -> None:
        self.rows = rows
        self.monitor = monitor
        self.start = start
        self.told = told

    def select(self, chosen: NDArray[np.bool_]) -> Cohort:
        """Return some of the rows, with their history."""
        return Cohort(self.rows[chosen], self.monitor.select(np.flatnonzero(chosen)), self.start, self.told[chosen])


class Worst:
    """Verdicts and intervals of rows, each the worst over several instances."""

    def __init__(self, count: int) -> None:
        self.verdicts = np.ones(count, np.int8)
        self.lower, self.upper = np.full(count, np.inf), np.full(count, np.inf)

    def add(self, cohort: Cohort, interval: bool) -> None:
        """Include the instances of a cohort."""
        rows, monitor = cohort.rows, cohort.monitor
        self.verdicts[rows] = np.minimum(self.verdicts[rows], monitor.verdict)
        if interval:
            self.lower[rows] = np.minimum(self.lower[rows], plain(monitor.lower))
            self.upper[rows] = np.minimum(self.upper[rows], plain(monitor.upper))

    def copy(self) -> Worst:
        """Return a copy."""
        other = Worst(0)
        other.verdicts, other.lower, other.upper = self.verdicts.copy(), self.lower.copy(), self.upper.copy()
        return other
