"""Ports and connections over Zenoh: a session for each port, a number for each connection, a sample for each record."""

from __future__ import annotations

import asyncio
import atexit
import json
import secrets
import threading
import time
import weakref
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from queue import SimpleQueue
from typing import Any

from symaware_cli.distributed.address import address_of
from symaware_cli.distributed.connection import FRAMES, PARTING, Connection
from symaware_cli.distributed.port import LoopPort
from symaware_cli.distributed.protocol import ConnectionEnded
from symaware_cli.distributed.transport import TransportError, TransportParameters

#: What is sent to a number whose connection is over.
_CLOSED = b""

#: So many samples may wait within Zenoh, and for the port's thread, before the links are read no more.
_ARRIVALS = 256

#: So many records, and so many bytes, may be sent before the other end says that it has taken them.
_RECORDS, _BYTES = 256, 2**22

#: For how long an ending process waits for threads that are within Zenoh [s]; that itself waits for five seconds if
#: something on its way cannot be sent.
_PATIENCE = 6.0

#: So many batches of records may be on their way to Zenoh.
_MOST_IN_TRANSIT = 4


class ZenohPort(LoopPort):
    """A port whose connections share a session."""

    def __init__(self, host: str, port: int, key: bytes | None, parameters: TransportParameters, is_host: bool) -> None:
        self.zenoh = _library()
        super().__init__(is_host, key, parameters)
        self._place = host, port
        self.address = address_of(host, port)
        #: Every connection whose number is in use.
        self.connections: dict[str, ZenohConnection] = {}
        self._session: Any = None
        # What is not held any more is not declared any more.
        self._declared: list[Any] = []
        self._arrivals: deque[tuple[str, bytes | None]] = deque()
        self._arrived, self._most = 0, FRAMES * parameters.maximum_frame
        self._draining = self._ended = False
        # What only this port can say to itself: that nothing more comes to a number.
        self._mark = secrets.token_bytes(16)
        self._room = threading.Condition()

    def configuration(self, **changes: Any) -> Any:
        """What a session shall be like."""
        parameters = self.parameters
        milliseconds = max(1, int(1000 * parameters.timeout))
        values = {
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            "connect/timeout_ms": 0,
            "connect/exit_on_failure": True,
            "listen/timeout_ms": 0,
            "listen/exit_on_failure": True,
            "transport/unicast/open_timeout": milliseconds,
            "transport/unicast/accept_timeout": milliseconds,
            "transport/unicast/max_sessions": 2 * parameters.members,
            # Zenoh's own threads keep it up, whatever the interpreter does; so it tells who is dead.
            "transport/link/tx/lease": max(1000, milliseconds),
            "transport/link/rx/max_message_size": parameters.maximum_frame + 2**16,
            "transport/shared_memory/enabled": False,
            **changes,
        }
        configuration = self.zenoh.Config()
        for name, value in values.items():
            configuration.insert_json5(name, json.dumps(value))
        return configuration

    @abstractmethod
    def stranger(self, name: str) -> ZenohConnection | None:
        """Who it is that speaks under a number that nobody has."""

    # Threads of Zenoh.

    def subscribe(self, session: Any, key: str) -> Any:
        """Take the samples of a key expression; returns what must be kept for it."""
        # A callback would stand behind a queue of hundreds of samples, however long they are.
        subscriber = session.declare_subscriber(key, self.zenoh.handlers.FifoChannel(_ARRIVALS))
        self.aside(self._read, subscriber.handler)
        return subscriber

    def _read(self, samples: Any) -> None:
        for sample in samples:
            record = sample.payload.to_bytes()
            self._put_in(str(sample.key_expr).rpartition("/")[2], None if record == self._mark else record)

    def aside(self, call: Callable[..., None], *arguments: Any) -> None:
        """Call what blocks, in a thread that keeps the interpreter from ending for a few seconds at most."""
        thread = threading.Thread(target=call, args=arguments, name="symaware-zenoh", daemon=True)
        _threads.add(thread)
        thread.start()

    def watch(self, session: Any, key: str, note: Callable[[Any], None], **options: Any) -> Any:
        """Take note of the liveliness tokens of a key expression; returns what must be kept for it."""
        # Not in a callback: that would be in a thread of Zenoh's own, which nobody can wait for in the end.
        channel = self.zenoh.handlers.FifoChannel(_ARRIVALS)
        subscriber = session.liveliness().declare_subscriber(key, channel, **options)
        self.aside(self._watch, subscriber.handler, note)
        return subscriber

    def _watch(self, tokens: Any, note: Callable[[Any], None]) -> None:
        for token in tokens:
            note(token)

    def note_end(self, session: Any, key: str) -> None:
        """Take note that a process is not there any more: behind all that it sent to a key expression.

        Liveliness tokens come another way than samples do, and so may be ahead of them.
        """
        with suppress(self.zenoh.ZError):  # the session is closed
            session.put(key, self._mark, allowed_destination=self.zenoh.Locality.SESSION_LOCAL)

    def _put_in(self, name: str, record: bytes | None) -> None:
        """Leave something for the port's thread; waits while that is far behind.

        Args:
            name: The number it was sent to or from.
            record: What; None if the process is not there any more.
        """
        with self._room:
            self._room.wait_for(lambda: self._ended or not self._behind())
            self._arrivals.append((name, record))
            self._arrived += len(record or b"")
            if not self._draining:
                self._draining = True
                self.later(self.drain)

    def _behind(self) -> bool:
        return len(self._arrivals) >= _ARRIVALS or self._arrived >= self._most

    # The port's thread.

    def drain(self) -> None:
        """Take what arrived."""
        self._draining = False
        while self._arrivals:
            with self._room:
                name, record = self._arrivals.popleft()
                self._arrived -= len(record or b"")
                self._room.notify_all()
            connection = self.connections.get(name)
            if connection is None and record:
                connection = self.stranger(name)
            if connection is None:
                continue
            if record is None or (record == _CLOSED and (connection.parting or not connection.protocol.signed)):
                connection.lost()
                connection.drop()
            elif record != _CLOSED:
                connection.hear(record)

    async def shut(self) -> None:
        """Wait for the connections to part, then close the session."""
        if self.connections:
            await asyncio.wait([each.closed for each in self.connections.values()], timeout=PARTING)
        for connection in list(self.connections.values()):
            connection.drop()
        await self.end_session()

    async def open_session(self, configuration: Any) -> Any:
        """Open a session.

        Raises:
            ZError: That cannot be.
        """
        outcome: asyncio.Future[Any] = asyncio.get_running_loop().create_future()

        def settle(session: Any, error: Exception | None) -> None:
            if outcome.done():  # nobody waits for it any more
                if session is not None:
                    session.close()
            elif error is not None:
                outcome.set_exception(error)
            else:
                outcome.set_result(session)

        def work() -> None:
            try:
                session = self.zenoh.open(configuration)
            except self.zenoh.ZError as error:
                self.later(settle, None, error)
            else:
                if not self.later(settle, session, None):
                    session.close()

        self.aside(work)
        return await outcome

    async def end_session(self) -> None:
        """Close the session, if there is one."""
        session, self._session = self._session, None
        self._declared = []
        # Whoever waits for room holds a thread of the session.
        with self._room:
            self._ended = True
            self._arrivals.clear()
            self._arrived = 0
            self._room.notify_all()
        if session is None:
            return
        if self.ending:
            # Right here, as the interpreter may be about to end, and then lets nobody start a thread any more.
            session.close()
            return
        closed = asyncio.Event()

        def work() -> None:
            session.close()
            self.later(closed.set)

        self.aside(work)
        # Zenoh waits for five seconds if what is on its way cannot be sent, because the other end is stopped.
        with suppress(TimeoutError):
            async with asyncio.timeout(PARTING):
                await closed.wait()

    def put(self, key: str, record: bytes, *, wait: bool) -> None:
        """Send a sample.

        Args:
            key: Under which key expression.
            record: What.
            wait: Whether to wait for room; otherwise it may be dropped.
        """
        congestion = self.zenoh.CongestionControl
        session = self._session
        if session is not None:
            # What is sent at once takes a place of its own in a short queue, and so is soon dropped.
            session.put(key, record, congestion_control=congestion.BLOCK if wait else congestion.DROP, express=wait)


