"""Ports that move whole frames between this process and its peers; a subclass moves the bytes of their records.

The thread that waits in `receive` reads the connections itself, and `send` writes to them at once, so that a frame
needs no switch of threads. When the run's thread has been away for a while, because it computes or sleeps, the port's
own thread takes over until it is back.
"""

from __future__ import annotations

import atexit
import heapq
import itertools
import math
import random
import selectors
import socket
import threading
import time
from abc import abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from types import MappingProxyType
from typing import Any, get_args

from symaware_cli.processes.connection import PARTING, Connection
from symaware_cli.processes.frame import CROWDED
from symaware_cli.processes.protocol import ConnectionEnded, PeerProtocol
from symaware_cli.processes.transport import Port, PortEvent, Rejection, TransportError, TransportParameters

#: Longest wait for a port to close; what is unfinished then continues in the background [s].
_CLOSING = 1.25 * PARTING

#: The time before a member tries to connect again, at first [s].
_FIRST_PAUSE = 0.05

#: The number of checks of the time limits within one timeout.
_TICKS = 16

#: How long the run's thread may be away before the port's own thread takes over [s].
_LEAVE = 0.02


class PeerPort(Port):
    """A port with connections, which are served by one of two threads: the one that holds the lock.

    A subclass listens or connects, and creates the connections. Its methods are called with the lock.

    Attributes:
        parameters: The parameters of the transport.
        is_host: Whether this is the host's port, to which members connect.
        numbers: The numbers of further peers.
        links: Every connection that is not closed, including those that have ended.
        selector: The selector of sockets; the data of each is a function, called with the events of the ready socket.
        ending: Whether the port is being closed.
    """

    def __init__(self, host: bool, key: bytes | None, parameters: TransportParameters) -> None:
        if key is not None and not key:
            raise TransportError("the key is empty")
        self.parameters = parameters
        self.is_host = host
        self._key = key
        self.numbers = itertools.count(1)
        self.links: set[Connection] = set()
        self.selector = selectors.DefaultSelector()
        self.ending = False
        self._counts: dict[Rejection, int] = dict.fromkeys(get_args(Rejection), 0)
        self.rejected: Mapping[Rejection, int] = MappingProxyType(self._counts)
        self._strangers: dict[int, Connection] = {}
        self._peers: dict[int, Connection] = {}
        self._inbox: deque[tuple[PortEvent | Exception, Connection | None]] = deque()
        self._reason = f"the {'host' if host else 'member'} ended the connection"
        self._pause, self._dice = _FIRST_PAUSE, random.Random()
        self._interval = parameters.timeout / _TICKS
        # Calls that are due at times of the monotonic clock, and calls from other threads, which wake the selector.
        self._timers: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._calls: deque[tuple[Callable[..., None], tuple[Any, ...]]] = deque()
        self._calling = threading.Lock()
        self._alarm, self._waker = socket.socketpair()
        for end in (self._alarm, self._waker):
            end.setblocking(False)
        self.selector.register(self._alarm, selectors.EVENT_READ, self._on_alarm)
        self._closed = self._is_over = False
        self._turn = threading.Lock()
        # How often the run's thread took or left the lock, and whether it waits for it.
        self._visits = 0
        self._claimed = False
        self._wanted = threading.Event()
        self._wanted.set()
        self._thread = threading.Thread(target=self._run, name="symaware-transport", daemon=True)

    # Implemented by subclasses.

    @abstractmethod
    def open(self) -> None:
        """Begin to listen or to connect.

        Raises:
            TransportError: The address cannot be used.
        """

    def connect(self) -> None:
        """Begin an attempt to connect, which ends with `retry` or with a connection that is closed at some time."""

    @abstractmethod
    def stop(self) -> None:
        """Listen no more, and end an attempt to connect."""

    def shut(self) -> None:
        """Release all remaining resources when all connections are closed."""
        return

    # The run's thread.

    def start(self) -> Port:
        """Open the port, and return it.

        Raises:
            TransportError: The address cannot be used.
        """
        try:
            self.open()
        except BaseException:
            self._closed = True
            self._dispose()
            raise
        self._tick()
        self._thread.start()
        # A thread that wakes up while the interpreter ends would abort the process.
        atexit.register(self.close)
        return self

    def send(self, peer: int, frame: bytes) -> None:
        """Send a frame, or queue it if the other end does not read fast enough."""
        maximum = self.parameters.maximum_frame
        if len(frame) > maximum:
            raise ValueError(f"a frame of {len(frame)} bytes is longer than `maximum_frame`: {maximum}")
        self._lock_port()
        try:
            if connection := self._peers.get(peer):
                connection.send(frame)
                if connection.held:
                    self._serve(0.0, self._inbox.__len__)
                connection.check_queue()
        finally:
            self._unlock_port()

    def receive(self, timeout: float | None = None) -> PortEvent | None:
        """Return the next event; None after the timeout, or if the port is closed."""
        if self._closed:
            return None
        if not self._inbox:
            self._lock_port()
            try:
                self._serve(math.inf if timeout is None else time.monotonic() + timeout, self._inbox.__len__)
            finally:
                self._unlock_port()
            if not self._inbox:
                return None
        event, connection = self._inbox.popleft()
        if isinstance(event, Exception):
            raise RuntimeError(f"the port {self.address} failed") from event
        if event.kind == "frame" and connection is not None and connection.take(event.frame):
            self._with_lock(connection.look_again)
        return event

    def offset(self, peer: int) -> float:
        """The estimated offset of a peer's clock [s]."""
        connection = self._peers.get(peer)
        return 0.0 if connection is None else connection.protocol.offset

    def cut(self, peer: int, reason: str) -> None:
        """End the connection to a peer with a farewell."""
        if connection := self._peers.get(peer):
            self._with_lock(connection.part, reason)

    def accept(self, peer: int) -> None:
        """Keep a place for a peer."""
        if connection := self._peers.get(peer):
            connection.accepted = True

    def close(self, reason: str = "") -> None:
        """End the port's thread, and all that it keeps."""
        if self._closed:
            return
        self._reason = reason or self._reason
        self._closed = True
        self.later(self._end)
        self._wanted.set()
        self._thread.join(_CLOSING)
        atexit.unregister(self.close)

    def _with_lock(self, call: Callable[..., None], *arguments: Any) -> None:
        self._lock_port()
        try:
            call(*arguments)
        finally:
            self._unlock_port()

    def _lock_port(self) -> None:
        """Take the lock, from the port's own thread if that has it."""
        self._visits += 1
        if not self._turn.acquire(blocking=False):
            # The port's own thread must not take it again before this one wakes up, as it is asked to stop only once.
            self._claimed = True
            self._wake()
            self._turn.acquire()
            self._claimed = False

    def _unlock_port(self) -> None:
        self._visits += 1
        self._turn.release()

    # With the lock.

    def _serve(self, end: float, is_enough: Callable[[], object]) -> None:
        """Make the calls that are due and handle received bytes, at least once.

        Args:
            end: The time of the monotonic clock at which to return.
            is_enough: Whether to return before.
        """
        timers, calls = self._timers, self._calls
        while True:
            now = time.monotonic()
            try:
                while calls:
                    call, arguments = calls.popleft()
                    call(*arguments)
                while timers[0][0] <= now:
                    heapq.heappop(timers)[2]()
                left = 0.0 if is_enough() else max(0.0, min(end, timers[0][0]) - now)
                for key, events in self.selector.select(left):
                    key.data(events)
            except Exception as error:
                self._inbox.append((error, None))  # a defect of this package
            if is_enough() or end <= now:
                return

    def _is_asked(self) -> bool:
        """Whether the port's own thread should give the lock away."""
        return self._claimed or self._is_over

    def _run(self) -> None:
        """Serve the connections whenever the run's thread does not, until the port is closed."""
        while not self._is_over:
            visits = self._visits
            is_left = self._wanted.wait(_LEAVE) or visits == self._visits
            if is_left and not self._claimed and self._turn.acquire(blocking=False):
                self._wanted.clear()
                try:
                    self._serve(math.inf, self._is_asked)
                finally:
                    self._turn.release()
        self._dispose()

    def _dispose(self) -> None:
        self.shut()
        with self._calling:
            self._is_over = True
            calls = list(self._calls)
            self._waker.close()
        for call, arguments in calls:
            call(*arguments)
        self._alarm.close()
        self.selector.close()

    def _end(self) -> None:
        self.ending = True
        self.stop()
        for connection in (*self._strangers.values(), *self._peers.values()):
            connection.part(self._reason)
        self.call_later(PARTING, self._drop_all)
        self._is_over = not self.links

    def _drop_all(self) -> None:
        for connection in list(self.links):
            connection.drop()

    def _tick(self) -> None:
        self.call_later(self._interval, self._tick)
        now = time.monotonic()
        for connection in (*self._strangers.values(), *self._peers.values()):
            connection.tick(now)

    def _on_alarm(self, events: int) -> None:
        with suppress(BlockingIOError):
            self._alarm.recv(4096)

    def _wake(self) -> None:
        with suppress(OSError):  # it is awake, or closed
            self._waker.send(b"!")

    def later(self, call: Callable[..., None], *arguments: Any) -> bool:
        """Have something called with the lock, from any thread; returns False if the port is closed."""
        with self._calling:
            if self._is_over:
                return False
            self._calls.append((call, arguments))
            self._wake()
        return True

    # Called by connections and subclasses.

    def call_later(self, delay: float, call: Callable[[], None]) -> None:
        """Have something called after a delay [s]."""
        heapq.heappush(self._timers, (time.monotonic() + delay, next(self._order), call))

    def protocol(self) -> PeerProtocol:
        """Create the protocol of a new connection."""
        parameters = self.parameters
        limits = parameters.maximum_frame, parameters.timeout, parameters.hang_timeout
        return PeerProtocol(self.is_host, self._key, *limits, time.monotonic())

    def enter(self, connection: Connection) -> None:
        """Add a connection whose handshake has not begun; if there are too many of these, one is closed."""
        if self.ending:
            # Closed at once, so that it causes no further events.
            connection.refuse(ConnectionEnded(self._reason))
            return
        self._strangers[connection.peer] = connection
        if len(self._strangers) > self.parameters.members:
            reason = ConnectionEnded(f"more than {self.parameters.members} connect at once", "crowded")
            _first_to_go(self._strangers.values()).refuse(reason)
        if not connection.gone:
            connection.transmit([connection.protocol.preamble])

    def admit(self, connection: Connection) -> None:
        """Admit a connection after its handshake, if there is room, or if one that is no member can be closed."""
        del self._strangers[connection.peer]
        present = [each for each in self._peers.values() if not each.parting]
        if len(present) >= self.parameters.members:
            self.reject("crowded")
            others = [each for each in present if not each.accepted]
            leaving = _first_to_go(others) if others else connection
            leaving.part(f"{CROWDED} {self.parameters.members} members")
            if leaving is connection:
                return
        self._peers[connection.peer] = connection
        connection.came = True
        self.deliver(PortEvent("came", connection.peer), connection)

    def leave(self, connection: Connection) -> None:
        """Remove a connection that has ended."""
        self._strangers.pop(connection.peer, None)
        self._peers.pop(connection.peer, None)

    def closed(self, connection: Connection) -> None:
        """Note that a connection is closed; a member's port connects again."""
        self.links.discard(connection)
        if self.ending:
            self._is_over = not self.links
        elif not self.is_host:
            self.retry(connection)

    def retry(self, connection: Connection | None = None) -> None:
        """Connect again after a pause, unless this end ended the connection."""
        if self.ending or (connection is not None and connection.parting):
            return
        if connection is not None and connection.came:
            self._pause = _FIRST_PAUSE
        # Random, so that members that lost the same host do not all connect again at the same time.
        self.call_later(self._pause * self._dice.uniform(0.5, 1.0), self._connect_again)
        self._pause = min(2 * self._pause, self.parameters.timeout)

    def _connect_again(self) -> None:
        if not self.ending:
            self.connect()

    def deliver(self, event: PortEvent, connection: Connection) -> None:
        """Queue an event for the run's thread."""
        self._inbox.append((event, connection))

    def reject(self, rejection: Rejection) -> None:
        """Count a rejected frame or connection."""
        self._counts[rejection] += 1


def _first_to_go(connections: Collection[Connection]) -> Connection:
    """The connection to close first: one that sent no frame, from the address with the most connections, the oldest."""
    crowds = Counter(each.origin for each in connections)
    return min(connections, key=lambda each: (each.spoke, -crowds[each.origin], each.peer))
