"""Conversations, without any socket: two ends, and somebody in between."""

import struct

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from symaware_cli.processes.protocol import (
    COUNT,
    FAREWELL,
    FRAME,
    PING,
    PONG,
    PREAMBLE,
    ConnectionEnded,
    PeerProtocol,
)

KEY = b"a key that both know"


class Pair:
    """A host and a member whose clock is ahead, and the time that a record needs."""

    def __init__(self, host_key: bytes | None = None, key: bytes | None = None, ahead: float = 0.0) -> None:
        self.now, self.ahead, self.delay = 100.0, ahead, 0.01
        self.host = PeerProtocol(True, host_key, 2000, 2.0, 60.0, self.now)
        self.member = PeerProtocol(False, key, 2000, 2.0, 60.0, self.now + ahead)

    def clock(self, end: PeerProtocol) -> float:
        return self.now + (self.ahead if end is self.member else 0.0)

    def other(self, end: PeerProtocol) -> PeerProtocol:
        return self.member if end is self.host else self.host

    def carry(self, end: PeerProtocol) -> list[bytes | None]:
        """Bring what an end has to say to the other."""
        records, heard = [end.record(*each) for each in end.outgoing], []
        end.outgoing.clear()
        for record in records:
            self.now += self.delay
            heard.append(self.other(end).hear(record, self.clock(self.other(end))))
        return heard

    def introduce(self, end: PeerProtocol) -> None:
        """Tell an end all that the other says of itself."""
        end.hear(self.other(end).preamble, self.clock(end))
        self.other(end).hear(end.preamble, self.clock(self.other(end)))
        self.carry(self.other(end))

    def meet(self) -> "Pair":
        self.host.hear(self.member.preamble, self.clock(self.host))
        self.member.hear(self.host.preamble, self.clock(self.member))
        while self.host.outgoing or self.member.outgoing:
            self.carry(self.host)
            self.carry(self.member)
        return self


@pytest.mark.parametrize("key", [None, KEY])
def test_two_ends_come_to_know_each_other_and_exchange_frames(key: bytes | None) -> None:
    pair = Pair(key, key).meet()
    for end in (pair.host, pair.member):
        assert end.open
        for frame in (b"", b"frame", bytes(2000)):
            assert pair.other(end).hear(end.record(FRAME, frame), pair.clock(pair.other(end))) == frame


@pytest.mark.parametrize("key", [None, KEY])
@pytest.mark.parametrize("to_host", [True, False])
@pytest.mark.parametrize("kind", [FRAME, PING, PONG, COUNT])
def test_a_record_that_is_lost_ends_the_connection_within_the_timeout(
    kind: int, to_host: bool, key: bytes | None
) -> None:
    pair = Pair(key, key).meet()

    def live(seconds: float) -> None:
        end = pair.now + seconds
        while pair.now < end:
            pair.now += 0.25
            for each in (pair.host, pair.member):
                each.tick(pair.clock(each))
                pair.carry(each)
                pair.carry(pair.other(each))

    live(10.0)
    sender = pair.member if to_host else pair.host
    sender.record(kind, bytes({FRAME: 5, PING: 8, PONG: 24, COUNT: 0}[kind]))  # nobody brings it
    lost = pair.now
    with pytest.raises(ConnectionEnded, match="comes after something that is missing"):
        live(10.0)
    assert pair.now - lost <= 2.0


@pytest.mark.parametrize("key", [None, KEY])
@pytest.mark.parametrize("ahead", [0.0, 3600.0, -5e6])
def test_each_end_learns_how_far_the_other_clock_is_ahead(key: bytes | None, ahead: float) -> None:
    pair = Pair(key, key, ahead).meet()
    # No better than half of the round trip: records here take their time one after another.
    assert pair.host.offset == pytest.approx(ahead, abs=4 * pair.delay)
    assert pair.member.offset == pytest.approx(-ahead, abs=4 * pair.delay)


def test_the_best_of_the_readings_counts() -> None:
    pair = Pair(ahead=50.0).meet()
    for delay in (0.4, 0.0, 0.4):
        pair.delay = delay
        pair.now += 0.6
        pair.host.notice(pair.now)
        pair.host.tick(pair.now)
        pair.carry(pair.host)
        pair.now += delay  # the answer takes longer than the question
        pair.carry(pair.member)
    assert pair.host.offset == pytest.approx(50.0, abs=1e-9)


@pytest.mark.parametrize(
    ("host", "member", "to_host", "to_member"),
    [
        (KEY, None, "the member has no key", "the host wants a key"),
        (None, KEY, "the member wants a key", "the host has no key"),
        (KEY, b"another", "the member does not know the key", "the host does not know this key"),
    ],
)
def test_ends_without_the_same_key_refuse_each_other(
    host: bytes | None, member: bytes | None, to_host: str, to_member: str
) -> None:
    for first, expected in ((True, to_host), (False, to_member)):
        pair = Pair(host, member)
        end = pair.host if first else pair.member
        with pytest.raises(ConnectionEnded, match=expected) as caught:
            pair.introduce(end)
        assert caught.value.rejection == "unauthenticated"
        assert not end.open


