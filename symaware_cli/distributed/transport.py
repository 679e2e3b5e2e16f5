"""Transports: what carries whole frames between the processes of one run, and tells who comes and goes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import TracebackType
from typing import ClassVar, Literal, NamedTuple, Self

from pydantic import BaseModel, Field

from symaware_cli.world.plugin import Parameters, Plugin

#: What has become of a frame that was not taken.
Rejection = Literal["garbage", "oversized", "unauthenticated", "replayed", "crowded"]


class TransportError(Exception):
    """A connection cannot be had; says to where, and why."""


class PortEvent(NamedTuple):
    """What happened at a port.

    Whoever came goes once: a frame stands between the two. Who is gone without having come was not let in, or did
    not let us in, as the reason says.

    Attributes:
        kind: Somebody came; sent a frame; or is gone, and nothing more comes from there.
        peer: Who: a number that is never given to anybody else, nor to the same process when it comes again.
        frame: What was sent.
        reason: Why somebody is gone.
    """

    kind: Literal["came", "frame", "gone"]
    peer: int
    frame: bytes = b""
    reason: str = ""


class Port(ABC):
    """One end of a transport: the host's, to which many come, or a member's, whose one peer is the host.

    Who is dead is a matter of the operating systems: a process is gone when its end of the connection is closed, as it
    is when the process ends in whatever way, or when the other machine does not answer for the transport's `timeout`.
    A process that computes for long, even with the interpreter's lock held, is neither; only one that says nothing for
    `hang_timeout`, though its threads should, counts as dead, too.

    All methods may be called from the run's thread only. Used in a ``with`` statement, it is closed at the end.

    Attributes:
        address: Where it is, as ``HOST:PORT``.
        rejected: How many frames were not taken, by why.
    """

    address: str
    rejected: Mapping[Rejection, int]

    @abstractmethod
    def send(self, peer: int, frame: bytes) -> None:
        """Send a frame, without waiting for anything. To send to somebody who is gone does nothing.

        A peer for whom too many frames wait is cut off: it is gone, and may come again.

        Raises:
            ValueError: The frame is longer than any that is taken.
        """

    @abstractmethod
    def receive(self, timeout: float | None = None) -> PortEvent | None:
        """Return what happened next, or None if nothing did within some time [s]; by default wait for ever."""

    def accept(self, peer: int) -> None:
        """Take note that a peer is one of those that are awaited: others have to make room, if there are too many."""
        return

    @abstractmethod
    def offset(self, peer: int) -> float:
        """How far the monotonic clock of a peer is ahead of ours [s], as well as is known; 0 if it is gone."""

    @abstractmethod
    def cut(self, peer: int, reason: str) -> None:
        """Send what waits for a peer, then let go of it; a member's port does not go back to it by itself.

        It is gone, for this reason, here and at the other end.
        """

    @abstractmethod
    def close(self, reason: str = "") -> None:
        """Send what waits, for a second at most, and let go of everything. To close it twice does nothing.

        Args:
            reason: Why, for those who are connected; by default that this end is over.
        """

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class TransportParameters(Parameters):
    """What every transport can be told."""

    timeout: float = Field(
        2.0,
        ge=0.05,
        le=3600,
        description="If its machine does not answer for so long, a process counts as dead; 1 s at least [s].",
    )
    hang_timeout: float = Field(
        60.0,
        ge=0.05,
        le=86400,
        description="If it says nothing for so long, though its machine answers, a process counts as dead [s].",
    )
    maximum_frame: int = Field(
        16 * 2**20, ge=2**10, le=2**30, description="A frame of more bytes than this is neither sent nor taken."
    )
    queue: int = Field(
        1024,
        ge=1,
        le=2**20,
        description="So many frames, or as many bytes as four of the longest have, may wait for one peer before it is "
        "cut off.",
    )
    members: int = Field(
        64,
        ge=1,
        le=4096,
        description="So many processes may be connected at once; who is no member yet makes room for who comes.",
    )


class Transport(Plugin, ABC):
    """Carries frames between processes.

    A subclass says how; the frames are opaque to it. Frames of one peer arrive in order, whole, and once, or the peer
    is gone. With a key nobody is a peer who does not prove to know it, and no frame is taken that was not signed
    with it, or was taken before.
    """

    Parameters: ClassVar[type[BaseModel]] = TransportParameters

    @abstractmethod
    def listen(self, host: str, port: int, key: bytes | None = None) -> Port:
        """Open the port of a host.

        Args:
            host: The address to listen at.
            port: Its number; 0 for any that is free.
            key: What everybody must know; None for an open port, for loopback only.

        Raises:
            TransportError: It cannot listen there.
        """

    @abstractmethod
    def join(self, host: str, port: int, key: bytes | None = None) -> Port:
        """Open the port of a member, which connects by itself, and again after a connection is lost.

        The time between two tries doubles from 0.05 s to the transport's `timeout`. That nobody is there yet is no
        error; that the other end does not take the key is told as ``gone`` with that reason, once for each try.

        Raises:
            TransportError: This address can never be reached.
        """
