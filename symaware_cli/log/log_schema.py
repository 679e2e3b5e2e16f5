"""Constants of the log format: message types and names that writer and reader share."""

import json
from collections.abc import Mapping
from typing import Any

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message

from symaware_cli.log import symaware_v1_pb2 as v1

MAGIC = b"\x89MCAP0\r\n"
"""The first and last bytes of an MCAP file."""

PROFILE = "symaware"
"""The profile in the header of the MCAP file."""

LIBRARY = "symaware"
"""The library in the header; it guarantees that times and sequences ascend in the file."""

FORMAT = 1
"""The version of the format (`format` in the manifest). A reader rejects a higher one."""

CHUNK_SIZE = 256 * 1024
"""Maximum size of a chunk before compression [bytes]; a larger message has a chunk for itself."""

LARGEST_CHUNK = 128 << 20
"""Maximum size of any chunk before compression [bytes]; writers reject a larger message, readers a larger chunk."""

TIMING = "/timing"
"""The only channel in which two equal runs may differ."""

MANIFEST = "manifest.json"
"""The attachment that describes agents, entities and run."""

GEOMETRY = "geometry.json"
"""The attachment with the appearance of bodies in a spatial world; the meshes it names are attachments, too."""

OUTCOME = "symaware.outcome"
"""The metadata record with the outcome of a run; its values are JSON."""

RECOVERY = "symaware.recovery"
"""The metadata record of a log that was recovered from a damaged one; its values are JSON."""

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
    """Serialise log.proto, which has no imports, as a FileDescriptorSet: the content of an MCAP schema record."""
    files = FileDescriptorSet()
    v1.DESCRIPTOR.CopyToProto(files.file.add())
    return files.SerializeToString(deterministic=True)


def json_values(content: Mapping[str, Any]) -> dict[str, str]:
    """Convert values to JSON, for a metadata record."""
    return {key: json.dumps(value, sort_keys=True) for key, value in sorted(content.items())}
