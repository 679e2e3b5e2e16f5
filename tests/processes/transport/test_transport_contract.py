"""What every transport between processes keeps, on real sockets and with real processes."""

import ctypes
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from leftovers import descriptors, tasks, threads
from ports import free_port
from simulating import untyped
from transporting import COUNT, ECHO, KEY, echo, eventually, expect, number

from symaware_cli.processes.memory import Memory
from symaware_cli.processes.protocol import PING, PONG, PeerProtocol
from symaware_cli.processes.tcp import Tcp
from symaware_cli.processes.transport import Port, PortEvent, Transport, TransportError
from symaware_cli.processes.zenoh import Zenoh

Open = Callable[..., Port]


@pytest.fixture(params=[Tcp, Zenoh])
def kind(request: pytest.FixtureRequest) -> type[Transport]:
    if request.param is Zenoh:
        pytest.importorskip("zenoh")
    result: type[Transport] = request.param
    return result


@pytest.fixture
def make(kind: type[Transport]) -> Callable[..., Transport]:
    return lambda **parameters: kind(kind.Parameters(**parameters))


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack
    assert eventually(lambda: not threads())


@pytest.fixture
def processes() -> Iterator[list[subprocess.Popen[str]]]:
    started: list[subprocess.Popen[str]] = []
    yield started
    for process in started:
        process.kill()
        process.communicate()


def meet(
    transport: Transport, stack: ExitStack, key: bytes | None = None, host: str = "127.0.0.1"
) -> tuple[Port, Port, int, int]:
    """A host and a member that have met, and the number by which each knows the other."""
    port = stack.enter_context(transport.listen(host, 0, key))
    member = stack.enter_context(transport.join(host, number(port), key))
    return port, member, expect(port, "came").peer, expect(member, "came").peer


@pytest.mark.parametrize("key", [None, KEY])
@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_frames_arrive_whole_and_in_order_both_ways(
    make: Callable[..., Transport], stack: ExitStack, key: bytes | None, host: str
) -> None:
    port, member, guest, home = meet(make(), stack, key, host)
    sizes = [0, 1, 1000, 2**16, 2**20, 3, 2**24, 7]
    frames = [bytes([number % 256]) * size for number, size in enumerate(sizes)]
    for frame in frames:
        port.send(guest, frame)
        member.send(home, frame)
    assert [expect(port, "frame").frame == frame for frame in frames] == [True] * len(sizes)
    assert [expect(member, "frame").frame == frame for frame in frames] == [True] * len(sizes)
    assert not any(port.rejected.values())
    assert not any(member.rejected.values())


def test_many_members_are_distinguished(make: Callable[..., Transport], stack: ExitStack) -> None:
    transport = make()
    port = stack.enter_context(transport.listen("127.0.0.1", 0))
    members = [stack.enter_context(transport.join("127.0.0.1", number(port))) for _ in range(5)]
    homes = [expect(member, "came").peer for member in members]
    guests = [expect(port, "came").peer for _ in members]
    assert len(set(guests)) == len(members)
    for place, (member, home) in enumerate(zip(members, homes, strict=True)):
        member.send(home, bytes([place]))
    told = {expect(port, "frame")[1:3] for _ in members}
    assert {peer for peer, _ in told} == set(guests)
    for peer, frame in told:
        port.send(peer, frame * 2)
    assert [expect(member, "frame").frame for member in members] == [bytes([place] * 2) for place in range(5)]


def test_a_member_may_come_before_its_host(make: Callable[..., Transport], stack: ExitStack) -> None:
    transport = make()
    free = free_port()
    member = stack.enter_context(transport.join("127.0.0.1", free))
    assert member.receive(0.2) is None
    stack.enter_context(transport.listen("127.0.0.1", free))
    expect(member, "came")


def test_a_member_comes_again_under_another_number(make: Callable[..., Transport], stack: ExitStack) -> None:
    transport = make()
    first = transport.listen("127.0.0.1", 0)
    stack.callback(first.close)
    member = stack.enter_context(transport.join("127.0.0.1", number(first)))
    before = expect(member, "came").peer
    first.close()
    assert expect(member, "gone").reason == "the host ended the connection"
    port = stack.enter_context(transport.listen("127.0.0.1", number(first)))
    after = expect(member, "came").peer
    assert after != before
    guest = expect(port, "came").peer
    member.send(before, b"to nobody")
    member.send(after, b"to the host")
    assert expect(port, "frame")[1:3] == (guest, b"to the host")


