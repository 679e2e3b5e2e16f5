"""Decodes the messages of a bag, if their definitions are those of ROS 2 Jazzy."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any, Literal

from symaware_cli.bags import ros_messages as ros
from symaware_cli.bags.bag import Bag
from symaware_cli.bags.bag_error import BagError
from symaware_cli.world import nearest

TimeSource = Literal["stamp", "received"]
"""The source of a message's time: the stamp of its header, or the time of recording."""

_LONGEST_DEFINITION = 1 << 17


def require_rosbags() -> None:
    """Check that the module that decodes messages is installed.

    Raises:
        BagError: The module is missing.
    """
    if find_spec("rosbags") is None:
        raise BagError(f"bags need the module `rosbags`, which is not installed: {ros.INSTALL}")


def check_topic(bag: Bag, topic: str, kinds: tuple[str, ...]) -> str:
    """Check that a topic can be read, and return the type of its messages.

    Args:
        bag: The bag.
        topic: The topic.
        kinds: The types that can be used.

    Raises:
        BagError: The topic is missing, of another type, or serialised or defined differently than in ROS 2 Jazzy.
    """
    require_rosbags()
    if topic not in bag.topics:
        close = nearest(topic, bag.topics)
        there = f"did you mean `{close}`?" if close else f"there are {', '.join(sorted(bag.topics)[:20])}"
        raise BagError(f"there is no topic `{topic}` in it; {there}")
    info = bag.topics[topic]
    if info.kind not in kinds:
        raise BagError(f"the messages on `{topic}` are {info.kind}; those that can be used are {', '.join(kinds)}")
    if info.encoding != "cdr":
        raise BagError(f"the messages on `{topic}` are serialised as `{info.encoding}`, not as cdr")
    if info.definition and not _is_known(info.definition, info.kind):
        raise BagError(f"the definition of {info.kind} in it is not that of ROS 2 Jazzy")
    return info.kind


def _is_known(definition: str, kind: str) -> bool:
    """Return whether a definition has the same fields as in ROS 2 Jazzy."""
    from rosbags.typesys import TypesysError, get_types_from_msg

    if len(definition) > _LONGEST_DEFINITION:
        return False
    try:
        found = get_types_from_msg(definition, kind)
    except TypesysError:
        return False
    known = ros.typestore().fielddefs
    return all(name in known and known[name][1] == fields for name, (_, fields) in found.items())


def decoded(bag: Bag, topic: str, kind: str) -> Iterator[tuple[int, Any]]:
    """Yield the time of recording [ns] and the decoded content of each message on a topic.

    Raises:
        BagError: A message is damaged.
    """
    from rosbags.serde import SerdeError

    store = ros.typestore()
    for _, time, data in bag.messages([topic]):
        try:
            yield time, store.deserialize_cdr(data, kind)
        except (SerdeError, ValueError, IndexError, MemoryError, OverflowError) as error:
            raise BagError(f"the message on `{topic}` at {time} ns is damaged: {error}") from error


def time_of(received: int, header: Any, source: TimeSource) -> int:
    """Return the time of a message [ns]."""
    return received if source == "received" else int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)
