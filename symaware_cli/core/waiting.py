"""What a component may wait for within a turn of the asynchronous mode: simulated time, an event, messages, or several.

A component does not make these itself: `Component.sleep`, `happening`, `messages`, `any_of` and `all_of` do.
"""

from __future__ import annotations

from collections.abc import Awaitable, Generator
from dataclasses import dataclass
from typing import Any, NamedTuple


class Wait:
    """Something to await; the runtime is handed it, and resumes the component with what it waited for."""

    __slots__ = ()

    def __await__(self) -> Generator[Wait, Any, Any]:
        return (yield self)


@dataclass(frozen=True, slots=True)
class Sleep(Wait):
    """Simulated time that shall pass.

    Attributes:
        duration: In nanoseconds.
    """

    duration: int

    def __str__(self) -> str:
        return f"{self.duration / 1e9:g} s to pass"


@dataclass(frozen=True, slots=True)
class EventWait(Wait):
    """An event that shall fire.

    Attributes:
        name: The event's name.
        source: A path, in which ``*`` matches anything.
    """

    name: str
    source: str

    def __str__(self) -> str:
        return f"the event {self.name} of {self.source}"


@dataclass(frozen=True, slots=True)
class MessageWait(Wait):
    """Messages that shall arrive.

    Attributes:
        receiver: The id of the agent they are for.
        reader: The name of the component that reads them, where it reads certain kinds.
    """

    receiver: str
    reader: str = ""

    def __str__(self) -> str:
        return f"messages for {self.receiver}"


class First(NamedTuple):
    """What came first of several.

    Attributes:
        which: Its position among those that were waited for.
        value: What it came to.
    """

    which: int
    value: Any


@dataclass(frozen=True, slots=True)
class Several(Wait):
    """Some of which any, or all, shall come.

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
    """Several things of which one shall come."""

    __slots__ = ()

    def __str__(self) -> str:
        return "any of " + ", ".join(map(said, self.waits))


class AllOf(Several):
    """Several things that shall come."""

    __slots__ = ()

    def __str__(self) -> str:
        return "all of " + ", ".join(map(said, self.waits))


def said(wait: Any) -> str:
    """Name what is waited for."""
    return str(wait) if isinstance(wait, Wait) else type(wait).__name__
