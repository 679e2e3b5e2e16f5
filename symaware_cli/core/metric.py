"""Metrics: figures of a run, one value in its row of the table of a sweep."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Literal

from symaware_cli.core.agent import AgentGroup
from symaware_cli.core.environment import Environment
from symaware_cli.core.event import Event, EventBus
from symaware_cli.world import Plugin


class Metric(Plugin, ABC):
    """A figure of a run, computed during the run; it has one value at the end.

    An instance follows one run. If it raises an exception, the row of the run has the state ``failed``.

    Attributes:
        kind: The type of its value; a ``series`` is a sequence of pairs of a time [s] and a number.
        unit: The unit of its value; empty for none.
        version: A number that changes when the same run gives another value.
        environment: The environment of the run.
        groups: Its groups of agents.
    """

    kind: ClassVar[Literal["number", "integer", "truth", "text", "series"]] = "number"
    unit: ClassVar[str] = ""
    version: ClassVar[int] = 1

    environment: Environment
    groups: Sequence[AgentGroup]

    def attach(self, environment: Environment, groups: Sequence[AgentGroup], events: EventBus) -> None:
        """Follow a run that is about to begin."""
        self.environment = environment
        self.groups = groups
        self._events = events
        self.begin()

    def begin(self) -> None:
        """Prepare, and subscribe to events; by default nothing."""

    def look(self, now: int) -> None:
        """Take note of the world at a step, after the turns of all components, and once more at the end.

        Args:
            now: Simulated time in nanoseconds.
        """

    @abstractmethod
    def value(self) -> float | int | bool | str | Sequence[tuple[float, float]] | None:
        """Return the value when the run is over; None where there is none."""

    def subscribe(self, name: str, callback: Callable[[Event], Any]) -> None:
        """Call ``callback(event)`` on each event of this name."""
        self._events.subscribe(name, callback)
