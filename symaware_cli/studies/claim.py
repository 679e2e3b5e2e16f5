"""A claim about the runs of a sweep, such as ``P(safe) > 0.99 with confidence 0.99, fixed``, and its tests.

The claim is P(failure) < epsilon; the hypothesis to be rejected is that P(failure) is epsilon or more. The tests are
performed once at a planned number of runs, or sequentially after each run.

Reasons: docs/decisions/0046-claims.md
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

from symaware_cli.studies.row import Row

#: Both parameters of the beta distribution that is mixed over: few failures are expected.
PRIOR = 0.5


def fixed_evidence(failures: int, runs: int, epsilon: float) -> float:
    """Return the evidence for the claim at a planned number of runs: the inverse of the test's p-value.

    The p-value is P(X <= k) where X is binomial with n and epsilon. It is at most alpha exactly where the one-sided
    upper limit of Clopper and Pearson for P(failure), with confidence 1 - alpha, is at most epsilon.

    Args:
        failures: The number of failed runs, k.
        runs: The number of runs, n.
        epsilon: The bound of the claim.

    Source: C. J. Clopper and E. S. Pearson, "The Use of Confidence or Fiducial Limits Illustrated in the Case of the
    Binomial", Biometrika 26, 1934.
    """
    from scipy.special import bdtr

    p_value = float(bdtr(failures, runs, epsilon)) if runs else 1.0
    return 1.0 / p_value if p_value > 0.0 else math.inf


def sequential_evidence(failures: int, runs: int, epsilon: float) -> float:
    """Return the evidence for the claim as an e-process, which may be checked after each run.

    It is the likelihood ratio of a mixture of probabilities below epsilon to epsilon itself,

        E_n = B(a + k, a + n - k; epsilon) / (B(a, a; epsilon) epsilon^k (1 - epsilon)^(n - k)),  a = 1/2,

    with B the incomplete beta function. Wherever P(failure) is epsilon or more, it is a supermartingale of mean at most
    1, and by Ville's inequality it ever reaches 1 / alpha with a probability of at most alpha.

    Args:
        failures: The number of failures among the first n runs, k.
        runs: The number of runs so far, n.
        epsilon: The bound of the claim.

    Sources: H. Robbins, "Statistical Methods Related to the Law of the Iterated Logarithm", The Annals of Mathematical
    Statistics 41, 1970; A. Ramdas, P. Gruenwald, V. Vovk, G. Shafer, "Game-Theoretic Statistics and Safe Anytime-Valid
    Inference", Statistical Science 38, 2023.
    """
    from scipy.special import betainc, betaln

    a, b = PRIOR + failures, PRIOR + runs - failures
    share = float(betainc(a, b, epsilon))
    if share == 0.0:  # almost all of the likelihood is above epsilon
        return 0.0
    mixture = math.log(share) + float(betaln(a, b)) - math.log(betainc(PRIOR, PRIOR, epsilon)) - betaln(PRIOR, PRIOR)
    ratio = float(mixture) - failures * math.log(epsilon) - (runs - failures) * math.log1p(-epsilon)
    return math.exp(min(ratio, 700.0))


def runs_needed(evidence: Callable[[int, int, float], float], failures: int, epsilon: float, alpha: float) -> int:
    """Return the least number of runs at which a given number of failures still establishes the claim.

    Args:
        evidence: `fixed_evidence` or `sequential_evidence`.
        failures: The number of failed runs.
        epsilon: The bound of the claim.
        alpha: The probability of being wrong.
    """
    enough = failures + 1
    while evidence(failures, enough, epsilon) < 1.0 / alpha:
        enough *= 2
    low, high = max(failures, enough // 2), enough
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if evidence(failures, middle, epsilon) >= 1.0 / alpha else (middle, high)
    return high


#: ``fixed``: all planned runs are executed, then tested once; ``sequential``: they may be tested after each run.
ClaimRule = Literal["fixed", "sequential"]

_FORM = re.compile(
    r"\s*P\(\s*(?P<name>[^\s()][^()]*?)\s*\)\s*>\s*(?P<probability>[0-9.eE+-]+)"
    r"(?:\s+with\s+confidence\s+(?P<confidence>[0-9.eE+-]+))?\s*(?:,\s*(?P<rule>\w+)\s*)?"
)
EXAMPLE = "P(safe) > 0.99 with confidence 0.99, sequential"

#: Claims beyond these limits need more runs than a sweep may have.
_RANGE = (0.0, 1.0 - 1e-6)


@dataclass(frozen=True, slots=True)
class Claim:
    """The claim that the probability of satisfying a specification exceeds a bound.

    Attributes:
        specification: The name of the specification.
        probability: The lower bound that the probability of satisfying it is claimed to exceed.
        confidence: The least probability that no false claim is certified, jointly over all combinations of a sweep.
        rule: When the runs are tested.
    """

    specification: str
    probability: float
    confidence: float = 0.99
    rule: ClaimRule = "fixed"

    @classmethod
    def parse(cls, text: str) -> Claim:
        """Parse a claim.

        Raises:
            ValueError: The text is not a valid claim; the message gives the reason.
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
        """The upper bound claimed for the probability of failure, to 12 digits, so that 1 - 0.99 is 0.01."""
        return float(f"{1.0 - self.probability:.12g}")

    def alpha(self, cells: int) -> float:
        """Return the admissible probability of a false certificate for each combination (Bonferroni correction)."""
        return float(f"{1.0 - self.confidence:.12g}") / cells

    def evidence(self, failures: int, runs: int) -> float:
        """Return the evidence; a combination is certified once it reaches 1 / alpha."""
        return self._evidence(failures, runs, self.epsilon)

    def runs_needed(self, failures: int, cells: int) -> int:
        """Return the least number of runs of a combination that suffices with a given number of failures."""
        return runs_needed(self._evidence, failures, self.epsilon, self.alpha(cells))

    def counts_against(self, row: Row) -> bool:
        """Return whether a run counts against the claim; failed, lost and undecided runs do."""
        return row.state != "done" or row.verdicts.get(self.specification) != "satisfied"

    @property
    def _evidence(self) -> Callable[[int, int, float], float]:
        return sequential_evidence if self.rule == "sequential" else fixed_evidence


class ClaimProgress:
    """The progress of a claim for one combination; its runs may arrive in any order.

    Attributes:
        runs: The number of known runs before the first gap, up to the run that established the claim.
        failures: The number of these that count against it.
        stopped_at: The final number of runs; None while a sequential claim is not established.
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
        """The evidence after the known runs."""
        return self._claim.evidence(self.failures, self.runs)

    @property
    def is_established(self) -> bool:
        """Whether the evidence suffices."""
        return self.evidence >= self._enough

    def add(self, replicate: int, row: Row) -> None:
        """Add a run.

        Args:
            replicate: Its number within the combination.
            row: Its result.
        """
        self._waiting[replicate] = self._claim.counts_against(row)
        while self.stopped_at is None and self.runs in self._waiting:
            self.failures += self._waiting.pop(self.runs)
            self.runs += 1
            if self._claim.rule == "sequential" and self.is_established:
                self.stopped_at = self.runs

    def keeps(self, replicate: int) -> bool:
        """Return whether a run is part of the result, according to the runs so far."""
        return self.stopped_at is None or replicate < self.stopped_at


def _number(text: str, what: str, low: float, high: float) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{what} is a number, not `{text}`") from None
    if not low < value <= high:
        raise ValueError(f"{what} is more than {low:g} and at most {high:.9g}, not {value:g}")
    return value
