"""TOML files as data with positions."""

import datetime
import json
import math
import re
import time
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from symaware_cli.language.problem import Problem, ScenarioError
from symaware_cli.language.source import MAX_DEPTH, MAX_NODES, Source
from symaware_cli.language.source_parser import load


def read(tmp_path: Path, text: str) -> Source:
    path = tmp_path / "f.toml"
    path.write_bytes(text.encode())
    return load(path, "f.toml")


def problems(tmp_path: Path, text: str) -> tuple[Problem, ...]:
    with pytest.raises(ScenarioError) as caught:
        read(tmp_path, text)
    return caught.value.problems


def only(tmp_path: Path, text: str) -> tuple[str, int, int]:
    (problem,) = problems(tmp_path, text)
    assert problem.span is not None
    return problem.code, problem.span.line, problem.span.column


def marked(source: Source, path: tuple[str | int, ...], key: bool = False) -> str:
    span = source.span(path, key)
    assert span is not None
    line = source.line_text(span.line)
    assert line is not None
    return line[span.column - 1 : span.end_column - 1]


EXAMPLE = """\
name = "hello" # a comment
run.duration = 30.0
"quo ted".'x.y' = [1, 2, # inside
  {a = 0x1F, b.c = true}]
[agents.robot]
count = 4
text = \"\"\"first
second\"\"\"
[agents.robot.model]
use = "unicycle"
[agents]
note = 'é'
[[walls]]
x = 1
[walls.shape]
radius = 0.3
[[walls]]
x = 2
[walls.shape]
radius = 0.4
"""


def test_every_key_and_value_has_its_place(tmp_path: Path) -> None:
    source = read(tmp_path, EXAMPLE)
    assert source.data == tomllib.loads(EXAMPLE)
    assert marked(source, ("name",), key=True) == "name"
    assert marked(source, ("name",)) == '"hello"'
    assert marked(source, ("run",), key=True) == "run"
    assert marked(source, ("run", "duration"), key=True) == "duration"
    assert marked(source, ("run", "duration")) == "30.0"
    assert marked(source, ("quo ted",), key=True) == '"quo ted"'
    assert marked(source, ("quo ted", "x.y"), key=True) == "'x.y'"
    assert marked(source, ("quo ted", "x.y")) == "[1, 2, # inside"
    assert marked(source, ("quo ted", "x.y", 1)) == "2"
    assert marked(source, ("quo ted", "x.y", 2)) == "{a = 0x1F, b.c = true}"
    assert marked(source, ("quo ted", "x.y", 2, "b", "c"), key=True) == "c"
    assert marked(source, ("quo ted", "x.y", 2, "b", "c")) == "true"
    assert marked(source, ("agents", "robot", "text")) == '"""first'
    assert marked(source, ("agents", "robot", "model", "use")) == '"unicycle"'
    assert marked(source, ("agents", "note")) == "'é'"
    span = source.span(("agents",), key=True)
    assert span is not None
    assert (span.line, span.column, span.end_column) == (11, 2, 8)
    for index, line in ((0, 16), (1, 20)):
        span = source.span(("walls", index, "shape", "radius"))
        assert span is not None
        assert span.line == line


def test_columns_count_characters_and_not_bytes(tmp_path: Path) -> None:
    source = read(tmp_path, "'é𝔸' = ['ü', '世', 3]\n")
    assert marked(source, ("é𝔸",), key=True) == "'é𝔸'"
    assert marked(source, ("é𝔸", 1)) == "'世'"
    assert marked(source, ("é𝔸", 2)) == "3"


def test_windows_line_breaks_do_not_move_anything(tmp_path: Path) -> None:
    source = read(tmp_path, "a = 1\r\nb = '''x\r\ny'''\r\nc = 3\r\n")
    span = source.span(("c",))
    assert span is not None
    assert (span.line, span.column) == (4, 5)


def test_a_duplicate_key_names_the_line_of_the_first(tmp_path: Path) -> None:
    (problem,) = problems(tmp_path, "a = 1\n[b]\nc = 1\nd = 2\nc = 3\n")
    assert problem.code == "duplicate-key"
    assert problem.message == "the key `c` is already on line 3"
    assert problem.path == "b.c"
    assert problem.span is not None
    assert (problem.span.line, problem.span.column) == (5, 1)


@pytest.mark.parametrize(
    ("text", "line", "column"),
    [
        ("[a]\nx=1\n[b]\n[a]\nx=2\n", 4, 2),
        ("[[a]]\n[a]\n", 2, 2),
        ("a = 1\n[a]\n", 2, 2),
        ("[a.b]\n[a]\nb = 3\n", 3, 1),
        ("a.b.c = 1\n[a.b]\n", 2, 4),
        ("a = {b = 1, b = 2}", 1, 13),
        ("a.a = 1\na.a.b = 2\n", 2, 1),
        ("a = [1]\n[[a]]\n", 2, 3),
        ("a = {}\na.b = 1\n", 2, 1),
    ],
)
def test_every_way_to_give_a_key_twice_is_located(tmp_path: Path, text: str, line: int, column: int) -> None:
    assert only(tmp_path, text) == ("duplicate-key", line, column)


