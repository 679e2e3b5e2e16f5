"""The router: connects events with what they trigger or resume."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable

from symaware_cli.core import Event, EventBus


class EventHandler:
    """A call on an event; `cancel` ends it, at any moment."""

    __slots__ = ("_among", "active", "call", "source")

    def __init__(self, source: str | None, call: Callable[[Event], object], among: dict[EventHandler, None]) -> None:
        self.source = source
        self.call = call
        self.active = True
        self._among = among
        among[self] = None

    def cancel(self) -> None:
        """Hear no more of it; harmless when repeated."""
        self.active = False
        self._among.pop(self, None)


class EventRouter:
    """One subscription for each name of an event, however many components wait for it.

    Components that wait for an event again and again would make the bus itself ever slower. Calls come in the order in
    which they were connected; those of an exact source are found at once, among however many.
    """

    def __init__(self, events: EventBus) -> None:
        self._events = events
        #: By the name of the event: those with an exact source, by the source, and all others.
        self._exact: dict[str, dict[str, dict[EventHandler, None]]] = {}
        self._open: dict[str, dict[EventHandler, None]] = {}

    def __len__(self) -> int:
        exact = sum(len(each) for sources in self._exact.values() for each in sources.values())
        return exact + sum(len(each) for each in self._open.values())

    def connect(self, name: str, source: str | None, call: Callable[[Event], object]) -> EventHandler:
        """Call ``call(event)`` on each event of a name.

        Args:
            name: The event's name.
            source: A path, in which ``*`` matches anything; None for whatever source.
            call: Enters something in the queue.
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
