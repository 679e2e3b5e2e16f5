"""Digests of a log: what two equal runs have in common, whenever their chunks were cut.

docs/log-format.md defines them for other languages.
"""

import hashlib
import struct
from dataclasses import dataclass
from functools import cache

from symaware_cli.recording.log_schema import MANIFEST, TIMING
from symaware_cli.recording.reader import Log

_HEAD = struct.Struct("<QII")


@dataclass(frozen=True, slots=True)
class Digest:
    """The SHA-256 of what is deterministic in a log, in hexadecimal.

    Attributes:
        channels: By topic; every channel but /timing.
        attachments: By name; the scenario as written, as resolved, and the manifest.
        combined: Of all of them.
    """

    channels: dict[str, str]
    attachments: dict[str, str]
    combined: str

    def differences(self, other: "Digest") -> list[str]:
        """Name the topics and attachments that differ, or that only one of both has; sorted."""
        mine, theirs = self.channels | self.attachments, other.channels | other.attachments
        return sorted(name for name in mine.keys() | theirs.keys() if mine.get(name) != theirs.get(name))


def digest(log: Log) -> Digest:
    """Digest a log in one pass.

    Args:
        log: The log; of a damaged one, what can be read.

    Raises:
        LogError: The file cannot be read any more.
    """
    hashes = {topic: hashlib.sha256() for topic in log.channels if topic != TIMING}
    for message in log.messages(hashes):
        head = _HEAD.pack(message.time, message.sequence, len(message.data))
        hashes[message.channel.topic].update(head + _named(message.channel.schema) + message.data)
    channels = {topic: content.hexdigest() for topic, content in sorted(hashes.items())}
    attachments = {
        name: hashlib.sha256(data).hexdigest()
        for name, data in sorted(log.attachments.items())
        if name in (MANIFEST, "resolved.yaml") or name.startswith("scenario/")
    }
    lines = [f"{name} {value}\n" for part in (channels, attachments) for name, value in part.items()]
    return Digest(channels, attachments, hashlib.sha256("".join(lines).encode()).hexdigest())


@cache
def _named(schema: str) -> bytes:
    name = schema.encode()
    return struct.pack("<I", len(name)) + name
