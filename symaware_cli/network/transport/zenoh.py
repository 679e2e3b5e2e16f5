"""The transport ``zenoh``: frames as samples of Eclipse Zenoh, over its own TCP links.

The host listens and every member is a client of it; nobody looks for anybody else. Each connection of a member is a
number of its own under which it is spoken to and of, and a liveliness token that tells when its process dies. Whoever
is connected to the host by Zenoh may send to any of these numbers: with a key, what is not sealed is dropped, and the
connection goes on.
"""

from __future__ import annotations

import asyncio
import json
import secrets
import socket
import threading
from abc import abstractmethod
from collections import deque
from collections.abc import Sequence
from queue import SimpleQueue
from typing import Any

from symaware_cli.core import Port, Transport, TransportError, TransportParameters
from symaware_cli.network.transport.address import address_of, numeric
from symaware_cli.network.transport.connection import PARTING, Connection
from symaware_cli.network.transport.port import LoopPort

_ROOT = "symaware/1"

#: What is sent to a number whose connection is over.
_CLOSED = b""

#: So many samples may wait for the port's thread before Zenoh must read no more.
_ARRIVALS = 4096

#: So many batches of records may be on their way to Zenoh.
_UNDERWAY = 4

#: So many numbers whose connections are over are remembered, as something may still arrive from them.
_REMEMBERED = 1024


class Zenoh(Transport):
    """Eclipse Zenoh, without its discovery: the host listens, and members connect to it. Needs the extra `zenoh`."""

    def listen(self, host: str, port: int, key: bytes | None = None) -> Port:
        """Open a Zenoh session that listens."""
        opened = _HostPort(numeric(host), port, key, self.parameters)
        opened.start()
        return opened

    def join(self, host: str, port: int, key: bytes | None = None) -> Port:
        """Open a Zenoh session that connects, again and again."""
        if not 0 < port < 2**16:
            raise TransportError(f"nobody can listen at port {port}")
        joined = _MemberPort(numeric(host), port, key, self.parameters)
        joined.start()
        return joined


def _library() -> Any:
    try:
        import zenoh
    except ModuleNotFoundError as error:
        raise TransportError(
            "the transport `zenoh` needs the module `zenoh`: pip install 'symaware-cli[zenoh]'"
        ) from error
    return zenoh


class _ZenohPort(LoopPort):
    """A port whose connections share a session."""

    def __init__(self, host: str, port: int, key: bytes | None, parameters: TransportParameters, is_host: bool) -> None:
        self.zenoh = _library()
        super().__init__(is_host, key, parameters)
        self._place = host, port
        self.address = address_of(host, port)
        self.sealed = key is not None
        #: Every connection whose number is in use.
        self.connections: dict[str, ZenohConnection] = {}
        self._session: Any = None
        # What is not held any more is not declared any more.
        self._declared: list[Any] = []
        self._arrivals: deque[tuple[str, bytes | None]] = deque()
        self._draining = False
        self._room = threading.Event()

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
            # Longer than what counts as death here, so that it is this port that says why.
            "transport/link/tx/lease": 2 * milliseconds,
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

    def arrive(self, sample: Any) -> None:
        """Take a sample; waits if the port's thread is far behind."""
        self._put(str(sample.key_expr).rpartition("/")[2], sample.payload.to_bytes())

    def note(self, sample: Any) -> None:
        """Take note that a liveliness token came or went."""
        if sample.kind == self.zenoh.SampleKind.DELETE:
            self._put(str(sample.key_expr).rpartition("/")[2], None)

    def _put(self, name: str, record: bytes | None) -> None:
        self._arrivals.append((name, record))
        if not self._draining:
            self._draining = True
            self.later(self.drain)
        if len(self._arrivals) > _ARRIVALS:
            self._room.clear()
            # Looked at again: it may have been emptied, and the event set, just before it was cleared.
            if len(self._arrivals) > _ARRIVALS:
                self._room.wait()

    # The port's thread.

    def drain(self) -> None:
        """Take what arrived, until somebody's frames must wait for the run's thread."""
        self._draining = False
        while self._arrivals:
            name, record = self._arrivals[0]
            connection = self.connections.get(name) or self.stranger(name)
            if connection is not None and connection.full and not connection.gone:
                return
            self._arrivals.popleft()
            if connection is None:
                continue
            if record is None or (record == _CLOSED and (connection.parting or not self.sealed)):
                connection.lost(f"{connection.conversation.other} closed the connection")
                connection.drop()
            elif record != _CLOSED:
                connection.hear(record)
        self._room.set()

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
        # What blocks is done in threads that do not keep the interpreter from ending.
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

        threading.Thread(target=work, name="symaware-zenoh", daemon=True).start()
        return await outcome

    async def end_session(self) -> None:
        """Close the session, if there is one."""
        session, self._session = self._session, None
        self._declared = []
        # Whoever waits for room holds a thread of the session.
        self._arrivals.clear()
        self._room.set()
        if session is None:
            return
        closed = asyncio.Event()

        def work() -> None:
            session.close()
            self.later(closed.set)

        threading.Thread(target=work, name="symaware-zenoh", daemon=True).start()
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
            session.put(key, record, congestion_control=congestion.BLOCK if wait else congestion.DROP, express=True)