def test_two_hosts_or_a_connection_with_itself_are_refused() -> None:
    one, other = (PeerProtocol(False, None, 2000, 2.0, 60.0, 0.0) for _ in range(2))
    for preamble in (one.preamble, other.preamble):
        with pytest.raises(ConnectionEnded, match="same part") as caught:
            one.hear(preamble, 0.0)
        assert caught.value.rejection == "garbage"


def test_another_version_is_refused_by_name() -> None:
    pair = Pair()
    preamble = bytearray(pair.host.preamble)
    preamble[8] = 9
    with pytest.raises(ConnectionEnded, match="the host speaks version 9"):
        pair.member.hear(bytes(preamble), 0.0)


def test_records_sealed_for_an_earlier_connection_are_refused() -> None:
    earlier, pair = Pair(KEY, KEY).meet(), Pair(KEY, KEY).meet()
    with pytest.raises(ConnectionEnded) as caught:
        pair.host.hear(earlier.member.record(FRAME, b"again"), pair.now)
    assert caught.value.rejection == "unauthenticated"


def test_own_records_are_refused() -> None:
    pair = Pair(KEY, KEY).meet()
    with pytest.raises(ConnectionEnded) as caught:
        pair.host.hear(pair.host.record(FRAME, b"mine"), pair.now)
    assert caught.value.rejection == "unauthenticated"


def test_repeated_records_are_refused() -> None:
    pair = Pair(KEY, KEY).meet()
    record = pair.member.record(FRAME, b"once")
    assert pair.host.hear(record, pair.now) == b"once"
    with pytest.raises(ConnectionEnded) as caught:
        pair.host.hear(record, pair.now)
    assert caught.value.rejection == "replayed"


@pytest.mark.parametrize("kind", [FRAME, PING])
def test_nothing_is_heard_before_the_other_end_is_known(kind: int) -> None:
    pair = Pair(KEY, KEY)
    pair.host.hear(pair.member.preamble, pair.now)
    pair.member.hear(pair.host.preamble, pair.now)
    with pytest.raises(ConnectionEnded) as caught:
        pair.host.hear(pair.member.record(kind, bytes(8)), pair.now)
    assert caught.value.rejection == "garbage"


def test_a_long_record_is_refused_and_before_they_know_each_other_a_shorter_one_is() -> None:
    pair = Pair().meet()
    with pytest.raises(ConnectionEnded) as caught:
        pair.host.hear(pair.member.record(FRAME, bytes(2001)), pair.now)
    assert caught.value.rejection == "oversized"
    assert Pair(KEY, KEY).host.limit == PREAMBLE


def test_a_farewell_tells_why_in_plain_text() -> None:
    pair = Pair(KEY, KEY).meet()
    with pytest.raises(ConnectionEnded, match=r"^enough of\?\[31m this$") as caught:
        pair.member.hear(pair.host.record(FAREWELL, b"enough of\x1b[31m this"), pair.now)
    assert caught.value.rejection is None


@pytest.mark.parametrize("clock", [float("nan"), float("inf")])
def test_a_clock_that_shows_no_time_is_refused(clock: float) -> None:
    pair = Pair().meet()
    with pytest.raises(ConnectionEnded) as caught:
        pair.host.hear(pair.member.record(PONG, struct.pack(">ddd", 0.0, clock, clock)), pair.now)
    assert caught.value.rejection == "garbage"


def test_silence_counts_as_death_after_a_long_time_only() -> None:
    pair = Pair().meet()
    pair.host.tick(pair.now + 59.0)
    with pytest.raises(ConnectionEnded, match="no sign of life of the member for 60 s"):
        pair.host.tick(pair.now + 61.0)


@pytest.mark.parametrize(("said", "rejection"), [(b"", None), (b"SYM", "garbage")])
def test_a_handshake_must_be_over_within_the_timeout(said: bytes, rejection: str | None) -> None:
    host = PeerProtocol(True, None, 2000, 2.0, 60.0, 0.0)
    if said:
        host.notice(1.0)
    with pytest.raises(ConnectionEnded, match="did not introduce itself") as caught:
        host.tick(2.1)
    assert caught.value.rejection == rejection


@given(st.lists(st.binary(max_size=80), max_size=6), st.sampled_from(["", "introduced", "open"]), st.booleans())
@example([b"\x03" + bytes(8), b"\x02frame"], "open", False)
@settings(max_examples=300)
def test_any_records_are_taken_or_end_the_conversation(records: list[bytes], stage: str, sealed: bool) -> None:
    pair = Pair(*(KEY, KEY) if sealed else (None, None))
    if stage == "open":
        pair.meet()
    elif stage:
        pair.host.hear(pair.member.preamble, pair.now)
    for record in records:
        try:
            pair.host.hear(record, pair.now)
        except ConnectionEnded as over:
            assert not sealed or stage != "open" or over.rejection == "unauthenticated"  # noqa: PT017
            return
    assert not sealed or stage != "open" or not records
