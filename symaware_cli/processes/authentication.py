"""Signatures of records with a shared key: they prove the sender, the connection, and that nothing is repeated.

A signature authenticates a record; it does not encrypt it.
"""

from __future__ import annotations

import hashlib
import hmac
import struct

from symaware_cli.processes.transport import Rejection

#: The bytes that a signature adds: a counter and an HMAC-SHA256 (RFC 2104).
OVERHEAD = 8 + 32

_COUNTER = struct.Struct(">Q")


class AuthenticationError(Exception):
    """A record has no valid signature, was sent before, or follows a lost record.

    Attributes:
        rejection: The kind of fault; None if the record is valid, but one before it was lost.
    """

    def __init__(self, rejection: Rejection | None, text: str) -> None:
        super().__init__(text)
        self.rejection = rejection


def connection_keys(key: bytes, host: bytes, member: bytes) -> tuple[bytes, bytes]:
    """Derive the keys of one connection: HKDF with SHA-256 (RFC 5869).

    Both preambles contain random bytes, so a record signed for one connection, or one direction of it, is invalid in
    any other.

    Args:
        key: The shared key.
        host: The preamble of the host.
        member: The preamble of the member.

    Returns:
        The key with which the host signs, and that with which the member signs.
    """
    salt = hashlib.sha256(host + member).digest()
    secret = hmac.digest(salt, key, "sha256")
    return hmac.digest(secret, b"host\x01", "sha256"), hmac.digest(secret, b"member\x01", "sha256")


class Signer:
    """Signs the records that one end sends, and numbers them."""

    __slots__ = ("_count", "_state")

    def __init__(self, key: bytes) -> None:
        self._state = hmac.new(key, digestmod="sha256")
        self._count = 0

    def sign(self, content: bytes) -> bytes:
        """Return the content preceded by its counter and followed by its HMAC."""
        counter = _COUNTER.pack(self._count)
        self._count += 1
        state = self._state.copy()
        state.update(counter)
        state.update(content)
        return b"".join((counter, content, state.digest()))


class Verifier:
    """Verifies the records that the other end signed."""

    __slots__ = ("_expected", "_state", "_window")

    def __init__(self, key: bytes) -> None:
        self._state = hmac.new(key, digestmod="sha256")
        self._window = ReplayWindow()
        self._expected = 0

    def open(self, record: bytes | memoryview) -> memoryview:
        """Return the content of a signed record.

        Raises:
            AuthenticationError: It was not signed with this key, was received before, or a record before it was lost.
        """
        if len(record) < OVERHEAD:
            raise AuthenticationError("unauthenticated", "is too short to be signed")
        view = memoryview(record)
        state = self._state.copy()
        state.update(view[:-32])
        if not hmac.compare_digest(state.digest(), view[-32:]):
            raise AuthenticationError("unauthenticated", "has a wrong signature")
        (counter,) = _COUNTER.unpack(view[:8])
        if not self._window.take(counter):
            raise AuthenticationError("replayed", "was sent before")
        # Transports keep the order; if this record is not the next one, another was removed or moved.
        if counter != self._expected:
            raise AuthenticationError(None, "comes after something that is missing")
        self._expected += 1
        return view[8:-32]


class ReplayWindow:
    """Distinguishes new counters from those that were seen, among the last 64; older ones are never new.

    The bitmap of RFC 4303, section 3.4.3; RFC 6479 shows others.
    """

    __slots__ = ("_highest", "_seen")

    WIDTH = 64

    def __init__(self) -> None:
        self._highest = -1
        self._seen = 0  # bit i stands for the counter i below the highest

    def take(self, counter: int) -> bool:
        """Mark a counter as seen; return whether it was new."""
        if counter > self._highest:
            advance = min(counter - self._highest, self.WIDTH)
            self._seen = (self._seen << advance | 1) & (1 << self.WIDTH) - 1
            self._highest = counter
            return True
        back = self._highest - counter
        if back >= self.WIDTH or self._seen >> back & 1:
            return False
        self._seen |= 1 << back
        return True
