import os

import numpy as np
import pytest
from formulas import random_formula, random_samples

from symaware_cli.engine.runtime.state.counterparts import Counterparts
from symaware_cli.engine.runtime.state.deserialiser import Deserialiser
from symaware_cli.engine.runtime.state.serialiser import Serialiser
from symaware_cli.evidence.semantics import robustness_interval
from symaware_cli.specification.formula import (
    Always,
    Array,
    Eventually,
    Formula,
    Historically,
    Not,
    Or,
    Predicate,
    Until,
    horizon,
    operands,
)
from symaware_cli.specification.monitor import Monitor


def check_reasons(monitor: Monitor, formula: Formula, samples: Array) -> None:
    """Each bound, re-read at the instant that its reason names, is the number that the reason states."""
    every = np.arange(monitor.rows)
    for side in (0, 1, None):
        for row, reason in enumerate(monitor.reasons(every, side)):
            bounds = monitor.lower[row], monitor.upper[row]
            if reason is None:
                assert np.isinf(bounds).any() if side is None else np.isinf(bounds[side])
                continue
            assert reason.value in (bounds if side is None else bounds[side : side + 1])
            if side is None and monitor.verdict[row]:
                assert reason.value == bounds[0 if monitor.verdict[row] > 0 else 1]
            found, sign = formula, 1
            for position in reason.path:
                sign *= -1 if isinstance(found, Not) else 1
                found = operands(found)[position]
            assert len(reason.instants) == len(reason.path) + 1
            if reason.predicate is None:
                assert not isinstance(found, Predicate)
                assert np.isinf(reason.value)
                continue
            assert found == Predicate(reason.predicate)
            assert reason.robustness == samples[reason.predicate, reason.instant, row]
            assert reason.value == sign * reason.robustness


def check(formula: Formula, samples: Array, *, ends: bool) -> None:
    """Compare a monitor with the definitions at each instant."""
    _, instants, rows = samples.shape
    monitor, quick = Monitor(formula, rows), Monitor(formula, rows, interval=False)
    exact = np.empty((0, rows))
    for known in range(1, instants + 1 + ends):
        ended = known > instants
        known = min(known, instants)
        for each in (monitor, quick):
            if ended:
                each.finish()
            else:
                each.update(list(samples[:, known - 1]))
        (low,), (high,) = robustness_interval(formula, list(samples[:, :known]), known, rows, ended, times=1)
        np.testing.assert_array_equal(monitor.lower, low)
        np.testing.assert_array_equal(monitor.upper, high)
        verdict = np.where(low > 0, 1, np.where(high < 0, -1, 0))
        np.testing.assert_array_equal(monitor.verdict, verdict)
        np.testing.assert_array_equal(quick.verdict, verdict)
        if known in (instants // 2, instants):
            check_reasons(monitor, formula, samples[:, :known])
            every = np.arange(rows)
            assert [monitor.reasons(every, side) for side in (0, 1)] == [quick.reasons(every, side) for side in (0, 1)]
        first, values = monitor.exact()
        also_first, also_values = quick.exact()
        assert first == also_first == len(exact)
        np.testing.assert_array_equal(values, also_values)
        exact = np.concatenate([exact, values])
    delay = horizon(formula)
    if delay is None:
        assert len(exact) == (instants if ends else 0)
    else:
        assert len(exact) == max(instants - delay, 0)
    lows, highs = (each[: len(exact)] for each in robustness_interval(formula, list(samples), instants, rows, ends))
    np.testing.assert_array_equal(exact, np.where(lows == highs, lows, np.nan))


def cases(seed: int, number: int) -> None:
    generator = np.random.default_rng(seed)
    for case in range(number):
        formula = random_formula(generator, int(generator.integers(1, 5)))
        samples = random_samples(generator, int(generator.integers(1, 13)), int(generator.integers(1, 4)))
        try:
            check(formula, samples, ends=bool(generator.integers(2)))
        except BaseException as error:
            error.add_note(f"case {case} of seed {seed}: {formula}\n{samples.tolist()}")
            raise


@pytest.mark.parametrize("seed", range(4))
def test_monitors_agree_with_the_definitions_at_every_instant(seed: int) -> None:
    cases(seed, 150)


def test_an_until_without_an_end_is_not_reached_after_the_run() -> None:
    # Where a window asks at once for the last instant, of which nothing is known, and one after it.
    until = Until(1, None, Historically(1, None, Predicate(0)), Always(1, 1, Predicate(2)))
    check(Always(1, 2, until), random_samples(np.random.default_rng(0), 3, 3), ends=True)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1000, 1000 + int(os.environ.get("SYMAWARE_MONITOR_SEEDS", "10"))))
def test_thousands_of_monitors_agree_with_the_definitions_at_every_instant(seed: int) -> None:
    """With SYMAWARE_MONITOR_SEEDS=500 a hundred thousand of them."""
    cases(seed, 200)


