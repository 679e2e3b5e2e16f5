"""What a component may wait for within a turn of the asynchronous mode: simulated time, an event, messages.

A component does not make these itself: `Component.sleep`, `happening` and `messages` do.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any


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
class Happening(Wait):
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
class Mail(Wait):
    """Messages that shall arrive.

    Attributes:
        receiver: The id of the agent they are for.
        reader: The name of the component that reads them, where it reads certain kinds.
    """

    receiver: str
    reader: str = ""

    def __str__(self) -> str:
        return f"messages for {self.receiver}"