def test_a_disconnected_peer_receives_the_reason_after_all_sent_records(
    make: Callable[..., Transport], stack: ExitStack
) -> None:
    port, member, guest, home = meet(make(), stack, KEY)
    member.send(home, b"hello")
    expect(port, "frame")
    port.send(guest, bytes(2**22))
    port.cut(guest, "enough")
    port.send(guest, b"too late")
    assert expect(port, "gone")[1:] == (guest, b"", "enough")
    assert len(expect(member, "frame").frame) == 2**22
    assert expect(member, "gone")[1:] == (home, b"", "enough")
    # The member's port comes again by itself ...
    again = expect(member, "came").peer
    assert expect(port, "came").peer != guest
    # ... unless it was the member who left.
    member.cut(again, "done")
    assert expect(member, "gone").reason == "done"
    assert expect(port, "gone").reason == "done"
    assert member.receive(0.3) is None
    assert port.receive(0) is None


def test_records_sent_before_the_end_arrive(make: Callable[..., Transport], stack: ExitStack) -> None:
    port, member, guest, _ = meet(make(), stack)
    for place in range(100):
        port.send(guest, bytes([place]) * 10_000)
    port.close()
    port.close()
    port.send(guest, b"too late")
    assert [expect(member, "frame").frame[0] for _ in range(100)] == list(range(100))
    assert expect(member, "gone").reason == "the host ended the connection"
    assert port.receive() is None


@pytest.mark.parametrize(
    ("host_key", "key", "reason"),
    [
        (KEY, None, "the host wants a key"),
        (None, KEY, "the host has no key"),
        (KEY, b"another", "the host does not know this key"),
    ],
)
def test_a_peer_without_the_key_is_refused_at_each_try(
    make: Callable[..., Transport], stack: ExitStack, host_key: bytes | None, key: bytes | None, reason: str
) -> None:
    transport = make()
    port = stack.enter_context(transport.listen("127.0.0.1", 0, host_key))
    member = stack.enter_context(transport.join("127.0.0.1", number(port), key))
    told = [expect(member, "gone") for _ in range(2)]
    assert [each.reason for each in told] == [reason] * 2
    assert told[0].peer != told[1].peer
    assert eventually(lambda: port.rejected["unauthenticated"] >= 2)
    assert port.receive(0) is None


def test_more_than_there_is_room_for_are_turned_away(make: Callable[..., Transport], stack: ExitStack) -> None:
    transport = make(members=2)
    port = stack.enter_context(transport.listen("127.0.0.1", 0))
    members = []
    for _ in range(2):
        members.append(stack.enter_context(transport.join("127.0.0.1", number(port))))
        expect(members[-1], "came")
        port.accept(expect(port, "came").peer)
    third = stack.enter_context(transport.join("127.0.0.1", number(port)))
    expect(third, "came")
    assert expect(third, "gone").reason == "the host takes no more than 2 members"
    assert port.rejected["crowded"] >= 1
    members[0].close()
    expect(port, "gone")
    expect(port, "came")


def test_a_connection_that_is_not_accepted_makes_room_for_the_next(
    make: Callable[..., Transport], stack: ExitStack
) -> None:
    transport = make(members=2)
    port = stack.enter_context(transport.listen("127.0.0.1", 0))
    ports = [stack.enter_context(transport.join("127.0.0.1", number(port))) for _ in range(2)]
    accepted, silent = expect(port, "came").peer, expect(port, "came").peer
    port.accept(accepted)
    last = stack.enter_context(transport.join("127.0.0.1", number(port)))
    expect(last, "came")
    assert expect(port, "gone")[1:] == (silent, b"", "the host takes no more than 2 members")
    # The one that had to go comes again, and takes the place of the other that was not accepted.
    newest = expect(port, "came").peer
    assert expect(port, "gone").peer == newest
    port.send(accepted, b"you stay")
    heard = [each for one in ports if (each := _frame(one)) is not None]
    assert [each.frame for each in heard] == [b"you stay"]


