"""Merges the logs that the processes of one run wrote into one log."""

import heapq
import json
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any

from symaware_cli.log import (
    MANIFEST,
    MESSAGES,
    RECOVERY,
    TIMING,
    ChannelInfo,
    Damage,
    LogError,
    LogMessage,
    LogWriter,
    OutputError,
    json_values,
    whole_file,
)
from symaware_cli.processes.process_log import ProcessLog, missing_agents, missing_in_words

_PROGRESS = 256
"""Messages between two reports of progress."""

_END = b"finished"
"""The name of the event that ends a run."""

_NAMES = {message.DESCRIPTOR.full_name: name for name, message in MESSAGES.items()}
"""The names of messages for `LogWriter.channel`, by their full names."""


@dataclass(frozen=True, slots=True)
class Merged:
    """The result of merging.

    Attributes:
        path: The log of the whole run.
        size: Its size, bytes.
        messages: The number of its messages.
        repeated: The number of messages left out because several parts contain them.
        missing: The agents that none of the parts ran.
        start_time: Simulated time of the first message, ns; None without messages.
        end_time: Simulated time of the last message, ns; None without messages.
    """

    path: Path
    size: int
    messages: int
    repeated: int
    missing: tuple[str, ...]
    start_time: int | None
    end_time: int | None


def merge(
    parts: Sequence[ProcessLog], path: str | os.PathLike[str], on_progress: Callable[[int], None] | None = None
) -> Merged:
    """Merge the parts of a run into one log, as a single process would have written it.

    Messages are ordered by time, then by part, and numbered anew. A message that several parts contain, such as an
    event that all processes recorded, is written once; the reason for the end of the run is the host's. Memory holds
    a chunk of each part, and a digest of each message of one instant that several parts might contain.

    Args:
        parts: The result of `open_process_logs`; damaged contents are left out, and their `damage` describes them
            afterwards.
        path: The new log; an existing file is replaced once the new one is complete.
        on_progress: Called now and then with the simulated time that was reached [ns].

    Raises:
        LogError: A part cannot be read any more, has messages of another format, or contradicts another part.
        OutputError: The new log cannot be written; no partial file is left.
    """
    path = Path(path)
    with whole_file(path, *(part.log.path for part in parts)) as partial:
        try:
            with LogWriter(partial) as writer:
                start, end, repeated = _write(writer, parts, on_progress)
        except OutputError as error:
            # `whole_file` reports this for the path that was asked for.
            raise error.__cause__ or error from None
    return Merged(path, writer.size, writer.messages, repeated, tuple(missing_agents(parts)), start, end)


def _write(
    writer: LogWriter, parts: Sequence[ProcessLog], on_progress: Callable[[int], None] | None
) -> tuple[int | None, int | None, int]:
    """Write the log; return its first and last time, and the number of messages left out."""
    _attach(writer, parts)
    channels = _open_channels(writer, parts)
    once, start, end, repeated = _Once(parts), None, None, 0
    for number, (time, rank, message) in enumerate(heapq.merge(*map(_stream, range(len(parts)), parts))):
        if on_progress and number % _PROGRESS == 0:
            on_progress(time)
        if once.is_new(rank, message):
            writer.add(channels[message.channel.topic], time, message.data)
            start, end = time if start is None else start, time
        else:
            repeated += 1
    writer.flush()
    _describe_end(writer, parts)
    writer.close()
    return start, end, repeated


def _attach(writer: LogWriter, parts: Sequence[ProcessLog]) -> None:
    """Write the attachments of the host, and those that only other parts have, or have undamaged."""
    written: set[str] = set()
    for part in parts:
        own = set()
        for record in part.log.attachment_records():
            if record.name not in written:
                content = _manifest(parts) if record.name == MANIFEST and not part.whole else record.data
                writer.attach(record.name, record.media_type, content)
                own.add(record.name)
        written |= own


def _manifest(parts: Sequence[ProcessLog]) -> bytes:
    content = {key: value for key, value in parts[0].log.manifest.items() if key != "part"}
    return json.dumps({**content, "parts": [part.describe() for part in parts]}, indent=1).encode()


def _open_channels(writer: LogWriter, parts: Sequence[ProcessLog]) -> dict[str, int]:
    """Open the channels of all parts, the host's first; return their numbers by topic."""
    numbers = {TIMING: writer.timing}
    known: dict[str, tuple[ChannelInfo, Path]] = {}
    for part in parts:
        for channel in part.log.index.channels.values():
            info, path = part.log.channels[channel.topic], part.log.path
            if info.schema not in _NAMES or info.encoding != "protobuf":
                raise LogError(
                    f"the messages on {info.topic} ({info.schema or 'no schema'}) in {path} are not of SymAware"
                )
            first, first_path = known.setdefault(info.topic, (info, path))
            if (first.schema, first.metadata) != (info.schema, info.metadata):
                what = "columns" if first.schema == info.schema else "messages"
                raise LogError(f"the {what} of {info.topic} are not the same in {first_path} and {path}")
            if info.topic not in numbers:
                numbers[info.topic] = writer.channel(info.topic, _NAMES[info.schema], info.metadata)
    return numbers


