"""The difference of two shares in paired trials, exactly, and Holm's correction over several of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PairedShares:
    """Trials in which two treatments were applied to the same future each.

    Attributes:
        trials: The number of futures.
        first: The number of futures that only the first treatment saves.
        second: The number of futures that only the second treatment saves.
        both: The number of futures that both save.
    """

    trials: int
    first: int
    second: int
    both: int = 0

    @classmethod
    def of(cls, first: Sequence[bool], second: Sequence[bool]) -> PairedShares:
        """Count the outcomes of two treatments in the same futures."""
        pairs = list(zip(first, second, strict=True))
        counts = [pairs.count(each) for each in ((True, False), (False, True), (True, True))]
        return cls(len(pairs), *counts)

    @property
    def difference(self) -> float:
        """The share of the first treatment minus that of the second."""
        return (self.first - self.second) / self.trials if self.trials else 0.0

    @property
    def probability(self) -> float:
        """The least error probability at which `interval` excludes differences of 0 and below.

        This is four times the one-sided probability of McNemar's exact test, because `interval` spends its error
        probability on both ends of two intervals.
        """
        from scipy.special import bdtr

        discordant = self.first + self.second
        return min(1.0, 4.0 * float(bdtr(float(self.second), discordant, 0.5))) if discordant else 1.0

    def interval(self, alpha: float) -> tuple[float, float]:
        """Return an exact interval of the difference of the shares.

        The difference is d (2 q - 1), where d is the probability that a future is saved by one treatment only, and q
        the probability that this is the first. Both have Clopper-Pearson intervals, with the error probability alpha /
        2 each; given the number of discordant futures, that of the first is binomial, as in McNemar's exact test.

        Source: Q. McNemar, "Note on the Sampling Error of the Difference Between Correlated Proportions or
        Percentages", Psychometrika 12, 1947; C. J. Clopper and E. S. Pearson, Biometrika 26, 1934.

        Args:
            alpha: The error probability.
        """
        discordant = self.first + self.second
        low, high = _clopper_pearson(discordant, self.trials, alpha / 4)
        if not discordant:
            return -high, high
        ends = [2.0 * each - 1.0 for each in _clopper_pearson(self.first, discordant, alpha / 4)]
        return min(ends[0] * low, ends[0] * high), max(ends[1] * low, ends[1] * high)


def _clopper_pearson(successes: int, count: int, tail: float) -> tuple[float, float]:
    from scipy.special import betaincinv

    failures = count - successes
    lower = float(betaincinv(successes, failures + 1, tail)) if successes else 0.0
    upper = float(betaincinv(successes + 1, failures, 1.0 - tail)) if failures else 1.0
    return lower, upper


def holm(probabilities: Sequence[float], count: int, alpha: float) -> list[float]:
    """Return the level at which each of several hypotheses is tested by Holm's procedure.

    The k-th smallest probability is compared with alpha / (count - k), k from 0 on. From the first that exceeds its
    level on, all are tested at that level, so that none is rejected: an interval at the returned level excludes 0 if
    and only if the procedure rejects.

    Source: S. Holm, "A Simple Sequentially Rejective Multiple Test Procedure", Scandinavian Journal of Statistics 6,
    1979.

    Args:
        probabilities: The error probability of each test.
        count: The number of all hypotheses; those without a test count as not rejected.
        alpha: The probability of any wrong rejection.
    """
    levels, level = [math.nan] * len(probabilities), alpha / max(count, 1)
    is_over = False
    for rank, place in enumerate(sorted(range(len(probabilities)), key=lambda each: (probabilities[each], each))):
        if not is_over:
            level = alpha / (count - rank)
            is_over = probabilities[place] > level
        levels[place] = level
    return levels