def _frame(port: Port) -> PortEvent | None:
    """The first frame that arrives at a port, if one does soon."""
    until = time.monotonic() + 1.0
    while (happening := port.receive(max(0.0, until - time.monotonic()))) is not None:
        if happening.kind == "frame":
            return happening
    return None


HOLD = """
import ctypes, sys
from importlib import import_module
module, kind, port, key, timeout = sys.argv[1:]
transport = getattr(import_module(module), kind)
port = transport(transport.Parameters(timeout=float(timeout))).join("127.0.0.1", int(port))
while True:
    happening = port.receive()
    if happening.kind == "frame":
        # PyDLL keeps the interpreter's lock while it calls.
        ctypes.PyDLL(None).usleep(int(happening.frame))
        port.send(happening.peer, happening.frame)
    elif happening.kind == "gone":
        sys.exit(happening.reason)
"""


def test_a_process_that_holds_the_interpreter_lock_for_long_is_not_taken_for_dead(
    make: Callable[..., Transport], stack: ExitStack, processes: list[subprocess.Popen[str]]
) -> None:
    transport = make(timeout=0.5)
    port = stack.enter_context(transport.listen("127.0.0.1", 0))
    processes.append(echo(transport, port, script=HOLD))
    peer = expect(port, "came").peer
    port.send(peer, b"3000000")
    assert expect(port, "frame").frame == b"3000000"
    # The other way round, the host holds its own.
    ctypes.PyDLL(None).usleep(3_000_000)
    port.send(peer, b"0")
    assert expect(port, "frame").frame == b"0"


CUT = """
import subprocess, sys, time
from importlib import import_module
module, kind, script = sys.argv[1:]
subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
transport = getattr(import_module(module), kind)
transport = transport(transport.Parameters(timeout=1.0))
port = transport.listen("127.0.0.1", 0)
number = port.address.rpartition(":")[2]
member = subprocess.Popen([sys.executable, "-c", script, module, kind, number, "", "1"], stdout=subprocess.DEVNULL)
assert port.receive(60).kind == "came"
assert port.receive(1.0) is None
subprocess.run(["ip", "link", "set", "lo", "down"], check=True)
began = time.monotonic()
happening = port.receive(30)
print(happening.kind, happening.reason, time.monotonic() - began, sep="|")
member.kill()
"""

#: A network of its own, which may be taken down.
APART = ["unshare", "--user", "--map-root-user", "--net"]


def test_a_machine_that_does_not_answer_any_more_is_gone_after_the_timeout(kind: type[Transport]) -> None:
    if subprocess.run([*APART, "ip", "link", "set", "lo", "up"], capture_output=True, check=False).returncode:
        pytest.skip("a network of one's own cannot be had here")
    line = [*APART, sys.executable, "-c", CUT, kind.__module__, kind.__name__, ECHO]
    done = subprocess.run(line, capture_output=True, text=True, timeout=90)
    assert done.returncode == 0, done.stderr
    what, reason, seconds = done.stdout.split("|")
    assert what == "gone"
    silent = "the machine of the member does not answer"
    assert reason == (silent if kind is Tcp else "the connection to the member was lost")
    assert float(seconds) < 6.0


def test_the_clocks_of_two_processes_on_one_machine_agree(
    make: Callable[..., Transport], stack: ExitStack, processes: list[subprocess.Popen[str]]
) -> None:
    transport = make()
    port = stack.enter_context(transport.listen("127.0.0.1", 0))
    processes.append(echo(transport, port))
    peer = expect(port, "came").peer
    assert eventually(lambda: port.offset(peer) != 0.0)
    # On Linux the monotonic clock is one for all processes.
    assert eventually(lambda: abs(port.offset(peer)) < 0.002)
    assert port.offset(peer + 1) == 0.0


@pytest.mark.parametrize("key", [None, KEY])
def test_a_process_that_is_killed_is_gone_at_once_and_comes_again(
    make: Callable[..., Transport], stack: ExitStack, processes: list[subprocess.Popen[str]], key: bytes | None
) -> None:
    transport = make(timeout=600.0)
    port = stack.enter_context(transport.listen("127.0.0.1", 0, key))
    processes.append(echo(transport, port, key))
    peer = expect(port, "came").peer
    port.send(peer, b"are you there?")
    expect(port, "frame")
    processes[0].send_signal(signal.SIGKILL)
    # Long before the timeout.
    assert expect(port, "gone", within=20.0).peer == peer
    processes.append(echo(transport, port, key))
    assert expect(port, "came").peer != peer


