"""`symaware recover`."""

import json
import resource
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from sample_log import write_sample
from simulating import COMMAND, Command
from small_disk import on_a_small_disk
from typer.testing import CliRunner, Result

from symaware_cli import open_log
from symaware_cli.cli.application import application

STEP = 50_000_000


@pytest.fixture
def recover() -> Callable[..., Result]:
    """Run `symaware recover ARGUMENTS` in this process."""

    def run(*arguments: object) -> Result:
        done = CliRunner().invoke(application, ["recover", *map(str, arguments)])
        assert done.exception is None or isinstance(done.exception, SystemExit), done.exc_info
        return done

    return run


@pytest.fixture
def broken(tmp_path: Path) -> Path:
    """A log that breaks off in its sixth chunk."""
    path = write_sample(tmp_path / "broken.mcap")
    span = open_log(path).index.spans[5]
    path.write_bytes(path.read_bytes()[: span.offset + 100])
    return path


def test_it_writes_a_sound_log_beside_the_broken_one_and_reports_the_loss(
    broken: Path, recover: Callable[..., Result], tmp_path: Path
) -> None:
    done = recover(broken)
    assert (done.exit_code, done.stderr) == (3, "")
    new = tmp_path / "broken.recovered.mcap"
    lines = done.stdout.splitlines()
    assert lines[0].startswith(f"{new}: ")
    assert lines[1] == "  kept  193 messages, 0 to 1.2 s; 4 attachments"
    assert lines[2] == (
        "  lost  the log breaks off after 1.2 s of simulated time and the end of the run is missing; "
        "100 bytes at the end of the file cannot be read"
    )
    found = open_log(new)
    assert found.verify() is None
    assert (found.message_count, found.end_time) == (193, 24 * STEP)
    assert [m.data for m in found.messages()] == [m.data for m in open_log(broken).messages()]


def test_the_json_has_the_same(broken: Path, recover: Callable[..., Result], tmp_path: Path) -> None:
    done = recover(broken, "--json", "-o", tmp_path / "new.mcap")
    assert (done.exit_code, done.stderr) == (3, "")
    assert json.loads(done.stdout) == {
        "log": str(broken),
        "lost": True,
        "damage": {
            "text": str(open_log(broken).damage),
            "end_missing": True,
            "summary_missing": True,
            "chunks": 0,
            "attachments": 0,
            "bytes": 100,
            "gaps": [],
            "missing_from": 1.2,
        },
        "recovered": {
            "log": str(tmp_path / "new.mcap"),
            "size": (tmp_path / "new.mcap").stat().st_size,
            "messages": 193,
            "chunks": 5,
            "attachments": 4,
            "start": 0.0,
            "end": 1.2,
        },
    }


def test_it_overwrites_no_file_without_permission(broken: Path, recover: Callable[..., Result], tmp_path: Path) -> None:
    for name in ("broken.recovered", "broken.recovered-2", "broken.recovered-3"):
        recover(broken)
        assert open_log(tmp_path / f"{name}.mcap").verify() is None
    (tmp_path / "mine.mcap").write_text("mine")
    recover(broken, "-o", tmp_path / "mine.mcap")
    assert open_log(tmp_path / "mine.mcap").message_count == 193


def test_a_sound_log_is_reported_as_sound_and_nothing_is_written(
    recover: Callable[..., Result], tmp_path: Path
) -> None:
    path = write_sample(tmp_path / "log.mcap")
    done = recover(path)
    assert (done.exit_code, done.stdout) == (0, f"{path} is sound: there is nothing to recover\n")
    found = json.loads(recover(path, "--json").stdout)
    assert found == {"log": str(path), "lost": False, "damage": None, "recovered": None}
    assert [each.name for each in tmp_path.iterdir()] == ["log.mcap"]
    done = recover(path, "--output", tmp_path / "copy.mcap")
    assert done.exit_code == 0
    assert done.stdout.splitlines()[2] == "  lost  nothing"
    assert open_log(tmp_path / "copy.mcap").recovery is None


def test_a_repair_without_losses_has_exit_status_0(recover: Callable[..., Result], tmp_path: Path) -> None:
    path = write_sample(tmp_path / "log.mcap")
    path.write_bytes(path.read_bytes()[:-1])
    done = recover(path)
    assert done.exit_code == 0
    assert done.stdout.splitlines()[2].startswith("  lost  nothing: the summary at the end of the file is damaged")
    assert open_log(tmp_path / "log.recovered.mcap").outcome == {"status": "done", "steps": 40}


def test_a_recovered_log_is_as_good_as_any_for_other_verbs(broken: Path, command: Command, tmp_path: Path) -> None:
    assert command("recover", broken, "-o", "new.mcap").returncode == 3
    for arguments in (["inspect"], ["log", "events"], ["log", "digest"], ["recover"]):
        assert command(*arguments, "new.mcap").returncode == 0
    before, after = (command("log", "digest", name).stdout for name in (broken, "new.mcap"))
    assert before == after


@pytest.mark.parametrize(
    ("place", "status", "sentence"),
    [
        ("broken.mcap", 2, "it is an input file"),
        (".", 2, "it is a folder"),
        ("missing/new.mcap", 1, "its folder does not exist"),
        ("broken.mcap/new.mcap", 1, "part of its path is not a folder"),
    ],
)
def test_an_unwritable_place_is_reported(
    broken: Path,
    recover: Callable[..., Result],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    place: str,
    status: int,
    sentence: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    before = broken.read_bytes()
    done = recover("broken.mcap", "-o", place)
    assert (done.exit_code, done.stdout) == (status, "")
    assert done.stderr == f"symaware: cannot write {place}: {sentence}\n"
    assert sentence in json.loads(recover("broken.mcap", "-o", place, "--json").stdout)["error"]
    assert broken.read_bytes() == before
    assert [each.name for each in tmp_path.iterdir()] == ["broken.mcap"]


def test_a_disk_that_fills_up_is_reported_and_leaves_no_partial_file(broken: Path, tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    done = on_a_small_disk(tmp_path / "disk", [*COMMAND, "recover", str(broken), "-o", "new.mcap"], size="20k")
    assert (done.returncode, done.stdout) == (1, "old\n")
    assert done.stderr == "symaware: cannot write new.mcap: the disk is full\n"


def test_a_file_that_may_not_grow_is_reported_and_leaves_no_partial_file(
    broken: Path, command: Command, tmp_path: Path
) -> None:
    limit = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (10_000, 10_000))
    done = command("recover", broken, "-o", "new.mcap", preexec_fn=limit)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "symaware: cannot write new.mcap: the file would be larger than allowed here\n"
    assert [each.name for each in tmp_path.iterdir()] == ["broken.mcap"]
