"""Bounds of the probability that a random walk ever leaves half spaces, against many walks."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm

from symaware_cli.planning.risk.first_passage import FirstPassage
from symaware_cli.planning.risk.state_conditions import HalfSpaces, Tail

Array = NDArray[np.float64]

STEPS, WALKS = 40, 20_000


def half_space(slope: Array, offset: float) -> HalfSpaces:
    return HalfSpaces(slope[None, None], np.array([[offset]]))


def bound(means: Array, slopes: Array, offset: float, start: float, noise: float, tail: Tail) -> float:
    """The bound for a walk in the plane whose half space has a slope (T, 2) at each instant."""
    passage = FirstPassage(tail)
    for number, (mean, slope) in enumerate(zip(means, slopes, strict=True), 1):
        covariance = (start**2 + number * noise**2) * np.eye(2)[None]
        passage.add(half_space(slope, offset), mean[None], covariance, slope[None, None], np.ones(1))
    return float(passage.risk[0])


def share(means: Array, slopes: Array, offset: float, start: float, noise: float) -> float:
    """How many of many walks leave a half space."""
    generator = np.random.default_rng(3)
    walks = start * generator.normal(size=(WALKS, 1, 2)) + np.cumsum(
        noise * generator.normal(size=(WALKS, STEPS, 2)), axis=1
    )
    return float((((means + walks) * slopes).sum(axis=2) + offset < 0.0).any(axis=1).mean())


@pytest.mark.parametrize("tail", ["normal", "chebyshev"])
@pytest.mark.parametrize("seed", range(12))
def test_no_bound_is_below_the_share_of_walks_that_leave(seed: int, tail: Tail) -> None:
    """Means that stand, approach and go away; half spaces that turn, some of them for a while."""
    generator = np.random.default_rng(seed)
    drift = generator.uniform(-0.04, 0.04, 2) * (np.arange(STEPS) < generator.integers(1, STEPS))[:, None]
    means = np.cumsum(drift, axis=0)
    angles = generator.uniform(-0.5, 0.5) * np.cumsum(generator.random(STEPS) < generator.choice([0.0, 0.1, 1.0]))
    slopes = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    start, noise, offset = generator.uniform(0.0, 0.2), generator.uniform(0.02, 0.1), generator.uniform(0.5, 1.2)
    found, measured = bound(means, slopes, offset, start, noise, tail), share(means, slopes, offset, start, noise)
    assert found >= measured - 4 * np.sqrt(measured * (1 - measured) / WALKS)


def test_a_walk_that_stands_is_bounded_by_twice_the_probability_at_its_end() -> None:
    """All instants together would have several times as much."""
    slopes, means = np.tile([1.0, 0.0], (STEPS, 1)), np.zeros((STEPS, 2))
    found = bound(means, slopes, 1.0, 0.0, 0.07, "normal")
    deviations = 0.07 * np.sqrt(np.arange(1, STEPS + 1))
    assert found == pytest.approx(2 * norm.sf(1.0 / deviations[-1]))
    assert found < 0.3 * norm.sf(1.0 / deviations).sum()
    assert found < 1.5 * share(means, slopes, 1.0, 0.0, 0.07)


def test_deviations_that_do_not_add_up_along_a_slope_are_counted_at_each_instant() -> None:
    passage, slope = FirstPassage("normal"), np.array([1.0, 0.0])
    for _ in range(STEPS):
        passage.add(
            half_space(slope, 1.0), np.zeros((1, 2)), 0.1 * np.eye(2)[None], 0.5 * slope[None, None], np.ones(1)
        )
    assert passage.risk[0] == pytest.approx(STEPS * norm.sf(1.0 / np.sqrt(0.1)))
