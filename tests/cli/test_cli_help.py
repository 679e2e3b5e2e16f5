"""The help of the command, which is written without Typer: in frames on a terminal, in whole lines in a pipe."""

import re
from pathlib import Path
from typing import Any

import pytest
from simulating import Command
from typer.main import get_command

from symaware_cli.cli.application import application
from symaware_cli.cli.help import OPTIONS, help_text
from symaware_cli.cli.verbs import Verbs
from symaware_cli.help_place import GROUPS

_COLOUR = re.compile(r"\x1b\[[0-9;]*m")


@pytest.fixture
def pipe(monkeypatch: pytest.MonkeyPatch) -> None:
    """Output that is read by a program, whatever the environment of the tests says."""
    monkeypatch.delenv("TTY_COMPATIBLE", raising=False)


class Terminal:
    """A stream that says that it is a terminal."""

    def __init__(self, encoding: str) -> None:
        self.encoding = encoding

    def isatty(self) -> bool:
        return True


def on_terminal(monkeypatch: pytest.MonkeyPatch, columns: int, encoding: str = "utf-8", **environment: str) -> str:
    """The help on a terminal of some columns."""
    for name, value in {"NO_COLOR": "", "TERM": "xterm", "COLUMNS": str(columns), **environment}.items():
        monkeypatch.setenv(name, value)
    with monkeypatch.context() as patch:
        patch.setattr("sys.stdout", Terminal(encoding))
        return help_text()


def words_of(text: str) -> list[str]:
    """The words of a help without colours and frames."""
    return re.sub(r"[╭╮╰╯│─:]", " ", _COLOUR.sub("", text)).split()


def test_the_help_names_the_options_that_typer_knows() -> None:
    root: Any = get_command(application)
    with root.make_context("symaware", ["run"], resilient_parsing=True) as context:
        known = {", ".join(sorted(each.opts, key=len)): each.help for each in root.get_params(context)}
    assert known == dict(OPTIONS)


@pytest.mark.parametrize("columns", [40, 60, 80, 100])
def test_each_line_of_a_frame_is_as_wide_as_the_terminal(columns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = [_COLOUR.sub("", line) for line in on_terminal(monkeypatch, columns).splitlines()]
    framed = [line for line in lines if line[:1] in {*"╭│╰"}]
    assert {(len(line), line[-1] in "╮│╯") for line in framed} == {(columns, True)}
    assert max(map(len, lines)) == columns
    titles = [line.split("─ ")[1].split(" ─")[0] for line in framed if line.startswith("╭")]
    assert titles == ["Options", *GROUPS.values()]


def test_the_help_on_a_terminal_has_the_groups_of_plugins(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    module = "from symaware_cli import in_help\n\n\n@in_help('weather')\ndef rain() -> None:\n    'Fall.'\n"
    (tmp_path / "rainy.py").write_text(module + "\n\ndef plain() -> None:\n    'Be in no group.'\n")
    information = tmp_path / "rainy-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: rainy\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text("[symaware.commands]\nrain = rainy:rain\nplain = rainy:plain\n")
    monkeypatch.syspath_prepend(tmp_path)
    lines = [_COLOUR.sub("", line) for line in on_terminal(monkeypatch, 100).splitlines()]
    titles = [line.split("─ ")[1].split(" ─")[0] for line in lines if line.startswith("╭")]
    assert titles == ["Options", *GROUPS.values(), "weather", "Other commands"]


def test_a_wide_terminal_gets_lines_that_can_be_read(monkeypatch: pytest.MonkeyPatch) -> None:
    assert max(len(_COLOUR.sub("", line)) for line in on_terminal(monkeypatch, 300).splitlines()) == 100


def test_the_same_words_are_on_terminals_of_any_kind_and_in_pipes(
    monkeypatch: pytest.MonkeyPatch, pipe: None, capsys: pytest.CaptureFixture[str]
) -> None:
    text = help_text()
    for columns in (60, 100):
        assert words_of(on_terminal(monkeypatch, columns)) == words_of(text)
        for plain in ({"NO_COLOR": "1"}, {"TERM": "dumb"}, {"encoding": "iso-8859-1"}):
            shown = on_terminal(monkeypatch, columns, **plain)
            assert words_of(shown) == words_of(text)
            assert not {"\x1b", "│"} & {*shown}
            assert max(map(len, shown.splitlines())) <= columns


def test_in_a_pipe_each_verb_is_on_a_line_of_its_own(pipe: None) -> None:
    lines = help_text().splitlines()
    for verb in Verbs().summaries():
        assert any(line.split() == [verb.name, *verb.text.partition("\n\n")[0].split()] for line in lines), verb.name


def test_the_help_is_the_same_with_and_without_typer(process: Command, command: Command) -> None:
    told = {process(*line).stdout for line in (["--help"], ["-h"], ["--help", "run"], ["-h", "nonsense"])}
    assert told == {help_text()} == {command("--help").stdout}
    nothing = process()
    assert nothing.returncode == 2
    assert help_text() in nothing.stdout + nothing.stderr
