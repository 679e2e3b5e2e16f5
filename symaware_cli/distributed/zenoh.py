"""The transport ``zenoh``: frames as samples of Eclipse Zenoh, over its own TCP links.

The host listens, and every member is its client; there is no discovery. A port has a session, each connection of a
member a number, which is part of its key expressions, and a liveliness token, which disappears when its process dies.
Each record is a sample. Every client of the host may send to any of these numbers: with a key, records that are not
signed are dropped, and the connection continues.
"""

from __future__ import annotations

import atexit
import json
import secrets
import socket
import threading
import time
import weakref
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from queue import SimpleQueue
from typing import Any

from symaware_cli.distributed.address import address_of, numeric
from symaware_cli.distributed.connection import FRAMES, PARTING, Connection
from symaware_cli.distributed.port import PeerPort
from symaware_cli.distributed.protocol import ConnectionEnded
from symaware_cli.distributed.transport import Port, Transport, TransportError, TransportParameters

#: The prefix of all key expressions, with the version of their use.
_ROOT = "symaware/1"

#: The number of ended connections whose numbers are stored, as samples from them may still arrive.
_REMEMBERED = 1024

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


class Zenoh(Transport):
    """Eclipse Zenoh, without its discovery: the host listens, and members connect to it. Needs the extra `zenoh`."""

    def listen(self, host: str, port: int, key: bytes | None = None) -> Port:
        """Open a Zenoh session that listens."""
        return _HostPort(numeric(host), port, key, self.parameters, True).start()

    def join(self, host: str, port: int, key: bytes | None = None) -> Port:
        """Open a Zenoh session that connects, and reconnects after each loss."""
        if not 0 < port < 2**16:
            raise TransportError(f"nobody can listen at port {port}")
        return _MemberPort(numeric(host), port, key, self.parameters, False).start()


