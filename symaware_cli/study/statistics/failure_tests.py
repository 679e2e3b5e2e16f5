"""Tests of the claim that failures are rarer than a bound: at a planned number of runs, and at all times.

The claim is P(failure) < epsilon; the hypothesis to be rejected is that P(failure) is epsilon or more.
"""

from __future__ import annotations

import math
from collections.abc import Callable

#: The parameter of both sides of the beta distribution that is mixed over: few failures are expected.
PRIOR = 0.5


def fixed_evidence(failures: int, runs: int, epsilon: float) -> float:
    """Return the evidence for the claim at a number of runs that was planned: the inverse of the test's p-value.

    The p-value is P(X <= k) where X is binomial with n and epsilon. It is at most alpha exactly where the one-sided
    upper limit of Clopper and Pearson for P(failure), with confidence 1 - alpha, is at most epsilon.

    Args:
        failures: How many runs failed, k.
        runs: How many there were, n.
        epsilon: The bound of the claim.

    Source: C. J. Clopper and E. S. Pearson, "The Use of Confidence or Fiducial Limits Illustrated in the Case of the
    Binomial", Biometrika 26, 1934.
    """
    from scipy.special import bdtr

    p_value = float(bdtr(failures, runs, epsilon)) if runs else 1.0
    return 1.0 / p_value if p_value > 0.0 else math.inf


def sequential_evidence(failures: int, runs: int, epsilon: float) -> float:
    """Return the evidence for the claim that may be looked at after each run: an e-process.

    It is the likelihood ratio of a mixture of probabilities below epsilon to epsilon itself,

        E_n = B(a + k, a + n - k; epsilon) / (B(a, a; epsilon) epsilon^k (1 - epsilon)^(n - k)),  a = 1/2,

    with B the incomplete beta function. Wherever P(failure) is epsilon or more, it is a supermartingale of mean at most
    1, and by Ville's inequality it ever reaches 1 / alpha with a probability of at most alpha.

    Args:
        failures: How many of the first runs failed, k.
        runs: How many of the first runs there are, n.
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
    """Return the least number of runs of which so many failures leave the claim established.

    Args:
        evidence: `fixed_evidence` or `sequential_evidence`.
        failures: How many runs fail.
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
