"""The conditions that a component's coroutine awaits (time, events, messages, asyncio futures), as a tree."""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from symaware_cli.core import Event
from symaware_cli.core.waiting import AllOf, AnyOf, EventWait, First, MessageWait, Several, Sleep, Wait
from symaware_cli.engine.network.exchange import MessageExchange
from symaware_cli.engine.runtime.event_router import EventHandler, EventRouter
from symaware_cli.engine.runtime.queue import Phase, Queue

if TYPE_CHECKING:
    import asyncio

    from symaware_cli.engine.runtime.asyncio_bridge import AsyncioBridge

REAL_TIME = ", which takes real time, and that only a paced run can (run.pace)"


class ForeignWaitError(Exception):
    """A component awaits something that does not happen in simulated time."""


class Wakeups:
    """The queue entries at which one component checks whether its coroutine can resume.

    The payload of an entry is a number assigned here. `discard` removes an entry that was reached; `clear` cancels all
    others.
    """

    __slots__ = ("_count", "_entered", "_place", "_queue", "_row", "_soon")

    #: The kind of the entries.
    KIND = "resume"

    def __init__(self, queue: Queue, place: int, row: int) -> None:
        self._queue, self._place, self._row = queue, place, row
        self._entered: dict[int, int] = {}
        self._count = self._soon = 0

    def __contains__(self, wakeup: int) -> bool:
        return wakeup in self._entered

    def after(self, duration: int) -> int:
        """Queue a wake-up after a duration in nanoseconds, and return its number."""
        return self.at(self._queue.clock.now + duration)

    def at(self, time: int) -> int:
        """Queue a wake-up at an instant in nanoseconds, and return its number."""
        self._count += 1
        entry = self._queue.put(time, self._place, Phase.RESUMING, self._row, self.KIND, self._count)
        self._entered[self._count] = entry
        return self._count

    def soon(self) -> None:
        """Queue a wake-up at the present instant, unless one is queued already."""
        if self._soon not in self._entered:
            self._soon = self.after(0)

    def discard(self, wakeup: int) -> None:
        """Discard a wake-up that was reached."""
        del self._entered[wakeup]

    def cancel(self, wakeup: int) -> None:
        """Cancel a wake-up, if it is queued."""
        entry = self._entered.pop(wakeup, None)
        if entry is not None:
            self._queue.cancel(entry)

    def clear(self) -> None:
        """Cancel all remaining wake-ups."""
        if not self._entered:
            return
        for entry in self._entered.values():
            self._queue.cancel(entry)
        self._entered.clear()


class Pending(ABC):
    """A condition that is awaited; after `begin` it wakes the component when it may be fulfilled.

    Attributes:
        is_certain: Whether it will be fulfilled without further events.
    """

    __slots__ = ()

    is_certain = False

    @abstractmethod
    def begin(self, wakeups: Wakeups) -> None:
        """Begin to wait."""

    @abstractmethod
    def settle(self) -> bool:
        """Return whether the condition is fulfilled; cancel parts of it that are no longer needed."""

    @abstractmethod
    def value(self) -> Any:
        """Return the result; called once, after the condition is fulfilled."""

    @abstractmethod
    def cancel(self) -> None:
        """Stop waiting; has no effect if the condition is fulfilled."""


class _Timer(Pending):
    __slots__ = ("_duration", "_wakeup", "_wakeups")

    is_certain = True

    def __init__(self, duration: int) -> None:
        self._duration = duration

    def begin(self, wakeups: Wakeups) -> None:
        self._wakeups = wakeups
        self._wakeup = wakeups.after(self._duration)

    def settle(self) -> bool:
        return self._wakeup not in self._wakeups

    def value(self) -> None:
        return None

    def cancel(self) -> None:
        self._wakeups.cancel(self._wakeup)


class _Event(Pending):
    __slots__ = ("_connection", "_event", "_router", "_wait", "_wakeups")

    def __init__(self, wait: EventWait, router: EventRouter) -> None:
        self._wait, self._router = wait, router
        self._event: Event | None = None

    def begin(self, wakeups: Wakeups) -> None:
        self._wakeups = wakeups
        self._connection = self._router.connect(self._wait.name, self._wait.source, self._on_event)

    def _on_event(self, event: Event) -> None:
        self._connection.cancel()
        self._event = event
        self._wakeups.soon()

    def settle(self) -> bool:
        return self._event is not None

    def value(self) -> Event | None:
        return self._event

    def cancel(self) -> None:
        self._connection.cancel()


