"""The command as a whole: its version, its help, its completion, and what it says to nonsense."""

import os
import statistics
import subprocess
import sys
from pathlib import Path

import pytest

import symaware_cli

SCRIPT = Path(sys.executable).parent / "symaware"
VERBS = {"run", "validate", "new", "inspect", "list", "show", "schema"}


def test_the_version_is_the_packages(command):
    for arguments in (["--version"], ["--version", "run"]):
        done = command(*arguments)
        assert (done.returncode, done.stdout) == (0, f"symaware {symaware_cli.__version__}\n")


def test_saying_the_version_costs_at_most_four_times_as_much_as_starting_python():
    def cpu_time(*line):
        process = subprocess.Popen([sys.executable, *line], stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        assert process.returncode == 0
        return usage.ru_utime + usage.ru_stime

    # In turn, so that both suffer alike from whatever else the machine does.
    pairs = [(cpu_time(str(SCRIPT), "--version"), cpu_time("-c", "pass")) for _ in range(15)]
    ratio = statistics.median(version for version, _ in pairs) / statistics.median(python for _, python in pairs)
    assert ratio <= 4


def test_help_names_every_verb_and_exit_status(command):
    done = command("--help")
    assert done.returncode == 0
    words = set(done.stdout.split())
    assert words >= VERBS
    assert "130 interrupted" in done.stdout
    assert {command("run", option).stdout for option in ("-h", "--help")} == {command("run", "-h").stdout}


def test_asking_for_help_does_not_import_what_is_heavy():
    code = "import sys; sys.argv = ['symaware', '--help']\ntry:\n from symaware_cli.cli import main; main()\nfinally:\n"
    code += " print([name for name in ('numpy', 'scipy', 'pydantic', 'mcap', 'yaml') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.splitlines()[-1] == "[]"


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
        ["new"],
        ["new", "a/b"],
        ["--nonsense"],
    ],
    ids=" ".join,
)
def test_nonsense_is_wrong_input_told_without_a_traceback(arguments, command, tmp_path):
    done = command(*arguments)
    assert done.returncode == 2
    assert done.stderr.strip()
    assert os.listdir(tmp_path) == []


def test_without_anything_it_shows_its_help(command):
    done = command()
    assert "Usage" in done.stdout + done.stderr
    assert set((done.stdout + done.stderr).split()) >= VERBS


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_completion_script_is_made_for_every_common_shell(shell):
    done = complete(f"source_{shell}")
    assert done.returncode == 0
    assert "_SYMAWARE_COMPLETE" in done.stdout
    assert "symaware" in done.stdout


def complete(what, **more):
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
def test_completing_ru_yields_run(shell, more):
    done = complete(f"complete_{shell}", **more)
    assert "run" in done.stdout
    assert not any(verb in done.stdout for verb in VERBS - {"run"})


def test_bash_itself_completes_with_the_script(tmp_path):
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


def test_a_script_for_ones_own_shell_is_shown_on_demand(tmp_path):
    done = subprocess.run(
        ["bash", "-c", f"{SCRIPT} --show-completion bash; true"], capture_output=True, text=True, timeout=60, check=True
    )
    assert "complete -o default -F" in done.stdout
