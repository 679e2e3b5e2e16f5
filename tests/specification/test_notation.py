"""Notations of other languages are answered by what to write instead, and that is valid."""

import pytest

from symaware_cli.specification.columns import ARGUMENTS
from symaware_cli.specification.parser import parse
from symaware_cli.specification.printing import printed
from symaware_cli.specification.token import ExpressionError

NAMES = ("x", "y", "position")


def corrected(text: str) -> str:
    """Apply hints until an expression is valid."""
    for _ in range(9):
        try:
            return printed(parse(text, NAMES, ARGUMENTS))
        except ExpressionError as error:
            found = error
        assert found.correction is not None, (text, found.problem)
        text = text[: found.start] + found.correction + text[found.end :]
    raise AssertionError(text)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        *((f"x > 0 {sign} x < 9", "x > 0 implies x < 9") for sign in ("=>", "->", "-->", "==>", "→", "⇒", "imply")),
        *((f"x > 0{sign}x < 9", "x > 0 and x < 9") for sign in ("&", "&&", "∧", "/\\", " AND ")),
        *((f"x > 0 {sign} x < 9", "x > 0 or x < 9") for sign in ("|", "||", "∨", "\\/", "OR")),
        *((f"{sign}(x > 0)", "not x > 0") for sign in ("!", "~", "¬", "NOT ", "NOT")),
        *(
            (f"x > 0 {sign} x < 9", "(x > 0 implies x < 9) and (x < 9 implies x > 0)")
            for sign in ("<->", "<=>", "↔", "⇔", "≡")
        ),
        ("always (x > 0 <-> x < 9)", "always ((x > 0 implies x < 9) and (x < 9 implies x > 0))"),
        *((f"{word} x > 0", "always x > 0") for word in ("G", "globally", "Globally", "ALWAYS", "□", "[]", "Always")),
        *((f"{word} (x > 0)", "always x > 0") for word in ("G", "globally", "□", "[]")),
        *((f"{word}(x > 0)", "eventually x > 0") for word in ("F", "finally", "◇", "<>", "EVENTUALLY")),
        *((f"{word} x > 0", "next x > 0") for word in ("X", "○", "Next")),
        ("N (x > 0)", "weak next x > 0"),
        *((f"(x > 0) {word} (y > 0)", "x > 0 until y > 0") for word in ("U", "UNTIL")),
        ("(x > 0) U[0,5] (y > 0)", "x > 0 until[0, 5] y > 0"),
        ("G[0:5] x > 0", "always[0, 5] x > 0"),
        ("F_[0,5](x > 0)", "eventually[0, 5] x > 0"),
        ("always[0:5] x > 0", "always[0, 5] x > 0"),
        ("always[0, ∞] x > 0", "always[0, inf] x > 0"),
        ("G (x ≥ 0 & F y ≤ 1 → ¬(x ≠ y))", "always (x >= 0 and eventually y <= 1 implies not x != y)"),
        ("x = 1", "x == 1"),
        ("x =< 1", "x <= 1"),
        ("x <> 1", "x != 1"),
        ("x ^ 2 > 1", "x ** 2 > 1"),
        ("x − 1 > 2 × y", "x - 1 > 2 * y"),
        ("TRUE", "true"),
        ("H x > 0 and O y > 0 or (x > 0) S (y > 0)", None),
    ],
)
def test_a_hint_that_is_applied_gives_a_valid_expression(text: str, expected: str | None) -> None:
    found = corrected(text)
    assert expected is None or found == expected


def test_our_own_notation_needs_no_hint() -> None:
    for text in ("x >= 0 and x != 1 or -x <= 3", "always[0, 5] not (x - -1 > 0 implies y == 2)", '"a->b" == "[]"'):
        assert printed(parse(text, NAMES, ARGUMENTS))


def test_a_name_takes_precedence_over_the_word_of_another_language() -> None:
    assert printed(parse("G > 0 and X < 1", ("G", "X"), {})) == "G > 0 and X < 1"
