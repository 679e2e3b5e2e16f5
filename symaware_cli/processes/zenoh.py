"""The transport ``zenoh``: frames as samples of Eclipse Zenoh, over its own TCP links.

The host listens, and every member is its client; there is no discovery. A port has a session, each connection of a
member a number, which is part of its key expressions, and a liveliness token, which disappears when its process dies.
Each record is a sample. Every client of the host may send to any of these numbers: with a key, records that are not
signed are dropped, and the connection continues.
"""

from __future__ import annotations

import secrets
import socket
from collections import deque
from collections.abc import Sequence
from queue import SimpleQueue
from typing import Any

from symaware_cli.processes.address import address_of, numeric
from symaware_cli.processes.connection import FRAMES, PARTING, Connection
from symaware_cli.processes.protocol import ConnectionEnded
from symaware_cli.processes.transport import Port, Transport, TransportError
from symaware_cli.processes.zenoh_port import CLOSED, ZenohPort

#: The prefix of all key expressions, with the version of their use.
_ROOT = "symaware/1"

#: The number of ended connections whose numbers are stored, as samples from them may still arrive.
_REMEMBERED = 1024

#: Most records, and most bytes, that may be unacknowledged.
_RECORDS, _BYTES = 256, 2**22

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


class _HostPort(ZenohPort):
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


class _MemberPort(ZenohPort):
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
        """Acknowledge the received records."""
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
            self._home.put(self._key, CLOSED, wait=False)
        else:
            self._courier.put([CLOSED])
            self._courier.put(None)
        self._home.closed(self)


def _free_port(host: str) -> int:
    """Return a free port; Zenoh does not report which one it chose."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])
