"""Online monitors: evaluate formulas while a run is in progress."""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.specification.formula import Array, Formula, Predicate, horizon, operands
from symaware_cli.specification.formula_stream import stream
from symaware_cli.specification.reason import Reason, reasons
from symaware_cli.specification.sliding import Extremum, History, Recent, Starts, UntilWindow
from symaware_cli.specification.stream import Clock, Stream, Together
from symaware_cli.specification.whole import bounds

#: Maximum number of samples that a monitor keeps, for the end of the run and for reasons.
KEPT = 2**25


class Monitor:
    """Evaluates a formula for many rows at once, instant by instant.

    The results of a row depend only on its own samples.

    Attributes:
        formula: The formula.
        rows: The number of rows.
        interval: Whether bounds of the robustness at the first instant are kept.
        horizon: Number of steps after which the exact robustness is known; None if only at the end of the run.
        instants: Number of instants processed.
        ended: Whether the declared run has ended.
        verdict: Whether the formula holds at the first instant, for each row: 1 true, -1 false, 0 undecided. The array
            is replaced only when a verdict changes, and never written to.
        lower: Least possible robustness at the first instant, over all continuations (only with `interval`).
        upper: Greatest possible robustness at the first instant.
        complete: Whether all samples were kept that the exact robustness at the end of the run requires, if it is not
            known before. At most `KEPT` are.
        is_changed: Whether the last instant may have changed verdict or bounds, or made exact robustness known.
    """

    def __init__(self, formula: Formula, rows: int, *, interval: bool = True, arrays: bool = False) -> None:
        """Create the monitor.

        Args:
            formula: The formula.
            rows: The number of rows.
            interval: Whether to keep bounds of the robustness.
            arrays: Whether even a single row is stored in arrays, as `Continuation` requires.
        """
        single = rows == 1 and not arrays
        self.formula = formula
        self.rows = rows
        self.interval = interval
        self.horizon = horizon(formula)
        self.instants = 0
        self.ended = False
        self.verdict: NDArray[np.int8] = np.zeros(rows, np.int8)
        self.lower: Array = np.full(rows, -np.inf)
        self.upper: Array = np.full(rows, np.inf)
        self.complete = True
        self.is_changed = True
        #: Without the interval, bounds are those of the truth value, and robustness has separate streams; for a single
        #: row, separate streams would cost more than they save.
        self._truth = not interval and not single
        self._clock = Clock(rows, boolean=self._truth, single=single)
        self._stream = stream(formula, self._clock, 0)
        self._robustness_clock = Clock(rows, boolean=False, single=single)
        #: The bounds where nothing is known.
        self._least, self._greatest = self._clock.full(1, False)[0], self._clock.full(1, True)[0]
        #: What `exact` returns if there is nothing new.
        self._nothing: Array = np.empty((0, rows))
        self._robustness = stream(formula, self._robustness_clock, -1)
        self._settled = False
        self._samples: list[Sequence[Any]] = []
        self._known: list[Array] = []
        self._told = 0
        limit = KEPT // max(1, rows * _predicates(formula))
        self._last_kept = limit if self.horizon is None else self.horizon
        self._judge()

    def update(self, values: Sequence[Array]) -> None:
        """Process the next instant.

        Args:
            values: Robustness of each predicate at that instant [rows]. It is kept, and must not be changed later.
        """
        now = self.instants
        self.instants = now + 1
        self.is_changed = False
        samples: Sequence[Any] = [each.item() for each in values] if self._clock.single else values
        if now <= self._last_kept:
            self._samples.append(samples)
        elif self.horizon is None:
            self.complete = False
        exact: Any = None
        if not (self._truth and self._settled):
            self._clock.now = now
            exact = self._stream.push([each > 0.0 for each in samples] if self._truth else samples)
            if not self._settled and (exact is not None or self._stream.is_changed):
                self._judge(exact)
                self.is_changed = True
            if self._truth:
                exact = None
        if self._truth and self.horizon is not None:
            self._robustness_clock.now = now
            exact = self._robustness.push(samples)
        if exact is not None:
            self._known.append(exact)
            self.is_changed = True

    def finish(self) -> None:
        """End the declared run with the last instant processed."""
        self.ended = self._clock.ended = self.is_changed = True
        if not self._settled:
            self._judge()
        if self.horizon is None and self.complete and self.instants:
            signals = self._signals(np.arange(self.rows), self.instants)
            found = bounds(self.formula, signals, self.instants, self.rows, True).upto(self.instants)
            self._known = list(np.where(found[:, 0] == found[:, 1], found[:, 0], np.nan))

    @property
    def history(self) -> list[Array] | None:
        """The robustness of each predicate at each instant so far [instants, rows]; None if some were not kept."""
        if len(self._samples) < self.instants:
            return None
        return self._signals(np.arange(self.rows), self.instants) if self.instants else []

    @property
    def kept(self) -> list[Array]:
        """The robustness of each predicate at the instants that are kept, from the first on [instants, rows]."""
        samples = len(self._samples)
        none = [np.empty((0, self.rows))] * _predicates(self.formula)
        return self._signals(np.arange(self.rows), samples) if samples else none

    @property
    def is_complete(self) -> bool:
        """Whether the exact robustness at the first instant is known."""
        return self.ended or (self.horizon is not None and self.instants > self.horizon)

    def exact(self) -> tuple[int, Array]:
        """Return the exact robustness that became known since the last call.

        Returns:
            The number of the first instant, and the robustness from there on [instants, rows]. For formulas without a
            horizon it is known at the end of the run; NaN where the run ended too early.
        """
        first, known = self._told, self._known
        if not known:
            return first, self._nothing
        self._told += len(known)
        self._known = []
        found: Array = np.array(known)
        return first, found[:, None] if found.ndim == 1 else found

    def select(self, rows: NDArray[np.intp]) -> Monitor:
        """Return a monitor of some rows, at least one, with their history."""
        made: Monitor = _selected(self, rows)
        for each in (made, made._clock, made._robustness_clock):
            each.rows = len(rows)
        return made

    def reasons(self, rows: NDArray[np.intp], side: int | None = None) -> list[Reason | None]:
        """Return what accounts for the present bounds of several rows; None where samples of it were not kept.

        Args:
            rows: The rows.
            side: The bound; see `reason.reasons`. It equals the robustness of each row where that is known.
        """
        instants, ended = self.instants, self.ended
        if instants > len(self._samples):
            if self.horizon is None:
                return [None] * len(rows)
            instants, ended = len(self._samples), False  # later samples have no influence
        if not instants or not len(rows):
            return [None] * len(rows)
        return reasons(self.formula, self._signals(rows, instants), instants, ended, side)

    def _signals(self, rows: NDArray[np.intp], instants: int) -> list[Array]:
        """Return the kept samples of each predicate for some rows [instants, rows]."""
        samples = self._samples[:instants]
        if len(rows) < self.rows:
            samples = [[each[rows] for each in some] for some in samples]
        kept = np.array(samples).reshape(instants, len(samples[0]), len(rows))
        return [kept[:, i] for i in range(kept.shape[1])]

    def _judge(self, exact: Any = None) -> None:
        """Update verdict and bounds at the first instant from its exact robustness, or from the streams."""
        if exact is not None:
            lower = upper = np.atleast_1d(exact)
        else:
            below, above = self._stream.first()
            if below is None and above is None:
                return
            lower = self._least if below is None else below
            upper = self._greatest if above is None else above
        if self._truth:
            holds, fails = lower, np.logical_not(upper)
        else:
            if self.interval:
                self.lower, self.upper = lower, upper
            if lower.item(lower.argmax()) < 0.0 < upper.item(upper.argmin()):
                return  # no row is decided
            holds, fails = lower > 0.0, upper < 0.0
        verdict = holds.view(np.int8) - fails.view(np.int8)
        if verdict.tobytes() != self.verdict.tobytes():
            self.verdict = verdict
        self._settled = exact is not None or (not self.interval and bool(verdict.all()))


