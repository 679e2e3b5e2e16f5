"""The frames that host and members exchange, as named tuples."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Contact, Delivery, MessageBatch
from symaware_cli.core.message import Indices

Array = NDArray[np.float64]

#: How the farewell begins where there is no room for another member; it may try again.
CROWDED = "the host takes no more than"


class Checkpoint(NamedTuple):
    """A state that a member has stored.

    Attributes:
        run: The random bytes that the host drew for the run.
        step: The number of steps made when it was captured.
    """

    run: bytes
    step: int


class Hello(NamedTuple):
    """A member asks to take part.

    Attributes:
        name: Its name in logs and messages.
        scenario: The digest of its scenario; the host's must be the same.
        version: The version of its package.
        agents: The ids of the agents that it asks to run.
        checkpoint: The state from which it could continue; None if it has none.
    """

    name: str
    scenario: bytes
    version: str
    agents: tuple[str, ...]
    checkpoint: Checkpoint | None = None


class Welcome(NamedTuple):
    """The host admits a member. The `Step` of this instant follows.

    Attributes:
        step: The number of steps made.
        time: Simulated time, in nanoseconds.
        pace: Simulated seconds for each second of wall time; 0 if the host waits for its members instead.
        started: The host's monotonic clock at the beginning of simulated time [s]; NaN if it has not begun.
        run: Random bytes that the host drew for the run.
        restores: Whether the member continues from its checkpoint: all frames that were sent since then follow.
        absent: If it does and the run did not wait for it, the first step that its agents missed: they take part again
            with the first `Step` of this number or a greater one. None if they missed nothing.
    """

    step: int
    time: int
    pace: float
    started: float
    run: bytes = b""
    restores: bool = False
    absent: int | None = None


class Refusal(NamedTuple):
    """The host refuses a member.

    Attributes:
        reason: The reason.
        final: Whether asking again is pointless.
    """

    reason: str
    final: bool = True


class Step(NamedTuple):
    """The host sends the state of the world at an instant, and the messages that arrived for the agents of a member.

    Attributes:
        step: The number of steps made.
        time: Simulated time, in nanoseconds.
        world: The arguments of `Environment.follow`, by name.
        contacts: The contacts that began or ended.
        arrived: Messages, in columns.
        started: As in `Welcome`.
    """

    step: int
    time: int
    world: Mapping[str, Array]
    contacts: tuple[Contact, ...] = ()
    arrived: tuple[Delivery, ...] = ()
    started: float = float("nan")


class Post(NamedTuple):
    """Messages that agents sent at one instant.

    Attributes:
        batch: The messages.
        time: The instant, in nanoseconds.
    """

    batch: MessageBatch
    time: int


class Report(NamedTuple):
    """A member reports what its agents did at an instant.

    Attributes:
        step: The number of steps made until then.
        inputs: By group, the rows of the member's agents, and their control inputs; shapes (m,) and (m, nu).
        posts: The messages that they sent.
        peak: The greatest risk that one of them sees, and its id; None if none sees any.
        checkpoint: The number of steps made when the state was captured that it has stored last; None without one.
    """

    step: int
    inputs: Mapping[str, tuple[Indices, Array]]
    posts: tuple[Post, ...] = ()
    peak: tuple[float, str] | None = None
    checkpoint: int | None = None


class Notice(NamedTuple):
    """An event that other processes fire as well; see `symaware_cli.core.Event`.

    Attributes:
        name: The name of the event.
        source: Its source.
        level: The name of its `symaware_cli.core.Level`.
        text: The description.
        data: Plain values by name.
    """

    name: str
    source: str
    level: str
    text: str
    data: Mapping[str, Any] = MappingProxyType({})


class End(NamedTuple):
    """The run has ended for the sender.

    Attributes:
        status: ``finished``, ``failed`` or ``interrupted``.
        reason: The reason.
        source: The source of the failure, if it failed.
    """

    status: str
    reason: str
    source: str = ""


Frame = Hello | Welcome | Refusal | Step | Report | Notice | End
