"""`symaware plot`."""

import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.writer import Writer
from plot_logs import YARD, log_of
from simulating import Command, untyped

from symaware_cli.log.writer import LogWriter


@pytest.fixture(scope="module")
def yard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return log_of(tmp_path_factory.mktemp("yard"), YARD).path


def test_a_figure_of_the_log_is_drawn_beside_others_of_that_name(yard: Path, command: Command, tmp_path: Path) -> None:
    done = command("plot", yard)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"{yard.stem}.png: trajectories, separation, contacts, risk, speed; ")
    assert "closest" in done.stdout
    assert command("plot", yard, "--show", "risk").stdout.startswith(f"{yard.stem}-2.png: risk; ")
    assert all((tmp_path / f"{yard.stem}{number}.png").read_bytes()[1:4] == b"PNG" for number in ("", "-2"))
    assert len(os.listdir(tmp_path)) == 2


def test_a_name_that_is_given_is_used_and_gives_the_same_bytes_in_any_process(
    yard: Path, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for seed, name in (("1", "one.svg"), ("2", "two.svg")):
        monkeypatch.setenv("PYTHONHASHSEED", seed)
        (tmp_path / name).write_text("old")
        assert command("plot", yard, "--show", "trajectories", "-o", name).returncode == 0
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "two.svg").read_bytes()
    assert sorted(os.listdir(tmp_path)) == ["one.svg", "two.svg"]


def test_with_json_the_drawn_content_is_reported(yard: Path, command: Command, tmp_path: Path) -> None:
    line = ["plot", yard, "--json", "-o", "a.pdf", "--agents", "cart, guard", "--from", "0.5", "--to", "2.5"]
    told = json.loads(command(*line, "--show", "separation,risk", "--series", "cart.0:state:x").stdout)
    assert (told["file"], told["size"]) == ("a.pdf", (tmp_path / "a.pdf").stat().st_size)
    assert (told["agents"], told["start"], told["end"], told["damage"]) == (3, 0.5, 2.5, None)
    separation, risk, series = told["panels"]
    assert separation["agents"]["who"] == ["cart.0", "cart.1"]
    assert separation["agents"]["minimum"] < 0 < separation["agents"]["between_centres"]
    assert separation["obstacles"]["who"][1] in ("pillar", "fence", "gate")
    assert 0 <= risk["minimum"]["value"] <= risk["maximum"]["value"] <= 1
    assert (series["panel"], series["unit"], series["curves"]) == ("x", "m", 1)


def test_a_log_that_was_cut_off_is_drawn_as_far_as_it_goes_with_exit_status_3(
    command: Command, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    whole = log_of(tmp_path_factory.mktemp("whole"), "crossing.yaml", "run.duration=6").path
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 3 // 4])
    done = command("plot", cut, "--json", "--show", "risk")
    assert done.returncode == 3
    assert "breaks off after" in done.stderr
    told = json.loads(done.stdout)
    assert 1 < told["end"] < 6
    assert "breaks off after" in told["damage"]
    assert (tmp_path / "cut.png").stat().st_size == told["size"]


def test_a_file_that_is_no_log_of_symaware_is_wrong_input(command: Command, tmp_path: Path) -> None:
    (tmp_path / "junk.mcap").write_bytes(b"junk")
    with open(tmp_path / "foreign.mcap", "wb") as file:
        writer = Writer(file)
        writer.start()
        untyped(writer).finish()
    with LogWriter(tmp_path / "newer.mcap") as newer:
        newer.attach("manifest.json", "application/json", b'{"format": 999}')
    with LogWriter(tmp_path / "begun.mcap"):
        pass
    names = set(os.listdir(tmp_path))
    for name, said in {
        "junk": "is not a log",
        "foreign": "was not written by SymAware",
        "newer": "was written by a newer SymAware",
        "begun": "was cut off before",
    }.items():
        done = command("plot", f"{name}.mcap", "-o", "a.png")
        assert (done.returncode, done.stdout) == (2, "")
        assert said in done.stderr
        assert len(done.stderr.splitlines()) == 1
    assert set(os.listdir(tmp_path)) == names


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["-o", "a.pgn"], "did you mean `.png`?"),
        (["--series", "cart.0:state:headin"], "did you mean `heading`?"),
        (["--at", "nan"], "--at takes a time"),
        (["--size", "12"], "such as 12x8"),
    ],
    ids=" ".join,
)
def test_an_undrawable_series_is_reported_in_a_sentence(
    options: list[str], said: str, yard: Path, command: Command, tmp_path: Path
) -> None:
    done = command("plot", yard, *options)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert os.listdir(tmp_path) == []


def test_with_json_undrawable_series_are_reported_as_well(yard: Path, command: Command) -> None:
    told = json.loads(command("plot", yard, "--json", "--show", "seperation").stdout)
    assert told["error"].endswith("did you mean `separation`?")


def test_where_nothing_can_be_written_nothing_changes(yard: Path, command: Command, tmp_path: Path) -> None:
    assert command("plot", yard, "-o", "missing/a.png").returncode == 1
    (tmp_path / "a.png").write_text("old")
    done = command(
        *("plot", yard, "-o", "a.png", "--show", "risk"),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (5_000, 5_000)),
    )
    assert done.returncode == 1
    assert done.stderr == "symaware: cannot write a.png: the file would be larger than allowed here\n"
    assert (tmp_path / "a.png").read_text() == "old"
    assert os.listdir(tmp_path) == ["a.png"]


def test_without_matplotlib_the_error_has_the_command_that_installs_it(yard: Path, tmp_path: Path) -> None:
    code = "import sys; sys.modules['matplotlib'] = None; from symaware_cli.cli import main; main()"
    line = [sys.executable, "-c", code, "plot", str(yard)]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr.endswith("which is not installed: pip install 'symaware-cli[plot]'\n")
    assert len(done.stderr.splitlines()) == 1