def test_a_process_that_is_stopped_is_gone_after_a_while_and_comes_again(
    kind: type[Transport], make: Callable[..., Transport], stack: ExitStack, processes: list[subprocess.Popen[str]]
) -> None:
    transport = make(timeout=0.5, hang_timeout=2.0)
    port = stack.enter_context(transport.listen("127.0.0.1", 0))
    processes.append(echo(transport, port))
    peer = expect(port, "came").peer
    assert port.receive(1.0) is None
    processes[0].send_signal(signal.SIGSTOP)
    # Zenoh's own threads are stopped, too, and so it tells sooner.
    silent = "no sign of life of the member for 2 s"
    assert expect(port, "gone").reason == (silent if kind is Tcp else "the connection to the member was lost")
    processes[0].send_signal(signal.SIGCONT)
    assert expect(port, "came").peer != peer


def test_a_member_whose_host_is_killed_reports_it_and_finds_the_next(
    make: Callable[..., Transport], stack: ExitStack, processes: list[subprocess.Popen[str]]
) -> None:
    transport = make(timeout=600.0)
    free = free_port()
    script = ECHO.replace('.join("127.0.0.1",', '.listen("127.0.0.1",')
    line = [sys.executable, "-c", script, type(transport).__module__, type(transport).__name__, str(free), "", "600"]
    processes.append(subprocess.Popen(line, stdout=subprocess.DEVNULL, text=True))
    quick = make(timeout=2.0)
    member = stack.enter_context(quick.join("127.0.0.1", free))
    expect(member, "came")
    processes[0].kill()
    expect(member, "gone")
    # A process that is killed lets go of its connections one after the other: of the one that listens, perhaps last.
    processes[0].wait()
    stack.enter_context(transport.listen("127.0.0.1", free))
    expect(member, "came")


def test_a_member_that_stands_still_while_its_host_ends_is_still_informed(
    make: Callable[..., Transport], stack: ExitStack, processes: list[subprocess.Popen[str]]
) -> None:
    transport = make(timeout=600.0)
    port = transport.listen("127.0.0.1", 0)
    stack.callback(port.close)
    processes.append(echo(transport, port, script=COUNT))
    peer = expect(port, "came").peer
    output = processes[0].stdout
    assert output
    assert output.readline() == "started\n"
    processes[0].send_signal(signal.SIGSTOP)
    for _ in range(10):
        port.send(peer, bytes(1000))
    # It waits no longer than a second.
    port.close()
    processes[0].send_signal(signal.SIGCONT)
    assert output.readline() == "10 the host ended the connection\n"


def test_a_run_that_computes_for_long_is_not_taken_for_dead(make: Callable[..., Transport], stack: ExitStack) -> None:
    port, member, guest, _ = meet(make(timeout=0.6), stack)
    until = time.monotonic() + 1.5
    while time.monotonic() < until:
        sum(range(1000))
    assert port.receive(0) is None
    assert member.receive(0) is None
    port.send(guest, b"still here")
    assert expect(member, "frame").frame == b"still here"


def test_a_peer_that_does_not_read_is_disconnected_and_nobody_waits_for_it(
    make: Callable[..., Transport], stack: ExitStack, processes: list[subprocess.Popen[str]]
) -> None:
    transport = make(timeout=600.0, queue=4)
    port = stack.enter_context(transport.listen("127.0.0.1", 0))
    processes.append(echo(transport, port))
    peer = expect(port, "came").peer
    processes[0].send_signal(signal.SIGSTOP)
    frame = bytes(2**20)
    for _ in range(40):
        port.send(peer, frame)
        if (happening := port.receive(0.05)) is not None:
            break
    assert happening is not None
    assert (happening.kind, happening.reason) == ("gone", "too many frames waited for it")


