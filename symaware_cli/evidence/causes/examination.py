"""The examination of a violation: branches in which candidates are corrected, compared with placebos.

Reasons: docs/decisions/0090-explanations.md
"""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path

from symaware_cli.evidence.branch_changes import BranchError
from symaware_cli.evidence.causes.branching_run import BranchingRun, branching_run
from symaware_cli.evidence.causes.candidate import (
    KINDS,
    Candidate,
    PairBelief,
    beliefs_of,
    command,
    faults_of,
    promises_of,
)
from symaware_cli.evidence.causes.component_alternatives import component_alternatives, possible_together
from symaware_cli.evidence.causes.explanation import (
    CandidateRow,
    CandidateSet,
    Explanation,
    ExplanationPlan,
    FutureComparison,
    strongest,
)
from symaware_cli.evidence.causes.lost_messages import has_messages, links_with_losses
from symaware_cli.evidence.causes.paired_shares import PairedShares, holm
from symaware_cli.language import FilePath, open_scenario
from symaware_cli.language.build import Built
from symaware_cli.log import INPUTS, open_log
from symaware_cli.log.digest import digest
from symaware_cli.studies import Over
from symaware_cli.world import key_of

#: How long before the violation candidates are made right, by default [s].
BEFORE = (0.5, 1.0, 2.0, 4.0)

#: Futures of each arm in which sets of candidates are screened.
_SCREENED = 12

#: The number of candidates that are compared with placebos at most: of those that screening leaves, the strongest.
_MOST_TESTED = 4

#: The most candidates of a set that suffices together; larger ones explain little.
_MOST_TOGETHER = 4

#: The fewest futures with which a difference of several candidates can be established.
_FEWEST = 16

#: Candidates of which the row in this run is made, at most; of more, only of those that screening leaves.
_MOST_ROWS = 40

#: A branch takes longer than the run, as beliefs are corrected after each turn: measured on `scenarios/mist.yaml`.
_DEARER = 1.5


