"""Seals: nothing is taken that was not sealed with the key, for this connection and direction, or was taken before."""

import hashlib
import hmac
import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli.processes.authentication import (
    OVERHEAD,
    AuthenticationError,
    ReplayWindow,
    Signer,
    Verifier,
    connection_keys,
)


@given(st.lists(st.binary(max_size=100), max_size=5))
def test_sealed_records_are_opened_in_order(contents: list[bytes]) -> None:
    signer, verifier = Signer(b"k"), Verifier(b"k")
    for content in contents:
        record = signer.sign(content)
        assert len(record) == len(content) + OVERHEAD
        assert verifier.open(record) == content


@given(st.binary(max_size=60), st.data())
def test_a_record_with_any_bit_changed_is_not_authentic(content: bytes, data: st.DataObject) -> None:
    record = bytearray(Signer(b"k").sign(content))
    record[data.draw(st.integers(0, len(record) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    assert _rejection(Verifier(b"k"), bytes(record)) == "unauthenticated"


@given(st.binary(max_size=100))
def test_random_bytes_are_not_authentic(record: bytes) -> None:
    assert _rejection(Verifier(b"k"), record) == "unauthenticated"


def test_a_record_is_taken_once() -> None:
    signer, verifier = Signer(b"k"), Verifier(b"k")
    first, second = signer.sign(b"a"), signer.sign(b"b")
    verifier.open(first)
    verifier.open(second)
    assert _rejection(verifier, first) == "replayed"
    assert _rejection(verifier, second) == "replayed"


def test_after_a_record_is_lost_no_other_is_taken() -> None:
    signer, verifier = Signer(b"k"), Verifier(b"k")
    signer.sign(b"lost")
    assert _rejection(verifier, signer.sign(b"next")) is None


def test_keys_differ_by_shared_key_connection_and_direction() -> None:
    ends = [bytes([number]) * 26 for number in range(3)]
    keys = [
        *connection_keys(b"a", ends[0], ends[1]),
        *connection_keys(b"b", ends[0], ends[1]),
        *connection_keys(b"a", ends[1], ends[0]),
        *connection_keys(b"a", ends[0], ends[2]),
    ]
    assert len(set(keys)) == len(keys)


def test_the_keys_are_those_of_rfc_5869() -> None:
    # Test case 1 of its appendix A, as far as the first block, by which the derivation in the test is checked...
    key = bytes.fromhex("0b" * 22)
    salt, information = bytes.fromhex("000102030405060708090a0b0c"), bytes.fromhex("f0f1f2f3f4f5f6f7f8f9")
    expected = "3cb25f25faacd57a90434f64d0362f2a2d2d0a90cf1a5a4c5db02d56ecc4c5bf"
    assert _hkdf(salt, key, information).hex() == expected
    # ... by which that of the package is.
    host, member = os.urandom(26), os.urandom(26)
    salt = hashlib.sha256(host + member).digest()
    assert connection_keys(key, host, member) == (_hkdf(salt, key, b"host"), _hkdf(salt, key, b"member"))


def _hkdf(salt: bytes, key: bytes, information: bytes) -> bytes:
    secret = hmac.digest(salt, key, "sha256")
    return hmac.digest(secret, information + b"\x01", "sha256")


def test_the_seal_is_hmac_sha256_over_counter_and_content() -> None:
    # Test case 2 of RFC 4231 checks that it is HMAC-SHA256 that the test computes.
    message = b"what do ya want for nothing?"
    expected = "5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843"
    assert hmac.new(b"Jefe", message, "sha256").hexdigest() == expected
    signer = Signer(b"Jefe")
    signer.sign(b"")
    counted = (1).to_bytes(8) + message
    assert signer.sign(message) == counted + hmac.digest(b"Jefe", counted, "sha256")


@given(st.lists(st.integers(0, 200), max_size=60))
def test_the_window_takes_each_number_once_and_none_that_is_too_old(counters: list[int]) -> None:
    window, seen, highest = ReplayWindow(), set(), -1
    for counter in counters:
        expected = counter > highest or (highest - counter < ReplayWindow.WIDTH and counter not in seen)
        assert window.take(counter) == expected
        seen.add(counter)
        highest = max(highest, counter)


def _rejection(verifier: Verifier, record: bytes) -> str | None:
    with pytest.raises(AuthenticationError) as caught:
        verifier.open(record)
    return caught.value.rejection
