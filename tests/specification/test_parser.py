"""One grammar serves conditions and specifications; its table of precedence decides what belongs together."""

import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from symaware_cli.specification.node import (
    Arithmetic,
    Call,
    Comparison,
    Constant,
    Element,
    Junction,
    Name,
    Node,
    Not,
    Sign,
    Temporal,
    Vector,
)
from symaware_cli.specification.parser import parse
from symaware_cli.specification.printing import printed
from symaware_cli.specification.token import ExpressionError

NAMES = ("a", "b", "c", "position", "arena")
FUNCTIONS = {"inside": 2, "max": None}
NOWHERE = (0, 0)


def tree(text: str) -> Node:
    return parse(text, NAMES, FUNCTIONS)


@pytest.mark.parametrize(
    ("text", "bracketed"),
    [
        ("a or b and c", "a or (b and c)"),
        ("a implies b implies c", "a implies (b implies c)"),
        ("a or b implies c", "(a or b) implies c"),
        ("not a and b", "(not a) and b"),
        ("not a > b", "not (a > b)"),
        ("always a and b", "(always a) and b"),
        ("always a > 1 implies b", "(always (a > 1)) implies b"),
        ("always not eventually a", "always (not (eventually a))"),
        ("a until b and c", "(a until b) and c"),
        ("a and b until c", "a and (b until c)"),
        ("a until[0, 2] b until c", "a until[0, 2] (b until c)"),
        ("not a until b", "(not a) until b"),
        ("a since eventually b", "a since (eventually b)"),
        ("-a ** 2 < b + c * 2", "(-(a ** 2)) < (b + (c * 2))"),
        ("a - b - c", "(a - b) - c"),
        ("2 ** -a ** b", "2 ** (-(a ** b))"),
    ],
)
def test_precedence_of_operators(text: str, bracketed: str) -> None:
    assert tree(text) == tree(bracketed)


@pytest.mark.parametrize(
    ("text", "problem", "marked"),
    [
        ("always[0 5] a", "a window is two times in seconds: always[0, 5] or always[2, inf]", "5"),
        ("always[0] a", "a window is two times in seconds", "]"),
        ("eventually[-1, 2] a", "the past has operators of its own: once, historically, since", "-"),
        ("eventually[3, 2] a", "the window ends before it begins", "[3, 2]"),
        ("eventually[a, 2] b", "a window is two times in seconds", "a"),
        ("next[0, 1] a", "`next` has no window", "next"),
        ("a until", "the expression breaks off here", "l"),
        ("a == next b", "`next` cannot stand after an operator that binds more tightly: put it in brackets", "next"),
        ("2 * not a", "`not` cannot stand after an operator that binds more tightly", "not"),
        ("until b", "`until` cannot stand here: a value is missing before it", "until"),
        ("a b", "`b` cannot stand here: an operator is missing before it", "b"),
        ("inside(position)", "inside(...) takes 2 arguments, not 1", "inside(position)"),
        ("inside(position, arenna)", "there is no `arenna` here", "arenna"),
        ("always", "the expression breaks off here", "s"),
        ("()", "the brackets are empty", "()"),
    ],
)
def test_problems_are_reported_at_their_place(text: str, problem: str, marked: str) -> None:
    with pytest.raises(ExpressionError) as caught:
        tree(text)
    assert problem in caught.value.problem
    assert text[caught.value.start : caught.value.end] == marked


def test_a_definition_stands_for_its_tree() -> None:
    near = tree("a < 1")
    assert parse("always near", NAMES, FUNCTIONS, {"near": near}) == tree("always a < 1")


def _numbers(inner: st.SearchStrategy[Node]) -> st.SearchStrategy[Node]:
    return st.one_of(
        st.builds(lambda one: Sign(NOWHERE, "-", one), inner),
        st.builds(lambda sign, one, two: Arithmetic(NOWHERE, sign, one, two), st.sampled_from("+-*/%"), inner, inner),
        st.builds(lambda one, two: Arithmetic(NOWHERE, "**", one, two), inner, inner),
        st.builds(lambda items: Vector(NOWHERE, tuple(items)), st.lists(inner, min_size=2, max_size=3)),
        st.builds(lambda items: Call(NOWHERE, "max", tuple(items)), st.lists(inner, min_size=1, max_size=3)),
        st.builds(
            lambda one, key: Element(NOWHERE, one, key), st.builds(lambda: Name(NOWHERE, "a")), st.integers(-3, 3)
        ),
    )


NUMBERS = st.recursive(
    st.one_of(
        st.builds(lambda name: Name(NOWHERE, name), st.sampled_from(NAMES)),
        st.builds(lambda value: Constant(NOWHERE, value), st.floats(0, 1e6)),
    ),
    _numbers,
    max_leaves=5,
)
WINDOWS = st.one_of(
    st.none(), st.tuples(st.floats(0, 5), st.floats(5, 9)), st.tuples(st.floats(0, 5), st.just(float("inf")))
)


def _conditions(inner: st.SearchStrategy[Node]) -> st.SearchStrategy[Node]:
    several = st.lists(inner, min_size=2, max_size=3).map(tuple)
    return st.one_of(
        st.builds(lambda one: Not(NOWHERE, one), inner),
        st.builds(lambda word, each: Junction(NOWHERE, word, each), st.sampled_from(["and", "or"]), several),
        st.builds(lambda one, two: Junction(NOWHERE, "implies", (one, two)), inner, inner),
        st.builds(lambda one: Temporal(NOWHERE, "next", None, (one,)), inner),
        st.builds(
            lambda word, window, one: Temporal(NOWHERE, word, window, (one,)),
            st.sampled_from(["always", "eventually", "once", "historically"]),
            WINDOWS,
            inner,
        ),
        st.builds(
            lambda word, window, one, two: Temporal(NOWHERE, word, window, (one, two)),
            st.sampled_from(["until", "since"]),
            WINDOWS,
            inner,
            inner,
        ),
    )


COMPARISONS = st.builds(
    lambda signs, numbers: Comparison(NOWHERE, tuple(signs), tuple(numbers[: len(signs) + 1])),
    st.lists(st.sampled_from(["<", "<=", ">", ">=", "==", "!="]), min_size=1, max_size=2),
    st.lists(NUMBERS, min_size=3, max_size=3),
)
CONDITIONS = st.recursive(COMPARISONS, _conditions, max_leaves=6)


@settings(max_examples=200, deadline=None)
@given(CONDITIONS)
def test_a_tree_is_printed_as_text_that_is_parsed_to_the_same_tree(node: Node) -> None:
    text = printed(node)
    assert printed(parse(text, NAMES, FUNCTIONS, longest=100_000)) == text


@settings(max_examples=200, deadline=None)
@given(st.text(st.sampled_from("ab01.()[],<>=+-*/ \"'!&|")) | st.text(max_size=20))
def test_any_text_is_parsed_or_refused(text: str) -> None:
    with contextlib.suppress(ExpressionError):
        assert printed(tree(text))