def explain(
    log: FilePath,
    specification: str | None = None,
    *,
    kinds: Sequence[str] = KINDS,
    agents: str = "*",
    before: Sequence[float] = BEFORE,
    futures: int = 32,
    within: float | None = None,
    confidence: float = 0.95,
    budget: float | None = None,
    seed: int = 0,
    over: Over = (),
    on_plan: Callable[[ExplanationPlan], object] | None = None,
    on_progress: Callable[[int, int], object] | None = None,
) -> Explanation:
    """Find what would have prevented a violation: a true belief, messages in time, no fault, another component.

    First all candidates are corrected at once, and compared with all placebos: single ones are examined only if that
    saves more futures. *In this run*, with all other draws unchanged, each is corrected from each instant on. *In
    general*, everything after the instant is drawn anew, in the same way for a branch with the candidate corrected and
    for one with its placebo; the difference of the shares of futures that they save has an exact paired interval,
    corrected by Holm's procedure over all candidates and instants. Before, sets of candidates are screened by halves,
    with futures of their own, from the instant at which all together matter most: the halves of a set that saves
    nothing are not examined, and of the candidates that remain the few strongest are. If no single one is a cause, the
    set of all is reduced to a small one that suffices.

    Args:
        log: The log.
        specification: The name of the violated specification; by default the one that was violated first.
        kinds: The kinds of candidates, of `KINDS`.
        agents: A pattern of the ids of the agents whose beliefs and received messages are examined.
        before: The times before the violation from which on candidates are corrected [s].
        futures: The number of redrawn futures of each arm.
        within: The longest time that a branch is run after the violation [s]; it is saved without a violation until
            then. None for the end of the run.
        confidence: The probability that every reported cause is a cause.
        budget: The maximum CPU time [s]; fewer futures are drawn if it would be exceeded. None for no limit.
        seed: The seed of the redrawn futures.
        over: The alternatives of components; see `component_alternatives`.
        on_plan: Called with the plan before any branch is run.
        on_progress: Called with the number of branches run and planned.

    Raises:
        BranchError: Nothing was violated, nothing can be corrected, the run is not reproducible or computes in several
            processes, or the budget is too small.
        LogError: The log cannot be read.
        ScenarioError: The scenario of the log is not valid here.
        KeyboardInterrupt: A signal ended a branch.
    """
    path = Path(log)
    unknown = [each for each in kinds if each not in KINDS]
    if unknown or not kinds:
        raise BranchError(f"kinds of candidates are {', '.join(KINDS)}; not {', '.join(unknown) or 'none at all'}")
    if INPUTS in open_log(path).channels:
        raise BranchError("the run received external inputs (/inputs in its log), which other futures do not have")
    built = open_scenario(path)
    name, violated, text = _violation(path, specification)
    step = built.simulation.environment.time_step / 1e9
    instants = _instants(violated, before, step)
    if not instants:
        raise BranchError(f"`{name}` is violated at {violated:g} s: no instant of the grid is that early")
    remote = [entry.path for entry in built.simulation.entries if entry.timing.in_process]
    if remote:
        raise BranchError(f"the run cannot be branched here: {remote[0]} computes in another process (`run_in`)")
    if over and "components" not in kinds:
        raise BranchError("alternatives of components are given, and kinds of candidates do not include components")
    candidates, passed = _candidates(built, path, kinds, agents, instants, name, violated, over)
    with branching_run(path, name, candidates) as run:
        run.begin(instants)
        if run.violated is None or abs(run.violated - violated) > 1.5 * step:
            raise BranchError(f"{path} does not repeat: see `symaware verify {path}`")
        run.horizon = math.inf if within is None else violated + within
        end = min(run.horizon, len(run.times) * step)
        left = sum(end - each for each in instants) / len(instants) / step
        sets = possible_together(candidates)
        plan = _plan(len(candidates), len(sets), instants, futures, left * run.step_time * _DEARER, budget)
        if on_plan is not None:
            on_plan(plan)
        examination = _Examination(run, plan, seed, 1.0 - confidence, on_progress)
        everything = examination.everything(sets)
        best = strongest(everything)
        rows: Sequence[CandidateRow] = []
        together = None
        if best.is_established:
            rows = examination.rows(path, candidates, sets, best.instant)
            if not any(each.is_cause for each in rows):
                most = sets[everything.index(best) // len(instants)]
                together = examination.together(path, most, best, len(candidates))
        return Explanation(
            path,
            digest(open_log(path)).combined,
            name,
            violated,
            text,
            tuple(dict.fromkeys(each.group for each in candidates)),
            plan,
            run.branches,
            confidence,
            everything,
            rows,
            together,
            passed,
            run.times,
        )


def _candidates(
    built: Built,
    path: Path,
    kinds: Sequence[str],
    agents: str,
    instants: Sequence[float],
    specification: str,
    violated: float,
    over: Over,
) -> tuple[Sequence[Candidate], Sequence[Candidate]]:
    """Return the candidates that branches can correct, and those that they no longer can: see `Candidate.acts_from`.

    Raises:
        BranchError: There are none.
    """
    found: list[Candidate] = []
    late: list[Candidate] = []
    reasons = []

    def still(some: Sequence[Candidate]) -> bool:
        """Keep the candidates that can be corrected from some instant on, and return whether there are others."""
        passed = [each for each in some if not any(each.acts_from(instant) for instant in instants)]
        late.extend(passed)
        found.extend(each for each in some if each not in passed)
        return bool(passed)

    if "beliefs" in kinds:
        found += beliefs_of(built)
        reasons.append("no belief can be wrong (sensors are exact, and messages contain no beliefs)")
    if "faults" in kinds:
        reasons.append(
            f"all faults are over before {instants[0]:g} s (--before)"
            if still(faults_of(built, violated))
            else "no fault begins before the violation"
        )
    if "promises" in kinds:
        reasons.append(
            f"all broken promises were broken before {instants[0]:g} s (--before)"
            if still(promises_of(built, open_log(path), specification, violated))
            else "no promise is broken before the violation"
        )
    if "messages" in kinds:
        if has_messages(built):
            # The run is used up by this; `branching_run` builds another one.
            found += links_with_losses(built, instants[0], violated)
        reasons.append("no message was lost or late")
    if "components" in kinds:
        found += component_alternatives(path, over)
        reasons.append("no component has an alternative (--over)")
    found = [each for each in found if each.whose is None or fnmatch.fnmatchcase(each.whose, agents)]
    if not found:
        whose = "" if agents == "*" else f" for {agents}"
        raise BranchError(f"nothing in {path} can be a cause{whose}: {', and '.join(reasons)}")
    return sorted(found, key=lambda each: KINDS.index(each.group)), late


def _violation(path: Path, specification: str | None) -> tuple[str, float, str]:
    """Return the violated specification, the time of the violation [s], and the message of the run about it."""
    found = [event for event in open_log(path).events() if event.name == "violated"]
    for event in found:
        name = event.source.removeprefix("specifications.")
        if specification in (None, name):
            return name, event.time / 1e9, event.text
    if specification is None:
        raise BranchError(f"no specification was violated in {path}: there is nothing to explain")
    there = ", ".join(dict.fromkeys(event.source.removeprefix("specifications.") for event in found)) or "nothing"
    raise BranchError(f"`{specification}` was not violated in {path}; {there} was")


def _instants(violated: float, before: Sequence[float], step: float) -> list[float]:
    """Return the instants of the grid within the run, at steps, ascending."""
    steps = {round((violated - each) / step) for each in before if each > 0.0}
    return [round(each * step, 9) for each in sorted(steps) if 0 < each * step < violated]


def _plan(
    count: int, sets: int, instants: Sequence[float], futures: int, branch_time: float, budget: float | None
) -> ExplanationPlan:
    grid = len(instants)
    rows = min(count, _MOST_ROWS) * grid
    # Each in the futures of its purpose, in which nothing is done once.
    screening = 0 if count == 1 else (2 * count - 1) * _SCREENED
    reduction = (_most_reductions(count) + 1) * _SCREENED if count > 2 else 0

    def branches(futures: int) -> int:
        together = 2 * futures if reduction else 0
        return rows + screening + reduction + together + (sets + min(count, _MOST_TESTED)) * grid * 2 * futures

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


def _most_reductions(count: int) -> int:
    """The maximum number of sets tried to find a small one: enough for two candidates that matter together."""
    return 0 if count <= 2 else 4 * (count - 1).bit_length() + 4


def _halves(some: Sequence[Candidate]) -> list[Sequence[Candidate]]:
    return [some[: len(some) // 2], some[len(some) // 2 :]]


class _TooManyError(Exception):
    """No small set was found."""


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
        #: Whether a future is saved by itself, by instant and seed: the placebo of candidates without draws.
        self._untreated: dict[tuple[float, int], bool] = {}
        self._reductions = 0
        #: The fewest futures that truth alone must save: the greatest level of Holm's procedure is alpha.
        self._least_saved = next(each for each in count(1) if PairedShares(each, each, 0).probability <= alpha)

    def everything(self, sets: Sequence[Sequence[Candidate]]) -> list[FutureComparison]:
        """Compare the correction of all candidates of each set at once with all placebos at once, at each instant."""
        instants, futures = self._plan.instants, self._plan.futures
        return self._corrected([self._compared(some, each, "all", futures) for some in sets for each in instants])

    def rows(
        self, log: Path, candidates: Sequence[Candidate], sets: Sequence[Sequence[Candidate]], screened_at: float
    ) -> list[CandidateRow]:
        """Examine single candidates, and return those that may be causes before the others."""
        instants = self._plan.instants
        left = self._screened(sets, screened_at) if len(candidates) > 1 else list(candidates)
        compared = set(left[:_MOST_TESTED])
        few = len(candidates) <= _MOST_ROWS
        # What comes too late to act is not tried: both arms would be equal.
        tested = [(each, at) for each in candidates if each in compared for at in instants if each.acts_from(at)]
        tests = [self._compared([each], at, f"one {each.text}", self._plan.futures) for each, at in tested]
        corrected = self._corrected(tests, self._hypotheses(len(candidates)))
        rows = []
        for each in candidates:
            own = [test for (one, _), test in zip(tested, corrected, strict=True) if one == each]
            saved = (
                [each.acts_from(at) and self._saved(at, [each]) for at in instants] if few or each in compared else []
            )
            wrongness = self._run.wrongness.get(each, []) if isinstance(each, PairBelief) else []
            row = CandidateRow(each, saved, own, each in left, wrongness, "")
            at = (
                row.best.instant
                if row.best
                else next((i for i, ok in zip(instants, saved, strict=False) if ok), instants[0])
            )
            rows.append(replace(row, command=command([each], log, at)))
        return sorted(rows, key=_order)

    def together(
        self, log: Path, candidates: Sequence[Candidate], everything: FutureComparison, count: int
    ) -> CandidateSet | None:
        """Reduce a set of candidates, of which no single one is a cause, to a small set that suffices.

        Args:
            log: The log.
            candidates: The candidates.
            everything: Their comparison at the instant at which they matter most.
            count: The number of all candidates.

        Returns:
            None if no small set was found, or its difference is not established.
        """
        instant, some, test = everything.instant, list(candidates), everything
        if len(candidates) > 2:
            try:
                some = self._reduced(some, [], instant, everything.shares.difference / 2.0)
            except _TooManyError:
                return None
            if len(some) > _MOST_TOGETHER:
                return None
            fresh = self._compared(some, instant, "together", self._plan.futures)
            (test,) = self._corrected([fresh], self._hypotheses(count))
        if not test.is_established:
            return None
        return CandidateSet(some, test, self._saved(instant, some), command(some, log, instant))

    def _reduced(
        self, some: Sequence[Candidate], rest: Sequence[Candidate], instant: float, least: float
    ) -> list[Candidate]:
        """Return a small subset of some candidates that suffices together with the others.

        If neither half suffices, the needed part of each half is found with the other half added. Source: A. Zeller,
        "Yesterday, my program worked. Today, it does not. Why?", ESEC/FSE 1999 (the algorithm dd+).

        Args:
            some: The candidates; together with the others, they suffice.
            rest: The others.
            instant: The instant from which on they are corrected [s].
            least: The least difference of the shares that counts as sufficient.

        Raises:
            _TooManyError: More sets would be tried than are planned.
        """
        if len(some) == 1:
            return list(some)
        halves = _halves(some)
        for half in halves:
            self._reductions += 1
            if self._reductions > _most_reductions(self._plan.candidates):
                raise _TooManyError
            if self._selected([*half, *rest], instant, "reduction").difference >= least:
                return self._reduced(half, rest, instant, least)
        first = self._reduced(halves[0], [*halves[1], *rest], instant, least)
        return first + self._reduced(halves[1], [*first, *rest], instant, least)

    def _hypotheses(self, count: int) -> int:
        """The number of hypotheses about some candidates: one for each at each instant, and one for a set of them."""
        return count * len(self._plan.instants) + (count > 2)

    def _screened(self, sets: Sequence[Sequence[Candidate]], instant: float) -> list[Candidate]:
        """Halve sets of candidates as long as they save something, and return the single ones, the strongest first."""
        left: list[tuple[int, int, Candidate]] = []
        # If all can be compared, none has to be ranked.
        is_ranked = sum(map(len, sets)) > _MOST_TESTED
        queue = [part for some in sets for part in (_halves(some) if len(some) > 1 else [some])]
        while queue:
            some = queue.pop(0)
            if len(some) > 1 or not is_ranked:
                if self._saves_more(some, instant):
                    queue += _halves(some) if len(some) > 1 else []
                    left += [(0, len(left), some[0])] if len(some) == 1 else []
                continue
            found = self._selected(some, instant, "screening")
            if found.first > found.second:
                left.append((found.second - found.first, len(left), some[0]))
        return [each for _, _, each in sorted(left, key=lambda each: each[:2])]

    def _selected(self, candidates: Sequence[Candidate], instant: float, purpose: str) -> PairedShares:
        """Compare truth with no change, in a few futures, to select the candidates to examine in other futures.

        In redrawn futures a placebo saves as many as no change, apart from its effects other than new draws, and the
        branches without a change are run only once for all sets.
        """
        seeds = self._seeds(instant, purpose, _SCREENED)
        second = [self._left_alone(instant, each) for each in seeds]
        return PairedShares.of([self._saved(instant, candidates, seed=each) for each in seeds], second)

    def _saves_more(self, candidates: Sequence[Candidate], instant: float) -> bool:
        """Whether truth saves more futures than no change; futures that can no longer alter this are not run."""
        seeds = self._seeds(instant, "screening", _SCREENED)
        alone = [self._left_alone(instant, each) for each in seeds]
        lead = 0
        for number, seed in enumerate(seeds):
            lead += self._saved(instant, candidates, seed=seed) - alone[number]
            still_lost = sum(alone[number + 1 :])
            if lead > still_lost or lead + (_SCREENED - number - 1) - still_lost <= 0:
                break
        return lead > 0

    def _compared(
        self, candidates: Sequence[Candidate], instant: float, purpose: str, futures: int
    ) -> FutureComparison:
        """Compare truth and placebo in futures that are the same for both.

        No placebo is tried if truth saves fewer futures than a difference takes that is established at any level.
        """
        seeds = self._seeds(instant, purpose, futures)
        first: list[bool] = []
        for each in seeds:
            first.append(self._saved(instant, candidates, seed=each))
            if first.count(False) > futures - min(self._least_saved, futures):
                return FutureComparison(instant, PairedShares(len(first), sum(first), 0), math.nan, math.nan, False)
        second = [self._placebo(instant, candidates, each) for each in seeds]
        return FutureComparison(instant, PairedShares.of(first, second), math.nan, math.nan)

    def _seeds(self, instant: float, purpose: str, count: int) -> list[int]:
        return [key_of(self._seed, "explain", purpose, round(instant * 1e9), each) >> 1 for each in range(count)]

    def _placebo(self, instant: float, candidates: Sequence[Candidate], seed: int) -> bool:
        if any(each.has_placebo for each in candidates):
            return self._saved(instant, candidates, truth=False, seed=seed)
        return self._left_alone(instant, seed)

    def _left_alone(self, instant: float, seed: int) -> bool:
        if (instant, seed) not in self._untreated:
            self._untreated[instant, seed] = self._saved(instant, [], seed=seed)
        return self._untreated[instant, seed]

    def _saved(
        self, instant: float, candidates: Sequence[Candidate], *, truth: bool = True, seed: int | None = None
    ) -> bool:
        saved = self._run.saved(instant, candidates, truth=truth, seed=seed)
        if self._on_progress is not None:
            self._on_progress(self._run.branches, self._plan.branches)
        return saved

    def _corrected(self, tests: Sequence[FutureComparison], count: int | None = None) -> list[FutureComparison]:
        levels = holm(
            [each.shares.probability if each.has_placebo else 1.0 for each in tests], count or len(tests), self._alpha
        )
        ends = [
            each.shares.interval(level) if each.has_placebo else (math.nan, math.nan)
            for each, level in zip(tests, levels, strict=True)
        ]
        return [each._replace(lower=low, upper=high) for each, (low, high) in zip(tests, ends, strict=True)]


def _order(row: CandidateRow) -> tuple[bool, float, float, bool, bool]:
    """The sort key: causes first, by lower bound and difference; then those left by screening or saving this run."""
    best = row.best
    lower, difference = (best.lower, best.shares.difference) if best and best.has_placebo else (-2.0, -2.0)
    return not row.is_cause, -lower, -difference, not row.left, not any(row.in_this_run)
