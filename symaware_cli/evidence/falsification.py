"""Searches for a violation of a specification, and makes what it finds as simple as possible.

Reasons: docs/decisions/0047-falsification.md
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from symaware_cli.evidence.search_method import SearchMethod, method_named
from symaware_cli.evidence.search_space import CandidateWork, SearchSpace
from symaware_cli.specification import Outcome
from symaware_cli.studies import Array, Blocks, Executor, Row, SweepError, executor_of, signals_raised

#: What stands for the robustness of a run that failed; methods take finite numbers, and square them.
_WORST = 1e100


@dataclass(frozen=True, slots=True)
class SearchResult:
    """What a search found.

    Attributes:
        runs: How many runs there are up to the first violation, or in all; further ones of its batch do not count.
        failed: How many of them failed, or had values that the scenario refuses.
        failure: Why the first of these failed.
        shrinking: How many further runs it took to make the violation simple.
        values: The values of the violation, or those of the least robustness without one, by their paths.
        found: The values of the violation before it was made simple; None without one.
        outcome: What became of the specification with these values; None if every run failed.
        one_by_one: Why the runs of a batch were made one by one; None if they were made together as arrays.
    """

    runs: int
    failed: int
    failure: str | None
    shrinking: int
    values: Mapping[str, Any]
    found: Mapping[str, Any] | None
    outcome: Outcome | None
    one_by_one: str | None


class _SearchOverError(Exception):
    """Ends a search."""


class _Search:
    """Has runs made, keeps the best, and ends with the first violation or the last run that is allowed.

    Attributes:
        runs: How many runs count.
        failed: How many of them failed.
        failure: Why the first of these failed.
        values: The values of the violation, or of the least robustness so far; None before a run succeeded.
        merit: What the search minimises there.
        is_violated: Whether that is a violation.
        one_by_one: See `SearchResult`.
    """

    def __init__(
        self,
        space: SearchSpace,
        executor: Executor[Row],
        work: CandidateWork,
        runs: int,
        on_progress: Callable[[int, int], object] | None,
    ) -> None:
        self.runs = 0
        self.failed = 0
        self.failure: str | None = None
        self.values: Mapping[str, Any] | None = None
        self.merit = math.inf
        self.is_violated = False
        self.one_by_one: str | None = None
        self._space = space
        self._executor = executor
        self._work = work
        self._most = runs
        self._on_progress = on_progress
        self._run_time: float | None = None

    def look(self, points: Array) -> Array:
        """Have the runs at some points made, and return what is to be minimised; shapes (n, d) and (n,).

        Raises:
            _SearchOverError: One is a violation, or no more are allowed.
        """
        begin = self.runs
        values = dict(enumerate(map(self._space.values, points[: self._most - begin]), start=begin))
        if begin == 0:
            self.one_by_one = self._work.refusal([*values.values()][:2])
        rows = self._made(values)
        for index in range(begin, begin + len(values)):
            row = rows[index]
            self.runs += 1
            if row.state != "done":
                self.failed += 1
                self.failure = self.failure or row.error
            merit = self._space.merit(row)
            if merit < self.merit or (self.values is None and row.state == "done"):
                self.values, self.merit = values[index], merit
            if self._space.is_violated(row):
                self.values, self.is_violated = values[index], True
                raise _SearchOverError
        if self.runs == self._most:
            raise _SearchOverError
        return np.array([min(self._space.merit(row), _WORST) for row in rows.values()])

    def _made(self, values: Mapping[int, Mapping[str, Any]]) -> dict[int, Row]:
        """The rows of all runs, in their order; of those before and with the first violation, if there is one."""
        rows: dict[int, Row] = {}
        first, reached = max(values), min(values)
        blocks = Blocks(values, len(values), run_time=self._run_time, values=values)
        for row in self._executor.results(blocks):
            rows[row.index] = row
            if self._on_progress is not None:
                self._on_progress(min(values) + len(rows), self._most)
            if self._space.is_violated(row):
                first = min(first, row.index)
            while reached in rows:
                reached += 1
            if reached > first:
                break
        self._run_time = blocks.run_time
        return {index: rows[index] for index in sorted(rows)}


def search(
    space: SearchSpace,
    method: str,
    runs: int,
    seed: int,
    jobs: int = 0,
    batch: int | None = None,
    on_progress: Callable[[int, int], object] | None = None,
) -> SearchResult:
    """Search for a violation.

    Args:
        space: What varies, and the specification.
        method: The name of the search method.
        runs: How many runs at most, besides those that make the violation simple.
        seed: What the search draws from.
        jobs: How many worker processes make the runs of a batch; 0 for this process. The result is the same.
        batch: How many are made together at most, where that is possible; 1 for none. The result is the same.
        on_progress: Called after each run with how many were made, and how many at most.

    Raises:
        SweepError: There is no such method, it needs a module that is not installed, or a worker process died.
        KeyboardInterrupt: A signal ended a run.
    """
    chosen = method_named(method)
    with signals_raised():
        state = _searched(space, space.work(batch), chosen, runs, seed, jobs, on_progress)
        known = (state.runs, state.failed, state.failure)
        # The runs of a batch have no reasons, so this one is made again by itself.
        outcome = None if state.values is None else space.outcome(state.values)
        values = state.values or {}
        if not state.is_violated:
            return SearchResult(*known, 0, values, None, outcome, state.one_by_one)
        if not space.is_violation(outcome):
            raise SweepError(f"run {state.runs - 1} of the search came out otherwise when it was repeated")
        shrinking = _Shrinking(space, dict(values), outcome)
        shrinking.shrink()
    found = shrinking.values, values, shrinking.outcome
    return SearchResult(*known, shrinking.runs, *found, state.one_by_one)


def _searched(
    space: SearchSpace,
    work: CandidateWork,
    method: SearchMethod,
    runs: int,
    seed: int,
    jobs: int,
    on_progress: Callable[[int, int], object] | None,
) -> _Search:
    """Look until there is a violation, or all runs are made."""
    with executor_of(work, min(jobs, runs)) as executor:
        state = _Search(space, executor, work, runs, on_progress)
        with suppress(_SearchOverError):
            method.minimise(state.look, [*space.distributions], runs, seed)
    return state


class _Shrinking:
    """Makes a violation simple: fewest changes first, then the simplest values."""

    def __init__(self, space: SearchSpace, values: dict[str, Any], outcome: Outcome | None) -> None:
        self.space = space
        self.values: Mapping[str, Any] = values
        self.outcome = outcome
        self.runs = 0

    def shrink(self) -> None:
        """Try simpler values until none of them violates the specification."""
        # A change may be needed only because of another one, so all are tried again after each success.
        while any(self._try(values) for values in self._without_one()):
            pass
        for path, value in self.values.items():
            any(self._try({**self.values, path: each}) for each in self.space.simpler(path, value))

    def _without_one(self) -> Iterator[Mapping[str, Any]]:
        values = self.values
        for path in values:
            yield {name: value for name, value in values.items() if name != path}

    def _try(self, values: Mapping[str, Any]) -> bool:
        outcome = self.space.outcome(values)
        self.runs += 1
        if not self.space.is_violation(outcome):
            return False
        self.values, self.outcome = values, outcome
        return True