def test_everything_wrong_with_single_values_is_reported_in_one_pass(tmp_path: Path) -> None:
    text = "a = nan\nb = -inf\nc = 1e999\nd = 99999999999999999999\ne = 1979-05-27\nf = [07:32:00]\n"
    text += "g = '\\u0000'\nh = \"\\u0000\"\n"
    codes = ["not-finite"] * 3 + ["too-large-number", "date-not-allowed", "date-not-allowed", "bad-character"]
    assert [problem.code for problem in problems(tmp_path, text)] == codes
    codes = [problem.code for problem in problems(tmp_path, text.replace("h = ", "a = 1\na = "))]
    assert codes.count("duplicate-key") == 2
    assert codes.count("not-finite") == 3


@pytest.mark.parametrize(
    "text", ["a = 1979-05-27T07:32:00Z", "a = 1979-05-27T07:32:00+01:00", "a = 1979-05-27 07:32:00", "a = 07:32:00.5"]
)
def test_a_scenario_has_no_dates(tmp_path: Path, text: str) -> None:
    assert only(tmp_path, text) == ("date-not-allowed", 1, 5)


@pytest.mark.parametrize("digits", ["9" * 5000, "9" * 30, "0x" + "f" * 9000, "-" + "9" * 20])
def test_a_number_of_any_length_is_refused(tmp_path: Path, digits: str) -> None:
    code, line, _ = only(tmp_path, f"x = 1\na = {digits}")
    assert (code, line) == ("too-large-number", 2)


def test_nesting_has_a_bound(tmp_path: Path) -> None:
    inner = MAX_DEPTH - 1
    read(tmp_path, "a = " + "[" * inner + "]" * inner)
    assert only(tmp_path, "a = " + "[" * (inner + 1) + "]" * (inner + 1))[0] == "too-deep"
    assert only(tmp_path, "a = " + "[" * 500_000)[0] == "too-deep"
    assert only(tmp_path, "a = " + "{a=" * 200_000)[0] == "too-deep"
    assert only(tmp_path, "a." * 400_000 + "a = 1")[0] == "too-deep"
    assert only(tmp_path, "['a'." + "'a'." * 100_000 + "a]")[0] == "too-deep"
    assert only(tmp_path, f"{'a.' * 20}a = {{{'a.' * 20}a = 1}}")[0] == "too-deep"


@pytest.mark.parametrize(
    "text", ['a = "[[[["', "a = '[[[['", 'a = """[[[[\n[[[["""""', "a = '''[[[[\n''[[[['''", "# [[[["]
)
def test_brackets_in_texts_and_comments_do_not_count_as_nesting(tmp_path: Path, text: str) -> None:
    read(tmp_path, text.replace("[[[[", "[" * 100) + "\nb = 1")
    assert only(tmp_path, text + "\nb = " + "[" * 100)[0] == "too-deep"


@pytest.mark.parametrize(
    "text", ['"""\\' * 200_000, "'''" * 300_000, '"\\' * 400_000, "'" * 900_000, '"""' * 300_000, "[a]\n" * 200_000]
)
def test_every_text_is_parsed_quickly(tmp_path: Path, text: str) -> None:
    started = time.process_time()
    problems(tmp_path, text)
    problems(tmp_path, "a = " + text)
    assert time.process_time() - started < 60  # or it grows faster than the text


