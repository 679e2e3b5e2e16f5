"""Conditions on the rows of a sweep's table."""

from typing import Any

import pyarrow
import pytest

from symaware_cli.studies.sweep_error import SweepError
from symaware_cli.studies.sweep_query import array_of, query

TABLE = pyarrow.table(
    {
        "index": [0, 1, 2],
        "number": [1.0, None, 3.0],
        "text": ["x", None, "y"],
        "truth": [True, False, True],
        "whole": [3, None, 4],
        "nothing": pyarrow.nulls(3, pyarrow.float64()),
        "silence": pyarrow.nulls(3, pyarrow.string()),
    }
)


@pytest.mark.parametrize(
    ("where", "expected"),
    [
        ("number < 2", [0]),
        ("number == 1 or text == 'y'", [0, 2]),
        ("text != 'x'", [1, 2]),
        ("truth", [0, 2]),
        ("not truth", [1]),
        ("whole >= 4", [2]),
        ("index % 2 == 0", [0, 2]),
        ("nothing < 1", []),
        ("silence == 'x'", []),
    ],
)
def test_a_missing_value_satisfies_no_comparison(where: str, expected: list[int]) -> None:
    assert query(TABLE, where)["index"].to_pylist() == expected
    assert query(TABLE.slice(0, 0), where).num_rows == 0


def test_rows_without_a_value_are_sorted_last() -> None:
    assert query(TABLE, None, "number")["index"].to_pylist() == [0, 2, 1]
    assert query(TABLE, None, "-number", 2)["index"].to_pylist() == [2, 0]


@pytest.mark.parametrize(
    ("where", "expected"),
    [
        ("abs(number - 3) < 1", [2]),
        ("truth implies whole > 3", [1, 2]),
        ("0 < index < 2 or max(number, index) >= 3", [1, 2]),
        ("number != 1", [2]),
        ("norm(number) > 2 and not (text == 'x')", [2]),
    ],
)
def test_conditions_on_rows_support_the_operators_of_other_conditions(where: str, expected: list[int]) -> None:
    assert query(TABLE, where)["index"].to_pylist() == expected


@pytest.mark.parametrize(
    ("where", "said"),
    [
        ("number < 'x'", "a text is not a number"),
        ("number", "a number is not a condition"),
        ("always truth", "`always` belongs in a specification"),
        ("truth & number > 1", "write `and` instead of `&`"),
        ("inside(number, text)", "no function `inside`"),
    ],
)
def test_invalid_conditions_on_rows_are_rejected(where: str, said: str) -> None:
    with pytest.raises(SweepError, match=said):
        query(TABLE, where)


def test_an_array_of_a_column_has_what_its_list_has() -> None:
    chunks: dict[pyarrow.DataType, list[list[Any]]] = {
        pyarrow.float64(): [[0.5, None], [2.5]],
        pyarrow.int64(): [[1, 2], [3]],
        pyarrow.bool_(): [[True, False], []],
        pyarrow.string(): [["a", None], ["b"]],
    }
    for kind, parts in chunks.items():
        column = pyarrow.chunked_array([pyarrow.array(part, kind) for part in parts], kind)
        found = [None if each != each else each for each in array_of(column).tolist()]
        assert found == column.to_pylist()
        assert len(array_of(column.slice(0, 0))) == 0
    nothing = pyarrow.chunked_array([pyarrow.nulls(2, pyarrow.string())])
    assert array_of(nothing).tolist() == [None, None]