class _Messages(Pending):
    __slots__ = ("_connection", "_exchange", "_has_come", "_router", "_wait", "_wakeups")

    def __init__(self, wait: MessageWait, router: EventRouter, exchange: MessageExchange) -> None:
        self._wait, self._router, self._exchange = wait, router, exchange
        self._connection: EventHandler | None = None
        self._has_come = False

    def begin(self, wakeups: Wakeups) -> None:
        self._wakeups = wakeups
        if not self._check():
            source = f"agents.{self._wait.receiver}"
            self._connection = self._router.connect("received", source, lambda event: self._check())

    def _check(self) -> bool:
        """Fulfil the condition if messages have arrived for this component."""
        if self._exchange.has_mail(self._wait.receiver, self._wait.reader):
            self.cancel()
            self._has_come = True
            self._wakeups.soon()
        return self._has_come

    def settle(self) -> bool:
        return self._has_come

    def value(self) -> Any:
        return self._exchange.receive(self._wait.receiver, self._wait.reader)

    def cancel(self) -> None:
        if self._connection is not None:
            self._connection.cancel()


class _Future(Pending):
    """An asyncio future; as a part of several conditions it is cancelled with them, and its result is passed on."""

    __slots__ = ("_bridge", "_future", "_has_come", "_is_part", "_wakeups", "_watch")

    def __init__(self, future: asyncio.Future[Any], bridge: AsyncioBridge, is_part: bool) -> None:
        self._future, self._bridge, self._is_part = future, bridge, is_part
        self._has_come = False
        self._watch: Callable[..., object] | None = None

    def begin(self, wakeups: Wakeups) -> None:
        self._wakeups = wakeups
        self._watch = self._bridge.watch(self._future, self._on_done)

    def _on_done(self, now: int) -> None:
        if self._watch is not None:
            self._has_come = True
            self._wakeups.at(now)

    def settle(self) -> bool:
        return self._has_come

    def value(self) -> Any:
        # A coroutine that awaits the future directly reads the result from it.
        return self._future.result() if self._is_part else None

    def cancel(self) -> None:
        if self._watch is not None:
            self._bridge.unwatch(self._future, self._watch)
            self._watch = None
        if self._is_part:
            self._future.cancel()


class _Some(Pending):
    __slots__ = ("_parts",)

    def __init__(self, parts: Sequence[Pending]) -> None:
        self._parts = parts

    def begin(self, wakeups: Wakeups) -> None:
        for part in self._parts:
            part.begin(wakeups)

    def cancel(self) -> None:
        for part in self._parts:
            part.cancel()


class _All(_Some):
    __slots__ = ()

    @property
    def is_certain(self) -> bool:  # type: ignore[override]
        return all(part.is_certain for part in self._parts)

    def settle(self) -> bool:
        # `settle` of every part is called, so that parts cancel what they no longer need.
        return sum(part.settle() for part in self._parts) == len(self._parts)

    def value(self) -> tuple[Any, ...]:
        return tuple(part.value() for part in self._parts)


class _Any(_Some):
    __slots__ = ("_first",)

    def __init__(self, parts: Sequence[Pending]) -> None:
        super().__init__(parts)
        self._first: int | None = None

    @property
    def is_certain(self) -> bool:  # type: ignore[override]
        return any(part.is_certain for part in self._parts)

    def settle(self) -> bool:
        if self._first is None:
            self._first = next((which for which, part in enumerate(self._parts) if part.settle()), None)
            if self._first is not None:
                for which, part in enumerate(self._parts):
                    if which != self._first:
                        part.cancel()
        return self._first is not None

    def value(self) -> First:
        assert self._first is not None
        return First(self._first, self._parts[self._first].value())


class Awaiter:
    """Converts the objects that components await into conditions."""

    def __init__(self, router: EventRouter, exchange: MessageExchange, bridge: AsyncioBridge | None) -> None:
        """Prepare.

        Args:
            router: Connects conditions with events.
            exchange: The message exchange.
            bridge: The bridge to asyncio; None in a run without a pace.
        """
        self._router = router
        self._exchange = exchange
        self.bridge = bridge

    def pending(self, wait: Any) -> Pending:
        """Convert an awaited object into a condition.

        Raises:
            ForeignWaitError: The object cannot be awaited in this run.
        """
        if type(wait) is Sleep:
            return _Timer(wait.duration)
        bridge = self.bridge
        if not isinstance(wait, Wait) and bridge is not None and bridge.is_awaitable(wait):
            return _Future(wait, bridge, is_part=False)
        try:
            return self._create(wait, is_part=False)
        except ForeignWaitError:
            _discard(wait)
            raise

    def _create(self, wait: Any, *, is_part: bool = True) -> Pending:
        match wait:
            case Sleep():
                return _Timer(wait.duration)
            case EventWait():
                return _Event(wait, self._router)
            case MessageWait():
                return _Messages(wait, self._router, self._exchange)
            case AnyOf():
                return _Any([self._create(each) for each in wait.waits])
            case AllOf():
                return _All([self._create(each) for each in wait.waits])
        if is_part and self.bridge is not None:
            return _Future(self.bridge.future(wait), self.bridge, is_part=True)
        raise ForeignWaitError(f"it awaits {type(wait).__name__}{REAL_TIME}")


def _discard(wait: Any) -> None:
    """Close coroutines that will never be awaited."""
    if isinstance(wait, Several):
        for each in wait.waits:
            _discard(each)
    elif inspect.iscoroutine(wait):
        wait.close()
