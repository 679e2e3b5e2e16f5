"""Looks come at numbers of runs that were declared beforehand."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli.study.statistics.looks import Looks


def first(looks: Looks, count: int) -> list[int]:
    return list(itertools.islice(looks, count))


def test_looks_come_every_so_many_runs() -> None:
    assert first(Looks(50), 4) == [50, 100, 150, 200]


def test_looks_of_a_geometric_schedule_come_ever_more_rarely() -> None:
    assert first(Looks(10, 1.5), 6) == [10, 20, 30, 45, 68, 102]


@given(step=st.integers(1, 100), ratio=st.floats(1, 3))
def test_two_looks_are_at_least_a_step_apart(step: int, ratio: float) -> None:
    found = first(Looks(step, ratio), 20)
    assert all(later - earlier >= step for earlier, later in itertools.pairwise([0, *found]))
    assert all(later >= ratio * earlier for earlier, later in itertools.pairwise(found))


@pytest.mark.parametrize(("step", "ratio"), [(0, 1.0), (1, 0.9), (1, math.inf), (1, math.nan)])
def test_other_schedules_are_refused(step: int, ratio: float) -> None:
    with pytest.raises(ValueError, match="at least 1"):
        Looks(step, ratio)