def _predicates(formula: Formula) -> int:
    """Return the number of predicates: the highest index in the formula plus one."""
    if isinstance(formula, Predicate):
        return formula.index + 1
    return max((_predicates(each) for each in operands(formula)), default=0)


#: The classes that a monitor consists of.
_PARTS = (Monitor, Clock, Stream, Together, History, Recent, Starts, Extremum, UntilWindow)


class Continuation:
    """Continues a monitor in several ways at once, each with samples of its own, for the verdict alone."""

    def __init__(self, monitor: Monitor, rows: NDArray[np.intp]) -> None:
        """Begin with the present state of a monitor, which stays as it is.

        Args:
            monitor: A monitor whose values are `arrays`.
            rows: The row that each continuation belongs to; rows may occur several times. Shape (m,).
        """
        self._clock, self._stream = _selected([monitor._clock, monitor._stream], rows)
        self._clock.rows = len(rows)
        self._exact: Any = None

    def update(self, values: Sequence[Array]) -> None:
        """Process the robustness of each predicate at the next instant; each of shape (m,)."""
        if self._exact is None:
            self._clock.now += 1
            self._exact = self._stream.push([each > 0.0 for each in values] if self._clock.boolean else values)

    def finish(self) -> None:
        """End the declared run with the last instant processed."""
        self._clock.ended = True

    @property
    def verdict(self) -> NDArray[np.int8]:
        """Whether the formula holds at the first instant of the monitor: 1 true, -1 false, 0 undecided; shape (m,)."""
        if self._exact is not None:
            lower = upper = self._exact
        else:
            below, above = self._stream.known(0, 0, 1), self._stream.known(1, 0, 1)
            lower, upper = (
                (self._clock.full(1, greatest) if found is None else found)[0]
                for greatest, found in enumerate((below, above))
            )
        holds, fails = (lower, ~upper) if self._clock.boolean else (lower > 0.0, upper < 0.0)
        verdict: NDArray[np.int8] = np.subtract(holds, fails, dtype=np.int8)
        return verdict


def _selected(value: Any, rows: NDArray[np.intp]) -> Any:
    """Return a copy of (a part of) a monitor with the selected rows.

    Args:
        value: An array with the rows along its last axis, a list, or an object of `_PARTS` with such attributes;
            anything else is shared.
        rows: The indices of the rows.
    """
    copies: dict[int, Any] = {}

    def of(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return value[..., rows]
        if isinstance(value, list | deque):
            return type(value)(of(each) for each in value)
        if not isinstance(value, _PARTS):
            return value
        if id(value) not in copies:
            made = copies[id(value)] = copy.copy(value)
            for name, each in vars(value).items():
                setattr(made, name, of(each))
        return copies[id(value)]

    return of(value)