def test_the_number_of_values_has_a_bound(tmp_path: Path) -> None:
    read(tmp_path, "a = [" + "1," * (MAX_NODES // 2) + "]")
    assert only(tmp_path, "a = [" + "1," * (MAX_NODES + 1) + "]")[0] == "too-large"


@pytest.mark.parametrize(
    ("text", "code", "line", "column"),
    [
        ("", "empty", 1, 1),
        ("# only a comment\n", "empty", 1, 1),
        ("a = hello\n", "syntax", 1, 5),
        ("a = [1, 2\nb = 3\n", "unclosed", 2, 1),
        ("a = [1, 2\n\n", "unclosed", 1, 10),
        ("a = 'x\n", "unclosed", 1, 5),
        ('a = "x\nb = 1\n', "unclosed", 1, 5),
        ('a = 1\nb = """x\n\n', "unclosed", 2, 5),
        ("a = {b = 1", "unclosed", 1, 11),
        ("a = 1 b = 2\n", "syntax", 1, 7),
        ("a\n", "syntax", 1, 2),
        ("[a\n", "syntax", 1, 3),
        ("= 1\n", "syntax", 1, 1),
        ("é = 1\n", "syntax", 1, 1),
        ('a = "\\q"', "bad-escape", 1, 8),
        ('a = "\\ud800"', "bad-escape", 1, 12),
        ("a = 1 # \x07", "bad-character", 1, 9),
        ("a = 1\rb = 2", "syntax", 1, 6),
    ],
)
def test_problems_are_located_where_a_person_corrects_them(
    tmp_path: Path, text: str, code: str, line: int, column: int
) -> None:
    assert only(tmp_path, text) == (code, line, column)


_TEXT = st.text(
    st.characters(codec="utf-8", exclude_categories=["Cc", "Cs", "Zl", "Zp", "Cn"], exclude_characters="\ufeff")
)
_VALUES = st.recursive(
    st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False, allow_infinity=False) | _TEXT,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(_TEXT, inner, max_size=4),
    max_leaves=15,
)


def _text(text: str) -> str:
    if text.isprintable() and "'" not in text:
        return f"'{text}'"
    # JSON escapes of characters beyond 16 bits are pairs of surrogates, which TOML does not know.
    return json.dumps(text, ensure_ascii=False)


def _key(key: str) -> str:
    return key if re.fullmatch("[A-Za-z0-9_-]+", key) else _text(key)


def _inline(value: Any, line_break: str) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(key)} = {_inline(item, '')}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + line_break + f", {line_break}".join(_inline(item, line_break) for item in value) + "]"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, float):
        shown = repr(value)
        return shown if re.search(r"[.e]", shown) else shown + ".0"
    return str(value).lower()


def _dump(table: dict[str, Any], line_break: str, header: tuple[str, ...] = ()) -> list[str]:
    """Writes a table: plain keys first, then inner tables and arrays of tables under headers of their own."""
    lines = []
    below = []
    for key, value in table.items():
        if isinstance(value, dict) and value:
            below += ["[" + ".".join(map(_key, (*header, key))) + "]", *_dump(value, line_break, (*header, key))]
        elif isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
            for item in value:
                below += ["[[" + ".".join(map(_key, (*header, key))) + "]]", *_dump(item, line_break, (*header, key))]
        elif isinstance(value, str) and len(value) % 2 and '"' not in value and "\\" not in value:
            lines.append(f'{_key(key)} = """{value}"""')
        else:
            lines.append(f"{_key(key)} = {_inline(value, line_break)}  # [a comment")
    return lines + below


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    data=st.dictionaries(_TEXT, _VALUES, min_size=1, max_size=5),
    style=st.sampled_from(["inline", "tables", "dotted"]),
    line_break=st.sampled_from(["", "\n", "\r\n"]),
)
def test_written_values_are_read_back_with_their_places(
    tmp_path: Path, data: dict[str, Any], style: str, line_break: str
) -> None:
    if style == "tables":
        lines = _dump(data, line_break)
    elif style == "inline":
        lines = [f"{_key(key)} = {_inline(value, line_break)}" for key, value in data.items()]
    else:
        data = {"outer": data}
        lines = [f"outer . {_key(key)} = {_inline(value, line_break)}" for key, value in data["outer"].items()]
    source = read(tmp_path, (line_break or "\n").join(lines))
    assert repr(source.data) == repr(tomllib.loads(source.text))
    assert source.data == data
    _check_places(source, data, ())


def _check_places(source: Source, value: Any, path: tuple[str | int, ...]) -> None:
    if isinstance(value, dict):
        for key, item in value.items():
            assert tomllib.loads(f"{marked(source, (*path, key), key=True)} = 1") == {key: 1}
            _check_places(source, item, (*path, key))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            _check_places(source, item, (*path, index))
    else:
        read_back = tomllib.loads(f"x = {marked(source, path)}")["x"]
        assert read_back == value
        assert not isinstance(read_back, datetime.date)
        assert not isinstance(read_back, float) or math.isfinite(read_back)


_PIECES = st.sampled_from(
    [
        *("a", "b.c", "'d'", r'"\u00e9"', "[a]", "[[b]]", "[a.b]", " = ", "1", "0x1F", "1979-05-27 07:32:00", "true"),
        *("'x'", '"""y\n', '"""', "[", "]", "{", "}", ", ", "\n", "\r\n", " # c\n", "\f", "é", '"'),
    ]
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(pieces=st.lists(_PIECES, max_size=30))
def test_any_text_is_read_or_refused_with_a_place(tmp_path: Path, pieces: list[str]) -> None:
    text = "a = 1\na = 2\n" + "".join(pieces)
    reported = problems(tmp_path, text)
    assert reported
    for problem in reported:
        assert problem.span is not None
        assert 1 <= problem.span.line <= text.count("\n") + 1
