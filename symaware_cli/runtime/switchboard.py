"""The switchboard: connects events with what they trigger or resume."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable

from symaware_cli.core import Event, EventBus


class Connection:
    """A call on an event; `cancel` ends it, at any moment."""

    __slots__ = ("active", "call", "source")

    def __init__(self, source: str | None, call: Callable[[Event], object]) -> None:
        self.source = source
        self.call = call
        self.active = True

    def cancel(self) -> None:
        """Hear no more of it; harmless when repeated."""
        self.active = False


class Switchboard:
    """One subscription for each name of an event, however many components wait for it.

    Components that wait for an event again and again would make the bus itself ever slower. Calls come in the order in
    which they were connected; those of an exact source are found at once, among however many.
    """

    def __init__(self, events: EventBus) -> None:
        self._events = events
        #: By the name of the event: those with an exact source, by the source, and all others.
        self._exact: dict[str, dict[str, list[Connection]]] = {}
        self._open: dict[str, list[Connection]] = {}

    def connect(self, name: str, source: str | None, call: Callable[[Event], object]) -> Connection:
        """Call ``call(event)`` on each event of a name.

        Args:
            name: The event's name.
            source: A path, in which ``*`` matches anything; None for whatever source.
            call: Enters something in the agenda.
        """
        if name not in self._exact:
            self._exact[name], self._open[name] = {}, []
            self._events.subscribe(name, self._on_event if name != "*" else self._on_any)
        connection = Connection(source, call)
        if source is None or any(sign in source for sign in "*?["):
            self._open[name].append(connection)
        else:
            self._exact[name].setdefault(source, []).append(connection)
        return connection

    def _on_event(self, event: Event) -> None:
        self._tell(event.name, event)

    def _on_any(self, event: Event) -> None:
        self._tell("*", event)

    def _tell(self, name: str, event: Event) -> None:
        exact = self._exact[name]
        listeners = exact.pop(event.source, None)
        if listeners is not None:
            for each in tuple(listeners):
                if each.active:
                    each.call(event)
            remaining = [each for each in listeners if each.active]
            if remaining:
                # What was connected meanwhile comes behind.
                exact[event.source] = remaining + exact.get(event.source, [])
        waiting = self._open[name]
        if waiting:
            for each in tuple(waiting):
                if each.active and (each.source is None or fnmatch.fnmatchcase(event.source, each.source)):
                    each.call(event)
            if not all(each.active for each in waiting):
                waiting[:] = [each for each in waiting if each.active]
