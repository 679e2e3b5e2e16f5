"""Encodes and decodes frames as protobuf messages (schemas/symaware/v1/transport.proto)."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import Any, Generic, TypeVar

import numpy as np
from google.protobuf.message import EncodeError
from numpy.typing import ArrayLike, NDArray

from symaware_cli.core import Contact, Delivery, MessageBatch
from symaware_cli.core.message import Indices, objects
from symaware_cli.engine import (
    FrameError,
    array_from_wire,
    array_to_wire,
    entries_from_wire,
    entries_to_wire,
    parsed,
    present,
    text_to_wire,
)
from symaware_cli.engine.network import transport_pb2 as wire
from symaware_cli.processes.frame import (
    Checkpoint,
    End,
    Frame,
    Hello,
    Notice,
    Post,
    Refusal,
    Report,
    Step,
    Welcome,
)

T = TypeVar("T", bound=Hashable)
S = TypeVar("S")

_REAL = np.dtype("<f8")


class _Heads(Generic[T, S]):
    """A cache of the first bytes of messages that end with an array, which are the same in each step.

    The same arrays are sent in each step, so only the bytes of their numbers change. The cache saves time; it has no
    effect on the encoded bytes or the decoded messages.
    """

    #: The maximum number of stored heads, and of the bytes of each.
    MOST, LONGEST = 64, 2**18

    def __init__(self, make: Callable[[T, NDArray[np.float64]], bytes], read: Callable[[T], S]) -> None:
        """Initialise.

        Args:
            make: Encodes a message of a key and an array of numbers, whose bytes come last.
            read: Returns the decoded form of a key.
        """
        self._make = make
        self._read = read
        self._heads: dict[tuple[T, tuple[int, ...]], bytes] = {}
        #: By the length of a message.
        self._known: dict[int, list[tuple[bytes, S, tuple[int, ...]]]] = {}

    def encode(self, what: T, values: ArrayLike) -> bytes:
        """Encode a message."""
        array = np.asarray(values, _REAL)
        head = self._heads.get((what, array.shape))
        return self._learn(what, array) if head is None else head + array.tobytes()

    def decode(self, data: bytes) -> tuple[S, NDArray[np.float64]] | None:
        """Decode a message if its head is stored; None otherwise."""
        for head, what, shape in self._known.get(len(data), ()):
            if data.startswith(head):
                return what, np.ndarray(shape, _REAL, data, len(head))
        return None

    def learn(self, data: bytes, what: T, array: NDArray[np.float64]) -> S:
        """Store the head of a message, if `make` would encode the same message; returns the decoded form of its key."""
        if array.nbytes and len(data) - array.nbytes <= self.LONGEST and self._make(what, array) == data:
            self._learn(what, array)
        return self._read(what)

    def _learn(self, what: T, array: NDArray[np.float64]) -> bytes:
        message = self._make(what, array)
        head = message[: len(message) - array.nbytes]
        if len(head) <= self.LONGEST:
            if len(self._heads) >= self.MOST:
                self._heads.clear()
                self._known.clear()
            if (what, array.shape) not in self._heads:
                self._heads[what, array.shape] = head
                self._known.setdefault(len(message), []).append((head, self._read(what), array.shape))
        return message


def encode(frame: Frame) -> bytes:
    """Encode a frame.

    Raises:
        TypeError: It holds a value that cannot be sent; states its type.
    """
    message = wire.Frame()
    name, fill = _ENCODERS[type(frame)]
    part = getattr(message, name)
    part.SetInParent()
    try:
        fill(part, frame)
        return message.SerializeToString()
    except (ValueError, EncodeError) as error:
        # Numbers out of the range of their fields, strings that are not Unicode, more than 2 GiB.
        raise TypeError(f"a {type(frame).__name__} cannot be sent: {error}") from error


def decode(data: bytes) -> Frame:
    """Decode a frame; its arrays are read-only.

    Raises:
        FrameError: The bytes are not a valid frame.
    """
    message = parsed(wire.Frame, data)
    kind = message.WhichOneof("content")
    if kind is None:
        raise FrameError("a frame is empty, or of a kind that is not known")
    frame: Frame = _DECODERS[kind](getattr(message, kind))
    return frame


def _hello(part: wire.Hello, frame: Hello) -> None:
    part.name, part.scenario, part.version = frame.name, frame.scenario, frame.version
    part.agents.extend(frame.agents)
    if frame.checkpoint is not None:
        part.checkpoint.run, part.checkpoint.step = frame.checkpoint


def _read_hello(message: wire.Hello) -> Hello:
    checkpoint = None
    if message.HasField("checkpoint"):
        checkpoint = Checkpoint(message.checkpoint.run, message.checkpoint.step)
    return Hello(message.name, message.scenario, message.version, tuple(message.agents), checkpoint)


def _welcome(part: wire.Welcome, frame: Welcome) -> None:
    part.step, part.time, part.pace, part.started, part.run, part.restores, absent = frame
    if absent is not None:
        part.absent = absent


def _read_welcome(message: wire.Welcome) -> Welcome:
    absent = message.absent if message.HasField("absent") else None
    return Welcome(message.step, message.time, message.pace, message.started, message.run, message.restores, absent)


def _refusal(part: wire.Refusal, frame: Refusal) -> None:
    part.reason, part.final = frame


def _read_refusal(message: wire.Refusal) -> Refusal:
    return Refusal(message.reason, message.final)


def _notice(part: wire.Notice, frame: Notice) -> None:
    part.name, part.source, part.level, part.text, data = frame
    part.data.extend(entries_to_wire(data))


def _read_notice(message: wire.Notice) -> Notice:
    return Notice(message.name, message.source, message.level, message.text, entries_from_wire(message.data))


def _end(part: wire.End, frame: End) -> None:
    part.status, part.reason, part.source = frame


def _read_end(message: wire.End) -> End:
    return End(message.status, message.reason, message.source)


def _step(part: wire.Step, frame: Step) -> None:
    part.step, part.time, part.started = frame.step, frame.time, frame.started
    part.world.extend([_WORLD.encode(name, array) for name, array in frame.world.items()])
    part.contacts.extend(_serialised(_contact, frame.contacts))
    if frame.arrived:
        # A member often gets parts of the same batch, one for each time of arrival.
        batches = {id(each.batch): each.batch for each in frame.arrived}
        numbers = {identity: number for number, identity in enumerate(batches)}
        part.batches.extend(_serialised(_batch, batches.values()))
        part.deliveries.extend(_serialised(lambda each: _delivery(each, numbers[id(each.batch)]), frame.arrived))


def _read_step(message: wire.Step) -> Step:
    contacts: tuple[Contact, ...] = ()
    arrived: tuple[Delivery, ...] = ()
    if message.contacts:
        contacts = tuple(_read_contact(parsed(wire.Contact, data)) for data in message.contacts)
    if message.batches or message.deliveries:
        batches = [_read_batch(parsed(wire.MessageBatch, data)) for data in message.batches]
        arrived = tuple(_read_delivery(parsed(wire.Delivery, data), batches) for data in message.deliveries)
    return Step(message.step, message.time, _read_world(message.world), contacts, arrived, message.started)


def _real_array(name: str, array: NDArray[np.float64]) -> bytes:
    (entry,) = entries_to_wire({name: array})
    return entry


def _read_world(entries: Iterable[bytes]) -> dict[str, NDArray[np.float64]]:
    world: dict[str, NDArray[np.float64]] = {}
    for data in entries:
        found = _WORLD.decode(data)
        if found is None:
            ((key, value),) = entries_from_wire([data]).items()
            found = key, _of_type(key, value, np.float64)
            _WORLD.learn(data, *found)
        name, array = found
        if name in world:
            raise FrameError(f"the name {name!r} comes twice")
        world[name] = array
    return world


def _report(part: wire.Report, frame: Report) -> None:
    part.step = frame.step
    for group, (rows, values) in frame.inputs.items():
        part.inputs.append(_INPUTS.encode((group, np.asarray(rows, np.int64).tobytes()), values))
    part.posts.extend(_serialised(_post, frame.posts))
    if frame.peak is not None:
        part.peak.SetInParent()
        part.peak.risk, part.peak.agent = frame.peak
    if frame.checkpoint is not None:
        part.checkpoint = frame.checkpoint


def _read_report(message: wire.Report) -> Report:
    inputs: dict[str, tuple[Indices, NDArray[np.float64]]] = {}
    for data in message.inputs:
        found = _INPUTS.decode(data)
        if found is None:
            what, values = _read_input(data)
            found = _INPUTS.learn(data, what, values), values
        (group, rows), values = found
        if group in inputs:
            raise FrameError(f"the group {group!r} comes twice")
        inputs[group] = rows, values
    posts = tuple(_read_post(parsed(wire.Post, data)) for data in message.posts) if message.posts else ()
    peak = (message.peak.risk, message.peak.agent) if message.HasField("peak") else None
    checkpoint = message.checkpoint if message.HasField("checkpoint") else None
    return Report(message.step, inputs, posts, peak, checkpoint)


def _input(rows: tuple[str, bytes], values: NDArray[np.float64]) -> bytes:
    """Encode the control inputs of some rows of a group; the rows are given as the bytes of an array."""
    group, numbers = rows
    indices = _indices(np.frombuffer(numbers, np.int64))
    return wire.Input(group=text_to_wire(group), rows=indices, inputs=array_to_wire(values)).SerializeToString()


def _rows(what: tuple[str, bytes]) -> tuple[str, Indices]:
    """Decode the key of control inputs: the name of a group, and the bytes of its rows."""
    return what[0], np.frombuffer(what[1], np.int64)


def _read_input(data: bytes) -> tuple[tuple[str, bytes], NDArray[np.float64]]:
    part = parsed(wire.Input, data)
    rows = _read_indices(present(part, "rows"))
    values = array_from_wire(present(part, "inputs"), "f", dimensions=2).astype(np.float64, copy=False)
    if len(values) != len(rows):
        raise FrameError(f"{len(rows)} rows do not fit control inputs of shape {values.shape}")
    return (part.group, rows.tobytes()), values


def _post(post: Post) -> wire.Post:
    return wire.Post(batch=_batch(post.batch), time=post.time)


def _read_post(message: wire.Post) -> Post:
    return Post(_read_batch(present(message, "batch")), message.time)


def _contact(contact: Contact) -> wire.Contact:
    return wire.Contact(
        first=contact.first,
        second=contact.second,
        point=contact.point,
        depth=contact.depth,
        begins=contact.begins,
        impulse=contact.impulse,
    )


def _read_contact(message: wire.Contact) -> Contact:
    if not message.first or not message.second:
        raise FrameError("a contact lacks a body")
    return Contact(message.first, message.second, tuple(message.point), message.depth, message.begins, message.impulse)


def _batch(batch: MessageBatch) -> wire.MessageBatch:
    columns = {
        name: column.tolist() if column.dtype == object else np.asarray(column)
        for name, column in batch.columns.items()
    }
    return wire.MessageBatch(
        senders=_indices(batch.senders),
        columns=entries_to_wire(columns),
        kind=batch.kind,
        receivers=None if batch.receivers is None else _indices(batch.receivers),
    )


def _read_batch(message: wire.MessageBatch) -> MessageBatch:
    senders = _read_indices(present(message, "senders"))
    receivers = _read_indices(message.receivers, len(senders)) if message.HasField("receivers") else None
    if (np.diff(senders) < 0).any():
        raise FrameError("the senders of a batch do not ascend")
    links = senders[:, None] if receivers is None else np.stack([senders, receivers], axis=1)
    if len(senders) > 1 and len(np.unique(links, axis=0)) < len(links):
        raise FrameError("a batch has two messages over one link")
    columns = {name: _column(name, value) for name, value in entries_from_wire(message.columns).items()}
    for name, column in columns.items():
        if column.shape[:1] != senders.shape:
            raise FrameError(f"the column {name!r} of shape {column.shape} does not fit {len(senders)} rows")
    return MessageBatch(senders, columns, message.kind, receivers)


def _column(name: str, value: Any) -> NDArray[Any]:
    """Return a column of numbers, or of objects."""
    return objects(value) if isinstance(value, list) else _of_type(name, value)


def _delivery(delivery: Delivery, batch: int) -> wire.Delivery:
    return wire.Delivery(
        batch=batch,
        rows=_indices(delivery.rows),
        receivers=_indices(delivery.receivers),
        sequences=_indices(delivery.sequences),
        sent_time=delivery.sent_time,
        due=_indices(delivery.due),
    )


def _read_delivery(message: wire.Delivery, batches: Sequence[MessageBatch]) -> Delivery:
    if message.batch >= len(batches):
        raise FrameError(f"there is no batch {message.batch}: there are {len(batches)}")
    batch = batches[message.batch]
    rows = _read_indices(present(message, "rows"))
    if len(rows) and int(rows.max()) >= len(batch.senders):
        raise FrameError(f"a batch of {len(batch.senders)} rows has no row {rows.max()}")
    receivers = _read_indices(present(message, "receivers"), len(rows))
    sequences = _read_whole(present(message, "sequences"), len(rows))
    return Delivery(
        batch, rows, receivers, sequences, message.sent_time, _read_whole(present(message, "due"), len(rows))
    )


def _indices(values: NDArray[Any]) -> wire.Array:
    return array_to_wire(np.asarray(values, np.int64))


def _read_whole(message: wire.Array, count: int | None = None) -> NDArray[np.int64]:
    if message.type != wire.Array.INT64:
        raise FrameError("what counts is not an array of 64-bit whole numbers")
    values = array_from_wire(message, dimensions=1)
    if count not in (None, len(values)):
        raise FrameError(f"{len(values)} numbers stand where {count} belong")
    return values


def _read_indices(message: wire.Array, count: int | None = None) -> Indices:
    values = _read_whole(message, count)
    if len(values) and int(values.min()) < 0:
        raise FrameError(f"an index is negative: {values.min()}")
    return values.astype(np.intp, copy=False)


def _of_type(name: str, value: Any, dtype: type[np.generic] | None = None) -> NDArray[Any]:
    """Check that a value is an array, of a type if one is given."""
    if not isinstance(value, np.ndarray) or dtype not in (None, value.dtype.type):
        raise FrameError(f"what stands under {name!r} is no array of the right type")
    return value


def _serialised(encoder: Callable[[Any], Any], values: Iterable[Any]) -> list[bytes]:
    return [encoder(value).SerializeToString() for value in values]


def _same(name: str) -> str:
    return name


_WORLD = _Heads(_real_array, _same)
_INPUTS = _Heads(_input, _rows)

_ENCODERS: dict[type, tuple[str, Callable[[Any, Any], None]]] = {
    Hello: ("hello", _hello),
    Welcome: ("welcome", _welcome),
    Refusal: ("refusal", _refusal),
    Step: ("step", _step),
    Report: ("report", _report),
    Notice: ("notice", _notice),
    End: ("end", _end),
}

_DECODERS: dict[str, Callable[[Any], Frame]] = {
    "hello": _read_hello,
    "welcome": _read_welcome,
    "refusal": _read_refusal,
    "step": _read_step,
    "report": _read_report,
    "notice": _read_notice,
    "end": _read_end,
}
