"""What happened in a run, entry by entry: events, messages between agents, contacts."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from symaware_cli.recording.json_text import read_json

#: The topics of messages between agents. Earlier versions wrote a `Message` for each on the first, and `MessageColumns`
#: for those of groups on the second; now there is the first alone, with `MessageColumns`.
MESSAGES = ("/messages", "/messages/columns")


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

    @property
    def latency(self) -> int:
        """How long after it was sent the stage was reached, simulated ns."""
        return self.time - self.sent_time


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
        impulse: How hard they hit each other in the step in which the contact begins, N s; 0 in worlds without forces.
    """

    time: int
    a: str
    b: str
    stage: str
    point: tuple[float, ...]
    depth: float
    impulse: float = 0.0


@dataclass(frozen=True, slots=True)
class LoggedKnowledge:
    """What an agent knows from now on.

    Attributes:
        time: Simulated time, ns.
        agent: Who.
        values: The whole of its knowledge database, by name; arrays as lists.
    """

    time: int
    agent: str
    values: dict[str, Any]


def event(time: int, message: Any) -> LoggedEvent:
    """Make an entry of a generated `Event`.

    Raises:
        ValueError: Its data are not JSON.
    """
    data = read_json(message.data) if message.data else {}
    level = _name(message, "level")
    return LoggedEvent(time, message.name, message.source, level, message.text, data)


def _former(time: int, message: Any) -> Communication:
    """Make an entry of a generated `Message`, as earlier versions wrote them."""
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
    """Make entries of a generated `MessageColumns`, or of a `Message`, as earlier versions wrote them.

    Args:
        time: When, simulated ns.
        message: One of the two.
        roster: The roster of the manifest.

    Raises:
        ValueError: Its payload is not JSON, its columns do not fit together, or it names who is not in the roster.
    """
    if not hasattr(message, "sequences"):
        return [_former(time, message)]
    count, stage, said = len(message.senders), _name(message, "stage"), _said(message)
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


def _said(message: Any) -> list[dict[str, Any]]:
    """What each in `says` says in a generated `MessageColumns`."""
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
    """Make an entry of a generated `Contact`."""
    stage = _name(message, "stage")
    return LoggedContact(time, message.a, message.b, stage, tuple(message.point), message.depth, message.impulse)


def knowledge(time: int, message: Any, agents: Sequence[str]) -> list[LoggedKnowledge]:
    """Make entries of a generated `Knowledge`.

    Raises:
        ValueError: Its values are not JSON, or of an agent that the group does not have.
    """
    rows = list(message.rows) or range(len(message.values))
    if len(rows) != len(message.values) or max(rows, default=0) >= max(len(agents), 1):
        raise ValueError(f"{len(message.values)} values for the rows {list(rows)} of a group of {len(agents)}")
    return [
        LoggedKnowledge(time, agents[row], read_json(value)) for row, value in zip(rows, message.values, strict=True)
    ]


def _name(message: Any, field_name: str) -> str:
    """The name of an enumeration's value; its number if a later version added it."""
    number = getattr(message, field_name)
    value = message.DESCRIPTOR.fields_by_name[field_name].enum_type.values_by_number.get(number)
    return value.name if value is not None else str(number)
