"""The connection to one peer, over any transport: the frames that wait, their limits, and how the connection ends."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import ClassVar, Protocol

from symaware_cli.processes.protocol import COUNT, FAREWELL, FRAME, PING, PONG, ConnectionEnded, PeerProtocol
from symaware_cli.processes.transport import PortEvent, Rejection, TransportParameters

#: How long the other end may take to receive what was sent before its connection is closed [s].
PARTING = 1.0

#: The capacity of each queue, as a number of frames of the greatest length.
FRAMES = 4

#: About how many bytes are transmitted at once.
_BATCH = 2**18

#: Most pings and pongs that may wait.
_CLOCKS = 16

#: Rejections that third parties can cause on shared connections; if a record was lost, the next one reveals it.
_NOT_FROM_THERE = ("oversized", "unauthenticated", "replayed")


class ConnectionOwner(Protocol):
    """The port of a connection, as the connection uses it; see `PeerPort`.

    Attributes:
        parameters: The parameters of the transport.
        is_host: Whether this is the host's port.
        links: Every connection that is not closed.
    """

    parameters: TransportParameters
    is_host: bool
    links: set[Connection]

    @property
    def numbers(self) -> Iterator[int]:
        """The numbers of further peers."""

    def protocol(self) -> PeerProtocol:
        """Create the protocol of a new connection."""

    def call_later(self, delay: float, call: Callable[[], None]) -> None:
        """Have something called after a delay [s]."""

    def admit(self, connection: Connection) -> None:
        """Admit a connection after its handshake, if there is room."""

    def leave(self, connection: Connection) -> None:
        """Remove a connection that has ended."""

    def deliver(self, event: PortEvent, connection: Connection) -> None:
        """Queue an event for the run's thread."""

    def reject(self, rejection: Rejection) -> None:
        """Count a rejected frame or connection."""


