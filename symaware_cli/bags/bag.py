"""Bags of ROS 2 as files: topics, and messages with their times of recording.

A bag is an MCAP file, an SQLite database, or a folder of these with a `metadata.yaml`
(https://github.com/ros2/rosbag2). The size of files is bounded, and they are checked before their content is decoded.
"""

from __future__ import annotations

import sqlite3
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from symaware_cli.assets import AssetFolders, asset
from symaware_cli.bags.bag_error import BagError
from symaware_cli.log import LogError, open_log, read_yaml

MOST_BYTES = 64 << 20
"""The greatest size of all files of a bag [bytes]: the log of a run contains them, so that it can be repeated."""

_METADATA = "metadata.yaml"
_MOST_METADATA = 1 << 20
_MOST_TOPICS = 10_000
#: The first bytes of a database (https://www.sqlite.org/fileformat.html).
_SQLITE = b"SQLite format 3\0"
_LAST_TIME = (1 << 63) - 1


@dataclass(frozen=True)
class BagTopic:
    """A topic of a bag.

    Attributes:
        name: The name of the topic.
        kind: The type of its messages, such as ``nav_msgs/msg/Odometry``.
        encoding: The serialisation of its messages; ``cdr`` in ROS 2.
        count: The number of its messages.
        definition: The definition of the type as a .msg file, with those of the types that it uses; empty if the bag
            has none.
    """

    name: str
    kind: str
    encoding: str
    count: int
    definition: str = ""


class BagFile(ABC):
    """A file of a bag.

    Attributes:
        path: The file.
        topics: The topics of the file, by name.
        start: The time of recording of the first message [ns]; None without messages.
        end: The time of recording of the last message [ns]; None without messages.
    """

    path: Path
    topics: Mapping[str, BagTopic]
    start: int | None
    end: int | None

    @abstractmethod
    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """Yield topic, time of recording [ns] and content of the messages on some topics, in the order of time.

        Raises:
            BagError: The file is damaged.
        """


class McapBagFile(BagFile):
    """A file in the format of MCAP, which is read like the logs of runs."""

    def __init__(self, path: Path) -> None:
        """Read the index of the file.

        Raises:
            BagError: The file is damaged, or no MCAP file.
        """
        self.path = path
        try:
            self._log = open_log(path)
            damage = self._log.verify()
        except LogError as error:
            raise BagError(str(error)) from error
        if damage is not None and damage.lost:
            raise BagError(str(damage))
        texts = {
            schema.name: schema.data.decode(errors="replace")
            for schema in self._log.index.schemas.values()
            if schema.encoding == "ros2msg"
        }
        self.topics = {
            info.topic: BagTopic(info.topic, info.schema, info.encoding, info.count, texts.get(info.schema, ""))
            for info in self._log.channels.values()
        }
        self.start, self.end = self._log.start_time, self._log.end_time

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """Yield the messages on some topics."""
        try:
            for message in self._log.messages(topics):
                yield message.channel.topic, message.time, message.data
        except LogError as error:
            raise BagError(str(error)) from error


class SqliteBagFile(BagFile):
    """An SQLite database, the default format of earlier versions of ROS 2."""

    def __init__(self, path: Path) -> None:
        """Read the topics.

        Raises:
            BagError: The file is damaged, or no database of a bag.
        """
        self.path = path
        try:
            with open(path, "rb") as file:
                if file.read(len(_SQLITE)) != _SQLITE:
                    raise BagError("it is no SQLite database")
        except OSError as error:
            raise BagError(f"it cannot be read: {error.strerror}") from error
        with self._opened() as connection:
            tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
            if not {"topics", "messages"} <= tables:
                raise BagError("it has no tables `topics` and `messages`")
            definitions = {}
            if "message_definitions" in tables:
                query = (
                    "SELECT topic_type, encoded_message_definition FROM message_definitions WHERE encoding = 'ros2msg'"
                )
                definitions = {str(kind): str(text) for kind, text in connection.execute(query)}
            query = (
                "SELECT name, type, serialization_format, (SELECT count(*) FROM messages WHERE topic_id = topics.id) "
                f"FROM topics ORDER BY topics.id LIMIT {_MOST_TOPICS}"
            )
            self.topics = {
                str(name): BagTopic(str(name), str(kind), str(form), int(count), definitions.get(str(kind), ""))
                for name, kind, form, count in connection.execute(query)
            }
            ((self.start, self.end),) = connection.execute("SELECT min(timestamp), max(timestamp) FROM messages")
        for time in (self.start, self.end):
            if time is not None and (not isinstance(time, int) or not 0 <= time <= _LAST_TIME):
                raise BagError("a message has a time that is no number of nanoseconds since 1970")

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """Yield the messages on some topics."""
        marks = ", ".join("?" for _ in topics)
        query = (
            "SELECT name, timestamp, data FROM messages JOIN topics ON topic_id = topics.id "
            f"WHERE name IN ({marks}) ORDER BY timestamp, messages.id"
        )
        with self._opened() as connection:
            for name, time, data in connection.execute(query, sorted(topics)):
                if not isinstance(time, int) or not isinstance(data, bytes):
                    raise BagError(f"a message on `{name}` is damaged")
                yield name, time, data

    def _opened(self) -> Any:
        return _Database(self.path)


