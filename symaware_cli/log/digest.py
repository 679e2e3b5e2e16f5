"""Digests of logs: hashes that are equal for equal runs, independent of how messages are divided into chunks.

docs/log-format.md defines them for implementations in other languages.
"""

import hashlib
import struct
from dataclasses import dataclass
from functools import cache

from symaware_cli.log.log_schema import MANIFEST, TIMING
from symaware_cli.log.reader import Log

_HEAD = struct.Struct("<QII")


@dataclass(frozen=True, slots=True)
class Digest:
    """The SHA-256 of the deterministic content of a log, in hexadecimal.

    Attributes:
        channels: By topic, for every channel but /timing.
        attachments: By name, for the scenario as written, the resolved scenario and the manifest.
        combined: Of all channels and attachments.
    """

    channels: dict[str, str]
    attachments: dict[str, str]
    combined: str

    def differences(self, other: "Digest") -> list[str]:
        """Return the topics and attachments that differ, or that only one of the two has; sorted."""
        mine, theirs = self.channels | self.attachments, other.channels | other.attachments
        return sorted(name for name in mine.keys() | theirs.keys() if mine.get(name) != theirs.get(name))


def digest(log: Log) -> Digest:
    """Compute the digest of a log in one pass.

    Args:
        log: The log; for a damaged one, the digest of its readable part.

    Raises:
        LogError: The file can no longer be read.
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
