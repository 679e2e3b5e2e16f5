"""Events: what happened, when, to whom; and those who want to know."""

from __future__ import annotations

import enum
import fnmatch
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any, ClassVar

from symaware_cli.core.stateful import StateError

#: What a component announces about its turns; hot paths make these only if somebody listens.
TURNS = frozenset({"computing", "computed", "updating", "updated"})

#: Events that recur with every step, turn or message: never part of ``*``, and not recorded as events.
RECURRING = TURNS | {
    *("initialising", "initialised", "iterating", "iterated", "stepping", "stepped"),
    *("sending", "sent", "received", "dropped", "traffic", "adding", "removing"),
}


class Level(enum.IntEnum):
    """How much an event matters to somebody who reads the log."""

    DEBUG = 0
    INFO = 1
    WARNING = 2
    ERROR = 3


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened.

    Attributes:
        name: What, in the past or present participle, such as ``goal-reached``.
        source: The dotted path of whom it happened to, such as ``agents.robot.2.steer`` or ``environment``.
        time: When, in nanoseconds of simulated time.
        level: How much it matters.
        text: One line for people.
        data: Further facts; plain JSON values, so that they can be recorded.
        subject: The object it is about, for subscribers within the process; never recorded.
        agent: The id of the agent that it happened to; None where it is not about a single one.
        value: What was computed, of ``computed``, ``updating`` and ``updated``; never recorded.
    """

    name: str
    source: str
    time: int
    level: Level = Level.INFO
    text: str = ""
    data: Mapping[str, Any] = field(default_factory=dict)
    subject: Any = None
    agent: str | None = None
    value: Any = None


Subscriber = Callable[[Event], Any]


class SubscriberError(Exception):
    """A subscriber raised while it was told of an event."""

    def __init__(self, event: Event, subscriber: Subscriber) -> None:
        name = getattr(subscriber, "__qualname__", repr(subscriber))
        super().__init__(f"subscriber {name} of event {event.name} of {event.source} raised")
        self.event = event
        self.subscriber = subscriber


class Subscription:
    """The right to be told of an event; `cancel` ends it, at any moment, also while the event fires."""

    __slots__ = ("active", "callback", "number", "source")

    def __init__(self, callback: Subscriber, source: str, number: int) -> None:
        self.callback = callback
        self.source = source
        self.number = number
        self.active = True

    def cancel(self) -> None:
        """Stop being told; harmless when repeated."""
        self.active = False


_number = attrgetter("number")


class EventBus:
    """Delivers events to subscribers, in the order in which they subscribed.

    Subscribers may subscribe and cancel while an event fires: the ones added hear from the next event on,
    the ones cancelled hear no more at once.
    """

    __slots__ = ("_count", "_muted", "_subscriptions", "turns_wanted", "wanted")

    #: Who listens belongs to the process; what components subscribed to is told by `captured`.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(self) -> None:
        self._count = 0
        self._muted: Collection[str] = ()
        self._subscriptions: dict[str, tuple[Subscription, ...]] = {}
        #: The names that somebody subscribed to; hot paths look here before they make an event.
        self.wanted: frozenset[str] = frozenset()
        #: Whether any of `TURNS` is among them.
        self.turns_wanted = False

    def subscribe(self, name: str, callback: Subscriber, source: str = "*") -> Subscription:
        """Call ``callback(event)`` on each event of this name.

        Args:
            name: The event's name; ``*`` stands for every event that is not `RECURRING`.
            callback: Is given the `Event`.
            source: A path, in which ``*`` matches anything.
        """
        self._count += 1
        subscription = Subscription(callback, source, self._count)
        present = tuple(each for each in self._subscriptions.get(name, ()) if each.active)
        self._subscriptions[name] = (*present, subscription)
        self.wanted = frozenset(self._subscriptions)
        self.turns_wanted = not TURNS.isdisjoint(self.wanted)
        return subscription

    @contextmanager
    def muted(self, sources: Collection[str]) -> Iterator[None]:
        """Tell nobody of what comes from some sources for a while.

        A component of a whole group speaks for all its agents, and knows nothing of those that take no part any more.
        """
        before, self._muted = self._muted, sources
        try:
            yield
        finally:
            self._muted = before

    def captured(self) -> list[list[str]]:
        """What components listen to, which they do from their start on."""
        return [
            [name, each.source, path]
            for name, subscriptions in sorted(self._subscriptions.items())
            for each in subscriptions
            if each.active and (path := getattr(getattr(each.callback, "__self__", None), "path", ""))
        ]

    def check_state(self, state: list[list[str]]) -> None:
        """Make sure that the same components listen to the same.

        Raises:
            StateError: One of them subscribed to something, or cancelled that, in a turn.
        """
        for name, source, path in sorted(set(map(tuple, state)) ^ set(map(tuple, self.captured()))):
            raise StateError(f"{path} listens to `{name}` of {source} at one of two instants, and not at the other")

    def restored(self, state: list[list[str]]) -> None:
        """Go on; there is nothing to take over."""

    def fire(self, event: Event) -> None:
        """Tell all who subscribed.

        Raises:
            SubscriberError: From the exception of the first subscriber that raised, after all were told.
        """
        if self._muted and event.source in self._muted:
            return
        listeners = self._subscriptions.get(event.name, ())
        if event.name not in RECURRING and (others := self._subscriptions.get("*")):
            # In one order for all, so that a recorder, which comes first, writes a cause before its consequences.
            listeners = tuple(sorted((*listeners, *others), key=_number)) if listeners else others
        failure: tuple[Subscriber, BaseException] | None = None
        for listener in listeners:
            if not listener.active:
                continue
            if listener.source not in ("*", event.source) and not fnmatch.fnmatchcase(event.source, listener.source):
                continue
            try:
                listener.callback(event)
            except (Exception, KeyboardInterrupt, SystemExit, GeneratorExit) as error:
                failure = failure or (listener.callback, error)
        if failure:
            raise SubscriberError(event, failure[0]) from failure[1]
