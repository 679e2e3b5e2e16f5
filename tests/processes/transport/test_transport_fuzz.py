"""Thousands of malformed frames at a host while a member talks to it: all are counted, and nothing else happens."""

import os
import random
import socket
import struct
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import pytest
from leftovers import descriptors, resident
from transporting import KEY, echo, eventually, expect, number

from symaware_cli.processes.protocol import FRAME, PREAMBLE, PROOF, PeerProtocol
from symaware_cli.processes.tcp import Tcp
from symaware_cli.processes.transport import Port, Transport
from symaware_cli.processes.zenoh import Zenoh

#: What a stranger says, record by record; the first one is the preamble.
Attack = Callable[[random.Random, bytes | None], list[bytes]]


def _preamble(key: bytes | None) -> bytes:
    return PeerProtocol(False, key, 2**20, 2.0, 60.0, 0.0).preamble


def _noise(dice: random.Random, key: bytes | None) -> list[bytes]:
    return [dice.randbytes(dice.randint(1, 200))]


def _web(dice: random.Random, key: bytes | None) -> list[bytes]:
    return [b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"]


def _beginning(dice: random.Random, key: bytes | None) -> list[bytes]:
    return [_preamble(key)[: dice.randint(1, PREAMBLE - 1)]]


def _future(dice: random.Random, key: bytes | None) -> list[bytes]:
    return [_preamble(key)[:8] + bytes([dice.randint(2, 255)]) + _preamble(key)[9:]]


def _mirror(dice: random.Random, key: bytes | None) -> list[bytes]:
    return [PeerProtocol(True, key, 2**20, 2.0, 60.0, 0.0).preamble]


def _wrong_key(dice: random.Random, key: bytes | None) -> list[bytes]:
    return [_preamble(None if key else b"a key")]


def _damaged(dice: random.Random, key: bytes | None) -> list[bytes]:
    preamble = bytearray(_preamble(key))
    preamble[dice.randrange(8)] ^= 1 << dice.randrange(8)
    return [bytes(preamble)]


def _forged(dice: random.Random, key: bytes | None) -> list[bytes]:
    return [_preamble(key), dice.choice([PROOF, FRAME, 9]).to_bytes() + dice.randbytes(dice.randint(1, 300))]


def _oversized(dice: random.Random, key: bytes | None) -> list[bytes]:
    return [_preamble(key), dice.randbytes(2000)]


ATTACKS: tuple[Attack, ...] = (
    _noise,
    _web,
    _beginning,
    _future,
    _mirror,
    _wrong_key,
    _damaged,
    _forged,
    _oversized,
)


@pytest.fixture
def processes() -> Iterator[list[subprocess.Popen[str]]]:
    started: list[subprocess.Popen[str]] = []
    yield started
    for process in started:
        process.kill()
        process.communicate()


def _over_tcp(records: list[bytes], port: Port, dice: random.Random) -> None:
    """Say something over a connection of its own, until the host closes it."""
    data = records[0] + b"".join(len(record).to_bytes(4) + record for record in records[1:])
    with socket.create_connection(("127.0.0.1", number(port))) as connection:
        # The host may have closed it before all is said.
        with suppress(ConnectionError):
            connection.sendall(data)
            connection.shutdown(socket.SHUT_WR)
        with suppress(ConnectionError):
            while connection.recv(4096):
                pass


def _besiege(
    transport: Transport,
    key: bytes | None,
    count: int,
    processes: list[subprocess.Popen[str]],
    attack: Callable[[list[bytes], Port, random.Random], None],
) -> Port:
    """Attack a host, while it talks with a member; returns its port, closed."""
    dice = random.Random(1)
    with transport.listen("127.0.0.1", 0, key) as port:
        processes.append(echo(transport, port, key))
        peer = expect(port, "came").peer
        sent = received = 0
        before = None
        for turn in range(count):
            if turn == count // 5:
                # Allocators keep some of what they had once.
                before = resident(), descriptors()
            attack(ATTACKS[turn % len(ATTACKS)](dice, key), port, dice)
            # In bursts: for a moment after the run's thread was there, the port's own thread leaves everything to it.
            if turn % 25:
                continue
            for _ in range(5):
                port.send(peer, struct.pack(">I", sent) + bytes(500))
                sent += 1
            # No more than a hundred on their way, or it is the attacks that outrun the processor.
            while (happening := port.receive(20.0 if sent - received > 100 else 0)) is not None:
                assert (happening.kind, happening.peer) == ("frame", peer), happening
                assert struct.unpack(">I", happening.frame[:4]) == (received,)
                received += 1
        while received < sent:
            assert struct.unpack(">I", expect(port, "frame").frame[:4]) == (received,)
            received += 1
        assert eventually(lambda: sum(port.rejected.values()) >= count), dict(port.rejected)
        assert sum(port.rejected.values()) == count
        assert before is not None
        assert eventually(lambda: descriptors() <= before[1] + 2)
        assert resident() - before[0] < 20e6
        return port


#: How many malformed connections or samples are tried.
COUNTS = [300, pytest.param(int(os.environ.get("SYMAWARE_MALFORMED", "1000")), marks=pytest.mark.slow)]


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("key", [None, KEY])
def test_malformed_connections_are_counted_and_a_member_hears_nothing_of_them(
    key: bytes | None, count: int, processes: list[subprocess.Popen[str]]
) -> None:
    port = _besiege(Tcp(Tcp.Parameters(timeout=60.0)), key, count, processes, _over_tcp)
    expected = {"garbage", "oversized", "unauthenticated"}
    assert {rejection for rejection, times in port.rejected.items() if times} == expected


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("key", [None, KEY])
def test_malformed_samples_are_counted_and_a_member_hears_nothing_of_them(
    key: bytes | None, count: int, processes: list[subprocess.Popen[str]]
) -> None:
    zenoh = pytest.importorskip("zenoh")
    numbers: list[str] = []
    session: Any = None

    def attack(records: list[bytes], port: Port, dice: random.Random) -> None:
        nonlocal session
        if session is None:
            session = _session(zenoh, port)
            seen = session.declare_subscriber(
                "symaware/1/member/*", lambda sample: numbers.append(str(sample.key_expr))
            )
            numbers.clear()
            del seen
        name = dice.randbytes(8).hex()
        if key and len(records) > 1 and numbers and dice.random() < 0.5:
            # What the member itself may have sent, as its number is no secret; it is not sealed.
            name, records = numbers[0].rpartition("/")[2], records[1:]
        for record in records:
            session.put(f"symaware/1/host/{name}", record, congestion_control=zenoh.CongestionControl.BLOCK)

    try:
        _besiege(Zenoh(Zenoh.Parameters(timeout=60.0, members=512)), key, count, processes, attack)
    finally:
        if session is not None:
            session.close()


def _session(zenoh: Any, port: Port) -> Any:
    configuration = zenoh.Config()
    configuration.insert_json5("mode", '"client"')
    configuration.insert_json5("scouting/multicast/enabled", "false")
    configuration.insert_json5("connect/endpoints", f'["tcp/{port.address}"]')
    session = zenoh.open(configuration)
    time.sleep(0.5)
    return session


@pytest.mark.parametrize("key", [None, KEY])
def test_a_silent_connection_is_closed_after_the_timeout(key: bytes | None) -> None:
    transport = Tcp(Tcp.Parameters(timeout=0.3))
    with transport.listen("127.0.0.1", 0, key) as port:
        silent = [socket.create_connection(("127.0.0.1", number(port))) for _ in range(20)]
        hesitant = [socket.create_connection(("127.0.0.1", number(port))) for _ in range(20)]
        for connection in hesitant:
            connection.sendall(b"SYMA")
        for connection in (*silent, *hesitant):
            connection.settimeout(20)
            with suppress(ConnectionError):
                while connection.recv(100):
                    pass
            connection.close()
        assert eventually(lambda: port.rejected["garbage"] == 20)
        assert port.receive(0) is None


def test_a_crowd_that_says_nothing_does_not_keep_a_member_out() -> None:
    transport = Tcp(Tcp.Parameters(timeout=60.0, members=8))
    with transport.listen("127.0.0.1", 0) as port:
        crowd = [socket.create_connection(("127.0.0.1", number(port))) for _ in range(100)]
        with transport.join("127.0.0.1", number(port)) as member:
            expect(member, "came")
            expect(port, "came")
        assert port.rejected["crowded"] >= 100 - 8
        for connection in crowd:
            connection.close()


class Member:
    """A member that says what it is told to, over a plain socket."""

    def __init__(self, port: Port, key: bytes | None) -> None:
        self._socket = socket.create_connection(("127.0.0.1", number(port)))
        self._stream = self._socket.makefile("rb")
        self._protocol = PeerProtocol(False, key, 2**20, 2.0, 60.0, time.monotonic())
        self.say(self._protocol.preamble)
        self._protocol.hear(self._stream.read(PREAMBLE), time.monotonic())
        while True:
            for each in self._protocol.outgoing:
                self.say(self.record(*each))
            self._protocol.outgoing.clear()
            if self._protocol.open:
                break
            length = int.from_bytes(self._stream.read(4))
            self._protocol.hear(self._stream.read(length), time.monotonic())
        self.peer = expect(port, "came").peer

    def record(self, kind: int, content: bytes) -> bytes:
        record = self._protocol.record(kind, content)
        return len(record).to_bytes(4) + record

    def say(self, data: bytes) -> None:
        self._socket.sendall(data)

    def close(self) -> None:
        self._stream.close()
        self._socket.close()


@pytest.fixture(params=[None, KEY], ids=["open", "sealed"])
def guest(request: pytest.FixtureRequest) -> Iterator[tuple[Port, Member]]:
    with Tcp(Tcp.Parameters(timeout=60.0, maximum_frame=2000)).listen("127.0.0.1", 0, request.param) as port:
        member = Member(port, request.param)
        yield port, member
        member.close()


def test_records_may_arrive_in_any_pieces(guest: tuple[Port, Member]) -> None:
    port, member = guest
    dice = random.Random(2)
    frames = [dice.randbytes(dice.choice([0, 1, 5, 300, 2000])) for _ in range(60)]
    data = b"".join(member.record(FRAME, frame) for frame in frames)
    while data:
        size = dice.choice([1, 2, 3, 50, 3000])
        member.say(data[:size])
        data = data[size:]
    assert [expect(port, "frame").frame for _ in frames] == frames


@pytest.mark.parametrize(
    ("said", "rejection"),
    [
        (b"\xff\xff\xff\xff", "oversized"),
        ((2000 + 1 + 41).to_bytes(4), "oversized"),
        (bytes(4), None),
        ((100).to_bytes(4) + bytes(100), None),
    ],
)
def test_a_malformed_record_ends_the_connection(
    guest: tuple[Port, Member], said: bytes, rejection: str | None, request: pytest.FixtureRequest
) -> None:
    port, member = guest
    member.say(member.record(FRAME, b"well") + said)
    assert expect(port, "frame").frame == b"well"
    assert expect(port, "gone").peer == member.peer
    sealed = "sealed" in request.node.name
    assert port.rejected[rejection or ("unauthenticated" if sealed else "garbage")] == 1  # type: ignore[index]
    assert sum(port.rejected.values()) == 1


def test_a_record_that_was_taken_before_ends_the_connection() -> None:
    with Tcp().listen("127.0.0.1", 0, KEY) as port:
        member = Member(port, KEY)
        member.say(2 * member.record(FRAME, b"once"))
        assert expect(port, "frame").frame == b"once"
        assert expect(port, "gone").peer == member.peer
        assert port.rejected["replayed"] == 1
        member.close()


def test_half_a_frame_and_then_nothing_takes_no_more_memory_than_came() -> None:
    with Tcp(Tcp.Parameters(timeout=60.0, maximum_frame=2**30)).listen("127.0.0.1", 0) as port:
        before = resident()
        members = [Member(port, None) for _ in range(20)]
        for member in members:
            member.say((2**30).to_bytes(4) + bytes(1000))
        assert port.receive(0.1) is None
        assert resident() - before < 20e6
        for member in members:
            member.close()
