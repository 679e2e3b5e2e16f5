"""Tokenizer of expressions: splits text into numbers, words, quoted texts and operators."""

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
    r"|(?P<operator>\*\*|<=|>=|==|!=|[-+*/%<>()\[\],.])"
)


class ExpressionError(ValueError):
    """A text is not a valid expression.

    Attributes:
        problem: What is wrong, in one sentence.
        start: Start of the faulty part of the text, in characters.
        end: Its end.
        names: Valid names, if an unknown name is the problem.
        name: The unknown name, if any.
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
        kind: "word", "number", "text", "operator", or "end" after the last token.
        text: The characters of the token.
        span: Its position in the text.
    """

    kind: str
    text: str
    span: Span


def tokens(text: str) -> Iterator[Token]:
    """Yield the tokens of a text, followed by one of kind "end".

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
    """Describe a character that begins no token, and return its span."""
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
