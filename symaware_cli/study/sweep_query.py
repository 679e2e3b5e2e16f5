"""Rows of a sweep's table that are asked for: which, in what order, how many."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np

from symaware_cli.recording.error import UnknownNameError
from symaware_cli.specification.node import Arithmetic, Comparison, Constant, Element, Junction, Name, Node, Not, Sign
from symaware_cli.specification.parser import parse
from symaware_cli.specification.token import ExpressionError
from symaware_cli.study.sweep_error import SweepError

if TYPE_CHECKING:
    import pyarrow

#: The most characters of a condition.
_LONGEST = 500

_OPERATORS: Mapping[str, Callable[[Any, Any], Any]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "%": operator.mod,
    "**": operator.pow,
    "and": np.logical_and,
    "or": np.logical_or,
}


def query(
    table: pyarrow.Table, where: str | None = None, sort: str | None = None, limit: int | None = None
) -> pyarrow.Table:
    """Return some rows of a table.

    Args:
        table: The table.
        where: A condition on its columns, such as ``closest < 0.6 and verdict.safe == "violated"``. A path that varies
            may be called by its last part, where no other column has that.
        sort: The column to sort by, in descending order if a minus stands before it; rows without a value come last.
        limit: How many rows, at most.

    Raises:
        SweepError: The condition is not valid.
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
    """Return the name of the column that is meant.

    Raises:
        UnknownNameError: There is none.
    """
    if name in table.column_names:
        return name
    found: list[str] = [each for each in table.column_names if each.endswith(f".{name}")]
    if len(found) != 1:
        which = f"; {' and '.join(found)} are called so" if found else ""
        raise UnknownNameError(f"the table has no column `{name}`{which}", name, table.column_names)
    return found[0]


def _single(table: pyarrow.Table, name: str) -> str:
    """Return the name of a column whose rows have one value each.

    Raises:
        SweepError: They have lists.
    """
    import pyarrow

    if pyarrow.types.is_list(table[name].type):
        raise SweepError(f"`{name}` is a list in each row, which is neither compared nor sorted by")
    return name


def _mask(table: pyarrow.Table, where: str) -> Any:
    import pyarrow

    names = {part for each in table.column_names for part in (each.partition(".")[0], each.rpartition(".")[2])}
    try:
        # Not an `Expression`, whose module takes half a second to import.
        tree = parse(where, names, {}, longest=_LONGEST)
        found = np.broadcast_to(np.asarray(_value(tree, table)), table.num_rows)
    except ExpressionError as error:
        known = f"; there are {', '.join(error.names)}" if error.names else ""
        raise SweepError(f"--where: {error.problem}{known}") from None
    except TypeError as error:
        raise SweepError(f"--where: `{where}` compares a number with a text") from error
    if found.dtype != bool:
        raise SweepError(f"--where: `{where}` is neither true nor false")
    # `pyarrow.array` would import pandas, if that is installed, and a part of NumPy that is needed nowhere else.
    bits = pyarrow.py_buffer(np.packbits(found, bitorder="little"))
    return pyarrow.BooleanArray.from_buffers(pyarrow.bool_(), len(found), [None, bits])


def _value(node: Node, table: pyarrow.Table) -> Any:
    """Evaluate a tree for all rows at once; a number that a row does not have compares with nothing."""
    match node:
        case Constant(value=value):
            return value
        case Name() | Element():
            return _column(table, ".".join(_parts(node)))
        case Sign(operator=sign, operand=operand):
            return _value(operand, table) if sign == "+" else -_value(operand, table)
        case Not(operand=operand):
            return np.logical_not(_value(operand, table))
        case Arithmetic():
            with np.errstate(all="ignore"):
                return _OPERATORS[node.operator](_value(node.left, table), _value(node.right, table))
        case Comparison():
            values = [_value(each, table) for each in node.operands]
            pairs = zip(node.operators, values, values[1:], strict=False)
            return reduce(np.logical_and, [_OPERATORS[each](left, right) for each, left, right in pairs])
        case Junction(operator="and" | "or"):
            return reduce(_OPERATORS[node.operator], [_value(each, table) for each in node.operands])
    raise ExpressionError("a condition on rows has comparisons, arithmetic, `and`, `or` and `not`", node.span)


def _parts(node: Node) -> Sequence[str]:
    if isinstance(node, Element):
        return [*_parts(node.operand), str(node.key)]
    if isinstance(node, Name):
        return [node.name]
    raise ExpressionError("this is no column", node.span)


def _column(table: pyarrow.Table, name: str) -> Any:
    """Return the values of a column: numbers, truths, or texts as objects; what is missing is NaN or None."""
    import pyarrow

    # Not by `to_numpy`, which imports pandas, if that is installed.
    values = table[_single(table, column(table, name))].combine_chunks()
    if pyarrow.types.is_string(values.type):
        coded = values.dictionary_encode()
        texts = np.array([*coded.dictionary.to_pylist(), None], object)
        return texts[np.from_dlpack(coded.indices.fill_null(len(texts) - 1))]
    if values.null_count:
        return np.from_dlpack(values.cast(pyarrow.float64()).fill_null(np.nan))
    if pyarrow.types.is_boolean(values.type):
        return np.from_dlpack(values.cast(pyarrow.int8())).astype(bool)
    return np.from_dlpack(values)
