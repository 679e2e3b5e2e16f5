"""The bound of the probability that outlines overlap, against Monte Carlo; the time until they do, against sampling."""

import itertools
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from outlines import random_core

from symaware_cli.engine.components.risk.gaussian import collision_probability
from symaware_cli.engine.components.risk.outlines import Side, first_touch, overlap_bound
from symaware_cli.geometry.minkowski import overlap_region, within
from symaware_cli.geometry.pieces import Pieces, separation_from_points

KINDS = ("disc", "box", "capsule", "polygon")
PAIRS = list(itertools.combinations_with_replacement(KINDS, 2))
SAMPLES = 4000
EVERY = 41
"""Instants at which bodies that turn are looked at."""


def random_outline(
    kind: str, random: np.random.Generator
) -> tuple[NDArray[np.float64] | list[tuple[float, float]], float]:
    if kind == "disc":
        return [(0.0, 0.0)], random.uniform(0.2, 1.5)
    if kind == "box":
        x, y = random.uniform(0.3, 2.3), random.uniform(0.2, 1.0)
        return [(-x, -y), (x, -y), (x, y), (-x, y)], 0.0
    if kind == "capsule":
        x = random.uniform(0.3, 2)
        return [(-x, 0.0), (x, 0.0)], random.uniform(0.1, 0.6)
    hull = shapely.MultiPoint(random_core(random, 6, 2.0)).convex_hull
    if hull.area < 0.2:
        return random_outline(kind, random)
    return np.array(hull.exterior.normalize().reverse().coords)[:-1], 0.0


class Pair:
    """Two bodies on their ways."""

    def __init__(self, kinds: tuple[str, str], random: np.random.Generator, doubt: str = "known") -> None:
        self.outlines = [random_outline(kind, random) for kind in kinds]
        self.horizon = random.uniform(1, 5)
        self.closing = random.normal(size=2) * random.choice([0.1, 1, 4])
        self.apart = -self.closing * random.uniform(0, self.horizon) + random.normal(size=2) * 2
        deviation = random.choice([0.05, 0.3, 1.0])
        speed_deviation = 0.0 if doubt == "known" else random.choice([0.02, 0.2, 0.6])
        square = random.normal(size=(4, 4))
        scale = np.repeat([deviation, speed_deviation], 2)
        self.covariance = square @ square.T / 4 * np.outer(scale, scale)
        self.headings = random.uniform(-3, 3, 2)
        self.deviations = random.choice([0.0, 0.03, 0.2], 2) if doubt in ("heading", "turning") else np.zeros(2)
        self.turn_rates = random.choice([0.0, 0.2, -1.0], 2) if doubt == "turning" else np.zeros(2)

    def sides(self) -> tuple[Side, Side]:
        one, other = (
            Side(
                Pieces.of([outline]),
                np.array([self.headings[number]]),
                np.array([self.turn_rates[number]]),
                np.array([self.deviations[number]]),
                np.zeros(1, bool),
            )
            for number, outline in enumerate(self.outlines)
        )
        return one, other

    def bound(self) -> float:
        columns = self.apart[:, None], self.closing[:, None]
        return float(overlap_bound(*columns, self.covariance[None], *self.sides(), 0.0, self.horizon)[0])

    def of_discs(self) -> float:
        """The probability for the discs around both, with velocities taken as they are expected."""
        radius = sum(np.hypot(*np.array(core).T).max() + rounding for core, rounding in self.outlines)
        columns = self.apart[:, None], self.closing[:, None]
        return float(
            collision_probability(*columns, np.array([radius]), self.covariance[None, :2, :2], self.horizon)[0]
        )

    def sampled(self, random: np.random.Generator, count: int = SAMPLES, wider: float = 1.0) -> float:
        """The part of sampled states in which they overlap at some time within the horizon."""
        drawn = random.multivariate_normal([*self.apart, *self.closing], self.covariance, size=count, method="eigh")
        place, speed = drawn[:, :2], drawn[:, 2:]
        headings = self.headings[:, None] + self.deviations[:, None] * random.normal(size=(2, count))
        if not self.deviations.any() and not self.turn_rates.any():
            places = self._places(headings[:, :1]).take(np.zeros(count, np.intp))
            places.rounding = wider * places.rounding
            start, end = within(place, speed, places)
            return float((np.maximum(start, 0.0) <= np.minimum(end, self.horizon)).mean())
        touched = np.zeros(count, bool)
        for time in np.linspace(0, self.horizon, EVERY):
            places = self._places(headings + time * self.turn_rates[:, None])
            touched |= separation_from_points(place + time * speed, np.zeros(count), places).distance < 0.0
        return float(touched.mean())

    def _places(self, headings: NDArray[np.float64]) -> Pieces:
        count = headings.shape[1]
        one, other = (
            Pieces.of([outline]).take(np.zeros(count, np.intp)).placed(np.zeros((count, 2)), heading)
            for outline, heading in zip(self.outlines, headings, strict=True)
        )
        return overlap_region(one, other)


