"""A Python value has the same meaning as the same value written as YAML."""

from __future__ import annotations

import enum
import math
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli.language.assignment import Assignment
from symaware_cli.language.compose import compose
from symaware_cli.language.problem import ScenarioError
from symaware_cli.language.resolved import dumped
from symaware_cli.language.source import Source, SourceNode
from symaware_cli.language.yaml_source import parse_yaml

#: Texts that would mean something else without quotes.
_AMBIGUOUS: tuple[str, ...] = ("1", "0.5", "1e3", "0x1f", "-.inf", ".nan", "~", "null", "", "true", "no", "1:30", "<<")
_AMBIGUOUS += (
    "2026-01-01",
    "a: b",
    "# a",
    "- a",
    "[1",
    "{",
    "&a",
    "*a",
    "!!int 1",
    "'",
    '"',
    "a\nb",
    " a ",
    "\t",
    "\\",
    "${",
    "a;b=c",
)

_TEXT = st.sampled_from(_AMBIGUOUS) | st.text(st.characters(exclude_categories=["Cc", "Cs", "Zl", "Zp", "Cn", "Co"]))
_NUMBER = st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False, allow_infinity=False)
_NUMPY = st.one_of(
    st.integers(-(2**63), 2**63 - 1).map(np.int64),
    st.floats(allow_nan=False, allow_infinity=False).map(np.float64),
    st.floats(allow_nan=False, allow_infinity=False, width=32).map(np.float32),
    st.booleans().map(np.bool_),
    st.lists(st.floats(allow_nan=False, allow_infinity=False)).map(np.array),
    st.lists(st.integers(-9, 9), min_size=4, max_size=4).map(lambda items: np.reshape(items, (2, 2))),
)
_VALUE = st.recursive(
    st.none() | st.booleans() | _NUMBER | _TEXT | _NUMPY,
    lambda inner: st.lists(inner) | st.lists(inner).map(tuple) | st.dictionaries(_TEXT, inner),
    max_leaves=20,
)

#: Values with which something is wrong, alone or inside others.
_FAULTY = st.recursive(
    st.sampled_from([math.nan, math.inf, -math.inf, 2**63, -(2**63) - 1, "\0", "a\x7f", "\u2028", "\ufeff", 1, "é\t"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["a", "é", "b c"]), inner, max_size=3),
    max_leaves=5,
)


def as_python(value: Any) -> Any:
    """The value in plain Python, converted by other means than those that are tested."""
    if isinstance(value, np.ndarray):
        return [as_python(each) for each in value]
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, dict):
        return {key: as_python(each) for key, each in value.items()}
    return [as_python(each) for each in value] if isinstance(value, list | tuple) else value


def spans(node: SourceNode) -> Any:
    """The columns of a node and of all inside."""
    own = (node.span.column, node.span.end_column)
    if isinstance(node.value, dict):
        return own, [
            (key, entry.key.column, entry.key.end_column, spans(entry.node)) for key, entry in node.value.items()
        ]
    return own, [spans(child) for child in node.children()]


@given(_VALUE)
def test_a_python_value_has_the_same_meaning_as_in_a_yaml_file(value: Any) -> None:
    file = Source("file", b"", dumped({"x": as_python(value)}).decode())
    parse_yaml(file)
    given_directly = Assignment.of("x", value)
    assert not [*file.problems, *given_directly.source.problems]
    # repr() also tells 1 from 1.0 and True, 0.0 from -0.0, and every float from its neighbours.
    assert repr(given_directly.value.plain()) == repr(file.data["x"]) == repr(as_python(value))


@given(_VALUE, st.booleans())
def test_the_text_of_a_python_value_has_the_same_meaning_and_places(value: Any, listed: bool) -> None:
    # As text, a list of a single mapping would be that mapping.
    value = [value, 1] if listed else value
    one = Assignment.of("agents.robot.state[1]", value, listed=listed)
    other = Assignment.parse(str(one), listed=listed)
    assert not [*one.source.problems, *other.source.problems]
    assert str(other) == str(one)
    assert other.path == one.path == ("agents", "robot", "state", 1)
    assert repr(other.value.plain()) == repr(one.value.plain())
    assert spans(other.value) == spans(one.value)


@given(_FAULTY)
def test_problems_of_a_python_value_are_located_in_its_text(value: Any) -> None:
    one = Assignment.of("a.b", value)
    # Characters that no file may contain are escaped in the text, so that it can be printed and parsed.
    other = Assignment.parse(str(one))
    assert str(one).isprintable()
    assert one.source.problems == other.source.problems


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scenario") / "one.yaml"
    path.write_text("parameters: {x: 1}\nname: ${parameters.x}\n")
    return path


@given(value=_VALUE)
def test_documents_with_a_python_value_and_with_its_text_are_the_same(scenario: Path, value: Any) -> None:
    def composed(changes: Any) -> object:
        try:
            return repr(compose(scenario, changes).data)
        except ScenarioError as error:
            return error.problems

    change = Assignment.of("parameters.x", value)
    expected = composed({"parameters.x": value})
    assert composed([str(change)]) == composed([change]) == expected


@pytest.mark.parametrize(
    ("value", "found"),
    [
        (np.float64(0.1), 0.1),
        (np.float32(0.1), 0.10000000149011612),
        (np.array(3), 3),
        (PurePosixPath("a/b.obj"), "a/b.obj"),
        (enum.IntEnum("Number", {"two": 2}).two, 2),  # type: ignore[attr-defined]
        (enum.Enum("Word", {"go": "go"}, type=str).go, "go"),  # type: ignore[attr-defined]
        ({1: (True,)}, {"1": [True]}),
        (-0.0, -0.0),
        (5e-324, 5e-324),
        (1e16, 1e16),
    ],
    ids=str,
)
def test_a_value_of_another_type_is_the_plain_one(value: Any, found: Any) -> None:
    plain = Assignment.of("a", value).value.plain()
    assert repr(plain) == repr(found)
    assert type(plain) is type(found)


def test_an_assignment_can_be_applied_repeatedly_and_reports_a_problem_once_each_time(scenario: Path) -> None:
    change = Assignment.of("name.x", 1)
    for _ in range(2):
        with pytest.raises(ScenarioError) as caught:
            compose(scenario, [change])
        assert [problem.code for problem in caught.value.problems] == ["bad-set-path"]


def test_a_value_that_contains_itself_is_too_deep(scenario: Path) -> None:
    endless: list[Any] = []
    endless.append(endless)
    deepest: Any = 1
    for _ in range(31):
        deepest = [deepest]
    assert compose(scenario, {"parameters.x": deepest}).data["parameters"] == {"x": deepest}
    for value in (endless, [deepest], {"a": endless}):
        with pytest.raises(ScenarioError) as caught:
            compose(scenario, {"parameters.x": value})
        assert [problem.code for problem in caught.value.problems] == ["too-deep"]


@pytest.mark.parametrize("path", ["a=b", "a\nb", "a..b", "", "a\0", "a[x]", "a\ud800"])
def test_a_path_that_could_not_be_typed_is_refused_and_replaces_nothing(path: str) -> None:
    change = Assignment.of(path, 1)
    assert change.source.problems
    root = SourceNode({}, change.source.at(0))
    assert change.apply(root) is root


def test_two_keys_that_are_the_same_text_are_refused() -> None:
    with pytest.raises(TypeError, match="the same text"):
        Assignment.of("a", {1: 1, "1": 2})
