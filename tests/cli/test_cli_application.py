"""The command as a whole: its version, its help, its completion, and what it says to nonsense."""

import contextlib
import json
import os
import pty
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from sample_log import write_sample
from simulating import Command

import symaware_cli

SCRIPT = Path(sys.executable).parent / "symaware"
VERBS = {"run", "validate", "new", "inspect", "list", "show", "schema"}


def test_the_version_is_the_packages(command: Command) -> None:
    for arguments in (["--version"], ["--version", "run"]):
        done = command(*arguments)
        assert (done.returncode, done.stdout) == (0, f"symaware {symaware_cli.__version__}\n")


def test_help_names_every_verb_and_exit_status(command: Command) -> None:
    done = command("--help")
    assert done.returncode == 0
    words = set(done.stdout.split())
    assert words >= VERBS
    assert "130 interrupted" in done.stdout
    assert {command("run", option).stdout for option in ("-h", "--help")} == {command("run", "-h").stdout}


LIGHT = ["numpy", "scipy", "pydantic", "mcap", "yaml", "symaware_cli.language"]
LOG = ["mcap", "zstandard", "google.protobuf", "symaware_cli.log.writer", "symaware_cli.log.reader"]
RUNNING = [
    "symaware_cli.engine.runtime.run",
    "symaware_cli.engine.runtime.workers",
    "symaware_cli.engine.runtime.scheduler",
]
UNUSED = [
    "symaware_cli.specification",
    "symaware_cli.cli.help",
    "symaware_cli.engine.network.network",
    "symaware_cli.engine.network.transmission",
    "symaware_cli.engine.runtime.awaiting",
    "symaware_cli.engine.runtime.coroutine",
    "symaware_cli.geometry.articulation",
    "symaware_cli.geometry.region",
    "symaware_cli.language.fault_section",
    "symaware_cli.language.presence_section",
    "symaware_cli.language.specification_section",
    "symaware_cli.language.topology_section",
    "symaware_cli.log.log_message",
    "symaware_cli.world.probability_distribution",
    "symaware_cli.language.fault_builder",
    "symaware_cli.language.presence_builder",
    "symaware_cli.engine.runtime.scope",
    "symaware_cli.engine.runtime.replica",
]
SIMULATED = ["symaware_cli.core", "symaware_cli.world.model", "symaware_cli.world.entity", "yaml"]
HEAVY = ["scipy", "asyncio", "rerun", "matplotlib", "casadi", "pymunk", "pybullet", "networkx", "rich"]


@pytest.mark.parametrize(
    ("line", "unneeded"),
    [
        (["--version"], [*LIGHT, "typer", "typing", "re"]),
        (["--help"], [*LIGHT, "typer", "click", "rich"]),
        (["validate", "hello.yaml"], [*HEAVY, *LOG, *RUNNING, "symaware_cli.engine.faults"]),
        (
            ["run", "hello.yaml", "--output", "hello.mcap"],
            [*HEAVY, "symaware_cli.log.reader", "symaware_cli.engine.faults"],
        ),
        (["validate", "head-on.yaml"], UNUSED),
        (["run", "head-on.yaml", "--output", "head-on.mcap"], [*UNUSED, "numpy.random"]),
        (["inspect", "sample.mcap"], [*HEAVY, *RUNNING, *SIMULATED, "symaware_cli.cli.help"]),
        (
            ["validate", "errands.yaml"],
            [*LOG, *RUNNING, "symaware_cli.engine.faults.replace", "symaware_cli.engine.faults.blind"],
        ),
    ],
    ids=lambda value: " ".join(value[:2]),
)
def test_a_verb_imports_nothing_heavy_that_it_does_not_need(
    line: list[str], unneeded: list[str], scenarios: Path, tmp_path: Path
) -> None:
    line = [str(scenarios / word) if word.endswith(".yaml") else word for word in line]
    if "sample.mcap" in line:
        write_sample(tmp_path / "sample.mcap")
    code = (
        f"import sys; sys.argv = ['symaware', *{line!r}]\ntry:\n from symaware_cli.cli import main; main()\nfinally:\n"
    )
    code += f" print('imported', [name for name in {unneeded!r} if name in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "imported []"


@pytest.mark.parametrize(
    "arguments",
    [
        ["rnu"],
        ["run"],
        ["run", "--sede", "1", "x.yaml"],
        ["run", "x.yaml", "y.yaml"],
        ["run", "x.yaml", "--seed", "-1"],
        ["run", "x.yaml", "--seed", "one"],
        ["run", "x.yaml", "--set"],
        ["validate"],
        ["show"],
        ["show", "nonsense"],
        ["list", "nonsense"],
        ["inspect"],
        ["log", "evnts", "x.mcap"],
        ["rows"],
        ["new"],
        ["new", "a/b"],
        ["--nonsense"],
    ],
    ids=" ".join,
)
def test_nonsense_is_wrong_input_reported_without_a_traceback(
    arguments: list[str], command: Command, tmp_path: Path
) -> None:
    done = command(*arguments)
    assert done.returncode == 2
    assert done.stderr.strip()
    assert os.listdir(tmp_path) == []


