"""A table for every agent: any number of rows, of which the column remembers whose were written."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from symaware_cli.awareness.table_column import TableColumn


def test_each_agent_has_as_many_rows_as_were_written() -> None:
    column = TableColumn(3, 2)
    assert column.row(1).shape == (0, 2)
    column.set([[[1, 2]], [], [[3, 4], [5, 6]]])
    assert [len(table) for table in column.tables] == [1, 0, 2]
    column.set_row(1, [[7, 8]])
    assert column.row(1).tolist() == [[7, 8]]


def test_what_was_written_since_is_told_once() -> None:
    column = TableColumn(3, 1)
    assert column.take_changes() == []
    column.set_row(2, [[1.0]])
    column.set_row(0, [])
    assert column.take_changes() == [0, 2]
    column.set([[], [], []])
    assert column.take_changes() is None
    assert column.take_changes() == []


def test_a_table_that_was_handed_out_never_changes() -> None:
    column = TableColumn(1, 1)
    given = np.array([[1.0]])
    column.set([given])
    given[0] = 2.0
    before = column.row(0)
    column.set_row(0, [[3.0]])
    assert before.tolist() == [[1.0]]
    with pytest.raises(ValueError, match="read-only"):
        before[0] = 4.0


@pytest.mark.parametrize(
    ("write", "said"),
    [
        (lambda column: column.set([[]]), "a table for each of 2 agents, not 1"),
        (lambda column: column.set_row(0, [[1.0]]), r"shape \(any, 2\), not \(1, 1\)"),
        (lambda column: column.set_row(0, [1.0, 2.0]), r"not \(2,\)"),
    ],
)
def test_what_does_not_fit_is_refused(write: Callable[..., Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        write(TableColumn(2, 2))
