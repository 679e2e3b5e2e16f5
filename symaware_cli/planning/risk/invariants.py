"""Invariants: conditions on the state that specifications demand of each instant of a window, or of the whole run."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup
from symaware_cli.geometry import Array, Indices, Mask
from symaware_cli.planning.risk.failure_bound import bounded
from symaware_cli.planning.risk.pair_conditions import check_apart, pair_bound
from symaware_cli.planning.risk.predicate_bounds import NotLinearError
from symaware_cli.planning.risk.state_conditions import Conjunction, Moments, Negation, StateCondition
from symaware_cli.specification import PairScope, PredictedAgentScope, Specification, SpecificationMonitor, monitor_of
from symaware_cli.specification.columns import Lookup
from symaware_cli.specification.formula import Always, And, Eventually, Formula, Not, Or, Predicate

Times = NDArray[np.int64]


class Partners(NamedTuple):
    """The other agents that an invariant of pairs is about: one for each agent of a group, or none.

    Attributes:
        ids: Their ids; None for none.
        pairs: The rows of the pairs in the scope of the specification; -1 for none. Shape (n,).
    """

    ids: tuple[str | None, ...]
    pairs: Indices


#: The part of the risk of a pair that each of its two agents may take.
SHARE_OF_PAIR = 0.5


class Invariant(NamedTuple):
    """A condition that a specification demands of each instant of a window.

    Attributes:
        specification: The name of the specification.
        first: The first instant of the window, in steps from the instant that the verdict is about.
        last: The last one; None for the end of the run.
        condition: The condition: on the state, or on the position of a partner relative to the own one.
        partners: The partners; None if it is about single agents.
    """

    specification: str
    first: int
    last: int | None
    condition: StateCondition
    partners: Partners | None = None

    @property
    def weight(self) -> float:
        """The factor of its probability of a violation in a comparison with a maximal risk: above 1 for pairs."""
        return 1.0 if self.partners is None else 1.0 / SHARE_OF_PAIR


def invariants(specification: Specification, group: AgentGroup) -> list[Invariant]:
    """Return the invariants of a specification of the agents of a group; together they are equivalent to it.

    If it is about pairs, the number of invariants for each condition is the greatest number of partners of an agent.

    Raises:
        NotLinearError: It is not a conjunction of invariants, or a predicate has no bound.
    """
    if isinstance(specification.scope, PairScope):
        found = _demanded(specification, _pair_predicates(specification, group))
        for each in found:
            check_apart(each.condition)
        return [each._replace(partners=partners) for partners in _partners(specification, group) for each in found]
    return _demanded(specification, bounded(specification, group))


def _pair_predicates(specification: Specification, group: AgentGroup) -> list[StateCondition]:
    if specification.end is not None or specification.automaton is not None:
        raise NotLinearError("it has an end (`to`), or is in linear temporal logic")
    found = []
    for atom in specification.formulation.atoms:
        try:
            found.append(pair_bound(atom.node, len(group.model.position)))
        except NotLinearError as error:
            raise NotLinearError(f"`{atom.text}`: {error}") from None
    return found


def _partners(specification: Specification, group: AgentGroup) -> list[Partners]:
    """Return the partners of the agents of a group: of each the first, then of each the second, and so on."""
    rows = {id: row for row, id in enumerate(group.ids)}
    of_each: list[list[tuple[int, str]]] = [[] for _ in rows]
    for pair in range(specification.scope.rows):
        first, second = specification.scope.agents(pair)
        for own, other in ((first, second), (second, first)):
            if own in rows:
                of_each[rows[own]].append((pair, other))
    found = []
    for slot in range(max(map(len, of_each))):
        chosen = [each[slot] if slot < len(each) else (-1, None) for each in of_each]
        found.append(Partners(tuple(id for _, id in chosen), np.array([pair for pair, _ in chosen], np.intp)))
    return found


def _demanded(specification: Specification, predicates: Sequence[StateCondition]) -> list[Invariant]:
    """Return the windows of conditions that a specification demands."""
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
        roster = group.surroundings.environment.roster
        self._time_step = time_step
        self._count = len(group)
        self.invariants: list[Invariant] = []
        self._monitors: list[SpecificationMonitor] = []
        for name in specifications:
            monitor = monitor_of(group, name)
            of_name = invariants(monitor.specification, group)
            self.invariants += of_name
            self._monitors += [monitor] * len(of_name)
        #: The partner of each agent as an index in the roster, -1 for none, for each invariant; None without pairs.
        self.others: list[Indices | None] = [
            None
            if each.partners is None
            else np.array([-1 if id is None else roster.indices[id] for id in each.partners.ids], np.intp)
            for each in self.invariants
        ]

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

    def spans(self, now: int, end: int | None) -> tuple[Times, Times]:
        """Return the first and the last instant to come at which each invariant must hold; each (invariants, n) [ns].

        If it is about several windows, they are those of all together; the last is before the first if there is none.

        Args:
            now: The present time [ns].
            end: The end of the run [ns]; None if it is unknown.
        """
        shape, following = (len(self.invariants), self._count), now + self._time_step
        firsts, lasts = np.full(shape, np.iinfo(np.int64).max), np.full(shape, now)
        for place, rows, first, last in self._windows(now, end):
            if last >= following:
                firsts[place, rows] = np.minimum(firsts[place, rows], max(first, following))
                lasts[place, rows] = np.maximum(lasts[place, rows], last)
        return firsts, lasts

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
                yield place, self._agents(each, monitor, rows), begin + each.first * step, last

    def _agents(self, each: Invariant, monitor: SpecificationMonitor, rows: Indices) -> Indices:
        """Return the agents of the group that some rows of the scope of a specification are about."""
        if each.partners is None:
            return rows
        pairs = each.partners.pairs
        chosen = np.zeros(monitor.specification.scope.rows, bool)
        chosen[rows] = True
        return np.flatnonzero((pairs >= 0) & chosen[np.maximum(pairs, 0)])


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
