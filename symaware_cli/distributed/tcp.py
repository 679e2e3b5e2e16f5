"""The transport ``tcp``: one connection for each process, over IPv4 or IPv6."""

from __future__ import annotations

import asyncio
import errno
import socket
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import cast

from symaware_cli.distributed.address import address_of, numeric
from symaware_cli.distributed.connection import PARTING, Connection
from symaware_cli.distributed.port import LoopPort
from symaware_cli.distributed.protocol import PREAMBLE, ConnectionEnded, may_begin
from symaware_cli.distributed.transport import Port, Transport, TransportError

#: The size of the length before each record [bytes].
_LENGTH = 4

#: Most bytes that may wait in asyncio's write buffer.
_AHEAD = 2**20

#: Most bytes that are read at once outside asyncio.
_READ = 2**16

#: The errors that mean that the other machine does not respond.
_SILENT = (errno.ETIMEDOUT, errno.EHOSTUNREACH, errno.ENETUNREACH)

#: The most open sockets, as a multiple of the most members: including those in the handshake and those closing.
_OPEN = 4


class Tcp(Transport):
    """TCP: the processes of a run on one machine, or on several in one network. Frames are signed, but not secret."""

    def listen(self, host: str, port: int, key: bytes | None = None) -> Port:
        """Open a listening socket."""
        return _opened(_HostPort(numeric(host), port, key, self))

    def join(self, host: str, port: int, key: bytes | None = None) -> Port:
        """Connect a socket, and reconnect after each loss."""
        if not 0 < port < 2**16:
            raise TransportError(f"nobody can listen at port {port}")
        return _opened(_MemberPort(numeric(host), port, key, self))


def _opened(port: LoopPort) -> Port:
    port.start()
    return port


class _TcpPort(LoopPort):
    """A port whose connections are sockets."""

    def __init__(self, host: str, port: int, key: bytes | None, transport: Tcp, *, listens: bool) -> None:
        super().__init__(listens, key, transport.parameters)
        self._place = host, port
        self.address = address_of(host, port)
        #: Every connection whose socket is open.
        self.sockets: set[_TcpConnection] = set()

    async def shut(self) -> None:
        if self.sockets:
            await asyncio.wait([each.closed for each in self.sockets], timeout=PARTING)
        while left := list(self.sockets):
            for connection in left:
                connection.drop()
            await asyncio.wait([each.closed for each in left])


class _HostPort(_TcpPort):
    def __init__(self, host: str, port: int, key: bytes | None, transport: Tcp) -> None:
        super().__init__(host, port, key, transport, listens=True)
        self._server: asyncio.Server | None = None

    async def open(self) -> None:
        try:
            self._server = await asyncio.get_running_loop().create_server(lambda: _TcpConnection(self), *self._place)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise TransportError(f"cannot listen at {self.address}: {reason}") from error
        self.address = address_of(*self._server.sockets[0].getsockname()[:2])

    async def shut(self) -> None:
        # A socket that was just accepted is not a connection yet but a task of asyncio, the only other one left. If the
        # task ran after the server was closed, its socket would stay open.
        end = time.monotonic() + PARTING
        while (others := asyncio.all_tasks() - {asyncio.current_task()}) and (left := end - time.monotonic()) > 0.0:
            await asyncio.wait(others, timeout=left)
        if self._server is not None:
            self._server.close()
        await super().shut()


class _MemberPort(_TcpPort):
    def __init__(self, host: str, port: int, key: bytes | None, transport: Tcp) -> None:
        super().__init__(host, port, key, transport, listens=False)

    async def open(self) -> None:
        self.keep(self.keep_connected(self._connect))

    async def _connect(self) -> Connection | None:
        try:
            async with asyncio.timeout(self.parameters.timeout):
                _, connection = await asyncio.get_running_loop().create_connection(
                    lambda: _TcpConnection(self), *self._place
                )
        except OSError:  # no host listens there yet
            return None
        await asyncio.shield(connection.closed)
        return connection


