"""Connections: protocols that a port holds, and what waits to be said in them."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from typing import ClassVar, Protocol

from symaware_cli.distributed.protocol import FAREWELL, FRAME, PING, PONG, ConnectionEnded, PeerProtocol
from symaware_cli.distributed.transport import PortEvent, Rejection, TransportParameters

#: So many bytes are handed on at once, if there are as many.
_BATCH = 2**18

#: So many questions and answers about the clock may wait.
_CLOCKS = 16

#: What anybody can make happen where a connection is shared; if a record is lost by it, the next one tells.
_NOT_FROM_THERE = ("oversized", "unauthenticated", "replayed")

#: For so many of the longest frames there is room in each queue, however many frames that are.
FRAMES = 4

#: How long the other end has to take what was sent before its connection is let go of [s].
PARTING = 1.0


class ConnectionOwner(Protocol):
    """What a connection asks of the port that holds it.

    Attributes:
        parameters: Those of the transport.
        is_host: Whether others come here.
    """

    parameters: TransportParameters
    is_host: bool

    def number(self) -> int:
        """A number that nobody had before."""

    def protocol(self) -> PeerProtocol:
        """Begin a protocol."""

    def call_later(self, delay: float, call: Callable[[], None]) -> None:
        """Call something in the port's thread, after a delay [s]."""

    def enter(self, connection: Connection) -> None:
        """Take in a connection that has not said anything yet."""

    def admit(self, connection: Connection) -> None:
        """Let somebody in who is known now, if there is room."""

    def leave(self, connection: Connection) -> None:
        """Take note that a connection is over."""

    def deliver(self, event: PortEvent, connection: Connection) -> None:
        """Let the run's thread know."""

    def reject(self, rejection: Rejection) -> None:
        """Count what was not taken."""


class Connection(ABC):
    """One connection of a port. Everything but `take` happens in the port's thread.

    A subclass moves bytes: it calls `begin`, `hear`, `pump` and `lost`, and implements what is abstract.

    Attributes:
        peer: Its number.
        protocol: What is said.
        origin: The address that it is from, as far as that is known.
        came: Whether the run was told of it.
        accepted: Whether the run takes the other end for one of those that it awaits.
        parting: Whether this end lets go of it: nothing is heard any more, but what waits is sent.
        gone: Whether it is over.
        full: Whether too many frames wait for the run's thread.
        held: Whether nothing more can be handed on now.
        given: How many frames were heard.
        stalled: Whether no more frames should be, as the other end has not taken those before.
        shared: Whether others than the other end can make something arrive here, so that it is no reason to end it
            if something is not signed.
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

    # What a subclass does.

    @abstractmethod
    def transmit(self, records: Sequence[bytes]) -> None:
        """Hand records on; sets `held` if no more should follow for now, and calls `pump` when they may."""

    @abstractmethod
    def rest(self) -> None:
        """Read nothing more until `resume`."""

    @abstractmethod
    def resume(self) -> None:
        """Read on."""

    @abstractmethod
    def hang_up(self) -> None:
        """Let go when the other end has taken what was handed on, within `PARTING`."""

    @abstractmethod
    def drop(self) -> None:
        """Let go at once."""

    @property
    def descriptor(self) -> int | None:
        """The file descriptor that tells when there is something to `read`; None if only the port's loop can tell."""
        return None

    def read(self) -> bool:
        """Hear what arrived, outside the port's loop; returns whether all of it was frames."""
        return False

    # What a subclass tells.

    def begin(self) -> None:
        """Introduce this end."""
        self.transmit([self.protocol.preamble])

    def hear(self, record: bytes) -> None:
        """Take a record that arrived whole."""
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
        """Look at the clock."""
        if self.gone or self.parting:
            return
        if self.full:
            # What is not read cannot be heard: the other end may well be alive.
            self.protocol.notice(now)
            self.look_again()
        try:
            self.protocol.tick(now)
        except ConnectionEnded as over:
            self.refuse(over)
            return
        self.pump()

    def lost(self, reason: str = "") -> None:
        """Take note that nothing carries this connection any more."""
        reason = reason or f"the connection to {self.protocol.other} was lost"
        # To a member it happens that the host goes before it has let it in; a host is told nothing by who only begins.
        unfinished = self._port.is_host and self.protocol.heard and not self.protocol.open
        self.refuse(ConnectionEnded(reason, "garbage" if unfinished else None))

    def refuse(self, over: ConnectionEnded) -> None:
        """End it, for what was heard or was not."""
        if self.gone:
            return
        if over.rejection is not None:
            self._port.reject(over.rejection)
        if self.shared and self.came and self.protocol.signed and over.rejection in _NOT_FROM_THERE:
            return
        # A member that was turned away must learn of it; a host need not know of strangers that left.
        self._leave(str(over), told=self.came or (not self._port.is_host and over.rejection is not None))
        self.drop()

    # What the port asks for.

    def add(self, frame: bytes) -> None:
        """Let a frame wait for `dispatch`."""
        if self.came and not self.gone and not self.parting:
            self._waiting.append(frame)
            self._waiting_bytes += len(frame)

    def dispatch(self) -> None:
        """Send what waits, as much as can be; if too much is left, it is over."""
        self.pump()
        count, size = self._limits
        if len(self._waiting) > count or self._waiting_bytes > size:
            self.refuse(ConnectionEnded("too many frames waited for it"))

    def part(self, reason: str) -> None:
        """Send what waits, say farewell and let go; for the run it is over now."""
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
        """Hand on as much as can be."""
        if self.gone:
            return
        outgoing = self.protocol.outgoing
        if self.held:
            # Who does not read what it asked for need not be told more and more.
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
        """Read on if few enough frames wait by now."""
        if self.full and not self.gone and not self._behind(2):
            self.full = False
            # Not at once: this may be called while something is read.
            self._port.call_later(0, self.resume)

    def untaken(self) -> tuple[int, int]:
        """How many frames wait for the run's thread, and how many bytes."""
        return self.given - self._taken, self._given_bytes - self._taken_bytes

    @property
    def spoke(self) -> bool:
        """Whether it sent any frame."""
        return self.given > 0

    def _behind(self, part: int) -> bool:
        """Whether as many frames wait for the run's thread as may, or one part of so many of them."""
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
        """Take note that the run has a frame; returns whether the port should `look_again`."""
        self._taken += 1
        self._taken_bytes += len(frame)
        return self.full and not self._behind(2)
