"""Writes an MCAP file of protobuf messages with their schemas."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from types import TracebackType
from typing import Any, BinaryIO

import numpy as np
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import Message
from mcap.writer import Writer
from numpy.typing import NDArray

from symaware_cli.views.foxglove.primitives import timestamp

_LIBRARY = "symaware export"
_FIELD = descriptor_pb2.FieldDescriptorProto


class Output:
    """Writes messages to an MCAP file.

    Attributes:
        counts: The number of messages written on each topic.
    """

    def __init__(self, file: BinaryIO) -> None:
        """Start the file.

        Args:
            file: The file to write to.

        Raises:
            OSError: It cannot be written.
        """
        self.counts: dict[str, int] = {}
        self._writer = Writer(file)
        self._writer.start(profile="", library=_LIBRARY)
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def write(self, topic: str, time: int, message: Message, metadata: Mapping[str, str] | None = None) -> None:
        """Write a message.

        Args:
            topic: Its topic, whose channel is opened with the first message; all its messages have the same type.
            time: Simulated time [ns].
            message: The message.
            metadata: Metadata of the channel, used when it is opened.

        Raises:
            OSError: It cannot be written.
        """
        if topic not in self._channels:
            self._open(topic, message, metadata or {})
        data = message.SerializeToString(deterministic=True)
        self._writer.add_message(self._channels[topic], time, data, time, self.counts[topic])
        self.counts[topic] += 1

    def _open(self, topic: str, message: Message, metadata: Mapping[str, str]) -> None:
        name = message.DESCRIPTOR.full_name
        if name not in self._schemas:
            self._schemas[name] = self._writer.register_schema(name, "protobuf", _files(message.DESCRIPTOR.file))
        self._channels[topic] = self._writer.register_channel(topic, "protobuf", self._schemas[name], dict(metadata))
        self.counts[topic] = 0

    def __enter__(self) -> Output:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if error is None:
            self._writer.finish()  # type: ignore[no-untyped-call]


class PlotChannel:
    """A channel of numbers that can be plotted: a field for each column, with a number for each agent.

    For example, ``/agents/robot/state.x[2]`` is the x of the third robot.
    """

    def __init__(self, path: str, quantities: Sequence[tuple[str, str]], names: Sequence[str]) -> None:
        """Create the message type of the channel.

        Args:
            path: The name of the channel.
            quantities: Name and unit of each column.
            names: The names of the rows.
        """
        self._fields = _distinct([_identifier(name) for name, _ in quantities])
        self._kind = _class(_identifier(path), self._fields)
        #: Metadata of the channel.
        self.metadata = {
            "rows": ",".join(names),
            "columns": ",".join(self._fields),
            "units": ",".join(unit for _, unit in quantities),
        }

    def message(self, values: NDArray[np.float64]) -> Message:
        """Return a message with the numbers (rows, columns) of an instant."""
        return self._kind(**dict(zip(self._fields, values.T.tolist(), strict=True)))


def _class(name: str, fields: Sequence[str]) -> type[Message]:
    """Create a message class with a repeated number for each field."""
    file = descriptor_pb2.FileDescriptorProto(
        name=f"symaware/plot/{name}.proto", package="symaware.plot", syntax="proto3"
    )
    message = file.message_type.add(name=name)
    for number, field in enumerate(fields, 1):
        message.field.add(name=field, number=number, type=_FIELD.TYPE_DOUBLE, label=_FIELD.LABEL_REPEATED)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"symaware.plot.{name}"))


def _files(file: Any) -> bytes:
    """Serialise a file and all files that it imports, imports first."""
    found: dict[str, Any] = {}

    def visit(one: Any) -> None:
        if one.name not in found:
            for imported in one.dependencies:
                visit(imported)
            found[one.name] = one

    visit(file)
    files = descriptor_pb2.FileDescriptorSet()
    for each in found.values():
        each.CopyToProto(files.file.add())
    return files.SerializeToString(deterministic=True)


def _identifier(name: str) -> str:
    """Convert a name to a valid protobuf identifier."""
    word = re.sub(r"\W", "_", name, flags=re.ASCII)
    return word if re.match("[A-Za-z_]", word) else f"_{word}"


def _distinct(names: Sequence[str]) -> list[str]:
    taken: list[str] = []
    for name in names:
        taken.append(name if name not in taken else f"{name}_{len(taken)}")
    return taken


class SceneUpdates:
    """Collects the messages for an interval of time, and writes them in the order of time.

    Entities are shown until they are replaced or removed. Every scene update of a topic contains all its entities, so
    that any instant can be shown after a jump.

    Attributes:
        kept: State that showing a mark keeps until the next mark of the same path.
    """

    def __init__(self, output: Output) -> None:
        """Start without entities."""
        self.kept: dict[Any, Any] = {}
        self._output = output
        self._said: list[tuple[int, str, Message | None, Mapping[str, str]]] = []
        #: The new entities, by time and topic, and then by path.
        self._changes: dict[tuple[int, str], dict[str, list[SceneEntity]]] = {}
        self._up: dict[str, dict[str, list[SceneEntity]]] = {}

    def add_message(self, time: int, topic: str, message: Message, metadata: Mapping[str, str] | None = None) -> None:
        """Add a message at an instant [ns], with metadata of its channel."""
        self._said.append((time, topic, message, metadata or {}))

    def set_entities(self, time: int, topic: str, path: str, entities: Iterable[SceneEntity]) -> None:
        """Replace the entities of a path on a topic, from an instant [ns] on."""
        self._changes.setdefault((time, topic), {})[path] = list(entities)

    def flush(self) -> None:
        """Write the collected messages.

        Raises:
            OSError: They cannot be written.
        """
        self._said += [(time, topic, None, {}) for time, topic in self._changes]
        for time, topic, message, metadata in sorted(self._said, key=lambda said: said[0]):
            said = self._update(time, topic) if message is None else message
            if said is not None:
                self._output.write(topic, time, said, metadata)
        self._said, self._changes = [], {}

    def _update(self, time: int, topic: str) -> SceneUpdate | None:
        """Return all entities on a topic from an instant on; None if there are none, before or after."""
        up = self._up.setdefault(topic, {})
        before = {made.id for entities in up.values() for made in entities}
        up.update(self._changes[time, topic])
        update = SceneUpdate(entities=[made for entities in up.values() for made in entities])
        for id in sorted(before - {made.id for made in update.entities}):
            update.deletions.add(type=SceneEntityDeletion.MATCHING_ID, id=id, timestamp=timestamp(time))
        return update if before or len(update.entities) else None
