"""A claim about the runs of a sweep, such as ``P(safe) > 0.99 with confidence 0.99, fixed``, and its tests.

Each term of a claim is P(failure) < epsilon; the hypothesis to be rejected is that P(failure) is epsilon or more. The
tests are performed once at a planned number of runs, or sequentially after each run.

Reasons: docs/decisions/0046-claims.md
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

from symaware_cli.studies.claim_term import ClaimTerm, number
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

#: The terms, then the confidence and the rule.
_FORM = re.compile(
    r"(?P<terms>.*?>\s*[0-9.eE+-]+)"
    r"(?:\s+with\s+confidence\s+(?P<confidence>[0-9.eE+-]+))?\s*(?:,\s*(?P<rule>\w+)\s*)?",
    re.DOTALL,
)
EXAMPLE = "P(safe) > 0.99 with confidence 0.99, sequential"

#: More terms are taken for a mistake.
_MOST_TERMS = 20


@dataclass(frozen=True, slots=True)
class Claim:
    """The claim that probabilities exceed bounds, all of them jointly.

    Attributes:
        terms: The probabilities; at least one.
        confidence: The least probability that no false term is certified, jointly over all combinations of a sweep.
        rule: When the runs are tested.
    """

    terms: tuple[ClaimTerm, ...]
    confidence: float = 0.99
    rule: ClaimRule = "fixed"

    @classmethod
    def parse(cls, text: str) -> Claim:
        """Parse a claim; several terms are separated by semicolons.

        Raises:
            ValueError: The text is not a valid claim; the message gives the reason.
        """
        match = _FORM.fullmatch(text)
        terms = [] if match is None else [ClaimTerm.parse(each) for each in match["terms"].split(";")]
        if match is None or None in terms:
            raise ValueError(f"a claim is written like `{EXAMPLE}`")
        if len(terms) > _MOST_TERMS:
            raise ValueError(f"a claim has at most {_MOST_TERMS} terms, not {len(terms)}")
        confidence = number(match["confidence"] or "0.99", "the confidence", 0.0, 1.0 - 1e-9)
        rule = match["rule"] or "fixed"
        known = next((each for each in get_args(ClaimRule) if each == rule), None)
        if known is None:
            raise ValueError(f"a claim is `fixed` or `sequential`, not `{rule}`")
        return cls(tuple(each for each in terms if each is not None), confidence, known)

    def __str__(self) -> str:
        return f"{'; '.join(map(str, self.terms))} with confidence {self.confidence:.12g}, {self.rule}"

    @property
    def names(self) -> tuple[str, ...]:
        """All specifications that it refers to, each once."""
        return tuple(dict.fromkeys(name for term in self.terms for name in term.names))

    @property
    def is_plain(self) -> bool:
        """Whether it is about the probability of a single specification."""
        return len(self.terms) == 1 and self.terms[0].is_plain

    def alpha(self, cells: int) -> float:
        """Return the admissible probability of a false certificate for each term of each combination (Bonferroni)."""
        return float(f"{1.0 - self.confidence:.12g}") / (cells * len(self.terms))

    def evidence(self, term: ClaimTerm, failures: int, runs: int) -> float:
        """Return the evidence for a term, which is certified once it reaches 1 / alpha.

        Given the number of runs that meet a condition, the number of failures among them is binomial, so that both
        tests hold for them as they do for all runs.
        """
        return self._evidence(failures, runs, term.epsilon)

    def runs_needed(self, term: ClaimTerm, failures: int, cells: int) -> int:
        """Return the least number of runs that suffices for a term with a given number of failures.

        Of a term with a condition, these are runs that meet it.
        """
        return runs_needed(self._evidence, failures, term.epsilon, self.alpha(cells))

    def least_runs(self, cells: int) -> int:
        """Return the least number of runs of a combination that can establish the claim."""
        return max(self.runs_needed(term, 0, cells) for term in self.terms)

    @property
    def _evidence(self) -> Callable[[int, int, float], float]:
        return sequential_evidence if self.rule == "sequential" else fixed_evidence


class ClaimProgress:
    """The progress of a claim for one combination; its runs may arrive in any order.

    Attributes:
        runs: The number of known runs before the first gap, up to the run that established the claim.
        counted: The number of these that each term counts.
        failures: The number of these that count against it.
        stopped_at: The final number of runs; None while a sequential claim is not established.
    """

    def __init__(self, claim: Claim, cells: int) -> None:
        self._claim = claim
        self._enough = 1.0 / claim.alpha(cells)
        self.runs = 0
        self.counted = [0] * len(claim.terms)
        self.failures = [0] * len(claim.terms)
        self.stopped_at: int | None = None
        self._waiting: dict[int, list[str | None]] = {}

    @property
    def evidence(self) -> list[float]:
        """The evidence for each term after the known runs."""
        counts = zip(self._claim.terms, self.failures, self.counted, strict=True)
        return [self._claim.evidence(*each) for each in counts]

    @property
    def is_established(self) -> bool:
        """Whether the evidence for all terms suffices."""
        return all(each >= self._enough for each in self.evidence)

    def add(self, replicate: int, row: Row) -> None:
        """Add a run.

        Args:
            replicate: Its number within the combination.
            row: Its result.
        """
        self._waiting[replicate] = [term.outcome(row) for term in self._claim.terms]
        while self.stopped_at is None and self.runs in self._waiting:
            for place, outcome in enumerate(self._waiting.pop(self.runs)):
                self.counted[place] += outcome is not None
                self.failures[place] += outcome not in (None, "satisfied")
            self.runs += 1
            # Each term has an e-process of its own, which may be looked at after each run, so all may be at once.
            if self._claim.rule == "sequential" and self.is_established:
                self.stopped_at = self.runs

    def keeps(self, replicate: int) -> bool:
        """Return whether a run is part of the result, according to the runs so far."""
        return self.stopped_at is None or replicate < self.stopped_at
