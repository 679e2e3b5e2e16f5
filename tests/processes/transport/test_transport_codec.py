"""Frames as bytes: what is encoded comes back, and nothing else is ever taken for a frame."""

import subprocess
import sys
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from symaware_cli.core import AwarenessVector, Contact, Delivery, MessageBatch, TimeSeries
from symaware_cli.core.message import objects
from symaware_cli.engine.network import transport_pb2 as wire
from symaware_cli.engine.network.value import DEPTH, FrameError
from symaware_cli.processes.codec import decode, encode
from symaware_cli.processes.frame import (
    Checkpoint,
    End,
    Hello,
    Notice,
    Post,
    Refusal,
    Report,
    Step,
    Welcome,
)

# --- what can be sent -------------------------------------------------------------------------------------------------

TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
NAMES = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=8)
TIMES = st.integers(-(2**63), 2**63 - 1)
COUNTS = st.integers(0, 2**64 - 1)
NUMBERS = st.floats()
TYPES = st.one_of(
    arrays.boolean_dtypes(), arrays.integer_dtypes(), arrays.unsigned_integer_dtypes(), arrays.floating_dtypes()
)
SHAPES = arrays.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4)
ARRAYS = arrays.arrays(TYPES, SHAPES)
DOUBLES = arrays.arrays(np.float64, SHAPES)


@st.composite
def series(draw: st.DrawFn) -> TimeSeries:
    times = sorted(draw(st.sets(st.integers(-(2**61), 2**61), max_size=4)))
    return TimeSeries.sampled(times, draw(arrays.arrays(np.float64, (len(times), draw(st.integers(0, 3))))))


@st.composite
def vectors(draw: st.DrawFn) -> AwarenessVector:
    return AwarenessVector(
        draw(TEXTS), draw(arrays.arrays(np.float64, st.integers(0, 4))), draw(series()), draw(series()), draw(series())
    )


PLAIN = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**63), 2**64 - 1),
    NUMBERS,
    TEXTS,
    st.binary(max_size=8),
    ARRAYS,
    ARRAYS.map(lambda array: array.reshape(-1)).filter(len).map(lambda array: array[0]),
    series(),
    vectors(),
)
VALUES = st.recursive(
    PLAIN,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.lists(inner, max_size=3).map(tuple), st.dictionaries(TEXTS, inner, max_size=3)
    ),
    max_leaves=6,
)
PAYLOADS = st.dictionaries(TEXTS, VALUES, max_size=3)
CONTACTS = st.builds(Contact, NAMES, NAMES, st.lists(NUMBERS, max_size=3).map(tuple), NUMBERS, st.booleans(), NUMBERS)


def indices(size: int) -> st.SearchStrategy[Any]:
    return arrays.arrays(np.intp, size, elements=st.integers(0, 2**40))


@st.composite
def batches(draw: st.DrawFn) -> MessageBatch:
    links = sorted(draw(st.sets(st.tuples(st.integers(0, 2**40), st.integers(0, 2**40)), max_size=4)))
    senders, ends = (np.array([link[end] for link in links], np.intp) for end in (0, 1))
    receivers: NDArray[np.intp] | None = ends
    if draw(st.booleans()):
        senders, receivers = np.unique(senders), None
    count = len(senders)
    sides = SHAPES.map(lambda shape: (count, *shape[:2]))
    numbers = sides.flatmap(lambda shape: arrays.arrays(TYPES, shape))
    anything = st.lists(VALUES, min_size=count, max_size=count).map(objects)
    return MessageBatch(senders, draw(st.dictionaries(TEXTS, numbers | anything, max_size=3)), draw(TEXTS), receivers)


@st.composite
def deliveries(draw: st.DrawFn, batch: MessageBatch) -> Delivery:
    count = draw(st.integers(0, 4)) if len(batch.senders) else 0
    rows = arrays.arrays(np.intp, count, elements=st.integers(0, max(0, len(batch.senders) - 1)))
    whole = arrays.arrays(np.int64, count)
    return Delivery(batch, draw(rows), draw(indices(count)), draw(whole), draw(TIMES), draw(whole))


@st.composite
def steps(draw: st.DrawFn) -> Step:
    told = draw(st.lists(batches(), max_size=2))
    columns = [draw(deliveries(each)) for each in told for _ in range(draw(st.integers(1, 2)))]
    arrived = draw(st.permutations(columns))
    return Step(
        draw(COUNTS),
        draw(TIMES),
        draw(st.dictionaries(TEXTS, DOUBLES, max_size=3)),
        draw(st.lists(CONTACTS, max_size=2).map(tuple)),
        tuple(arrived),
        draw(NUMBERS),
    )


