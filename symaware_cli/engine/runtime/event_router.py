"""The event router: calls handlers by the name and the source of events, with one bus subscription per name."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable

from symaware_cli.core import Event, EventBus


class EventHandler:
    """A handler that is called on events; `cancel` disconnects it at any time."""

    __slots__ = ("_among", "active", "call", "source")

    def __init__(self, source: str | None, call: Callable[[Event], object], among: dict[EventHandler, None]) -> None:
        self.source = source
        self.call = call
        self.active = True
        self._among = among
        among[self] = None

    def cancel(self) -> None:
        """Disconnect the handler; has no effect when repeated."""
        self.active = False
        self._among.pop(self, None)


class EventRouter:
    """Connects handlers with events; holds one bus subscription for each name, however many handlers there are.

    Subscribing to the bus for each wait of a component would make the bus slower and slower. Handlers are called in the
    order of connection, first those of the exact source; these are found by a dictionary lookup.
    """

    def __init__(self, events: EventBus) -> None:
        self._events = events
        #: By the event's name: handlers with an exact source, by that source; and all others.
        self._exact: dict[str, dict[str, dict[EventHandler, None]]] = {}
        self._open: dict[str, dict[EventHandler, None]] = {}

    def __len__(self) -> int:
        exact = sum(len(each) for sources in self._exact.values() for each in sources.values())
        return exact + sum(len(each) for each in self._open.values())

    def connect(self, name: str, source: str | None, call: Callable[[Event], object]) -> EventHandler:
        """Call ``call(event)`` on each event of a name.

        Args:
            name: The event's name.
            source: A path, in which ``*`` matches anything; None for any source.
            call: The function to call.
        """
        if name not in self._exact:
            self._exact[name], self._open[name] = {}, {}
            self._events.subscribe(name, self._on_event if name != "*" else self._on_any)
        if source is None or any(sign in source for sign in "*?["):
            return EventHandler(source, call, self._open[name])
        return EventHandler(source, call, self._exact[name].setdefault(source, {}))

    def _on_event(self, event: Event) -> None:
        self._tell(event.name, event)

    def _on_any(self, event: Event) -> None:
        self._tell("*", event)

    def _tell(self, name: str, event: Event) -> None:
        for each in tuple(self._exact[name].get(event.source, ())):
            if each.active:
                each.call(event)
        for each in tuple(self._open[name]):
            if each.active and (each.source is None or fnmatch.fnmatchcase(event.source, each.source)):
                each.call(event)
