"""What happened in a run, entry by entry: events, messages between agents, contacts."""

import json
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class LoggedEvent:
    """Something that happened.

    Attributes:
        time: Simulated time, ns.
        name: What, such as `failed`.
        source: Where, as a dotted path such as `agents.robot.2.steer`.
        level: `DEBUG`, `INFO`, `WARNING` or `ERROR`.
        text: For people.
        data: For programs.
    """

    time: int
    name: str
    source: str
    level: str
    text: str
    data: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Communication:
    """One stage in the life of a message between agents.

    Attributes:
        time: When the stage was reached, simulated ns.
        id: The same in all stages of one message.
        sender: The agent that sent it.
        receiver: The agent it is for.
        kind: What it is about.
        stage: `SENT`, `DELIVERED` or `DROPPED`.
        sent_time: When it was sent, simulated ns.
        reason: Why it was dropped.
        payload: What it says; None if this stage does not repeat it.
        size: On the simulated channel, bytes.
    """

    time: int
    id: int
    sender: str
    receiver: str
    kind: str
    stage: str
    sent_time: int
    reason: str
    payload: Any
    size: int


@dataclass(frozen=True, slots=True)
class LoggedContact:
    """Two entities touch, or cease to.

    Attributes:
        time: Simulated time, ns.
        a: The one.
        b: The other.
        stage: `BEGIN` or `END`.
        point: Where, m; empty if unknown.
        depth: How deep they overlap, m.
    """

    time: int
    a: str
    b: str
    stage: str
    point: tuple[float, ...]
    depth: float


def event(time: int, message: Any) -> LoggedEvent:
    """Make an entry of a generated `Event`.

    Raises:
        ValueError: Its data are not JSON.
    """
    data = json.loads(message.data) if message.data else {}
    level = _name(message, "level")
    return LoggedEvent(time, message.name, message.source, level, message.text, data)


def communication(time: int, message: Any) -> Communication:
    """Make an entry of a generated `Message`.

    Raises:
        ValueError: Its payload is not JSON.
    """
    return Communication(
        time=time,
        id=message.id,
        sender=message.sender,
        receiver=message.receiver,
        kind=message.kind,
        stage=_name(message, "stage"),
        sent_time=message.sent_time,
        reason=message.reason,
        payload=json.loads(message.payload) if message.payload else None,
        size=message.size,
    )


def contact(time: int, message: Any) -> LoggedContact:
    """Make an entry of a generated `Contact`."""
    return LoggedContact(time, message.a, message.b, _name(message, "stage"), tuple(message.point), message.depth)


def _name(message: Any, field_name: str) -> str:
    """The name of an enumeration's value; its number if a later version added it."""
    number = getattr(message, field_name)
    value = message.DESCRIPTOR.fields_by_name[field_name].enum_type.values_by_number.get(number)
    return value.name if value is not None else str(number)
