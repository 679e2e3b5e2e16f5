"""The transport ``zenoh``: frames as samples of Eclipse Zenoh, over its own TCP links.

The host listens, and every member is its client; there is no discovery. Each connection of a member has a number, which
is part of its key expressions, and a liveliness token, which disappears when its process dies. Every client of the host
may send to any of these numbers: with a key, records that are not signed are dropped, and the connection continues.
"""

from __future__ import annotations

import asyncio
import secrets
import socket
from collections import deque
from typing import Any

from symaware_cli.distributed.address import address_of, numeric
from symaware_cli.distributed.connection import Connection
from symaware_cli.distributed.transport import Port, Transport, TransportError, TransportParameters
from symaware_cli.distributed.zenoh_port import ZenohConnection, ZenohPort

#: The prefix of all key expressions, with the version of their use.
_ROOT = "symaware/1"

#: The number of ended connections whose numbers are stored, as samples from them may still arrive.
_REMEMBERED = 1024


class Zenoh(Transport):
    """Eclipse Zenoh, without its discovery: the host listens, and members connect to it. Needs the extra `zenoh`."""

    def listen(self, host: str, port: int, key: bytes | None = None) -> Port:
        """Open a Zenoh session that listens."""
        opened = _HostPort(numeric(host), port, key, self.parameters)
        opened.start()
        return opened

    def join(self, host: str, port: int, key: bytes | None = None) -> Port:
        """Open a Zenoh session that connects, and reconnects after each loss."""
        if not 0 < port < 2**16:
            raise TransportError(f"nobody can listen at port {port}")
        joined = _MemberPort(numeric(host), port, key, self.parameters)
        joined.start()
        return joined


class _HostPort(ZenohPort):
    def __init__(self, host: str, port: int, key: bytes | None, parameters: TransportParameters) -> None:
        super().__init__(host, port, key, parameters, True)
        self._late: deque[str] = deque(maxlen=_REMEMBERED)

    async def open(self) -> None:
        """Listen."""
        host, port = self._place
        try:
            port = port or _free_port(host)
            self.address = address_of(host, port)
            endpoint = f"tcp/{self.address}"
            configuration = self.configuration(**{"mode": "peer", "listen/endpoints": [endpoint]})
            self._session = await self.open_session(configuration)
        except (OSError, OverflowError, self.zenoh.ZError) as error:
            reason = getattr(error, "strerror", None) or str(error).partition(" at /")[0]
            raise TransportError(f"cannot listen at {self.address}: {reason}") from error
        session = self._session

        def note(sample: Any) -> None:
            if sample.kind == self.zenoh.SampleKind.DELETE:
                self.note_end(session, f"{_ROOT}/host/{str(sample.key_expr).rpartition('/')[2]}")

        self._declared = [
            self.subscribe(session, f"{_ROOT}/host/*"),
            self.watch(session, f"{_ROOT}/alive/member/*", note),
            session.liveliness().declare_token(f"{_ROOT}/alive/host"),
        ]

    def stranger(self, name: str) -> ZenohConnection | None:
        """A new connection, unless the number was in use before."""
        if name in self._late:
            return None
        connection = ZenohConnection(self, name, f"{_ROOT}/member/{name}")
        self.enter(connection)
        return connection

    def leave(self, connection: Connection) -> None:
        """Remove the connection, and store its number."""
        super().leave(connection)
        if connection.came and isinstance(connection, ZenohConnection):
            self._late.append(connection.name)


class _MemberPort(ZenohPort):
    def __init__(self, host: str, port: int, key: bytes | None, parameters: TransportParameters) -> None:
        super().__init__(host, port, key, parameters, False)

    async def open(self) -> None:
        """Begin to connect."""
        self.keep(self.keep_connected(self._connect))

    async def _connect(self) -> Connection | None:
        endpoint = f"tcp/{self.address}"
        configuration = self.configuration(**{"mode": "client", "connect/endpoints": [endpoint]})
        try:
            self._session = session = await self.open_session(configuration)
            self._ended = False
        except self.zenoh.ZError:  # no host listens there yet
            return None
        name = secrets.token_hex(8)
        try:
            found = asyncio.Event()

            def note(sample: Any) -> None:
                if sample.kind == self.zenoh.SampleKind.DELETE:
                    self.note_end(session, f"{_ROOT}/member/{name}")
                else:
                    self.later(found.set)

            self._declared = [
                self.subscribe(session, f"{_ROOT}/member/{name}"),
                session.liveliness().declare_token(f"{_ROOT}/alive/member/{name}"),
                self.watch(session, f"{_ROOT}/alive/host", note, history=True),
            ]
            # The host's subscriptions are declared before its token: earlier samples might be lost.
            async with asyncio.timeout(self.parameters.timeout):
                await found.wait()
            connection = ZenohConnection(self, name, f"{_ROOT}/host/{name}")
            self.enter(connection)
            await asyncio.shield(connection.closed)
        except TimeoutError:
            return None
        finally:
            if not self.ending:
                await self.end_session()
        return connection

    def stranger(self, name: str) -> ZenohConnection | None:
        """None: a member has one peer."""
        return None


def _free_port(host: str) -> int:
    """Return a free port; Zenoh does not report which one it chose."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])
