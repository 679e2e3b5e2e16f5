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

#: The sample that closes a connection.
_CLOSED = b""

#: Most samples that wait within Zenoh, and for the port's loop; then its links are no longer read.
_ARRIVALS = 256

#: Most records, and most bytes, that may be unacknowledged.
_RECORDS, _BYTES = 256, 2**22

#: How long an ending process waits for threads within Zenoh [s], which itself waits five seconds for samples that
#: cannot be sent.
_PATIENCE = 6.0

#: Most batches of records that may wait to be passed to Zenoh.
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
        # A declaration ends when its object is deleted.
        self._declared: list[Any] = []
        self._arrivals: deque[tuple[str, bytes | None]] = deque()
        self._arrived, self._most = 0, FRAMES * parameters.maximum_frame
        self._draining = self._ended = False
        # A secret sample by which this port marks the end of a connection.
        self._mark = secrets.token_bytes(16)
        self._room = threading.Condition()

    def configuration(self, **changes: Any) -> Any:
        """The configuration of a session."""
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
            # Zenoh renews the lease in its own threads, so it expires only when a process dies.
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
        """The connection of an unknown number; None to ignore it."""

    # Called in threads of Zenoh.

    def subscribe(self, session: Any, key: str) -> Any:
        """Subscribe to a key expression; returns the declaration, which must be kept."""
        # A callback would follow a queue of hundreds of samples of any length.
        subscriber = session.declare_subscriber(key, self.zenoh.handlers.FifoChannel(_ARRIVALS))
        self.aside(self._read, subscriber.handler)
        return subscriber

    def _read(self, samples: Any) -> None:
        for sample in samples:
            record = sample.payload.to_bytes()
            self._put_in(str(sample.key_expr).rpartition("/")[2], None if record == self._mark else record)

    def aside(self, call: Callable[..., None], *arguments: Any) -> None:
        """Make a blocking call in a thread, for which the interpreter waits a few seconds at its end."""
        thread = threading.Thread(target=call, args=arguments, name="symaware-zenoh", daemon=True)
        _threads.add(thread)
        thread.start()

    def watch(self, session: Any, key: str, note: Callable[[Any], None], **options: Any) -> Any:
        """Subscribe to the liveliness tokens of a key expression; returns the declaration, which must be kept."""
        # Not in a callback: it would run in a thread of Zenoh, for whose end one cannot wait.
        channel = self.zenoh.handlers.FifoChannel(_ARRIVALS)
        subscriber = session.liveliness().declare_subscriber(key, channel, **options)
        self.aside(self._watch, subscriber.handler, note)
        return subscriber

    def _watch(self, tokens: Any, note: Callable[[Any], None]) -> None:
        for token in tokens:
            note(token)

    def note_end(self, session: Any, key: str) -> None:
        """Note that a process has ended, after all that it sent to a key expression.

        Liveliness tokens are not ordered with samples, and may overtake them.
        """
        with suppress(self.zenoh.ZError):  # the session is closed
            session.put(key, self._mark, allowed_destination=self.zenoh.Locality.SESSION_LOCAL)

    def _put_in(self, name: str, record: bytes | None) -> None:
        """Queue a record for the port's loop; waits while the queue is full.

        Args:
            name: The number of the connection.
            record: The record; None if the process has ended.
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

    # Called within the port's loop.

    def drain(self) -> None:
        """Handle the records that arrived."""
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
        """Wait until the connections are closed, then close the session."""
        if self.connections:
            await asyncio.wait([each.closed for each in self.connections.values()], timeout=PARTING)
        for connection in list(self.connections.values()):
            connection.drop()
        await self.end_session()

    async def open_session(self, configuration: Any) -> Any:
        """Open a session.

        Raises:
            ZError: It cannot be opened.
        """
        outcome: asyncio.Future[Any] = asyncio.get_running_loop().create_future()

        def settle(session: Any, error: Exception | None) -> None:
            if outcome.done():  # the caller no longer waits
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
        # A thread that waits for room keeps the session open.
        with self._room:
            self._ended = True
            self._arrivals.clear()
            self._arrived = 0
            self._room.notify_all()
        if session is None:
            return
        if self.ending:
            # In this thread, as an interpreter that is about to end starts no threads.
            session.close()
            return
        closed = asyncio.Event()

        def work() -> None:
            session.close()
            self.later(closed.set)

        self.aside(work)
        # Zenoh waits five seconds if samples cannot be sent, as the other end is stopped.
        with suppress(TimeoutError):
            async with asyncio.timeout(PARTING):
                await closed.wait()

    def put(self, key: str, record: bytes, *, wait: bool) -> None:
        """Send a sample.

        Args:
            key: The key expression.
            record: The record.
            wait: Whether to wait for room; otherwise it may be dropped.
        """
        congestion = self.zenoh.CongestionControl
        session = self._session
        if session is not None:
            # Express samples are not batched; the queue for them is short, so they are soon dropped.
            session.put(key, record, congestion_control=congestion.BLOCK if wait else congestion.DROP, express=wait)


class ZenohConnection(Connection):
    """A connection with a number of its own; each record is a sample."""

    shared = True

    def __init__(self, port: ZenohPort, name: str, key: str) -> None:
        super().__init__(port)
        self.name = name
        self._home = port
        self._key = key
        self._courier: SimpleQueue[Sequence[bytes] | None] | None = None
        self._in_transit = 0
        # The sizes of the records that the other end has not acknowledged, and their sum.
        self._flight: deque[int] = deque()
        self._flying = self._settled = 0
        # The number of records that this end has acknowledged, and of bytes received since.
        self._told = self._untold = 0
        self.closed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        port.connections[name] = self

    def transmit(self, records: Sequence[bytes]) -> None:
        """Send samples from a thread of the connection, which waits for slow links."""
        if not self.protocol.introduced:
            # The preamble; unknown peers get no thread.
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
        """Handle a record, and acknowledge records now and then."""
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
        # While it closes, nothing is received any more, acknowledgements included.
        return not self.parting and (len(self._flight) >= _RECORDS or self._flying >= _BYTES)

    def part(self, reason: str) -> None:
        """Send queued frames and a farewell, then close."""
        self.stalled = False
        super().part(reason)

    def rest(self) -> None:
        """Acknowledge nothing for now; a peer that sends on regardless is refused."""
        parameters, (count, size) = self._home.parameters, self.untaken()
        if count > 2 * parameters.queue + _RECORDS or size > 2 * FRAMES * parameters.maximum_frame + _BYTES:
            self.refuse(ConnectionEnded(f"{self.protocol.other} sent more than it was let", "oversized"))

    def resume(self) -> None:
        """Acknowledge what was received."""
        self._tell()

    def hang_up(self) -> None:
        """Wait until the other end has closed the connection."""

    def drop(self) -> None:
        """Send the closing sample, and remove the connection."""
        if self.closed.done():
            return
        self.closed.set_result(None)
        self._home.connections.pop(self.name, None)
        if self._courier is None:
            self._home.put(self._key, _CLOSED, wait=False)
        else:
            self._courier.put([_CLOSED])
            self._courier.put(None)


#: Threads that are, or were, within Zenoh. One that returned to an interpreter that has ended would abort the
#: process.
_threads: weakref.WeakSet[threading.Thread] = weakref.WeakSet()


@atexit.register  # before those of all ports, and so it is called after them
def _wait_out() -> None:
    """Wait until all threads have returned; their sessions are closed by now."""
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
