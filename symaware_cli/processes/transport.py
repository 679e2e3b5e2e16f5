"""The interface of transports, which carry whole frames between the processes of one run."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import TracebackType
from typing import ClassVar, Literal, NamedTuple, Self

from pydantic import BaseModel, Field

from symaware_cli.world import Parameters, Plugin, UserError

#: Why a frame or a connection was rejected.
Rejection = Literal["garbage", "oversized", "unauthenticated", "replayed", "crowded"]


class TransportError(UserError):
    """A port cannot be opened; states the address and the reason."""


class PortEvent(NamedTuple):
    """An event at a port.

    Each peer that came is gone once, and its frames come in between. A peer that is gone without having come was
    refused, or refused this end, for the stated reason.

    Attributes:
        kind: A peer came, sent a frame, or is gone, so that nothing more comes from it.
        peer: The number of the peer; never used again, not even for the same process when it reconnects.
        frame: The frame.
        reason: Why the peer is gone.
    """

    kind: Literal["came", "frame", "gone"]
    peer: int
    frame: bytes = b""
    reason: str = ""


class Port(ABC):
    """One end of a transport: the host's, whose peers are the members, or a member's, whose one peer is the host.

    The operating systems decide whether a process is dead: a peer is gone when its end of the connection is closed,
    which happens however the process ends, or when its machine does not answer for the transport's `timeout`. A
    process that computes for long, even with the interpreter's lock held, is not dead; one that sends nothing for
    `hang_timeout`, although its threads should, counts as dead, too.

    Only the run's thread may call these methods. Used in a ``with`` statement, the port is closed at the end.

    Attributes:
        address: Its address, as ``HOST:PORT``.
        rejected: The number of rejected frames and connections, by reason.
    """

    address: str
    rejected: Mapping[Rejection, int]

    @abstractmethod
    def send(self, peer: int, frame: bytes) -> None:
        """Send a frame without waiting; does nothing if the peer is gone.

        A peer for which too many frames wait is cut off: it is gone, and may reconnect.

        Raises:
            ValueError: The frame is longer than `maximum_frame`.
        """

    @abstractmethod
    def receive(self, timeout: float | None = None) -> PortEvent | None:
        """Return the next event; None if there was none within a time [s], which is unlimited by default."""

    def accept(self, peer: int) -> None:
        """Mark a peer as a member: if there are too many peers, others have to make room."""
        return

    @abstractmethod
    def offset(self, peer: int) -> float:
        """The estimated offset of a peer's monotonic clock from ours [s], positive if ahead; 0 if the peer is gone."""

    @abstractmethod
    def cut(self, peer: int, reason: str) -> None:
        """End the connection to a peer after sending what waits for it; a member's port does not reconnect.

        The peer is gone here, and this end is gone there, for this reason.
        """

    @abstractmethod
    def close(self, reason: str = "") -> None:
        """Send what waits, for at most a second, and close all connections. Closing twice does nothing.

        Args:
            reason: The reason for the peers; by default that this end ended the connection.
        """

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class TransportParameters(Parameters):
    """The parameters of every transport."""

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

    Frames are opaque to a transport. Frames of one peer arrive whole, in order and once, or the peer is gone. With a
    key, a peer must prove that it knows the key, and frames that are not signed with it, or are repeated, are rejected.
    """

    Parameters: ClassVar[type[BaseModel]] = TransportParameters

    @abstractmethod
    def listen(self, host: str, port: int, key: bytes | None = None) -> Port:
        """Open the port of a host.

        Args:
            host: The address to listen at.
            port: The port number; 0 for any free one.
            key: The shared key; None for no authentication, for loopback only.

        Raises:
            TransportError: It cannot listen there.
        """

    @abstractmethod
    def join(self, host: str, port: int, key: bytes | None = None) -> Port:
        """Open the port of a member, which connects by itself, and reconnects after a connection is lost.

        The pause between two attempts doubles from 0.05 s to the transport's `timeout`. A host that is not there yet
        is no error; if the host refuses the key, each attempt ends with the event ``gone`` and that reason.

        Raises:
            TransportError: This address can never be reached.
        """
