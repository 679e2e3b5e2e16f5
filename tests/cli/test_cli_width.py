"""What a terminal of 80 or 60 columns shows: lines are folded between words, never within a word or before a unit."""

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest
from test_cli_paths import CALLS, called, line, sound  # type: ignore[import-not-found] # a folder with a conftest of its own

from symaware_cli.cli.folding import folded, parts_of
from symaware_cli.cli.streams import width_of
from symaware_cli.cli.text_table import aligned

__all__ = ["sound"]

SENTENCE = (
    "  closest      0.201 m between robot.0 and robot.1 at 4.2 s, after 12 of 20 runs in 1.5 MB: 95 % of all of them"
)

TABLE = [
    ["channel", "since [s]", "messages", "greatest difference"],
    ["/world/robot/state", "0.05", "1,204", "0.0125 in robot.3 heading at 4.15 s, and 12 more of them are as great"],
    ["/agents/robot/knowledge", "12.5", "3", "robot.0, robot.1, robot.2 ..."],
]


def terminal(monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    monkeypatch.setenv("COLUMNS", str(columns))


@pytest.mark.parametrize("width", [40, 60, 80])
def test_a_line_is_folded_between_words_and_a_number_stays_with_its_unit(width: int) -> None:
    lines = folded(SENTENCE, width).split("\n")
    assert len(lines) > 1
    assert max(map(len, lines)) <= width
    assert " ".join(each.strip() for each in lines) == SENTENCE.strip()
    for whole in ("0.201 m", "4.2 s,", "12 of", "20 runs", "1.5 MB:", "95 %"):
        assert any(whole in each for each in lines), whole
    assert all(each.startswith(" " * 15) for each in lines[1:])


def test_a_word_longer_than_the_line_and_an_excerpt_of_a_file_are_left_whole() -> None:
    path = f"  log          /a/{'b' * 90}.mcap and more"
    assert folded(path, 60).split("\n")[0] == path.removesuffix(" and more")
    excerpt = f"   12 | {'word ' * 30}"
    assert folded(excerpt, 60) == excerpt


@pytest.mark.parametrize("width", [60, 80])
def test_texts_of_a_table_are_folded_within_their_columns(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal(monkeypatch, width)
    lines = aligned(TABLE, "<>><")
    assert max(map(len, lines)) <= width
    for row in TABLE:
        for cell in (part for each in row for part in parts_of(each)):
            assert any(cell in each for each in lines), cell
    assert "".join(TABLE[1][3].split()) in "".join("".join(lines).split())


def test_columns_that_do_not_fit_stand_in_further_blocks_with_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal(monkeypatch, 60)
    table = [
        ["run", *(f"column_{number}" for number in range(12))],
        *([str(run), *["123456"] * 12] for run in range(3)),
    ]
    lines = aligned(table, ">", indent="")
    assert max(map(len, lines)) <= 60
    assert [each.split()[0] for each in lines if each] == ["run", "0", "1", "2"] * (1 + lines.count(""))
    assert [name for each in lines if "column" in each for name in each.split()[1:]] == table[0][1:]


def test_text_in_files_and_pipes_is_not_folded(monkeypatch: pytest.MonkeyPatch) -> None:
    # Whoever has imported `readline` exports it to each process that it starts.
    monkeypatch.setenv("COLUMNS", "80")
    with open(os.devnull, "w") as stream:
        assert width_of(stream) is None
    assert folded(SENTENCE, None) == SENTENCE


#: Verbs that print JSON or tables for programs only, or run for long and print what others print as well.
LEFT_OUT = {"schema": "JSON", "doctor": "waits for the checks of all packages"}

#: What a call of `CALLS` needs to work; and calls that print an error only, which is folded as well.
MORE = {"sweep": ["--output", "swept"]}
REFUSED = {"compare": "the sweep has no variants"}


def named(sound: Path) -> Mapping[str, tuple[str, str]]:
    return {"show": ("name", str(sound / "room.yaml"))}


CASES = [
    pytest.param(verb, number, id=f"{verb}{number or ''}")
    for verb in CALLS
    if verb not in LEFT_OUT
    for number, _ in enumerate(CALLS[verb])
]


@pytest.mark.slow
@pytest.mark.parametrize("columns", [60, 80])
@pytest.mark.parametrize(("verb", "number"), CASES)
def test_every_verb_fits_the_terminal(
    verb: str, number: int, columns: int, sound: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    terminal(monkeypatch, columns)
    status, said = called([*line(verb, number, *named(sound).get(verb, ("", "")), sound), *MORE.get(verb, ())])
    assert status in (0, 1, 3) or verb in REFUSED, said
    assert too_long(said.splitlines(), columns) == []


def too_long(lines: Sequence[str], columns: int) -> list[str]:
    """The lines that are longer than the terminal, though they could be folded."""
    found = [each for each in lines if len(each) > columns and not re.match(r" *\d* \|", each)]
    # A single part, with a label before it, cannot be folded.
    return [each for each in found if len(parts_of(re.split(r" {2,}", each)[-1])) > 1]