@st.composite
def reports(draw: st.DrawFn) -> Report:
    groups = draw(st.sets(TEXTS, max_size=2))
    inputs = {}
    for group in sorted(groups):
        count = draw(st.integers(0, 3))
        inputs[group] = draw(indices(count)), draw(arrays.arrays(np.float64, (count, draw(st.integers(0, 3)))))
    posts = st.lists(st.builds(Post, batches(), TIMES), max_size=2)
    peak = st.none() | st.tuples(NUMBERS, TEXTS)
    return Report(draw(COUNTS), inputs, tuple(draw(posts)), draw(peak), draw(st.none() | COUNTS))


CHECKPOINTS = st.builds(Checkpoint, st.binary(max_size=16), COUNTS)

FRAMES = st.one_of(
    st.builds(
        Hello, TEXTS, st.binary(max_size=32), TEXTS, st.lists(TEXTS, max_size=3).map(tuple), st.none() | CHECKPOINTS
    ),
    st.builds(Welcome, COUNTS, TIMES, NUMBERS, NUMBERS, st.binary(max_size=16), st.booleans(), st.none() | COUNTS),
    st.builds(Refusal, TEXTS, st.booleans()),
    steps(),
    reports(),
    st.builds(Notice, TEXTS, TEXTS, TEXTS, TEXTS, PAYLOADS),
    st.builds(End, TEXTS, TEXTS, TEXTS),
)


def plain(value: Any) -> Any:
    """A value in a form that compares equal exactly if the value is the same: type, shape and every bit."""
    if isinstance(value, np.ndarray) and value.dtype == object:
        return "objects", plain(value.tolist())
    if isinstance(value, np.ndarray | np.generic):
        little = np.asarray(value)
        little = little.astype(little.dtype.newbyteorder("<"))
        return type(value).__name__, little.dtype.str, little.shape, little.tobytes()
    if isinstance(value, float):
        return np.float64(value).tobytes()
    if isinstance(value, TimeSeries):
        return "series", plain(value.times), plain(value.values)
    if isinstance(value, AwarenessVector):
        return "awareness", *(plain(getattr(value, name)) for name in ("id", "state", "intent", "uncertainty", "risk"))
    if is_dataclass(value):
        return type(value).__name__, *(plain(getattr(value, each.name)) for each in fields(value))
    if isinstance(value, dict):
        return "dict", *((name, plain(each)) for name, each in value.items())
    if isinstance(value, list | tuple):
        return type(value).__name__, *(plain(each) for each in value)
    return type(value).__name__, value


# --- what must hold ---------------------------------------------------------------------------------------------------


@given(FRAMES)
@settings(max_examples=300, suppress_health_check=[HealthCheck.too_slow])
def test_every_frame_comes_back_as_it_was(frame: Any) -> None:
    assert plain(decode(encode(frame))) == plain(frame)


@given(FRAMES, st.data())
@settings(max_examples=300, suppress_health_check=[HealthCheck.too_slow])
def test_a_frame_that_was_damaged_is_refused_or_is_another_frame(frame: Any, data: st.DataObject) -> None:
    damaged = bytearray(encode(frame))
    for _ in range(data.draw(st.integers(1, 4))):
        if damaged:
            place = data.draw(st.integers(0, len(damaged) - 1))
            damaged[place] ^= 1 << data.draw(st.integers(0, 7))
    del damaged[data.draw(st.integers(0, len(damaged))) :]
    _decoded_or_refused(bytes(damaged))


@given(st.binary(max_size=200))
@example(b"")
@example(b"\xff" * 64)
@settings(max_examples=300)
def test_any_bytes_are_refused_or_are_a_frame(data: bytes) -> None:
    _decoded_or_refused(data)


def _decoded_or_refused(data: bytes) -> None:
    try:
        frame = decode(data)
    except FrameError:
        return
    encode(frame)


def test_deliveries_of_one_batch_send_it_once_and_share_it_again() -> None:
    batch = MessageBatch(np.array([1, 4]), {"state": np.zeros((2, 1000))})
    each = Delivery(batch, np.array([0]), np.array([3]), np.array([7]), 5, np.array([6]))
    data = encode(Step(0, 0, {}, arrived=(each, each, each)))
    assert len(data) < 1.1 * batch.columns["state"].nbytes
    frame = decode(data)
    assert isinstance(frame, Step)
    assert len({id(delivery.batch) for delivery in frame.arrived}) == 1


