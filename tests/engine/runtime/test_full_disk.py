"""A disk that is full is a clear error, and what was written before stays readable."""

import os
import resource
import subprocess
from pathlib import Path
from typing import Any

import pytest
from checkout import CHECKOUT
from simulating import COMMAND, Command, present
from small_disk import on_a_small_disk

from symaware_cli import open_log

SCENARIO = """
symaware: 1
name: bulky
run: {duration: 100000.0}
environment: {use: kinematic}
agents:
  robot: {count: 4, model: {use: unicycle}, components: {bulk: {use: doubles.bulky}}}
"""
QUIET = """
symaware: 1
name: quiet
run: {duration: 1.0}
environment: {use: kinematic}
agents: {robot: {model: {use: unicycle}}}
"""
LIMIT = 2_000_000


@pytest.mark.parametrize("options", [["--quiet"], ["--json"]])
def test_a_run_that_may_write_no_more_reports_it_and_exits_1(
    options: Any, doubles: Path, process: Command, tmp_path: Path
) -> None:
    (tmp_path / "bulky.yaml").write_text(SCENARIO)
    done = process(
        *("run", "bulky.yaml", *options),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT, LIMIT)),
    )
    assert done.returncode == 1
    said = done.stdout if "--json" in options else done.stderr
    assert "cannot write the log bulky.mcap: the file would be larger than allowed here" in said
    assert len((done.stdout + done.stderr).splitlines()) <= 3
    log = open_log(tmp_path / "bulky.mcap")
    assert present(log.end_time) > 0
    assert (tmp_path / "bulky.mcap").stat().st_size > LIMIT * 0.7
    if "--quiet" in options:
        inspected = process("inspect", "bulky.mcap")
        assert inspected.returncode == 3
        assert "breaks off after" in inspected.stdout
        assert "bulk" in inspected.stdout


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="only Linux has /dev/full")
def test_a_disk_that_is_full_from_the_start_is_reported_in_a_sentence(process: Command, tmp_path: Path) -> None:
    (tmp_path / "quiet.yaml").write_text(QUIET)
    done = process("run", "quiet.yaml", "--output", "/dev/full")
    assert done.returncode == 1
    assert done.stderr.startswith("symaware: cannot write the log /dev/full: the disk is full")
    assert len(done.stderr.splitlines()) == 1


def test_a_file_system_that_fills_up_is_reported_in_a_sentence(doubles: Path, tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "bulky.yaml").write_text(SCENARIO)
    symaware = " ".join(COMMAND)
    script = f"{symaware} run ../bulky.yaml --quiet --output run.mcap; echo $?; {symaware} inspect run.mcap; echo $?"
    done = on_a_small_disk(tmp_path / "disk", ["bash", "-c", script], size="1m")
    assert done.stderr.startswith("symaware: cannot write the log run.mcap: the disk is full; the data written before")
    assert len(done.stderr.splitlines()) == 1
    lines = done.stdout.splitlines()
    assert (lines[0], lines[-3:]) == ("1", ["3", "old", "run.mcap"])
    assert "breaks off after" in done.stdout


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="only Linux has /dev/full")
@pytest.mark.parametrize("verb", [["run", "quiet.yaml", "--no-record"], ["validate", "quiet.yaml"], ["list"]])
def test_an_output_that_is_full_is_a_sentence_too(verb: Any, process: Command, tmp_path: Path) -> None:
    (tmp_path / "quiet.yaml").write_text(QUIET)
    with open("/dev/full", "w") as full:
        done = process(*verb, capture_output=False, stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 1
    assert done.stderr == "symaware: cannot write the output: the disk is full\n"


def test_a_reader_that_goes_away_is_no_failure_worth_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    line = f"{COMMAND[0]} -P -m symaware_cli schema | head -c 1"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=60, check=False)
    assert (done.stdout, done.stderr) == ("{", "")


def test_a_worker_of_a_sweep_reports_a_full_disk_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    hello = CHECKOUT / "scenarios" / "hello.yaml"
    options = ["--runs", "40", "--with", "keep=all", "--jobs", "2", "--quiet", "-o", "out"]
    line = [*COMMAND, "sweep", str(hello), *options]
    done = on_a_small_disk(tmp_path / "disk", line, size="300k")
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    assert "the disk is full" in done.stderr
    assert len(done.stderr.strip().splitlines()) <= 2, done.stderr
