"""Invariants: conditions on the state that specifications demand of each instant of a window, or of the whole run."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symaware_cli.components.risk.failure_bound import bounded
from symaware_cli.components.risk.predicate_bounds import NotLinearError
from symaware_cli.components.risk.state_conditions import Conjunction, Moments, Negation, StateCondition
from symaware_cli.core import AgentGroup
from symaware_cli.specification.columns import Lookup
from symaware_cli.specification.formula import Always, And, Eventually, Formula, Not, Or, Predicate
from symaware_cli.specification.monitor_statuses import MonitorStatuses
from symaware_cli.specification.predicted_scope import PredictedAgentScope
from symaware_cli.specification.specification import Specification, SpecificationMonitor

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Times = NDArray[np.int64]


class Invariant:
    """A condition that a specification demands of each instant of a window.

    Attributes:
        specification: The name of the specification.
        first: The first instant of the window, in steps from the instant that the verdict is about.
        last: The last one; None for the end of the run.
        condition: The condition.
    """

    def __init__(self, specification: str, first: int, last: int | None, condition: StateCondition) -> None:
        self.specification = specification
        self.first = first
        self.last = last
        self.condition = condition


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
        self.invariants: list[Invariant] = []
        self._monitors: list[SpecificationMonitor] = []
        for name in specifications:
            statuses = group.specifications.get(name)
            if not isinstance(statuses, MonitorStatuses):
                raise ValueError(f"`{name}` is not monitored in this process")
            of_name = invariants(statuses.monitor.specification, group)
            self.invariants += of_name
            self._monitors += [statuses.monitor] * len(of_name)

    def of(self, row: int, now: int, end: int | None) -> list[list[tuple[int, int]]]:
        """Return the present windows of an agent for each invariant, as their first and last instants [ns].

        Args:
            row: The row of the agent.
            now: The present time [ns].
            end: The end of the run [ns]; None if it is unknown.
        """
        step = self._time_step
        far = np.iinfo(np.int64).max if end is None else end
        found = []
        for each, monitor in zip(self.invariants, self._monitors, strict=True):
            starts = [cohort.start for cohort in monitor.cohorts if row in cohort.rows]
            if monitor.awaited[row]:
                starts.append(max(monitor.specification.start, -(-now // step) * step))
            found.append(
                [
                    (begin + each.first * step, far if each.last is None else min(far, begin + each.last * step))
                    for begin in starts
                ]
            )
        return found


def covered(windows: Sequence[tuple[int, int]], times: Times) -> NDArray[np.bool_]:
    """Return which of some times lie in one of several windows."""
    found = np.zeros(len(times), bool)
    for first, last in windows:
        found |= (times >= first) & (times <= last)
    return found


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
