"""The interval of a share at a planned number of runs."""

from __future__ import annotations

import math

from symaware_cli.study.statistics.interval_estimate import IntervalEstimate, error_probability


def clopper_pearson(successes: int, count: int, confidence: float = 0.95) -> IntervalEstimate:
    """Estimate a probability from the number of successes among runs whose number was fixed beforehand.

    The interval is exact in that it covers the probability at least as often as it says, for every number of runs:

        lower = BetaInv(alpha / 2; s, n - s + 1),  upper = BetaInv(1 - alpha / 2; s + 1, n - s).

    Args:
        successes: How many runs succeeded, s.
        count: How many runs there were, n.
        confidence: 1 - alpha.

    Raises:
        ValueError: There are more successes than runs, or fewer than none.

    Source: C. J. Clopper and E. S. Pearson, "The Use of Confidence or Fiducial Limits Illustrated in the Case of the
    Binomial", Biometrika 26, 1934.
    """
    from scipy.special import betaincinv

    if not 0 <= successes <= count:
        raise ValueError(f"there are {successes} successes among {count} runs")
    tail = error_probability(confidence) / 2
    failures = count - successes
    lower = float(betaincinv(successes, failures + 1, tail)) if successes else 0.0
    upper = float(betaincinv(successes + 1, failures, 1 - tail)) if failures else 1.0
    value = successes / count if count else math.nan
    return IntervalEstimate(value, lower, upper, count, confidence, "Clopper-Pearson")
