"""The entities shown in Foxglove, and the messages that update them, in the order of time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message

from symaware_cli.viewing.foxglove.output import Output
from symaware_cli.viewing.foxglove.primitives import timestamp


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
