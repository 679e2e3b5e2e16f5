"""From the text of an expression to its tokens."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass

from symaware_cli.specification.node import Span

_TOKEN = re.compile(
    r"(?P<space>\s+)"
    r"|(?P<number>(?:\d[\d_]*\.?[\d_]*|\.\d[\d_]*)(?:[eE][-+]?\d+)?)"
    r"|(?P<word>[^\W\d]\w*)"
    r"|(?P<text>\"[^\"\n]*\"|'[^'\n]*')"
    r"|(?P<operator>\*\*|<=|>=|==|!=|[-+*/%<>()\[\],])"
)


class ExpressionError(ValueError):
    """A text is not a valid expression.

    Attributes:
        problem: What is wrong, in one sentence.
        start: Where in the text, in characters.
        end: Where that ends.
        names: What could stand there, if it is a name that is wrong.
        name: The name that is wrong, if one is.
    """

    def __init__(self, problem: str, span: Span, name: str = "", names: Collection[str] = ()) -> None:
        super().__init__(problem)
        self.problem = problem
        self.start, self.end = span
        self.name = name
        self.names = sorted(names)


@dataclass(frozen=True, slots=True)
class Token:
    """A word, a number, a text in quotes or an operator.

    Attributes:
        kind: "word", "number", "text", "operator", or "end" after the last.
        text: As written.
        span: Where.
    """

    kind: str
    text: str
    span: Span


def tokens(text: str) -> Iterator[Token]:
    """Yield the tokens of a text and then one of the kind "end".

    Raises:
        ExpressionError: A character belongs to no token.
    """
    position = 0
    while position < len(text):
        match = None if text.startswith("->", position) else _TOKEN.match(text, position)
        if match is None:
            raise ExpressionError(*_unknown(text, position))
        if match.lastgroup != "space":
            yield Token(str(match.lastgroup), match.group(), match.span())
        position = match.end()
    yield Token("end", "", (len(text), len(text)))


def _unknown(text: str, position: int) -> tuple[str, Span]:
    """What is wrong with a character that begins no token, and where."""
    character, rest = text[position], text[position : position + 2]
    one = (position, position + 1)
    if character in "\"'":
        return "the text in quotes does not end", (position, len(text))
    if rest in ("&&", "||"):
        return f"write `{'and' if rest == '&&' else 'or'}` instead of `{rest}`", (position, position + 2)
    if rest == "->":
        return "write `implies` instead of `->`", (position, position + 2)
    if character == "!":
        return "write `not` instead of `!`", one
    if character == "=":
        return "write `==` to compare, instead of `=`", one
    return f"{character!r} has no meaning in an expression", one
