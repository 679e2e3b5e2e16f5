"""The port of the transport ``zenoh``: its session, the samples that arrive, and threads for calls that block."""

from __future__ import annotations

import atexit
import json
import secrets
import threading
import time
import weakref
from abc import abstractmethod
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from symaware_cli.processes.address import address_of
from symaware_cli.processes.connection import FRAMES, Connection
from symaware_cli.processes.port import PeerPort
from symaware_cli.processes.transport import TransportError, TransportParameters

#: The sample that closes a connection.
CLOSED = b""

#: Most samples that wait within Zenoh, and for the port's loop; then its links are no longer read.
_ARRIVALS = 256

#: How long an ending process waits for threads within Zenoh [s], which itself waits five seconds for samples that
#: cannot be sent.
_PATIENCE = 6.0


class ZenohPort(PeerPort):
    """A port whose connections share a session."""

    def __init__(self, host: str, port: int, key: bytes | None, parameters: TransportParameters, is_host: bool) -> None:
        self.zenoh = _library()
        super().__init__(is_host, key, parameters)
        self._place = host, port
        self.address = address_of(host, port)
        #: Every connection whose number is in use.
        self.connections: dict[str, Connection] = {}
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
    def stranger(self, name: str) -> Connection | None:
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
            if record is None or (record == CLOSED and (connection.parting or not connection.protocol.signed)):
                connection.lost()
                connection.drop()
            elif record != CLOSED:
                connection.hear(record, time.monotonic())

    def stop(self) -> None:
        """Do nothing: the session listens until it is closed."""

    def shut(self) -> None:
        """Close the session."""
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
