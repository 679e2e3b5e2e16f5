"""Transports that break a rule are named, with the method and a correction."""

from collections.abc import Mapping
from typing import Any

import pytest
from deviating import deviations

from symaware_cli import Port, PortEvent, Transport
from symaware_cli.processes.memory import Memory
from symaware_cli.processes.tcp import Tcp
from symaware_cli.testing import check_transport


class Wrapped(Port):
    """A port of TCP with a flaw."""

    def __init__(self, port: Port) -> None:
        self.port = port
        self.address = port.address
        self.rejected: Mapping[Any, int] = port.rejected

    def send(self, peer: int, frame: bytes) -> None:
        self.port.send(peer, frame)

    def receive(self, timeout: float | None = None) -> PortEvent | None:
        return self.port.receive(timeout)

    def offset(self, peer: int) -> float:
        return self.port.offset(peer)

    def cut(self, peer: int, reason: str) -> None:
        self.port.cut(peer, reason)

    def close(self, reason: str = "") -> None:
        self.port.close(reason)


class Flawed(Tcp):
    """A transport by TCP whose port can have a flaw."""

    port: type[Wrapped] = Wrapped

    def listen(self, host: str, port: int, key: bytes | None = None) -> Port:
        return self.port(super().listen(host, port, key))

    def join(self, host: str, port: int, key: bytes | None = None) -> Port:
        return self.port(super().join(host, port, key))


class Truncated(Wrapped):
    def send(self, peer: int, frame: bytes) -> None:
        super().send(peer, frame[:40])


class Repeated(Wrapped):
    def send(self, peer: int, frame: bytes) -> None:
        super().send(peer, frame)
        if len(frame) == 1:
            super().send(peer, frame)


class Ahead(Wrapped):
    def offset(self, peer: int) -> float:
        return 5.0


class Reasonless(Wrapped):
    def cut(self, peer: int, reason: str) -> None:
        super().cut(peer, "because")


class Fragile(Wrapped):
    closed = False

    def close(self, reason: str = "") -> None:
        super().close(reason)
        if self.closed:
            raise OSError("it is closed")
        self.closed = True


class Cutting(Flawed):
    """Cuts long frames."""

    port = Truncated


class Doubling(Flawed):
    """Sends a frame twice."""

    port = Repeated


class Advancing(Flawed):
    """Has a clock that is ahead."""

    port = Ahead


class Curt(Flawed):
    """Gives another reason for the end of a connection."""

    port = Reasonless


class Once(Flawed):
    """Can be closed once only."""

    port = Fragile


class Keyless(Flawed):
    """Ignores the key."""

    def listen(self, host: str, port: int, key: bytes | None = None) -> Port:
        return super().listen(host, port)

    def join(self, host: str, port: int, key: bytes | None = None) -> Port:
        return super().join(host, port)


class Listless(Flawed):
    """Returns no port."""

    def listen(self, host: str, port: int, key: bytes | None = None) -> Any:
        return None


BROKEN: dict[type[Transport], tuple[str, ...]] = {
    Cutting: ("Cutting.receive", "gives 40 bytes as frame 1 of the host, which sent 100", "keep frames whole"),
    Doubling: ("Doubling.receive", "of the host", "give each once"),
    Advancing: ("Advancing.offset", "more than 1 s within one process"),
    Curt: ("Curt.cut", "gives the reason", "because"),
    Once: ("Once.close (test_transport_check.py, line", "raises OSError: it is closed"),
    Keyless: ("Keyless.join (", "lets a member with another key connect"),
    Listless: ("Listless.listen (", "returns a NoneType", "return a `Port`"),
    Memory: ("Memory.listen (", "stays within one process"),
}


@pytest.mark.parametrize("kind", BROKEN, ids=lambda kind: kind.__name__)
def test_a_broken_transport_is_named_with_the_method_and_a_correction(kind: type[Transport]) -> None:
    said = deviations(check_transport, kind)
    for words in BROKEN[kind]:
        assert words in said


def test_a_transport_that_carries_frames_whole_conforms() -> None:
    check_transport(Flawed)
