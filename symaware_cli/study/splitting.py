"""Splitting: the probability of a rare event as a product of probabilities that are not small."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from symaware_cli.study.statistics.interval_estimate import IntervalEstimate, error_probability
from symaware_cli.study.statistics.student import variance
from symaware_cli.world.chance import generator, key_of

State = TypeVar("State")


class Process(Protocol[State]):
    """A random process that can be continued from its states."""

    def begin(self) -> State:
        """Return the state at the beginning."""

    def reach(self, state: State, stage: int, seed: int) -> State | None:
        """Continue from a state until the end of a stage.

        Args:
            state: Where to continue; it stays as it is.
            stage: The stage, from 0 on; the last one ends with the event itself.
            seed: What is drawn on the way.

        Returns:
            The state there; None if the process ended before.
        """


@dataclass(frozen=True, slots=True)
class StageCount:
    """What became of one stage of one repeat.

    Attributes:
        trials: How often it was tried.
        reached: How often its end was reached.
    """

    trials: int
    reached: int


def split(process: Process[State], stages: int, trials: int, seed: int) -> list[StageCount]:
    """Estimate the probability of an event in stages: those that come to the end of one are split for the next.

    Every stage has the same number of trials. Each trial of a stage continues from one of the states in which the stage
    before ended: each of these states in turn, in an order that is drawn once, so that all are used equally often, or
    once more than the others. The product of the shares that reach the ends is an unbiased estimate of the probability
    of the event, wherever the stages end.

    Source: P. L'Ecuyer, F. Le Gland, P. Lezaud, B. Tuffin, "Splitting Techniques", in G. Rubino, B. Tuffin (editors),
    Rare Event Simulation using Monte Carlo Methods, Wiley 2009: fixed effort with fixed assignment.

    Args:
        process: The process.
        stages: The number of stages, the last of which ends with the event.
        trials: The number of trials of each stage.
        seed: What trials draw from, with their stage and number.

    Returns:
        What became of each stage; fewer than `stages` if nothing reached the end of one.
    """
    states = [process.begin()]
    counts: list[StageCount] = []
    for stage in range(stages):
        order = generator(seed, f"splitting {stage}").permutation(len(states)).tolist()
        reached = []
        for trial in range(trials):
            start = states[order[trial % len(order)]]
            end = process.reach(start, stage, key_of(seed, "splitting", stage, trial) >> 1)
            if end is not None:
                reached.append(end)
        counts.append(StageCount(trials, len(reached)))
        states = reached
        if not states:
            break
    return counts


def product(counts: Sequence[StageCount], stages: int) -> float:
    """The estimate of one repeat: the product of the shares, 0 if it did not come to the last stage."""
    return math.prod(each.reached / each.trials for each in counts) if len(counts) == stages else 0.0


def mean_of_repeats(estimates: ArrayLike, confidence: float = 0.95) -> IntervalEstimate:
    """Estimate the probability from independent repeats: m exp(± t(1 - alpha / 2; n - 1) s / (m sqrt(n))).

    It is Student's interval of the mean for its logarithm, by the delta method. Estimates by splitting are skewed,
    and their logarithm less so; the interval is approximate (docs/evidence.md has what it covers).

    Args:
        estimates: The estimate of each repeat; shape (n,).
        confidence: 1 - alpha.

    Returns:
        The mean with its interval; from 0 to 1 if there are fewer than two repeats or all estimates are 0.
    """
    from scipy.special import stdtrit

    method, alpha = "Student's t of the logarithm", error_probability(confidence)
    sample = np.asarray(estimates, float)
    count = len(sample)
    mean = math.fsum(sample) / count if count else math.nan
    if count < 2 or not mean > 0.0:
        return IntervalEstimate(mean, 0.0, 1.0, count, confidence, method)
    relative = math.sqrt(variance(sample) / count) / mean
    factor = math.exp(min(float(stdtrit(count - 1, 1.0 - alpha / 2)) * relative, 700.0))
    return IntervalEstimate(mean, mean / factor, min(mean * factor, 1.0), count, confidence, method)
