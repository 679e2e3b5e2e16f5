"""Claims are established by the number of runs that theory gives, and false claims as rarely as it states."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import bdtr
from scipy.stats import beta

from symaware_cli.studies.claim import fixed_evidence, runs_needed, sequential_evidence

#: The claim of all tests: failures are rarer than 1 in 100, with confidence 0.99.
EPSILON, ALPHA = 0.01, 0.01


@pytest.mark.parametrize(
    ("evidence", "runs"), [(fixed_evidence, (459, 662, 838)), (sequential_evidence, (556, 862, 1097))]
)
def test_a_claim_needs_the_number_of_runs_given_by_theory(
    evidence: Callable[[int, int, float], float], runs: tuple[int, ...]
) -> None:
    assert tuple(runs_needed(evidence, failures, EPSILON, ALPHA) for failures in range(3)) == runs


def test_the_fixed_test_agrees_with_the_one_sided_clopper_pearson_limit() -> None:
    for failures, runs in ((0, 458), (0, 459), (1, 661), (1, 662), (5, 1500), (20, 3000)):
        upper = beta.ppf(1.0 - ALPHA, failures + 1, runs - failures)
        assert (fixed_evidence(failures, runs, EPSILON) >= 1.0 / ALPHA) == (upper <= EPSILON)


def test_sequential_evidence_has_mean_one_on_the_boundary_of_the_claim() -> None:
    """The mean is the sum over all sequences of 200 runs, weighted with their probability."""
    mean = sum(
        sequential_evidence(k, 200, EPSILON) * float(bdtr(k, 200, EPSILON) - (bdtr(k - 1, 200, EPSILON) if k else 0.0))
        for k in range(201)
    )
    assert mean == pytest.approx(1.0, rel=1e-9)


def test_evidence_far_from_the_claim_is_finite() -> None:
    assert sequential_evidence(100_000, 200_000, EPSILON) == 0.0
    assert 1e300 < sequential_evidence(0, 10_000_000, EPSILON) < np.inf
    assert fixed_evidence(0, 0, EPSILON) == 1.0


Evidence = Callable[[int, int, float], float]


def most_failures(evidence: Evidence, epsilon: float, alpha: float, runs: int) -> NDArray[np.int64]:
    """Return the maximum number of failures with which a claim is established after 1, 2, ... runs; -1 if none is."""
    most = np.full(runs, -1)
    for count in range(runs):
        least = runs_needed(evidence, count, epsilon, alpha)
        if least > runs:
            break
        most[least - 1 :] = count
    return most


def false_certificates(most: NDArray[np.int64], epsilon: float) -> float:
    """Return the exact probability of certifying a sweep on the boundary of its claim, tested after each run."""
    # The probability of k failures so far in a sweep that is not yet certified.
    chances, certified = np.array([1.0]), 0.0
    for bound in most:
        chances = np.append(chances, 0.0) * (1 - epsilon) + np.insert(chances, 0, 0.0) * epsilon
        certified += float(chances[: bound + 1].sum())
        chances[: bound + 1] = 0.0
    return certified


@pytest.mark.parametrize(("epsilon", "alpha"), [(0.01, 0.01), (0.1, 0.05)])
def test_repeated_looks_are_valid_for_sequential_evidence_but_not_for_a_fixed_test(
    epsilon: float, alpha: float
) -> None:
    runs = 2000
    watched, peeked = (most_failures(each, epsilon, alpha, runs) for each in (sequential_evidence, fixed_evidence))
    assert 0.3 * alpha < false_certificates(watched, epsilon) <= alpha
    assert false_certificates(peeked, epsilon) > 3 * alpha
    random = np.random.default_rng(22)
    failures = np.cumsum(random.random((2000, runs)) < epsilon, axis=1)
    assert float((failures <= watched).any(axis=1).mean()) <= alpha
    assert float((failures <= peeked).any(axis=1).mean()) > 3 * alpha
