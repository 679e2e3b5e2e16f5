"""The module `wire` writes the same bytes as the generated classes."""

import contextlib
import importlib.util
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from checkout import CHECKOUT
from google.protobuf.message import DecodeError
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from simulating import present

from symaware_cli.log import others_message, wire
from symaware_cli.log import symaware_v1_pb2 as v1

SCHEMAS = CHECKOUT / "schemas"

finite = st.floats(allow_nan=False, width=64)
layouts = st.sampled_from(["plain", "big-endian", "reversed", "column-major", "every other", "list"])


def tables() -> st.SearchStrategy[Any]:
    shapes = st.tuples(st.integers(0, 40), st.integers(1, 7))
    return shapes.flatmap(lambda shape: hnp.arrays(np.float64, shape, elements=finite))


def laid_out(array: np.ndarray, layout: str) -> NDArray[np.float64]:
    """The same numbers in another memory layout."""
    match layout:
        case "big-endian":
            return array.astype(">f8")
        case "reversed":
            return array[::-1].copy()[::-1]
        case "column-major":
            return np.asfortranarray(array)
        case "every other":
            wide = np.zeros((array.shape[0], 2 * array.shape[1]))
            wide[:, ::2] = array
            return wide[:, ::2]
        case "list":
            return array.tolist() if array.size else array
    return array


def row_indices(count: int) -> st.SearchStrategy[Any]:
    return st.none() | st.lists(st.integers(0, 2**32 - 1), min_size=count, max_size=count, unique=True).map(sorted)


@given(st.data(), tables(), layouts)
def test_rows_are_written_byte_for_byte_as_the_generated_class_writes_them(
    data: st.DataObject, values: NDArray[np.float64], layout: str
) -> None:
    rows = data.draw(row_indices(len(values)))
    written = wire.encode_rows(laid_out(values, layout), rows)
    expected = v1.Rows(columns=values.shape[1], rows=rows or [], values=values.ravel())
    assert written == expected.SerializeToString()
    decoded = wire.decode_rows(written)
    assert np.array_equal(decoded.values, values)
    assert decoded.rows is None if not rows else present(decoded.rows).tolist() == rows


times = st.integers(-(2**63), 2**63 - 1)


@given(st.data(), st.integers(0, 10), st.integers(0, 6), st.integers(1, 4))
def test_series_with_shared_times_are_written_as_the_generated_class_writes_them(
    data: st.DataObject, count: int, points: int, columns: int
) -> None:
    rows = data.draw(row_indices(count))
    stamps = data.draw(st.lists(times, min_size=points, max_size=points))
    values = data.draw(hnp.arrays(np.float64, (count, points, columns), elements=finite))
    written = wire.encode_series(stamps, values, rows=rows)
    expected = v1.SeriesRows(columns=columns, rows=rows or [], lengths=[points], times=stamps, values=values.ravel())
    assert written == expected.SerializeToString()
    series = list(wire.decode_series(written))
    if points:
        assert len(series) == count
    for (at, row), original in zip(series, values, strict=False):
        assert at.tolist() == stamps
        assert np.array_equal(row, original)


@given(st.data(), st.lists(st.integers(0, 6), max_size=10), st.integers(1, 4))
def test_series_with_times_of_their_own_are_written_as_the_generated_class_writes_them(
    data: st.DataObject, lengths: list[int], columns: int
) -> None:
    rows = data.draw(row_indices(len(lengths)))
    total = sum(lengths)
    stamps = data.draw(st.lists(times, min_size=total, max_size=total))
    values = data.draw(hnp.arrays(np.float64, (total, columns), elements=finite))
    written = wire.encode_series(stamps, values, lengths, rows)
    expected = v1.SeriesRows(columns=columns, rows=rows or [], lengths=lengths, times=stamps, values=values.ravel())
    assert written == expected.SerializeToString()
    series = list(wire.decode_series(written))
    if len(lengths) > 1:
        assert [len(at) for at, _ in series] == lengths
    if total:
        assert np.array_equal(np.concatenate([row for _, row in series]), values)
        assert np.concatenate([at for at, _ in series]).tolist() == stamps


@given(st.data(), st.lists(st.integers(0, 5), max_size=8), st.booleans())
def test_awareness_is_written_as_the_generated_class_writes_it(
    data: st.DataObject, lengths: list[int], uniform: bool
) -> None:
    rows = data.draw(row_indices(len(lengths)))
    known = sum(lengths)
    entities = data.draw(st.lists(st.integers(0, 2**32 - 1), min_size=known, max_size=known))
    columns = [3] if uniform else data.draw(st.lists(st.integers(0, 4), min_size=known, max_size=known))
    size = 3 * known if uniform else sum(columns)
    values = data.draw(hnp.arrays(np.float64, size, elements=finite))
    squares = 9 * known if uniform else sum(each * each for each in columns)
    spread = data.draw(hnp.arrays(np.float64, data.draw(st.sampled_from([0, squares])), elements=finite))
    ages = data.draw(hnp.arrays(np.float64, data.draw(st.sampled_from([0, known])), elements=finite))
    written = others_message.encode_awareness(lengths, entities, columns, values, rows, covariances=spread, ages=ages)
    expected = v1.Awareness(
        rows=rows or [],
        lengths=lengths,
        entities=entities,
        columns=columns,
        values=values,
        covariances=spread,
        ages=ages,
    )
    assert written == expected.SerializeToString()
    decoded = others_message.decode_awareness(written)
    assert decoded.lengths.tolist() == lengths
    assert decoded.entities.tolist() == entities
    assert decoded.columns.tolist() == columns
    assert np.array_equal(decoded.values, values)
    assert not decoded.world


