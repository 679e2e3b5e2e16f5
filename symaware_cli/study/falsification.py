"""Searches for a violation of a specification, and makes what it finds as simple as possible."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Literal, get_args

import numpy as np

from symaware_cli.specification.outcome import Outcome
from symaware_cli.study.search_space import SearchSpace, is_violated, merit
from symaware_cli.study.statistics.design import independent
from symaware_cli.study.statistics.interval_estimate import Array
from symaware_cli.study.sweep_error import SweepError

#: ``random``: independent draws; the others: towards less robustness.
Method = Literal["random", "differential-evolution", "cma-es"]
METHODS: tuple[Method, ...] = get_args(Method)

#: The least number of points of a generation of differential evolution, and how many for each coordinate.
_LEAST, _EACH = 8, 5

#: The standard deviation with which the covariance matrix adaptation begins, on coordinates between 0 and 1.
_DEVIATION = 0.3


@dataclass(frozen=True, slots=True)
class SearchResult:
    """What a search found.

    Attributes:
        runs: How many runs were made until the first violation, or in all.
        failed: How many of them failed, or had values that the scenario refuses.
        shrinking: How many further runs it took to make the violation simple.
        values: The values of the violation, or those of the least robustness without one, by their paths.
        found: The values of the violation before it was made simple; None without one.
        outcome: What became of the specification with these values; None if every run failed.
    """

    runs: int
    failed: int
    shrinking: int
    values: Mapping[str, Any]
    found: Mapping[str, Any] | None
    outcome: Outcome | None


class _SearchOverError(Exception):
    """Ends a search."""


class _Search:
    """Counts runs, keeps the best, and ends with the first violation or the last run that is allowed."""

    def __init__(self, space: SearchSpace, runs: int, on_progress: Callable[[int, int], object] | None) -> None:
        self.space = space
        self.most = runs
        self.runs = 0
        self.failed = 0
        self.values: Mapping[str, Any] = {}
        self.outcome: Outcome | None = None
        self._on_progress = on_progress

    def look(self, point: Array) -> float:
        """Make the run at a point, and return what is to be minimised."""
        if self.runs == self.most:
            raise _SearchOverError
        values = self.space.values(point)
        outcome = self.space.outcome(values)
        self.runs += 1
        self.failed += outcome is None
        if self._on_progress is not None:
            self._on_progress(self.runs, self.most)
        if outcome is not None and (self.outcome is None or merit(outcome) < merit(self.outcome)):
            self.values, self.outcome = values, outcome
        if is_violated(outcome):
            self.values, self.outcome = values, outcome
            raise _SearchOverError
        found = merit(outcome)
        return found if math.isfinite(found) else 1e300


def search(
    space: SearchSpace,
    method: Method,
    runs: int,
    seed: int,
    on_progress: Callable[[int, int], object] | None = None,
) -> SearchResult:
    """Search for a violation.

    Args:
        space: What varies, and the specification.
        method: How to search.
        runs: How many runs at most, besides those that make the violation simple.
        seed: What the search draws from.
        on_progress: Called after each run with how many were made, and how many at most.

    Raises:
        SweepError: The method needs a module that is not installed.
        KeyboardInterrupt: A signal ended a run.
    """
    if method == "cma-es" and find_spec("cmaes") is None:
        raise SweepError(
            "the method cma-es needs the module `cmaes`, which is not installed: pip install 'symaware-cli[falsify]'"
        )
    state = _Search(space, runs, on_progress)
    try:
        if method == "random":
            for block in range(0, runs, 256):
                for point in independent(seed, [*space.distributions], np.arange(block, block + 256)):
                    state.look(point)
        elif method == "cma-es":
            _adapt(state, seed)
        else:
            _evolve(state, seed)
    except _SearchOverError:
        pass
    if not is_violated(state.outcome):
        return SearchResult(state.runs, state.failed, 0, state.values, None, state.outcome)
    shrinking = _Shrinking(space, dict(state.values), state.outcome)
    shrinking.shrink()
    return SearchResult(state.runs, state.failed, shrinking.runs, shrinking.values, state.values, shrinking.outcome)


def _evolve(state: _Search, seed: int) -> None:
    """Differential evolution on points between 0 and 1, until it is ended; it begins again where it has converged.

    Source: R. Storn, K. Price, "Differential Evolution: A Simple and Efficient Heuristic for Global Optimization over
    Continuous Spaces", Journal of Global Optimization 11, 1997; as in `scipy.optimize.differential_evolution`.
    """
    from scipy.optimize import Bounds, differential_evolution

    names = [*state.space.distributions]
    size = max(_LEAST, _EACH * len(names))
    for attempt in range(state.most):
        first = independent(seed, names, np.arange(attempt * size, (attempt + 1) * size))
        random = np.random.default_rng((seed, attempt))
        bounds = Bounds(np.zeros(len(names)), np.ones(len(names)))
        differential_evolution(state.look, bounds, init=first, seed=random, polish=False, tol=1e-6, maxiter=state.most)


def _adapt(state: _Search, seed: int) -> None:
    """Covariance matrix adaptation on points between 0 and 1, until it is ended.

    Where it has converged, it begins again at another point, with twice the points in a generation.

    Sources: N. Hansen, "The CMA Evolution Strategy: A Tutorial", arXiv:1604.00772, 2016; A. Auger, N. Hansen, "A
    Restart CMA Evolution Strategy with Increasing Population Size", IEEE Congress on Evolutionary Computation 2005.
    """
    from cmaes import CMA

    names = [*state.space.distributions]
    square = np.tile([0.0, 1.0], (len(names), 1))
    size: int | None = None
    for attempt in range(state.most):
        (first,) = independent(seed, names, np.arange(attempt, attempt + 1))
        drawn = int(np.random.SeedSequence((seed, attempt)).generate_state(1)[0])
        found = CMA(mean=first, sigma=_DEVIATION, bounds=square, seed=drawn, population_size=size)
        while not found.should_stop():
            points = [found.ask() for _ in range(found.population_size)]
            found.tell([(point, state.look(point)) for point in points])
        size = 2 * found.population_size


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
        if not is_violated(outcome):
            return False
        self.values, self.outcome = values, outcome
        return True
