"""`symaware merge`."""

import json
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from parts import split, write_part
from sample_log import write_sample
from simulating import COMMAND
from small_disk import on_a_small_disk
from typer.testing import CliRunner, Result

from symaware_cli import open_log
from symaware_cli.cli.application import application

STEP = 50_000_000


@pytest.fixture
def merge(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Callable[..., Result]]:
    """Run `symaware merge ARGUMENTS` in this process, in the folder of the parts."""
    monkeypatch.chdir(tmp_path)
    before = signal.getsignal(signal.SIGTERM)

    def run(*arguments: object) -> Result:
        done = CliRunner().invoke(application, ["merge", *map(str, arguments)])
        assert done.exception is None or isinstance(done.exception, SystemExit), done.exc_info
        return done

    yield run
    signal.signal(signal.SIGTERM, before)


@pytest.fixture
def sample(tmp_path: Path) -> Path:
    """The log of a whole run."""
    return write_sample(tmp_path / "sample.mcap")


@pytest.fixture
def parts(sample: Path, tmp_path: Path) -> tuple[str, str]:
    """`host.mcap` and `left.mcap`."""
    split(sample, tmp_path, {"left": ["robot.1", "car"]})
    return "host.mcap", "left.mcap"


@pytest.fixture
def killed(sample: Path, parts: tuple[str, str]) -> str:
    """A member of which the second half is missing."""
    whole = open_log(sample)
    return write_part(whole, sample.parent / "left.mcap", "left", ["robot.1", "car"], until=20 * STEP, end="kill").name


def test_it_names_the_merged_logs(parts: tuple[str, str], merge: Callable[..., Result]) -> None:
    done = merge("left.mcap", "host.mcap", "-o", "whole.mcap")
    assert (done.exit_code, done.stderr) == (0, "")
    head, *table = done.stdout.splitlines()
    count = open_log("whole.mcap").message_count
    assert head.startswith(f"whole.mcap: {count} messages, ")
    # By both: 16 events, contacts and stages of messages, and 40 times that everybody of the group knows the world.
    assert head.endswith("kB; 56 that stand in several parts are written once")
    assert table == [
        "",
        "  part  agents  from [s]  until [s]  log",
        "  host       2         0       1.95  host.mcap",
        "  left       2         0       1.95  left.mcap",
    ]


def test_the_json_has_the_same(parts: tuple[str, str], merge: Callable[..., Result]) -> None:
    done = merge(*parts, "-o", "whole.mcap", "--json")
    assert (done.exit_code, done.stderr) == (0, "")
    log = open_log("whole.mcap")
    shared = {"start": 0.0, "end": 1.95, "damage": None}
    assert json.loads(done.stdout) == {
        "log": "whole.mcap",
        "size": log.size,
        "messages": log.message_count,
        "repeated": 56,
        "start": 0.0,
        "end": 1.95,
        "lost": False,
        "missing": [],
        "parts": [
            {"log": "host.mcap", "name": "host", "host": True, "agents": ["robot.0", "robot.2"], **shared},
            {"log": "left.mcap", "name": "left", "host": False, "agents": ["robot.1", "car"], **shared},
        ],
    }


def test_the_loss_of_a_process_is_reported_with_exit_status_3(killed: str, merge: Callable[..., Result]) -> None:
    done = merge("host.mcap", killed, "-o", "whole.mcap")
    assert done.exit_code == 3
    assert done.stdout.splitlines()[-1].split() == ["left", "2", "0", "0.95", "left.mcap"]
    assert done.stderr == (
        "symaware: left.mcap: the log breaks off after 0.95 s of simulated time and the end of the run is missing\n"
    )
    found = json.loads(merge("host.mcap", killed, "-o", "whole.mcap", "--json").stdout)
    assert (found["lost"], found["parts"][0]["damage"]) == (True, None)
    assert found["parts"][1]["damage"].startswith("the log breaks off after 0.95 s")


@pytest.mark.parametrize(
    ("given", "missing"), [(["host.mcap"], ["robot.1", "car"]), (["host.mcap", "right.mcap"], ["robot.1"])]
)
def test_agents_that_no_part_ran_are_reported_with_exit_status_3(
    sample: Path, merge: Callable[..., Result], tmp_path: Path, given: list[str], missing: list[str]
) -> None:
    split(sample, tmp_path, {"left": ["robot.1"], "right": ["car"]})
    done = merge(*given, "-o", "whole.mcap")
    sentence = (
        f"no part ran {' and '.join(missing)}, so what they knew and did is missing: name the logs of all processes"
    )
    assert (done.exit_code, done.stderr) == (3, f"symaware: {sentence}\n")
    found = merge(*given, "-o", "whole.mcap", "--json")
    assert found.exit_code == 3
    assert {key: json.loads(found.stdout)[key] for key in ("lost", "missing")} == {"lost": True, "missing": missing}
    # Whoever reads the merged log is told, too.
    assert sentence in CliRunner().invoke(application, ["inspect", "whole.mcap"]).stdout


