"""`symaware replay`, as a process."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import Browser
from checkout import CHECKOUT
from numpy.typing import NDArray
from rerun_files import CHROMIUM, STEP, Recording, Script, coloured, group, needs_browser, needs_graphics, pixels
from sample_log import write_sample
from simulating import COMMAND, Command, present
from small_disk import on_a_small_disk

from symaware_cli import Log
from symaware_cli.language.execution import execute
from symaware_cli.language.files import open_scenario
from symaware_cli.log import wire

SCENARIOS = CHECKOUT / "scenarios"
SHOWN = "4 agents: bodies tinted by risk, trails of 3.6 s, intents and uncertainties of all; tabs for all agents"


@pytest.fixture(scope="module")
def hello(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "hello.mcap"
    execute(open_scenario(SCENARIOS / "hello.yaml", []), path)
    return path


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start a replay in the background; at the end it must be gone, with all that it started."""
    processes = []

    def start(*arguments: object) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [*COMMAND, "replay", *map(str, arguments)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "TMPDIR": str(tmp_path)},
        )
        processes.append(process)
        return process

    yield start
    for process in processes:
        process.kill()
        process.communicate()


def children(process: subprocess.Popen[str]) -> list[str]:
    return Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()


def alive(pid: str) -> bool:
    try:
        return b"rerun" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False


def test_a_file_is_written_and_its_content_is_described(hello: Path, command: Command, tmp_path: Path) -> None:
    done = command("replay", hello, "--save", "hello.rrd")
    assert (done.returncode, done.stderr) == (0, "")
    first, second = done.stdout.splitlines()
    assert first.startswith("hello.rrd: ")
    assert second.strip() == SHOWN
    recording = Recording(tmp_path / "hello.rrd")
    assert recording.blueprints == 1
    assert len(recording.times("/world/agents/robot/body", "Points3D:positions")) == 241
    assert sorted(each.name for each in tmp_path.iterdir()) == ["hello.rrd"]


def test_the_facts_are_there_for_scripts(hello: Path, command: Command) -> None:
    facts = json.loads(command("replay", hello, "--save", "hello.rrd", "--json").stdout)
    assert facts["shown"] == SHOWN
    assert facts["file"] == "hello.rrd"
    assert facts["size"] == Path("hello.rrd").stat().st_size


@needs_graphics
def test_a_picture_is_taken_of_an_instant(hello: Path, command: Command) -> None:
    done = command("replay", hello, "--screenshot", "a.png", "--at", "3", "--size", "900x600", "--json")
    assert done.returncode == 0, done.stdout
    assert json.loads(done.stdout)["reports"] == []
    command("replay", hello, "--screenshot", "b.png", "--at", "9", "--size", "900x600")
    early, late = pixels(Path("a.png").read_bytes()), pixels(Path("b.png").read_bytes())
    assert early.shape == (600, 900, 3)
    assert coloured(early) > 300
    assert (abs(early - late).sum(axis=-1) > 40).sum() > 300


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--save", "a.rrd", "--web"], "choose one of --save, --screenshot, --video, --web and --connect"),
        (["--save", "a.rrd", "--agents", "robot.9"], "there is no agent 'robot.9'; did you mean 'robot."),
        (["--save", "a.rrd", "--from", "99"], "nothing to show in that interval"),
        (["--save", "a.rrd", "--from", "3", "--to", "2"], "--from 3 is later than --to 2"),
        (["--save", "a.rrd", "--from", "-1"], "--from takes a time in seconds, not -1"),
        (["--save", "a.rrd", "--to", "nan"], "--to takes a time in seconds"),
        (["--screenshot", "a.png", "--at", "inf"], "--at takes a time in seconds"),
        (["--screenshot", "a.png", "--at", "99"], "--at 99 is not in"),
        (["--screenshot", "a.png", "--at", "3", "--from", "4"], "--at 3 is not in"),
        (["--screenshot", "a.jpg"], "--screenshot writes a PNG; end the name of the file in .png, not a.jpg"),
        (["--save", "a.rrd", "--at", "3"], "--at goes with --screenshot"),
        (["--screenshot", "a.png", "--size", "big"], "--size is two numbers of pixels"),
        (["--screenshot", "a.png", "--size", "100000x4"], "--size is two numbers of pixels"),
        (["--web", "--bind", "localhost"], "--bind is an IP address"),
    ],
)
def test_meaningless_options_are_reported(
    options: list[str], said: str, hello: Path, command: Command, tmp_path: Path
) -> None:
    done = command("replay", hello, *options)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_log_is_not_overwritten_by_its_own_export(hello: Path, command: Command) -> None:
    before = hello.read_bytes()
    Path("same.rrd").symlink_to(hello)
    done = command("replay", hello, "--save", "same.rrd")
    assert done.returncode == 2
    assert "it is an input file" in done.stderr
    assert hello.read_bytes() == before