class _TcpConnection(asyncio.Protocol, Connection):
    """A connection over a socket. Each record is preceded by its length, the preamble is not."""

    def __init__(self, port: _TcpPort) -> None:
        Connection.__init__(self, port)
        self._sockets = port.sockets
        self._transport = cast("asyncio.Transport", None)
        self._buffer = bytearray()
        # A duplicate of the socket, to read outside asyncio.
        self._socket: socket.socket | None = None
        self._descriptor: int | None = None
        self._error: OSError | None = None
        self.closed: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    # Called by asyncio.

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.Transport", transport)
        self._transport.set_write_buffer_limits(_AHEAD)
        self._descriptor = transport.get_extra_info("socket").fileno()
        self._socket = transport.get_extra_info("socket").dup()
        self._transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        _watch(self._transport.get_extra_info("socket"), self._port.parameters.timeout)
        self.origin = str((transport.get_extra_info("peername") or ("",))[0])
        self._sockets.add(self)
        if transport.get_extra_info("sockname") == transport.get_extra_info("peername"):
            # If no process listens, a socket may be assigned the port to which it connects.
            self.drop()
            return
        self._port.enter(self)
        if len(self._sockets) > _OPEN * self._port.parameters.members:
            self.refuse(ConnectionEnded("too many connections are open", "crowded"))

    def data_received(self, data: bytes) -> None:
        self.protocol.notice(time.monotonic())
        if self.gone or self.parting:
            return
        self._buffer += data
        self._split()

    def eof_received(self) -> bool:
        self.lost()
        return False

    def connection_lost(self, error: Exception | None) -> None:
        error = error or self._error
        if error is not None:
            self._read_rest()
        if self._socket is not None:
            self._socket.close()
        self._sockets.discard(self)
        self._buffer.clear()
        silent = isinstance(error, OSError) and error.errno in _SILENT
        self.lost(f"the machine of {self.protocol.other} does not answer" if silent else "")
        if not self.closed.done():
            self.closed.set_result(None)

    def _read_rest(self) -> None:
        """Read what arrived before the other end closed; asyncio stops reading when it cannot write."""
        with suppress(OSError):
            while self._socket is not None and (data := self._socket.recv(_AHEAD)):
                self.data_received(data)

    def pause_writing(self) -> None:
        self.held = True

    def resume_writing(self) -> None:
        self.held = False
        self.pump()

    def _split(self) -> None:
        """Split what arrived into records."""
        buffer, position = self._buffer, 0
        while not (self.gone or self.full or self.parting):
            if not self.protocol.introduced:
                start, length = position, PREAMBLE
                # Other protocols are refused at once, not after as many bytes as a preamble has.
                if not may_begin(bytes(buffer[:PREAMBLE])):
                    length = min(len(buffer), PREAMBLE)
            elif len(buffer) - position < _LENGTH:
                break
            else:
                start = position + _LENGTH
                length = int.from_bytes(buffer[position:start])
                if length > self.protocol.limit:
                    self.refuse(ConnectionEnded(f"{self.protocol.other} announced {length} bytes", "oversized"))
                    break
            if len(buffer) - start < length:
                break
            position = start + length
            self.hear(bytes(memoryview(buffer)[start:position]))
        del buffer[:position]

    # Called by the port and by the base class.

    @property
    def descriptor(self) -> int | None:
        return self._descriptor

    def read(self) -> bool:
        assert self._socket is not None
        try:
            data = self._socket.recv(_READ)
        except BlockingIOError:
            return True
        except OSError as error:
            self._error = error
            self._transport.abort()
            return False
        if not data:
            return False  # asyncio reads the same
        given = self.given
        self.data_received(data)
        return self.given > given and not (self.gone or self.parting or self.full)

    def transmit(self, records: Sequence[bytes]) -> None:
        if self._transport.is_closing():
            return
        parts: list[bytes] = []
        for record in records:
            if record is not self.protocol.preamble:
                parts.append(len(record).to_bytes(_LENGTH))
            parts.append(record)
        self._transport.write(b"".join(parts))

    def rest(self) -> None:
        self._transport.pause_reading()

    def resume(self) -> None:
        self._split()
        if not self.full and not self._transport.is_closing():
            self._transport.resume_reading()

    def hang_up(self) -> None:
        """Close this direction; the other end closes the connection then."""
        # If this end closed with unread data, the other would get an error before it had read everything.
        try:
            if not self._transport.is_closing():
                self._transport.write_eof()
        except OSError:  # it is closed already
            self.drop()

    def drop(self) -> None:
        self._transport.abort()


def _watch(connected: socket.socket, timeout: float) -> None:
    """Make the operating system break a connection whose other machine no longer responds.

    The other operating system responds, whatever its process does. Pings ensure that there is always something to
    acknowledge; systems without `TCP_USER_TIMEOUT` only probe idle connections.

    Args:
        connected: The socket.
        timeout: After which time [s], rounded to seconds, at least one.
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
