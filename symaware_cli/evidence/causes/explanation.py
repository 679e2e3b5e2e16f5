"""The findings about a violation: the corrections that would have prevented it, such as of a false belief.

Reasons: docs/decisions/0090-explanations.md
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from symaware_cli.evidence.causes.candidate import Candidate
from symaware_cli.evidence.causes.paired_shares import PairedShares


@dataclass(frozen=True, slots=True)
class ExplanationPlan:
    """The greatest cost of an explanation.

    Attributes:
        branches: The number of branches.
        cpu_time: The CPU time of the branches, estimated from the run itself [s].
        futures: The number of redrawn futures of each arm.
        candidates: The number of candidates.
        instants: The instants from which candidates are corrected [s], ascending.
    """

    branches: int
    cpu_time: float
    futures: int
    candidates: int
    instants: Sequence[float]

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data, without values that differ between machines."""
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
        shares: The numbers of futures that each arm, or both, saved.
        lower: The lower bound of the difference, at the level of Holm's procedure.
        upper: The upper bound of the difference.
        has_placebo: Whether the placebo was tried. If truth saves so few futures that no difference could be
            established, it is not; `shares` then counts these as saved by truth alone, and there are no bounds.
    """

    instant: float
    shares: PairedShares
    lower: float
    upper: float
    has_placebo: bool = True

    @property
    def is_established(self) -> bool:
        """Whether truth saves more futures than the placebo."""
        return self.lower > 0.0

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        shares = self.shares
        if not self.has_placebo:
            unknown = dict.fromkeys(
                ("saved_by_placebo", "saved_by_truth_alone", "saved_by_placebo_alone", "difference", "lower", "upper")
            )
            known = {"at": self.instant, "futures": shares.trials, "saved_by_truth": shares.first}
            return {**known, **unknown, "established": False}
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
    """Return the comparison with the greatest difference, established ones first; the earliest of equal ones."""
    return max(comparisons, key=lambda each: (each.is_established, each.shares.difference, -each.instant))


@dataclass(frozen=True, slots=True)
class CandidateRow:
    """The findings about one candidate.

    Attributes:
        candidate: The candidate.
        in_this_run: Whether its correction from each instant on prevents the violation; empty if that was not tried.
        tests: The comparisons with its placebo; empty if there are none.
        left: Whether the candidate remained after screening. Only the strongest of those that remain are compared.
        wrongness: The error of the believed position at each step [m], NaN without a belief; empty if the candidate is
            no belief about a state.
        command: The command that repeats the branch with the candidate corrected, from the instant of `best` on.
    """

    candidate: Candidate
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
        """Whether the candidate remained after screening without being compared, so that it may be a cause."""
        return self.left and not self.tests

    @property
    def is_cause(self) -> bool:
        """Whether its correction saves more futures than its placebo, from some instant on."""
        return any(each.is_established for each in self.tests)

    def prevented_until(self, instants: Sequence[float]) -> float | None:
        """The latest instant such that correction from any instant up to it prevents this violation [s]."""
        until = None
        for instant, saved in zip(instants, self.in_this_run, strict=False):
            if not saved:
                break
            until = instant
        return until

    def to_json(self, instants: Sequence[float]) -> dict[str, Any]:
        """Return the object as plain data."""
        return {
            "candidate": self.candidate.to_json(),
            "cause": self.is_cause,
            "screening": "left" if self.left else "excluded",
            "compared": bool(self.tests),
            "in_this_run": [{"at": at, "saved": saved} for at, saved in zip(instants, self.in_this_run, strict=False)],
            "prevented_until": self.prevented_until(instants),
            "in_general": [each.to_json() for each in self.tests],
            "command": self.command,
        }


@dataclass(frozen=True, slots=True)
class CandidateSet:
    """A set of candidates whose joint correction suffices.

    Attributes:
        candidates: The candidates.
        test: The comparison of all corrections with all placebos.
        in_this_run: Whether their correction from the instant of `test` on prevents the violation of this run.
        command: The command that repeats the branch with the candidates corrected.
    """

    candidates: Sequence[Candidate]
    test: FutureComparison
    in_this_run: bool
    command: str

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        return {
            "candidates": [each.to_json() for each in self.candidates],
            "in_this_run": {"at": self.test.instant, "saved": self.in_this_run},
            "in_general": self.test.to_json(),
            "command": self.command,
        }


@dataclass(frozen=True, slots=True)
class Explanation:
    """The explanation of the violation of a specification in a run.

    Attributes:
        log: The log of the run.
        digest: The digest of the log's content.
        specification: The name of the specification.
        violated: The time of the violation [s].
        text: The message of the run about the violation.
        kinds: The kinds of the candidates, of `KINDS`.
        plan: The plan of the branches.
        branches: The number of branches that were run.
        confidence: The probability that every reported cause is a cause.
        everything: The comparison of all corrections at once with all placebos at once.
        rows: The candidates, causes first.
        together: Candidates that suffice together, if no single one is a cause; None if no few do.
        over: Faults that can no longer be prevented, and promises that can no longer be kept, at the first instant.
        times: The instants of `CandidateRow.wrongness` [s].
    """

    log: Path
    digest: str
    specification: str
    violated: float
    text: str
    kinds: Sequence[str]
    plan: ExplanationPlan
    branches: int
    confidence: float
    everything: Sequence[FutureComparison]
    rows: Sequence[CandidateRow]
    together: CandidateSet | None
    over: Sequence[Candidate]
    times: Sequence[float]

    @property
    def causes(self) -> Sequence[CandidateRow]:
        """The single candidates that are reported as causes, the strongest first."""
        return [each for each in self.rows if each.is_cause]

    @property
    def uncompared(self) -> Sequence[CandidateRow]:
        """The candidates that remained after screening without being compared, since only a few are."""
        return [each for each in self.rows if each.is_uncompared]

    @property
    def where(self) -> str:
        """Where the cause was sought, in a few words."""
        places = {"faults": "declared faults", "promises": "promises", "components": "components with alternatives"}
        return " or ".join(dict.fromkeys(places.get(each, "awareness") for each in self.kinds))

    @property
    def made_right(self) -> str:
        """The result of the corrections in a few words, such as "true or absent"."""
        words = {
            "beliefs": "true",
            "messages": "in time",
            "faults": "absent",
            "promises": "kept",
            "components": "replaced",
        }
        return " or ".join(words[each] for each in self.kinds)

    @property
    def is_among_candidates(self) -> bool:
        """Whether the correction of all candidates at once saves more futures than all placebos."""
        return any(each.is_established for each in self.everything)

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        instants = self.plan.instants
        return {
            "log": str(self.log),
            "digest": self.digest,
            "specification": self.specification,
            "violated": self.violated,
            "text": self.text,
            "kinds": list(self.kinds),
            "plan": self.plan.to_json(),
            "branches": self.branches,
            "confidence": self.confidence,
            "where": self.where,
            "among_candidates": self.is_among_candidates,
            "everything": [each.to_json() for each in self.everything],
            "causes": [each.candidate.to_json() for each in self.causes],
            "uncompared": [each.candidate.to_json() for each in self.uncompared],
            "together": None if self.together is None else self.together.to_json(),
            "over": [each.to_json() for each in self.over],
            "candidates": [each.to_json(instants) for each in self.rows],
        }
