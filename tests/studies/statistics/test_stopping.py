"""A rule stops a sequence at the same run, regardless of the order in which runs end and of the number of workers."""

from __future__ import annotations

import itertools
import math
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from symaware_cli.specification.expression import EvaluationError, ExpressionError
from symaware_cli.studies.statistics.confidence_sequence import BetaMixture, EmpiricalBernstein, bounds
from symaware_cli.studies.statistics.interval_estimate import Array
from symaware_cli.studies.statistics.stopping import Estimands, Looks, Mean, Share, StoppingRule, StoppingState


def first(looks: Looks, count: int) -> list[int]:
    return list(itertools.islice(looks, count))


def test_looks_are_a_fixed_number_of_runs_apart() -> None:
    assert first(Looks(50), 4) == [50, 100, 150, 200]


def test_looks_of_a_geometric_schedule_become_rarer() -> None:
    assert first(Looks(10, 1.5), 6) == [10, 20, 30, 45, 68, 102]


@given(step=st.integers(1, 100), ratio=st.floats(1, 3))
def test_two_looks_are_at_least_a_step_apart(step: int, ratio: float) -> None:
    found = first(Looks(step, ratio), 20)
    assert all(later - earlier >= step for earlier, later in itertools.pairwise([0, *found]))
    assert all(later >= ratio * earlier for earlier, later in itertools.pairwise(found))


@pytest.mark.parametrize(("step", "ratio"), [(0, 1.0), (1, 0.9), (1, math.inf), (1, math.nan)])
def test_invalid_schedules_are_rejected(step: int, ratio: float) -> None:
    with pytest.raises(ValueError, match="at least 1"):
        Looks(step, ratio)


Flags = NDArray[np.bool_]

ESTIMANDS: Estimands = {
    "satisfied.safe": Share(),
    "satisfied.keep-away": Share(),
    "mean.closest": Mean(0, 2),
    "mean.effort": Mean(),
    "failed": Share(),
}


def rule(text: str, step: int = 10) -> StoppingRule:
    return StoppingRule(text, ESTIMANDS, looks=Looks(step))


def followed(state: StoppingState, values: Array, order: list[int] | None = None) -> StoppingState:
    for index in order or range(len(values)):
        state.add(index, {"satisfied.safe": float(values[index])})
    return state


def draws(p: float, count: int, seed: int = 1) -> Array:
    return (np.random.default_rng(seed).random(count) < p).astype(float)


def test_runs_stop_at_the_first_look_at_which_the_rule_holds() -> None:
    values = draws(0.9, 2000)
    state = followed(rule("halfwidth(satisfied.safe) < 0.05").begin(), values)
    assert state.stopped_at is not None
    narrow = [look for look in range(10, 2001, 10) if watched(values[:look]) < 0.05]
    assert state.stopped_at == narrow[0]
    found = state.estimates()["satisfied.safe"]
    assert found.count == narrow[0]
    assert found.value == pytest.approx(values[: narrow[0]].mean())
    assert found.halfwidth == watched(values[: narrow[0]])
    assert state.keeps(narrow[0] - 1)
    assert not state.keeps(narrow[0])


def watched(values: Array) -> float:
    sequence = BetaMixture()
    sequence.update(values)
    return sequence.estimate().halfwidth


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1000), workers=st.integers(1, 60))
def test_the_order_in_which_runs_end_does_not_matter(seed: int, workers: int) -> None:
    values = draws(0.8, 400)
    given_rule = rule("halfwidth(satisfied.safe) < 0.1 or lower(satisfied.safe) > 0.9")
    expected = followed(given_rule.begin(), values)
    chance, order, running = random.Random(seed), [], list(range(workers))
    begun = workers
    while running:
        order.append(running.pop(chance.randrange(len(running))))
        if begun < len(values):
            running.append(begun)
            begun += 1
    found = followed(given_rule.begin(), values, order)
    assert found.stopped_at == expected.stopped_at is not None
    assert found.estimates() == expected.estimates()


def test_runs_after_a_gap_are_not_used() -> None:
    state = rule("runs >= 10").begin()
    for index in range(1, 30):
        assert not state.add(index, {})
    assert (state.prefix, state.looked_at) == (0, 0)
    assert state.add(0, {})
    assert state.stopped_at == 10
    assert state.add(30, {})
    assert state.stopped_at == 10


