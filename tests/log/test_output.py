"""Files and folders appear whole or not at all."""

import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from small_disk import on_a_small_disk

from symaware_cli.log.error import LogError, OutputError
from symaware_cli.log.output import require_writable_file, require_writable_folder, whole_file, whole_folder


def listing(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*"))


@pytest.fixture(params=["file", "folder"])
def write(request: pytest.FixtureRequest) -> Callable[..., Any]:
    """Write something of a size at a path, as a file or as a folder with a file in it."""

    def write_file(path: Path, size: int = 1) -> None:
        with whole_file(path) as part:
            part.write_bytes(bytes(size))

    def write_folder(path: Path, size: int = 1) -> None:
        with whole_folder(path) as part:
            (part / "table.csv").write_bytes(bytes(size))

    return write_file if request.param == "file" else write_folder


def test_an_existing_file_stays_until_the_new_one_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(b"old")
    with whole_file(path) as part:
        assert (part.parent, part.suffix) == (tmp_path, ".mcap")
        part.write_bytes(b"half of the ")
        assert path.read_bytes() == b"old"
        with open(part, "ab") as file:
            file.write(b"new")
    assert path.read_bytes() == b"half of the new"
    assert listing(tmp_path) == ["log.mcap"]


def test_a_folder_appears_with_everything_in_it(tmp_path: Path) -> None:
    (tmp_path / "tables").mkdir()
    with whole_folder(tmp_path / "tables") as part:
        (part / "agents").mkdir()
        (part / "agents" / "a.csv").write_text("1")
        assert listing(tmp_path / "tables") == []
    assert listing(tmp_path / "tables") == ["a.csv", "agents"]
    assert listing(tmp_path) == ["a.csv", "agents", "tables"]


@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt, SystemExit])
def test_a_partial_file_is_removed_after_any_error(
    tmp_path: Path, error: type[KeyboardInterrupt | SystemExit | ZeroDivisionError]
) -> None:
    (tmp_path / "log.mcap").write_bytes(b"old")

    def begin_file() -> None:
        with whole_file(tmp_path / "log.mcap") as part:
            part.write_bytes(b"half")
            raise error

    def begin_folder() -> None:
        with whole_folder(tmp_path / "tables") as part:
            (part / "a.csv").write_text("half")
            raise error

    for begin in (begin_file, begin_folder):
        with pytest.raises(error):
            begin()
    assert listing(tmp_path) == ["log.mcap"]
    assert (tmp_path / "log.mcap").read_bytes() == b"old"


@pytest.mark.parametrize(
    ("place", "sentence"),
    [("missing/out", "its folder does not exist"), ("file/out", "part of its path is not a folder")],
)
def test_an_unwritable_place_is_reported(tmp_path: Path, write: Callable[..., Any], place: str, sentence: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError) as caught:
        write(tmp_path / place)
    assert str(caught.value) == f"cannot write {tmp_path / place}: {sentence}"
    assert listing(tmp_path) == ["file"]


@pytest.mark.parametrize("place", ["missing/out", "file/out"])
@pytest.mark.parametrize(
    ("whole", "check"), [(whole_file, require_writable_file), (whole_folder, require_writable_folder)]
)
def test_an_unwritable_place_is_found_before_any_work(tmp_path: Path, place: str, whole: Any, check: Any) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError), whole(tmp_path / place):
        pytest.fail("the block has begun")
    with pytest.raises(OutputError):
        check(tmp_path / place)


def test_a_check_leaves_what_is_there_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "log.mcap").write_bytes(b"old")
    require_writable_file(tmp_path / "log.mcap")
    require_writable_file(tmp_path / "new")
    assert listing(tmp_path) == ["log.mcap"]
    assert (tmp_path / "log.mcap").read_bytes() == b"old"
    with pytest.raises(LogError, match="it is an input file"):
        require_writable_file(tmp_path / "log.mcap", tmp_path / "log.mcap")


@pytest.mark.usefixtures("ordinary_rights")
def test_a_folder_without_permission_is_reported(tmp_path: Path, write: Any) -> None:
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept").chmod(0o500)
    with pytest.raises(OutputError, match="permission denied"):
        write(tmp_path / "kept" / "out")


