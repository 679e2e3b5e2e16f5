"""Expressions say what they mean, and reach nothing else."""

import contextlib
import re
import string

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulating import untyped

from symaware_cli.geometry.region import Region
from symaware_cli.specification.columns import FUNCTIONS
from symaware_cli.specification.expression import EvaluationError, Expression, ExpressionError
from symaware_cli.specification.region import PlacedRegion

REGIONS = {"disc": Region.model_validate({"circle": {"centre": [0, 0], "radius": 7}})}
VALUES = {
    "x": 2.0,
    "risk": 0.3,
    "position": np.array([3.0, 4.0]),
    "goal": [0, 0],
    "name": "north",
    "ready": True,
    "flags": np.array([True, False]),
    "knowledge": {"goal-2": [1, 2], "count": 3, "deep": {"a": [5]}},
    "infinite": float("inf"),
    "disc": PlacedRegion("disc", REGIONS, lambda agent: (np.zeros(2), None)),
}


def value(text: str) -> object:
    return Expression(text, VALUES).value(VALUES.__getitem__)


def holds(text: str) -> bool:
    return Expression(text, VALUES).holds(VALUES.__getitem__)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1 + 2 * 3 - 4 / 2", 5),
        ("-x ** 2", -4),
        ("7 % 4", 3),
        ("abs(-x)", 2),
        ("min(3, 1, 2) + max(position)", 5),
        ("norm(position)", 5),
        ("distance(position, goal)", 5),
        ("distance(position, [3, 0])", 4),
        ("sqrt(16)", 4),
        ("sin(0) + cos(0)", 1),
        ("wrap(3 * 3.141592653589793)", -np.pi),
        ("atan2(1, 1)", np.pi / 4),
        ("position[0] + position[-1]", 7),
        ('knowledge["goal-2"][1]', 2),
        ('knowledge["deep"]["a"][0]', 5),
        ('knowledge.deep["a"][0]', 5),
        ("knowledge.count", 3),
        ("count(flags)", 1),
        ("signed_distance(position, disc)", 2),
    ],
)
def test_numbers(text: str, expected: int) -> None:
    assert value(text) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("risk > 0.2", True),
        ("0 < risk < 0.2", False),
        ("x == 2 and not risk >= 1", True),
        ("risk > 1 or ready", True),
        ('name == "north"', True),
        ('name != "south"', True),
        ("name == 3", False),
        ("goal == [0, 0]", True),
        ("all(position > 2)", True),
        ("all(position > 3)", False),
        ("any(flags)", True),
        ("inside(position, disc)", True),
        ("infinite > 1e300", True),
        ("True and not False", True),
        ("risk\n  > 0.2", True),
        ("risk > 0.2 implies ready", True),
        ("ready implies x < 0 implies false", True),
        ("(ready implies x < 0) implies false", True),
    ],
)
def test_true_conditions(text: str, expected: bool) -> None:
    assert holds(text) is expected


def test_the_right_half_is_not_looked_at_where_the_left_one_decides() -> None:
    assert holds("x < 0 and 1 / 0 > 1") is False
    assert holds("x > 0 or 1 / 0 > 1") is True


