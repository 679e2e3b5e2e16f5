"""The conversation with one peer, over any transport.

Each end first sends a preamble: its role, the version of the protocol, whether it has a key, and 16 random bytes.
Records follow, each a byte for its kind and its content. With a key every record is signed; the first one proves that
the key is known, and must come before all others. Then each end asks for the other's clock; with the first answer the
handshake is complete, and frames may follow.

Nothing here reads a socket or a clock: records and times go in, records to send come out.
"""

from __future__ import annotations

import math
import os
import struct
from collections import deque

from symaware_cli.processes.authentication import (
    OVERHEAD,
    AuthenticationError,
    Signer,
    Verifier,
    connection_keys,
)
from symaware_cli.processes.transport import Rejection

#: The version of this protocol; both ends must speak the same.
VERSION = 1

_MAGIC = b"SYMAWARE"
_PREAMBLE = struct.Struct(">8sBB16s")
_HAS_KEY = 1
_IS_HOST = 2

#: The length of a preamble [bytes].
PREAMBLE = _PREAMBLE.size

#: The longest record before the handshake is complete: long enough for a reason [bytes].
_BEFORE = 1024

#: The number of clock readings at the beginning, and the number of readings of which the best counts.
_BURST, _KEPT = 8, 16

PROOF, FRAME, PING, PONG, FAREWELL, TAKEN, COUNT = range(1, 8)
"""The kinds of records.

A ping carries the sender's clock; a pong that, and the other clock at its arrival and departure; a farewell the reason;
TAKEN, over transports without flow control, how many records this end has received;
COUNT, without a key, how many it has sent before.
"""

_PING, _PONG, _NUMBER = struct.Struct(">d"), struct.Struct(">ddd"), struct.Struct(">Q")


def may_begin(start: bytes) -> bool:
    """Whether the first bytes may be those of a preamble."""
    return start[: len(_MAGIC)] == _MAGIC[: len(start)]


class ConnectionEnded(Exception):  # noqa: N818 - most connections end well
    """The connection must end.

    Attributes:
        rejection: The kind of fault of the last record; None if it has none.
    """

    def __init__(self, reason: str, rejection: Rejection | None = None) -> None:
        super().__init__(reason)
        self.rejection = rejection


