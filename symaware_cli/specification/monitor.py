"""Monitors: formulas evaluated while a run goes on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.specification.formula import Array, Formula, horizon
from symaware_cli.specification.reason import Reason, reason
from symaware_cli.specification.whole import bounds


class Monitor:
    """Evaluates a formula for many rows at once, instant by instant.

    Attributes:
        formula: The formula.
        rows: The number of rows.
        instants: How many instants have been given.
        ended: Whether the declared run has ended.
        verdict: Of each row whether the formula holds at the first instant: 1 true, -1 false, 0 undecided.
        lower: Least robustness that the formula can have at the first instant, whatever follows (only with `interval`).
        upper: Greatest such robustness.
    """

    def __init__(self, formula: Formula, rows: int, *, interval: bool = True) -> None:
        self.formula = formula
        self.rows = rows
        self.interval = interval
        self.instants = 0
        self.ended = False
        self.verdict: NDArray[np.int8] = np.zeros(rows, np.int8)
        self.lower: Array = np.full(rows, -np.inf)
        self.upper: Array = np.full(rows, np.inf)
        self._horizon = horizon(formula)
        self._decided_at: NDArray[np.int64] = np.zeros(rows, np.int64)
        self._history: list[Array] = []
        self._told = 0
        self._judge()

    def update(self, values: Sequence[Array]) -> None:
        """Go on by an instant.

        Args:
            values: Robustness of each predicate at that instant [rows].
        """
        self._history.append(np.array(values).reshape(len(values), self.rows))
        self.instants += 1
        self._judge()

    def finish(self) -> None:
        """End the declared run with the last instant given."""
        self.ended = True
        self._judge()

    def exact(self) -> tuple[int, Array]:
        """Exact robustness that is known since this was last asked.

        Returns:
            The number of the first instant, and the robustness at that and the following ones [instants, rows]. That of
            formulas without a horizon is known at the end of the run; NaN where the run ended too early to tell.
        """
        first = self._told
        if self._horizon is not None:
            self._told = max(first, self.instants - self._horizon)
        elif self.ended:
            self._told = self.instants
        if self._told == first:
            return first, np.empty((0, self.rows))
        known = bounds(self.formula, self._samples(), self.instants, self.rows, self.ended).upto(self._told)[first:]
        return first, np.where(known[:, 0] == known[:, 1], known[:, 0], np.nan)

    def select(self, rows: NDArray[np.intp]) -> Monitor:
        """A monitor of some rows, with their past."""
        selected = Monitor(self.formula, len(rows), interval=self.interval)
        selected.instants, selected.ended, selected._told = self.instants, self.ended, self._told
        selected.verdict, selected._decided_at = self.verdict[rows], self._decided_at[rows]
        selected.lower, selected.upper = self.lower[rows], self.upper[rows]
        selected._history = [each[:, rows] for each in self._history]
        return selected

    def reason(self, row: int) -> Reason | None:
        """The sample that decided the verdict of a row, or that bounds its robustness so far."""
        decided = bool(self.verdict[row])
        instants = int(self._decided_at[row]) if decided else self.instants
        samples = [each[:, row : row + 1] for each in self._samples()]
        return reason(self.formula, samples, instants, self.ended and instants == self.instants)

    def _samples(self) -> list[Array]:
        return list(np.stack(self._history, axis=1)) if self._history else []

    def _judge(self) -> None:
        lower, upper = bounds(self.formula, self._samples(), self.instants, self.rows, self.ended).upto(1)[0]
        self.lower, self.upper = lower, upper
        verdict = np.where(lower > 0.0, 1, np.where(upper < 0.0, -1, 0)).astype(np.int8)
        self._decided_at[(self.verdict == 0) & (verdict != 0)] = self.instants
        self.verdict = verdict
