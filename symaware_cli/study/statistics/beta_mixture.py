"""The confidence sequence of a share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symaware_cli.study.statistics.confidence_sequence import ConfidenceSequence
from symaware_cli.study.statistics.interval_estimate import Array

#: Both parameters of the beta distribution that is mixed over: the least regret for every probability (Krichevsky and
#: Trofimov 1981), and narrow intervals for probabilities near 0 and 1.
PRIOR = 0.5

#: Newton's method stops where a step is smaller than this, in log-odds.
_STEP = 1e-12
_MOST_STEPS = 100


class BetaMixture(ConfidenceSequence):
    """The confidence sequence of a probability, from values that are 0 or 1.

    With s ones among the first n values, and B the beta function,

        M_n(p) = B(a + s, a + n - s) / (B(a, a) p^s (1 - p)^(n - s)),  a = 1/2,

    is a martingale with mean 1 where p is the probability: the likelihood ratio of a mixture over all probabilities to
    p. By Ville's inequality it ever reaches 1 / alpha with a probability of at most alpha, so the set of all p for
    which M_n(p) < 1 / alpha covers the probability at all n together; it is an interval.

    Sources: H. Robbins, "Statistical Methods Related to the Law of the Iterated Logarithm", The Annals of Mathematical
    Statistics 41, 1970; S. R. Howard, A. Ramdas, J. McAuliffe, J. Sekhon, "Time-uniform, Nonparametric, Nonasymptotic
    Confidence Sequences", The Annals of Statistics 49, 2021 (beta-binomial mixtures).
    """

    method = "beta mixture"

    def __init__(self, confidence: float = 0.95, streams: tuple[int, ...] = ()) -> None:
        """Begin without values; see `ConfidenceSequence`."""
        super().__init__(0.0, 1.0, confidence, streams)

    def _bounds(self, values: Array, sums: Array) -> tuple[Array, Array]:
        if ((values != 0.0) & (values != 1.0)).any():
            raise ValueError("the values of a share are 0 and 1")
        return bounds(sums[1:], np.broadcast_to(self._counts(values), values.shape), self.alpha)


def bounds(successes: Array, counts: Array, alpha: float) -> tuple[Array, Array]:
    """Return the ends of the interval for numbers of successes s among n values, both of any one shape."""
    from scipy.special import betaln

    failures = counts - successes
    threshold = betaln(PRIOR + successes, PRIOR + failures) - betaln(PRIOR, PRIOR) + np.log(alpha)
    # With one and zero exchanged, the upper end is a lower end.
    return _lower(successes, failures, threshold), 1.0 - _lower(failures, successes, threshold)


def _lower(successes: Array, failures: Array, threshold: Array) -> Array:
    """The least probability of which s log p + (n - s) log(1 - p) reaches a threshold.

    In log-odds the function is concave, and s times the log-odds bounds it from above. So Newton's method, begun where
    that bound reaches the threshold, comes to the root from below, and wherever it stops the interval is no narrower
    than the exact one.
    """
    from scipy.special import expit, log_expit

    shape, s, f = successes.shape, successes.ravel(), failures.ravel()
    goal = threshold.ravel()
    found = np.zeros(s.shape)
    rows: NDArray[np.intp] = np.flatnonzero(s > 0)
    odds = goal[rows] / s[rows]
    for _ in range(_MOST_STEPS):
        p = expit(odds)
        slope = s[rows] * (1.0 - p) - f[rows] * p
        value = s[rows] * log_expit(odds) + f[rows] * log_expit(-odds)
        step = (goal[rows] - value) / slope
        # Each element stops by itself, so its bits do not depend on the others.
        moves = step > _STEP
        found[rows[~moves]] = p[~moves]
        rows, odds = rows[moves], (odds + step)[moves]
        if not len(rows):
            break
    found[rows] = expit(odds)
    return found.reshape(shape)
