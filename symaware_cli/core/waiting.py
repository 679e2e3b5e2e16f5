"""Awaitables for a turn of the asynchronous mode: simulated time, an event, messages, or several of these.

Components create them with `Component.sleep`, `happening`, `messages`, `any_of` and `all_of`.
"""

from __future__ import annotations

from collections.abc import Awaitable, Generator
from typing import Any, NamedTuple

from symaware_cli.world import record


class Wait:
    """An awaitable; the runtime receives it, and resumes the component with the result."""

    __slots__ = ()

    def __await__(self) -> Generator[Wait, Any, Any]:
        return (yield self)


@record
class Sleep(Wait):
    """Waits for simulated time to pass.

    Attributes:
        duration: In nanoseconds.
    """

    duration: int

    def __str__(self) -> str:
        return f"{self.duration / 1e9:g} s to pass"


@record
class EventWait(Wait):
    """Waits for an event.

    Attributes:
        name: The event's name.
        source: A path, in which ``*`` matches anything.
    """

    name: str
    source: str

    def __str__(self) -> str:
        return f"the event {self.name} of {self.source}"


@record
class MessageWait(Wait):
    """Waits for messages.

    Attributes:
        receiver: The id of the agent they are for.
        reader: The name of the component that reads them, if it reads certain kinds only.
    """

    receiver: str
    reader: str = ""

    def __str__(self) -> str:
        return f"messages for {self.receiver}"


class First(NamedTuple):
    """The first result of several.

    Attributes:
        which: Its position in the list.
        value: The result.
    """

    which: int
    value: Any


@record
class Several(Wait):
    """Waits for any or all of several.

    Attributes:
        waits: Each a `Wait`, or an awaitable of asyncio.
    """

    waits: tuple[Awaitable[Any], ...]

    def __post_init__(self) -> None:
        if not self.waits:
            raise ValueError("there is nothing to wait for")
        for each in self.waits:
            if not isinstance(each, Awaitable):
                raise TypeError(
                    f"cannot wait for {type(each).__name__}; an awaitable is, for example, `self.sleep(0.2)`"
                )


class AnyOf(Several):
    """Waits for the first of several."""

    __slots__ = ()

    def __str__(self) -> str:
        return "any of " + ", ".join(map(said, self.waits))


class AllOf(Several):
    """Waits for all of several."""

    __slots__ = ()

    def __str__(self) -> str:
        return "all of " + ", ".join(map(said, self.waits))


def said(wait: Any) -> str:
    """Return a description of an awaitable."""
    return str(wait) if isinstance(wait, Wait) else type(wait).__name__
