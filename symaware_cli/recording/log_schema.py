"""The vocabulary of a log: its messages and the names that writer and reader share."""

import json
from collections.abc import Mapping
from typing import Any

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message

from symaware_cli.recording import symaware_v1_pb2 as v1

MAGIC = b"\x89MCAP0\r\n"
"""What an MCAP file begins and ends with."""

PROFILE = "symaware"
"""The profile in the header of the MCAP file."""

LIBRARY = "symaware"
"""The library in the header: whoever says this keeps the order of times and sequences in the file."""

FORMAT = 1
"""The version of the format (`format` in the manifest). A reader refuses a higher one."""

CHUNK_SIZE = 256 * 1024
"""Bytes of a chunk before compression, at most; only a message that is larger than that has a larger one to itself."""

LARGEST_CHUNK = 128 << 20
"""Bytes of a chunk before compression; the writer refuses a message that does not fit, a reader what claims more."""

TIMING = "/timing"
"""The only channel in which two equal runs may differ."""

MANIFEST = "manifest.json"
"""The attachment that says who took part."""

GEOMETRY = "geometry.json"
"""The attachment that says what bodies look like in a world of space; meshes that it names are attachments, too."""

OUTCOME = "symaware.outcome"
"""The metadata record that ends a run; its values are JSON."""

RECOVERY = "symaware.recovery"
"""The metadata record of a log that was recovered from a damaged one; its values are JSON."""

FORMER = {"symaware.v1.Control": "symaware.v1.Rows"}
"""What is read as another message: it has the fields of that, and more that are ignored.

What earlier logs say of the control input that was applied was computed from the one that was requested; only the
latter is read.
"""

MESSAGES: dict[str, type[Message]] = {
    message.DESCRIPTOR.name: message
    for message in (
        v1.Rows,
        v1.SeriesRows,
        v1.TableRows,
        v1.Awareness,
        v1.Knowledge,
        v1.Event,
        v1.Recurring,
        v1.Message,
        v1.MessageColumns,
        v1.Scan,
        v1.Image,
        v1.Contact,
        v1.Timing,
        v1.Specification,
    )
}
"""The generated class of each message, by its name without the package."""


def descriptor_set() -> bytes:
    """Serialise log.proto, which imports nothing, as a FileDescriptorSet: what an MCAP schema record holds."""
    files = FileDescriptorSet()
    v1.DESCRIPTOR.CopyToProto(files.file.add())
    return files.SerializeToString(deterministic=True)


def json_values(content: Mapping[str, Any]) -> dict[str, str]:
    """Lay out the content of a metadata record whose values are JSON."""
    return {key: json.dumps(value, sort_keys=True) for key, value in sorted(content.items())}