def test_a_part_of_a_process_that_came_back_begins_when_its_agents_do(
    sample: Path, parts: tuple[str, str], merge: Callable[..., Result], tmp_path: Path
) -> None:
    whole = open_log(sample)
    write_part(whole, tmp_path / "left.mcap", "left", ["robot.1", "car"], until=20 * STEP)
    # What it repeats of the beginning is no turn of its agents.
    late = write_part(whole, tmp_path / "late.mcap", "left", ["robot.1", "car"], start=30 * STEP, begun=True)
    assert open_log(late).start_time == 0
    done = merge("host.mcap", "left.mcap", "late.mcap", "-o", "whole.mcap")
    assert done.stdout.splitlines()[-1].split() == ["left", "2", "1.5", "1.95", "late.mcap"]
    found = json.loads(merge("host.mcap", "left.mcap", "late.mcap", "-o", "whole.mcap", "--json").stdout)
    assert [part["start"] for part in found["parts"]] == [0.0, 0.0, 1.5]


def test_the_merged_log_is_sound_and_names_the_losses(killed: str, merge: Callable[..., Result]) -> None:
    merge("host.mcap", killed, "-o", "whole.mcap")
    done = CliRunner().invoke(application, ["inspect", "whole.mcap"])
    assert done.exit_code == 0
    assert "recovered from left.mcap: the log breaks off after 0.95 s" in done.stdout


def test_a_whole_log_is_called_that(sample: Path, merge: Callable[..., Result]) -> None:
    done = merge("sample.mcap", "-o", "whole.mcap")
    assert done.exit_code == 0
    assert done.stdout.splitlines()[-1].split() == ["(whole)", "4", "0", "1.95", "sample.mcap"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["left.mcap"], "the host's part is missing: name it beside left.mcap, which is a member's"),
        (["host.mcap", "none.mcap"], "there is no file none.mcap"),
        (["host.mcap", "host.mcap"], "host.mcap is named twice: name each part once"),
        (["host.mcap", "sample.mcap"], "sample.mcap is the log of a whole run and no part of one: leave it out"),
        (["host.mcap", "note.txt"], "note.txt is not a log: it does not begin like an MCAP"),
    ],
)
def test_wrong_input_is_a_sentence_and_exit_status_2(
    parts: tuple[str, str], merge: Callable[..., Result], tmp_path: Path, arguments: list[str], sentence: str
) -> None:
    (tmp_path / "note.txt").write_text("This is a note.")
    done = merge(*arguments, "-o", "whole.mcap")
    assert (done.exit_code, done.stdout, done.stderr) == (2, "", f"symaware: {sentence}\n")
    assert json.loads(merge(*arguments, "-o", "whole.mcap", "--json").stdout) == {"error": sentence}
    assert not (tmp_path / "whole.mcap").exists()


@pytest.mark.parametrize(
    ("place", "status", "sentence"),
    [
        ("left.mcap", 2, "it is an input file"),
        (".", 2, "it is a folder"),
        ("missing/whole.mcap", 1, "its folder does not exist"),
        ("host.mcap/whole.mcap", 1, "part of its path is not a folder"),
    ],
)
def test_an_unwritable_place_is_reported(
    parts: tuple[str, str], merge: Callable[..., Result], tmp_path: Path, place: str, status: int, sentence: str
) -> None:
    before = sorted((path.name, path.read_bytes()) for path in tmp_path.iterdir())
    done = merge(*parts, "-o", place)
    assert (done.exit_code, done.stdout) == (status, "")
    assert done.stderr == f"symaware: cannot write {place}: {sentence}\n"
    assert sorted((path.name, path.read_bytes()) for path in tmp_path.iterdir()) == before


def test_an_output_is_asked_for(parts: tuple[str, str], merge: Callable[..., Result]) -> None:
    done = merge(*parts)
    assert done.exit_code == 2
    assert "--output" in done.stderr


def test_a_disk_that_fills_up_is_reported_and_leaves_no_partial_file(parts: tuple[str, str], tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    line = [*COMMAND, "merge", *(str(tmp_path / part) for part in parts), "-o", "whole.mcap"]
    done = on_a_small_disk(tmp_path / "disk", line, size="20k")
    assert (done.returncode, done.stdout) == (1, "old\n")
    assert done.stderr == "symaware: cannot write whole.mcap: the disk is full\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_merge_that_is_ended_leaves_nothing(number: signal.Signals, tmp_path: Path) -> None:
    log = write_sample(tmp_path / "sample.mcap", steps=5000, flush_every=100)
    line = [*COMMAND, "merge", str(log), "--output", str(tmp_path / "whole.mcap")]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and len(list(tmp_path.iterdir())) < 2:
            time.sleep(0.005)
        process.send_signal(number)
        said = process.communicate(timeout=60)
    assert (process.returncode, said) == (130, ("", "symaware: interrupted; nothing was saved\n"))
    assert [path.name for path in tmp_path.iterdir()] == ["sample.mcap"]
