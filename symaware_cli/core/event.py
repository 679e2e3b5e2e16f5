"""Events and their subscribers."""

from __future__ import annotations

import enum
import fnmatch
import functools
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import field
from operator import attrgetter
from typing import Any, ClassVar

from symaware_cli.core.stateful import StateError
from symaware_cli.world import record

#: The events of a component's turns; hot paths create these only if there are subscribers.
TURNS = frozenset({"computing", "computed", "updating", "updated"})

#: Events that occur at every step, turn or message: never part of ``*``, and not recorded as events by default.
RECURRING = TURNS | {
    *("initialising", "initialised", "iterating", "iterated", "stepping", "stepped"),
    *("sending", "sent", "received", "dropped", "traffic", "adding", "removing", "touching", "external-input"),
}

#: Those of `RECURRING` that have a channel of their own in the log.
CHANNELS = frozenset({"traffic", "touching", "external-input"})


class Level(enum.IntEnum):
    """The importance of an event to a reader of the log."""

    DEBUG = 0
    INFO = 1
    WARNING = 2
    ERROR = 3


@record
class Event:
    """Something that happened.

    Attributes:
        name: The name, ending in a past or present participle, such as ``goal-reached``.
        source: The dotted path of its origin, such as ``agents.robot.2.steer`` or ``environment``.
        time: Simulated time in nanoseconds.
        level: Its importance.
        text: One line for people.
        data: Further facts as plain JSON values, which are recorded.
        subject: The object that it concerns, for subscribers within the process; never recorded.
        agent: The id of the agent that it concerns; None if it does not concern a single one.
        value: A value for subscribers, which must not be changed and is never recorded: the computed value for
            ``computed``, ``updating`` and ``updated``, the `Message` for ``sending``, ``sent``, ``received`` and
            ``dropped``, the `Contact` for ``contact``.
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

    @property
    def seconds(self) -> float:
        """Simulated time in seconds."""
        return self.time / 1e9

    @property
    def component(self) -> str | None:
        """The name of the component that it concerns, such as ``steer``; None if it does not concern one."""
        if not self.source.startswith("agents."):
            return None
        if self.agent is not None:
            return self.source.removeprefix(f"agents.{self.agent}").removeprefix(".") or None
        # Of the whole group; the name of a group has no dots.
        return self.source.removeprefix("agents.").partition(".")[2] or None


Subscriber = Callable[[Event], Any]


class SubscriberError(Exception):
    """A subscriber raised an exception while it handled an event."""

    def __init__(self, event: Event, subscriber: Subscriber) -> None:
        name = getattr(subscriber, "__qualname__", repr(subscriber))
        super().__init__(f"subscriber {name} of event {event.name} of {event.source} raised")
        self.event = event
        self.subscriber = subscriber


class Subscription:
    """A subscription to an event; it can be cancelled at any time, also while the event fires."""

    __slots__ = ("active", "callback", "number", "source")

    def __init__(self, callback: Subscriber, source: str, number: int) -> None:
        self.callback = callback
        self.source = source
        self.number = number
        self.active = True

    def cancel(self) -> None:
        """End the subscription; may be called repeatedly."""
        self.active = False


_number = attrgetter("number")


def _matching(pattern: str, callback: Subscriber) -> Subscriber:
    """Pass on the events whose names match a pattern."""

    @functools.wraps(callback, updated=())
    def passing(event: Event) -> Any:
        return callback(event) if fnmatch.fnmatchcase(event.name, pattern) else None

    return passing


class EventBus:
    """Delivers events to subscribers, in the order in which they subscribed.

    Subscribers may subscribe and cancel while an event fires: new ones receive events from the next one on, cancelled
    ones receive none from that moment on.
    """

    __slots__ = (
        *("_by_owner", "_components", "_count", "_listeners", "_muted", "_subscriptions"),
        *("turns_wanted", "wanted"),
    )

    #: Subscribers belong to the process; `captured` returns the subscriptions of components.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(self) -> None:
        self._count = 0
        self._muted: Collection[str] = ()
        self._components: Callable[[], Mapping[str, object]] = dict
        #: The subscriptions of each component, by its identity.
        self._by_owner: dict[int, list[Subscription]] = {}
        self._subscriptions: dict[str, tuple[Subscription, ...]] = {}
        #: Those that get an event of a name, for each name that was fired since the last one subscribed.
        self._listeners: dict[str, tuple[Subscription, ...]] = {}
        #: The names with subscribers; hot paths check this before they create an event.
        self.wanted: frozenset[str] = frozenset()
        #: Whether any of `TURNS` is among them.
        self.turns_wanted = False

    def subscribe(self, name: str, callback: Subscriber, source: str = "*") -> Subscription:
        """Call ``callback(event)`` on each event of this name.

        Args:
            name: The event's name; ``*`` stands for every event that is not `RECURRING`.
            callback: Called with the `Event`.
            source: A path, in which ``*`` matches anything.
        """
        return self._add((name,), callback, source)

    def _add(self, names: Iterable[str], callback: Subscriber, source: str) -> Subscription:
        self._count += 1
        subscription = Subscription(callback, source, self._count)
        owner = getattr(callback, "__self__", None)
        if getattr(owner, "path", ""):
            earlier = self._by_owner.get(id(owner), ())
            self._by_owner[id(owner)] = [*(each for each in earlier if each.active), subscription]
        for name in names:
            present = tuple(each for each in self._subscriptions.get(name, ()) if each.active)
            self._subscriptions[name] = (*present, subscription)
        self._listeners.clear()
        self.wanted = frozenset(self._subscriptions)
        self.turns_wanted = not TURNS.isdisjoint(self.wanted)
        return subscription

    def subscribe_matching(self, pattern: str, callback: Subscriber, source: str = "*") -> Subscription:
        """Call ``callback(event)`` on each event whose name matches a pattern, those that recur included.

        Args:
            pattern: The event's name, in which ``*`` matches anything.
            callback: Called with the `Event`.
            source: A path, in which ``*`` matches anything.
        """
        if not set(pattern) & set("*?["):
            return self.subscribe(pattern, callback, source)
        recurring = sorted(name for name in RECURRING - CHANNELS if fnmatch.fnmatchcase(name, pattern))
        return self._add(("*", *recurring), callback if pattern == "*" else _matching(pattern, callback), source)

    def mute(self, sources: Collection[str]) -> None:
        """Suppress the events of these sources from now on, and of no others.

        A component of a whole group fires events for all its agents, including those that no longer take part.
        """
        self._muted = sources

    @property
    def muted(self) -> Collection[str]:
        """The sources whose events are suppressed at present: components of agents for which a group's does not act."""
        return self._muted

    def name_components(self, components: Callable[[], Mapping[str, object]]) -> None:
        """Take a function that returns the components by unique names; their subscriptions are captured."""
        self._components = components

    def _owned(self) -> Iterator[tuple[str, Subscription, list[str]]]:
        """Yield the subscriptions of components, in order, each in its captured form."""
        names = {id(each): name for name, each in self._components().items()}
        for name, subscriptions in sorted(self._subscriptions.items()):
            for each in subscriptions:
                owner = names.get(id(getattr(each.callback, "__self__", None)))
                if each.active and owner is not None:
                    yield name, each, [name, each.source, owner, getattr(each.callback, "__name__", "")]

    def captured(self) -> list[list[str]]:
        """Return the subscriptions of components: event, source, component and method."""
        return [captured for _, _, captured in self._owned()]

    def check_state(self, state: list[list[str]]) -> None:
        """Check that the components can be subscribed as they were.

        Raises:
            StateError: There is no such component, or it has no such method.
        """
        components = self._components()
        for each in state:
            if len(each) != 4 or not all(isinstance(part, str) for part in each):
                raise StateError("the subscriptions of components differ from those captured")
            name, source, owner, method = each
            if not callable(getattr(components.get(owner), method, None)):
                raise StateError(f"{owner} cannot listen to `{name}` of {source}: it has no method `{method}`")

    def restored(self, state: list[list[str]]) -> None:
        """Subscribe components as they were; those that a fault brought in, or that began anew, subscribe in turns."""
        if state == self.captured():
            return
        for _, each, _ in list(self._owned()):
            each.cancel()
        components = self._components()
        for name, source, owner, method in state:
            self.subscribe(name, getattr(components[owner], method), source)

    def cancel_all_of(self, component: object) -> None:
        """End the subscriptions of a component, which is about to begin anew."""
        for each in self._by_owner.pop(id(component), ()):
            each.cancel()

    def _listeners_to(self, name: str) -> tuple[Subscription, ...]:
        """Return who gets the events of a name."""
        others = () if name in RECURRING else self._subscriptions.get("*", ())
        # In order of subscription, so that the recorder, which comes first, writes a cause before its consequences.
        return tuple(sorted((*self._subscriptions.get(name, ()), *others), key=_number))

    def fire(self, event: Event) -> None:
        """Call all subscribers.

        Raises:
            SubscriberError: A subscriber raised; the cause is the first such exception. All subscribers are called
                before.
        """
        if self._muted and event.source in self._muted:
            return
        listeners = self._listeners.get(event.name)
        if listeners is None:
            listeners = self._listeners[event.name] = self._listeners_to(event.name)
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
