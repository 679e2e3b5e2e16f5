"""The presentation of problems to people and tools."""

import json
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from symaware_cli.language.problem import Problem, ScenarioError, TextSpan, nearest, render, to_json


def problem(line: str, column: int, end: int, **fields: Any) -> Problem:
    return Problem("code", "the message", TextSpan("a.yaml", 12, column, end), source_line=line, **fields)


def test_a_problem_shows_its_place_line_caret_and_hints() -> None:
    shown = render(
        [
            Problem(
                "unknown-key",
                "unknown key `contrl`",
                TextSpan("scenarios/hello.yaml", 12, 5, 11),
                "agents.robot.contrl",
                "one of components, count",
                "components",
                "    contrl: {use: control.go-to-goal}",
            )
        ]
    )
    assert shown.splitlines() == [
        "scenarios/hello.yaml:12:5: unknown key `contrl`",
        "   12 |     contrl: {use: control.go-to-goal}",
        "      |     ^^^^^^",
        "   expected one of components, count; did you mean `components`?",
        "1 problem in scenarios/hello.yaml",
    ]


def test_the_last_line_counts_problems_and_files() -> None:
    problems = [Problem("a", "one", TextSpan("a.yaml", 1, 1, 2)), Problem("a", "two", TextSpan("b.toml", 1, 1, 2))]
    assert render(problems).splitlines()[-1] == "2 problems in 2 files"
    assert render([Problem("a", "one")]).splitlines() == ["one", "1 problem"]
    assert render([]) == ""


def test_a_long_line_is_cut_around_the_caret() -> None:
    line = "x" * 5000 + "BAD" + "y" * 5000
    _, source, caret, _ = render([problem(line, 5001, 5004)]).splitlines()
    assert len(source) <= 106
    assert source.startswith("   12 | ...x")
    assert source.endswith("y...")
    assert source[caret.index("^") : caret.rindex("^") + 1] == "BAD"


def test_tabs_and_wide_characters_keep_the_caret_below_its_text() -> None:
    _, source, caret, _ = render([problem("\tkey: BAD", 7, 10)]).splitlines()
    assert source[caret.index("^") : caret.rindex("^") + 1] == "BAD"
    # Two ideographs take four columns of the terminal.
    _, source, caret, _ = render([problem("世界: BAD", 5, 8)]).splitlines()
    assert caret.index("^") == source.index("BAD") + 2
    assert caret.count("^") == 3


def test_no_escape_code_of_the_file_reaches_the_terminal() -> None:
    evil = "\x1b[31m\x07\u202e\x9b"
    shown = render(
        [
            Problem("a", evil, TextSpan(evil, 1, 3, 5), evil, evil, evil, f"a{evil}b"),
            Problem("a", evil, None, evil),
        ]
    )
    assert all(character.isprintable() or character == "\n" for character in shown)
    assert "\\x1b[31m" in shown


def test_colour_adds_only_escape_codes() -> None:
    plain = render([problem("a: b", 4, 5)])
    coloured = render([problem("a: b", 4, 5)], colour=True)
    assert "\x1b" not in plain
    for code in ("\x1b[1m", "\x1b[31m", "\x1b[2m", "\x1b[0m"):
        coloured = coloured.replace(code, "")
    assert coloured == plain


@given(st.text(max_size=300), st.integers(1, 400), st.integers(1, 400), st.integers(20, 200))
def test_any_line_and_any_span_can_be_shown(line: str, column: int, end: int, width: int) -> None:
    shown = render([problem(line, column, end)], width=width).split("\n")
    assert len(shown) == 4
    assert shown[2].count("^") >= 1
    assert all(character.isprintable() for each in shown for character in each)


def test_an_error_sorts_its_problems_and_drops_repetitions() -> None:
    late = Problem("a", "late", TextSpan("a.yaml", 9, 1, 2))
    early = Problem("a", "early", TextSpan("a.yaml", 2, 5, 6))
    error = ScenarioError([late, early, late])
    assert error.problems == (early, late)
    assert "early" in str(error)


def test_problems_are_plain_data_for_tools() -> None:
    (data,) = to_json([problem("a: b", 4, 5, path="a", expected="c", suggestion="d")])
    assert json.loads(json.dumps(data)) == {
        "code": "code",
        "message": "the message",
        "span": {"file": "a.yaml", "line": 12, "column": 4, "end_column": 5},
        "path": "a",
        "expected": "c",
        "suggestion": "d",
        "source_line": "a: b",
        "users": [],
    }


def test_a_huge_line_is_not_repeated_in_the_data() -> None:
    (data,) = to_json([problem("x" * 2000, 4, 5)])
    assert data["source_line"] is None


def test_the_nearest_name_ignores_case_and_nonsense() -> None:
    assert nearest("contrl", ["control", "count"]) == "control"
    assert nearest("MODEL", ["model", "Module"]) == "model"
    assert nearest("zzz", ["control", "count"]) is None
    assert nearest("a" * 10_000, ["a" * 10_000]) is None
    assert nearest("a", []) is None
