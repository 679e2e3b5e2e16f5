"""The explanation of a violation: the beliefs that would have prevented it, had they been true."""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from symaware_cli.evidence.branch_changes import BranchError
from symaware_cli.evidence.causes.branching_run import BranchingRun, branching_run
from symaware_cli.evidence.causes.candidate import Candidate, beliefs_of
from symaware_cli.evidence.causes.paired_shares import PairedShares, holm
from symaware_cli.language import FilePath, open_scenario
from symaware_cli.log import open_log
from symaware_cli.world import key_of

#: How long before the violation beliefs become true, by default [s].
BEFORE = (0.5, 1.0, 2.0, 4.0)

#: Futures of each arm in which sets of beliefs are screened.
_SCREENED = 12

#: The number of beliefs that are compared with their placebos at most: of those that screening leaves, the strongest.
_MOST_TESTED = 4

#: The fewest futures with which a difference of several beliefs can be established.
_FEWEST = 16

#: Beliefs of which the row in this run is made, at most; of more, only of those that screening leaves.
_MOST_ROWS = 40

#: A branch takes longer than the run, as beliefs are corrected after each turn: measured on `scenarios/mist.yaml`.
_DEARER = 1.5


@dataclass(frozen=True, slots=True)
class ExplanationPlan:
    """What an explanation will cost at most.

    Attributes:
        branches: The number of branches.
        cpu_time: Their CPU time, estimated from the run itself [s].
        futures: The number of redrawn futures of each arm.
        candidates: The number of beliefs.
        instants: The instants from which beliefs are made true [s], ascending.
    """

    branches: int
    cpu_time: float
    futures: int
    candidates: int
    instants: Sequence[float]

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data, without what differs from machine to machine."""
        return {
            "branches": self.branches,
            "futures": self.futures,
            "candidates": self.candidates,
            "instants": list(self.instants),
        }


class FutureComparison(NamedTuple):
    """The comparison of truth and placebo from one instant on, over redrawn futures.

    Attributes:
        instant: The instant [s].
        shares: The futures, by which arm saved them.
        lower: The lower bound of the difference, at the level of Holm's procedure.
        upper: The upper bound.
    """

    instant: float
    shares: PairedShares
    lower: float
    upper: float

    @property
    def is_established(self) -> bool:
        """Whether truth saves more futures than the placebo."""
        return self.lower > 0.0

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        shares = self.shares
        return {
            "at": self.instant,
            "futures": shares.trials,
            "saved_by_truth": shares.first + shares.both,
            "saved_by_placebo": shares.second + shares.both,
            "saved_by_truth_alone": shares.first,
            "saved_by_placebo_alone": shares.second,
            "difference": shares.difference,
            "lower": self.lower,
            "upper": self.upper,
            "established": self.is_established,
        }


def strongest(comparisons: Sequence[FutureComparison]) -> FutureComparison:
    """Return the comparison with the greatest difference, established ones first; the earliest of several."""
    return max(comparisons, key=lambda each: (each.is_established, each.shares.difference, -each.instant))


@dataclass(frozen=True, slots=True)
class BeliefRow:
    """What was found about one belief.

    Attributes:
        belief: The belief.
        in_this_run: Whether its truth from each instant on prevents the violation; empty if that was not tried.
        tests: Its comparisons with the placebo; empty if it was not compared.
        left: Whether screening left it. Of those that it leaves, only the strongest are compared.
        wrongness: How far the believed position was from the true one at each step [m], NaN for no belief.
        command: The command that repeats the branch in which it is true, at the instant that `best` names.
    """

    belief: Candidate
    in_this_run: Sequence[bool]
    tests: Sequence[FutureComparison]
    left: bool
    wrongness: Sequence[float]
    command: str

    @property
    def best(self) -> FutureComparison | None:
        """The strongest comparison; see `strongest`."""
        return strongest(self.tests) if self.tests else None

    @property
    def is_uncompared(self) -> bool:
        """Whether screening left it, but it was not compared: whether it is a cause is not known."""
        return self.left and not self.tests

    @property
    def is_cause(self) -> bool:
        """Whether its truth saves more futures than the placebo, from some instant on."""
        return any(each.is_established for each in self.tests)

    def prevented_until(self, instants: Sequence[float]) -> float | None:
        """The latest instant up to which its truth prevents the violation of this run from every instant on [s]."""
        until = None
        for instant, saved in zip(instants, self.in_this_run, strict=False):
            if not saved:
                break
            until = instant
        return until

    def to_json(self, instants: Sequence[float]) -> dict[str, Any]:
        """Return the object as plain data."""
        return {
            "belief": self.belief.to_json(),
            "cause": self.is_cause,
            "screening": "left" if self.left else "excluded",
            "compared": bool(self.tests),
            "in_this_run": [{"at": at, "saved": saved} for at, saved in zip(instants, self.in_this_run, strict=False)],
            "prevented_until": self.prevented_until(instants),
            "in_general": [each.to_json() for each in self.tests],
            "command": self.command,
        }


@dataclass(frozen=True, slots=True)
class Explanation:
    """Why a specification was violated in a run.

    Attributes:
        log: The log of the run.
        specification: The name of the specification.
        violated: When it was violated [s].
        text: What the run said about the violation.
        plan: What was planned.
        branches: The number of branches that were run.
        confidence: The probability that no reported cause is none.
        everything: All beliefs made true at once, compared with all placebos at once.
        rows: The beliefs, causes first.
        times: The instants of `BeliefRow.wrongness` [s].
    """

    log: Path
    specification: str
    violated: float
    text: str
    plan: ExplanationPlan
    branches: int
    confidence: float
    everything: Sequence[FutureComparison]
    rows: Sequence[BeliefRow]
    times: Sequence[float]

    @property
    def causes(self) -> Sequence[BeliefRow]:
        """The beliefs that are reported as causes, the strongest first."""
        return [each for each in self.rows if each.is_cause]

    @property
    def uncompared(self) -> Sequence[BeliefRow]:
        """The beliefs that screening left and that were not compared, as they are more than are compared at most."""
        return [each for each in self.rows if each.is_uncompared]

    @property
    def is_in_awareness(self) -> bool:
        """Whether all beliefs made true at once save more futures than the placebo."""
        return any(each.is_established for each in self.everything)

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        instants = self.plan.instants
        return {
            "log": str(self.log),
            "specification": self.specification,
            "violated": self.violated,
            "text": self.text,
            "plan": self.plan.to_json(),
            "branches": self.branches,
            "confidence": self.confidence,
            "in_awareness": self.is_in_awareness,
            "everything": [each.to_json() for each in self.everything],
            "causes": [each.belief.to_json() for each in self.causes],
            "uncompared": [each.belief.to_json() for each in self.uncompared],
            "beliefs": [each.to_json(instants) for each in self.rows],
        }


def explain(
    log: FilePath,
    specification: str | None = None,
    *,
    agents: str = "*",
    before: Sequence[float] = BEFORE,
    futures: int = 32,
    within: float | None = None,
    confidence: float = 0.95,
    budget: float | None = None,
    seed: int = 0,
    on_plan: Callable[[ExplanationPlan], object] | None = None,
    on_progress: Callable[[int, int], object] | None = None,
) -> Explanation:
    """Find the beliefs that would have prevented the violation of a run, had they been true.

    First all beliefs are made true at once, and compared with their placebos: only if truth saves more futures, single
    beliefs are examined. *In this run*, with all other draws as they were, each belief is made true from each instant
    on. *In general*, everything after the instant is drawn anew, in the same way for a branch with the truth and for
    one with the placebo; the difference of the shares of futures that they save has an exact paired interval, corrected
    by Holm's procedure over all beliefs and instants. Before, sets of beliefs are screened by halves, with futures of
    their own, from the instant at which all beliefs together matter most: the halves of a set that saves nothing are
    not examined, and of the beliefs that remain the few strongest are.

    Args:
        log: The log.
        specification: The name of the violated specification; by default the one that was violated first.
        agents: A pattern of the ids of the believing agents.
        before: How long before the violation beliefs become true [s].
        futures: The number of redrawn futures of each arm.
        within: How long after the violation a branch is run at most [s]: what is not violated until then counts as
            saved. None for the end of the run.
        confidence: The probability that no reported cause is none.
        budget: The most CPU time [s]; fewer futures are drawn if it would be exceeded. None for no limit.
        seed: The seed of the redrawn futures.
        on_plan: Called with the plan before any branch is run.
        on_progress: Called with the number of branches run and planned.

    Raises:
        BranchError: Nothing was violated, the run does not repeat, or the budget is too small.
        LogError: The log cannot be read.
        ScenarioError: The scenario of the log is not valid here.
        KeyboardInterrupt: A signal ended a branch.
    """
    path = Path(log)
    built = open_scenario(path)
    name, violated, text = _violation(path, specification)
    step = built.simulation.environment.time_step / 1e9
    instants = _instants(violated, before, step)
    if not instants:
        raise BranchError(f"`{name}` is violated at {violated:g} s: no instant of the grid is that long before")
    beliefs = [each for each in beliefs_of(built) if fnmatch.fnmatchcase(each.agent, agents)]
    if not beliefs:
        whose = "" if agents == "*" else f" of {agents}"
        raise BranchError(f"no belief{whose} in {path} can be wrong: sensors are exact, and no messages tell anything")
    with branching_run(path, name, beliefs) as run:
        run.begin(instants)
        if run.violated is None or abs(run.violated - violated) > 1.5 * step:
            raise BranchError(f"{path} does not repeat: see `symaware verify {path}`")
        run.horizon = math.inf if within is None else violated + within
        end = min(run.horizon, len(run.times) * step)
        left = sum(end - each for each in instants) / len(instants) / step
        plan = _plan(len(beliefs), instants, futures, left * run.step_time * _DEARER, budget)
        if on_plan is not None:
            on_plan(plan)
        examination = _Examination(run, plan, seed, 1.0 - confidence, on_progress)
        everything = examination.everything(beliefs)
        best = strongest(everything)
        rows = examination.rows(path, beliefs, best.instant) if any(each.is_established for each in everything) else []
        return Explanation(path, name, violated, text, plan, run.branches, confidence, everything, rows, run.times)


def _violation(path: Path, specification: str | None) -> tuple[str, float, str]:
    """Return the specification that was violated, when [s], and what the run said about it."""
    found = [event for event in open_log(path).events() if event.name == "violated"]
    for event in found:
        name = event.source.removeprefix("specifications.")
        if specification in (None, name):
            return name, event.time / 1e9, event.text
    if specification is None:
        raise BranchError(f"no specification was violated in {path}: there is nothing to explain")
    there = ", ".join(dict.fromkeys(event.source.removeprefix("specifications.") for event in found)) or "nothing"
    raise BranchError(f"`{specification}` was not violated in {path}; violated was {there}")


def _instants(violated: float, before: Sequence[float], step: float) -> list[float]:
    """Return the instants of the grid within the run, at steps, ascending."""
    steps = {round((violated - each) / step) for each in before if each > 0.0}
    return [round(each * step, 9) for each in sorted(steps) if 0 < each * step < violated]


def _plan(
    count: int, instants: Sequence[float], futures: int, branch_time: float, budget: float | None
) -> ExplanationPlan:
    grid = len(instants)
    rows = min(count, _MOST_ROWS) * grid
    screening = 0 if count == 1 else (2 * count - 2) * 2 * _SCREENED

    def branches(futures: int) -> int:
        return rows + screening + (1 + min(count, _MOST_TESTED)) * grid * 2 * futures

    if budget is not None:
        while futures > _FEWEST and branches(futures) * branch_time > budget:
            futures -= 1
    total = branches(futures)
    if budget is not None and total * branch_time > budget:
        raise BranchError(
            f"{total:,} branches with {futures} futures take about {total * branch_time:.0f} s of CPU time, more than "
            f"the budget of {budget:g} s: give fewer instants (--before) or fewer agents (--agents)"
        )
    return ExplanationPlan(total, total * branch_time, futures, count, instants)


class _Examination:
    """The branches of an explanation."""

    def __init__(
        self,
        run: BranchingRun,
        plan: ExplanationPlan,
        seed: int,
        alpha: float,
        on_progress: Callable[[int, int], object] | None,
    ) -> None:
        self._run = run
        self._plan = plan
        self._seed = seed
        self._alpha = alpha
        self._on_progress = on_progress
        #: What no treatment at all saves, which is the placebo of beliefs without draws, by instant and seed.
        self._untreated: dict[tuple[float, int], bool] = {}

    def everything(self, beliefs: Sequence[Candidate]) -> list[FutureComparison]:
        """Compare all truths at once with all placebos at once."""
        return self._corrected(
            [self._compared(beliefs, each, "all", self._plan.futures) for each in self._plan.instants]
        )

    def rows(self, log: Path, beliefs: Sequence[Candidate], screened_at: float) -> list[BeliefRow]:
        """Examine single beliefs, and return those that may be causes before the others."""
        instants = self._plan.instants
        left = self._screened(beliefs, screened_at) if len(beliefs) > 1 else list(beliefs)
        compared = set(left[:_MOST_TESTED])
        few = len(beliefs) <= _MOST_ROWS
        tested = [(each, at) for each in beliefs if each in compared for at in instants]
        tests = [self._compared([each], at, f"one {each.text}", self._plan.futures) for each, at in tested]
        corrected = self._corrected(tests, len(beliefs) * len(instants))
        rows = []
        for each in beliefs:
            own = [test for (belief, _), test in zip(tested, corrected, strict=True) if belief == each]
            saved = [self._saved(at, [each]) for at in instants] if few or each in compared else []
            wrongness = self._run.wrongness.get(each, [])
            row = BeliefRow(each, saved, own, each in left, wrongness, "")
            at = (
                row.best.instant
                if row.best
                else next((i for i, ok in zip(instants, saved, strict=False) if ok), instants[0])
            )
            rows.append(replace(row, command=each.command(log, at)))
        return sorted(rows, key=_order)

    def _screened(self, beliefs: Sequence[Candidate], instant: float) -> list[Candidate]:
        """Halve sets of beliefs as long as they save something, and return the single ones, the strongest first."""
        left: list[tuple[int, int, Candidate]] = []
        sets = [beliefs[: len(beliefs) // 2], beliefs[len(beliefs) // 2 :]]
        while sets:
            some = sets.pop(0)
            found = self._compared(some, instant, "screening", _SCREENED).shares
            if found.first <= found.second:
                continue
            if len(some) == 1:
                left.append((found.second - found.first, len(left), some[0]))
            else:
                sets += [some[: len(some) // 2], some[len(some) // 2 :]]
        return [each for _, _, each in sorted(left, key=lambda each: each[:2])]

    def _compared(self, beliefs: Sequence[Candidate], instant: float, purpose: str, futures: int) -> FutureComparison:
        """Compare truth and placebo in futures that are the same for both."""
        seeds = [key_of(self._seed, "explain", purpose, round(instant * 1e9), each) >> 1 for each in range(futures)]
        first = [self._saved(instant, beliefs, truth=True, seed=each) for each in seeds]
        second = [self._placebo(instant, beliefs, each) for each in seeds]
        return FutureComparison(instant, PairedShares.of(first, second), math.nan, math.nan)

    def _placebo(self, instant: float, beliefs: Sequence[Candidate], seed: int) -> bool:
        if any(each.is_drawn for each in beliefs):
            return self._saved(instant, beliefs, truth=False, seed=seed)
        if (instant, seed) not in self._untreated:
            self._untreated[instant, seed] = self._saved(instant, [], seed=seed)
        return self._untreated[instant, seed]

    def _saved(
        self, instant: float, beliefs: Sequence[Candidate], *, truth: bool = True, seed: int | None = None
    ) -> bool:
        saved = self._run.saved(instant, beliefs, truth=truth, seed=seed)
        if self._on_progress is not None:
            self._on_progress(self._run.branches, self._plan.branches)
        return saved

    def _corrected(self, tests: Sequence[FutureComparison], count: int | None = None) -> list[FutureComparison]:
        levels = holm([each.shares.probability for each in tests], count or len(tests), self._alpha)
        ends = [each.shares.interval(level) for each, level in zip(tests, levels, strict=True)]
        return [each._replace(lower=low, upper=high) for each, (low, high) in zip(tests, ends, strict=True)]


def _order(row: BeliefRow) -> tuple[bool, float, float, bool, bool]:
    """Causes before others, by the lower bound and the difference; then what screening left, and what saves this run."""
    best = row.best
    lower, difference = (best.lower, best.shares.difference) if best else (-2.0, -2.0)
    return not row.is_cause, -lower, -difference, not row.left, not any(row.in_this_run)
