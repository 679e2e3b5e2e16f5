"""The table of a sweep: one row a run in order of its index, whoever made it."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from symaware_cli.scenario.catalogue import Catalogue
from symaware_cli.study.custom_metrics import CustomMetrics
from symaware_cli.study.metrics import BUILT_IN
from symaware_cli.study.row import Row
from symaware_cli.study.sweep_plan import SweepPlan

if TYPE_CHECKING:
    import pyarrow

#: How many rows are in memory at a time, which is also a row group of the file.
_AT_ONCE = 65_536


def schema(plan: SweepPlan, specifications: Sequence[str]) -> pyarrow.Schema:
    """Return the columns of the table of a plan; units and descriptions are in the metadata of the fields."""
    import pyarrow

    text, integer, number = pyarrow.string(), pyarrow.int64(), pyarrow.float64()
    times = pyarrow.list_(pyarrow.struct([("agent", text), ("time", number)]))
    types = {"number": number, "integer": integer, "truth": pyarrow.bool_(), "text": text, "times": times}

    def field(name: str, kind: pyarrow.DataType, description: str, unit: str = "", version: int = 0) -> pyarrow.Field:
        notes = {"description": description, "unit": unit, "version": str(version or "")}
        return pyarrow.field(name, kind, metadata={key: note for key, note in notes.items() if note})

    fields = [
        field("index", integer, "the number of the run"),
        field("replicate", integer, "the number of the run among those with the same parameters and variant"),
    ]
    if plan.document.variants:
        fields.append(field("variant", text, "the variant of the scenario"))
    for target in plan.paths:
        drawn = plan.document.drawn.get(target)
        kind = _kind(drawn.landmarks if drawn else [cell.parameters[target] for cell in plan.cells])
        fields.append(field(target, types[kind], "a value of the scenario that varies"))
    fields += [
        field("seed", integer, "the seed of the run"),
        field("state", text, "done, failed or lost"),
    ]
    for name in specifications:
        fields.append(field(f"verdict.{name}", text, f"satisfied, violated or undecided: the specification {name}"))
        fields.append(field(f"robustness.{name}", number, f"the robustness of the specification {name}"))
    for each in [*BUILT_IN, *CustomMetrics(plan.document, Catalogue()).descriptions()]:
        fields.append(field(each.name, types[each.kind], each.description, each.unit, each.version))
    fields += [
        field("digest", text, "a hash of the states and control inputs at every step"),
        field("error", text, "why the run is not done"),
    ]
    return pyarrow.schema(fields, {"symaware.sweep": "1"})


def batches(rows: Iterator[Row], plan: SweepPlan, specifications: Sequence[str]) -> Iterator[pyarrow.RecordBatch]:
    """Yield rows as columns, a bounded number at a time.

    Args:
        rows: In order of their index.
        plan: Whose rows they are.
        specifications: The names of the specifications.
    """
    import pyarrow

    columns = schema(plan, specifications)
    while some := list(islice(rows, _AT_ONCE)):
        values = [_values(row, plan) for row in some]
        arrays = [
            pyarrow.array([_as(each.get(field.name), field.type) for each in values], field.type) for field in columns
        ]
        yield pyarrow.RecordBatch.from_arrays(arrays, schema=columns)


def write(path: Path, content: Iterator[pyarrow.RecordBatch], columns: pyarrow.Schema) -> None:
    """Write a Parquet file that appears as a whole."""
    import pyarrow
    from pyarrow import parquet

    draft = path.with_name(f".{path.name}")
    with parquet.ParquetWriter(draft, columns, compression="zstd") as writer:
        for batch in content:
            writer.write_table(pyarrow.Table.from_batches([batch]))
    os.replace(draft, path)


def write_times(path: Path, rows: Iterator[Row]) -> None:
    """Write how long each run took, which is the only thing about it that differs from time to time."""
    import pyarrow

    columns = pyarrow.schema(
        [
            pyarrow.field("index", pyarrow.int64()),
            pyarrow.field("wall_time", pyarrow.float64(), metadata={"unit": "s", "description": "what the run took"}),
        ]
    )

    def content() -> Iterator[pyarrow.RecordBatch]:
        while some := list(islice(rows, _AT_ONCE)):
            arrays = [[row.index for row in some], [row.wall_time for row in some]]
            yield pyarrow.RecordBatch.from_arrays([pyarrow.array(each) for each in arrays], schema=columns)

    write(path, content(), columns)


def _values(row: Row, plan: SweepPlan) -> Mapping[str, Any]:
    cell = plan.cell(row.index)
    return {
        "index": row.index,
        "replicate": plan.replicate(row.index),
        "variant": cell.variant,
        **plan.parameters(row.index),
        "seed": plan.seed(row.index),
        "state": row.state,
        **{f"verdict.{name}": each for name, each in row.verdicts.items()},
        **{f"robustness.{name}": each for name, each in row.robustness.items()},
        **row.metrics,
        "digest": row.digest,
        "error": row.error,
    }


def _kind(values: Sequence[Any]) -> str:
    """The type of a column in which all values have their place."""
    if all(isinstance(each, bool) for each in values):
        return "truth"
    if any(isinstance(each, bool) or not isinstance(each, int | float) for each in values):
        return "text"
    return "integer" if all(isinstance(each, int) for each in values) else "number"


def _as(value: Any, kind: pyarrow.DataType) -> Any:
    import pyarrow

    if value is not None and pyarrow.types.is_string(kind) and not isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return value
