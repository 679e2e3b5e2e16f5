"""The table of a sweep: one row per run, in order of the index, independent of where it was executed."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from symaware_cli.language import Catalogue
from symaware_cli.studies.custom_metrics import CustomMetrics
from symaware_cli.studies.metrics import BUILT_IN, MOST_AGENTS, PREFIX
from symaware_cli.studies.sweep_error import SweepError
from symaware_cli.studies.sweep_journal import JournalRecord
from symaware_cli.studies.sweep_plan import SweepPlan
from symaware_cli.studies.table_file import PLANNED, write

if TYPE_CHECKING:
    import pyarrow

#: The number of rows held in memory at a time, which is also the size of a row group of the file.
_AT_ONCE = 16_384


def schema(plan: SweepPlan, specifications: Sequence[str]) -> pyarrow.Schema:
    """Return the columns of the table of a plan; units and descriptions are in the metadata of the fields."""
    import pyarrow

    text, integer, number = pyarrow.string(), pyarrow.int64(), pyarrow.float64()
    by_agent = pyarrow.list_(pyarrow.struct([("agent", text), ("verdict", text), ("robustness", number)]))
    times = pyarrow.list_(pyarrow.struct([("agent", text), ("time", number)]))
    series = pyarrow.list_(pyarrow.struct([("time", number), ("value", number)]))
    types = {"number": number, "integer": integer, "truth": pyarrow.bool_(), "text": text, "times": times}
    types["series"] = series

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
        said = f"what became of {name} for each agent or pair, the worst {MOST_AGENTS} of them first"
        fields.append(field(f"{PREFIX}{name}", by_agent, said))
    for each in [*BUILT_IN, *CustomMetrics(plan.document, Catalogue()).descriptions()]:
        fields.append(field(each.name, types[each.kind], each.description, each.unit, each.version))
    fields += [
        field("digest", text, "a hash of the states and control inputs at every step"),
        field("error", text, "why the run is not done"),
    ]
    return pyarrow.schema(fields, {"symaware.sweep": "1", PLANNED: str(plan.count)})


def batches(
    records: Iterator[JournalRecord], plan: SweepPlan, specifications: Sequence[str]
) -> Iterator[pyarrow.RecordBatch]:
    """Yield the records of a journal as columns, a bounded number of rows at a time.

    Args:
        records: The records, in order of their index.
        plan: The plan of the sweep.
        specifications: The names of the specifications.

    Raises:
        SweepError: The journal contains a value that no run can produce.
    """
    import pyarrow

    columns = schema(plan, specifications)
    while some := list(islice(records, _AT_ONCE)):
        try:
            values = _columns(some, plan)
            # Values that no row has, such as the verdict of another cell's specification, are missing.
            arrays = [
                pyarrow.array(_told(values[field.name], field.type), field.type)
                if field.name in values
                else pyarrow.nulls(len(some), field.type)
                for field in columns
            ]
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            raise SweepError(f"the journal is damaged: runs {some[0].index} to {some[-1].index}: {error}") from error
        yield pyarrow.RecordBatch.from_arrays(arrays, schema=columns)


def write_times(path: Path, times: Iterator[tuple[int, float]]) -> None:
    """Write the wall times of runs, apart from the table because they alone differ between repetitions."""
    import pyarrow

    columns = pyarrow.schema(
        [
            pyarrow.field("index", pyarrow.int64()),
            pyarrow.field("wall_time", pyarrow.float64(), metadata={"unit": "s", "description": "what the run took"}),
        ]
    )

    def content() -> Iterator[pyarrow.RecordBatch]:
        while some := list(islice(times, _AT_ONCE)):
            arrays = [pyarrow.array(each) for each in zip(*some, strict=True)]
            yield pyarrow.RecordBatch.from_arrays(arrays, schema=columns)

    write(path, content(), columns)


def _columns(records: Sequence[JournalRecord], plan: SweepPlan) -> Mapping[str, Sequence[Any]]:
    """Return the values of all rows by column."""
    fields = JournalRecord(*zip(*records, strict=True))
    found: dict[str, Sequence[Any]] = {
        "index": fields.index,
        "replicate": [plan.replicate(index) for index in fields.index],
        "variant": fields.variant,
        "seed": fields.seed,
        "state": fields.state,
        "digest": fields.digest,
        "error": fields.error,
    }
    for prefix, texts in (
        ("", fields.parameters),
        ("verdict.", fields.verdicts),
        ("robustness.", fields.robustness),
        ("", fields.metrics),
    ):
        # Parsed all at once, which takes half as long as one by one.
        contents = json.loads(f"[{','.join(texts)}]")
        for name in dict.fromkeys(chain.from_iterable(contents)):
            found[prefix + name] = [each.get(name) for each in contents]
    return found


def _kind(values: Sequence[Any]) -> str:
    """Return the type of a column that can hold all values."""
    if all(isinstance(each, bool) for each in values):
        return "truth"
    if any(isinstance(each, bool) or not isinstance(each, int | float) for each in values):
        return "text"
    return "integer" if all(isinstance(each, int) for each in values) else "number"


def _told(values: Sequence[Any], kind: pyarrow.DataType) -> Sequence[Any]:
    """Return the values of a column; non-text values in a column of texts are written as JSON."""
    import pyarrow

    if not pyarrow.types.is_string(kind) or all(each is None or isinstance(each, str) for each in values):
        return values
    return [each if each is None or isinstance(each, str) else json.dumps(each, ensure_ascii=False) for each in values]
