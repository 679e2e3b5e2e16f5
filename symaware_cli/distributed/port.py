"""The base of ports: a set of connections in an event loop, which the run's thread runs while it waits for frames."""

from __future__ import annotations

import asyncio
import atexit
import itertools
import math
import random
import selectors
import threading
import time
from abc import abstractmethod
from collections import Counter
from collections.abc import Awaitable, Callable, Collection, Coroutine, Mapping
from queue import Empty, SimpleQueue
from types import MappingProxyType
from typing import Any, get_args

from symaware_cli.distributed.connection import PARTING, Connection
from symaware_cli.distributed.frame import CROWDED
from symaware_cli.distributed.protocol import ConnectionEnded, PeerProtocol
from symaware_cli.distributed.transport import Port, PortEvent, Rejection, TransportError, TransportParameters

#: The time before a member tries to connect again, at first [s].
_FIRST_PAUSE = 0.05

#: Longest wait for a port to close; what is unfinished then continues in the background [s].
_CLOSING = 1.25 * PARTING

#: The number of checks of the time limits within one timeout.
_TICKS = 16

#: How long the whole loop runs after an event other than a frame [s].
_SETTLING = 0.05

#: How long the run's thread may be away before the port's own thread runs the loop [s].
_LEAVE = 0.02


class LoopPort(Port):
    """A port that keeps its connections in an event loop.

    Two threads share the loop, one at a time. The thread that waits in `receive` runs it, and frames are written to the
    socket at once, so that a frame needs no switch of threads. When the run's thread has been away for a while, because
    it computes or sleeps, the port's own thread runs the loop until it is back.

    A subclass opens and closes the sockets or sessions of the connections, within the loop.

    Attributes:
        parameters: Those of the transport.
        is_host: Whether this is the host's port, to which members connect.
    """

    def __init__(self, host: bool, key: bytes | None, parameters: TransportParameters) -> None:
        if key is not None and not key:
            raise TransportError("the key is empty")
        self.parameters = parameters
        self.is_host = host
        self._key = key
        self._counts: dict[Rejection, int] = dict.fromkeys(get_args(Rejection), 0)
        self.rejected: Mapping[Rejection, int] = MappingProxyType(self._counts)
        self._numbers = itertools.count(1)
        self._inbox: SimpleQueue[tuple[PortEvent | BaseException, Connection | None]] = SimpleQueue()
        self._closed = False
        # Held by the thread that runs the loop or uses its connections.
        self._turn = threading.Lock()
        # How often the run's thread took the lock, whether it waits within the loop, and whether it waits for the lock.
        self._visits = 0
        self._waits = self._claimed = False
        self._wanted = threading.Event()
        self._wanted.set()
        self._reason = f"the {'host' if host else 'member'} ended the connection"
        self._strangers: dict[int, Connection] = {}
        self._peers: dict[int, Connection] = {}
        self._tasks: list[asyncio.Task[None]] = []
        self._selector = selectors.DefaultSelector()
        self._loop = asyncio.SelectorEventLoop(self._selector)
        self._interval = parameters.timeout / _TICKS
        # By file descriptor, the connections that can be read without the loop; when the loop must run next, and until
        # when it should run because something other than frames is in progress.
        self._direct: dict[int, Connection] = {}
        self._due = self._settled = 0.0
        self._loop.set_exception_handler(self._fail)
        self._end = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="symaware-transport", daemon=True)

    # Implemented by subclasses; called within the loop.

    @abstractmethod
    async def open(self) -> None:
        """Begin to listen or to connect.

        Raises:
            TransportError: The address cannot be used.
        """

    @abstractmethod
    async def shut(self) -> None:
        """Accept no further connections, and wait until the present ones are closed."""

    # The run's thread.

    def start(self) -> None:
        """Open the port.

        Raises:
            TransportError: The address cannot be used.
        """
        self._thread.start()
        # A thread that wakes up while the interpreter ends would abort the process.
        atexit.register(self.close)
        try:
            asyncio.run_coroutine_threadsafe(self.open(), self._loop).result()
        except BaseException:
            self.close()
            raise

    def send(self, peer: int, frame: bytes) -> None:
        """Send a frame, or queue it if the other end does not read fast enough."""
        maximum = self.parameters.maximum_frame
        if len(frame) > maximum:
            raise ValueError(f"a frame of {len(frame)} bytes is longer than `maximum_frame`: {maximum}")
        self._take_loop()
        try:
            if connection := self._peers.get(peer):
                connection.add(frame)
                connection.pump()
                if connection.held:
                    self._go_round()
                connection.dispatch()
        finally:
            self._leave_loop()

    def receive(self, timeout: float | None = None) -> PortEvent | None:
        """Return the next event; None after the timeout, or if the port is closed."""
        if self._closed:
            return None
        if self._inbox.empty():
            self._take_loop()
            try:
                self._wait(math.inf if timeout is None else time.monotonic() + timeout)
            finally:
                self._leave_loop()
        try:
            event, connection = self._inbox.get_nowait()
        except Empty:
            return None
        if isinstance(event, Exception):
            raise RuntimeError(f"the port {self.address} failed") from event
        if isinstance(event, BaseException):
            raise event
        if event.kind == "frame" and connection is not None and connection.take(event.frame):
            self.later(connection.look_again)
        return event

    def _take_loop(self) -> None:
        """Take the loop over from the port's own thread."""
        self._visits += 1
        if not self._turn.acquire(blocking=False):
            # The port's own thread must not take it again before this one wakes up, as it is asked to stop only once.
            self._claimed = True
            self.later(self._loop.stop)
            self._turn.acquire()
            self._claimed = False
            self._settled = time.monotonic() + _SETTLING

    def _leave_loop(self) -> None:
        self._visits += 1
        self._turn.release()

    def _wait(self, end: float) -> None:
        """Run the loop until there is an event for the run's thread, or until a time of the monotonic clock."""
        polled = False
        while self._inbox.empty():
            now = time.monotonic()
            if now >= end and polled:
                break
            polled = True
            if now < self._settled or not self._direct:
                self._go_round(min(end, max(self._settled, now + self._interval)) - now)
            elif now >= self._due:
                self._due = now + self._interval
                self._go_round()
            else:
                for key, _ in self._selector.select(max(0.0, min(end, self._due) - now)):
                    if (connection := self._direct.get(key.fd)) is None or not connection.read():
                        self._settled = now + _SETTLING

    def _go_round(self, duration: float = 0.0) -> None:
        """Run the loop once, or for at most a duration [s] until there is an event for the run's thread."""
        # In a notebook, the run takes place within another event loop.
        before = asyncio._get_running_loop()
        asyncio._set_running_loop(None)
        alarm = None
        if duration > 0.0:
            self._waits = True
            alarm = self._loop.call_later(duration, self._loop.stop)
        else:
            self._loop.stop()
        try:
            self._loop.run_forever()
        finally:
            self._waits = False
            if alarm is not None:
                alarm.cancel()
            asyncio._set_running_loop(before)

    def offset(self, peer: int) -> float:
        """The estimated offset of a peer's clock [s]."""
        connection = self._peers.get(peer)
        return 0.0 if connection is None else connection.protocol.offset

    def cut(self, peer: int, reason: str) -> None:
        """End the connection to a peer with a farewell."""
        self._take_loop()
        if connection := self._peers.get(peer):
            connection.part(reason)
        self._leave_loop()

    def accept(self, peer: int) -> None:
        """Keep a place for a peer."""
        self._take_loop()
        if connection := self._peers.get(peer):
            connection.accepted = True
        self._leave_loop()

    def close(self, reason: str = "") -> None:
        """End the port's thread, and all that it keeps."""
        if self._closed:
            return
        self._reason = reason or self._reason
        self._closed = True
        self.later(self._end.set)
        self._wanted.set()
        if self._thread.is_alive():
            self._thread.join(_CLOSING)
        atexit.unregister(self.close)

    def later(self, call: Callable[..., None], *arguments: Any) -> bool:
        """Schedule a call within the loop, from any thread; returns False if the loop has ended."""
        try:
            self._loop.call_soon_threadsafe(call, *arguments)
        except RuntimeError:
            if self._loop.is_closed():
                return False
            raise
        return True

    # Called within the loop.

    def number(self) -> int:
        """Return a new number for a peer."""
        return next(self._numbers)

    def protocol(self) -> PeerProtocol:
        """Create the protocol of a new connection."""
        parameters = self.parameters
        limits = parameters.maximum_frame, parameters.timeout, parameters.hang_timeout
        return PeerProtocol(self.is_host, self._key, *limits, time.monotonic())

    @property
    def ending(self) -> bool:
        """Whether the port is being closed."""
        return self._end.is_set()

    def call_later(self, delay: float, call: Callable[[], None]) -> None:
        """Schedule a call within the loop after a delay [s]."""
        self._loop.call_later(delay, call)

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
            connection.begin()

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
        if (number := connection.descriptor) is not None:
            self._direct[number] = connection
        self.deliver(PortEvent("came", connection.peer), connection)

    def leave(self, connection: Connection) -> None:
        """Remove a connection that has ended."""
        self._strangers.pop(connection.peer, None)
        self._peers.pop(connection.peer, None)
        if (number := connection.descriptor) is not None:
            self._direct.pop(number, None)

    def deliver(self, event: PortEvent, connection: Connection) -> None:
        """Queue an event for the run's thread."""
        self._tell(event, connection)

    def _tell(self, event: PortEvent | BaseException, connection: Connection | None = None) -> None:
        self._inbox.put((event, connection))
        if self._waits:
            self._loop.stop()

    def reject(self, rejection: Rejection) -> None:
        """Count a rejected frame or connection."""
        self._counts[rejection] += 1

    async def keep_connected(self, connect: Callable[[], Awaitable[Connection | None]]) -> None:
        """Connect, and reconnect after each loss, until this end has ended the connection.

        Args:
            connect: Connects and returns the connection when it has ended; None if there was none.
        """
        pause, dice = _FIRST_PAUSE, random.Random()
        while True:
            connection = await connect()
            if connection is not None and connection.parting:
                return
            if connection is not None and connection.came:
                pause = _FIRST_PAUSE
            # Random, so that members that lost the same host do not all reconnect at the same time.
            await asyncio.sleep(pause * dice.uniform(0.5, 1.0))
            pause = min(2 * pause, self.parameters.timeout)

    def keep(self, work: Coroutine[Any, Any, None]) -> None:
        """Run a task until the port is closed."""
        task = self._loop.create_task(work)
        task.add_done_callback(self._look_at)
        self._tasks.append(task)

    def _look_at(self, task: asyncio.Task[None]) -> None:
        if not task.cancelled() and (error := task.exception()) is not None:
            self._tell(error)

    def _fail(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Report a defect of this package to the run's thread; asyncio handles the errors of sockets."""
        error = context.get("exception")
        if error is None or isinstance(error, OSError):
            loop.default_exception_handler(context)
        else:
            self._tell(error)

    def _run(self) -> None:
        """Run the loop whenever the run's thread does not, until the port is closed."""
        live = self._loop.create_task(self._live())
        live.add_done_callback(lambda _: self._loop.stop())
        while not live.done():
            visits = self._visits
            is_left = self._wanted.wait(_LEAVE) or visits == self._visits
            if is_left and not self._claimed and self._turn.acquire(blocking=False):
                self._wanted.clear()
                try:
                    self._loop.run_forever()
                finally:
                    self._turn.release()
        live.result()
        self._loop.run_until_complete(self._loop.shutdown_asyncgens())
        self._loop.close()

    async def _live(self) -> None:
        self._tick()
        await self._end.wait()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for connection in (*self._strangers.values(), *self._peers.values()):
            connection.part(self._reason)
        await self.shut()

    def _tick(self) -> None:
        self._loop.call_later(self._interval, self._tick)
        now = time.monotonic()
        for connection in (*self._strangers.values(), *self._peers.values()):
            connection.tick(now)


def _first_to_go(connections: Collection[Connection]) -> Connection:
    """The connection to close first: one that sent no frame, from the address with the most connections, the oldest."""
    crowds = Counter(each.origin for each in connections)
    return min(connections, key=lambda each: (each.spoke, -crowds[each.origin], each.peer))
