"""The transport ``tcp``: one connection for each process, over IPv4 or IPv6."""

from __future__ import annotations

import errno
import os
import selectors
import socket
import time
from collections.abc import Sequence
from contextlib import suppress

from symaware_cli.processes.address import address_of, numeric
from symaware_cli.processes.connection import Connection
from symaware_cli.processes.port import PeerPort
from symaware_cli.processes.protocol import PREAMBLE, ConnectionEnded, may_begin
from symaware_cli.processes.transport import Port, Transport, TransportError, TransportParameters

#: The size of the length before each record [bytes].
_LENGTH = 4

#: How many bytes are read at once, at first and at most.
_READ, _MOST = 2**16, 2**20

#: The errors that mean that the other machine does not respond.
_SILENT = (errno.ETIMEDOUT, errno.EHOSTUNREACH, errno.ENETUNREACH)

#: The most open sockets, as a multiple of the most members: including those in the handshake and those closing.
_OPEN = 4

#: The pause before more connections are accepted, when the process may not open more files [s].
_FULL = 1.0

_READS, _WRITES = selectors.EVENT_READ, selectors.EVENT_WRITE


class Tcp(Transport):
    """TCP: the processes of a run on one machine, or on several in one network. Frames are signed, but not secret."""

    def listen(self, host: str, port: int, key: bytes | None = None) -> Port:
        """Open a listening socket."""
        return _HostPort(numeric(host), port, key, self.parameters).start()

    def join(self, host: str, port: int, key: bytes | None = None) -> Port:
        """Connect a socket, and reconnect after each loss."""
        if not 0 < port < 2**16:
            raise TransportError(f"nobody can listen at port {port}")
        return _MemberPort(numeric(host), port, key, self.parameters).start()


class _TcpPort(PeerPort):
    def __init__(
        self, host: str, port: int, key: bytes | None, parameters: TransportParameters, *, listens: bool
    ) -> None:
        super().__init__(listens, key, parameters)
        self._place = host, port
        self._family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self.address = address_of(host, port)
        #: The socket that listens or connects.
        self._socket: socket.socket | None = None

    def stop(self) -> None:
        opened, self._socket = self._socket, None
        if opened is not None:
            with suppress(KeyError):  # it is not registered at present
                self.selector.unregister(opened)
            opened.close()


class _HostPort(_TcpPort):
    def __init__(self, host: str, port: int, key: bytes | None, parameters: TransportParameters) -> None:
        super().__init__(host, port, key, parameters, listens=True)

    def open(self) -> None:
        try:
            self._socket = socket.create_server(self._place, family=self._family, backlog=128)
        except (OSError, OverflowError) as error:
            reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
            raise TransportError(f"cannot listen at {self.address}: {reason}") from error
        self._socket.setblocking(False)
        self.address = address_of(*self._socket.getsockname()[:2])
        self._listen()

    def _listen(self) -> None:
        if self._socket is not None:
            self.selector.register(self._socket, _READS, self._accept)

    def _accept(self, events: int) -> None:
        assert self._socket is not None
        try:
            accepted, address = self._socket.accept()
        except OSError as error:
            # Otherwise who connected is gone again.
            if error.errno in (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM):
                self.selector.unregister(self._socket)
                self.call_later(_FULL, self._listen)
            return
        connection = _TcpConnection(self, accepted, str(address[0]))
        if len(self.links) > _OPEN * self.parameters.members:
            connection.refuse(ConnectionEnded("too many connections are open", "crowded"))


class _MemberPort(_TcpPort):
    def __init__(self, host: str, port: int, key: bytes | None, parameters: TransportParameters) -> None:
        super().__init__(host, port, key, parameters, listens=False)

    def open(self) -> None:
        self.connect()

    def connect(self) -> None:
        self._socket = opened = socket.socket(self._family)
        opened.setblocking(False)
        if opened.connect_ex(self._place) not in (0, errno.EINPROGRESS):
            self._fail(opened)
            return
        # When the connection is made or refused, the socket can be written to.
        self.selector.register(opened, _WRITES, self._on_connected)
        self.call_later(self.parameters.timeout, lambda: self._fail(opened))

    def _fail(self, opened: socket.socket) -> None:
        """End an attempt that failed or takes too long: no host listens there yet."""
        if self._socket is opened:
            self.stop()
            self.retry()

    def _on_connected(self, events: int) -> None:
        opened = self._socket
        assert opened is not None
        try:
            # If no process listens, a socket may be assigned the port to which it connects.
            is_made = opened.getpeername() != opened.getsockname()
        except OSError:
            is_made = False
        if not is_made:
            self._fail(opened)
            return
        self._socket = None
        self.selector.unregister(opened)
        _TcpConnection(self, opened, self._place[0])


