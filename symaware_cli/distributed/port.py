"""Ports whose connections live in an event loop, which the run's thread goes through while it waits for frames."""

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

#: How long it may take to close a port; what is still not over then goes on without anybody to wait for it [s].
_CLOSING = 1.25 * PARTING

#: How often a port looks at the clock within the timeout.
_TICKS = 16

#: For how long the loop runs by itself after something other than a frame happened [s].
_SETTLING = 0.05

#: For how long the run's thread may leave the loop alone before the port's own thread takes it over [s].
_LEAVE = 0.02


class LoopPort(Port):
    """A port that keeps its connections in an event loop.

    Two threads share the loop, one at a time. Who waits in `receive` runs it, and what is sent is written to the socket
    right away: a frame costs no change of threads. When the run's thread has been away for a while, because it computes
    or sleeps, the port's own thread runs the loop until it comes back.

    A subclass opens and closes what the connections are made of, within the loop.

    Attributes:
        parameters: Those of the transport.
        is_host: Whether others come here.
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
        # Held by the thread that runs the loop, or does something to what lives in it.
        self._turn = threading.Lock()
        # How often the run's thread has had it, whether it waits in the loop now, and whether it waits for its turn.
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
        # By file descriptor, the connections that can be read without the loop; when it must run, and until when it
        # had better run because something is under way in it.
        self._direct: dict[int, Connection] = {}
        self._due = self._settled = 0.0
        self._loop.set_exception_handler(self._fail)
        self._end = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="symaware-transport", daemon=True)

    # What a subclass does, in the loop's thread.

    @abstractmethod
    async def open(self) -> None:
        """Begin to listen or to connect.

        Raises:
            TransportError: That cannot be.
        """

    @abstractmethod
    async def shut(self) -> None:
        """Let nobody in any more, and wait for the connections to part."""

    # The run's thread.

    def start(self) -> None:
        """Open the port.

        Raises:
            TransportError: That cannot be.
        """
        self._thread.start()
        # Threads that wake up while the interpreter ends would bring it down.
        atexit.register(self.close)
        try:
            asyncio.run_coroutine_threadsafe(self.open(), self._loop).result()
        except BaseException:
            self.close()
            raise

    def send(self, peer: int, frame: bytes) -> None:
        """Send a frame, as far as the other end takes it."""
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
        """Return what happened next; None if the port is closed."""
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
        """Have the loop to oneself; the port's own thread lets go of it, until the run's has been away for a while."""
        self._visits += 1
        if not self._turn.acquire(blocking=False):
            # The port's own thread must not have it again before this one wakes up: it is asked to stop but once.
            self._claimed = True
            self.later(self._loop.stop)
            self._turn.acquire()
            self._claimed = False
            self._settled = time.monotonic() + _SETTLING

    def _leave_loop(self) -> None:
        self._visits += 1
        self._turn.release()

    def _wait(self, end: float) -> None:
        """Let things happen until the run's thread has to be told of one, or until a moment of the monotonic clock."""
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
        """Run the loop: once, or for some time [s] at most, until the run's thread has to be told of something."""
        # A notebook has a loop of its own, in which the whole run takes place.
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
        """How far the clock of a peer is ahead [s]."""
        connection = self._peers.get(peer)
        return 0.0 if connection is None else connection.protocol.offset

    def cut(self, peer: int, reason: str) -> None:
        """Let go of a peer, in order."""
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
        """Call something within the loop, from any thread; returns False if that has ended."""
        try:
            self._loop.call_soon_threadsafe(call, *arguments)
        except RuntimeError:
            if self._loop.is_closed():
                return False
            raise
        return True

    # The loop's thread.

    def number(self) -> int:
        """A number that nobody had before."""
        return next(self._numbers)

    def protocol(self) -> PeerProtocol:
        """Begin a protocol."""
        parameters = self.parameters
        limits = parameters.maximum_frame, parameters.timeout, parameters.hang_timeout
        return PeerProtocol(self.is_host, self._key, *limits, time.monotonic())

    @property
    def ending(self) -> bool:
        """Whether the port is being closed."""
        return self._end.is_set()

    def call_later(self, delay: float, call: Callable[[], None]) -> None:
        """Call something in the loop's thread."""
        self._loop.call_later(delay, call)

    def enter(self, connection: Connection) -> None:
        """Take in a connection that has not said anything yet; where there are too many, one of them goes."""
        if self.ending:
            # Over, so that nothing more is heard of it.
            connection.refuse(ConnectionEnded(self._reason))
            return
        self._strangers[connection.peer] = connection
        if len(self._strangers) > self.parameters.members:
            reason = ConnectionEnded(f"more than {self.parameters.members} connect at once", "crowded")
            _first_to_go(self._strangers.values()).refuse(reason)
        if not connection.gone:
            connection.begin()

    def admit(self, connection: Connection) -> None:
        """Let somebody in who is known now, if there is room, or if one can go who is no member."""
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
        """Take note that a connection is over."""
        self._strangers.pop(connection.peer, None)
        self._peers.pop(connection.peer, None)
        if (number := connection.descriptor) is not None:
            self._direct.pop(number, None)

    def deliver(self, event: PortEvent, connection: Connection) -> None:
        """Let the run's thread know."""
        self._tell(event, connection)

    def _tell(self, event: PortEvent | BaseException, connection: Connection | None = None) -> None:
        self._inbox.put((event, connection))
        if self._waits:
            self._loop.stop()

    def reject(self, rejection: Rejection) -> None:
        """Count what was not taken."""
        self._counts[rejection] += 1

    async def keep_connected(self, connect: Callable[[], Awaitable[Connection | None]]) -> None:
        """Connect, and again when the connection is over, until this end has let go of it.

        Args:
            connect: Makes a connection, and returns it when it is over; None if there was none.
        """
        pause, dice = _FIRST_PAUSE, random.Random()
        while True:
            connection = await connect()
            if connection is not None and connection.parting:
                return
            if connection is not None and connection.came:
                pause = _FIRST_PAUSE
            # Those who lost the same host at the same instant must not all come back at the same instant.
            await asyncio.sleep(pause * dice.uniform(0.5, 1.0))
            pause = min(2 * pause, self.parameters.timeout)

    def keep(self, work: Coroutine[Any, Any, None]) -> None:
        """Let something go on until the port is closed."""
        task = self._loop.create_task(work)
        task.add_done_callback(self._look_at)
        self._tasks.append(task)

    def _look_at(self, task: asyncio.Task[None]) -> None:
        if not task.cancelled() and (error := task.exception()) is not None:
            self._tell(error)

    def _fail(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Let the run's thread know of a mistake in this package; asyncio itself copes with what a socket cannot do."""
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
    """Who makes room: of the address from which most have come the one that came first, if it has said nothing yet."""
    crowds = Counter(each.origin for each in connections)
    return min(connections, key=lambda each: (each.spoke, -crowds[each.origin], each.peer))