@pytest.mark.parametrize("kinds", PAIRS, ids="-".join)
@pytest.mark.parametrize(
    ("doubt", "count", "samples"), [("known", 100, 4000), ("velocity", 100, 4000), ("turning", 20, 400)]
)
def test_the_bound_is_never_below_the_sampled_probability(
    kinds: tuple[str, str], doubt: str, count: int, samples: int
) -> None:
    random = np.random.default_rng([PAIRS.index(kinds), len(doubt)])
    excess = []
    for _ in range(count):
        pair = Pair(kinds, random, doubt)
        bound, sampled = pair.bound(), pair.sampled(random, samples)
        error = np.sqrt(max(sampled * (1 - sampled), 1 / samples) / samples)
        assert sampled <= bound + 4 * error
        if doubt == "known" and bound > sampled + 4 * error:
            # With nothing but positions uncertain it is the probability itself, but for arcs.
            assert bound <= pair.sampled(random, samples, wider=1.01) + 4 * error
        excess.append(bound - sampled)
    # How loose it is: with uncertain velocities some hundredths on average, for bodies that turn more.
    assert np.mean(excess) < {"known": 0.01, "velocity": 0.08, "turning": 0.4}[doubt]


def test_for_boxes_the_bound_is_ten_times_nearer_to_the_truth_than_discs() -> None:
    random = np.random.default_rng(8)
    of_outlines, of_discs = 0.0, 0.0
    for _ in range(200):
        pair = Pair(("box", "box"), random)
        pair.outlines = [([(-2.25, -0.9), (2.25, -0.9), (2.25, 0.9), (-2.25, 0.9)], 0.0)] * 2
        sampled = pair.sampled(random)
        of_outlines += max(pair.bound() - sampled, 0.0)
        of_discs += max(pair.of_discs() - sampled, 0.0)
    assert 10 * of_outlines < of_discs


@pytest.mark.parametrize("kinds", PAIRS, ids="-".join)
def test_outlines_first_touch_when_dense_sampling_finds_them_overlapping(kinds: tuple[str, str]) -> None:
    random = np.random.default_rng([7, PAIRS.index(kinds)])
    for number in range(200):
        pair = Pair(kinds, random, "turning" if number % 4 == 0 else "known")
        pair.deviations = np.zeros(2)
        (touch,) = first_touch(pair.apart[:, None], pair.closing[:, None], *pair.sides(), 0.0, pair.horizon)
        times = np.linspace(0, pair.horizon, 1001)
        places = pair._places(pair.headings[:, None] + times * pair.turn_rates[:, None])
        apart = separation_from_points(
            pair.apart + times[:, None] * pair.closing, np.zeros(len(times)), places
        ).distance
        overlapping = times[apart < 0.0]
        first = overlapping[0] if len(overlapping) else np.inf
        assert touch <= first + 1e-9
        if not pair.turn_rates.any() and abs(apart).min() > 1e-3:
            assert touch == first == np.inf or touch >= first - times[1]


def test_bodies_that_turn_are_held_by_outlines_that_are_not_wider_than_they_need_to_be() -> None:
    box = ([(-2.0, -0.2), (2.0, -0.2), (2.0, 0.2), (-2.0, 0.2)], 0.0)
    none = np.zeros(1)

    def touch(rate: Any) -> Any:
        side = Side(Pieces.of([box]), none, np.array([rate]), none, np.zeros(1, bool))
        other = Side(Pieces.of([([(0.0, 0.0)], 0.1)]), none, none, none, np.zeros(1, bool))
        # A disc that stands 1 m beside a bar that begins to turn: they meet after asin(0.5) or so.
        return first_touch(np.array([[1.8], [1.0]]), np.zeros((2, 1)), side, other, 0.0, 5.0)[0]

    assert touch(0.0) == np.inf
    assert touch(0.5) <= 0.85
    assert touch(0.5) >= 0.5
    assert touch(0.01) == np.inf
