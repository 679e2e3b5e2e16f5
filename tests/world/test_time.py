"""Simulated time is an integer count of nanoseconds."""

from hypothesis import given
from hypothesis import strategies as st

from symaware_cli import nanoseconds, seconds
from symaware_cli.core import Clock


def test_a_decimal_time_step_becomes_the_nanoseconds_it_means() -> None:
    assert [nanoseconds(time) for time in (0.0, 0.05, 0.1, 0.3, 1e-6, 1 / 3)] == [
        *(0, 50_000_000, 100_000_000, 300_000_000, 1_000, 333_333_333)
    ]


def test_steps_counted_in_nanoseconds_do_not_drift() -> None:
    assert sum([nanoseconds(0.1)] * 1_000_000) == nanoseconds(100_000.0)


@given(st.integers(0, 10**15))
def test_up_to_eleven_days_no_nanosecond_is_lost_in_seconds(time: int) -> None:
    assert nanoseconds(seconds(time)) == time


def test_a_clock_starts_at_zero() -> None:
    assert Clock().now == 0
