"""No feature is tested by `slow` tests alone: each plugin that a file or a command names is in another test, too."""

import ast
import re
import tomllib
from pathlib import Path

import pytest
from checkout import CHECKOUT

#: Groups of entry points whose names users write; every `symaware.searches` is a parameter of tests of all of them.
NAMED = (
    *("abstractions", "commands", "components", "environments", "executors", "exports", "faults", "metrics", "models"),
    *("sections", "topologies", "transports"),
)


def without_slow_tests(text: str) -> str:
    """Return the text of a module of tests without the tests that are marked `slow`."""
    if "mark.slow" not in text:
        return text
    tree, lines = ast.parse(text), text.splitlines()
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "pytestmark":
            if "mark.slow" in ast.unparse(node.value):
                return ""
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            marks = [each for each in node.decorator_list if ast.unparse(each) == "pytest.mark.slow"]
            if marks:
                lines[marks[0].lineno - 1 : node.end_lineno] = [""] * ((node.end_lineno or 0) - marks[0].lineno + 1)
    return "\n".join(lines)


@pytest.fixture(scope="module")
def texts() -> list[str]:
    files = sorted((CHECKOUT / "tests").rglob("test_*.py"))
    return [without_slow_tests(file.read_text(encoding="utf-8")) for file in files if file != Path(__file__)]


def test_slow_tests_are_left_out_and_others_are_not() -> None:
    slow = "@pytest.mark.slow\ndef test_a(): 'gyroscope'\n"
    quick = "@pytest.mark.parametrize('a', ['compass'])\ndef test_b(a): 'sextant'\n"
    assert without_slow_tests(slow + quick).split("\n", 2)[2] == quick.removesuffix("\n")
    assert without_slow_tests(f"pytestmark = [pytest.mark.slow]\n{quick}") == ""


@pytest.mark.parametrize("group", NAMED)
def test_each_plugin_is_named_in_a_test_that_is_not_slow(group: str, texts: list[str]) -> None:
    points = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"]
    untested = []
    for name, target in points[f"symaware.{group}"].items():
        words: tuple[str, ...] = (name, target.partition(":")[2])
        pattern = re.compile("|".join(rf"(?<![\w.-]){re.escape(word)}(?![\w-]|\.\w)" for word in words))
        if group == "commands":  # ordinary words, which are commands only as arguments
            words, pattern = (name,), re.compile(f"[\"']{name}[\"']")
        if not any(pattern.search(text) for text in texts if any(word in text for word in words)):
            untested.append(name)
    assert not untested