def test_a_log_that_broke_off_is_shown_as_far_as_it_goes_and_exits_3(command: Command, tmp_path: Path) -> None:
    data = write_long(tmp_path / "whole.mcap", 100).path.read_bytes()
    Path("cut.mcap").write_bytes(data[: len(data) // 2])
    done = command("replay", "cut.mcap", "--save", "cut.rrd")
    assert done.returncode == 3
    assert "breaks off" in done.stderr
    assert 20 < len(Recording(Path("cut.rrd")).times("/world/agents/a/body", "Points3D:positions")) < 100


def test_a_log_that_broke_off_at_once_is_reported(hello: Path, command: Command) -> None:
    data = hello.read_bytes()
    Path("cut.mcap").write_bytes(data[: len(data) // 2])
    done = command("replay", "cut.mcap", "--save", "cut.rrd")
    assert done.returncode == 2
    assert "has nothing to show; the log breaks off" in done.stderr


@pytest.mark.slow
def test_a_log_cut_anywhere_is_shown_or_refused_in_a_sentence(tmp_path: Path) -> None:
    from fuzzing.log_verbs import called

    data = write_small(tmp_path / "whole.mcap").read_bytes()
    cut, made = tmp_path / "cut.mcap", tmp_path / "cut.rrd"
    for length in range(0, len(data), 37):
        cut.write_bytes(data[:length])
        status, _, trouble = called(["replay", cut, "--save", made])
        assert status in (0, 2, 3), (length, trouble)
        assert "Traceback" not in trouble
        assert made.exists() == (status in (0, 3))
        made.unlink(missing_ok=True)
        assert list(tmp_path.glob(".*")) == []


def write_small(path: Path) -> Path:
    script = Script(path, {"a": group("a.0", "a.1", shape={"circle": {"radius": 0.5}})})
    for step in range(5):
        script.say("/world/a/state", step * STEP, wire.encode_rows([[0, 0], [step, 1]]), "Rows")
        script.event(step * STEP, "moved", "agents.a.0.steer")
    return script.finish().path


def test_a_log_without_models_is_a_damaged_one(command: Command, tmp_path: Path) -> None:
    done = command("replay", write_sample(tmp_path / "sample.mcap"), "--save", "a.rrd")
    assert done.returncode == 2
    assert "is damaged" in done.stderr
    assert not Path("a.rrd").exists()


def test_a_full_disk_is_reported_and_keeps_the_existing_file(hello: Path, tmp_path: Path) -> None:
    folder = tmp_path / "disk"
    folder.mkdir()
    line = [*COMMAND, "replay", str(hello), "--save", "old.rrd"]
    done = on_a_small_disk(folder, line, size="256k", then="mv old old.rrd")
    assert done.returncode == 1
    assert "cannot write old.rrd: the disk is full" in done.stderr
    assert done.stdout.split() == ["old.rrd"]


def test_a_file_that_may_not_grow_is_reported_and_leaves_no_file(hello: Path, command: Command, tmp_path: Path) -> None:
    limit = 200_000
    done = command(
        *("replay", hello, "--save", "a.rrd"),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert done.returncode == 1
    assert "cannot write a.rrd: the file would be larger than allowed here" in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a"])
def test_a_recording_that_is_called_something_else_is_refused(name: str, hello: Path, command: Command) -> None:
    done = command("replay", hello, "--save", name)
    assert done.returncode == 2
    assert "end the name of the file in .rrd" in done.stderr
    assert not Path(name).exists()


def test_a_missing_folder_is_reported(hello: Path, command: Command) -> None:
    done = command("replay", hello, "--save", "nowhere/a.rrd")
    assert done.returncode == 1
    assert done.stderr == "symaware: cannot write nowhere/a.rrd: its folder does not exist\n"


def test_a_missing_viewer_is_reported_at_once(hello: Path, command: Command) -> None:
    done = command("replay", hello, "--connect", "rerun+http://127.0.0.1:1/proxy", timeout=30)
    assert done.returncode == 1
    assert "the viewer at rerun+http://127.0.0.1:1/proxy cannot be reached: connection refused" in done.stderr


def test_a_taken_port_is_reported(hello: Path, command: Command) -> None:
    import socket

    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        done = command("replay", hello, "--web", "--port", other.getsockname()[1], timeout=60)
    assert done.returncode == 1
    assert done.stderr == "symaware: the port is taken by another program; choose one with --port\n"


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize(("end", "status"), [(signal.SIGINT, 0), (signal.SIGTERM, 0), (signal.SIGKILL, -9)])
def test_no_viewer_is_left_behind_however_it_ends(
    end: signal.Signals, status: int, hello: Path, started: Callable[..., subprocess.Popen[str]], free_port: int
) -> None:
    process = started(hello, "--web", "--port", free_port)
    assert present(process.stdout).readline().startswith(f"http://127.0.0.1:{free_port}/?url=")
    (viewer,) = children(process)
    assert alive(viewer)
    time.sleep(0.3)
    process.send_signal(end)
    assert process.wait(30) == status
    deadline = time.monotonic() + 20
    while alive(viewer):
        assert time.monotonic() < deadline, "the viewer lives on"
        time.sleep(0.05)


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_ctrl_c_while_it_sends_leaves_nothing_and_exits_130(
    hello: Path, started: Callable[..., subprocess.Popen[str]], tmp_path: Path, free_port: int
) -> None:
    log = tmp_path / "long.mcap"
    execute(open_scenario(SCENARIOS / "hello.yaml", ["agents.robot.count=200", "run.duration=60"]), log)
    process = started(log, "--web", "--port", free_port)
    deadline = time.monotonic() + 60
    while not (viewers := children(process)):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    # A shell calls either 130: that it says so itself, and that the signal ended it before it could.
    assert process.wait(60) in (130, -signal.SIGINT)
    assert not any(alive(viewer) for viewer in viewers)
    assert present(process.stdout).read() == ""


@pytest.mark.slow
@needs_browser
def test_a_browser_shows_it(
    hello: Path, started: Callable[..., subprocess.Popen[str]], tmp_path: Path, free_port: int
) -> None:
    process = started(hello, "--web", "--port", free_port)
    link = present(process.stdout).readline().strip()
    page = link.partition("?")[0]
    with Browser(present(CHROMIUM), tmp_path / "profile") as browser:
        browser.open(link)
        shown = settled(browser, lambda picture: coloured(scene(picture)) > 500)
        # Without the recording there is nothing but what the viewer shows by itself.
        browser.open(f"{page}?hide_welcome_screen=1&theme=dark")
        time.sleep(3.0)
        empty = pixels(browser.screenshot())
    assert coloured(scene(empty)) < 0.2 * coloured(scene(shown))
    assert (abs(shown - empty).sum(axis=-1) > 40).sum() > 5000


def scene(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The left part of a picture, below the menus."""
    return picture[70:-80, : picture.shape[1] * 3 // 5]


def settled(browser: Browser, shown: Callable[[NDArray[np.uint8]], bool], patience: float = 90.0) -> NDArray[np.uint8]:
    """A picture of the page, as soon as it shows something."""
    deadline = time.monotonic() + patience
    while not shown(picture := pixels(browser.screenshot())):
        assert time.monotonic() < deadline, "the browser shows nothing"
        time.sleep(0.5)
    return picture


@pytest.fixture
def free_port() -> int:
    import socket

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def peak_memory(log: Path, folder: Path) -> int:
    """The most memory that a conversion held [bytes]."""
    code = f"""
import resource
from fuzzing.log_verbs import called
assert called(["replay", {str(log)!r}, "--save", {str(folder / "made.rrd")!r}])[0] == 0
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
"""
    path = os.pathsep.join([str(CHECKOUT), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    return int(done.stdout)


def write_long(path: Path, steps: int) -> Log:
    """A log of 16 kB a step."""
    random = np.random.default_rng(1)
    agents = [f"a.{row}" for row in range(50)]
    script = Script(path, {"a": group(*agents, shape={"circle": {"radius": 0.5}})}, buffered=False)
    for step in range(steps):
        now = step * STEP
        places = random.normal(size=(50, 2))
        script.say("/world/a/state", now, wire.encode_rows(places), "Rows")
        ahead = wire.encode_series(np.arange(20) * STEP + now, random.normal(size=(50, 20, 2)))
        script.say("/agents/a/intent", now, ahead, "SeriesRows", "x,y")
    return script.finish()


def test_memory_does_not_grow_with_the_log(tmp_path: Path) -> None:
    peaks = []
    for steps in (700, 2800):
        log = write_long(tmp_path / f"{steps}.mcap", steps)
        assert log.size > steps * 15e3
        peaks.append(peak_memory(log.path, tmp_path))
    # Room for how the allocators behave, far below the 34 MB by which the log grew.
    assert peaks[1] < peaks[0] + 15e6
