"""Tokenizer of expressions: splits text into numbers, words, quoted texts and operators."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass

from symaware_cli.specification.node import Span
from symaware_cli.specification.notation import foreign_sign

_TOKEN = re.compile(
    r"(?P<space>\s+)"
    r"|(?P<number>(?:\d[\d_]*\.?[\d_]*|\.\d[\d_]*)(?:[eE][-+]?\d+)?)"
    r"|(?P<word>weak\s+next\b|[^\W\d]\w*)"
    r"|(?P<text>\"[^\"\n]*\"|'[^'\n]*')"
    r"|(?P<operator>\*\*|<=|>=|==|!=|[-+*/%<>()\[\],.])"
)


class ExpressionError(ValueError):
    """A text is not a valid expression.

    Attributes:
        problem: The error, in one sentence.
        start: Start of the faulty part of the text, in characters.
        end: Its end.
        names: Valid names, if an unknown name is the problem.
        name: The unknown name, if any.
        correction: The text to write in place of the faulty part; None if that is not known.
    """

    def __init__(
        self,
        problem: str,
        span: Span,
        name: str = "",
        names: Collection[str] = (),
        correction: str | None = None,
        *,
        quotes: bool = False,
    ) -> None:
        """Initialise.

        Args:
            problem: The error, in one sentence.
            span: The faulty part of the text.
            name: The unknown name, if any.
            names: Valid names, if an unknown name is the problem.
            correction: The text to write in place of the faulty part.
            quotes: Whether the span includes quotes around the name, which is narrowed to the name.
        """
        super().__init__(problem)
        self.problem = problem
        self.start, self.end = (span[0] + 1, span[1] - 1) if quotes else span
        self.name = name
        self.names = sorted(names)
        self.correction = correction


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
        foreign = foreign_sign(text, position)
        match = _TOKEN.match(text, position)
        if foreign is not None and (match is None or len(match.group()) < foreign.length):
            raise ExpressionError(foreign.problem, foreign.span, correction=foreign.correction)
        if match is None:
            raise ExpressionError(*_unknown(text, position))
        if match.lastgroup != "space":
            yield Token(str(match.lastgroup), " ".join(match.group().split()), match.span())
        position = match.end()
    yield Token("end", "", (len(text), len(text)))


def _unknown(text: str, position: int) -> tuple[str, Span]:
    """Describe a character that begins no token, and return its span."""
    character = text[position]
    if character in "\"'":
        return "the text in quotes does not end", (position, len(text))
    return f"{character!r} has no meaning in an expression", (position, position + 1)