def test_a_missing_value_affects_only_its_own_estimand() -> None:
    state = rule("halfwidth(mean.closest) < 0.3 and lower(satisfied.safe) > 0 and runs >= 100").begin()
    for index in range(100):
        state.add(index, {"satisfied.safe": 1.0, "mean.closest": math.nan if index % 2 else 1.0})
    assert state.stopped_at == 100
    found = state.estimates()
    assert (found["mean.closest"].count, found["satisfied.safe"].count) == (50, 100)
    assert found["mean.closest"].value == 1.0


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("halfwidth(satisfied.safe) < 0.01", ["satisfied.safe"]),
        ('upper(failed) < 0.1 and not lower(satisfied["keep-away"]) < 0.2', ["failed", "satisfied.keep-away"]),
        ("lower(satisfied.safe) > 0.95 or upper(satisfied.safe) < 0.9", ["satisfied.safe"]),
        ("halfwidth(mean.closest) < 0.05 and runs >= 100", ["mean.closest"]),
        ("halfwidth(mean.closest) < 0.05 * max(1, abs(estimate(mean.closest)))", ["mean.closest"]),
        ("runs == 100", []),
    ],
)
def test_a_rule_lists_its_estimands(text: str, asked: list[str]) -> None:
    assert list(rule(text).estimands) == asked


@pytest.mark.parametrize(
    ("text", "problem", "marked", "offered"),
    [
        ("halfwidth(satisfied.saef) < 0.1", "there is no `satisfied.saef` to estimate", "satisfied.saef", True),
        ('lower(satisfied["keep"]) > 0', "there is no `satisfied.keep` to estimate", 'satisfied["keep"]', True),
        ("lower(satisifed.safe) > 0", "there is no `satisifed` here", "satisifed", True),
        ("halfwdith(failed) < 1", "there is no function `halfwdith`", "halfwdith", True),
        ("satisfied.safe > 0.9", "this is an estimand: ask for estimate(satisfied.safe) or", "satisfied.safe", False),
        ("lower(satisfied) > 0", "there is no `satisfied` to estimate", "satisfied", True),
        ("lower(satisfied.safe.x) > 0", "lower(...) takes an estimand, such as failed", "satisfied.safe.x", False),
        ("lower(runs) > 0", "lower(...) takes an estimand", "runs", False),
        ("lower(mean.closest + 1) > 0", "lower(...) takes an estimand", "mean.closest + 1", False),
        ("runs.x > 0", "there is no `runs.x` to estimate", "runs.x", True),
        ("upper(mean.effort) < 1", "bounds of its values are declared", "mean.effort", False),
        ("runs", "a stopping rule is made of comparisons", "runs", False),
        ("runs > 1 and lower(failed)", "a stopping rule is made of comparisons", "lower(failed)", False),
        ("always runs > 1", "`always` belongs in a specification", "always runs > 1", False),
        ("inside(failed, failed)", "there is no function `inside`", "inside", True),
    ],
)
def test_errors_in_rules_are_located(text: str, problem: str, marked: str, offered: bool) -> None:
    with pytest.raises(ExpressionError) as caught:
        rule(text)
    assert problem in caught.value.problem
    assert text[caught.value.start : caught.value.end] == marked
    assert bool(caught.value.names) is offered


def test_invalid_runs_values_and_confidences_are_rejected() -> None:
    state = rule("halfwidth(mean.closest) < 0.3").begin()
    state.add(0, {})
    with pytest.raises(ValueError, match="run 0 was already there"):
        state.add(0, {})
    with pytest.raises(ValueError, match=r"the value 3 of `mean\.closest` in run 1 is outside the bounds 0 and 2"):
        state.add(1, {"mean.closest": 3.0})
    with pytest.raises(ValueError, match="between 0 and 1"):
        StoppingRule("runs > 1", ESTIMANDS, confidence=1.0)
    state = rule("1 / (runs - 10) > 0").begin()
    with pytest.raises(EvaluationError, match="has no value"):
        [state.add(index, {}) for index in range(10)]


# Coverage at the stop. Vectorized; some of the streams are compared with `StoppingState`.


def prefixes_of_shares(values: Array) -> tuple[Array, Array]:
    """Return the ends after each run of each stream, computed once per number of successes; shapes (runs, streams)."""
    successes = np.cumsum(values, axis=0)
    counts = np.broadcast_to(np.arange(1.0, len(values) + 1)[:, None], values.shape)
    pairs, place = np.unique(successes + 1j * counts, return_inverse=True)
    lower, upper = (end[place.reshape(values.shape)] for end in bounds(pairs.real.copy(), pairs.imag.copy(), 1 - 0.95))
    return np.maximum.accumulate(lower), np.minimum.accumulate(upper)


def stops(holds: Flags, step: int) -> tuple[NDArray[np.intp], Flags]:
    """Return the number of runs of each stream at the first look at which the rule holds, or at the last look."""
    looks = holds[step - 1 :: step]
    first = np.where(looks.any(axis=0), looks.argmax(axis=0), len(looks) - 1)
    stopped: Flags = np.any(looks, axis=0, keepdims=True)[0]
    return (first + 1) * step, stopped


