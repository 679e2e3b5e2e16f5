"""Checks of transports: two ends within this process that exchange frames, refuse keys and close."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from symaware_cli.processes import Port, PortEvent, Transport
from symaware_cli.testing.conformance import DeviationList, require_kind, with_parameters
from symaware_cli.world import PluginKind

_KIND = PluginKind("transport", "symaware.transports", (Transport,))

#: Longest wait for an event [s].
_PATIENCE = 10.0


def check_transport(kind: type[Transport], /, **parameters: Any) -> None:
    """Check a transport with a host and members within this process, on the loopback interface.

    Frames must arrive whole, in order and once, in both directions. A frame that is longer than `maximum_frame` must be
    refused, and so must a member with another key. Each end must get one event when the other is gone, and closing
    twice must do nothing. Members in processes of their own, and processes that end suddenly, are not tested.

    Args:
        kind: The class.
        parameters: The parameters of the transport.

    Raises:
        ConformanceError: A line for each deviation.
    """
    found = require_kind(kind, _KIND)
    transport: Any = with_parameters(found, {"timeout": 1.0, "maximum_frame": 2**16, **parameters})
    with _host(found, transport, None) as host, _member(found, transport, host, None) as member:
        _check_frames(found, transport, host, member)
    found.settle()
    with _host(found, transport, b"one key") as host, _member(found, transport, host, b"another key") as member:
        event = member.receive(_PATIENCE)
        if event is None or event.kind != "gone":
            found.add("join", "lets a member with another key connect", "let both ends prove that they know the key")
        elif not event.reason:
            found.add("receive", "says that a peer is gone without a reason", "give the reason in the event")
    found.settle()


@contextmanager
def _host(found: DeviationList, transport: Transport, key: bytes | None) -> Iterator[Port]:
    with found.calling("listen"):
        port = transport.listen("127.0.0.1", 0, key)
        _check_port(found, port)
    found.settle()
    try:
        yield port
    finally:
        with suppress(Exception):  # `_check_frames` reports it
            port.close()


@contextmanager
def _member(found: DeviationList, transport: Transport, host: Port, key: bytes | None) -> Iterator[Port]:
    with found.calling("join"):
        port = transport.join("127.0.0.1", int(host.address.rpartition(":")[2]), key)
    found.settle()
    try:
        yield port
    finally:
        with suppress(Exception):  # `_check_frames` reports it
            port.close()


def _check_port(found: DeviationList, port: Port) -> None:
    if not isinstance(port, Port):
        found.add("listen", f"returns a {type(port).__name__}", "return a `Port`")
    elif not port.address.rpartition(":")[2].isdigit() or port.address.endswith(":0"):
        found.add("listen", f"has the address {port.address!r}", "give HOST:PORT with the port that it listens at")
    elif any(port.rejected.get(reason) != 0 for reason in ("garbage", "oversized", "unauthenticated", "replayed")):
        found.add("listen", f"begins with `rejected` = {dict(port.rejected)}", "count each reason from 0")


def _check_frames(found: DeviationList, transport: Transport, host: Port, member: Port) -> None:
    ends = {"host": (host, _next(found, host, "came")), "member": (member, _next(found, member, "came"))}
    if found:
        return
    longest = transport.parameters.maximum_frame
    frames = [b"", b"\x00\xff" * 50, *(bytes([number]) * (number + 1) for number in range(20)), b"x" * longest]
    for name, (sender, peer) in ends.items():
        receiver, _ = ends["member" if name == "host" else "host"]
        with found.calling("send"):
            for frame in frames:
                sender.send(peer.peer, frame)
        for number, frame in enumerate(frames):
            event = _next(found, receiver, "frame")
            if not found and event.frame != frame:
                what = f"gives {len(event.frame)} bytes as frame {number} of the {name}, which sent {len(frame)}"
                found.add("receive", what, "keep frames whole, in order, and give each once")
            if found:
                return
        try:
            sender.send(peer.peer, b"x" * (longest + 1))
            found.add("send", "takes a frame that is longer than `maximum_frame`", "raise ValueError")
        except ValueError:
            pass
        if receiver.receive(0.05) is not None:
            found.add("receive", "gives an event that nothing caused", "give each frame once")
    with found.calling("offset"):
        if abs(host.offset(ends["host"][1].peer)) > 1.0:
            found.add("offset", "is more than 1 s within one process", "estimate the difference of monotonic clocks")
    with found.calling("cut"):
        host.cut(ends["host"][1].peer, "the check is over")
    for port in (host, member):
        gone = _next(found, port, "gone")
        if not found and "the check is over" not in gone.reason:
            found.add("cut", f"gives the reason {gone.reason!r}", "give both ends the reason of `cut`")
    with found.calling("close"):
        for port in (member, member, host, host):
            port.close()


def _next(found: DeviationList, port: Port, kind: str) -> PortEvent:
    """Return the next event of a port, which must be of a kind."""
    event = None
    with found.calling("receive"):
        event = port.receive(_PATIENCE)
    if event is None or event.kind != kind:
        what = "nothing within 10 s" if event is None else f"`{event.kind}` ({event.reason})"
        found.add("receive", f"gives {what}, where `{kind}` is due", "give `came`, then frames, then `gone`")
        found.settle()
    assert event is not None
    return event
