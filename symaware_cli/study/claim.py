"""A claim about the runs of a sweep, such as ``P(safe) > 0.99 with confidence 0.99, fixed``, and what decides it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

from symaware_cli.study.row import Row
from symaware_cli.study.statistics.failure_tests import fixed_evidence, runs_needed, sequential_evidence

#: ``fixed``: all planned runs are made, and then looked at once; ``sequential``: they may be looked at after each run.
ClaimRule = Literal["fixed", "sequential"]

_FORM = re.compile(
    r"\s*P\(\s*(?P<name>[^\s()][^()]*?)\s*\)\s*>\s*(?P<probability>[0-9.eE+-]+)"
    r"(?:\s+with\s+confidence\s+(?P<confidence>[0-9.eE+-]+))?\s*(?:,\s*(?P<rule>\w+)\s*)?"
)
EXAMPLE = "P(safe) > 0.99 with confidence 0.99, sequential"

#: Claims beyond these need more runs than a sweep may have.
_RANGE = (0.0, 1.0 - 1e-6)


@dataclass(frozen=True, slots=True)
class Claim:
    """That a specification is satisfied with more than some probability.

    Attributes:
        specification: Its name.
        probability: What the probability of satisfying it is claimed to exceed.
        confidence: The probability, at least, that no false claim is certified: of all combinations of a sweep jointly.
        rule: When the runs are looked at.
    """

    specification: str
    probability: float
    confidence: float = 0.99
    rule: ClaimRule = "fixed"

    @classmethod
    def parse(cls, text: str) -> Claim:
        """Read a claim.

        Raises:
            ValueError: It is not valid; says why.
        """
        match = _FORM.fullmatch(text)
        if match is None:
            raise ValueError(f"a claim is written like `{EXAMPLE}`")
        probability = _number(match["probability"], "the probability", *_RANGE)
        confidence = _number(match["confidence"] or "0.99", "the confidence", 0.0, 1.0 - 1e-9)
        rule = match["rule"] or "fixed"
        known = next((each for each in get_args(ClaimRule) if each == rule), None)
        if known is None:
            raise ValueError(f"a claim is `fixed` or `sequential`, not `{rule}`")
        return cls(match["name"], probability, confidence, known)

    def __str__(self) -> str:
        return f"P({self.specification}) > {self.probability:.12g} with confidence {self.confidence:.12g}, {self.rule}"

    @property
    def epsilon(self) -> float:
        """What the probability of failing is claimed to be less than, to 12 digits: 1 - 0.99 is 0.01."""
        return float(f"{1.0 - self.probability:.12g}")

    def alpha(self, cells: int) -> float:
        """Return the probability of a false certificate for one of so many combinations: Bonferroni's share."""
        return float(f"{1.0 - self.confidence:.12g}") / cells

    def evidence(self, failures: int, runs: int) -> float:
        """Return the evidence; a combination is certified where it reaches 1 / alpha."""
        return self._evidence(failures, runs, self.epsilon)

    def runs_needed(self, failures: int, cells: int) -> int:
        """Return the least number of runs of a combination that suffices with so many failures."""
        return runs_needed(self._evidence, failures, self.epsilon, self.alpha(cells))

    def counts_against(self, row: Row) -> bool:
        """Whether a run counts against the claim: also one that failed, was lost or is undecided."""
        return row.state != "done" or row.verdicts.get(self.specification) != "satisfied"

    @property
    def _evidence(self) -> Callable[[int, int, float], float]:
        return sequential_evidence if self.rule == "sequential" else fixed_evidence


class ClaimProgress:
    """The runs of one combination under a claim; they come in any order.

    Attributes:
        runs: How many runs are known without a gap, up to where the claim was established.
        failures: How many of them count against it.
        stopped_at: How many runs there are in the end; None as long as a sequential claim is not established.
    """

    def __init__(self, claim: Claim, cells: int) -> None:
        self._claim = claim
        self._enough = 1.0 / claim.alpha(cells)
        self.runs = 0
        self.failures = 0
        self.stopped_at: int | None = None
        self._waiting: dict[int, bool] = {}

    @property
    def evidence(self) -> float:
        """The evidence after these runs."""
        return self._claim.evidence(self.failures, self.runs)

    @property
    def is_established(self) -> bool:
        """Whether the evidence is enough."""
        return self.evidence >= self._enough

    def add(self, replicate: int, row: Row) -> None:
        """Take a run.

        Args:
            replicate: Its number among those of the combination.
            row: What became of it.
        """
        self._waiting[replicate] = self._claim.counts_against(row)
        while self.stopped_at is None and self.runs in self._waiting:
            self.failures += self._waiting.pop(self.runs)
            self.runs += 1
            if self._claim.rule == "sequential" and self.is_established:
                self.stopped_at = self.runs

    def keeps(self, replicate: int) -> bool:
        """Whether a run is part of the result, as far as is known."""
        return self.stopped_at is None or replicate < self.stopped_at


def _number(text: str, what: str, low: float, high: float) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{what} is a number, not `{text}`") from None
    if not low < value <= high:
        raise ValueError(f"{what} is more than {low:g} and at most {high:.9g}, not {value:g}")
    return value