def test_a_run_that_does_not_take_its_frames_holds_few_of_them_and_its_sender_the_rest(
    make: Callable[..., Transport], stack: ExitStack
) -> None:
    transport = make(timeout=2.0, maximum_frame=2**20)
    port, member, _, home = meet(transport, stack)
    sent, happening = 0, None
    # Four of the longest frames may wait at each end, and the network holds some, too.
    while happening is None and sent < 100:
        member.send(home, bytes([sent]) * 2**20)
        sent += 1
        happening = member.receive(0.02)
    assert happening is not None
    assert happening.reason == "too many frames waited for it"
    for place in range(4):
        assert expect(port, "frame").frame == bytes([place]) * 2**20


def test_not_to_read_is_no_sign_of_death(make: Callable[..., Transport], stack: ExitStack) -> None:
    port, member, _, home = meet(make(timeout=0.6, queue=8), stack)
    frames = [bytes([place]) * 100_000 for place in range(16)]
    for frame in frames:
        member.send(home, frame)
        time.sleep(0.01)
    time.sleep(1.5)
    assert [expect(port, "frame").frame == frame for frame in frames] == [True] * len(frames)
    assert port.receive(0.1) is None


def test_a_frame_that_nobody_would_take_is_not_sent(make: Callable[..., Transport], stack: ExitStack) -> None:
    port, member, guest, _ = meet(make(maximum_frame=2000), stack)
    with pytest.raises(ValueError, match="2001 bytes"):
        port.send(guest, bytes(2001))
    port.send(guest, bytes(2000))
    assert len(expect(member, "frame").frame) == 2000


def test_a_member_that_takes_less_turns_away_what_is_longer(
    kind: type[Transport], make: Callable[..., Transport], stack: ExitStack
) -> None:
    port = stack.enter_context(make().listen("127.0.0.1", 0))
    member = stack.enter_context(make(maximum_frame=2000).join("127.0.0.1", number(port)))
    guest = expect(port, "came").peer
    expect(member, "came")
    port.send(guest, bytes(3000))
    expect(member, "gone")
    assert member.rejected["oversized"] == 1


def test_a_place_that_is_taken_is_a_clear_error(make: Callable[..., Transport], stack: ExitStack) -> None:
    transport = make()
    port = stack.enter_context(transport.listen("127.0.0.1", 0))
    with pytest.raises(TransportError, match=f"cannot listen at {port.address}: .*[Aa]ddress already in use"):
        transport.listen("127.0.0.1", number(port))
    with pytest.raises(TransportError, match=r"cannot listen at 192\.0\.2\.1"):
        transport.listen("192.0.2.1", 0)
    with pytest.raises(TransportError, match="nobody can listen at port 0"):
        transport.join("127.0.0.1", 0)
    with pytest.raises(TransportError, match="not looked up"):
        transport.join("robot.example", 80)


def test_waiting_for_what_happens_can_be_interrupted(make: Callable[..., Transport], stack: ExitStack) -> None:
    port = stack.enter_context(make().listen("127.0.0.1", 0))
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        port.receive()
    timer.join()


