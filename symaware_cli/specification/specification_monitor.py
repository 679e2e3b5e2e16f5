"""The monitor of a specification during a run: verdicts, robustness, and the decisions behind them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core.verdict import SpecificationStatus
from symaware_cli.specification.automaton import AutomatonMonitor
from symaware_cli.specification.formula import Array, plain
from symaware_cli.specification.formulation import subformula
from symaware_cli.specification.measured import measured
from symaware_cli.specification.monitor import Monitor
from symaware_cli.specification.outcome import Decision, Outcome, outcome_of
from symaware_cli.specification.printing import printed
from symaware_cli.specification.reason import Reason
from symaware_cli.specification.specification import PredicateSampler, Specification


@dataclass(frozen=True, slots=True)
class Exact:
    """Exact robustness that became known.

    Attributes:
        times: The instants of the values, in nanoseconds; shape (m,).
        rows: The indices of the rows; shape (k,).
        values: The robustness; shape (m, k).
    """

    times: NDArray[np.int64]
    rows: NDArray[np.intp]
    values: Array


class Cohort:
    """Rows whose evaluation began at the same instant.

    Attributes:
        rows: Their indices, ascending; shape (k,).
        monitor: Their monitor.
        start: Their first instant, in nanoseconds.
        told: Their verdicts as last reported; shape (k,).
        count: The number of rows of the specification.
        is_whole: Whether these are all rows of the specification.
    """

    def __init__(
        self,
        rows: NDArray[np.intp],
        monitor: Monitor | AutomatonMonitor,
        start: int,
        told: NDArray[np.int8],
        count: int,
    ) -> None:
        self.rows = rows
        self.count = count
        self.monitor = monitor
        self.start = start
        self.told = told
        self.is_whole = len(rows) == count
        #: The bounds of the monitor as they were decoded last, and decoded.
        self._lower, self._upper = monitor.lower, monitor.upper
        self._plain_lower, self._plain_upper = plain(self._lower), plain(self._upper)

    def bounds(self) -> tuple[Array, Array]:
        """Return the bounds of the robustness; each of shape (k,)."""
        lower, upper = self.monitor.lower, self.monitor.upper
        # Monitors replace their arrays, and never write to them.
        if lower is not self._lower:
            self._lower, self._plain_lower = lower, plain(lower)
        if upper is not self._upper:
            self._upper, self._plain_upper = upper, plain(upper)
        return self._plain_lower, self._plain_upper

    def select(self, chosen: NDArray[np.bool_]) -> Cohort:
        """Return some of the rows, with their history."""
        monitor = self.monitor.select(np.flatnonzero(chosen))
        return Cohort(self.rows[chosen], monitor, self.start, self.told[chosen], self.count)


class Worst:
    """Verdicts and intervals of rows, each the worst over several instances; arrays that were read never change.

    Attributes:
        verdicts: The verdicts; shape (rows,).
        lower: Lower bounds of the robustness; shape (rows,).
        upper: Upper bounds of the robustness; shape (rows,).
    """

    def __init__(self, verdicts: NDArray[np.int8], lower: Array, upper: Array, is_empty: bool = False) -> None:
        self.verdicts, self.lower, self.upper = verdicts, lower, upper
        self._is_empty = is_empty

    @classmethod
    def of_none(cls, count: int) -> Worst:
        """Return what counts if there are no instances."""
        bound = np.full(count, np.inf)
        return cls(np.ones(count, np.int8), bound, bound, is_empty=True)

    def joined(self, cohorts: Sequence[Cohort], interval: bool) -> tuple[NDArray[np.int8], Array, Array]:
        """Return the verdicts and bounds with the instances of cohorts included."""
        if self._is_empty and len(cohorts) == 1 and cohorts[0].is_whole:
            # By far the most frequent case.
            lower, upper = cohorts[0].bounds() if interval else (self.lower, self.upper)
            return cohorts[0].monitor.verdict, lower, upper
        verdicts, lower, upper = self.verdicts.copy(), self.lower.copy(), self.upper.copy()
        for cohort in cohorts:
            rows = cohort.rows
            verdicts[rows] = np.minimum(verdicts[rows], cohort.monitor.verdict)
            if interval:
                least, greatest = cohort.bounds()
                lower[rows] = np.minimum(lower[rows], least)
                upper[rows] = np.minimum(upper[rows], greatest)
        return verdicts, lower, upper

    def add(self, cohorts: Sequence[Cohort], interval: bool) -> None:
        """Include the instances of cohorts."""
        self.verdicts, self.lower, self.upper = self.joined(cohorts, interval)
        self._is_empty = False


class SpecificationMonitor:
    """Monitors a specification during a run.

    The formula must hold for each row from `Specification.start` on, or from the instant at which the row becomes
    present; or from several instants on, the *instances*: then the worst instance counts. An offered specification is
    evaluated for all rows that are present when it begins; it counts for the row that has accepted it, at any time.

    Attributes:
        specification: The specification.
        robustness: The exact robustness of each row at the latest instant where it is known; NaN before the first.
        settled: The exact robustness that the verdict of each row is about, the least of its instances; NaN while that
            of any is unknown.
        begun: Whether each row counts, as it has been present, or has accepted the offer; shape (rows,).
        rejection: The reason why the offer was rejected; empty if it is open or accepted, or if there is no offer.
        decisions: The decisions in the order in which they were made.
        begins: Whether evaluation begins by itself, once for each row.
        cohorts: The rows that are evaluated, by the instant at which their evaluation began.
        is_over: Whether further values are ignored.
        changes: How often results may have changed.
        is_continued: Whether forecasts are made; to be set before the first value.
    """

    uncaptured: ClassVar[Sequence[str]] = ("specification", "_sample")

    def __init__(self, specification: Specification, time_step: int, begins: bool = True) -> None:
        """Initialise the monitor.

        Args:
            specification: The specification to monitor.
            time_step: The time between two steps, in nanoseconds.
            begins: Whether evaluation begins by itself, whenever a row enters the world; otherwise instances begin with
                `begin`.
        """
        count = specification.scope.rows
        self.specification = specification
        self._sample = PredicateSampler(specification, specification.scope.getter, count)
        #: The bounds without intervals.
        self._unbounded = np.full(count, -np.inf), np.full(count, np.inf)
        #: The verdicts and bounds of all instances; None if they are to be combined when they are read.
        self._combined: tuple[NDArray[np.int8], Array, Array] | None = (np.zeros(count, np.int8), *self._unbounded)
        self.robustness = np.full(count, np.nan)
        self.settled = np.full(count, np.nan)
        #: The least exact robustness of the instances of each row so far, and of how many it is unknown.
        self._least = np.full(count, np.inf)
        self._unsettled = np.zeros(count, np.int64)
        self.begun = np.zeros(count, bool)
        self._all_begun = not count
        self.is_over = False
        self.is_continued = False
        self._time_step = time_step
        self._is_offered = specification.offer is not None
        self.begins = begins and not self._is_offered
        self.rejection = ""
        self._now = 0
        #: Whether rows came or went since results were combined.
        self._is_regrouped = False
        self.changes = 0
        self._due: list[NDArray[np.intp]] = []
        #: Which rows have left the world, and begin an instance if they return.
        self._away = np.zeros(count, bool)
        self.cohorts: list[Cohort] = []
        self._ended = Worst.of_none(count)
        self._exact: list[Exact] = []
        self._momentary_agents: dict[int, tuple[str, ...]] = {}
        self.decisions: list[Decision] = []
        #: What accounts for the least upper bound of each row that is no longer evaluated, with that bound.
        self._explained: dict[int, tuple[float, Decision]] = {}

    def look(self, now: int) -> Sequence[Decision]:
        """Evaluate the predicates at the present step, and return the decisions that follow.

        Raises:
            SpecificationError: A predicate has no value.
        """
        specification = self.specification
        if self.is_over or now < specification.start:
            return ()
        if specification.end is not None and now > specification.end:
            return self.finish()
        self._now = now
        scope = specification.scope
        present = scope.present
        decisions: list[Decision] = []
        if present is not None:
            self._leave(present, decisions)
        if self._due or present is not None or (self.begins and not self._all_begun):
            self._arrive(present, now)
        cohorts = self.cohorts
        if self._is_offered:
            cohorts = [cohort for cohort in cohorts if not self._is_complete(cohort)]
        is_changed = self._is_regrouped or self._is_offered
        if cohorts:
            values = self._sample(present)
            if agents := scope.momentary_agents:
                self._momentary_agents[now] = agents
            for cohort in cohorts:
                monitor = cohort.monitor
                monitor.update(values if cohort.is_whole else [each[cohort.rows] for each in values])
                is_changed = is_changed or monitor.is_changed
        if is_changed and self.cohorts:
            for cohort in self.cohorts:
                self._take(cohort, decisions)
            self._combine()
            self._is_regrouped = False
        return decisions

    def begin(self, rows: Sequence[int]) -> None:
        """Begin an instance with the next step, for those of the rows that are present then."""
        self._due.append(np.array(rows, np.intp))

    def accept(self, row: int) -> None:
        """Let the offered specification count for a row, from the beginning of its evaluation."""
        self._results()
        self.begun[row] = True
        self._all_begun = bool(self.begun.all())
        if not self._due:  # otherwise its evaluation has not begun, and there is nothing to combine
            self._combine()

    def release(self, row: int) -> None:
        """Let the offered specification no longer count for a row."""
        self.begun[row] = self._all_begun = False
        self._combine()

    def is_open_to(self, row: int) -> bool:
        """Whether a row may accept the offer: the row is evaluated, or will be next, and does not violate it."""
        present = self.specification.scope.present
        if self.is_over or (present is not None and not present[row]):
            return False
        for cohort in self.cohorts:
            if len(places := np.flatnonzero(cohort.rows == row)):
                return bool(cohort.monitor.verdict[places[0]] >= 0)
        return any(row in rows for rows in self._due)

    def measured(self, row: int, now: int) -> float:
        """Return the robustness of a row on its samples from the beginning to the present; see the module `measured`.

        Before the beginning, the present values count as its first sample.

        Args:
            row: The row.
            now: The present time, in nanoseconds.

        Raises:
            SpecificationError: A predicate has no value.
        """
        specification = self.specification
        if specification.automaton is not None:
            return np.nan
        samples = [np.empty(0) for _ in specification.formulation.atoms]
        is_known = False
        for cohort in self.cohorts:
            monitor = cohort.monitor
            if isinstance(monitor, Monitor) and row in cohort.rows:
                samples = [each[:, int(np.searchsorted(cohort.rows, row))] for each in monitor.kept]
                is_known = self._is_complete(cohort) or now < self._now + self._time_step
        if not is_known:
            present = specification.values(specification.scope.look_up, specification.scope.rows, None)
            samples = [np.append(each, value[row]) for each, value in zip(samples, present, strict=True)]
        count = len(samples[0]) if samples else 1
        found = measured(specification.formulation.formula, [each[:, None] for each in samples], count, 1)
        return float(plain(found[0, 0]))

    @property
    def verdicts(self) -> NDArray[np.int8]:
        """1 (satisfied), -1 (violated) or 0 (undecided) for each row; shape (rows,)."""
        return self._results()[0]

    @property
    def lower(self) -> Array:
        """Lower bound of the robustness of each row; minus infinity without intervals."""
        return self._results()[1]

    @property
    def upper(self) -> Array:
        """Upper bound of the robustness of each row; infinity without intervals."""
        return self._results()[2]

    @property
    def awaited(self) -> NDArray[np.bool_]:
        """Which rows begin with the next step, if they are present then; shape (rows,)."""
        awaited = ~self.begun if self.begins else np.zeros(len(self.begun), bool)
        for rows in self._due:
            awaited[rows] = True
        return awaited

    def finish(self) -> Sequence[Decision]:
        """End the evaluation, and return the decisions that follow."""
        decisions: list[Decision] = []
        if not self.is_over:
            self.is_over = True
            for cohort in self.cohorts:
                cohort.monitor.finish()
                self._take(cohort, decisions)
            self._combine()
        return decisions

    def take_exact(self) -> Sequence[Exact]:
        """Return the exact robustness that became known since the last call."""
        exact, self._exact = self._exact, []
        return exact

    @property
    def verdict(self) -> int:
        """The worst verdict of the rows that were ever present: violated, then undecided, then satisfied."""
        seen = self.verdicts[self.begun]
        return int(seen.min()) if len(seen) else 0

    @property
    def presumptions(self) -> NDArray[np.int8] | None:
        """The verdict of each row if the run ended now, of linear temporal logic; shape (rows,). None for others."""
        if self.specification.automaton is None:
            return None
        found: NDArray[np.int8] = np.where(self.verdicts == 0, np.int8(1), self.verdicts)
        for cohort in self.cohorts:
            if isinstance(cohort.monitor, AutomatonMonitor):
                found[cohort.rows] = np.minimum(found[cohort.rows], cohort.monitor.presumption)
        return found

    @property
    def presumption(self) -> int | None:
        """The worst verdict if the run ended now, of a formula of linear temporal logic; None for others."""
        presumptions = self.presumptions
        return None if presumptions is None or not self.begun.any() else int(presumptions[self.begun].min())

    @property
    def outcome(self) -> Outcome:
        """The summary so far."""
        specification, begun = self.specification, np.flatnonzero(self.begun)
        outcome = outcome_of(
            specification.name,
            specification.text,
            lambda place: specification.scope.agents(int(begun[place])),
            self.verdicts[begun],
            self.settled[begun],
            self.upper[begun],
            self.decisions,
            self.presumption,
            lambda place: self._explanation(int(begun[place])),
        )
        return outcome.rejected(self.rejection) if self.rejection else outcome

    def status(self, rows: Sequence[int]) -> SpecificationStatus:
        """Return the worst status of some rows."""
        chosen = list(rows)
        verdict = int(self.verdicts[chosen].min())
        return SpecificationStatus(
            verdict=None if verdict == 0 else verdict > 0,
            robustness=float(np.fmin.reduce(self.robustness[chosen])),
            interval=(float(self.lower[chosen].min()), float(self.upper[chosen].min())),
        )

    def _arrive(self, present: NDArray[np.bool_] | None, now: int) -> None:
        """Begin the evaluation of rows that are due and present."""
        if self.begins and not self._all_begun:
            self._due.append(np.flatnonzero(~self.begun))
        if present is not None and self._away.any():
            returned = self._away & present
            if returned.any():
                self._due.append(np.flatnonzero(returned))
                self._away &= ~present
        if not self._due:
            return
        # However many events fired since the last step, each row begins at most one instance: all would be equal.
        due = np.unique(np.concatenate(self._due))
        self._due.clear()
        rows = due if present is None else due[present[due]]
        if len(rows):
            self._results()
            self.begun[rows] |= not self._is_offered
            self._all_begun = bool(self.begun.all())
            self._unsettled[rows] += 1
            self.settled[rows] = np.nan
            monitor = self.specification.monitor(len(rows), self.is_continued)
            self._is_regrouped = True
            self.cohorts.append(Cohort(rows, monitor, now, np.zeros(len(rows), np.int8), len(self.begun)))

    def _leave(self, present: NDArray[np.bool_], decisions: list[Decision]) -> None:
        """End the evaluation of rows that are no longer present."""
        remaining: list[Cohort] = []
        for cohort in self.cohorts:
            here = present[cohort.rows]
            if here.any():
                remaining.append(cohort if here.all() else cohort.select(here))
            if not here.all():
                self._results()
                self._is_regrouped = True
                gone = cohort.select(~here) if here.any() else cohort
                gone.monitor.finish()
                self._take(gone, decisions)
                self._close(gone)
                self._away[gone.rows] |= self.begins
        self.cohorts = remaining

    def _take(self, cohort: Cohort, decisions: list[Decision]) -> None:
        """Read the new results of a monitor."""
        self.changes += 1
        rows, monitor = cohort.rows, cohort.monitor
        first, exact = monitor.exact()
        if len(exact):
            values, times = plain(exact), cohort.start + (first + np.arange(len(exact))) * self._time_step
            if not self._is_offered:
                self._exact.append(Exact(times, rows, values))
                self.robustness[rows] = values[-1]
            if first == 0:
                is_known = ~np.isnan(values[0])
                self._unsettled[rows] -= is_known
                self._least[rows] = np.fmin(self._least[rows], values[0])
                self.settled[rows] = np.where(self._unsettled[rows] == 0, self._least[rows], np.nan)
        if self._is_offered:
            # What is offered is about the instant at which it begins alone.
            known = rows[self.begun[rows] & np.isnan(self.robustness[rows]) & ~np.isnan(self.settled[rows])]
            if len(known):
                self.robustness[known] = self.settled[known]
                self._exact.append(Exact(np.array([cohort.start]), known, self.settled[known][None]))
        verdicts = monitor.verdict
        if verdicts is cohort.told:  # monitors replace it only when it changes
            return
        changed = verdicts != cohort.told
        if self._is_offered:
            changed &= self.begun[rows]
        if np.count_nonzero(changed) and self.specification.explains:  # several times as fast as `any` for few rows
            found = self._decisions(cohort, np.flatnonzero(changed))
            decisions += found
            self.decisions += found
        cohort.told = np.where(changed, verdicts, cohort.told) if self._is_offered else verdicts

    def _combine(self) -> None:
        """Take note that results of instances may have changed; decided instances are dropped."""
        self.changes += 1
        if not self.begins and not self._is_offered:
            for cohort in self.cohorts:
                if cohort.told.all():
                    self._close(cohort)
            self.cohorts = [cohort for cohort in self.cohorts if not cohort.told.all()]
        self._combined = None

    def _results(self) -> tuple[NDArray[np.int8], Array, Array]:
        """Return the verdicts and bounds of all instances, as of the last `_combine`.

        They are combined at the first reading, since most runs do not read them at each step. Whoever lets instances
        begin or end calls this before, as the cohorts change then.
        """
        if self._combined is None:
            interval = self.specification.interval
            verdicts, lower, upper = self._ended.joined(self.cohorts, interval)
            if not self._all_begun:
                verdicts = np.where(self.begun, verdicts, np.int8(0))
                lower, upper = np.where(self.begun, lower, -np.inf), np.where(self.begun, upper, np.inf)
            self._combined = (verdicts, lower, upper) if interval else (verdicts, *self._unbounded)
        return self._combined

    def _is_complete(self, cohort: Cohort) -> bool:
        """Whether the verdicts of an offered cohort, and their robustness, are known."""
        return self._is_offered and isinstance(cohort.monitor, Monitor) and cohort.monitor.is_complete

    def _close(self, cohort: Cohort) -> None:
        """Keep the results of a cohort that is no longer evaluated."""
        self._ended.add([cohort], self.specification.interval)
        if self.specification.explains:
            every = np.arange(len(cohort.rows))
            for row, bound, decision in self._bounds(cohort, every):
                if row not in self._explained or bound < self._explained[row][0]:
                    self._explained[row] = bound, decision

    def _explanation(self, row: int) -> Decision | None:
        """Return what accounts for the robustness of a row, or for the upper bound of it; None if that was not kept."""
        found = [(row, *self._explained[row])] if row in self._explained else []
        if self.specification.explains:
            for cohort in self.cohorts:
                found += self._bounds(cohort, np.flatnonzero(cohort.rows == row))
        known = self.upper[row] if np.isnan(self.settled[row]) else self.settled[row]
        return next((decision for _, bound, decision in found if bound == known), None)

    def _bounds(self, cohort: Cohort, places: NDArray[np.intp]) -> list[tuple[int, float, Decision]]:
        """Return rows of a cohort with the upper bound of their robustness and what accounts for it, where known."""
        found = []
        for place, reason in zip(places.tolist(), cohort.monitor.reasons(places, side=1), strict=True):
            if reason is not None:
                bound = float(plain(np.asarray(reason.value)))
                found.append((int(cohort.rows[place]), bound, self._decision(cohort, place, reason)))
        return found

    def _decisions(self, cohort: Cohort, places: NDArray[np.intp]) -> list[Decision]:
        """Return the verdicts of rows of a cohort that were just decided."""
        every = cohort.monitor.reasons(places)
        return [self._decision(cohort, place, each) for place, each in zip(places.tolist(), every, strict=True)]

    def _decision(self, cohort: Cohort, place: int, reason: Reason | None) -> Decision:
        specification = self.specification
        tree = specification.formulation.tree
        satisfied = bool(cohort.monitor.verdict[place] > 0)
        agents = specification.scope.agents(int(cohort.rows[place]))
        if reason is None or reason.predicate is None:
            # No single sample decides a path through an automaton, and an operator may be about no instant.
            now = self._now if specification.automaton is not None else None
            formula = specification.text if reason is None else printed(subformula(tree, reason.path))
            return Decision(specification.name, agents, satisfied, "", formula, now, np.inf, satisfied)
        instant = cohort.start + reason.instant * self._time_step
        return Decision(
            specification=specification.name,
            agents=agents or self._momentary_agents.get(instant, ()),
            satisfied=satisfied,
            predicate=specification.formulation.atoms[reason.predicate].text,
            formula=printed(subformula(tree, reason.path[:-1])),
            instant=instant,
            robustness=float(plain(np.asarray(reason.robustness))),
            holds=reason.robustness > 0.0,
        )
