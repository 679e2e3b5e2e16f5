"""Exports for Foxglove, decoded with the schemas in the file."""

from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf import descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Messages = dict[str, list[tuple[int, Any]]]
"""By topic, the time of each message and the message."""


def read(path: Path) -> Messages:
    """The messages of an MCAP, decoded with the schemas in it: topic -> [(time, message)]."""
    kinds = {}
    messages: dict[Any, Any] = {}
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            assert schema is not None
            if schema.id not in kinds:
                pool = descriptor_pool.DescriptorPool()
                for each in FileDescriptorSet.FromString(schema.data).file:
                    pool.Add(each)
                kinds[schema.id] = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
            messages.setdefault(channel.topic, []).append((message.log_time, kinds[schema.id].FromString(message.data)))
            assert message.publish_time == message.log_time
    return messages


def frames(message: Any) -> dict[str, tuple[str, NDArray[np.float64], Rotation]]:
    """By name its parent, translation and rotation."""
    return {
        each.child_frame_id: (
            each.parent_frame_id,
            np.array([each.translation.x, each.translation.y, each.translation.z]),
            Rotation.from_quat([each.rotation.x, each.rotation.y, each.rotation.z, each.rotation.w]),
        )
        for each in message.transforms
    }
