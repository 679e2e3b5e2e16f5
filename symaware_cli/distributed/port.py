"""Ports whose connections live in an event loop, in a thread of their own."""

from __future__ import annotations

import asyncio
import atexit
import itertools
import random
import threading
import time
from abc import abstractmethod
from collections import Counter, deque
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


class LoopPort(Port):
    """A port that keeps its connections in an event loop.

    A subclass opens and closes what the connections are made of, in the loop's thread.

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
        # What to send to whom, or why to let go of it.
        self._outbox: deque[tuple[int, bytes | str]] = deque()
        self._flushing = False
        self._closed = False
        self._reason = f"the {'host' if host else 'member'} ended the connection"
        self._strangers: dict[int, Connection] = {}
        self._peers: dict[int, Connection] = {}
        self._tasks: list[asyncio.Task[None]] = []
        self._loop = asyncio.new_event_loop()
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
        """Hand a frame to the port's thread."""
        maximum = self.parameters.maximum_frame
        if len(frame) > maximum:
            raise ValueError(f"a frame of {len(frame)} bytes is longer than `maximum_frame`: {maximum}")
        self._hand_over(peer, frame)

    def receive(self, timeout: float | None = None) -> PortEvent | None:
        """Return what happened next; None if the port is closed."""
        if self._closed:
            return None
        try:
            event, connection = self._inbox.get(timeout=timeout)
        except Empty:
            return None
        if isinstance(event, BaseException):
            raise RuntimeError(f"the port {self.address} failed") from event
        if event.kind == "frame" and connection is not None and connection.take(event.frame):
            self.later(connection.look_again)
        return event

    def offset(self, peer: int) -> float:
        """How far the clock of a peer is ahead [s]."""
        connection = self._peers.get(peer)
        return 0.0 if connection is None else connection.protocol.offset

    def cut(self, peer: int, reason: str) -> None:
        """Let go of a peer, in order."""
        self._hand_over(peer, reason)

    def accept(self, peer: int) -> None:
        """Keep a place for a peer."""
        self.later(self._accept, peer)

    def close(self, reason: str = "") -> None:
        """End the port's thread, and all that it keeps."""
        if self._closed:
            return
        self._reason = reason or self._reason
        self.later(self._end.set)
        self._closed = True
        if self._thread.is_alive():
            self._thread.join(_CLOSING)
        atexit.unregister(self.close)

    def _hand_over(self, peer: int, what: bytes | str) -> None:
        if self._closed:
            return
        self._outbox.append((peer, what))
        if not self._flushing:
            self._flushing = True
            self.later(self._flush)

    def later(self, call: Callable[..., None], *arguments: Any) -> bool:
        """Call something in the loop's thread, from any; returns False if that has ended."""
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
            connection.drop()
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
        self.deliver(PortEvent("came", connection.peer), connection)

    def _accept(self, peer: int) -> None:
        if peer in self._peers:
            self._peers[peer].accepted = True

    def leave(self, connection: Connection) -> None:
        """Take note that a connection is over."""
        self._strangers.pop(connection.peer, None)
        self._peers.pop(connection.peer, None)

    def deliver(self, event: PortEvent, connection: Connection) -> None:
        """Let the run's thread know."""
        self._inbox.put((event, connection))

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
            self._inbox.put((error, None))

    def _fail(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Let the run's thread know of a mistake in this package; asyncio itself copes with what a socket cannot do."""
        error = context.get("exception")
        if error is None or isinstance(error, OSError):
            loop.default_exception_handler(context)
        else:
            self._inbox.put((error, None))

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._live())
        finally:
            self._loop.run_until_complete(self._loop.shutdown_asyncgens())
            asyncio.set_event_loop(None)
            self._loop.close()

    async def _live(self) -> None:
        self.keep(self._tick())
        await self._end.wait()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._flush()
        for connection in (*self._strangers.values(), *self._peers.values()):
            connection.part(self._reason)
        await self.shut()

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(self.parameters.timeout / _TICKS)
            now = time.monotonic()
            for connection in (*self._strangers.values(), *self._peers.values()):
                connection.tick(now)

    def _flush(self) -> None:
        self._flushing = False
        concerned: dict[int, Connection] = {}
        while self._outbox:
            peer, what = self._outbox.popleft()
            connection = self._peers.get(peer)
            if connection is None:
                continue
            if isinstance(what, str):
                connection.part(what)
            else:
                connection.add(what)
                concerned[peer] = connection
        for connection in concerned.values():
            connection.dispatch()


def _first_to_go(connections: Collection[Connection]) -> Connection:
    """Who makes room: of the address from which most have come the one that came first, if it has said nothing yet."""
    crowds = Counter(each.origin for each in connections)
    return min(connections, key=lambda each: (each.spoke, -crowds[each.origin], each.peer))