class _HostPort(_ZenohPort):
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
        alive = self._session.liveliness()
        self._declared = [
            self._session.declare_subscriber(f"{_ROOT}/host/*", self.arrive),
            alive.declare_subscriber(f"{_ROOT}/alive/member/*", self.note),
            alive.declare_token(f"{_ROOT}/alive/host"),
        ]

    def stranger(self, name: str) -> ZenohConnection | None:
        """Somebody new, unless the number was in use before."""
        if name in self._late:
            return None
        connection = ZenohConnection(self, name, f"{_ROOT}/member/{name}")
        self.enter(connection)
        return connection

    def leave(self, connection: Connection) -> None:
        """Remember the number."""
        super().leave(connection)
        if connection.came and isinstance(connection, ZenohConnection):
            self._late.append(connection.name)


class _MemberPort(_ZenohPort):
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
        except self.zenoh.ZError:  # nobody is there yet
            return None
        name = secrets.token_hex(8)
        connection = ZenohConnection(self, name, f"{_ROOT}/host/{name}")
        try:
            found = asyncio.Event()

            def note(sample: Any) -> None:
                if sample.kind == self.zenoh.SampleKind.DELETE:
                    self._put(name, None)
                else:
                    self.later(found.set)

            alive = session.liveliness()
            self._declared = [
                session.declare_subscriber(f"{_ROOT}/member/{name}", self.arrive),
                alive.declare_token(f"{_ROOT}/alive/member/{name}"),
                alive.declare_subscriber(f"{_ROOT}/alive/host", note, history=True),
            ]
            # The host's declarations come with its token: what is sent sooner might reach nobody.
            async with asyncio.timeout(self.parameters.timeout):
                await found.wait()
            self.enter(connection)
            await asyncio.shield(connection.closed)
        except TimeoutError:
            return None
        finally:
            if not self.ending:
                await self.end_session()
        return connection

    def stranger(self, name: str) -> ZenohConnection | None:
        """Nobody: a member has one peer."""
        return None


class ZenohConnection(Connection):
    """A connection that is a number; each record is a sample."""

    shared = True

    def __init__(self, port: _ZenohPort, name: str, key: str) -> None:
        super().__init__(port)
        self.name = name
        self._home = port
        self._key = key
        self._courier: SimpleQueue[Sequence[bytes] | None] | None = None
        self._underway = 0
        self.closed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        port.connections[name] = self

    def transmit(self, records: Sequence[bytes]) -> None:
        """Put samples, from a thread of the connection: that waits for a slow reader."""
        if not self.came:
            for record in records:
                self._home.put(self._key, record, wait=False)
            return
        if self._courier is None:
            self._courier = SimpleQueue()
            threading.Thread(target=self._carry, name="symaware-zenoh", args=(self._courier,), daemon=True).start()
        self._underway += 1
        self.held = self._underway >= _UNDERWAY
        self._courier.put(records)

    def _carry(self, courier: SimpleQueue[Sequence[bytes] | None]) -> None:
        while (records := courier.get()) is not None:
            try:
                for record in records:
                    self._home.put(self._key, record, wait=True)
            except self._home.zenoh.ZError:
                self._home.later(lambda: self.lost(f"the connection to {self.conversation.other} was lost"))
                return
            self._home.later(self._carried)

    def _carried(self) -> None:
        self._underway -= 1
        self.held = False
        self.pump()

    def rest(self) -> None:
        """The port reads nothing for anybody until then."""

    def resume(self) -> None:
        """Read on."""
        self._home.drain()

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


def _free_port(host: str) -> int:
    """A port nobody listens at; Zenoh does not tell which one it took."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])