class _ZenohPort(PeerPort):
    """A port whose connections share a session."""

    def __init__(self, host: str, port: int, key: bytes | None, parameters: TransportParameters, is_host: bool) -> None:
        self.zenoh = _library()
        super().__init__(is_host, key, parameters)
        self._place = host, port
        self.address = address_of(host, port)
        #: Every connection whose number is in use.
        self.connections: dict[str, _ZenohConnection] = {}
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
    def stranger(self, name: str) -> _ZenohConnection | None:
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
        """Queue a record for the port; waits while the queue is full.

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

    # Called with the port's lock.

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
                connection.hear(record, time.monotonic())

    def stop(self) -> None:
        return

    def shut(self) -> None:
        # In this thread, as an interpreter that is about to end starts no threads.
        if (session := self._detached()) is not None:
            session.close()

    def _detached(self) -> Any:
        """The session, which this port uses no more; None if there is none."""
        session, self._session = self._session, None
        self._declared = []
        # A thread that waits for room keeps the session open.
        with self._room:
            self._ended = True
            self._arrivals.clear()
            self._arrived = 0
            self._room.notify_all()
        return session

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


class _HostPort(_ZenohPort):
    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._late: deque[str] = deque(maxlen=_REMEMBERED)

    def open(self) -> None:
        host, port = self._place
        try:
            port = port or _free_port(host)
            self.address = address_of(host, port)
            endpoint = f"tcp/{self.address}"
            configuration = self.configuration(**{"mode": "peer", "listen/endpoints": [endpoint]})
            self._session = session = self.zenoh.open(configuration)
        except (OSError, OverflowError, self.zenoh.ZError) as error:
            reason = getattr(error, "strerror", None) or str(error).partition(" at /")[0]
            raise TransportError(f"cannot listen at {self.address}: {reason}") from error

        def note(sample: Any) -> None:
            if sample.kind == self.zenoh.SampleKind.DELETE:
                self.note_end(session, f"{_ROOT}/host/{str(sample.key_expr).rpartition('/')[2]}")

        self._declared = [
            self.subscribe(session, f"{_ROOT}/host/*"),
            self.watch(session, f"{_ROOT}/alive/member/*", note),
            session.liveliness().declare_token(f"{_ROOT}/alive/host"),
        ]

    def stranger(self, name: str) -> _ZenohConnection | None:
        if name in self._late:
            return None
        connection = _ZenohConnection(self, name, f"{_ROOT}/member/{name}")
        self.enter(connection)
        return connection

    def leave(self, connection: Connection) -> None:
        super().leave(connection)
        if connection.came and isinstance(connection, _ZenohConnection):
            self._late.append(connection.name)


class _MemberPort(_ZenohPort):
    def open(self) -> None:
        self.connect()

    def connect(self) -> None:
        endpoint = f"tcp/{self.address}"
        configuration = self.configuration(**{"mode": "client", "connect/endpoints": [endpoint]})

        def work() -> None:
            try:
                session = self.zenoh.open(configuration)
            except self.zenoh.ZError:  # no host listens there yet
                self.later(self.retry)
            else:
                if not self.later(self._on_opened, session):
                    session.close()

        self.aside(work)

    def _on_opened(self, session: Any) -> None:
        if self.ending:
            session.close()
            return
        self._session, self._ended = session, False
        name = secrets.token_hex(8)
        is_there = False

        def note(sample: Any) -> None:
            if sample.kind == self.zenoh.SampleKind.DELETE:
                self.note_end(session, f"{_ROOT}/member/{name}")
            else:
                self.later(begin)

        def begin() -> None:
            nonlocal is_there
            if not is_there and self._session is session:
                is_there = True
                self.enter(_ZenohConnection(self, name, f"{_ROOT}/host/{name}"))

        def give_up() -> None:
            if not is_there and self._session is session:
                self._end_session(None)

        self._declared = [
            self.subscribe(session, f"{_ROOT}/member/{name}"),
            session.liveliness().declare_token(f"{_ROOT}/alive/member/{name}"),
            # The host's subscriptions are declared before its token: earlier samples might be lost.
            self.watch(session, f"{_ROOT}/alive/host", note, history=True),
        ]
        self.call_later(self.parameters.timeout, give_up)

    def closed(self, connection: Connection) -> None:
        if self.ending:
            super().closed(connection)
        else:
            self.links.discard(connection)
            self._end_session(connection)

    def _end_session(self, connection: Connection | None) -> None:
        """Close the session, then connect again; Zenoh waits if samples cannot be sent, as the other end is stopped."""
        session, waits = self._detached(), True

        def go_on() -> None:
            nonlocal waits
            if waits:
                waits = False
                self.retry(connection)

        def work() -> None:
            session.close()
            self.later(go_on)

        self.aside(work)
        self.call_later(PARTING, go_on)

    def stranger(self, name: str) -> _ZenohConnection | None:
        return None  # a member has one peer


class _ZenohConnection(Connection):
    """A connection with a number of its own; each record is a sample."""

    shared = True

    def __init__(self, port: _ZenohPort, name: str, key: str) -> None:
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
        self._is_closed = False
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

    def hear(self, record: bytes | memoryview, now: float) -> None:
        """Handle a record, and acknowledge records now and then."""
        super().hear(record, now)
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
        if self._is_closed:
            return
        self._is_closed = True
        self._home.connections.pop(self.name, None)
        if self._courier is None:
            self._home.put(self._key, _CLOSED, wait=False)
        else:
            self._courier.put([_CLOSED])
            self._courier.put(None)
        self._home.closed(self)


#: Threads that are, or were, within Zenoh. One that returned to an interpreter that has ended would abort the
#: process.
_threads: weakref.WeakSet[threading.Thread] = weakref.WeakSet()


@atexit.register  # before those of all ports, and so it is called after them
def _wait_out() -> None:
    """Wait until all threads have returned; their sessions are closed by now."""
    end = time.monotonic() + _PATIENCE
    for thread in list(_threads):
        thread.join(max(0.0, end - time.monotonic()))


def _free_port(host: str) -> int:
    """Return a free port; Zenoh does not report which one it chose."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])


def _library() -> Any:
    try:
        import zenoh
    except ModuleNotFoundError as error:
        raise TransportError(
            "the transport `zenoh` needs the module `zenoh`: pip install 'symaware-cli[zenoh]'"
        ) from error
    return zenoh
