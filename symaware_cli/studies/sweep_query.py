"""Queries on the table of a sweep: filter, order and number of rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log import UnknownNameError
from symaware_cli.specification import ExpressionError, parse
from symaware_cli.specification.columns import ARGUMENTS, KindError, check_momentary, truth
from symaware_cli.specification.node import Element, Name, Node, with_children
from symaware_cli.studies.sweep_error import SweepError

if TYPE_CHECKING:
    import pyarrow

#: The maximum length of a condition [characters].
_LONGEST = 500


def query(
    table: pyarrow.Table, where: str | None = None, sort: str | None = None, limit: int | None = None
) -> pyarrow.Table:
    """Return the rows of a table that match a query.

    Args:
        table: The table.
        where: A condition on its columns, such as ``closest < 0.6 and verdict.safe == "violated"``. A varied parameter
            may be named by the last part of its path if no other column ends with it.
        sort: The column to sort by, in descending order if prefixed with a minus; rows without a value come last.
        limit: The maximum number of rows.

    Raises:
        SweepError: The condition is invalid.
        UnknownNameError: There is no such column.
    """
    if where is not None:
        table = table.filter(_mask(table, where))
    if sort is not None:
        name = _single(table, column(table, sort.removeprefix("-")))
        order = "descending" if sort.startswith("-") else "ascending"
        table = table.sort_by([(name, order), ("index", "ascending")])
    return table if limit is None else table.slice(0, limit)


def column(table: pyarrow.Table, name: str) -> str:
    """Return the full name of a column.

    Raises:
        UnknownNameError: There is no such column.
    """
    if name in table.column_names:
        return name
    found: list[str] = [each for each in table.column_names if each.endswith(f".{name}")]
    if len(found) != 1:
        which = f"; {' and '.join(found)} are called so" if found else ""
        raise UnknownNameError(f"the table has no column `{name}`{which}", name, table.column_names)
    return found[0]


def _single(table: pyarrow.Table, name: str) -> str:
    """Return the name of a column after checking that it contains one value per row.

    Raises:
        SweepError: The column contains lists.
    """
    import pyarrow

    if pyarrow.types.is_list(table[name].type):
        raise SweepError(f"`{name}` is a list in each row, which is neither compared nor sorted by")
    return name


def _mask(table: pyarrow.Table, where: str) -> Any:
    import pyarrow

    names = {part for each in table.column_names for part in (each.partition(".")[0], each.rpartition(".")[2])}
    functions = {name: count for name, count in ARGUMENTS.items() if name not in ("inside", "signed_distance")}
    try:
        # Not an `Expression`, because its module takes half a second to import.
        tree = parse(where, names, functions, longest=_LONGEST)
        check_momentary(tree, "a specification: a row has no instants")
        holds = truth(_with_columns(tree))
        with np.errstate(all="ignore"):
            found = np.broadcast_to(holds(lambda name: _column(table, name)), table.num_rows)
    except ExpressionError as error:
        known = f"; there are {', '.join(error.names)}" if error.names else ""
        raise SweepError(f"--where: {error.problem}{known}") from None
    except KindError as error:
        raise SweepError(f"--where: `{where}`: {error}") from error
    # `pyarrow.array` would import pandas, if installed, and a part of NumPy that is not needed elsewhere.
    bits = pyarrow.py_buffer(np.packbits(found, bitorder="little"))
    return pyarrow.BooleanArray.from_buffers(pyarrow.bool_(), len(found), [None, bits])


def _with_columns(node: Node) -> Node:
    """Return a condition with dotted names of columns, such as ``verdict.safe``, replaced by single names."""
    if isinstance(node, Element):
        return Name(node.span, ".".join(_parts(node)))
    return with_children(node, _with_columns)


def _parts(node: Node) -> Sequence[str]:
    if isinstance(node, Element):
        return [*_parts(node.operand), str(node.key)]
    if isinstance(node, Name):
        return [node.name]
    raise ExpressionError("this is no column", node.span)


def _column(table: pyarrow.Table, name: str) -> Any:
    """Return the values of a column: numbers, booleans, or texts as objects; missing values are NaN or None."""
    return array_of(table[_single(table, column(table, name))])


def array_of(column: pyarrow.ChunkedArray) -> Any:
    """Return the values of a column of numbers, booleans or texts, (k,), which may be read-only.

    Texts are objects. Missing values are None among texts, and NaN otherwise.
    """
    import pyarrow

    # Neither `to_numpy` nor `fill_null` nor `pyarrow.scalar`, which import pandas, if installed.
    values = column.combine_chunks()
    if pyarrow.types.is_string(values.type):
        coded = values.dictionary_encode()
        return _filled(coded.indices, None, np.array(coded.dictionary.to_pylist(), object))
    if values.null_count:
        return _filled(values.cast(pyarrow.float64()), np.nan)
    if pyarrow.types.is_boolean(values.type):
        return np.from_dlpack(values.cast(pyarrow.int8())).astype(bool)
    return np.from_dlpack(values)


def _filled(values: pyarrow.Array, missing: float | None, coded: NDArray[np.object_] | None = None) -> NDArray[Any]:
    """Return values, or what they are the codes of, with another value in place of those that are missing."""
    import pyarrow

    found = np.full(len(values), missing)
    there = np.from_dlpack(values.is_valid().cast(pyarrow.int8())).astype(bool)
    known = np.from_dlpack(values.drop_null())
    found[there] = known if coded is None else coded[known]
    return found
