"""Laws of temporal logic hold for verdicts, bounds and exact robustness at every instant."""

import numpy as np
from formulas import random_formula, random_samples
from hypothesis import given, settings
from hypothesis import strategies as st
from test_monitor import followed

from symaware_cli.specification.formula import (
    Always,
    And,
    Array,
    Eventually,
    Formula,
    Historically,
    Not,
    Once,
    Or,
    Since,
    Until,
)

seeds = st.integers(0, 2**32 - 1)
firsts = st.integers(0, 3)
widths = st.none() | st.integers(0, 4)


def drawn(seed: int) -> tuple[Formula, Formula, Array]:
    """Two formulas, and samples."""
    generator = np.random.default_rng(seed)
    one, other = (random_formula(generator, int(generator.integers(3))) for _ in range(2))
    return one, other, random_samples(generator, int(generator.integers(1, 12)), 2)


def same(one: Formula, other: Formula, samples: Array) -> None:
    for interval in (True, False):
        for left, right in zip(
            followed(one, samples, interval=interval), followed(other, samples, interval=interval), strict=True
        ):
            np.testing.assert_array_equal(left, right)


def last(first: int, width: int | None) -> int | None:
    return None if width is None else first + width


@settings(max_examples=60, deadline=None)
@given(seeds, firsts, widths)
def test_the_negation_of_always_is_eventually_not(seed: int, first: int, width: int | None) -> None:
    one, _, samples = drawn(seed)
    end = last(first, width)
    same(Not(Always(first, end, one)), Eventually(first, end, Not(one)), samples)
    same(Not(Historically(first, end, one)), Once(first, end, Not(one)), samples)


@settings(max_examples=60, deadline=None)
@given(seeds)
def test_conjunction_and_disjunction_are_dual(seed: int) -> None:
    one, other, samples = drawn(seed)
    same(Not(And((one, other))), Or((Not(one), Not(other))), samples)


@settings(max_examples=60, deadline=None)
@given(seeds, widths)
def test_the_negation_of_until_is_a_release(seed: int, width: int | None) -> None:
    left, right, samples = drawn(seed)
    neither = And((Not(left), Not(right)))
    released = Or((Always(0, width, Not(right)), Until(0, width, Not(right), neither)))
    until = Not(Until(0, width, left, right))
    if width is None:
        # Bounds suppose for each operator alone that the run ends now, or never does, so those of one may be tighter.
        (one, exact), (other, also_exact) = followed(until, samples), followed(released, samples)
        np.testing.assert_array_equal(one[-1], other[-1])
        np.testing.assert_array_equal(exact, also_exact)
    else:
        same(until, released, samples)


@settings(max_examples=60, deadline=None)
@given(seeds, firsts, st.integers(0, 3), st.integers(0, 3))
def test_windows_can_be_split(seed: int, first: int, one_width: int, other_width: int) -> None:
    one, _, samples = drawn(seed)
    middle = first + one_width
    end = middle + other_width
    for whole, kind in ((And, Always), (Or, Eventually), (And, Historically), (Or, Once)):
        parts = whole((kind(first, middle, one), kind(middle, end, one)))
        same(kind(first, end, one), parts, samples)


@settings(max_examples=60, deadline=None)
@given(seeds, firsts, st.integers(0, 3), st.integers(0, 3))
def test_wider_windows_promise_more_and_ask_for_less(seed: int, first: int, width: int, wider: int) -> None:
    one, other, samples = drawn(seed)
    for build, sign in (
        (lambda end: Always(first, end, one), 1),
        (lambda end: Historically(first, end, one), 1),
        (lambda end: Eventually(first, end, one), -1),
        (lambda end: Once(first, end, one), -1),
        (lambda end: Until(first, end, one, other), -1),
        (lambda end: Since(first, end, one, other), -1),
    ):
        (narrow, _), (wide, _) = (followed(build(end), samples) for end in (first + width, first + width + wider))
        assert np.all(sign * np.clip(narrow, -9, 9) >= sign * np.clip(wide, -9, 9))


@settings(max_examples=60, deadline=None)
@given(seeds, firsts, widths)
def test_bounds_only_tighten_and_verdicts_stay(seed: int, first: int, width: int | None) -> None:
    one, other, samples = drawn(seed)
    found, _ = followed(Until(first, last(first, width), one, other), samples)
    verdicts, lower, upper = found[:, 0], found[:, 1], found[:, 2]
    assert np.all(lower <= upper)
    assert np.all(lower[1:] >= lower[:-1])
    assert np.all(upper[1:] <= upper[:-1])
    assert np.all((verdicts[1:] == verdicts[:-1]) | (verdicts[:-1] == 0))


@settings(max_examples=60, deadline=None)
@given(seeds, firsts)
def test_until_and_since_unfold(seed: int, steps: int) -> None:
    left, right, samples = drawn(seed)
    until = Until(0, steps + 1, left, right)
    same(until, Or((right, And((left, Eventually(1, 1, Until(0, steps, left, right)))))), samples)
    since = Since(0, None, left, right)
    same(since, Or((right, And((left, Once(1, 1, since))))), samples)