def test_the_reason_of_a_violation_is_the_sample_that_accounts_for_its_robustness() -> None:
    formula = Always(0, None, Or((Not(Predicate(0)), Eventually(0, 2, Predicate(1)))))
    monitor = Monitor(formula, 1)
    reasons = []
    for asked, answered in [(-1.0, -5.0), (2.0, -3.0), (-1.0, -4.0), (-1.0, -2.5), *[(3.0, -9.0)] * 3]:
        monitor.update([np.array([asked]), np.array([answered])])
        (reason,) = monitor.reasons(np.array([0]))
        reasons.append((int(monitor.verdict[0]), monitor.upper[0], reason))
    assert [verdict for verdict, _, _ in reasons] == [0, 0, 0, -1, -1, -1, -1]
    # What was asked at 1 had not been answered at 3; what was asked at 4 was answered even less at 6.
    for number, value, instant in ((3, -2.0, 1), (6, -3.0, 4)):
        _, upper, reason = reasons[number]
        assert reason is not None
        assert (reason.value, reason.predicate, reason.instant, reason.robustness) == (upper, 0, instant, -value)
        assert (reason.path, reason.instants) == ((0, 0, 0), (0, instant, instant, instant))


def _same(one: Monitor, other: Monitor) -> None:
    np.testing.assert_array_equal(one.verdict, other.verdict)
    np.testing.assert_array_equal(one.lower, other.lower)
    np.testing.assert_array_equal(one.upper, other.upper)
    (first, values), (other_first, other_values) = one.exact(), other.exact()
    assert first == other_first
    np.testing.assert_array_equal(values, other_values)
    assert one.reasons(np.arange(one.rows)) == other.reasons(np.arange(other.rows))


@pytest.mark.parametrize("interval", [True, False])
@pytest.mark.parametrize("seed", range(60))
def test_selected_rows_go_on_as_monitors_of_their_own_do(seed: int, interval: bool) -> None:
    generator = np.random.default_rng(seed)
    formula = random_formula(generator, 3)
    instants, rows = 12, 5
    samples = random_samples(generator, instants, rows)
    chosen = generator.permutation(rows)[: int(generator.integers(1, rows))]
    monitor = Monitor(formula, rows, interval=interval)
    alone = [Monitor(formula, 1, interval=interval) for _ in chosen]
    change = int(generator.integers(instants))
    for t in range(instants):
        if t == change:
            monitor = monitor.select(chosen)
            samples = samples[:, :, chosen]
        monitor.update(list(samples[:, t]))
        for each, row in zip(alone, chosen, strict=True):
            each.update(list(samples[:, t, [list(chosen).index(row)] if t >= change else [row]]))
    monitor.finish()
    for each in alone:
        each.finish()
    for place, each in enumerate(alone):
        _same(monitor.select(np.array([place])), each)


@pytest.mark.parametrize("interval", [True, False])
@pytest.mark.parametrize("seed", range(60))
def test_a_monitor_put_back_goes_on_as_if_nothing_had_happened(seed: int, interval: bool) -> None:
    generator = np.random.default_rng(seed)
    formula = random_formula(generator, 3)
    samples = random_samples(generator, 12, 2)
    monitor = Monitor(formula, 2, interval=interval)
    taken = int(generator.integers(12))
    state = None
    for t in range(12):
        if t == taken:
            state = Serialiser({"monitor": monitor}, {"symaware_cli"}).entries
        monitor.update(list(samples[:, t]))
    monitor.finish()
    # Into one that has gone on elsewhere, and into a fresh one.
    elsewhere = Monitor(formula, 2, interval=interval)
    for t in range(5):
        elsewhere.update(list(samples[:, t] + 1.0))
    for other in (elsewhere, Monitor(formula, 2, interval=interval)):
        assert state is not None
        root = {"monitor": other}
        restored = Deserialiser(Counterparts(state, root, {"symaware_cli"}, {})).restore()[0]
        for t in range(taken, 12):
            restored.update(list(samples[:, t]))
        restored.finish()
        _same(restored, monitor.select(np.arange(2)))


@pytest.mark.parametrize("seed", range(60))
def test_a_row_alone_is_what_it_is_among_others(seed: int) -> None:
    generator = np.random.default_rng(seed)
    formula = random_formula(generator, 4)
    samples = random_samples(generator, 12, 3)
    for bounded in (True, False):
        together = followed(formula, samples, interval=bounded)
        for row in range(3):
            alone = followed(formula, samples[:, :, row : row + 1], interval=bounded)
            for all_rows, one_row in zip(together, alone, strict=True):
                assert all_rows[..., row].tobytes() == one_row[..., 0].tobytes()


def followed(formula: Formula, samples: Array, *, interval: bool = True) -> list[Array]:
    """Verdict and bounds after each instant and the end, and exact robustness."""
    monitor = Monitor(formula, samples.shape[2], interval=interval)
    found = []
    for t in range(samples.shape[1] + 1):
        if t < samples.shape[1]:
            monitor.update(list(samples[:, t]))
        else:
            monitor.finish()
        found.append(np.stack([monitor.verdict, monitor.lower, monitor.upper]))
    return [np.array(found), monitor.exact()[1]]