def _stream(rank: int, part: ProcessLog) -> Iterator[tuple[int, int, LogMessage]]:
    """Read the messages of a part with the keys of their order: the time and the rank of the part."""
    last = 0
    for message in part.log.messages(part.log.channels.keys() - (set() if part.host else {TIMING})):
        if message.time < last:
            raise LogError(f"the messages in {part.log.path} do not stand in the order of time")
        last = message.time
        yield last, rank, message


class _Once:
    """Finds messages that several parts contain: of n equal ones in one part and m in another, max(n, m) stay."""

    def __init__(self, parts: Sequence[ProcessLog]) -> None:
        topics = Counter(topic for part in parts for topic in part.log.channels)
        self._shared = {topic for topic, count in topics.items() if count > 1}
        #: Whether the host recorded how the run ended. If not, because it was killed, what its members recorded stays.
        self._has_end = any(part.host and part.log.outcome is not None for part in parts)
        self._place = (0, 0)
        self._written: Counter[tuple[str, bytes]] = Counter()
        self._own: Counter[tuple[str, bytes]] = Counter()

    def is_new(self, rank: int, message: LogMessage) -> bool:
        """Whether the next message in order has not been written yet.

        Args:
            rank: The rank of its part.
            message: The message.
        """
        topic = message.channel.topic
        if topic not in self._shared:
            return True
        if rank and self._has_end and _is_end(message):
            return False
        if self._place != (message.time, rank):
            if self._place[0] != message.time:
                self._written.clear()
            self._own.clear()
            self._place = message.time, rank
        key = topic, blake2b(message.data, digest_size=16).digest()
        self._own[key] += 1
        if self._own[key] <= self._written[key]:
            return False
        self._written[key] = self._own[key]
        return True


def _is_end(message: LogMessage) -> bool:
    """Whether a message is the event that the run finished, which each process records with figures of its own."""
    if not message.channel.carries("Event") or _END not in message.data:
        return False
    event = message.decode()
    return (event.name, event.source) == (_END.decode(), "run")


def _describe_end(writer: LogWriter, parts: Sequence[ProcessLog]) -> None:
    """Write the metadata of the host, and the losses of all parts."""
    for part in parts:
        # Reading their JSON may reveal that they are damaged.
        _ = part.log.recovery, part.log.outcome
    for record in parts[0].log.metadata_records():
        if record.name != RECOVERY:
            writer.metadata(record.name, record.metadata)
    lost = _losses(parts)
    if lost:
        writer.metadata(RECOVERY, json_values(lost))


def _losses(parts: Sequence[ProcessLog]) -> dict[str, Any] | None:
    """The losses of the parts, now or when they were recovered earlier; None if there are none."""
    damages = [(part, part.log.damage) for part in parts if part.log.damage]
    told = [(part.log.path.name, str(damage), damage.lost) for part, damage in damages]
    for part in parts:
        earlier: Any = part.log.recovery
        while isinstance(earlier, dict):
            told.append((str(earlier.get("log")), str(earlier.get("text")), bool(earlier.get("lost"))))
            earlier = earlier.get("earlier")
    missing = missing_agents(parts)
    if missing:
        told.append((parts[0].log.path.name, missing_in_words(missing), True))
    if not told:
        return None
    total = Damage(
        end_missing=parts[0].end_missing,
        summary_missing=any(damage.summary_missing for _, damage in damages),
        unread_bytes=sum(damage.unread_bytes for _, damage in damages),
        chunks_skipped=sum(damage.chunks_skipped for _, damage in damages),
        attachments_skipped=sum(damage.attachments_skipped for _, damage in damages),
        bytes_skipped=sum(damage.bytes_skipped for _, damage in damages),
        gaps=[gap for _, damage in damages for gap in damage.gaps],
        last_time=max((time for part in parts if (time := part.log.end_time) is not None), default=None),
    )
    text = told[0][1] if len(told) == 1 else "; ".join(f"{name}: {text}" for name, text, _ in told)
    return asdict(total) | {
        "log": ", ".join(dict.fromkeys(name for name, _, _ in told)),
        "text": text,
        "lost": any(lost for _, _, lost in told),
        "earlier": None,
    }
