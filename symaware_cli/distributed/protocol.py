"""Conversations: what the two ends of a connection say to each other, whatever carries their bytes.

Each end begins with a preamble: who speaks, what protocol, whether it has a key, and 16 random bytes. After it come
records, a byte that says of which kind, and what belongs to it. With a key every record is signed, the first of them
is a proof that the key is known, and nothing else is heard before it. Then each end asks the other for its clock; when
it was told, the other has come, and frames may follow.

Nothing here reads a socket or a clock: bytes and times go in, and what is to be sent comes out. So the same
protocol is held over TCP and over Zenoh.
"""

from __future__ import annotations

import math
import os
import struct
from collections import deque

from symaware_cli.distributed.authentication import (
    OVERHEAD,
    AuthenticationError,
    Signer,
    Verifier,
    connection_keys,
)
from symaware_cli.distributed.transport import Rejection

#: The version of this protocol; both ends must speak the same.
VERSION = 1

_MAGIC = b"SYMAWARE"
_PREAMBLE = struct.Struct(">8sBB16s")
_HAS_KEY = 1
_IS_HOST = 2

#: How long a preamble is [bytes].
PREAMBLE = _PREAMBLE.size

#: How long a record may be before the other end has come: long enough for a reason [bytes].
_BEFORE = 1024

#: How many clock readings are asked for at once in the beginning, and of how many the best counts.
_BURST, _KEPT = 8, 16

PROOF, FRAME, PING, PONG, FAREWELL, TAKEN = range(1, 7)
"""The kinds of records.

A ping carries the clock of who asks; a pong that, and the other clock when it came and when it left; a farewell why;
and where nothing else keeps an end from sending more than the other takes, that tells how many records it has taken.
"""

_PING, _PONG, _TAKEN = struct.Struct(">d"), struct.Struct(">ddd"), struct.Struct(">Q")


def may_begin(start: bytes) -> bool:
    """Whether what was heard so far may become a preamble."""
    return start[: len(_MAGIC)] == _MAGIC[: len(start)]


class ConnectionEnded(Exception):  # noqa: N818 - most protocols end well
    """A protocol is over.

    Attributes:
        rejection: What was wrong with what was heard last, if anything was.
    """

    def __init__(self, reason: str, rejection: Rejection | None = None) -> None:
        super().__init__(reason)
        self.rejection = rejection


class PeerProtocol:
    """One end of a protocol.

    Attributes:
        preamble: What to send first, as it is.
        outgoing: What to send next, as arguments of `record`.
        introduced: Whether the preamble of the other end has come.
        open: Whether the other end has come.
        heard: Whether anything was heard.
        offset: How far the other end's clock is ahead of ours [s].
        count: How many records were heard.
        taken: How many of ours the other end has taken, as far as it tells.
    """

    def __init__(
        self, host: bool, key: bytes | None, maximum: int, timeout: float, hang_timeout: float, now: float
    ) -> None:
        """Begin.

        Args:
            host: Whether this end is the host's.
            key: What both ends must know, or None.
            maximum: How long a frame may be [bytes].
            timeout: For how long the other end may take to introduce itself [s]; a quarter of it is between two pings.
            hang_timeout: For how long it may be silent afterwards [s].
            now: What the monotonic clock shows [s].
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
        self.offset = 0.0
        self.count = self.taken = 0
        self._proven = False
        self._signer: Signer | None = None
        self._verifier: Verifier | None = None
        self._readings: deque[tuple[float, float]] = deque(maxlen=_KEPT)

    @property
    def other(self) -> str:
        """What to call the other end."""
        return "the member" if self._is_host else "the host"

    @property
    def signed(self) -> bool:
        """Whether nothing is taken that is not signed."""
        return self._key is not None

    @property
    def limit(self) -> int:
        """How long the next record may be [bytes]."""
        if not self.introduced:
            return PREAMBLE
        return (self._maximum if self.open else _BEFORE) + 1 + (OVERHEAD if self._key is not None else 0)

    def record(self, kind: int, content: bytes) -> bytes:
        """Return a record to be sent; in this order, as each has a number."""
        record = bytes((kind,)) + content
        return record if self._signer is None else self._signer.sign(record)

    def tell_taken(self) -> None:
        """Let the other end know how many of its records were taken."""
        self.outgoing.append((TAKEN, _TAKEN.pack(self.count)))

    def notice(self, now: float) -> None:
        """Take note that something was heard, if only a part of a record."""
        self.heard = True
        self._alive = now

    def tick(self, now: float) -> None:
        """Look at the clock, several times within the timeout.

        That the other process is dead is for those to notice who carry the bytes: a process that is alive may have no
        time to talk, such as one that computes with the interpreter's lock held.

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

    def hear(self, record: bytes, now: float) -> bytes | None:
        """Take what the other end sent: its preamble, then records.

        Returns:
            A frame, if it was one.

        Raises:
            ConnectionEnded: It must not be heard any further.
        """
        self.notice(now)
        if len(record) > self.limit:
            raise ConnectionEnded(f"{self.other} sent {len(record)} bytes at once: more than {self.limit}", "oversized")
        if not self.introduced:
            self._be_introduced(record)
            self._answer_preamble(record, now)
            return None
        content = self._opened(record)
        kind, body = (content[0], content[1:]) if len(content) else (0, content)
        self.count += 1
        if kind == FAREWELL:
            raise ConnectionEnded(_printable(bytes(body)) or f"{self.other} ended the connection")
        if not self._proven:
            if kind != PROOF or len(body):
                raise self._nonsense()
            self._proven = True
            self._ping(now)
        elif kind == FRAME and self.open:
            return bytes(body)
        elif kind == PING and len(body) == _PING.size:
            self.outgoing.append((PONG, _PONG.pack(*_PING.unpack(body), now, now)))
        elif kind == PONG and len(body) == _PONG.size:
            self._read_clock(_PONG.unpack(body), now)
        elif kind == TAKEN and len(body) == _TAKEN.size:
            self.taken = _TAKEN.unpack(body)[0]
        else:
            raise self._nonsense()
        return None

    def _be_introduced(self, preamble: bytes) -> None:
        """Look at the other end's preamble."""
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
        if self._key is None:
            self._proven = True
            self._ping(now)
            return
        ends = (self.preamble, preamble) if self._is_host else (preamble, self.preamble)
        keys = connection_keys(self._key, *ends)
        own, others = keys if self._is_host else keys[::-1]
        self._signer, self._verifier = Signer(own), Verifier(others)
        self.outgoing.append((PROOF, b""))

    def _opened(self, record: bytes) -> memoryview:
        if self._verifier is None:
            return memoryview(record)
        try:
            return self._verifier.open(record)
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

    def _read_clock(self, readings: tuple[float, float, float], now: float) -> None:
        """Learn how far the other end's clock is ahead: what NTP does (RFC 5905, section 8), with its minimum filter.

        The way there and the way back are taken to last as long; the shorter both are, the less that can be wrong.
        """
        asked, came, left = readings
        around, offset = (now - asked) - (left - came), ((came - asked) + (left - now)) / 2
        if not (math.isfinite(around) and math.isfinite(offset)):
            raise self._nonsense()
        self._readings.append((max(around, 0.0), offset))
        self.offset = min(self._readings)[1]
        self.open = True
        if len(self._readings) < _BURST:
            self._ping(now)


def _printable(text: bytes) -> str:
    return "".join(each if each.isprintable() else "?" for each in text.decode(errors="replace"))