class Connection(ABC):
    """The connection to one peer: the protocol with it, the frames that wait, and how the connection ends.

    A subclass moves bytes: it calls `hear`, `pump` and `lost`, and implements the abstract methods. All methods but
    `take` are called with the port's lock.

    Attributes:
        peer: Its number.
        protocol: Its protocol.
        origin: The address of the other end, if known.
        came: Whether the run received the event ``came``.
        accepted: Whether the other end is a member.
        parting: Whether this end is closing it: nothing more is received, but what waits is sent.
        gone: Whether it has ended.
        full: Whether too many frames wait for the run's thread.
        held: Whether nothing can be transmitted at present.
        given: The number of frames received.
        stalled: Whether no frames should be sent, as the other end has not acknowledged earlier ones.
        shared: Whether third parties can send records on this connection; then an unsigned record does not end it.
    """

    shared: ClassVar[bool] = False

    def __init__(self, port: ConnectionOwner, origin: str = "") -> None:
        parameters = port.parameters
        self.port = port
        self.peer = next(port.numbers)
        self.protocol = port.protocol()
        self.origin = origin
        self.came = self.accepted = self.parting = self.gone = self.full = self.held = self.stalled = False
        self._limits = parameters.queue, FRAMES * parameters.maximum_frame
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0
        self._farewell: bytes | None = None
        # Each of these is written by one thread only.
        self.given = self._given_bytes = 0
        self._taken = self._taken_bytes = 0
        port.links.add(self)

    # Implemented by subclasses.

    @abstractmethod
    def transmit(self, records: Sequence[bytes]) -> None:
        """Send records; sets `held` if no more can be sent for now, and calls `pump` when they can."""

    @abstractmethod
    def rest(self) -> None:
        """Stop reading until `resume`."""

    @abstractmethod
    def resume(self) -> None:
        """Continue to read."""

    @abstractmethod
    def hang_up(self) -> None:
        """Close the connection once the other end has received everything, within `PARTING`."""

    @abstractmethod
    def drop(self) -> None:
        """Close the connection at once, and call `PeerPort.closed`."""

    # Called by subclasses.

    def hear(self, record: bytes | memoryview, now: float) -> None:
        """Handle a complete record."""
        if self.gone or self.parting:
            return
        protocol, was_open = self.protocol, self.protocol.open
        try:
            frame = protocol.hear(record, now)
        except ConnectionEnded as over:
            self.refuse(over)
            return
        if frame is not None:
            self.given += 1
            self._given_bytes += len(frame)
            self.port.deliver(PortEvent("frame", self.peer, frame), self)
            if self._behind(1):
                self.full = True
                self.rest()
                self.look_again()
        elif protocol.open and not was_open:
            self.port.admit(self)
        if protocol.outgoing:
            self.pump()

    def lost(self, reason: str = "") -> None:
        """Handle the loss of the underlying connection."""
        reason = reason or f"the connection to {self.protocol.other} was lost"
        # A host counts a peer that left during its handshake; a member may lose a host that way without any fault.
        unfinished = self.port.is_host and self.protocol.heard and not self.protocol.open
        self.refuse(ConnectionEnded(reason, "garbage" if unfinished else None))

    def refuse(self, over: ConnectionEnded) -> None:
        """End the connection for a reason, and count a rejection."""
        if self.gone:
            return
        if over.rejection is not None:
            self.port.reject(over.rejection)
        if self.shared and self.came and self.protocol.signed and over.rejection in _NOT_FROM_THERE:
            return
        # A member must learn that it was refused; a host need not know of unknown peers that left.
        self._leave(str(over), told=self.came or (not self.port.is_host and over.rejection is not None))
        self.drop()

    # Called by the port.

    def tick(self, now: float) -> None:
        """Check the time limits."""
        if self.gone or self.parting:
            return
        if self.full:
            # Nothing is read at present, so silence does not mean that the other end is dead.
            self.protocol.notice(now)
            self.look_again()
        try:
            self.protocol.tick(now)
        except ConnectionEnded as over:
            self.refuse(over)
            return
        self.pump()

    def send(self, frame: bytes) -> None:
        """Send a frame, or queue it."""
        if not self.came or self.gone or self.parting:
            return
        if self.held or self.stalled or self._waiting or self.protocol.outgoing:
            self._waiting.append(frame)
            self._waiting_bytes += len(frame)
            self.pump()
        else:
            self.transmit([self.protocol.record(FRAME, frame)])

    def check_queue(self) -> None:
        """End the connection if too many frames wait for it."""
        count, size = self._limits
        if len(self._waiting) > count or self._waiting_bytes > size:
            self.refuse(ConnectionEnded("too many frames waited for it"))

    def part(self, reason: str) -> None:
        """Send queued frames and a farewell, then close; for the run the connection has ended now."""
        if self.gone or self.parting:
            return
        if not self.protocol.introduced:
            self.refuse(ConnectionEnded(reason))
            return
        self.parting = True
        if self.came:
            self.port.deliver(PortEvent("gone", self.peer, reason=reason), self)
        self._farewell = reason.encode()[:512]
        self.port.call_later(PARTING, self._let_go)
        if self.full:
            self.full = False
            self.port.call_later(0.0, self.resume)
        self.pump()

    def pump(self) -> None:
        """Transmit as much as possible."""
        if self.gone:
            return
        outgoing = self.protocol.outgoing
        if self.held:
            # A peer that does not read need not get every pong that it asked for.
            if len(outgoing) > _CLOCKS:
                outgoing[:] = [each for each in outgoing if each[0] not in (COUNT, PING, PONG)]
            return
        while (outgoing or (self._waiting and not self.stalled)) and not self.held:
            records = [self.protocol.record(*each) for each in outgoing]
            outgoing.clear()
            size = 0
            while self._waiting and size < _BATCH and not self.stalled:
                frame = self._waiting.popleft()
                self._waiting_bytes -= len(frame)
                size += len(frame)
                records.append(self.protocol.record(FRAME, frame))
            self.transmit(records)
        if self._farewell is not None and not self._waiting and not self.held:
            self.transmit([self.protocol.record(FAREWELL, self._farewell)])
            self._farewell = None
            self._leave("", told=False)
            self.hang_up()

    def look_again(self) -> None:
        """Continue to read if few enough frames wait by now."""
        if self.full and not self.gone and not self._behind(2):
            self.full = False
            # Not at once: this may be called while something is read.
            self.port.call_later(0.0, self.resume)

    def untaken(self) -> tuple[int, int]:
        """The number of frames that wait for the run's thread, and of their bytes."""
        return self.given - self._taken, self._given_bytes - self._taken_bytes

    @property
    def spoke(self) -> bool:
        """Whether the other end sent any frame."""
        return self.given > 0

    def _behind(self, part: int) -> bool:
        """Whether the queue for the run's thread is filled to a fraction of its capacity: one half for `part=2`."""
        count, size = self._limits
        waiting = self.given - self._taken
        return waiting * part >= max(count, part) or (self._given_bytes - self._taken_bytes) * part >= size

    def _let_go(self) -> None:
        if not self.gone:
            self._leave("", told=False)
        self.drop()

    def _leave(self, reason: str, *, told: bool) -> None:
        self.gone = True
        self._waiting.clear()
        self._waiting_bytes = 0
        self.port.leave(self)
        if told and not self.parting:
            self.port.deliver(PortEvent("gone", self.peer, reason=reason), self)

    # The run's thread, without the lock.

    def take(self, frame: bytes) -> bool:
        """Note that the run received a frame; returns whether the port should call `look_again`."""
        self._taken += 1
        self._taken_bytes += len(frame)
        return self.full and not self._behind(2)
