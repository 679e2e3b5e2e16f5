"""Invariants: conditions on the state that specifications demand of each instant of a window, or of the whole run."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.components.risk.failure_bound import bounded
from symaware_cli.components.risk.predicate_bounds import NotLinearError
from symaware_cli.components.risk.state_conditions import Conjunction, Moments, Negation, StateCondition
from symaware_cli.core import AgentGroup
from symaware_cli.geometry.vectors import Array, Indices, Mask
from symaware_cli.specification.columns import Lookup
from symaware_cli.specification.formula import Always, And, Eventually, Formula, Not, Or, Predicate
from symaware_cli.specification.monitor_statuses import monitor_of
from symaware_cli.specification.predicted_scope import PredictedAgentScope
from symaware_cli.specification.specification import Specification
from symaware_cli.specification.specification_monitor import SpecificationMonitor

Times = NDArray[np.int64]


class Invariant(NamedTuple):
    """A condition that a specification demands of each instant of a window.

    Attributes:
        specification: The name of the specification.
        first: The first instant of the window, in steps from the instant that the verdict is about.
        last: The last one; None for the end of the run.
        condition: The condition.
    """

    specification: str
    first: int
    last: int | None
    condition: StateCondition


def invariants(specification: Specification, group: AgentGroup) -> list[Invariant]:
    """Return the invariants of a specification of the agents of a group; together they are all that it demands.

    Raises:
        NotLinearError: It demands anything else, or a predicate has no bound.
    """
    predicates = bounded(specification, group)
    found: list[Invariant] = []

    def collect(formula: Formula, first: int, last: int | None) -> None:
        match formula:
            case Always(begin, end, operand):
                collect(operand, first + begin, None if last is None or end is None else last + end)
            case And(operands):
                for each in operands:
                    collect(each, first, last)
            case Not(Eventually(begin, end, operand)):
                collect(Always(begin, end, Not(operand)), first, last)
            case _:
                found.append(Invariant(specification.name, first, last, _condition(formula, predicates)))

    collect(specification.formulation.formula, 0, 0)
    return found


def _condition(formula: Formula, predicates: Sequence[StateCondition]) -> StateCondition:
    match formula:
        case Predicate(index):
            return predicates[index]
        case Not(operand):
            return Negation(_condition(operand, predicates))
        case And(operands):
            return Conjunction([_condition(each, predicates) for each in operands])
        case Or(operands):
            return Negation(Conjunction([Negation(_condition(each, predicates)) for each in operands]))
    raise NotLinearError("only `always`, with or without a window, of predicates can be kept as a constraint")


class InvariantWindows:
    """The windows of the invariants of one or several specifications for the agents of a group, during a run."""

    def __init__(self, group: AgentGroup, specifications: Sequence[str], time_step: int) -> None:
        """Find the specifications.

        Args:
            group: The group.
            specifications: The names of its specifications.
            time_step: The time between two instants [ns].

        Raises:
            ValueError: A specification is not monitored in this process.
        """
        self._time_step = time_step
        self._count = len(group)
        self.invariants: list[Invariant] = []
        self._monitors: list[SpecificationMonitor] = []
        for name in specifications:
            monitor = monitor_of(group, name)
            of_name = invariants(monitor.specification, group)
            self.invariants += of_name
            self._monitors += [monitor] * len(of_name)

    def counting(self, times: Times, now: int, end: int | None) -> Mask:
        """Return which invariants must hold at some instants, for each agent; shape (invariants, n, instants).

        Args:
            times: The instants, from now on [ns].
            now: The present time [ns].
            end: The end of the run [ns]; None if it is unknown.
        """
        found = np.zeros((len(self.invariants), self._count, len(times)), bool)
        for place, rows, first, last in self._windows(now, end):
            found[place, rows] |= (times >= first) & (times <= last)
        return found

    def remaining(self, now: int, end: int | None) -> Indices:
        """Return at how many instants to come an invariant must hold, at most; shape (n,)."""
        found = np.zeros(self._count, np.intp)
        for _, rows, first, last in self._windows(now, end):
            left = (last - max(first, now + self._time_step)) // self._time_step + 1
            found[rows] = np.maximum(found[rows], left)
        return found

    def _windows(self, now: int, end: int | None) -> Iterator[tuple[int, Indices, int, int]]:
        """Yield the present windows: the place of the invariant, the agents, and the first and the last instant."""
        step = self._time_step
        far = int(np.iinfo(np.int64).max) if end is None else end
        for place, (each, monitor) in enumerate(zip(self.invariants, self._monitors, strict=True)):
            starts = [(cohort.rows, cohort.start) for cohort in monitor.cohorts]
            awaited = np.flatnonzero(monitor.awaited)
            if len(awaited):
                starts.append((awaited, max(monitor.specification.start, -(-now // step) * step)))
            for rows, begin in starts:
                last = far if each.last is None else min(far, begin + each.last * step)
                yield place, rows, begin + each.first * step, last


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedMotion:
    """Expected states of agents; see `specification.predicted_scope.PredictedMotion`.

    Attributes:
        time: The instant of each row [s]; shape (R,).
        states: Shape (R, nx).
        inputs: Shape (R, nu).
        agents: The row of the group that each row belongs to; shape (R,).
    """

    time: Array
    states: Array
    inputs: Array
    agents: Indices

    def repeated(self, values: Array) -> Array:
        """Return the values of the agents of the group, shape (n, ...), for each row."""
        return values[self.agents]

    def moments(self, covariance: Array, scope: PredictedAgentScope) -> Moments:
        """Return the moments of the states.

        Args:
            covariance: Shape (R, nx, nx).
            scope: The values of names.
        """

        def look_up(states: Array) -> Lookup:
            of: PredictedAgentScope = copy.copy(scope)
            of.motion = replace(self, states=states)  # type: ignore[assignment]
            return of.look_up

        return Moments(self.states, covariance, look_up)
