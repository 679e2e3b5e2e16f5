"""When turns are due, as declared."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from simulating import present

from symaware_cli.engine.runtime.timing import Timetable, Timing

STEP = 50


def first(timing: Timing, count: int, grid: int = 0, key: int = 3) -> list[int]:
    timetable = Timetable(timing, STEP, grid, key)
    turns = [present(timetable.turn(0, 0))]
    while len(turns) < count:
        time, number = turns[-1]
        turns.append(present(timetable.turn(number + 1, time + 1)))
    return [time for time, _ in turns][:count]


def test_instants_are_exact_multiples_of_the_period() -> None:
    assert first(Timing(period=7, offset=3), 5) == [3, 10, 17, 24, 31]
    assert first(Timing(), 3) == [0, 50, 100]
    assert first(Timing(period=33_333_333), 3 * 10**4)[-1] == (3 * 10**4 - 1) * 33_333_333


def test_a_period_of_zero_has_one_instant_of_its_own() -> None:
    timetable = Timetable(Timing(period=0, offset=9), STEP, 0)
    assert timetable.turn(0, 0) == (9, 0)
    assert timetable.turn(1, 10) is None


@given(period=st.integers(1, 400), offset=st.integers(0, 400), now=st.integers(0, 40))
def test_an_agent_that_joins_late_begins_with_the_next_turn(period: int, offset: int, now: int) -> None:
    timetable = Timetable(Timing(period=period, offset=offset), STEP, STEP)
    every = first(Timing(period=period, offset=offset), 50 * now + 2, grid=STEP)
    assert present(timetable.turn(0, now * STEP))[0] == next(time for time in every if time >= now * STEP)


@given(period=st.integers(1, 400), offset=st.integers(0, 400))
def test_on_a_grid_each_instant_is_the_next_one_and_none_comes_twice(period: int, offset: int) -> None:
    nominal = first(Timing(period=period, offset=offset), 200)
    expected = sorted({-(-time // STEP) * STEP for time in nominal})
    found = first(Timing(period=period, offset=offset), len(expected), grid=STEP)
    assert found == expected


@given(period=st.integers(1, 400), jitter=st.floats(0, 0.99))
def test_jitter_is_drawn_once_for_each_nominal_instant_on_any_grid(period: int, jitter: float) -> None:
    timing = Timing(period=period * 10**6, jitter=int(jitter * period * 10**6))
    plain = first(timing, 50)
    grid = STEP * 10**6
    expected = sorted({-(-time // grid) * grid for time in plain})
    assert first(timing, len(expected) - 1, grid=grid) == expected[:-1]


def test_jitter_is_drawn_evenly_and_anew_for_each_turn() -> None:
    timing = Timing(period=10**9, jitter=8 * 10**8)
    late = [(time % 10**9) / (8 * 10**8) for time in first(timing, 2000)]
    assert stats.kstest(late, "uniform").pvalue > 1e-3
    assert abs(np.corrcoef(late[1:], late[:-1])[0, 1]) < 5 / np.sqrt(len(late))
    assert first(timing, 100, key=4) != first(timing, 100)


@given(period=st.integers(2, 90), times=st.integers(2, 5))
def test_jitter_is_that_of_the_nominal_instant_for_any_period(period: int, times: int) -> None:
    often = first(Timing(period=period * 10**6, jitter=10**6), 40 * times)
    seldom = first(Timing(period=times * period * 10**6, jitter=10**6), 40)
    assert often[::times] == seldom


@given(st.lists(st.integers(0, 200), max_size=10))
def test_the_jitter_of_a_turn_does_not_depend_on_the_turns_that_were_asked_for_before(numbers: list[int]) -> None:
    timing = Timing(period=1000, jitter=900)
    timetable = Timetable(timing, STEP, 0, key=3)
    assert [timetable.turn(number, 0) for number in numbers] == [
        Timetable(timing, STEP, 0, key=3).turn(number, 0) for number in numbers
    ]


def test_a_timing_with_one_turn_a_step_is_steady() -> None:
    assert Timing().is_steady(STEP)
    assert Timing(period=STEP).is_steady(STEP)
    assert not Timing(period=STEP, offset=1).is_steady(STEP)
    assert not Timing(period=STEP, jitter=1).is_steady(STEP)
    assert not Timing(period=2 * STEP).is_steady(STEP)
    assert not Timing(period=0).is_steady(STEP)
