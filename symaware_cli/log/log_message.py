"""Messages of a log: reading them from records, and decoding them."""

from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

from google.protobuf.message import DecodeError
from mcap.opcode import Opcode

from symaware_cli.log import others_message, wire
from symaware_cli.log.consistency import require_consistent
from symaware_cli.log.error import LogError
from symaware_cli.log.index import FRAME, LAST_TIME, MESSAGE, ChannelInfo, Unsound, frames
from symaware_cli.log.log_schema import MESSAGES
from symaware_cli.world import record

_DECODERS: dict[str, Callable[[bytes], Any]] = {
    message.DESCRIPTOR.full_name: message.FromString for message in MESSAGES.values()
} | {
    "symaware.v1.Rows": wire.decode_rows,
    "symaware.v1.SeriesRows": wire.decode_series,
    "symaware.v1.TableRows": wire.decode_tables,
    "symaware.v1.Awareness": others_message.decode_awareness,
}


@record
class RawMessage:
    """A message as stored in the file."""

    channel_id: int
    sequence: int
    time: int
    data: bytes


def _stored(data: bytes) -> Iterator[tuple[int, int, int, int, int]]:
    """Yield channel, sequence, time, start and end of each message in consecutive records."""
    for opcode, position, stop in frames(data):
        if opcode == Opcode.MESSAGE:
            start = position - FRAME.size
            if stop - start < MESSAGE.size:
                raise Unsound("a message is cut off")
            _, _, channel_id, sequence, time, _ = MESSAGE.unpack_from(data, start)
            if time > LAST_TIME:
                raise Unsound("a message has an impossible time")
            yield channel_id, sequence, time, start, stop


def read_messages(data: bytes, wanted: Collection[int], start: int, end: int) -> list[RawMessage]:
    """Collect messages from consecutive records.

    Args:
        data: The records.
        wanted: The ids of the channels to read.
        start: The first log time to read, ns.
        end: The log time at which to stop, exclusive, ns.

    Raises:
        Unsound: The records are damaged.
    """
    return [
        RawMessage(channel_id, sequence, time, data[position + MESSAGE.size : stop])
        for channel_id, sequence, time, position, stop in _stored(data)
        if start <= time < end and channel_id in wanted
    ]


def message_positions(data: bytes) -> dict[int, list[int]]:
    """Locate the messages in consecutive records.

    Returns:
        For each channel id a flat list with log time [ns] and offset of each message.

    Raises:
        Unsound: The records are damaged.
    """
    positions: dict[int, list[int]] = {}
    for channel_id, _, time, position, _ in _stored(data):
        positions.setdefault(channel_id, []).extend((time, position))
    return positions


@record
class LogMessage:
    """A message of a log.

    Attributes:
        channel: Its channel.
        time: Simulated time, ns.
        sequence: Its number among the messages of that time; /timing is numbered separately.
        data: The serialised message.
        path: The log, for error messages.
        content: The decoded message, if already known: for the message of one entity, split off a shared one.
    """

    channel: ChannelInfo
    time: int
    sequence: int
    data: bytes
    path: Path | None = None
    content: Any = None

    def decode(self) -> Any:
        """Decode the message.

        Returns:
            A `wire.Rows`, `wire.SeriesRows` or `wire.TableRows`, or an `Awareness`; for other SymAware messages an
            instance of the generated class.

        Raises:
            LogError: It is not a SymAware message, or it is damaged.
        """
        if self.content is not None:
            return self.content
        decode = _DECODERS.get(self.channel.schema)
        expected = self.channel.message
        if (
            decode is None
            or self.channel.encoding != "protobuf"
            or not (expected is None or self.channel.carries(expected))
        ):
            kind = self.channel.schema or "no schema"
            raise LogError(f"the messages on {self.channel.topic} ({kind}){self.origin} are not SymAware messages")
        try:
            content = decode(self.data)
        except (ValueError, DecodeError) as error:
            place = f"on {self.channel.topic} at {self.time} ns{self.origin}"
            raise LogError(f"the message {place} is not a {self.channel.schema}") from error
        try:
            require_consistent(content, self.channel)
        except ValueError as error:
            raise LogError(
                f"the messages on {self.channel.topic}{self.origin} do not fit together: at {self.time} ns, {error}"
            ) from error
        return content

    @property
    def origin(self) -> str:
        """The log that it belongs to, as the end of a phrase."""
        return f" in {self.path}" if self.path else ""
