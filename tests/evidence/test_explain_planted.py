"""Explanations name planted causes, and no cause where there is none."""

import os
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

#: How many cases of each kind are explained, and five times as many without a cause. All 400 are those of 40.
CASES = int(os.environ.get("SYMAWARE_PLANTED", "2"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("made", "count"),
    [
        (planted, CASES),
        (with_lost_messages, CASES),
        (with_late_messages, CASES),
        (with_faults, CASES),
        (with_broken_promises, CASES),
        (unplanted, 5 * CASES),
    ],
)
def test_the_first_cause_is_the_planted_one_and_none_is_named_without_one(
    made: Callable[[Path], Iterator[Case]], count: int, tmp_path: Path
) -> None:
    """In 19 of 20 cases at least; `benchmarks/explain.py` prints intervals."""
    right = sum(is_right(case, explained(case)) for case in islice(made(tmp_path), count))
    assert right >= count - count // 20
