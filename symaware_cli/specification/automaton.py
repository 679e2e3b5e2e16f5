"""Deterministic automata for linear temporal logic (LTL) over finite runs.

A formula is progressed by the letters of a run: the obligation that remains after an instant is again a formula
(F. Bacchus and F. Kabanza, "Using Temporal Logics to Express Search Control Knowledge for Planning", Artificial
Intelligence 116, 2000). States are in a normal form, so that their number is finite. Runs are finite, as in LTLf
(G. De Giacomo and M. Vardi, "Linear Temporal Logic and Linear Dynamic Logic on Finite Traces", IJCAI 2013): a state
accepts if the formula holds when the run ends with the preceding instant. Acceptance and reachability together give a
four-valued verdict (A. Bauer, M. Leucker and C. Schallhart, "Comparing LTL Semantics for Runtime Verification", Journal
of Logic and Computation 20, 2010).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from symaware_cli.specification import formula as stl
from symaware_cli.specification.formula import Array

#: Maximum number of states and of propositions of an automaton.
MOST_STATES = 2_000
MOST_PROPOSITIONS = 10
#: Maximum number of clauses of a state.
_MOST_CLAUSES = 256

#: A part of a formula: ("literal", index, sign), ("until", left, right), ...
_Term: TypeAlias = tuple[Any, ...]
#: A remaining obligation: a disjunctive normal form over terms about later instants. No clause contains another, so
#: that equal Boolean functions of the terms are equal sets.
_State: TypeAlias = frozenset[frozenset[_Term]]

_TRUE: _State = frozenset([frozenset()])
_FALSE: _State = frozenset()
#: Requires that there is another instant, or that there is none.
_INSTANT: _Term = ("instant",)
_END: _Term = ("end",)


class AutomatonError(ValueError):
    """The automaton of a formula would be too large, or the formula uses operators that automata do not support."""


class Automaton:
    """A deterministic automaton over sets of propositions.

    Attributes:
        transitions: The next state for each state and letter, shape (states, letters). A letter is the sum of 2**i over
            the propositions i that hold.
        accepting: Whether the formula holds if the run ends in a state; shape (states,).
        verdicts: 1 where the formula holds however the run continues, -1 where it can no longer hold, else 0; shape
            (states,).
        propositions: Number of propositions.
    """

    #: The state before the first instant.
    start = 0

    def __init__(self, formula: stl.Formula, propositions: int) -> None:
        """Construct the automaton of a formula.

        Args:
            formula: A formula of predicates, `Not`, `And`, `Or`, `Next` and future operators without windows.
            propositions: Number of predicates.

        Raises:
            AutomatonError: It has more than `MOST_STATES` states or `MOST_PROPOSITIONS` propositions, or the formula
                has windows or past operators.
        """
        if propositions > MOST_PROPOSITIONS:
            said = f"there are {propositions} propositions, and {MOST_PROPOSITIONS} at most are possible"
            raise AutomatonError(said)
        self.propositions = propositions
        progression = _Progression()
        first: _State = frozenset([frozenset([("first", _term(formula, positive=True))])])
        states: dict[_State, int] = {first: 0}
        waiting = list(states)
        rows: list[list[int]] = []
        for state in waiting:
            row = []
            for letter in range(2**propositions):
                after = progression.of_state(state, letter)
                if after not in states:
                    if len(states) >= MOST_STATES:
                        raise AutomatonError(f"its automaton has more than {MOST_STATES:,} states; split the formula")
                    states[after] = len(states)
                    waiting.append(after)
                row.append(states[after])
            rows.append(row)
        self.transitions: NDArray[np.int32] = np.array(rows, np.int32)
        self.accepting: NDArray[np.bool_] = np.array([_holds_at_end(state) for state in states])
        self.verdicts = self._verdicts()

    def _verdicts(self) -> NDArray[np.int8]:
        """Find the states from which only accepting states, or none, can be reached."""
        always, never = self.accepting.copy(), ~self.accepting
        # Greatest fixed point: states are removed until nothing changes.
        for found in (always, never):
            while True:
                closed = found & found[self.transitions].all(axis=1)
                if (closed == found).all():
                    break
                found[:] = closed
        return always.astype(np.int8) - never.astype(np.int8)


def _term(formula: stl.Formula, *, positive: bool) -> _Term:
    """Return a formula, or its negation, in negation normal form."""
    match formula:
        case stl.Constant(value=value):
            return ("constant", value == positive)
        case stl.Predicate(index=index):
            return ("literal", index, positive)
        case stl.Not(operand=operand):
            return _term(operand, positive=not positive)
        case stl.And() | stl.Or():
            parts = [_term(each, positive=positive) for each in formula.operands]
            return ("and" if isinstance(formula, stl.And) == positive else "or", *parts)
        case stl.Next(operand=operand, weak=weak):
            return ("next" if positive != weak else "weak next", _term(operand, positive=positive))
        case stl.Always(first=0, last=None, operand=operand):
            inner = _term(operand, positive=positive)
            return ("release", ("constant", False), inner) if positive else ("until", ("constant", True), inner)
        case stl.Eventually(first=0, last=None, operand=operand):
            inner = _term(operand, positive=positive)
            return ("until", ("constant", True), inner) if positive else ("release", ("constant", False), inner)
        case stl.Until(first=0, last=None, left=left, right=right):
            return ("until" if positive else "release", _term(left, positive=positive), _term(right, positive=positive))
    raise AutomatonError("linear temporal logic has no windows, and no operators about the past")


class _Progression:
    """Computes the obligation that remains after an instant, with a cache."""

    def __init__(self) -> None:
        self._known: dict[tuple[_Term, int], _State] = {}

    def of_state(self, state: _State, letter: int) -> _State:
        """Progress a state by a letter."""
        return _or(_and(self._of_term(term, letter) for term in clause) for clause in state)

    def _of_term(self, term: _Term, letter: int) -> _State:
        found = self._known.get((term, letter))
        if found is None:
            found = self._known[term, letter] = self._progressed(term, letter)
        return found

    def _progressed(self, term: _Term, letter: int) -> _State:
        match term:
            case ("constant", value):
                return _TRUE if value else _FALSE
            case ("literal", index, sign):
                return _TRUE if bool(letter >> index & 1) == sign else _FALSE
            case ("and", *parts):
                return _and(self._of_term(part, letter) for part in parts)
            case ("or", *parts):
                return _or(self._of_term(part, letter) for part in parts)
            case ("first", inner):
                return self._of_term(inner, letter)
            case ("next", inner):
                return frozenset([frozenset([_INSTANT, ("first", inner)])])
            case ("weak next", inner):
                return frozenset([frozenset([_END]), frozenset([("first", inner)])])
            case ("until", left, right):
                rest = frozenset([frozenset([term])])
                return _or([self._of_term(right, letter), _and([self._of_term(left, letter), rest])])
            case ("release", left, right):
                rest = frozenset([frozenset([term])])
                return _and([self._of_term(right, letter), _or([self._of_term(left, letter), rest])])
        return _TRUE if term == _INSTANT else _FALSE


def _or(states: Iterable[_State]) -> _State:
    clauses: set[frozenset[_Term]] = set()
    for state in states:
        clauses |= state
    if len(clauses) > _MOST_CLAUSES:
        raise AutomatonError("its automaton has states that are too large; split the formula")
    return frozenset(clause for clause in clauses if not any(other < clause for other in clauses))


def _and(states: Iterable[_State]) -> _State:
    total = _TRUE
    for state in states:
        total = _or([frozenset(one | other for one in total for other in state)])
    return total


def _holds_at_end(state: _State) -> bool:
    """Whether the obligation is met if there is no further instant."""
    return any(all(term[0] in ("release", "end") for term in clause) for clause in state)


class AutomatonMonitor:
    """Tracks runs in an automaton, for many rows at once; has the interface of `monitor.Monitor`.

    Attributes:
        verdict: 1 satisfied, -1 violated, 0 undecided; shape (rows,).
        is_changed: Whether the last instant changed the state of a row.
    """

    def __init__(self, automaton: Automaton, rows: int) -> None:
        self._automaton = automaton
        self._states = np.full(rows, Automaton.start, np.int32)
        self.verdict = np.zeros(rows, np.int8)
        self.is_changed = True

    def update(self, values: Sequence[Array]) -> None:
        """Process the robustness of each predicate at the next instant, each of shape (rows,)."""
        letters = np.zeros(len(self._states), np.int32)
        for index, value in enumerate(values):
            letters |= (value > 0.0).astype(np.int32) << index
        before, self._states = self._states, self._automaton.transitions[self._states, letters]
        self.is_changed = bool((self._states != before).any())
        self.verdict = self._automaton.verdicts[self._states]

    def finish(self) -> None:
        """End the run."""
        self.verdict = self.presumption
        self.is_changed = True

    @property
    def presumption(self) -> NDArray[np.int8]:
        """The verdict if the run ended now: 1 or -1; shape (rows,)."""
        return np.where(self._automaton.accepting[self._states], 1, -1).astype(np.int8)

    @property
    def lower(self) -> Array:
        """Infinity where the formula holds, else minus infinity: this logic has no robustness."""
        return np.where(self.verdict > 0, np.inf, -np.inf)

    @property
    def upper(self) -> Array:
        """Minus infinity where the formula fails, else infinity."""
        return np.where(self.verdict < 0, -np.inf, np.inf)

    def exact(self) -> tuple[int, Array]:
        """Return nothing: this logic has no robustness."""
        return 0, np.empty((0, len(self._states)))

    def reasons(self, rows: NDArray[np.intp], side: int | None = None) -> list[None]:
        """Return None for each row: no single sample decides a path through an automaton."""
        return [None] * len(rows)

    def select(self, rows: NDArray[np.intp]) -> AutomatonMonitor:
        """Return a monitor of some rows, with their history."""
        other = AutomatonMonitor(self._automaton, len(rows))
        other._states, other.verdict = self._states[rows], self.verdict[rows]
        return other
