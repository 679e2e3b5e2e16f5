"""Hosts and those who are not of this package, or not of this run: others' members, silent peers, bad frames."""

import hashlib
import json
import resource
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from independent_member import FRAME, Wire
from simulating import in_process, present
from spreading import PATIENCE, Spread, goal_seekers, written

from symaware_cli import __version__, open_log
from symaware_cli.engine.network import transport_pb2
from symaware_cli.language.build import build
from symaware_cli.processes.codec import decode, encode
from symaware_cli.processes.frame import Hello, Welcome
from symaware_cli.processes.tcp import Tcp

HERE = Path(__file__).resolve().parent.parent


@pytest.fixture
def spread(tmp_path: Path, doubles: Path) -> Iterator[Callable[..., Spread]]:
    """Prepare a run that is shared with others."""
    begun = []

    def begin(document: dict[str, Any], *arguments: object) -> Spread:
        begun.append(Spread(tmp_path / "spread", written(tmp_path / "goals.yaml", document), *arguments))
        return begun[-1]

    yield begin
    for each in begun:
        each.close()


def independent(run: Spread, agent: str, goal: Sequence[float], key: bytes = b"") -> subprocess.Popen[str]:
    """Start the member that has only sockets, protobuf and docs/wire.md."""
    told = in_process("validate", "--json", run.scenario)
    line = [sys.executable, "-I", HERE / "independent_member.py", transport_pb2.__file__, f"127.0.0.1:{run.port}"]
    line += [json.loads(told.stdout)["digest"], __version__, key.hex(), agent, *goal]
    return subprocess.Popen(list(map(str, line)), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def outcome(member: subprocess.Popen[str]) -> Any:
    """What an independent member says in the end."""
    said, error = member.communicate(timeout=PATIENCE)
    assert member.returncode == 0, error
    return json.loads(said)


@pytest.mark.parametrize("key", [b"", b"a key that both ends know"])
def test_a_member_written_from_the_page_alone_takes_part_to_the_end(
    spread: Callable[..., Spread], tmp_path: Path, key: bytes
) -> None:
    document = goal_seekers()
    document["agents"]["ticker"]["components"] = {"tell": {"use": "communication.broadcast", "period": 0.5}}
    document["agents"]["robot"]["components"]["hear"] = {"use": "doubles.ear"}
    run = spread(document)
    (tmp_path / "run.key").write_bytes(key)
    host = run.host("--only", "ticker,robot.1", *(("--key-file", tmp_path / "run.key") if key else ()))
    host.wait_for("waits at")
    said = outcome(independent(run, "robot.0", (4.0, 0.0), key))
    assert host.end() == 0
    assert said["status"] == "finished"
    assert "all(goals_reached)" in said["reason"]
    assert said["told"][0] == "welcome"
    assert said["steps"] == list(range(len(said["steps"])))
    assert [sender for sender, _ in said["heard"]][:1] == [2]  # the ticker, after both robots
    log = open_log(host.log)
    assert present(log.outcome)["steps"] + 1 == len(said["steps"])
    states = np.array([message.decode().values[0] for message in log.messages(["/world/robot/state"])])
    assert np.linalg.norm(states[-1] - [4.0, 0.0]) < 0.1
    assert "agents.robot.1.hear" in {each.source for each in log.events() if "robot.0" in each.text}


@pytest.mark.parametrize(("change", "reason"), [("digest", "another scenario"), ("version", "is SymAware")])
def test_it_is_refused_with_the_reason_where_it_does_not_fit(
    spread: Callable[..., Spread], monkeypatch: pytest.MonkeyPatch, change: str, reason: str
) -> None:
    run = spread(goal_seekers())
    run.host("--only", "ticker,robot.1").wait_for("waits at")
    if change == "version":
        monkeypatch.setattr(sys.modules[__name__], "__version__", "0.0.9")
    else:
        run.scenario = written(run.scenario.with_name("other.yaml"), goal_seekers(distance=5.0))
    said = outcome(independent(run, "robot.0", (4.0, 0.0)))
    assert said["status"] == "refused"
    assert reason in said["reason"]


class Crowd:
    """Peers that connect, say nothing that makes them members, and come again when they are sent off."""

    def __init__(self, address: Any, count: int) -> None:
        self._over = False
        self._address = address
        self.reasons: list[Any] = []
        self._threads = [threading.Thread(target=self._sit) for _ in range(count)]
        for each in self._threads:
            each.start()

    def _sit(self) -> None:
        while not self._over:
            try:
                with Wire(self._address) as wire:
                    wire.socket.settimeout(1.0)
                    while not self._over:
                        with suppress(TimeoutError):
                            wire.hear()
            except EOFError as error:
                self.reasons.append(str(error))
                time.sleep(0.05)
            except OSError:
                time.sleep(0.05)

    def close(self) -> None:
        """Go."""
        self._over = True
        for each in self._threads:
            each.join()


def test_silent_peers_do_not_keep_members_out(spread: Callable[..., Spread]) -> None:
    run = spread(goal_seekers(distance=2.0), "--set", "transport.with.members=8")
    host = run.host("--only", "ticker")
    host.wait_for("waits at")
    crowd = Crowd(f"127.0.0.1:{run.port}", 20)
    try:
        time.sleep(1.0)
        members = run.member("west", "robot.0"), run.member("east", "robot.1")
        assert [each.end() for each in (host, *members)] == [0, 0, 0]
    finally:
        crowd.close()
    assert {"the host takes no more than 8 members"} <= set(crowd.reasons)


def test_a_connection_without_a_request_is_refused(spread: Callable[..., Spread]) -> None:
    run = spread(goal_seekers(), "--set", "transport.with.hang_timeout=1.5")
    run.host("--only", "ticker").wait_for("waits at")
    with (
        Wire(f"127.0.0.1:{run.port}") as wire,
        pytest.raises(EOFError, match=r"it did not say within 1\.5 s what it wants"),
    ):
        # It answers whatever it is asked, so that its connection does not count as dead.
        wire.hear()


def test_a_connection_with_a_slow_request_is_admitted(spread: Callable[..., Spread]) -> None:
    run = spread(goal_seekers())
    run.host("--only", "ticker,robot.1").wait_for("waits at")
    hello = Hello("slow", hashlib.sha256(build(run.scenario).resolved).digest(), __version__, ("robot.0",))
    with Tcp().join("127.0.0.1", run.port) as port:
        peer = present(port.receive(60.0)).peer
        assert port.receive(3.0) is None
        port.send(peer, encode(hello))
        assert isinstance(decode(present(port.receive(60.0)).frame), Welcome)


def test_bad_frames_are_one_event_with_their_number(spread: Callable[..., Spread]) -> None:
    run = spread(goal_seekers(distance=2.0))
    host = run.host("--only", "ticker")
    host.wait_for("waits at")
    for number in range(50):
        with Wire(f"127.0.0.1:{run.port}") as wire, suppress(EOFError):
            wire.say(FRAME, bytes([255, number]) * 1000)
            wire.hear()
    run.member("west", "robot.0")
    run.member("east", "robot.1")
    run.finish()
    rejected = [each for each in open_log(host.log).events() if each.name == "rejected"]
    assert len(rejected) == 1
    assert rejected[0].data["total"] == {"malformed": 50}
    assert "50 malformed; what a stranger said is not taken" in rejected[0].text
    assert len(rejected[0].text) < 300


def test_a_process_that_holds_the_interpreter_lock_is_waited_for(spread: Callable[..., Spread]) -> None:
    document = goal_seekers(distance=2.0, timeout=1.0)
    document["agents"]["robot"]["components"]["hold"] = {"use": "doubles.holder"}
    run = spread(document)
    host = run.host("--only", "ticker,robot.1")
    run.member("west", "robot.0")
    run.finish()
    assert not [each for each in open_log(host.log).events() if each.name == "lost"]


def test_members_receive_the_reason_why_the_host_cannot_go_on(spread: Callable[..., Spread]) -> None:
    run = spread(goal_seekers(wait=0.02, distance=1000.0))
    host, west = run.host("--only", "ticker,robot.1"), run.member("west", "robot.0")
    west.wait_for("west takes part")
    size = host.log.stat().st_size
    resource.prlimit(host._popen.pid, resource.RLIMIT_FSIZE, (size + 1000, size + 1000))
    assert run.end() == [1, 1]
    assert "larger than allowed" in host.text
    assert "the host failed: " in west.text
    assert "larger than allowed" in west.text