def test_a_process_that_never_closes_its_ports_ends(kind: type[Transport]) -> None:
    script = (
        f"from {kind.__module__} import {kind.__name__} as kind\n"
        "port = kind().listen('127.0.0.1', 0)\n"
        "member = kind().join('127.0.0.1', int(port.address.rpartition(':')[2]))\n"
        "other = kind().join('127.0.0.1', 1)\n"
        "print(port.receive(9).kind, member.receive(9).kind)\n"
    )
    done = subprocess.run([sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "came came\n", "")


def test_a_process_that_ends_while_it_connects_ends_in_order(kind: type[Transport]) -> None:
    script = (
        "import socket\n"
        f"from {kind.__module__} import {kind.__name__} as kind\n"
        "silent = socket.create_server(('127.0.0.1', 0))\n"
        "member = kind(kind.Parameters(timeout=2.0)).join(*silent.getsockname())\n"
        "connection, _ = silent.accept()\n"
        "print('connected')\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "connected\n", "")


def test_a_transport_whose_library_is_not_there_says_what_to_install() -> None:
    script = (
        "import sys\n"
        "sys.modules['zenoh'] = None\n"
        "from symaware_cli import TransportError\n"
        "from symaware_cli.processes.zenoh import Zenoh\n"
        "try:\n    Zenoh().listen('127.0.0.1', 0)\nexcept TransportError as error:\n    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "pip install 'symaware-cli[zenoh]'" in done.stdout


def test_a_connection_at_the_closing_of_the_port_does_not_delay_it(
    stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    for limit in ("port.PARTING", "port._CLOSING"):
        monkeypatch.setattr(f"symaware_cli.processes.{limit}", 60.0)
    host = Tcp(Tcp.Parameters()).listen("127.0.0.1", 0)
    untyped(host).later(time.sleep, 0.5)  # so that it is closing when it hears of who came
    stack.enter_context(socket.create_connection(("127.0.0.1", number(host))))
    began = time.monotonic()
    host.close()
    assert time.monotonic() - began < 30.0


def test_a_stranger_who_comes_over_zenoh_as_the_host_closes_leaves_no_thread() -> None:
    pytest.importorskip("zenoh")
    parameters = Zenoh.Parameters()
    host: Any = Zenoh(parameters).listen("127.0.0.1", 0)
    member = PeerProtocol(False, None, 2**20, 2.0, 60.0, time.monotonic())

    def come() -> None:
        host.ending = True
        for record in (member.preamble, member.record(PING, bytes(8)), member.record(PONG, bytes(24))):
            host._put_in("0123456789abcdef", record)
        host.drain()

    assert host.later(come)
    host.close()
    assert not host.connections
    assert eventually(lambda: not threads(), within=10.0)


def test_waiting_for_frames_needs_no_other_thread(stack: ExitStack, processes: list[subprocess.Popen[str]]) -> None:
    port: Any = stack.enter_context(Tcp(Tcp.Parameters()).listen("127.0.0.1", 0))
    processes.append(echo(Tcp(Tcp.Parameters()), port))
    peer = expect(port, "came").peer

    def switches() -> int:
        """How often the port's own thread waited for something."""
        status = Path(f"/proc/self/task/{port._thread.native_id}/status").read_text()
        return int(status.partition("\nvoluntary_ctxt_switches:")[2].split()[0])

    before, began = switches(), time.monotonic()
    for _ in range(500):
        port.send(peer, b"?")
        assert expect(port, "frame").frame == b"?"
    # It looks now and then whether it is needed.
    assert switches() - before < 100 + 100 * (time.monotonic() - began)


class _Sluggish:
    """A lock whose owner-to-be takes its time to wake up, as on a machine with much to do."""

    def __init__(self, lock: Any) -> None:
        self._lock = lock

    def acquire(self, blocking: bool = True) -> bool:
        if blocking:
            with self._lock:
                pass
            time.sleep(0.1)
        return bool(self._lock.acquire(blocking))

    def release(self) -> None:
        self._lock.release()


def test_a_run_that_is_slow_to_wake_up_gets_its_turn_all_the_same(stack: ExitStack) -> None:
    port: Any = stack.enter_context(Tcp(Tcp.Parameters()).listen("127.0.0.1", 0))
    assert eventually(port._turn.locked)  # its own thread has it
    port._turn = _Sluggish(port._turn)
    waiting = threading.Thread(target=port.receive, args=(0.0,), daemon=True)
    waiting.start()
    waiting.join(20.0)
    assert not waiting.is_alive()


def test_ports_leave_no_thread_and_no_descriptor(make: Callable[..., Transport]) -> None:
    transport = make()

    def once() -> None:
        with ExitStack() as stack:
            meet(transport, stack)

    # Libraries keep some threads of their own, and some for a while.
    for _ in range(5):
        once()
    before = descriptors(), tasks()
    for _ in range(95):
        once()
    assert eventually(lambda: descriptors() <= before[0] + 4 and tasks() <= before[1] + 8)
    assert eventually(lambda: not threads())


def test_memory_stays_within_one_process() -> None:
    for connect in (Memory().listen, Memory().join):
        with pytest.raises(TransportError, match="`memory` stays within one process"):
            connect("127.0.0.1", 4321)


def test_every_rejection_is_counted_from_nought(make: Callable[..., Transport], stack: ExitStack) -> None:
    port = stack.enter_context(make().listen("127.0.0.1", 0))
    assert Counter(port.rejected) == dict.fromkeys(
        ("garbage", "oversized", "unauthenticated", "replayed", "crowded"), 0
    )
    with pytest.raises(TypeError):
        port.rejected["garbage"] = 1  # type: ignore[index]
