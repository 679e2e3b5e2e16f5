"""`symaware run` as one of several processes: what it refuses, in one sentence, and how it leaves."""

import signal
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from ports import free_port
from simulating import present
from spreading import Spread, goal_seekers, written
from typer.testing import CliRunner, Result

from symaware_cli import open_log
from symaware_cli.cli.application import application


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Callable[..., Result]]:
    """Run `symaware run goals.yaml ARGUMENTS` in this process; the scenario has a ticker and two robots."""
    monkeypatch.chdir(tmp_path)
    written(tmp_path / "goals.yaml", goal_seekers())
    before = signal.getsignal(signal.SIGTERM)

    def invoke(*arguments: object, scenario: str = "goals.yaml") -> Result:
        done = CliRunner().invoke(application, ["run", scenario, "-o", "part.mcap", *map(str, arguments)])
        assert done.exception is None or isinstance(done.exception, SystemExit), done.exc_info
        return done

    yield invoke
    signal.signal(signal.SIGTERM, before)


@pytest.fixture(scope="module")
def waiting(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A host that runs the ticker and waits for ever, as only robot.0 has come: its address."""
    folder = tmp_path_factory.mktemp("waiting")
    processes = Spread(folder, written(folder / "goals.yaml", goal_seekers()))
    host, _ = processes.host("--only", "ticker"), processes.member("west", "robot.0")
    assert host.wait_for("west").endswith("west is there; waits for robot.1")
    yield f"127.0.0.1:{processes.port}"
    processes.close()


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path]]:
    """A host that asks for a key: its address, and a file with the key."""
    folder = tmp_path_factory.mktemp("guarded")
    (folder / "run.key").write_text("0123456789abcdef0123456789abcdef")
    processes = Spread(folder, written(folder / "goals.yaml", goal_seekers()))
    processes.host("--key-file", folder / "run.key").wait_for("waits at")
    yield f"127.0.0.1:{processes.port}", folder / "run.key"
    processes.close()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--only", "robot.0"], "--only is for a run of several processes: with --listen PORT or --join HOST:PORT"),
        (["--name", "west"], "--name is for a run of several processes: with --listen PORT or --join HOST:PORT"),
        (["--bind", "0.0.0.0"], "--bind is for a run of several processes: with --listen PORT or --join HOST:PORT"),
        (["--key-file", "a.key"], "--key-file is for a run of several processes: with --listen PORT or --join"),
        (
            ["--listen", 0, "--join", "127.0.0.1:7000"],
            "--listen is for the host and --join for all others: give one of them",
        ),
        (["--join", "127.0.0.1:7000", "--bind", "::1"], "--bind says where a host listens: it goes with --listen"),
        (
            ["--join", "127.0.0.1:7000"],
            "a process that joins must run some of the agents; select them with --only",
        ),
        (
            ["--join", "127.0.0.1:7000", "--only", "robt"],
            "--only names `robt`, and there is no such agent or group; did you mean `agents.robot`?",
        ),
        (
            ["--join", "127.0.0.1:7000", "--only", "robot.0,robot.2"],
            "--only names `robot.2`, and there is no such agent or group; did you mean `agents.robot.1`?",
        ),
        (
            ["--listen", 0, "--only", "robot,ticker"],
            "--only selects all agents, so there are none for other processes to run",
        ),
        (
            ["--listen", 0, "--bind", "0.0.0.0"],
            "to listen at 0.0.0.0, which other machines can reach, all processes must share a key: --key-file FILE",
        ),
        (
            ["--join", "192.0.2.7:7000", "--only", "robot"],
            "to join 192.0.2.7, which other machines can reach, all processes must share a key: --key-file FILE",
        ),
        (["--listen", 0, "--key-file", "none.key"], "the key cannot be read: none.key: No such file or directory"),
        (["--listen", 0, "--key-file", "short.key"], "the key in short.key has 5 bytes; it needs at least 16"),
        (
            ["--join", "somewhere.example:7000", "--only", "robot"],
            "`somewhere.example` is no IP address: write it in numbers, such as 192.0.2.7; names other than localhost",
        ),
        (["--join", "127.0.0.1", "--only", "robot"], "`127.0.0.1` has no port: expected HOST:PORT with a port of"),
        (["--join", "127.0.0.1:0", "--only", "robot"], "nobody can listen at port 0"),
        (["--listen", 0, "--set", "transport.use=memory"], "`memory` stays within one process"),
    ],
)
def test_a_place_that_makes_no_sense_is_refused_before_anything_begins(
    run: Callable[..., Result], tmp_path: Path, arguments: list[int | str], said: str
) -> None:
    (tmp_path / "short.key").write_text("hello\n")
    done = run(*arguments)
    assert done.exit_code == 2
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "part.mcap").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--only", "robot.1", "--seed", 9], "the host runs another scenario: file, seed and --set must be the same"),
        (
            ["--only", "robot.1", "--set", "run.duration=3"],
            "the host runs another scenario: file, seed and --set must be the same",
        ),
        (["--only", "robot.1,ticker"], "the host runs ticker itself"),
        (["--only", "robot", "--wait", 1], "robot.0 run in west"),
        (["--only", "robot.1", "--name", "west"], "another process is called west; give this one a --name of its own"),
    ],
)
def test_a_member_that_does_not_fit_is_refused(
    run: Callable[..., Result], waiting: str, arguments: list[int | str], said: str
) -> None:
    done = run("--join", waiting, *arguments)
    assert done.exit_code == 1
    assert said in done.stderr
    assert present(open_log("part.mcap").outcome)["status"] == "failed"


@pytest.mark.parametrize("key", ["another", "none"])
def test_a_process_without_the_key_is_refused(
    run: Callable[..., Result], guarded: tuple[str, Path], tmp_path: Path, key: str
) -> None:
    address, _ = guarded
    (tmp_path / "another.key").write_text("another key of sufficient length")
    options = ["--key-file", "another.key"] if key == "another" else []
    done = run("--join", address, "--only", "robot", *options, "--wait", 20)
    assert done.exit_code == 1
    assert f"the host at {address} does not take us in: " in done.stderr
    assert "key" in done.stderr


def test_a_key_that_the_host_does_not_ask_for_is_refused_too(
    run: Callable[..., Result], waiting: str, guarded: tuple[str, Path]
) -> None:
    done = run("--join", waiting, "--only", "robot.1", "--key-file", guarded[1], "--wait", 20)
    assert done.exit_code == 1
    assert f"the host at {waiting} does not take us in: " in done.stderr
    assert "key" in done.stderr


def test_with_the_key_a_host_listens_anywhere(tmp_path: Path) -> None:
    (tmp_path / "run.key").write_text("0123456789abcdef0123456789abcdef")
    processes = Spread(tmp_path, written(tmp_path / "goals.yaml", goal_seekers(distance=1.0)), "--key-file", "run.key")
    try:
        processes.host("--bind", "0.0.0.0")
        processes.member("all", "robot,ticker")
        processes.finish()
    finally:
        processes.close()


def test_a_port_in_use_is_said_to_be(run: Callable[..., Result]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        done = run("--listen", port)
    assert done.exit_code == 2
    assert done.stderr.startswith(f"symaware: cannot listen at 127.0.0.1:{port}: ")
    assert "address already in use" in done.stderr.lower()


def test_it_waits_for_a_host_no_longer_than_its_limit(run: Callable[..., Result]) -> None:
    port = free_port()
    done = run("--join", f"127.0.0.1:{port}", "--only", "robot", "--wait", 1)
    assert done.exit_code == 1
    assert f"no host at 127.0.0.1:{port} took us in within 1 s" in done.stderr
    assert present(open_log("part.mcap").outcome)["status"] == "failed"


def test_a_host_waits_for_members_no_longer_than_its_limit(run: Callable[..., Result]) -> None:
    done = run("--listen", 0, "--only", "ticker", "--wait", 1)
    assert done.exit_code == 1
    assert "no process joined within 1 s for robot.0, robot.1" in done.stderr


def test_ctrl_c_ends_the_waiting(tmp_path: Path) -> None:
    processes = Spread(tmp_path, written(tmp_path / "goals.yaml", goal_seekers()))
    try:
        host = processes.host()
        host.wait_for("waits at")
        host.send(signal.SIGINT)
        assert host.end() == 130
        assert present(open_log(host.log).outcome)["status"] == "interrupted"
    finally:
        processes.close()


def test_a_world_that_cannot_be_followed_is_not_shared(run: Callable[..., Result], doubles: Path) -> None:
    done = run("--listen", 0, "--set", "environment.use=doubles.lonely-world")
    assert done.exit_code == 2
    assert done.stderr == "symaware: the world `doubles.lonely-world` cannot be copied to other processes\n"


def test_a_transport_may_be_a_plugin(doubles: Path, tmp_path: Path) -> None:
    scenario = written(tmp_path / "goals.yaml", goal_seekers(distance=1.0))
    processes = Spread(tmp_path, scenario, "--set", "transport.use=doubles.loud")
    try:
        processes.host("--only", "ticker")
        processes.member("all", "robot")
        processes.finish()
    finally:
        processes.close()
    assert (tmp_path / "loud.txt").read_text() == f"127.0.0.1:{processes.port}"