def test_arrays_of_either_byte_order_are_sent_as_the_same_numbers() -> None:
    frame = decode(encode(Notice("a", "b", "INFO", "", {"big": np.arange(3, dtype=">i4")})))
    assert isinstance(frame, Notice)
    assert frame.data["big"].dtype == "<i4"
    assert frame.data["big"].tolist() == [0, 1, 2]


class _Strange:
    pass


@pytest.mark.parametrize(
    ("value", "named"),
    [
        (_Strange(), "_Strange"),
        ({1, 2}, "set"),
        (1j, "complex"),
        (2**64, "65 bits"),
        (-(2**63) - 1, "64 bits"),
        (np.array([object()]), "object"),
        (np.array(["a"]), "<U1"),
        (np.zeros(1, np.complex128), "complex128"),
        (np.datetime64("2026-01-01"), "datetime64"),
        (np.empty((2**40, 0)), "1099511627776"),
        ({3: 1}, "int as a key"),
        ("\ud800", "str"),
        ([[[1, lambda: None]]], "function"),
    ],
)
def test_unsendable_values_are_refused_with_their_type(value: Any, named: str) -> None:
    with pytest.raises(TypeError, match=named):
        encode(Notice("a", "b", "INFO", "", {"value": value}))


def test_a_number_that_does_not_fit_its_field_is_refused() -> None:
    with pytest.raises(TypeError, match="Welcome"):
        encode(Welcome(-1, 0, 0.0, 0.0))


def _nested(depth: int) -> Any:
    value: Any = 1
    for _ in range(depth):
        value = [value]
    return value


def test_nesting_is_bounded_on_both_sides() -> None:
    frame = Notice("a", "b", "INFO", "", {"value": _nested(DEPTH)})
    assert decode(encode(frame)) == frame
    with pytest.raises(TypeError, match="16"):
        encode(Notice("a", "b", "INFO", "", {"value": _nested(DEPTH + 1)}))
    value = wire.Value(truth=True)
    for _ in range(1000):
        value = wire.Value(list=wire.Items(values=[value.SerializeToString()]))
    entry = wire.Entry(name="value", value=value).SerializeToString()
    with pytest.raises(FrameError, match="16"):
        decode(wire.Frame(notice=wire.Notice(data=[entry])).SerializeToString())


def _array(shape: list[int], data: bytes, dtype: int = wire.Array.FLOAT64) -> wire.Array:
    return wire.Array(type=dtype, shape=shape, data=data)  # type: ignore[arg-type]


def _whole(*numbers: int) -> wire.Array:
    return _array([len(numbers)], np.array(numbers, "<i8").tobytes(), wire.Array.INT64)


def _entry(name: str, array: wire.Array) -> bytes:
    return wire.Entry(name=name, value=wire.Value(array=array)).SerializeToString()


def _batch(**changes: Any) -> bytes:
    return wire.MessageBatch(**{"senders": _whole(1, 2), **changes}).SerializeToString()


def _delivery(**changes: Any) -> bytes:
    parts = {name: _whole(0) for name in ("rows", "receivers", "sequences", "due")}
    return wire.Delivery(**{**parts, **changes}).SerializeToString()


def _input(**changes: Any) -> bytes:
    parts = {"group": "a", "rows": _whole(0), "inputs": _array([1, 1], bytes(8))}
    return wire.Input(**{**parts, **changes}).SerializeToString()


