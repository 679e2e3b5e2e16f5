"""Search for a violation of a specification, and simplification of the violation found.

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

#: The substitute for the robustness of a failed run; methods need finite values and square them.
_WORST = 1e100


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The result of a search.

    Attributes:
        runs: The number of runs up to the first violation, or in total; later runs of the same batch do not count.
        failed: The number of runs that failed or had values rejected by the scenario.
        failure: The reason of the first failure; None if no run failed.
        shrinking: The number of further runs for simplifying the violation.
        values: The values of the violation, or of the least robust run if there is no violation, by path.
        found: The values of the violation before simplification; None without a violation.
        outcome: The outcome of the specification for `values`; None if every run failed.
        one_by_one: Why runs were executed one by one; None if they were batched as arrays.
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
    """The search is over."""


class _Search:
    """The state of a search: executes runs, keeps the best, and ends at the first violation or the last allowed run.

    Attributes:
        runs: The number of runs that count.
        failed: The number of these that failed.
        failure: The reason of the first failure; None if no run failed.
        values: The values of the violation, or of the least robust run so far; None before a run succeeded.
        merit: The value of the objective there.
        is_violated: Whether `values` are a violation.
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
        """Execute the runs at points (n, d), and return the values of the objective (n,).

        Raises:
            _SearchOverError: A run is a violation, or no further runs are allowed.
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
        """Return the rows of the runs in order, up to and including the first violation if there is one."""
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
        space: The varied values and the specification.
        method: The name of the search method.
        runs: The maximum number of runs, apart from those for simplification.
        seed: The seed of the search.
        jobs: The number of worker processes for the runs of a batch; 0 for this process. It does not affect the result.
        batch: The maximum number of runs batched as arrays; 1 for none. It does not affect the result.
        on_progress: Called after each run with the number of completed runs and the maximum.

    Raises:
        SweepError: There is no such method, it needs a module that is not installed, or a worker process died.
        KeyboardInterrupt: A signal ended a run.
    """
    chosen = method_named(method)
    with signals_raised():
        state = _searched(space, space.work(batch), chosen, runs, seed, jobs, on_progress)
        known = (state.runs, state.failed, state.failure)
        # Outcomes of batched runs carry no reasons, so this run is repeated alone.
        outcome = None if state.values is None else space.outcome(state.values)
        values = state.values or {}
        if not state.is_violated:
            return SearchResult(*known, 0, values, None, outcome, state.one_by_one)
        if not space.is_violation(outcome):
            raise SweepError(f"run {state.runs - 1} of the search had another result when it was repeated")
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
    """Search until there is a violation or all runs are used."""
    with executor_of(work, min(jobs, runs)) as executor:
        state = _Search(space, executor, work, runs, on_progress)
        with suppress(_SearchOverError):
            method.minimise(state.look, [*space.distributions], runs, seed)
    return state


class _Shrinking:
    """Simplifies a violation: first to the fewest changes, then to the simplest values."""

    def __init__(self, space: SearchSpace, values: dict[str, Any], outcome: Outcome | None) -> None:
        self.space = space
        self.values: Mapping[str, Any] = values
        self.outcome = outcome
        self.runs = 0

    def shrink(self) -> None:
        """Try simpler values until none of them violates the specification."""
        # A change may be needed only because of another one, so all removals are tried again after each success.
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