@pytest.mark.parametrize(
    ("p", "halfwidth", "runs"),
    [(0.5, 0.05, 1600), (0.9, 0.05, 900), (0.02, 0.02, 1400), (0.999, 0.01, 1000)],
)
def test_the_interval_of_a_share_at_the_stop_has_the_nominal_coverage(p: float, halfwidth: float, runs: int) -> None:
    streams, step = 2000, 20
    values = (np.random.default_rng(11).random((runs, streams)) < p).astype(float)
    lower, upper = prefixes_of_shares(values)
    counts, stopped = stops(0.5 * (upper - lower) < halfwidth, step)
    assert stopped.all()
    at = counts - 1, np.arange(streams)
    covered = (lower[at] <= p) & (p <= upper[at])
    assert covered.mean() >= 0.95
    for stream in range(0, streams, 400):
        state = followed(rule(f"halfwidth(satisfied.safe) < {halfwidth}", step).begin(), values[:, stream])
        found = state.estimates()["satisfied.safe"]
        assert state.stopped_at == counts[stream]
        assert (found.lower, found.upper) == (lower[at][stream], upper[at][stream])


@pytest.mark.parametrize("p", [0.88, 0.93, 0.97])
def test_a_decision_rule_is_rarely_wrong(p: float) -> None:
    streams, runs = 2000, 1500
    values = (np.random.default_rng(12).random((runs, streams)) < p).astype(float)
    lower, upper = prefixes_of_shares(values)
    counts, stopped = stops((lower > 0.95) | (upper < 0.9), 20)
    at = counts - 1, np.arange(streams)
    covered = (lower[at] <= p) & (p <= upper[at])
    assert covered.mean() >= 0.95
    wrong = stopped & np.where(lower[at] > 0.95, p <= 0.95, p >= 0.9)
    assert wrong.mean() <= 0.05
    if p == 0.97:
        assert stopped.mean() > 0.5


def test_watching_a_fixed_sample_interval_loses_coverage() -> None:
    """The mistake that confidence sequences avoid: stopping when a fixed-sample interval excludes one half."""
    from scipy.special import betaincinv

    streams, runs = 2000, 1000
    values = (np.random.default_rng(13).random((runs, streams)) < 0.5).astype(float)
    successes = np.cumsum(values, axis=0)[19::20]
    counts = np.arange(20.0, runs + 1, 20)[:, None]
    fixed = (betaincinv(successes, counts - successes + 1, 0.025) > 0.5) | (
        betaincinv(successes + 1, counts - successes, 0.975) < 0.5
    )
    assert fixed.any(axis=0).mean() > 0.2
    lower, upper = prefixes_of_shares(values)
    assert ((lower > 0.5) | (upper < 0.5)).any(axis=0).mean() <= 0.05


@pytest.mark.parametrize(("name", "mean"), [("beta", 0.25), ("two points", 0.1)])
def test_the_interval_of_a_bounded_mean_at_the_stop_has_the_nominal_coverage(name: str, mean: float) -> None:
    streams, runs, step = 2000, 1500, 20
    chance = np.random.default_rng(14)
    unit = chance.beta(2, 6, (runs, streams)) if name == "beta" else chance.random((runs, streams)) < 0.1
    values = 2.0 * unit
    lower, upper = EmpiricalBernstein(0, 2, streams=(streams,)).update(values)
    counts, stopped = stops(0.5 * (upper - lower) < 0.12, step)
    assert stopped.all()
    at = counts - 1, np.arange(streams)
    covered = (lower[at] <= 2 * mean) & (2 * mean <= upper[at])
    assert covered.mean() >= 0.95
    for stream in (0, 1000):
        state = rule("halfwidth(mean.closest) < 0.12", step).begin()
        for index, value in enumerate(values[:, stream].tolist()):
            state.add(index, {"mean.closest": value})
        found = state.estimates()["mean.closest"]
        assert state.stopped_at == counts[stream]
        assert (found.lower, found.upper) == (lower[at][stream], upper[at][stream])


@pytest.mark.slow
@pytest.mark.parametrize(("p", "halfwidth"), [(0.3, 0.05), (0.9, 0.05), (0.999, 0.01)])
def test_the_states_of_two_thousand_streams_have_the_nominal_coverage(p: float, halfwidth: float) -> None:
    given_rule = rule(f"halfwidth(satisfied.safe) < {halfwidth}", 20)
    covered = 0
    for seed in range(2000):
        state = followed(given_rule.begin(), draws(p, 2000, seed))
        assert state.stopped_at is not None
        covered += state.estimates()["satisfied.safe"].covers(p)
    assert covered / 2000 >= 0.95