def test_without_anything_it_shows_its_help(command: Command) -> None:
    done = command()
    assert "Usage" in done.stdout + done.stderr
    assert set((done.stdout + done.stderr).split()) >= VERBS


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_completion_script_is_made_for_every_common_shell(shell: str) -> None:
    done = complete(f"source_{shell}")
    assert done.returncode == 0
    assert "_SYMAWARE_COMPLETE" in done.stdout
    assert "symaware" in done.stdout


def complete(what: str, **more: str) -> subprocess.CompletedProcess[str]:
    surroundings = {**os.environ, "_SYMAWARE_COMPLETE": what, **more}
    return subprocess.run([SCRIPT], env=surroundings, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize(
    ("shell", "more"),
    [
        ("bash", {"COMP_WORDS": "symaware ru", "COMP_CWORD": "1"}),
        ("zsh", {"_TYPER_COMPLETE_ARGS": "symaware ru"}),
        ("fish", {"_TYPER_COMPLETE_ARGS": "symaware ru", "_TYPER_COMPLETE_FISH_ACTION": "get-args"}),
    ],
)
def test_completing_ru_yields_run(shell: str, more: dict[str, Any]) -> None:
    done = complete(f"complete_{shell}", **more)
    assert "run" in done.stdout
    assert not any(verb in done.stdout for verb in VERBS - {"run"})


def test_bash_itself_completes_with_the_script(tmp_path: Path) -> None:
    (tmp_path / "completion.bash").write_text(complete("source_bash").stdout)
    lines = f"""
PATH={SCRIPT.parent}:$PATH
source completion.bash
COMP_WORDS=(symaware va); COMP_CWORD=1
$(complete -p symaware | sed 's/.*-F \\([^ ]*\\).*/\\1/') symaware
echo "${{COMPREPLY[@]}}"
"""
    done = subprocess.run(["bash", "-c", lines], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert done.stdout.split() == ["validate"]


def test_a_script_for_ones_own_shell_is_shown_on_demand(tmp_path: Path) -> None:
    done = subprocess.run(
        ["bash", "-c", f"{SCRIPT} --show-completion bash; true"], capture_output=True, text=True, timeout=60, check=True
    )
    assert "complete -o default -F" in done.stdout


def on_a_terminal(environment: Mapping[str, str], *arguments: str) -> str:
    """What the command prints on a terminal of its own."""
    terminal, its_end = pty.openpty()
    settings = {**os.environ, "TERM": "xterm-256color", "NO_COLOR": "", **environment}
    with subprocess.Popen([SCRIPT, *arguments], stdin=its_end, stdout=its_end, stderr=its_end, env=settings):
        os.close(its_end)
        output = b""
        # Reading from a terminal that its last user has left is an error.
        with contextlib.suppress(OSError):
            while piece := os.read(terminal, 4096):
                output += piece
    os.close(terminal)
    return output.decode()


@pytest.mark.parametrize(
    "words", ["--help", "rnu", "list", "show unicycle", "run missing.yaml", "run HELLO --no-record"]
)
def test_nothing_but_text_is_printed_where_that_is_wanted(words: str, scenarios: Path) -> None:
    line = words.replace("HELLO", str(scenarios / "hello.yaml")).split()
    assert "\x1b" in on_a_terminal({}, *line)
    for environment in ({"NO_COLOR": "1"}, {"TERM": "dumb"}):
        plain = on_a_terminal(environment, *line)
        assert plain
        assert "\x1b" not in plain


@pytest.mark.parametrize(
    ("typed", "some"), [("", {"unicycle", "kinematic", "ring", "tcp", "control.mpc"}), ("uni", {"unicycle"})]
)
def test_show_completes_the_names_of_plugins(typed: str, some: set[str], command: Command) -> None:
    known = {plugin["name"] for plugin in json.loads(command("list", "--json").stdout)}
    words = {"_SYMAWARE_COMPLETE": "complete_bash", "COMP_WORDS": f"symaware show {typed}", "COMP_CWORD": "2"}
    done = subprocess.run(
        [SCRIPT], env={**os.environ, **words}, capture_output=True, text=True, check=False, timeout=60
    )
    found = done.stdout.split()
    assert some <= set(found)
    assert found == sorted(name for name in known if name.startswith(typed))