class ZenohConnection(Connection):
    """A connection that is a number; each record is a sample."""

    shared = True

    def __init__(self, port: ZenohPort, name: str, key: str) -> None:
        super().__init__(port)
        self.name = name
        self._home = port
        self._key = key
        self._courier: SimpleQueue[Sequence[bytes] | None] | None = None
        self._in_transit = 0
        # Of the records that the other end has not taken, as far as it told, the sizes, and their sum.
        self._flight: deque[int] = deque()
        self._flying = self._settled = 0
        # How many the other end was told that we have taken, and how many bytes came since.
        self._told = self._untold = 0
        self.closed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        port.connections[name] = self

    def transmit(self, records: Sequence[bytes]) -> None:
        """Put samples, from a thread of the connection: that waits for a slow link."""
        if not self.protocol.introduced:
            # The preamble; no thread for who has said nothing that makes sense.
            for record in records:
                self._home.put(self._key, record, wait=False)
            return
        self._flight.extend(map(len, records))
        self._flying += sum(map(len, records))
        self.stalled = self._is_stalled()
        if self._courier is None:
            self._courier = SimpleQueue()
            self._home.aside(self._carry, self._courier)
        self._in_transit += 1
        self.held = self._in_transit >= _MOST_IN_TRANSIT
        self._courier.put(records)

    def _carry(self, courier: SimpleQueue[Sequence[bytes] | None]) -> None:
        while (records := courier.get()) is not None:
            try:
                for record in records:
                    self._home.put(self._key, record, wait=True)
            except self._home.zenoh.ZError:
                self._home.later(self.lost)
                return
            self._home.later(self._carried)

    def _carried(self) -> None:
        self._in_transit -= 1
        self.held = False
        self.pump()

    def hear(self, record: bytes) -> None:
        """Take a record, and let the other end know now and then."""
        super().hear(record)
        self._untold += len(record)
        self._tell()
        if self._settled < self.protocol.taken:
            while self._flight and self._settled < self.protocol.taken:
                self._flying -= self._flight.popleft()
                self._settled += 1
            self.stalled = self._is_stalled()
            self.pump()

    def _tell(self) -> None:
        protocol = self.protocol
        if self.gone or self.full:
            return
        if 4 * (protocol.count - self._told) >= _RECORDS or 4 * self._untold >= _BYTES:
            self._told, self._untold = protocol.count, 0
            protocol.tell_taken()
            self.pump()

    def _is_stalled(self) -> bool:
        # In the end there is no time to wait, and nothing is heard any more.
        return not self.parting and (len(self._flight) >= _RECORDS or self._flying >= _BYTES)

    def part(self, reason: str) -> None:
        """Send what waits, and let go."""
        self.stalled = False
        super().part(reason)

    def rest(self) -> None:
        """Let the other end wait; one that does not is not of our kind."""
        parameters, (count, size) = self._home.parameters, self.untaken()
        if count > 2 * parameters.queue + _RECORDS or size > 2 * FRAMES * parameters.maximum_frame + _BYTES:
            self.refuse(ConnectionEnded(f"{self.protocol.other} sent more than it was let", "oversized"))

    def resume(self) -> None:
        """Let the other end send on."""
        self._tell()

    def hang_up(self) -> None:
        """Wait until the other end has closed its number."""

    def drop(self) -> None:
        """Close the number."""
        if self.closed.done():
            return
        self.closed.set_result(None)
        self._home.connections.pop(self.name, None)
        if self._courier is None:
            self._home.put(self._key, _CLOSED, wait=False)
        else:
            self._courier.put([_CLOSED])
            self._courier.put(None)


#: Threads that are, or were, within Zenoh. One that came back from there to an interpreter that has ended would bring
#: down the process.
_threads: weakref.WeakSet[threading.Thread] = weakref.WeakSet()


@atexit.register  # before those of all ports, and so it is called after them
def _wait_out() -> None:
    """Give all threads the time to come back; their sessions are closed by now."""
    end = time.monotonic() + _PATIENCE
    for thread in list(_threads):
        thread.join(max(0.0, end - time.monotonic()))


def _library() -> Any:
    try:
        import zenoh
    except ModuleNotFoundError as error:
        raise TransportError(
            "the transport `zenoh` needs the module `zenoh`: pip install 'symaware-cli[zenoh]'"
        ) from error
    return zenoh