BAD = {
    "no content": wire.Frame(),
    "an array longer than its bytes": {"world": [_entry("a", _array([2**40], bytes(8)))]},
    "an array shorter than its bytes": {"world": [_entry("a", _array([1], bytes(9)))]},
    "a shape whose product overflows": {"world": [_entry("a", _array([2**63, 2], b""))]},
    "an absurd shape without numbers": {"world": [_entry("a", _array([2**40, 0], b""))]},
    "too many dimensions": {"world": [_entry("a", _array([1] * 33, bytes(8)))]},
    "a type that does not exist": {"world": [_entry("a", _array([1], bytes(8), 99))]},
    "a truth value of two": wire.Notice(data=[_entry("a", _array([1], b"\2", wire.Array.BOOL))]),
    "whole numbers in the world": {"world": [_entry("a", _whole(1))]},
    "text in the world": {"world": [wire.Entry(name="a", value=wire.Value(text="a")).SerializeToString()]},
    "a name twice": {"world": [_entry("a", _array([0], b""))] * 2},
    "an entry without a value": {"world": [wire.Entry(name="a").SerializeToString()]},
    "an entry that is none": {"world": [b"\xff\xff"]},
    "text that is no UTF-8": {"contacts": [b"\x0a\x01\xff\x12\x01a"]},
    "a contact with nobody": {"contacts": [wire.Contact(first="a").SerializeToString()]},
    "a batch without senders": {"batches": [wire.MessageBatch().SerializeToString()]},
    "senders that descend": {"batches": [_batch(senders=_whole(2, 1))]},
    "a sender twice in a batch for all": {"batches": [_batch(senders=_whole(1, 1))]},
    "a link twice": {"batches": [_batch(senders=_whole(1, 1), receivers=_whole(2, 2))]},
    "text where columns belong": {
        "batches": [_batch(columns=[wire.Entry(name="a", value=wire.Value(text="ab")).SerializeToString()])]
    },
    "a list that does not fit": {
        "batches": [_batch(columns=[wire.Entry(name="a", value=wire.Value(list=wire.Items())).SerializeToString()])]
    },
    "a negative sender": {"batches": [_batch(senders=_whole(-1, 1))]},
    "a column that does not fit": {"batches": [_batch(columns=[_entry("a", _array([3], bytes(24)))])]},
    "receivers that do not fit": {"batches": [_batch(receivers=_whole(1))]},
    "an empty delivery": {"deliveries": [b""]},
    "a delivery of nothing": {"deliveries": [_delivery()]},
    "a row too many": {"batches": [_batch()], "deliveries": [_delivery(rows=_whole(2))]},
    "a delivery without rows": {"batches": [_batch()], "deliveries": [_delivery(rows=None)]},
    "times that do not fit": {"batches": [_batch()], "deliveries": [_delivery(due=_whole(1, 2))]},
    "numbers that are fractions": {
        "batches": [_batch()],
        "deliveries": [_delivery(due=_array([1], bytes(8)))],
    },
    "inputs that do not fit": wire.Report(inputs=[_input(rows=_whole(0, 1))]),
    "inputs that are flat": wire.Report(inputs=[_input(inputs=_array([1], bytes(8)))]),
    "a group twice": wire.Report(inputs=[_input(), _input()]),
    "a post without content": wire.Report(posts=[wire.Post(time=1).SerializeToString()]),
    "a series that does not ascend": wire.Notice(
        data=[
            wire.Entry(
                name="a",
                value=wire.Value(series=wire.Series(times=_whole(2, 1), values=_array([2, 1], bytes(16)))),
            ).SerializeToString()
        ]
    ),
}


@pytest.mark.parametrize("bad", BAD.values(), ids=BAD.keys())
def test_unsuitable_values_are_refused(bad: Any) -> None:
    if isinstance(bad, dict):
        bad = wire.Step(**bad)
    if not isinstance(bad, wire.Frame):
        bad = wire.Frame(**{type(bad).__name__.lower(): bad})
    with pytest.raises(FrameError):
        decode(bad.SerializeToString())


_GREEDY = """
import sys
from symaware_cli.engine.network import transport_pb2 as wire
from symaware_cli.processes.codec import decode
from symaware_cli.engine.network.value import FrameError

def peak():
    # Not `ru_maxrss`: that begins with the peak of the process that started this one, and so may not grow at all.
    with open("/proc/self/status") as status:
        return 1024 * int(status.read().partition("VmHWM:")[2].split()[0])

kind, part = sys.argv[1], bytes.fromhex(sys.argv[2])
frame = wire.Frame(**{kind: {}}).SerializeToString()[:-1]
body = part * (2**21 // len(part))
frame += bytes([len(body) & 127 | 128, len(body) >> 7 & 127 | 128, len(body) >> 14 & 127 | 128, len(body) >> 21]) + body
decode(wire.Frame(end={}).SerializeToString())
before = peak()
try:
    decode(frame)
    print("taken", end=" ")
except FrameError:
    print("refused", end=" ")
print((peak() - before) / len(frame))
"""


@pytest.mark.parametrize(
    ("kind", "part", "outcome"),
    [
        ("step", "2200", "refused"),  # contacts of nobody
        ("step", "22060a0161120162", "taken"),  # contacts as short as can be
        ("step", "3200", "refused"),  # deliveries of nothing
        ("step", "2a070a050805120100", "taken"),  # batches as short as can be
        ("notice", "2a00", "refused"),  # entries without a value
        ("hello", "2200", "taken"),  # agents without a name
    ],
)
def test_a_frame_of_many_small_things_takes_a_small_multiple_of_its_size(kind: str, part: str, outcome: str) -> None:
    line = [sys.executable, "-c", _GREEDY, kind, part]
    told, ratio = subprocess.run(line, capture_output=True, text=True, check=True).stdout.split()
    assert told == outcome
    assert 1 < float(ratio) < 40