WRITE = """
from symaware_cli.log.output import {0}
try:
    with {0}("out") as part:
        (part if "{0}" == "whole_file" else part / "table").write_bytes(bytes({1}))
except Exception as error:
    print(type(error).__name__, error)
"""


@pytest.mark.parametrize("kind", ["whole_file", "whole_folder"])
def test_a_read_only_file_system_is_reported(tmp_path: Path, kind: str) -> None:
    line = [sys.executable, "-c", WRITE.format(kind, 10)]
    done = on_a_small_disk(tmp_path, line, then="mount -o remount,ro .")
    assert done.stdout == "OutputError cannot write out: the file system is read-only\nold\n", done.stderr


@pytest.mark.parametrize("kind", ["whole_file", "whole_folder"])
def test_a_disk_that_fills_up_is_reported_and_left_as_it_was(tmp_path: Path, kind: str) -> None:
    done = on_a_small_disk(tmp_path, [sys.executable, "-c", WRITE.format(kind, 100_000)])
    assert done.stdout == "OutputError cannot write out: the disk is full\nold\n", done.stderr


@pytest.mark.parametrize("kind", ["whole_file", "whole_folder"])
def test_a_file_larger_than_allowed_is_reported_and_left_out(tmp_path: Path, kind: str) -> None:
    (tmp_path / "old").write_text("old")
    line = [sys.executable, "-c", WRITE.format(kind, 2000)]
    limit = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (1000, 1000))
    done = subprocess.run(line, cwd=tmp_path, preexec_fn=limit, capture_output=True, text=True, timeout=60)
    sentence = "OutputError cannot write out: the file would be larger than allowed here"
    assert done.stdout == f"{sentence}\n", done.stderr
    assert listing(tmp_path) == ["old"]


def test_the_source_is_not_overwritten_under_any_name(tmp_path: Path) -> None:
    source = tmp_path / "log.mcap"
    source.write_bytes(b"source")
    (tmp_path / "link.mcap").symlink_to(source)
    (tmp_path / "same.mcap").hardlink_to(source)
    for path in (source, tmp_path / "link.mcap", tmp_path / "same.mcap", tmp_path / "." / "log.mcap"):
        with pytest.raises(LogError, match="it is an input file") as caught, whole_file(path, source) as part:
            part.write_bytes(b"other")
        assert not isinstance(caught.value, OutputError)
    assert source.read_bytes() == b"source"
    assert listing(tmp_path) == ["link.mcap", "log.mcap", "same.mcap"]


def test_only_files_are_replaced_by_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for name, kind in (("pipe", "not a file"), ("folder", "a folder")):
        with pytest.raises(LogError, match=f"it is {kind}"), whole_file(tmp_path / name) as part:
            part.write_bytes(b"x")
    monkeypatch.chdir(tmp_path)
    for name in (".", "..", "/", ""):
        with pytest.raises(LogError, match="it is a folder"), whole_file(name) as part:
            part.write_bytes(b"x")
    assert (tmp_path / "pipe").is_fifo()
    assert listing(tmp_path) == ["folder", "pipe"]


def test_a_nonempty_folder_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "kept").write_text("kept")
    (tmp_path / "file").write_text("kept")
    for name in ("full", "file"):
        with pytest.raises(LogError, match="it is not an empty folder"), whole_folder(tmp_path / name) as part:
            (part / "x").write_text("x")
    assert listing(tmp_path) == ["file", "full", "kept"]


def test_an_empty_folder_may_be_the_present_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with whole_folder(".") as part:
        (part / "a.csv").write_text("1")
    assert listing(tmp_path) == ["a.csv", "here"]


def test_a_killed_process_leaves_the_existing_file(tmp_path: Path) -> None:
    (tmp_path / "out.mcap").write_bytes(b"old")
    code = """
from symaware_cli.log.output import whole_file
with whole_file("out.mcap") as part:
    part.write_bytes(b"half")
    print(flush=True)
    time.sleep(60)
"""
    process = subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == b"\n"
    finally:
        os.kill(process.pid, signal.SIGKILL)
        process.communicate()
    assert (tmp_path / "out.mcap").read_bytes() == b"old"
