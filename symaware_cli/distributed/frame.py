"""What host and members tell each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Contact, Delivery, MessageBatch
from symaware_cli.core.message import Indices

Array = NDArray[np.float64]

#: How a farewell begins for which there is no room; who hears it may come again.
CROWDED = "the host takes no more than"


@dataclass(frozen=True, slots=True)
class Hello:
    """A member asks to take part.

    Attributes:
        name: What to call it in messages to people.
        scenario: A digest of what it runs; the host's must be the same.
        version: Of the package.
        agents: The ids of those that it wants to run.
    """

    name: str
    scenario: bytes
    version: str
    agents: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Welcome:
    """The host takes a member in. The `Step` of this instant follows.

    Attributes:
        step: How many steps were made.
        time: Simulated time, in nanoseconds.
        pace: Simulated seconds for each second of wall time; 0 if the host waits for its members instead.
        started: When the host's monotonic clock showed the beginning of simulated time [s]; NaN if that is to come.
    """

    step: int
    time: int
    pace: float
    started: float


@dataclass(frozen=True, slots=True)
class Refusal:
    """The host does not take a member in.

    Attributes:
        reason: Why.
        final: Whether it is of no use to ask again.
    """

    reason: str
    final: bool = True


@dataclass(frozen=True, slots=True)
class Step:
    """The host tells how the world is at an instant, and what arrived for the agents of a member.

    Attributes:
        step: How many steps were made.
        time: Simulated time, in nanoseconds.
        world: All that `Environment.follow` takes, by name.
        contacts: Those that began or ended.
        arrived: Messages, in columns.
        started: As in `Welcome`.
    """

    step: int
    time: int
    world: Mapping[str, Array]
    contacts: tuple[Contact, ...] = ()
    arrived: tuple[Delivery, ...] = ()
    started: float = float("nan")


@dataclass(frozen=True, slots=True)
class Post:
    """What agents said.

    Attributes:
        batch: It.
        time: When, in nanoseconds.
    """

    batch: MessageBatch
    time: int


@dataclass(frozen=True, slots=True)
class Report:
    """A member tells what its agents did at an instant.

    Attributes:
        step: How many steps were made until then.
        inputs: By group, the rows that are the member's, and their control inputs; shapes (m,) and (m, nu).
        posts: What they said.
        peak: The greatest risk that one of them sees, and which; None if nobody sees any.
    """

    step: int
    inputs: Mapping[str, tuple[Indices, Array]]
    posts: tuple[Post, ...] = ()
    peak: tuple[float, str] | None = None


@dataclass(frozen=True, slots=True)
class Notice:
    """Something happened that everybody writes into the log; see `symaware_cli.core.Event`.

    Attributes:
        name: What.
        source: Where.
        level: The name of a `symaware_cli.core.Level`.
        text: For people.
        data: For programs: plain values.
    """

    name: str
    source: str
    level: str
    text: str
    data: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class End:
    """The run is over for whom this comes from.

    Attributes:
        status: ``finished``, ``failed`` or ``interrupted``.
        reason: Why.
        source: Where, if it failed.
    """

    status: str
    reason: str
    source: str = ""


Frame = Hello | Welcome | Refusal | Step | Report | Notice | End