@given(st.data(), st.lists(st.integers(0, 3), max_size=5))
def test_series_of_others_are_written_as_the_generated_class_writes_them(
    data: st.DataObject, lengths: list[int]
) -> None:
    def drawn(elements: st.SearchStrategy[Any], count: int) -> Any:
        return data.draw(st.lists(elements, min_size=count, max_size=count))

    known = sum(lengths)
    rows = data.draw(row_indices(len(lengths)))
    entities, columns, points = (drawn(st.integers(0, most), known) for most in (2**32 - 1, 4, 3))
    stamps = drawn(times, sum(points))
    values = drawn(finite, sum(size * count for size, count in zip(columns, points, strict=True)))
    written = others_message.encode_others_series("risk", lengths, entities, columns, points, stamps, values, rows)
    own: dict[str, Any] = {
        "part": "risk",
        "rows": rows or [],
        "lengths": lengths,
        "entities": entities,
        "columns": columns,
    }
    expected = v1.Awareness(series=[v1.OthersSeries(**own, points=points, times=stamps, values=values)])
    assert written == expected.SerializeToString()


def test_knowing_the_whole_world_takes_two_bytes() -> None:
    assert v1.Awareness(world=True).SerializeToString() == others_message.WHOLE_WORLD
    assert others_message.decode_awareness(others_message.WHOLE_WORLD).world


@pytest.mark.parametrize("size", [15, 16, 17, 2047, 2048, 100_000])
def test_lengths_of_every_size_of_varint_are_written(size: int) -> None:
    values = np.arange(size, dtype=float)[:, None]
    written = wire.encode_rows(values)
    assert written == v1.Rows(columns=1, values=values.ravel()).SerializeToString()
    assert np.array_equal(wire.decode_rows(written).values, values)


def test_a_nan_keeps_its_bits() -> None:
    values = np.array([[np.nan, -np.nan, np.inf, -0.0]])
    assert wire.decode_rows(wire.encode_rows(values)).values.tobytes() == values.tobytes()


def test_integers_are_written_as_the_numbers_they_are() -> None:
    assert wire.decode_rows(wire.encode_rows(np.array([[1, 2]]), np.array([5]))).values.tolist() == [[1.0, 2.0]]


def test_decoding_makes_no_copies() -> None:
    decoded = wire.decode_rows(wire.encode_rows(np.ones((4, 2)), range(4)))
    assert decoded.values.base is not None
    assert not decoded.values.flags.writeable


def test_a_message_in_another_layout_is_read_with_the_generated_class() -> None:
    split = v1.Rows(columns=2, values=[1, 2]).SerializeToString() + v1.Rows(values=[3, 4]).SerializeToString()
    assert wire.decode_rows(split).values.tolist() == [[1, 2], [3, 4]]
    unpacked = b"\x08\x02" + b"".join(b"\x19" + np.float64(value).tobytes() for value in (1, 2))
    assert wire.decode_rows(unpacked).values.tolist() == [[1, 2]]
    later = v1.Rows(columns=1, rows=[3], values=[4]).SerializeToString() + b"\xaa\x06\x03new"
    assert present(wire.decode_rows(later).rows).tolist() == [3]
    series = v1.SeriesRows(lengths=[1], times=[1]).SerializeToString() + v1.SeriesRows(times=[2]).SerializeToString()
    assert wire.decode_series(series).times.tolist() == [1, 2]
    known = v1.Awareness(entities=[1]).SerializeToString() + v1.Awareness(entities=[2]).SerializeToString()
    assert others_message.decode_awareness(known).entities.tolist() == [1, 2]


@given(st.binary(max_size=60))
def test_noise_is_refused_with_a_value_error_or_a_decode_error(noise: bytes) -> None:
    for decode in (wire.decode_rows, wire.decode_series, others_message.decode_awareness):
        with contextlib.suppress(ValueError, DecodeError):
            decode(noise)


@pytest.mark.parametrize(
    "call",
    [
        lambda: wire.encode_rows([1.0, 2.0]),
        lambda: wire.encode_rows([[1.0]], [1, 2]),
        lambda: wire.encode_series([0, 1], [[[1.0]]]),
        lambda: wire.encode_series([0], [[1.0]], [2]),
        lambda: others_message.encode_awareness([2], [1], [1], [1.0]),
        lambda: others_message.encode_awareness([1], [1], [2], [1.0]),
    ],
)
def test_shapes_that_do_not_fit_are_refused(call: Callable[..., Any]) -> None:
    with pytest.raises(ValueError, match=r"\d"):
        call()


def test_the_generated_code_is_fresh() -> None:
    spec = importlib.util.spec_from_file_location("generate", SCHEMAS / "generate.py")
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["generate"] = module
    assert spec.loader is not None
    spec.loader.exec_module(module)
    for path, text in module.generated().items():
        assert path.read_text() == text, f"{path.name} is stale: run python schemas/generate.py"
