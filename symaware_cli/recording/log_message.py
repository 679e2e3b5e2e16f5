"""Messages of a log, and their decoding."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from google.protobuf.message import DecodeError

from symaware_cli.recording import wire
from symaware_cli.recording.consistency import require_consistent
from symaware_cli.recording.error import LogError
from symaware_cli.recording.index import ChannelInfo
from symaware_cli.recording.log_schema import MESSAGES

_DECODERS: dict[str, Callable[[bytes], Any]] = {
    message.DESCRIPTOR.full_name: message.FromString for message in MESSAGES.values()
} | {
    "symaware.v1.Rows": wire.decode_rows,
    "symaware.v1.SeriesRows": wire.decode_series,
    "symaware.v1.TableRows": wire.decode_tables,
    "symaware.v1.Awareness": wire.decode_awareness,
}


@dataclass(frozen=True, slots=True)
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
            A `wire.Rows`, `wire.SeriesRows`, `wire.TableRows` or `wire.Awareness`; for other SymAware messages an
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
