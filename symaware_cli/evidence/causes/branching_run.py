"""A run that returns to earlier instants and continues in branches with corrected candidates, in one process."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from symaware_cli.core.stateful import StateError
from symaware_cli.engine import Run, StateMark, mark, return_to
from symaware_cli.evidence.branch_changes import BranchError
from symaware_cli.evidence.causes.candidate import Candidate, PairBelief
from symaware_cli.language import open_scenario, prepared

#: The names of the candidates' faults in the scenario of the branches.
_TRUE, _PLACEBO = "explain-true-{}", "explain-placebo-{}"


class BranchingRun:
    """The run of a log with marked states, from which branches are run.

    Attributes:
        violated: The time at which the specification was violated [s]; None before `begin`, and without a violation.
        wrongness: For each candidate about a state, the error of the believed position at each step [m]: NaN without a
            belief. Shape (steps,).
        times: The instants of these errors [s]; shape (steps,).
        horizon: Branches end at this time at the latest [s].
        branches: The number of branches that were run.
        step_time: The CPU time of a step of the run itself [s].
    """

    def __init__(self, run: Run, specification: str, candidates: Sequence[Candidate], first: int) -> None:
        """Prepare.

        Args:
            run: The run, which has not begun and writes no log.
            specification: The name of the specification.
            candidates: The candidates that branches correct.
            first: The index of the first of the candidates' faults: each candidate has one for its truth, and one for
                its placebo if it has one.
        """
        self.violated: float | None = None
        beliefs = [each for each in candidates if isinstance(each, PairBelief)]
        self.wrongness: Mapping[PairBelief, list[float]] = {each: [] for each in beliefs if each.part == "state"}
        self.times: list[float] = []
        self.horizon = math.inf
        self.branches = 0
        self.step_time = 0.0
        self._run = run
        self._monitor = next(each for each in run.specification_monitors if each.specification.name == specification)
        self._marks: dict[float, StateMark] = {}
        self._faults: dict[tuple[Candidate, bool], int] = {}
        for each in candidates:
            for truth in (True, False) if each.has_placebo else (True,):
                self._faults[each, truth] = first
                first += 1

    def begin(self, instants: Sequence[float]) -> None:
        """Make the run itself, and mark its states.

        Args:
            instants: The instants from which branches may begin [s], ascending.

        Raises:
            BranchError: The state at an instant cannot be marked, or the run failed.
            KeyboardInterrupt: A signal ended the run.
        """
        run, began = self._run, time.process_time()
        step = run.simulation.environment.time_step
        marked = {round(each * 1e9 / step): each for each in instants}
        run.advance(0)
        while run.status is None:
            if run.done in marked:
                try:
                    self._marks[marked[run.done]] = mark(run)
                except StateError as error:
                    raise BranchError(f"the run cannot be continued from {marked[run.done]:g} s: {error}") from error
            snapshot, now = run.simulation.environment.snapshot(), run.simulation.clock.now
            run.advance(1)
            self.times.append(now / 1e9)
            self._measure(snapshot)
            if self.violated is None and self._monitor.verdict < 0:
                self.violated = now / 1e9
        self._check()
        self.step_time = (time.process_time() - began) / max(run.done, 1)

    def _measure(self, snapshot: object) -> None:
        """Record the errors of the beliefs of the last step."""
        motions = snapshot.motions  # type: ignore[attr-defined]
        agents = {id: group.agents[row] for group in self._run.simulation.groups for row, id in enumerate(group.ids)}
        for candidate, found in self.wrongness.items():
            agent, error = agents[candidate.agent], np.nan
            true = motions.get(candidate.about)
            if true is not None and candidate.agent == candidate.about:
                group = agent.group
                believed = group.model.positions(agent.self_awareness["state"][None])[0]
                error = float(np.linalg.norm(believed - true[: len(believed)]))
            elif true is not None and (known := agent.awareness_database.get(candidate.about)) is not None:
                half = len(true) // 2
                error = float(np.linalg.norm(known.state[:half] - true[:half]))
            found.append(error)

    def saved(
        self, instant: float, candidates: Sequence[Candidate], *, truth: bool = True, seed: int | None = None
    ) -> bool:
        """Run a branch to the violation or the end, and return whether the specification was not violated.

        Args:
            instant: The begin of the branch [s], one of the instants given to `begin`.
            candidates: The candidates that are corrected from then on, or that get their placebos.
            truth: Whether the candidates are corrected, instead of getting their placebos.
            seed: The seed of all random draws from then on; None for the draws of the run.

        Raises:
            BranchError: The branch failed.
            KeyboardInterrupt: A signal ended the branch.
        """
        run = self._run
        return_to(run, self._marks[instant], seed)
        for each in candidates:
            index = self._faults.get((each, truth))
            if index is not None:
                run.begin_fault(index)
        self.branches += 1
        clock, horizon = run.simulation.clock, self.horizon
        run.advance(until=lambda: self._monitor.verdict < 0 or clock.now / 1e9 >= horizon)
        self._check()
        return bool(self._monitor.verdict >= 0)

    def _check(self) -> None:
        if self._run.signal is not None:
            raise KeyboardInterrupt
        if self._run.failure is not None:
            raise BranchError(f"a branch failed: {self._run.failure.problem}")


@contextmanager
def branching_run(log: Path, specification: str, candidates: Sequence[Candidate]) -> Iterator[BranchingRun]:
    """Provide the run of a log with branches.

    Raises:
        LogError: The log cannot be read.
        ScenarioError: The scenario of the log is not valid here.
    """
    changes = {}
    for number, each in enumerate(candidates):
        changes[f"faults.{_TRUE.format(number)}"] = {"at": 0.0, **each.document(truth=True)}
        if each.has_placebo:
            changes[f"faults.{_PLACEBO.format(number)}"] = {"at": 0.0, **each.document(truth=False)}
    built = open_scenario(log, changes)
    first = len(built.options.faults) - len(changes)
    for fault in built.options.faults[first:]:
        fault.at = None  # branches begin these faults
    options = replace(built.options, pace=None)
    with prepared(replace(built, options=options), None, may_exit=False) as run:
        yield BranchingRun(run, specification, candidates, first)
