"""The base of connections: the protocol with one peer, the queues of frames, and how a connection ends."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from typing import ClassVar, Protocol

from symaware_cli.distributed.protocol import FAREWELL, FRAME, PING, PONG, ConnectionEnded, PeerProtocol
from symaware_cli.distributed.transport import PortEvent, Rejection, TransportParameters

#: About how many bytes are transmitted at once.
_BATCH = 2**18

#: Most pings and pongs that may wait.
_CLOCKS = 16

#: Rejections that third parties can cause on shared connections; if a record was lost, the next one reveals it.
_NOT_FROM_THERE = ("oversized", "unauthenticated", "replayed")

#: The capacity of each queue, as a number of frames of the greatest length.
FRAMES = 4

#: How long the other end may take to receive what was sent before its connection is closed [s].
PARTING = 1.0


class ConnectionOwner(Protocol):
    """What a connection needs of its port.

    Attributes:
        parameters: Those of the transport.
        is_host: Whether the port is the host's.
    """

    parameters: TransportParameters
    is_host: bool

    def number(self) -> int:
        """Return a new number for a peer."""

    def protocol(self) -> PeerProtocol:
        """Create the protocol of a new connection."""

    def call_later(self, delay: float, call: Callable[[], None]) -> None:
        """Schedule a call within the port's loop after a delay [s]."""

    def enter(self, connection: Connection) -> None:
        """Add a connection whose handshake has not begun."""

    def admit(self, connection: Connection) -> None:
        """Admit a connection after its handshake, if there is room."""

    def leave(self, connection: Connection) -> None:
        """Remove a connection that has ended."""

    def deliver(self, event: PortEvent, connection: Connection) -> None:
        """Queue an event for the run's thread."""

    def reject(self, rejection: Rejection) -> None:
        """Count a rejected frame or connection."""


class Connection(ABC):
    """One connection of a port. All methods but `take` are called within the port's loop.

    A subclass transfers bytes: it calls `begin`, `hear`, `pump` and `lost`, and implements the abstract methods.

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

    def __init__(self, port: ConnectionOwner) -> None:
        self._port = port
        self.peer = port.number()
        self.protocol = port.protocol()
        self.origin = ""
        self.came = self.accepted = self.parting = self.gone = self.full = self.held = self.stalled = False
        self._limits = port.parameters.queue, FRAMES * port.parameters.maximum_frame
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0
        self._farewell: bytes | None = None
        # Each of these is written by one thread only.
        self.given = self._given_bytes = 0
        self._taken = self._taken_bytes = 0

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
        """Close the connection at once."""

    @property
    def descriptor(self) -> int | None:
        """The file descriptor to wait for before `read`; None if only the port's loop can read."""
        return None

    def read(self) -> bool:
        """Receive what arrived, outside the port's loop; returns whether it consisted of frames only."""
        return False

    # Called by subclasses.

    def begin(self) -> None:
        """Send the preamble."""
        self.transmit([self.protocol.preamble])

    def hear(self, record: bytes) -> None:
        """Handle a complete record."""
        if self.gone or self.parting:
            return
        protocol, was_open = self.protocol, self.protocol.open
        try:
            frame = protocol.hear(record, time.monotonic())
        except ConnectionEnded as over:
            self.refuse(over)
            return
        if protocol.open and not was_open:
            self._port.admit(self)
        if frame is not None:
            self.given += 1
            self._given_bytes += len(frame)
            self._port.deliver(PortEvent("frame", self.peer, frame), self)
            if self._behind(1):
                self.full = True
                self.rest()
                self.look_again()
        if protocol.outgoing:
            self.pump()

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

    def lost(self, reason: str = "") -> None:
        """Handle the loss of the underlying connection."""
        reason = reason or f"the connection to {self.protocol.other} was lost"
        # A host counts a peer that left during its handshake; a member may lose a host that way without any fault.
        unfinished = self._port.is_host and self.protocol.heard and not self.protocol.open
        self.refuse(ConnectionEnded(reason, "garbage" if unfinished else None))

    def refuse(self, over: ConnectionEnded) -> None:
        """End the connection for a reason, and count a rejection."""
        if self.gone:
            return
        if over.rejection is not None:
            self._port.reject(over.rejection)
        if self.shared and self.came and self.protocol.signed and over.rejection in _NOT_FROM_THERE:
            return
        # A member must learn that it was refused; a host need not know of unknown peers that left.
        self._leave(str(over), told=self.came or (not self._port.is_host and over.rejection is not None))
        self.drop()

    # Called by the port.

    def add(self, frame: bytes) -> None:
        """Queue a frame for `dispatch`."""
        if self.came and not self.gone and not self.parting:
            self._waiting.append(frame)
            self._waiting_bytes += len(frame)

    def dispatch(self) -> None:
        """Send queued frames as far as possible; if too many are left, end the connection."""
        self.pump()
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
            self._port.deliver(PortEvent("gone", self.peer, reason=reason), self)
        self._farewell = reason.encode()[:512]
        self._port.call_later(PARTING, self._let_go)
        if self.full:
            self.full = False
            self._port.call_later(0, self.resume)
        self.pump()

    def pump(self) -> None:
        """Transmit as much as possible."""
        if self.gone:
            return
        outgoing = self.protocol.outgoing
        if self.held:
            # A peer that does not read need not get every pong that it asked for.
            if len(outgoing) > _CLOCKS:
                outgoing[:] = [each for each in outgoing if each[0] not in (PING, PONG)]
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
            self._port.call_later(0, self.resume)

    def untaken(self) -> tuple[int, int]:
        """The number of frames that wait for the run's thread, and of their bytes."""
        return self.given - self._taken, self._given_bytes - self._taken_bytes

    @property
    def spoke(self) -> bool:
        """Whether the other end sent any frame."""
        return self.given > 0

    def _behind(self, part: int) -> bool:
        """Whether the queue for the run's thread is filled to a fraction of its capacity: one half for `part=2`."""
        (count, size), (waiting, waiting_bytes) = self._limits, self.untaken()
        return waiting * part >= max(count, part) or waiting_bytes * part >= size

    def _let_go(self) -> None:
        if not self.gone:
            self._leave("", told=False)
        self.drop()

    def _leave(self, reason: str, *, told: bool) -> None:
        self.gone = True
        self._waiting.clear()
        self._waiting_bytes = 0
        self._port.leave(self)
        if told and not self.parting:
            self._port.deliver(PortEvent("gone", self.peer, reason=reason), self)

    # The run's thread.

    def take(self, frame: bytes) -> bool:
        """Note that the run received a frame; returns whether the port should call `look_again`."""
        self._taken += 1
        self._taken_bytes += len(frame)
        return self.full and not self._behind(2)
