"""`symaware export`."""

import csv
import json
import os
import resource
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from pyarrow import parquet
from sample_log import write_sample
from simulating import COMMAND, Command, present, untyped

from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log.writer import LogWriter

TARGETS = ["parquet", "csv", "foxglove"]


@pytest.fixture(scope="session")
def recorded(scenarios: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recorded") / "hello.mcap"
    execute(build(scenarios / "hello.yaml", ["run.duration=1"], None), path)
    return path


@pytest.fixture
def log(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(recorded, tmp_path))


def test_it_names_the_written_tables(log: Path, command: Command, tmp_path: Path) -> None:
    done = command("export", log, "--format", "parquet", "--output", "tables")
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert lines[0].startswith(f"{log}: ")
    assert lines[0].endswith(" in tables")
    listed = {line.split()[0] for line in lines[3:]}
    folder = tmp_path / "tables"
    assert listed == {path.relative_to(folder).as_posix() for path in folder.rglob("*.parquet")}
    assert "state/robot.parquet" in listed
    assert parquet.read_table(tmp_path / "tables" / "state" / "robot.parquet").num_rows == 80


def test_without_an_output_it_is_named_after_the_log(log: Path, command: Command, tmp_path: Path) -> None:
    for target, name in (("csv", "hello-csv"), ("foxglove", "hello-foxglove.mcap")):
        assert command("export", log, "--format", target).returncode == 0
        assert (tmp_path / name).exists()


def test_tables_fields_agents_and_times_can_be_chosen(log: Path, command: Command, tmp_path: Path) -> None:
    chosen = ("--fields", "state, world", "--agents", "robot.1", "--from", "0.5", "--to", "0.75")
    assert command("export", log, "--format", "csv", *chosen).returncode == 0
    with open(tmp_path / "hello-csv" / "state" / "robot.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["time"] for row in rows] == ["0.5", "0.55", "0.6", "0.65", "0.7", "0.75"]
    assert {row["agent"] for row in rows} == {"robot.1"}
    assert not (tmp_path / "hello-csv" / "control").exists()


def test_scripts_receive_json(log: Path, command: Command) -> None:
    report = json.loads(command("export", log, "--format", "csv", "--json").stdout)
    assert (report["output"], report["damage"]) == ("hello-csv", None)
    state = next(table for table in report["tables"] if table["file"] == "state/robot.csv")
    assert (state["rows"], state["columns"]) == (80, ["time", "agent", "x", "y", "heading"])
    report = json.loads(command("export", log, "--format", "foxglove", "--json").stdout)
    assert report["topics"]["/tf/robot"] == 21


def test_foxglove_gets_one_file(log: Path, command: Command, tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_text("what was there before")
    done = command("export", log, "--format", "foxglove", "--output", "run.mcap")
    assert (done.returncode, done.stderr) == (0, "")
    with open(tmp_path / "run.mcap", "rb") as file:
        schemas = {schema.name for schema in present(make_reader(file).get_summary()).schemas.values()}
    assert {"foxglove.SceneUpdate", "foxglove.FrameTransforms", "foxglove.Log"} <= schemas


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--format", "csv", "--fields", "rsk"), "did you mean `risk`?"),
        (("--format", "csv", "--agents", "robt.1"), "did you mean `robot.1`?"),
        (("--format", "csv", "--from", "2", "--to", "1"), "--from 2 is later than --to 1"),
        (("--format", "csv", "--from", "nan"), "--from takes a time in seconds"),
        (("--format", "foxglove", "--agents", "robot.1"), "--agents does not go with foxglove"),
        (("--format", "foxglove", "--output", "hello.mcap"), "it is an input file"),
        (("--format", "csv", "--output", "."), "it is not an empty folder"),
    ],
)
def test_wrong_options_are_reported_in_a_sentence_and_leave_no_file(
    log: Path, command: Command, tmp_path: Path, options: tuple[str, ...], said: str
) -> None:
    before = log.read_bytes()
    done = command("export", log.name, *options)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["hello.mcap"]
    assert log.read_bytes() == before


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("empty", "empty.mcap is empty"),
        ("junk", "junk.mcap is not a log"),
        ("newer", "newer.mcap was written by a newer SymAware"),
        ("foreign", "foreign.mcap was not written by SymAware"),
        ("missing", "there is no file missing.mcap"),
    ],
)
def test_a_file_that_is_no_log_of_symaware_is_wrong_input(
    name: str, said: str, command: Command, tmp_path: Path
) -> None:
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "junk.mcap").write_bytes(b"junk")
    with LogWriter(tmp_path / "newer.mcap") as newer:
        newer.attach("manifest.json", "application/json", b'{"format": 2}')
    with open(tmp_path / "foreign.mcap", "wb") as file:
        foreign = Writer(file)
        foreign.start(profile="ros2")
        untyped(foreign).finish()
    before = sorted(path.name for path in tmp_path.iterdir())
    for target in TARGETS if name == "foreign" else ["csv"]:
        done = command("export", f"{name}.mcap", "--format", target)
        assert (done.returncode, done.stdout) == (2, "")
        assert said in done.stderr
        assert len(done.stderr.splitlines()) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == before


