"""Entries of a log: events, messages between agents, contacts and knowledge."""

from collections.abc import Sequence
from dataclasses import field
from typing import Any

import numpy as np

from symaware_cli.log.json_text import read_json
from symaware_cli.world import record

#: The topics of messages between agents. Earlier versions wrote a `Message` for each on the first, and `MessageColumns`
#: for groups on the second; now all are `MessageColumns` on the first.
MESSAGES = ("/messages", "/messages/columns")


@record
class LoggedEvent:
    """An event.

    Attributes:
        time: Simulated time, ns.
        name: Such as `failed`.
        source: Dotted path of its origin, such as `agents.robot.2.steer`.
        level: `DEBUG`, `INFO`, `WARNING` or `ERROR`.
        text: Description for users.
        data: Data for programs.
    """

    time: int
    name: str
    source: str
    level: str
    text: str
    data: dict[str, Any] = field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """Simulated time in seconds."""
        return self.time / 1e9


@record
class Communication:
    """A stage in the life of a message between agents.

    Attributes:
        time: When the stage was reached, simulated ns.
        id: Identifies the message; equal in all its stages.
        sender: The agent that sent it.
        receiver: The agent it is addressed to.
        kind: The kind of message.
        stage: `SENT`, `DELIVERED` or `DROPPED`.
        sent_time: When it was sent, simulated ns.
        reason: Why it was dropped.
        payload: Its content; None if this stage does not repeat it.
        size: Its size on the simulated channel, bytes.
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

    @property
    def latency(self) -> int:
        """Time from sending to this stage, simulated ns."""
        return self.time - self.sent_time


@record
class LoggedContact:
    """The beginning or end of a contact between two bodies.

    Attributes:
        time: Simulated time, ns.
        a: The first agent or entity.
        b: The second agent or entity.
        stage: `BEGIN`, `END`, or `RESUME` if the bodies touch again within the debounce of their world.
        point: Point of contact, m; empty if unknown.
        depth: Penetration depth, m.
        impulse: Impulse in the step in which the contact begins, N s; 0 in worlds without forces.
    """

    time: int
    a: str
    b: str
    stage: str
    point: tuple[float, ...]
    depth: float
    impulse: float = 0.0


@record
class LoggedKnowledge:
    """The knowledge of an agent from a time on.

    Attributes:
        time: Simulated time, ns.
        agent: The id of the agent.
        values: Its whole knowledge database, by name; arrays as lists.
    """

    time: int
    agent: str
    values: dict[str, Any]


def event(time: int, message: Any) -> LoggedEvent:
    """Create an entry from a generated `Event`.

    Raises:
        ValueError: Its data are not JSON.
    """
    data = read_json(message.data) if message.data else {}
    level = _name(message, "level")
    return LoggedEvent(time, message.name, message.source, level, message.text, data)


def recurring_entries(time: int, message: Any) -> list[LoggedEvent]:
    """Create entries from a generated `Recurring`, in the order in which the events were fired.

    Raises:
        IndexError: An index is out of range.
    """
    pairs = zip(message.name, message.source, strict=True)
    return [LoggedEvent(time, message.names[name], message.sources[source], "DEBUG", "") for name, source in pairs]


def _legacy_message(time: int, message: Any) -> Communication:
    """Create an entry from a generated `Message`, as earlier versions wrote them."""
    return Communication(
        time=time,
        id=message.id,
        sender=message.sender,
        receiver=message.receiver,
        kind=message.kind,
        stage=_name(message, "stage"),
        sent_time=message.sent_time,
        reason=message.reason,
        payload=read_json(message.payload) if message.payload else None,
        size=message.size,
    )


def communications(time: int, message: Any, roster: Sequence[str]) -> list[Communication]:
    """Create entries from a generated `MessageColumns`, or from a `Message` of an earlier version.

    Args:
        time: Simulated time, ns.
        message: One of the two.
        roster: The roster of the manifest.

    Raises:
        ValueError: A payload is not JSON, the columns are inconsistent, or an index is not in the roster.
    """
    if not hasattr(message, "sequences"):
        return [_legacy_message(time, message)]
    count, stage, said = len(message.senders), _name(message, "stage"), _payloads(message)
    reasons = [message.reasons[number] for number in message.reason] or [""] * count
    payloads: list[dict[str, Any] | None] = [None] * count
    if said:
        places = {sender: place for place, sender in enumerate(message.says)}
        rows = message.rows or [places.get(sender) for sender in message.senders]
        payloads = [None if row is None else said[row] for row in rows]
    columns = (message.senders, message.receivers, message.sequences, reasons, payloads)
    try:
        return [
            Communication(
                time=time,
                id=(sender << 32) | sequence,
                sender=roster[sender],
                receiver=roster[receiver],
                kind=message.kind,
                stage=stage,
                sent_time=message.sent_time,
                reason=reason,
                payload=payload,
                size=size,
            )
            for sender, receiver, sequence, reason, payload, size in zip(
                *columns, message.sizes or [message.size] * count, strict=True
            )
        ]
    except IndexError:
        raise ValueError(f"messages between more agents than the {len(roster)} of the roster") from None


def _payloads(message: Any) -> list[dict[str, Any]]:
    """Return the payload of each sender in `says` of a generated `MessageColumns`."""
    said: list[dict[str, Any]] = [{} for _ in message.says]
    for column in message.said:
        if column.texts:
            known = {text: read_json(text) for text in set(column.texts)}
            values = [known[text] for text in column.texts]
        else:
            values = np.array(column.values).reshape(len(message.says), *column.shape).tolist()
        for payload, value in zip(said, values, strict=True):
            payload[column.name] = value
    return said


def contact(time: int, message: Any) -> LoggedContact:
    """Create an entry from a generated `Contact`."""
    stage = _name(message, "stage")
    return LoggedContact(time, message.a, message.b, stage, tuple(message.point), message.depth, message.impulse)


def knowledge(time: int, message: Any, agents: Sequence[str]) -> list[LoggedKnowledge]:
    """Create entries from a generated `Knowledge`.

    Raises:
        ValueError: Its values are not JSON, or refer to a row that the group does not have.
    """
    rows = list(message.rows) or range(len(message.values))
    if len(rows) != len(message.values) or max(rows, default=0) >= max(len(agents), 1):
        raise ValueError(f"{len(message.values)} values for the rows {list(rows)} of a group of {len(agents)}")
    return [
        LoggedKnowledge(time, agents[row], read_json(value)) for row, value in zip(rows, message.values, strict=True)
    ]


def _name(message: Any, field_name: str) -> str:
    """Return the name of an enumeration value; its number if a later version added it."""
    number = getattr(message, field_name)
    value = message.DESCRIPTOR.fields_by_name[field_name].enum_type.values_by_number.get(number)
    return value.name if value is not None else str(number)