class _TcpConnection(Connection):
    """A connection over a socket. Each record is preceded by its length, the preamble is not."""

    def __init__(self, port: _TcpPort, opened: socket.socket, origin: str) -> None:
        super().__init__(port, origin)
        self._home = port
        self._socket = opened
        #: The beginning of a record, and the end of what was to be sent.
        self._arrived, self._left = bytearray(), memoryview(b"")
        self._length = 0
        self._events = 0
        opened.setblocking(False)
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        _watch(opened, port.parameters.timeout)
        self._select()
        port.enter(self)

    def _select(self) -> None:
        """Wait for the events that matter now."""
        if self._socket.fileno() < 0:
            return
        events = (0 if self.full else _READS) | (_WRITES if self._left else 0)
        if events != self._events:
            selector = self._home.selector
            if not self._events:
                selector.register(self._socket, events, self._on_ready)
            elif not events:
                selector.unregister(self._socket)
            else:
                selector.modify(self._socket, events, self._on_ready)
            self._events = events

    def _on_ready(self, events: int) -> None:
        if events & _READS and not self._read():
            return
        if events & _WRITES and self._left:
            self._write()

    def _read(self) -> bool:
        """Read once; returns whether there may be more at some time."""
        try:
            data = self._socket.recv(min(max(_READ, self._length - len(self._arrived)), _MOST))
        except BlockingIOError:
            return True
        except OSError as error:
            self._break(error)
            return False
        if not data:
            self._break(None)
            return False
        if self.gone or self.parting:
            return True
        now = time.monotonic()
        self.protocol.notice(now)
        if self._arrived:
            self._arrived += data
            if len(self._arrived) >= self._length:
                self._split(memoryview(self._arrived), now)
        else:
            self._split(memoryview(data), now)
        return True

    def _split(self, data: memoryview, now: float) -> None:
        """Split received bytes into records, and keep the rest."""
        position, size = 0, len(data)
        protocol = self.protocol
        self._length = 0
        while not (self.gone or self.full or self.parting):
            if protocol.introduced:
                start = position + _LENGTH
                if size < start:
                    break
                length = int.from_bytes(data[position:start])
                if length > protocol.limit:
                    self.refuse(ConnectionEnded(f"{protocol.other} announced {length} bytes", "oversized"))
                    break
            else:
                start = position
                # Other protocols are refused at once, not after as many bytes as a preamble has.
                length = PREAMBLE if may_begin(bytes(data[:PREAMBLE])) else min(size, PREAMBLE)
            if size < start + length:
                self._length = start + length - position
                break
            position = start + length
            self.hear(data[start:position], now)
        self._arrived = bytearray(data[position:]) if position < size else bytearray()

    def _write(self) -> None:
        """Send as many of the remaining bytes as the socket takes."""
        try:
            self._left = self._left[self._socket.send(self._left) :]
        except BlockingIOError:
            return
        except OSError as error:
            self._break(error)
            return
        if not self._left:
            self.held = False
            self._select()
            self.pump()

    def _break(self, error: OSError | None) -> None:
        """Close the connection because the other end closed it, or because of an error."""
        if self._socket.fileno() < 0:
            return
        if error is not None and not self.gone:
            # What arrived before the other end closed: an error on writing may come first.
            with suppress(OSError):
                while data := self._socket.recv(_MOST):
                    self._arrived += data
            self._split(memoryview(self._arrived), time.monotonic())
        silent = error is not None and error.errno in _SILENT
        self.lost(f"the machine of {self.protocol.other} does not answer" if silent else "")
        self.drop()

    # Called by the base class and the port.

    def transmit(self, records: Sequence[bytes]) -> None:
        protocol = self.protocol
        parts: list[bytes] = []
        for record in records:
            if record is not protocol.preamble:
                parts.append(len(record).to_bytes(_LENGTH))
            parts.append(record)
        data = b"".join(parts)
        try:
            sent = self._socket.send(data)
        except BlockingIOError:
            sent = 0
        except OSError as error:
            # Not at once: this may be called while something is read.
            self.held, broken = True, error
            self.port.call_later(0.0, lambda: self._break(broken))
            return
        if sent < len(data):
            self._left, self.held = memoryview(data)[sent:], True
            self._select()

    def rest(self) -> None:
        self._select()

    def resume(self) -> None:
        if self._socket.fileno() >= 0:
            self._split(memoryview(self._arrived), time.monotonic())
            self._select()

    def hang_up(self) -> None:
        """Close this direction; the other end closes the connection then."""
        # If this end closed with unread data, the other would get an error before it had read everything.
        try:
            self._socket.shutdown(socket.SHUT_WR)
        except OSError:  # it is closed already
            self.drop()

    def drop(self) -> None:
        if self._socket.fileno() < 0:
            return
        if self._events:
            self._home.selector.unregister(self._socket)
        self._socket.close()
        self._arrived = bytearray()
        self._left = memoryview(b"")
        self._home.closed(self)


def _watch(connected: socket.socket, timeout: float) -> None:
    """Make the operating system break a connection whose other machine no longer responds.

    The other operating system responds even if its process hangs. Pings ensure that there is always something to
    acknowledge; systems without `TCP_USER_TIMEOUT` only probe idle connections.

    Args:
        connected: The socket.
        timeout: The time without a response [s], rounded to seconds, at least one.
    """
    seconds = max(1, round(timeout))
    idle = max(1, seconds // 2)
    count = max(1, min(4, seconds - idle))
    options = {
        "TCP_KEEPIDLE" if hasattr(socket, "TCP_KEEPIDLE") else "TCP_KEEPALIVE": idle,
        "TCP_KEEPINTVL": max(1, (seconds - idle) // count),
        "TCP_KEEPCNT": count,
        "TCP_USER_TIMEOUT": 1000 * seconds,
    }
    connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in options.items():
        if hasattr(socket, name):
            connected.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
