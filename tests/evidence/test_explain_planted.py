"""Explanations name planted causes, and no cause where there is none."""

from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

import pytest
from planted_causes import (
    Case,
    explained,
    is_right,
    planted,
    unplanted,
    with_broken_promises,
    with_faults,
    with_late_messages,
    with_lost_messages,
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("made", "count", "least"),
    [
        (planted, 3, 3),
        (with_lost_messages, 2, 2),
        (with_late_messages, 2, 2),
        (with_faults, 3, 3),
        (with_broken_promises, 2, 2),
        (unplanted, 10, 10),
    ],
)
def test_the_first_cause_is_the_planted_one_and_none_is_named_without_one(
    made: Callable[[Path], Iterator[Case]], count: int, least: int, tmp_path: Path
) -> None:
    """`benchmarks/explain.py` tries more cases."""
    right = sum(is_right(case, explained(case)) for case in islice(made(tmp_path), count))
    assert right >= least