class _Database:
    """A connection that only reads, and does not trust the schema of the file."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> sqlite3.Connection:
        self._closing = closing(sqlite3.connect(f"{self._path.absolute().as_uri()}?mode=ro&immutable=1", uri=True))
        connection = self._closing.__enter__()
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_BYTES)
        for pragma in ("query_only = ON", "trusted_schema = OFF", "cell_size_check = ON"):
            connection.execute(f"PRAGMA {pragma}")
        return connection

    def __exit__(self, kind: Any, error: BaseException | None, traceback: Any) -> None:
        self._closing.__exit__(kind, error, traceback)
        if isinstance(error, sqlite3.Error | OverflowError | UnicodeError):
            raise BagError(f"it is damaged: {error}") from error


_FILES: Mapping[str, type[McapBagFile | SqliteBagFile]] = {".mcap": McapBagFile, ".db3": SqliteBagFile}


class Bag:
    """A bag of one or several files.

    Attributes:
        topics: The topics of the bag, by name.
        start: The time of recording of the first message [ns].
        end: The time of recording of the last message [ns].
        contents: The files, by their paths relative to the scenario's folder.
    """

    def __init__(self, name: str, folders: AssetFolders) -> None:
        """Open a bag.

        Args:
            name: The file or the folder, relative to one of the scenario's folders.
            folders: The folders of the scenario.

        Raises:
            BagError: The bag cannot be used.
            WorldError: A file is missing, or outside of the folders.
        """
        self.contents: dict[str, bytes] = {}
        paths = [(name, asset.find(name, folders))] if not _is_folder(name, folders) else self._listed(name, folders)
        size = sum(path.stat().st_size for _, path in paths)
        if size > MOST_BYTES:
            raise BagError(
                f"it has {size / 2**20:.0f} MiB, and at most {MOST_BYTES >> 20} are read: "
                "take the topics out that are needed (`ros2 bag convert`)"
            )
        self._files: list[BagFile] = []
        for each, path in paths:
            kind = _FILES.get(path.suffix.lower())
            if kind is None:
                raise BagError(f"`{each}` is neither .mcap nor .db3")
            try:
                self._files.append(kind(path))
            except BagError as error:
                raise BagError(f"`{each}`: {error}" if len(paths) > 1 else str(error)) from error
            self.contents[each] = path.read_bytes()
        self.topics: dict[str, BagTopic] = {}
        for file in self._files:
            for topic in file.topics.values():
                known = self.topics.get(topic.name)
                if known is not None and known.kind != topic.kind:
                    raise BagError(f"the files have different types of messages on `{topic.name}`")
                count = topic.count + (known.count if known else 0)
                definition = topic.definition or (known.definition if known else "")
                self.topics[topic.name] = BagTopic(topic.name, topic.kind, topic.encoding, count, definition)
        starts = [file.start for file in self._files if file.start is not None]
        if not starts:
            raise BagError("there are no messages in it")
        self.start = min(starts)
        self.end = max(file.end for file in self._files if file.end is not None)

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """Yield topic, time of recording [ns] and content of the messages on some topics, file by file.

        Raises:
            BagError: A file is damaged.
        """
        for file in self._files:
            own = [topic for topic in topics if topic in file.topics]
            if own:
                yield from file.messages(own)

    def _listed(self, name: str, folders: AssetFolders) -> list[tuple[str, Path]]:
        """Return the files that the `metadata.yaml` of a folder names."""
        at = str(PurePosixPath(name, _METADATA))
        path = asset.find(at, folders)
        with open(path, "rb") as file:
            content = file.read(_MOST_METADATA + 1)
        if len(content) > _MOST_METADATA:
            raise BagError(f"`{at}` is too long")
        try:
            found = read_yaml(content)["rosbag2_bagfile_information"]
            files = [PurePosixPath(each).name for each in found["relative_file_paths"]]
            mode = str(found.get("compression_mode") or "none").lower()
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise BagError(f"`{at}` is not that of a bag") from error
        if mode != "none":
            raise BagError(f"it is compressed by {mode}; unpack it (`ros2 bag convert`)")
        self.contents[at] = content
        return [(inner, asset.find(inner, folders)) for inner in (str(PurePosixPath(name, each)) for each in files)]


def _is_folder(name: str, folders: AssetFolders) -> bool:
    return any((root / name / _METADATA).is_file() for root in folders.roots)