class PeerProtocol:
    """One end of the protocol.

    Attributes:
        preamble: The first bytes to send, without a record.
        outgoing: Records to send next, as arguments of `record`.
        introduced: Whether the preamble of the other end has been received.
        open: Whether the handshake is complete.
        heard: Whether anything has been received.
        limit: The length of the longest record that may come next [bytes].
        offset: The time by which the other end's clock is ahead of ours [s].
        count: The number of records received.
        sent: The number of records sent.
        taken: The number of our records that the other end has received, as it last reported.
    """

    def __init__(
        self, host: bool, key: bytes | None, maximum: int, timeout: float, hang_timeout: float, now: float
    ) -> None:
        """Initialise.

        Args:
            host: Whether this end is the host's.
            key: The shared key, or None.
            maximum: The length of the longest frame [bytes].
            timeout: How long the handshake may take [s]; a quarter of it is between two pings.
            hang_timeout: How long the other end may be silent afterwards [s].
            now: The monotonic clock [s].
        """
        self._is_host = host
        self._key = key
        self._maximum = maximum
        self._timeout = timeout
        self._hang_timeout = hang_timeout
        self._began = self._alive = now
        self._pinged = -math.inf
        flags = (_HAS_KEY if key is not None else 0) | (_IS_HOST if host else 0)
        self.preamble = _PREAMBLE.pack(_MAGIC, VERSION, flags, os.urandom(16))
        self.outgoing: list[tuple[int, bytes]] = []
        self.introduced = self.open = self.heard = False
        self._overhead = 1 + (OVERHEAD if key is not None else 0)
        self.limit = PREAMBLE
        self.offset = 0.0
        self.count = self.sent = self.taken = 0
        self._proven = False
        self._signer: Signer | None = None
        self._verifier: Verifier | None = None
        self._readings: deque[tuple[float, float]] = deque(maxlen=_KEPT)

    @property
    def other(self) -> str:
        """The name of the other end in messages."""
        return "the member" if self._is_host else "the host"

    @property
    def signed(self) -> bool:
        """Whether all records must be signed."""
        return self._key is not None

    def record(self, kind: int, content: bytes) -> bytes:
        """Return a record to send. Records are numbered, so they must be sent in the order of these calls."""
        if kind == COUNT:
            content = _NUMBER.pack(self.sent)  # records queued earlier are sent earlier
        self.sent += 1
        record = bytes((kind,)) + content
        return record if self._signer is None else self._signer.sign(record)

    def tell_taken(self) -> None:
        """Report to the other end the number of its records that were received."""
        self.outgoing.append((TAKEN, _NUMBER.pack(self.count)))

    def notice(self, now: float) -> None:
        """Note that bytes were received, if only a part of a record."""
        self.heard = True
        self._alive = now

    def tick(self, now: float) -> None:
        """Check the time limits; called several times within the timeout.

        The transport, not this protocol, detects that the other process is dead: a living process may be silent, such
        as one that computes with the interpreter's lock held.

        Raises:
            ConnectionEnded: The other end was silent for too long.
        """
        if not self.open and now - self._began > self._timeout:
            unfinished = self._is_host and self.heard
            raise ConnectionEnded(
                f"{self.other} did not introduce itself within {self._timeout:g} s", "garbage" if unfinished else None
            )
        if self.open and now - self._alive > self._hang_timeout:
            raise ConnectionEnded(f"no sign of life of {self.other} for {self._hang_timeout:g} s")
        if self.open and now - self._pinged >= self._timeout / 4:
            self._ping(now)

    def hear(self, record: bytes | memoryview, now: float) -> bytes | None:
        """Handle the preamble or a record of the other end.

        Returns:
            The frame, if it was one.

        Raises:
            ConnectionEnded: The connection must end.
        """
        self.heard = True
        self._alive = now
        if len(record) > self.limit:
            raise ConnectionEnded(f"{self.other} sent {len(record)} bytes at once: more than {self.limit}", "oversized")
        if not self.introduced:
            preamble = bytes(record)
            self._be_introduced(preamble)
            self._answer_preamble(preamble, now)
            return None
        content = record if self._verifier is None else self._opened(self._verifier, record)
        kind, body = (content[0], content[1:]) if len(content) else (0, content)
        self.count += 1
        if kind == FRAME and self.open:
            return bytes(body)
        if kind == FAREWELL:
            raise ConnectionEnded(_printable(bytes(body)) or f"{self.other} ended the connection")
        if not self._proven:
            if kind != PROOF or len(body):
                raise self._nonsense()
            self._proven = True
            self._ping(now)
        elif kind == PING and len(body) == _PING.size:
            self.outgoing.append((PONG, _PONG.pack(*_PING.unpack(body), now, now)))
        elif kind == PONG and len(body) == _PONG.size:
            self._read_clock(_PONG.unpack(body), now)
        elif kind == TAKEN and len(body) == _NUMBER.size:
            self.taken = _NUMBER.unpack(body)[0]
        elif kind == COUNT and len(body) == _NUMBER.size:
            self._check_count(_NUMBER.unpack(body)[0])
        else:
            raise self._nonsense()
        return None

    def _be_introduced(self, preamble: bytes) -> None:
        """Check the other end's preamble."""
        if len(preamble) != PREAMBLE or not preamble.startswith(_MAGIC):
            raise ConnectionEnded(f"{self.other} does not speak the protocol of SymAware", "garbage")
        _, version, flags, _ = _PREAMBLE.unpack(preamble)
        if version != VERSION:
            raise ConnectionEnded(
                f"{self.other} speaks version {version} of the protocol, this end {VERSION}", "garbage"
            )
        if bool(flags & _IS_HOST) == self._is_host or flags & ~(_HAS_KEY | _IS_HOST):
            raise ConnectionEnded("the other end has the same part in the run", "garbage")
        if bool(flags & _HAS_KEY) != (self._key is not None):
            lacks = "wants a key" if self._key is None else "has no key"
            raise ConnectionEnded(f"{self.other} {lacks}", "unauthenticated")

    def _answer_preamble(self, preamble: bytes, now: float) -> None:
        self.introduced = True
        self.limit = _BEFORE + self._overhead
        if self._key is None:
            self._proven = True
            self._ping(now)
            return
        ends = (self.preamble, preamble) if self._is_host else (preamble, self.preamble)
        keys = connection_keys(self._key, *ends)
        own, others = keys if self._is_host else keys[::-1]
        self._signer, self._verifier = Signer(own), Verifier(others)
        self.outgoing.append((PROOF, b""))

    def _opened(self, verifier: Verifier, record: bytes | memoryview) -> memoryview:
        try:
            return verifier.open(record)
        except AuthenticationError as error:
            reason = f"{self.other} does not know {'the' if self._is_host else 'this'} key"
            if self._proven:
                reason = f"what {self.other} sent {error}"
            raise ConnectionEnded(reason, error.rejection) from error

    def _nonsense(self) -> ConnectionEnded:
        return ConnectionEnded(f"{self.other} sent something that makes no sense", "garbage")

    def _ping(self, now: float) -> None:
        self._pinged = now
        self.outgoing.append((PING, _PING.pack(now)))
        if self.open and not self.signed:
            self.outgoing.append((COUNT, b""))

    def _check_count(self, sent: int) -> None:
        """Check that everything was received that the other end has sent; with a key, each record has a number."""
        if sent != self.count - 1:
            raise ConnectionEnded(f"what {self.other} sent comes after something that is missing")

    def _read_clock(self, readings: tuple[float, float, float], now: float) -> None:
        """Estimate the offset of the other end's clock as NTP does (RFC 5905, section 8), with its minimum filter.

        Both directions are assumed to take equally long, so the shortest round trip bounds the error best.
        """
        asked, came, left = readings
        around, offset = (now - asked) - (left - came), ((came - asked) + (left - now)) / 2
        if not (math.isfinite(around) and math.isfinite(offset)):
            raise self._nonsense()
        self._readings.append((max(around, 0.0), offset))
        self.offset = min(self._readings)[1]
        self.open = True
        self.limit = self._maximum + self._overhead
        if len(self._readings) < _BURST:
            self._ping(now)


def _printable(text: bytes) -> str:
    return "".join(each if each.isprintable() else "?" for each in text.decode(errors="replace"))
