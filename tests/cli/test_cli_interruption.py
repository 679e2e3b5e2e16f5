"""Ctrl-C in any verb that writes: status 130, and a sentence that says what was saved."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

import symaware_cli as sa
from symaware_cli.cli.terminal import interruption

#: One process makes the run whose log several of these tests read.
pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("interruption")]

SCENARIO = """\
symaware: 1
name: long
run: {{duration: {duration}}}
environment: {{use: kinematic, with: {{time_step: 0.1}}}}
parameters: {{gain: 1.0}}
agents:
  robot:
    model: {{use: unicycle, with: {{max_speed: 1, process_noise: 0.1}}}}
    state: [0, 0, 0]
    knowledge: {{goal: [3, 0]}}
    components: {{steer: {{use: control.go-to-goal}}}}
specifications: {{safe: {{each: robot, formula: "always x < 1000"}}}}
"""

LONG, OFTEN = "1.0e6", "1000000"

#: Verbs that write, with what exists when they are to be interrupted, and what they then say is saved.
CASES: dict[str, tuple[Sequence[str], str, str]] = {
    "run": (["run", "long.yaml", "-o", "it.mcap"], "it.mcap", "it.mcap"),
    "run quietly": (["run", "long.yaml", "-q", "-o", "it.mcap"], "it.mcap", "saved: it.mcap"),
    "sweep": (["sweep", "short.yaml", "--runs", OFTEN, "-o", "it", "--jobs", "1"], "it", "it: interrupted"),
    "sweep quietly": (
        ["sweep", "short.yaml", "--runs", OFTEN, "-q", "-o", "it", "--jobs", "1"],
        "it",
        "saved: it with",
    ),
    "falsify": (["falsify", "long.yaml", "--specification", "safe", "--seeds", "9", "--jobs", "0"], "", "nothing was"),
    "estimate": (
        ["estimate", "long.yaml", "--specification", "safe", "--levels", "none", "--jobs", "0"],
        "",
        "nothing",
    ),
    "branch": (
        ["branch", "ended.mcap", "--at", "2900.0", "--set", "run.duration=1e6", "-o", "it.mcap"],
        "",
        "interrupted",
    ),
    "export": (["export", "ended.mcap", "--format", "csv", "-o", "it"], "", "nothing was saved"),
    "replay": (["replay", "ended.mcap", "--save", "it.rrd"], "", "nothing was saved"),
    "video": (["replay", "ended.mcap", "--video", "it.gif"], "", "nothing was saved"),
}


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a run that is over, long enough that what reads it can be interrupted."""
    folder = tmp_path_factory.mktemp("ended")
    (folder / "ended.yaml").write_text(SCENARIO.format(duration="3000.0"))
    assert sa.load(folder / "ended.yaml").run(output=folder / "ended.mcap").status == "finished"
    return folder / "ended.mcap"


@pytest.fixture
def started(tmp_path: Path) -> Callable[..., subprocess.Popen[str]]:
    for name, duration in (("long", LONG), ("short", "1.0")):
        (tmp_path / f"{name}.yaml").write_text(SCENARIO.format(duration=duration))

    def start(*words: str) -> subprocess.Popen[str]:
        line = [sys.executable, "-P", "-m", "symaware_cli", *words]
        return subprocess.Popen(line, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    return start


@pytest.mark.parametrize("case", CASES)
def test_an_interrupted_verb_names_the_saved_files(
    case: str, started: Callable[..., subprocess.Popen[str]], tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    words, begun, expected = CASES[case]
    if "ended.mcap" in words:
        (tmp_path / "ended.mcap").symlink_to(request.getfixturevalue("ended"))
    process = started(*words)
    deadline = time.monotonic() + 60
    while begun and not (tmp_path / begun).exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    # Until the verb works, rather than is imported.
    cpu_time_of(process, 1.5)
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=120)
    said = output + errors
    assert process.returncode == 130, said
    assert expected in said
    assert "Traceback" not in said


def cpu_time_of(process: subprocess.Popen[str], seconds: float) -> None:
    """Wait until a process has used so much CPU time [s], or has ended."""
    used = 0.0
    while process.poll() is None and used < seconds:
        fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
        used = (int(fields[11]) + int(fields[12])) / 100.0
        time.sleep(0.05)


def test_only_existing_files_are_reported_as_saved(tmp_path: Path) -> None:
    there = tmp_path / "there.mcap"
    there.touch()
    assert interruption([there, tmp_path / "gone.mcap"]) == f"interrupted; saved: {there}"
    assert interruption([]) == "interrupted; nothing was saved"