@pytest.mark.parametrize("target", ["csv", "foxglove"])
def test_of_a_log_that_breaks_off_the_rest_is_exported_with_exit_status_3(
    log: Path, command: Command, target: str
) -> None:
    log.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    done = command("export", log, "--format", target, "--output", "out")
    assert done.returncode == 3
    assert "the end of the run is missing" in done.stderr
    assert "out" in done.stdout


@pytest.mark.parametrize("target", TARGETS)
def test_a_full_disk_is_reported_in_a_sentence_and_leaves_no_file(
    log: Path, command: Command, target: str, tmp_path: Path
) -> None:
    done = command(
        *("export", log, "--format", target, "--output", "out"),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000)),
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "symaware: cannot write out: the file would be larger than allowed here\n"
    assert [path.name for path in tmp_path.iterdir()] == ["hello.mcap"]


@pytest.mark.parametrize("target", ["parquet", "foxglove"])
def test_a_file_system_that_fills_up_is_reported_in_a_sentence_and_leaves_no_file(
    log: Path, command: Command, target: str, tmp_path: Path
) -> None:
    mounted = tmp_path / "disk"
    mounted.mkdir()
    made = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=8k", "tmpfs", str(mounted)], capture_output=True, check=False
    )
    if made.returncode:
        pytest.skip("mounting a small file system takes rights that are not given here")
    try:
        done = command("export", log, "--format", target, "--output", mounted / "out")
        assert (done.returncode, done.stderr) == (1, f"symaware: cannot write {mounted / 'out'}: the disk is full\n")
        assert list(mounted.iterdir()) == []
    finally:
        subprocess.run(["umount", str(mounted)], check=True)


@pytest.mark.parametrize("target", ["csv", "foxglove"])
def test_a_place_that_cannot_be_written_is_a_failure_of_the_machine(log: Path, command: Command, target: str) -> None:
    done = command("export", log, "--format", target, "--output", "nowhere/out")
    assert done.returncode == 1
    assert done.stderr == "symaware: cannot write nowhere/out: its folder does not exist\n"


@pytest.mark.parametrize(
    ("target", "module", "status"),
    [("parquet", "pyarrow", 2), ("foxglove", "foxglove_schemas_protobuf", 2), ("csv", "pyarrow", 0)],
)
def test_missing_libraries_are_named_with_the_command_that_installs_them(
    log: Path, command: Command, tmp_path: Path, target: str, module: str, status: int
) -> None:
    hide = f"import sys; sys.modules[{module!r}] = None; from symaware_cli.cli import main; main()"
    done = subprocess.run(
        [COMMAND[0], "-P", "-c", hide, "export", str(log), "--format", target],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={**os.environ},
    )
    assert done.returncode == status, done.stderr
    if status:
        assert "pip install 'symaware-cli[export]'" in done.stderr
        assert len(done.stderr.splitlines()) == 1
        assert [path.name for path in tmp_path.iterdir()] == ["hello.mcap"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_export_that_is_ended_leaves_nothing(number: signal.Signals, tmp_path: Path) -> None:
    log = write_sample(tmp_path / "sample.mcap", steps=3000, flush_every=100)
    line = [*COMMAND, "export", str(log), "--format", "csv", "--output", str(tmp_path / "out")]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and len(list(tmp_path.iterdir())) < 2:
            time.sleep(0.005)
        process.send_signal(number)
        said = process.communicate(timeout=60)
    assert (process.returncode, said) == (130, ("", "symaware: interrupted; nothing was saved\n"))
    assert [path.name for path in tmp_path.iterdir()] == ["sample.mcap"]