@pytest.mark.parametrize(
    ("text", "problem", "marked"),
    [
        ("riks > 1", "there is no `riks` here", "riks"),
        ("x + foo(1)", "there is no function `foo`", "foo"),
        ("x + norm", "`norm` is a function: write norm(...)", "norm"),
        ("norm(1, 2)", "norm(...) takes 1 argument, not 2", "norm(1, 2)"),
        ("min()", "min(...) takes at least 1 argument, not 0", "min()"),
        ("position.0", "`.0` cannot stand here: an operator is missing before it", ".0"),
        ("knowledge.[0]", "a name is missing after the dot", "["),
        ("position.__class__.", "a name is missing after the dot", "."),
        ("x is 2", "the comparisons are <, <=, >, >=, == and !=", "is"),
        ("x in goal", "the comparisons are <, <=, >, >=, == and !=", "in"),
        ("[x for i in goal]", "the bracket lacks its `]`", "for"),
        ("goal[x]", "an element is named by a number or a text", "x"),
        ("1e999 > x", "the number is too large", "1e999"),
        ("x >", "the expression breaks off here", ">"),
        ("(x", "the bracket lacks its `)`", "x"),
        ("x > 1)", "`)` cannot stand here", ")"),
        ("", "the expression is empty", ""),
        ("x = 3", "write `==` instead of `=`", "="),
        ("x -> ready", "write `implies` instead of `->`", "->"),
        ("x && ready", "write `and` instead of `&&`", "&&"),
        ("!ready", "write `not` instead of `!`", "!"),
        ("x ; 3", "write `,` instead of `;`", ";"),
        ("ä > 1 and riks", "there is no `ä` here", "ä"),
        ("x > 1 and 'ä' == riks", "there is no `riks` here", "riks"),
        ("name == 'north", "the text in quotes does not end", "'north"),
        ("x" * 501, "an expression has at most 500 characters, not 501", None),
        ("min(*goal)", "`*` cannot stand here: a value is missing before it", "*"),
        ("x << 3", "`<` cannot stand here: a value is missing before it", "<"),
        ("~x", "write `not` instead of `~`", "~"),
        ("x if ready else 1", "write `a implies b`", "if"),
        ("f'{x}'", "there is no `f` here", "f"),
        ("1j > x", "`j` cannot stand here: an operator is missing before it", "j"),
        ("x\0", "'\\x00' has no meaning in an expression", "\0"),
        ("always x > 1", "`always` belongs in a specification: a condition is about one instant", "always x > 1"),
        ("(" * 40 + "x" + ")" * 40, "the expression is nested too deeply", None),
    ],
)
def test_invalid_expressions_are_reported_at_their_place(text: str, problem: str, marked: str | None) -> None:
    with pytest.raises(ExpressionError) as caught:
        Expression(text, VALUES)
    assert problem in caught.value.problem
    if marked is not None:
        assert text[caught.value.start : caught.value.end] == marked
    assert 0 <= caught.value.start <= len(text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 / 0 > 1", "division by zero"),
        ("9 ** 9 ** 9 ** 9", "overflow encountered in power"),
        ("position > 1", "there are 2 values of each; use all(...) or any(...)"),
        ("not flags", "there are 2 values of each; use all(...) or any(...)"),
        ("name + 1 > 0", "a text is not a number"),
        ("name * 9e18", "a text is not a number"),
        ("name[0] == 1", "a text has no element 0"),
        ('knowledge["plan"]', "plan"),
        ("position[7] > 1", "there is no element 7 in a vector of 2"),
        ("distance(position, [1, 2, 3]) > 1", "a vector of 2 does not go with one of 3"),
        ("knowledge > 1", "a table is not a number"),
    ],
)
def test_a_missing_value_has_a_reason(text: str, said: str) -> None:
    with pytest.raises(EvaluationError, match=re.escape(said)) as caught:
        holds(text)
    assert f"`{text}`" in str(caught.value)


def test_the_names_that_are_used_are_known() -> None:
    assert Expression("risk > 1 and norm(position) < x", VALUES).names == ("position", "risk", "x")


@settings(max_examples=300)
@given(st.text(string.printable, max_size=80))
def test_no_text_does_anything_but_mean_something_or_be_refused(text: str) -> None:
    with contextlib.suppress(ExpressionError, EvaluationError):
        holds(text)


numbers = st.one_of(st.sampled_from(["x", "risk", "norm(position)"]), st.floats(0, 100).map(lambda f: f"{f:.3f}"))
sums = st.recursive(
    numbers, lambda inner: st.tuples(inner, st.sampled_from("+-*"), inner).map(lambda t: f"({t[0]} {t[1]} {t[2]})")
)


@given(sums, sums, st.sampled_from(["<", "<=", ">", ">="]))
def test_arithmetic_is_that_of_python(left: str, right: str, sign: str) -> None:
    text = f"{left} {sign} {right}"
    if len(text) > 500:
        return
    names = {"x": 2.0, "risk": 0.3, "position": VALUES["position"], "norm": np.linalg.norm}
    assert holds(text) == eval(text, {"__builtins__": {}}, names)


def test_every_function_is_documented_by_an_example() -> None:
    text = " ".join(line for case in untyped(test_numbers).pytestmark[0].args[1] for line in case[:1])
    text += " ".join(case[0] for case in untyped(test_true_conditions).pytestmark[0].args[1])
    assert all(f"{name}(" in text for name in FUNCTIONS)
